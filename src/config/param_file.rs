//! Reads a ROS 2 parameter file as `rcl_yaml_param_parser` does, and overrides as in `--ros-args -p`.
//!
//! We refuse some input that rcl accepts silently: duplicate keys, `null`, tags, anchors. We accept an empty array,
//! which has no type in rcl. Overrides with `-p` win over all sections of a file.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use super::error::ParamError;
use super::names::NodePattern;
use super::scalar::{MixedArray, ParamValue, resolve};
use super::text::{list, one_line, printable};
use super::yaml::{self, Node, NodeData};

const PARAMETERS_KEY: &str = "ros__parameters";

/// Where a parameter was set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// In a parameter file.
    File {
        /// The file as the user named it.
        file: Arc<str>,
        /// Line of the value, from 1.
        line: usize,
        /// True if the section is for nodes of any name, as `/**` is.
        any_node: bool,
    },
    /// Set by `-p key:=value`.
    CommandLine,
    /// Set by a request to the running node.
    Request,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Origin::File { file, line, .. } => write!(f, "{}:{line}", printable(file)),
            Origin::CommandLine => f.write_str("command line"),
            Origin::Request => f.write_str("parameter request"),
        }
    }
}

/// A value and its origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Param {
    /// The value.
    pub value: ParamValue,
    /// Where it was set.
    pub origin: Origin,
}

impl Origin {
    /// True if it was set in a section that several nodes share, which may have parameters of other nodes.
    pub fn is_shared(&self) -> bool {
        matches!(self, Origin::File { any_node: true, .. })
    }
}

/// Parameters of one node, by dotted key.
#[derive(Debug, Clone, PartialEq)]
pub struct ParamTree {
    node_fqn: String,
    files: String,
    params: BTreeMap<String, Param>,
}

impl ParamTree {
    /// Parameters of a node without files.
    pub fn empty(node_fqn: &str) -> Self {
        ParamTree { node_fqn: node_fqn.to_owned(), files: "parameters".to_owned(), params: BTreeMap::new() }
    }

    /// Applies an override from `-p`: `key:=value`, or `node:key:=value` for one node only. The value is YAML, as in
    /// rcl.
    ///
    /// Returns true if the override is for this node.
    ///
    /// # Errors
    /// [`ParamError::Override`] if it can't be parsed.
    pub fn set_override(&mut self, rule: &str) -> Result<bool, ParamError> {
        let refuse = |reason: &str| ParamError::Override { rule: one_line(rule), reason: reason.to_owned() };
        let (target, value) = rule.split_once(":=").ok_or_else(|| refuse("expected key:=value"))?;
        let (node, key) = match target.split_once(':') {
            Some((node, key)) => (Some(node), key),
            None => (None, target),
        };
        if !key.split('.').all(is_key_part) {
            return Err(refuse("a key is made of letters, digits, '_' and '/', with '.' between its parts"));
        }
        let meant = match node {
            Some(node) if !is_key_token(node) => return Err(refuse("the node before ':' must be a name without '/'")),
            Some(node) => self.node_fqn.strip_prefix('/') == Some(node),
            None => true,
        };
        let documents = yaml::parse(value).map_err(|e| refuse(&format!("the value is not YAML: {}", e.reason)))?;
        let [document] = documents.as_slice() else {
            return Err(refuse("it has no value; write key:=\"\" for empty text"));
        };
        let value = match value_of(document) {
            Ok(Some(value)) => value,
            Ok(None) => return Err(refuse("a value is a scalar or a list of scalars, and not null")),
            Err(mixed) => return Err(refuse(&mixed.to_string())),
        };
        if meant {
            self.set(key, value, Origin::CommandLine);
        }
        Ok(meant)
    }

    /// Sets or replaces a parameter.
    pub fn set(&mut self, key: &str, value: ParamValue, origin: Origin) {
        self.params.insert(key.to_owned(), Param { value, origin });
    }

    /// The node that the parameters are for.
    pub fn node_fqn(&self) -> &str {
        &self.node_fqn
    }

    /// The files that were read, separated by commas.
    pub fn files(&self) -> &str {
        &self.files
    }

