//! All parameters: type, default, range, unit and meaning. Parsing, checks of values, the live node's descriptors and
//! the documentation use this table.

mod table;

use std::fmt;

use super::scalar::ParamValue;

pub use table::KEYS;

/// The type of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ParamKind {
    /// `bool`.
    Bool,
    /// `int`.
    Int,
    /// `double`; an int is accepted too.
    Double,
    /// `string`.
    Str,
    /// `int[]`.
    IntArray,
    /// `double[]` with this number of elements; ints are accepted too.
    DoubleArray(usize),
    /// `double[]` with any number of elements; ints are accepted too.
    Doubles,
    /// `string[]`.
    StrArray,
    /// An int, or the path of a field as a `string`.
    IntOrField,
}

impl ParamKind {
    /// True if a parameter of this type accepts the value.
    pub fn fits(self, value: &ParamValue) -> bool {
        use ParamValue::{Bool, Double, DoubleArray, EmptyArray, Int, IntArray, Str, StrArray};
        match self {
            ParamKind::Bool => matches!(value, Bool(_)),
            ParamKind::Int => matches!(value, Int(_)),
            ParamKind::Double => matches!(value, Int(_) | Double(_)),
            ParamKind::Str => matches!(value, Str(_)),
            ParamKind::IntArray => matches!(value, IntArray(_) | EmptyArray),
            ParamKind::StrArray => matches!(value, StrArray(_) | EmptyArray),
            ParamKind::IntOrField => matches!(value, Int(_) | Str(_)),
            ParamKind::Doubles => matches!(value, DoubleArray(_) | IntArray(_) | EmptyArray),
            ParamKind::DoubleArray(len) => match value {
                DoubleArray(values) => values.len() == len,
                IntArray(values) => values.len() == len,
                _ => false,
            },
        }
    }
}

impl fmt::Display for ParamKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ParamKind::Bool => f.write_str("bool"),
            ParamKind::Int => f.write_str("int"),
            ParamKind::Double => f.write_str("double"),
            ParamKind::Str => f.write_str("string"),
            ParamKind::IntArray => f.write_str("int[]"),
            ParamKind::DoubleArray(len) => write!(f, "double[{len}]"),
            ParamKind::Doubles => f.write_str("double[]"),
            ParamKind::StrArray => f.write_str("string[]"),
            ParamKind::IntOrField => f.write_str("int or string"),
        }
    }
}

/// Default of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ParamDefault {
    /// No default: it must be set.
    Required,
    /// A `bool`.
    Bool(bool),
    /// An `int`.
    Int(i64),
    /// A `double`.
    Double(f64),
    /// A `string`.
    Str(&'static str),
    /// A `double[]`.
    Doubles(&'static [f64]),
    /// `[]`.
    EmptyArray,
    /// Depends on other parameters, as described by the text.
    Depends(&'static str),
}

impl ParamDefault {
    /// The default as a value, if it has one.
    pub fn value(&self) -> Option<ParamValue> {
        match *self {
            ParamDefault::Required | ParamDefault::Depends(_) => None,
            ParamDefault::Bool(value) => Some(ParamValue::Bool(value)),
            ParamDefault::Int(value) => Some(ParamValue::Int(value)),
            ParamDefault::Double(value) => Some(ParamValue::Double(value)),
            ParamDefault::Str(value) => Some(ParamValue::Str(value.to_owned())),
            ParamDefault::Doubles(values) => Some(ParamValue::DoubleArray(values.to_vec())),
            ParamDefault::EmptyArray => Some(ParamValue::EmptyArray),
        }
    }
}

impl fmt::Display for ParamDefault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self, self.value()) {
            (ParamDefault::Depends(words), _) => f.write_str(words),
            (_, Some(value)) => value.fmt(f),
            (_, None) => f.write_str("required"),
        }
    }
}

/// Allowed values of a parameter. Doubles must always be finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ParamRange {
    /// Any value of its type.
    Any,
    /// From `min` to `max`, inclusive. For arrays, each element.
    Int {
        /// Smallest.
        min: i64,
        /// Largest.
        max: i64,
    },
    /// From `min` to `max`, inclusive.
    Closed {
        /// Smallest.
        min: f64,
        /// Largest.
        max: f64,
    },
    /// Greater than `min`, at most `max`.
    Above {
        /// Lower bound, exclusive.
        min: f64,
        /// Largest.
        max: f64,
    },
    /// One of these ints.
    Ints(&'static [i64]),
    /// One of these strings.
    OneOf(&'static [&'static str]),
}

impl ParamRange {
    /// True if the value, which has the parameter's type, is in range.
    pub fn contains(&self, value: &ParamValue) -> bool {
        match value {
            ParamValue::Int(value) => self.contains_int(*value),
            ParamValue::IntArray(values) => values.iter().all(|value| self.contains_int(*value)),
            ParamValue::Double(value) => self.contains_double(*value),
            ParamValue::DoubleArray(values) => values.iter().all(|value| self.contains_double(*value)),
            ParamValue::Str(value) => match self {
                ParamRange::OneOf(texts) => texts.contains(&value.as_str()),
                _ => true,
            },
            _ => true,
        }
    }

    fn contains_int(&self, value: i64) -> bool {
        match *self {
            ParamRange::Int { min, max } => (min..=max).contains(&value),
            ParamRange::Ints(values) => values.contains(&value),
            _ => self.contains_double(value as f64),
        }
    }

