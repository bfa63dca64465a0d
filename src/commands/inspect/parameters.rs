//! Lines for a parameter file, to be pasted below `ros__parameters`.

use std::fmt::Write as _;

/// The lines of one source.
#[derive(Debug)]
pub(super) struct Block {
    text: String,
}

impl Block {
    /// A source in `section`, named by its topic.
    pub(super) fn new(section: &str, topic: &str, type_name: &str) -> Self {
        let mut block = Block { text: format!("{section}:\n  {}:\n", source_name(topic)) };
        block.line("topic", &text(topic));
        block.line("type", &text(type_name));
        block
    }

    pub(super) fn line(&mut self, key: &str, value: &str) {
        let _ = writeln!(self.text, "    {key}: {value}"); // a String takes every write
    }

    /// A line, and why it is as it is.
    pub(super) fn noted(&mut self, key: &str, value: &str, note: &str) {
        self.line(key, &format!("{value}  # {note}"));
    }

    /// A line for the reader alone.
    pub(super) fn remark(&mut self, words: &str) {
        let _ = writeln!(self.text, "    # {words}");
    }

    /// Where the stamp comes from, unless it is where it is looked for anyway.
    pub(super) fn stamp(&mut self, path: Option<&str>) {
        match path {
            Some("header.stamp") => {}
            Some(path) => self.line("stamp", &text(path)),
            None => self.noted("stamp", "receipt", "the type has none, so the time of receipt counts"),
        }
    }

    pub(super) fn finish(self) -> String {
        self.text
    }
}

/// Name of the source that a topic becomes: `/left/glove/taxels` is `left_glove_taxels`.
pub(super) fn source_name(topic: &str) -> String {
    let words: Vec<String> = topic
        .split(|c: char| !c.is_ascii_alphanumeric())
        .filter(|word| !word.is_empty())
        .map(str::to_ascii_lowercase)
        .collect();
    let name = words.join("_");
    if name.starts_with(|c: char| c.is_ascii_lowercase()) { name } else { format!("source_{name}") }
}

/// A string as YAML has it: quoted where it could be taken for something else.
pub(super) fn text(value: &str) -> String {
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
        assert_eq!(text("sensors[].values"), "\"sensors[].values\"");
        assert_eq!(text("/a/b"), "/a/b");
        assert_eq!((decimal(10.0), decimal(0.15151515)), ("10.0".to_owned(), "0.151515".to_owned()));
    }
}
