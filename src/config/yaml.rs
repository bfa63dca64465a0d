//! Parses YAML to a small tree with line numbers. Scalars stay as written: rcl has its own rules to resolve them, and
//! they depend on quotes.

use saphyr::{LoadableYamlNode, MarkedYaml, Scalar, YamlData};

/// Largest parameter file, bytes.
pub(super) const MAX_BYTES: usize = 256 * 1024;
/// Maximum nesting of mappings and sequences.
const MAX_DEPTH: usize = 32;
/// Largest indentation. The YAML reader recurses per level, and each level is at least one column wider.
const MAX_INDENT: usize = 200;
/// Maximum number of anchors. The YAML reader copies the target of an anchor before we can refuse it, and nested
/// anchors multiply.
const MAX_ANCHORS: usize = 16;

/// A node of the tree.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Node {
    /// Line of its first character, from 1.
    pub(super) line: usize,
    pub(super) data: NodeData,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum NodeData {
    Scalar { text: String, quoted: bool },
    Sequence(Vec<Node>),
    Mapping(Vec<(Key, Node)>),
}

/// A key of a mapping, as written.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Key {
    pub(super) line: usize,
    pub(super) text: String,
}

/// Syntax error or unsupported YAML: line, from 1, and reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct YamlError {
    pub(super) line: usize,
    pub(super) reason: String,
}

impl YamlError {
    fn new(line: usize, reason: impl Into<String>) -> Self {
        YamlError { line: line.max(1), reason: reason.into() }
    }
}

/// Parses the documents of a YAML text.
pub(super) fn parse(text: &str) -> Result<Vec<Node>, YamlError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    refuse_hostile(text)?;
    let documents = MarkedYaml::load_from_str(text).map_err(|e| YamlError::new(e.marker().line(), e.info()))?;
    let source = Source { chars: text.chars().collect() };
    documents.iter().filter(|document| !is_empty(document)).map(|document| source.node(document, 0)).collect()
}

fn is_empty(document: &MarkedYaml<'_>) -> bool {
    matches!(document.data, YamlData::Value(Scalar::Null)) && document.span.start.index() == document.span.end.index()
        || matches!(document.data, YamlData::BadValue) && document.span.start.index() == document.span.end.index()
}

/// Refuses input that would make the YAML reader use too much stack or memory.
fn refuse_hostile(text: &str) -> Result<(), YamlError> {
    if text.len() > MAX_BYTES {
        return Err(YamlError::new(1, format!("the text has {} bytes, more than {MAX_BYTES}", text.len())));
    }
    for (idx, line) in text.lines().enumerate() {
        let content = line.trim_start_matches([' ', '\t', '-', '?', ':']);
        if line.len() - content.len() > MAX_INDENT && !line.trim().is_empty() && !content.starts_with('#') {
            return Err(YamlError::new(idx + 1, format!("indented by more than {MAX_INDENT} columns")));
        }
    }
    if text.matches('&').count() > MAX_ANCHORS {
        return Err(YamlError::new(1, format!("more than {MAX_ANCHORS} `&`: anchors (`&name`) are not supported")));
    }
    Ok(())
}

struct Source {
    chars: Vec<char>,
}

impl Source {
    fn node(&self, yaml: &MarkedYaml<'_>, depth: usize) -> Result<Node, YamlError> {
        let line = yaml.span.start.line();
        if depth > MAX_DEPTH {
            return Err(YamlError::new(line, format!("nested deeper than {MAX_DEPTH} levels")));
        }
        let refused = match self.first_char(yaml) {
            Some('*') => Some("aliases (`*name`) are not supported, as in ROS 2: write the value out"),
            Some('&') => Some("anchors (`&name`) are not supported, since no alias could use them: remove it"),
            Some('!') => Some("tags (`!name`) are not supported: write the plain value, in quotes if it is text"),
            _ => None,
        };
        if let Some(reason) = refused {
            return Err(YamlError::new(line, reason));
        }
        let data = match &yaml.data {
            YamlData::Value(scalar) => self.scalar(yaml, scalar),
            YamlData::Sequence(items) => {
                NodeData::Sequence(items.iter().map(|item| self.node(item, depth + 1)).collect::<Result<_, _>>()?)
            }
            YamlData::Mapping(entries) => {
                let mut mapping = Vec::with_capacity(entries.len());
                for (key, value) in entries {
                    let key_line = key.span.start.line();
                    match self.node(key, depth + 1)?.data {
                        NodeData::Scalar { text, .. } => {
                            mapping.push((Key { line: key_line, text }, self.node(value, depth + 1)?));
                        }
                        _ => return Err(YamlError::new(key_line, "a key must be a name, not a mapping or a sequence")),
                    }
                }
                NodeData::Mapping(mapping)
            }
            _ => return Err(YamlError::new(line, "not a value that a parameter can have")),
        };
        Ok(Node { line, data })
    }

