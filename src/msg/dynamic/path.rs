//! The text of a field path.

use super::FieldError;

/// One name on a path.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Segment {
    pub(super) name: String,
    pub(super) select: Select,
}

/// Which elements of an array the path goes through.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Select {
    /// No brackets.
    Whole,
    /// `[]`.
    Every,
    /// `[index]`.
    Element(usize),
}

/// The names of a path, at least one.
pub(super) fn parse(path: &str) -> Result<Vec<Segment>, FieldError> {
    let error = |reason: String| FieldError::Syntax { path: path.to_owned(), reason };
    path.split('.')
        .map(|part| {
            let (name, select) = match part.split_once('[') {
                None => (part, Select::Whole),
                Some((name, brackets)) => {
                    let inside =
                        brackets.strip_suffix(']').ok_or_else(|| error(format!("'{part}' leaves a bracket open")))?;
                    let select = match inside {
                        "" => Select::Every,
                        index => {
                            let is_number = index.bytes().all(|byte| byte.is_ascii_digit());
                            let number = index.parse().ok().filter(|_| is_number);
                            Select::Element(number.ok_or_else(|| error(format!("'{index}' is not an index")))?)
                        }
                    };
                    (name, select)
                }
            };
            let is_name = name.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
                && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
            if is_name {
                Ok(Segment { name: name.to_owned(), select })
            } else {
                Err(error(format!("'{name}' is not a name")))
            }
        })
        .collect()
}

/// The path that `segments` were parsed from.
pub(super) fn display(segments: &[Segment]) -> String {
    let parts: Vec<String> = segments
        .iter()
        .map(|segment| match segment.select {
            Select::Whole => segment.name.clone(),
            Select::Every => format!("{}[]", segment.name),
            Select::Element(index) => format!("{}[{index}]", segment.name),
        })
        .collect();
    parts.join(".")
}