    fn contains_double(&self, value: f64) -> bool {
        value.is_finite()
            && match *self {
                ParamRange::Closed { min, max } => (min..=max).contains(&value),
                ParamRange::Above { min, max } => value > min && value <= max,
                _ => true,
            }
    }
}

impl fmt::Display for ParamRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ParamRange::Any => f.write_str("finite"),
            ParamRange::Int { min, max } => write!(f, "in [{min}, {max}]"),
            ParamRange::Closed { min, max } => write!(f, "in [{min}, {max}]"),
            ParamRange::Above { min, max } => write!(f, "in ({min}, {max}]"),
            ParamRange::Ints(values) => {
                f.write_str(&values.iter().map(i64::to_string).collect::<Vec<_>>().join(" or "))
            }
            ParamRange::OneOf(texts) => {
                f.write_str(&texts.iter().map(|text| format!("\"{text}\"")).collect::<Vec<_>>().join(" or "))
            }
        }
    }
}

/// A parameter, or a family of parameters that differ in a name, written as `<name>`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParamKey {
    /// The dotted key, such as `tactile.<source>.topic`.
    pub pattern: &'static str,
    /// Its type.
    pub kind: ParamKind,
    /// Default.
    pub default: ParamDefault,
    /// Allowed values.
    pub range: ParamRange,
    /// Unit of the value, empty if it has none.
    pub unit: &'static str,
    /// Meaning, on one line.
    pub about: &'static str,
    /// True if a running node accepts a new value.
    pub at_run_time: bool,
}

impl ParamKey {
    const fn new(pattern: &'static str, kind: ParamKind, default: ParamDefault, about: &'static str) -> Self {
        ParamKey { pattern, kind, default, range: ParamRange::Any, unit: "", about, at_run_time: false }
    }

    const fn range(self, range: ParamRange) -> Self {
        ParamKey { range, ..self }
    }

    const fn unit(self, unit: &'static str) -> Self {
        ParamKey { unit, ..self }
    }

    const fn at_run_time(self) -> Self {
        ParamKey { at_run_time: true, ..self }
    }

    /// The part of a key that stands for the `<...>` of the pattern. `Some("")` if the pattern has none, `None` if the
    /// key doesn't match.
    pub fn name_in<'k>(&self, key: &'k str) -> Option<&'k str> {
        let mut name = "";
        let mut tokens = key.split('.');
        for expected in self.pattern.split('.') {
            let token = tokens.next()?;
            if expected.starts_with('<') {
                name = token;
            } else if expected != token {
                return None;
            }
        }
        tokens.next().is_none().then_some(name)
    }

    /// The key with a name for the pattern's `<...>`.
    pub fn with_name(&self, name: &str) -> String {
        let token = |token: &str| if token.starts_with('<') { name.to_owned() } else { token.to_owned() };
        self.pattern.split('.').map(token).collect::<Vec<_>>().join(".")
    }
}

/// The parameter that a key belongs to.
pub fn find(key: &str) -> Option<&'static ParamKey> {
    KEYS.iter().find(|candidate| candidate.name_in(key).is_some())
}

/// All parameters as a Markdown table, one row per key.
pub fn markdown() -> String {
    let mut page = String::from(
        "| key | type | default | range | unit | at run time | meaning |\n|---|---|---|---|---|---|---|\n",
    );
    for key in KEYS {
        let range = if key.range == ParamRange::Any { String::new() } else { key.range.to_string() };
        let at_run_time = if key.at_run_time { "yes" } else { "" };
        page.push_str(&format!(
            "| `{}` | {} | {} | {range} | {} | {at_run_time} | {} |\n",
            key.pattern, key.kind, key.default, key.unit, key.about
        ));
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_default_is_of_its_type_and_in_range() {
        for key in KEYS {
            if let Some(value) = key.default.value() {
                assert!(key.kind.fits(&value), "{}", key.pattern);
                assert!(key.range.contains(&value), "{}", key.pattern);
            }
            assert!(!key.about.is_empty() && !key.about.contains(['\n', '|']), "{}", key.pattern);
        }
    }

    #[test]
    fn no_key_is_said_twice_and_each_finds_itself() {
        for key in KEYS {
            let concrete = key.with_name("left_2");
            assert_eq!(find(&concrete).map(|found| found.pattern), Some(key.pattern));
        }
        assert_eq!(find("contact"), None);
        assert_eq!(find("contact.force_on.x"), None);
        assert_eq!(
            find("region.index.contact.force_on").map(|key| key.pattern),
            Some("region.<name>.contact.force_on")
        );
    }

    #[test]
    fn the_documentation_has_a_row_for_each_key() {
        let page = markdown();
        assert_eq!(page.lines().count(), KEYS.len() + 2);
        assert!(page.contains(
            "| `contact.force_on` | double | 0.024516625 | in (0, 1000] | N | yes | At or above this force a contact may \
             begin; the default is 2.5 gF |\n"
        ));
    }

    #[test]
    fn the_contact_defaults_are_the_papers_touch_threshold_and_a_gram_less() {
        use crate::units::{GramForce, Newton};
        for (key, grams) in [("contact.force_on", 2.5), ("contact.force_off", 1.5)] {
            let Some(ParamDefault::Double(newtons)) = find(key).map(|key| key.default) else { panic!("{key}") };
            assert!((Newton::from(GramForce(grams)).0 - newtons).abs() < 1e-17, "{key}"); // a few ulp at 0.02
        }
    }
}