    fn first_char(&self, yaml: &MarkedYaml<'_>) -> Option<char> {
        self.chars.get(yaml.span.start.index()).copied()
    }

    /// The scalar as written. The reader has already resolved plain scalars by YAML's rules, so unless it is a string,
    /// its text is taken from the source.
    fn scalar(&self, yaml: &MarkedYaml<'_>, scalar: &Scalar<'_>) -> NodeData {
        let quoted = matches!(self.first_char(yaml), Some('"' | '\''));
        let text = match scalar {
            Scalar::String(text) => text.to_string(),
            _ => {
                let span = yaml.span.start.index()..yaml.span.end.index();
                let written: String = self.chars.get(span).unwrap_or_default().iter().collect();
                if quoted { written.trim_matches(['"', '\'']).to_owned() } else { written.trim().to_owned() }
            }
        };
        NodeData::Scalar { text, quoted }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn only_value(text: &str) -> (String, bool) {
        let documents = parse(text).unwrap();
        let NodeData::Mapping(entries) = &documents[0].data else { panic!("{documents:?}") };
        let NodeData::Scalar { text, quoted } = &entries[0].1.data else { panic!("{documents:?}") };
        (text.clone(), *quoted)
    }

    #[test]
    fn scalars_keep_how_they_were_written() {
        for written in ["0x1F", "010", "1e3", "true", "yes", ".inf", "12:30", "a b", "~", "null", "1_0", "é2"] {
            assert_eq!(only_value(&format!("x: {written}\n")), (written.to_owned(), false));
            assert_eq!(only_value(&format!("x: {written}\r\ny: 1\r\n")), (written.to_owned(), false));
            assert_eq!(only_value(&format!("# äöü\nx: {written}  # comment\n")), (written.to_owned(), false));
            assert_eq!(only_value(&format!("\u{feff}{{x: {written}, y: 2}}")), (written.to_owned(), false));
            assert_eq!(only_value(&format!("x: '{written}'")), (written.to_owned(), true));
            assert_eq!(only_value(&format!("x: \"{written}\"")), (written.to_owned(), true));
        }
        assert_eq!(only_value("x: |\n  5\n"), ("5\n".to_owned(), false));
        assert_eq!(only_value("x:\ny: 1\n"), (String::new(), false));
        assert_eq!(only_value("x: ''\n"), (String::new(), true));
        assert_eq!(only_value("x: two\n  lines\n"), ("two lines".to_owned(), false));
    }

    #[test]
    fn texts_made_to_exhaust_memory_or_stack_are_refused() {
        let patterns = [
            "- ",
            "? ",
            ": ",
            "[",
            "{",
            "- &a ",
            "? !a ",
            "a: ",
            "- a: ",
            "!a ",
            "&a ",
            "? - ",
            "{a: ",
            "[a: ",
            "--- ",
            "-\t",
            "[&a ",
            "? ? : ",
            "- ? ",
            "\"",
            "'",
            "|",
            "%",
            "*a ",
            "[*a,",
            "- !!seq ",
            "- !!map ",
            "? !!map\n",
            "\u{feff}- ",
            "a:\n",
            "-\n",
            "?\n",
            "&a\n- ",
        ];
        for pattern in patterns {
            let text = pattern.repeat(MAX_BYTES / pattern.len());
            let _ = parse(&text); // it must return
        }
        let staircase: String = (0..700).map(|depth| format!("{}a:\n", " ".repeat(depth))).collect();
        assert!(parse(&staircase).is_err());
        assert!(parse(&"x".repeat(MAX_BYTES + 1)).unwrap_err().reason.contains("more than 262144"));
    }
}