    /// A parameter, if it is set.
    pub fn get(&self, key: &str) -> Option<&Param> {
        self.params.get(key)
    }

    /// All parameters, by key.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Param)> {
        self.params.iter().map(|(key, param)| (key.as_str(), param))
    }
}

/// Reads the parameters for a node from a file.
///
/// # Errors
/// [`ParamError`] if the text is not a parameter file, or has nothing for this node.
pub fn parse_param_file(text: &str, file_label: &str, node_fqn: &str) -> Result<ParamTree, ParamError> {
    parse_param_files(&[(text, file_label)], node_fqn)
}

/// Reads the parameters for a node from several files, each with its text and name.
///
/// As in rcl and rclpy, sections apply in the order in which their names first appear, and later ones win. A section
/// with a wildcard has the same priority as one with a full name.
///
/// # Errors
/// [`ParamError`] if a text is not a parameter file, or if no file has anything for this node.
pub fn parse_param_files(files: &[(&str, &str)], node_fqn: &str) -> Result<ParamTree, ParamError> {
    let mut sections = Vec::new();
    for (text, label) in files {
        let file: Arc<str> = (*label).into();
        let documents = yaml::parse(text).map_err(|e| ParamError::Yaml {
            file: printable(&file),
            line: e.line,
            reason: e.reason,
        })?;
        for document in &documents {
            Reader { file: &file, sections: &mut sections }.nodes(document, "")?;
        }
    }
    let mut tree = ParamTree::empty(node_fqn);
    tree.files = files.iter().map(|(_, label)| printable(label)).collect::<Vec<_>>().join(", ");
    let mut matched = false;
    for section in sections.iter().filter(|section| section.pattern.matches(node_fqn)) {
        matched = true;
        tree.params.extend(section.params.iter().map(|(key, param)| (key.clone(), param.clone())));
    }
    if !matched {
        let names = list(sections.iter().map(|section| section.name.as_str()));
        let names = if names.is_empty() { "no node at all".to_owned() } else { format!("parameters for {names}") };
        return Err(ParamError::NoSection { files: tree.files, node: one_line(node_fqn), names });
    }
    Ok(tree)
}

/// Parameters of one section. Sections are identified by their names as written, so `/a` and `a` are two sections.
struct Section {
    name: String,
    pattern: NodePattern,
    params: BTreeMap<String, Param>,
}

struct Reader<'a> {
    file: &'a Arc<str>,
    sections: &'a mut Vec<Section>,
}

