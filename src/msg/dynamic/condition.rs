//! Conditions on the value of a field of an element.

use super::leaf::Leaf;
use super::skip::{self, Op};
use super::{ElementKind, FieldKind, numbers};
use crate::msg::cdr::{CdrError, CdrReader};
use crate::msg::definition::Primitive;

/// Maximum number of values that an error lists.
const SHOWN: usize = 8;

/// Maximum length of a value in an error, characters.
const SHOWN_CHARACTERS: usize = 40;

/// Required value of a field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Wanted {
    Text(String),
    Whole(i128),
}

impl Wanted {
    /// The value as the type of the field. `None` if no field of this type can have it, or if the type can't be
    /// compared.
    pub(super) fn of(kind: FieldKind, value: &str) -> Option<Self> {
        let FieldKind { element, many: false } = kind else { return None };
        match element {
            ElementKind::Text => Some(Wanted::Text(value.to_owned())),
            ElementKind::Number(Primitive::Bool) => match value {
                "true" | "1" => Some(Wanted::Whole(1)),
                "false" | "0" => Some(Wanted::Whole(0)),
                _ => None,
            },
            ElementKind::Number(primitive) => {
                let [least, most] = numbers::whole_range(primitive)?;
                value.parse().ok().filter(|whole| (least..=most).contains(whole)).map(Wanted::Whole)
            }
            ElementKind::Time | ElementKind::Duration => None,
        }
    }

    /// Types that a condition can compare, for an error.
    pub(super) const EXPECTED: &'static str = "a string, a whole number or a truth value that can have this value";

    pub(super) fn holds(&self, leaf: Leaf, reader: &mut CdrReader<'_>) -> Result<bool, CdrError> {
        match self {
            Wanted::Text(wanted) => leaf.texts(reader).and_then(|_| Ok(reader.text()? == wanted.as_bytes())),
            Wanted::Whole(wanted) => {
                let (primitive, bytes) = leaf.numbers(reader)?;
                Ok(numbers::whole(primitive, bytes, reader.is_little_endian()) == *wanted)
            }
        }
    }
}

/// A field of an element, and its required value.
#[derive(Debug, Clone)]
pub(super) struct Condition {
    /// `field=value`.
    pub(super) text: String,
    pub(super) lead: Vec<Op>,
    pub(super) leaf: Leaf,
    pub(super) wanted: Wanted,
}

impl Condition {
    /// True if the element at the reader's position has the value.
    pub(super) fn holds(&self, reader: &mut CdrReader<'_>) -> Result<bool, CdrError> {
        skip::run(&self.lead, reader)?;
        self.wanted.holds(self.leaf, reader)
    }

    /// The error that none of `len` elements has the value. The first one begins at the reader's position.
    pub(super) fn unmet(&self, len: usize, past: &[Op], reader: &mut CdrReader<'_>) -> CdrError {
        let mut values = Vec::new();
        for _ in 0..len.min(SHOWN) {
            let mut element = reader.clone();
            let value = skip::run(&self.lead, &mut element).and_then(|()| shown(self.leaf, &mut element));
            values.extend(value);
            if skip::run(past, reader).is_err() {
                break;
            }
        }
        values.extend((len > SHOWN).then(|| format!("{len} elements in all")));
        let got = if values.is_empty() { "no elements".to_owned() } else { values.join(", ") };
        CdrError::NoMatch { condition: self.text.clone(), got }
    }
}

/// The value of a field on one line.
pub(super) fn shown(leaf: Leaf, reader: &mut CdrReader<'_>) -> Result<String, CdrError> {
    if let Ok((primitive, bytes)) = leaf.numbers(&mut reader.clone()) {
        return Ok(numbers::whole(primitive, bytes, reader.is_little_endian()).to_string());
    }
    leaf.texts(reader)?;
    let text = String::from_utf8_lossy(reader.text()?).into_owned();
    let short: String = text.chars().take(SHOWN_CHARACTERS).collect();
    Ok(format!("'{}'", short.escape_debug()))
}
