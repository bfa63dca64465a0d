//! Lines for a parameter file, to be pasted below `ros__parameters`.

use std::fmt;

use serde::{Serialize, Serializer};

use super::sides::Sides;
use super::topic::Look;

/// The lines of one source in a parameter file, below `ros__parameters`.
///
/// Shown, and serialized, as YAML that can be pasted there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceLines {
    /// `tactile` or `joint`.
    pub section: &'static str,
    /// Name of the source, after its topic.
    pub name: String,
    /// Its keys in order, the topic and the type first.
    pub lines: Vec<SourceLine>,
}

/// One line of a source.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SourceLine {
    /// A key and its value.
    Value {
        /// The key within the source.
        key: &'static str,
        /// The value as YAML has it.
        value: String,
        /// Why it is as it is.
        note: Option<String>,
    },
    /// A line for the reader alone.
    Remark(String),
}

impl SourceLines {
    /// A source in `section`, named by its topic.
    pub(super) fn new(section: &'static str, topic: &str, type_name: &str) -> Self {
        let mut source = SourceLines { section, name: source_name(topic), lines: Vec::new() };
        source.line("topic", &yaml_text(topic));
        source.line("type", &yaml_text(type_name));
        source
    }

    pub(super) fn line(&mut self, key: &'static str, value: &str) {
        self.lines.push(SourceLine::Value { key, value: value.to_owned(), note: None });
    }

    /// A line, and why it is as it is.
    pub(super) fn noted(&mut self, key: &'static str, value: &str, note: &str) {
        self.lines.push(SourceLine::Value { key, value: value.to_owned(), note: Some(note.to_owned()) });
    }

    /// A line for the reader alone.
    pub(super) fn remark(&mut self, words: &str) {
        self.lines.push(SourceLine::Remark(words.to_owned()));
    }

    /// Where the stamp comes from, unless it is where it is looked for anyway.
    pub(super) fn stamp(&mut self, look: &Look) {
        match look.stamp_path() {
            Some("header.stamp") => {}
            Some(path) => self.line("stamp", &yaml_text(path)),
            None => self.noted("stamp", "receipt", look.why_receipt()),
        }
        if let (None, Some((path, unit))) = (look.stamp_path(), &look.clock) {
            self.remark(&format!(
                "{path} may be the device's clock: stamp: {path}, stamp_unit: {unit}, stamp_since: boot"
            ));
        }
    }

    /// Which of several hands on the topic it is, where one is known.
    pub(super) fn only(&mut self, sides: Option<&Sides>) {
        let Some(Sides { field, values }) = sides else { return };
        match &values[..] {
            [only] => {
                self.noted("only", &yaml_text(&format!("{field}={only}")), "all messages here are; others are not used")
            }
            _ => self.remark(&format!("several are on the topic; one of them: only: {field}={}", values[0])),
        }
    }
}

impl fmt::Display for SourceLines {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}:\n  {}:", self.section, self.name)?;
        self.lines.iter().try_for_each(|line| match line {
            SourceLine::Value { key, value, note: None } => writeln!(f, "    {key}: {value}"),
            SourceLine::Value { key, value, note: Some(note) } => writeln!(f, "    {key}: {value}  # {note}"),
            SourceLine::Remark(words) => writeln!(f, "    # {words}"),
        })
    }
}

impl Serialize for SourceLines {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Name of the source that a topic becomes: `/left/glove/taxels` is `left_glove_taxels`.
pub fn source_name(topic: &str) -> String {
    let words: Vec<String> = topic
        .split(|c: char| !c.is_ascii_alphanumeric())
        .filter(|word| !word.is_empty())
        .map(str::to_ascii_lowercase)
        .collect();
    let name = words.join("_");
    if name.starts_with(|c: char| c.is_ascii_lowercase()) { name } else { format!("source_{name}") }
}

/// A string as YAML has it: quoted where it could be taken for something else.
pub fn yaml_text(value: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '/' | '_' | '.' | '~');
    let begins = value.starts_with(|c: char| c.is_ascii_alphabetic() || c == '/');
    if begins && value.chars().all(is_plain) { value.to_owned() } else { serde_json::Value::from(value).to_string() }
}

/// A number that a parameter file takes for a double.
pub(super) fn decimal(value: f64) -> String {
    let text = format!("{value:.6}");
    let short = text.trim_end_matches('0');
    if short.ends_with('.') { format!("{short}0") } else { short.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_become_names_and_values_stay_what_they_are() {
        assert_eq!(source_name("/Left/glove-2/taxels"), "left_glove_2_taxels");
        assert_eq!(source_name("/2"), "source_2");
        assert_eq!(yaml_text("sensors[].values"), "\"sensors[].values\"");
        assert_eq!(yaml_text("/a/b"), "/a/b");
        assert_eq!((decimal(10.0), decimal(0.15151515)), ("10.0".to_owned(), "0.151515".to_owned()));
    }
}