impl Reader<'_> {
    fn yaml_error(&self, line: usize, reason: &str) -> ParamError {
        ParamError::Yaml { file: printable(self.file), line, reason: reason.to_owned() }
    }

    /// Descends through names of nodes and namespaces to `ros__parameters`.
    fn nodes(&mut self, node: &Node, name: &str) -> Result<(), ParamError> {
        let entries = match &node.data {
            NodeData::Mapping(entries) if !entries.is_empty() => entries,
            NodeData::Mapping(_) | NodeData::Scalar { .. } | NodeData::Sequence(_) if name.is_empty() => {
                return Err(
                    self.yaml_error(node.line, "expected a node name, then `ros__parameters:`, then parameters")
                );
            }
            _ => {
                let (file, name) = (printable(self.file), one_line(name));
                return Err(ParamError::NoParametersKey { file, line: node.line, name });
            }
        };
        for (key, value) in entries {
            if key.text == PARAMETERS_KEY {
                if name.is_empty() {
                    return Err(self.yaml_error(key.line, "`ros__parameters:` needs the name of a node above it"));
                }
                self.section(name, key.line, value)?;
            } else {
                let separator = if name.is_empty() || name.ends_with('/') { "" } else { "/" };
                self.nodes(value, &format!("{name}{separator}{}", key.text))?;
            }
        }
        Ok(())
    }

    fn section(&mut self, name: &str, line: usize, node: &Node) -> Result<(), ParamError> {
        let file = printable(self.file);
        let pattern = NodePattern::parse(name).map_err(|reason| ParamError::NodeName {
            file: file.clone(),
            line,
            name: one_line(name),
            reason,
        })?;
        if !matches!(node.data, NodeData::Mapping(_)) {
            return Err(self.yaml_error(node.line, "`ros__parameters:` must be followed by keys and values"));
        }
        let mut params = BTreeMap::new();
        self.params(node, "", pattern.is_any_node(), &mut params)?;
        match self.sections.iter_mut().find(|section| section.name == name) {
            Some(section) => section.params.extend(params),
            None => self.sections.push(Section { name: name.to_owned(), pattern, params }),
        }
        Ok(())
    }

    /// Flattens nested mappings to dotted keys.
    fn params(
        &self,
        node: &Node,
        prefix: &str,
        any_node: bool,
        params: &mut BTreeMap<String, Param>,
    ) -> Result<(), ParamError> {
        if let NodeData::Mapping(entries) = &node.data
            && (prefix.is_empty() || !entries.is_empty())
        {
            for (key, value) in entries {
                if key.text.is_empty() {
                    return Err(self.yaml_error(key.line, "a key must not be empty"));
                }
                let separator = if prefix.is_empty() { "" } else { "." };
                self.params(value, &format!("{prefix}{separator}{}", key.text), any_node, params)?;
            }
            return Ok(());
        }
        let (file, line, key) = (printable(self.file), node.line, one_line(prefix));
        let value = match value_of(node) {
            Ok(Some(value)) => value,
            Ok(None) => return Err(ParamError::NoValue { file, line, key }),
            Err(refused) => return Err(ParamError::Array { file, line, key, reason: refused.to_string() }),
        };
        if let Some(Param { origin: Origin::File { line: first_line, .. }, .. }) = params.get(prefix) {
            return Err(ParamError::Duplicate { file, line, key, first_line: *first_line });
        }
        let origin = Origin::File { file: Arc::clone(self.file), line, any_node };
        params.insert(prefix.to_owned(), Param { value, origin });
        Ok(())
    }
}

/// An array that can't be a parameter.
enum RefusedArray {
    Mixed(MixedArray),
    Nested { idx: usize },
    NoValue { idx: usize },
}

impl fmt::Display for RefusedArray {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RefusedArray::Mixed(MixedArray { idx, first, other }) => {
                let remedy = match (*first, *other) {
                    ("int", "double") | ("double", "int") => "; write every number with a decimal point",
                    ("string", _) | (_, "string") => "; put each text in quotes",
                    _ => "",
                };
                write!(f, "element 0 is {first}, element {idx} is {other}{remedy}")
            }
            RefusedArray::Nested { idx } => write!(f, "element {idx} is not a scalar"),
            RefusedArray::NoValue { idx } => write!(f, "element {idx} has no value"),
        }
    }
}

/// The value of a scalar or an array. `None` for a mapping, an empty value or null.
fn value_of(node: &Node) -> Result<Option<ParamValue>, RefusedArray> {
    let scalar = |node: &Node| match &node.data {
        NodeData::Scalar { text, quoted: false } if matches!(text.as_str(), "" | "~" | "null" | "Null" | "NULL") => {
            None
        }
        NodeData::Scalar { text, quoted } => Some(resolve(text, *quoted)),
        _ => None,
    };
    let NodeData::Sequence(items) = &node.data else { return Ok(scalar(node)) };
    let mut values = Vec::with_capacity(items.len());
    for (idx, item) in items.iter().enumerate() {
        match (scalar(item), &item.data) {
            (Some(value), _) => values.push(value),
            (None, NodeData::Scalar { .. }) => return Err(RefusedArray::NoValue { idx }),
            (None, _) => return Err(RefusedArray::Nested { idx }),
        }
    }
    ParamValue::array(values).map(Some).map_err(RefusedArray::Mixed)
}

/// Parts of a key that rcl accepts before `:=`: tokens, and slashes for names of topics.
fn is_key_part(part: &str) -> bool {
    !part.is_empty() && part.split('/').all(|token| token.is_empty() || is_key_token(token))
}

/// Tokens of a key or node name that rcl accepts before `:=`.
fn is_key_token(token: &str) -> bool {
    token.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
        && token.chars().all(|character| character.is_ascii_alphanumeric() || character == '_')
}
