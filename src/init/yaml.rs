//! YAML with its reasons as comments.

/// Widest line, unless a word is wider.
const WIDTH: usize = 120;

/// Text of a parameter file, line by line.
#[derive(Debug, Default)]
pub(super) struct Yaml {
    text: String,
}

impl Yaml {
    /// A comment of as many lines as it takes. Characters that would end it or steer a terminal become spaces.
    pub(super) fn comment(&mut self, indent: usize, words: &str) {
        let words = words.replace(|c: char| c.is_control() || matches!(c, '\u{2028}' | '\u{2029}'), " ");
        let mut line = String::new();
        for word in words.split_whitespace() {
            if !line.is_empty() && indent + 3 + line.chars().count() + word.chars().count() > WIDTH {
                self.line(indent, &format!("# {line}"));
                line.clear();
            }
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
        self.line(indent, format!("# {line}").trim_end());
    }

    /// A key without a value of its own.
    pub(super) fn section(&mut self, indent: usize, key: &str) {
        self.line(indent, &format!("{key}:"));
    }

    /// A key, its value as YAML has it, and the reason for it, which may be empty.
    pub(super) fn entry(&mut self, indent: usize, key: &str, value: &str, why: &str) {
        let why = why.replace(|c: char| c.is_control(), " ");
        let line = format!("{key}: {value}");
        if why.is_empty() {
            self.line(indent, &line);
        } else if indent + line.chars().count() + why.chars().count() + 4 <= WIDTH {
            self.line(indent, &format!("{line}  # {why}"));
        } else {
            self.comment(indent, &why);
            self.line(indent, &line);
        }
    }

    pub(super) fn empty(&mut self) {
        self.text.push('\n');
    }

    /// Whether these lines are in it.
    pub(super) fn contains(&self, lines: &str) -> bool {
        self.text.contains(lines)
    }

    fn line(&mut self, indent: usize, words: &str) {
        self.text.extend(std::iter::repeat_n(' ', indent));
        self.text.push_str(words);
        self.text.push('\n');
    }

    pub(super) fn finish(self) -> String {
        self.text
    }
}

/// Texts as a YAML list in one line.
pub(super) fn list<T: AsRef<str>>(texts: &[T]) -> String {
    let texts: Vec<String> = texts.iter().map(|text| crate::inspect::yaml_text(text.as_ref())).collect();
    format!("[{}]", texts.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_words_stay_within_their_comment() {
        let mut yaml = Yaml::default();
        yaml.comment(2, "a topic\nregions: []");
        yaml.entry(2, "topic", "/a", "b\nc: d");
        yaml.comment(0, &"word ".repeat(60));
        let text = yaml.finish();
        assert!(
            text.lines().all(|line| line.trim_start().starts_with('#') || line == "  topic: /a  # b c: d"),
            "{text}"
        );
        assert!(text.lines().all(|line| line.len() <= WIDTH), "{text}");
        assert_eq!(list(&["a", "b c"]), "[a, \"b c\"]");
    }
}
