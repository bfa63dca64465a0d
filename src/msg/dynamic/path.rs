//! Parses field paths.

use super::FieldError;

/// One name on a path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Segment {
    pub(super) name: String,
    pub(super) select: Select,
}

/// Selection of elements of an array on the path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Select {
    /// No brackets.
    Whole,
    /// `[]`.
    Every,
    /// `[index]`.
    Element(usize),
    /// `[field=value]`: the elements whose field has this value.
    Where {
        /// Path of the field in the element.
        field: Vec<Segment>,
        value: String,
    },
}

/// The segments of a path, at least one.
pub(super) fn parse(path: &str) -> Result<Vec<Segment>, FieldError> {
    let error = |reason: String| FieldError::Syntax { path: path.to_owned(), reason };
    parts(path).into_iter().map(|part| segment(part).map_err(error)).collect()
}

/// Splits at the dots outside of brackets.
fn parts(path: &str) -> Vec<&str> {
    let (mut parts, mut start, mut within) = (Vec::new(), 0, false);
    for (at, character) in path.char_indices() {
        match character {
            '[' => within = true,
            ']' => within = false,
            '.' if !within => {
                parts.push(&path[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&path[start..]);
    parts
}

fn segment(part: &str) -> Result<Segment, String> {
    let Some((name, brackets)) = part.split_once('[') else { return named(part, Select::Whole) };
    let inside = brackets.strip_suffix(']').ok_or_else(|| format!("'{part}' leaves a bracket open"))?;
    let select = match inside.split_once('=') {
        None if inside.is_empty() => Select::Every,
        None => {
            let is_number = inside.bytes().all(|byte| byte.is_ascii_digit());
            let number = inside.parse().ok().filter(|_| is_number);
            Select::Element(number.ok_or_else(|| format!("'{inside}' is not an index"))?)
        }
        Some((field, value)) => {
            let (field, value) = condition(field, value)?;
            Select::Where { field, value }
        }
    };
    named(name, select)
}

/// `field=value`. The field may be a path with dots.
pub(super) fn condition(field: &str, value: &str) -> Result<(Vec<Segment>, String), String> {
    let field: Result<Vec<Segment>, String> = field.trim().split('.').map(|name| named(name, Select::Whole)).collect();
    let value = value.trim();
    if value.is_empty() || value.contains(['[', ']']) {
        return Err(format!("'{value}' is not a value, such as tip or 2"));
    }
    Ok((field?, value.to_owned()))
}

fn named(name: &str, select: Select) -> Result<Segment, String> {
    let is_name = name.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
        && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
    if is_name { Ok(Segment { name: name.to_owned(), select }) } else { Err(format!("'{name}' is not a name")) }
}

/// Text of a path.
pub(super) fn display(segments: &[Segment]) -> String {
    let parts: Vec<String> = segments
        .iter()
        .map(|segment| match &segment.select {
            Select::Whole => segment.name.clone(),
            Select::Every => format!("{}[]", segment.name),
            Select::Element(index) => format!("{}[{index}]", segment.name),
            Select::Where { field, value } => format!("{}[{}={value}]", segment.name, display(field)),
        })
        .collect();
    parts.join(".")
}
