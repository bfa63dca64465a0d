//! Names of nodes and topics, by the rules of rcl and rmw.

use std::fmt;

use super::text::one_line;

/// Longest full name that the middleware accepts (`RMW_TOPIC_MAX_NAME_LENGTH`).
const MAX_NAME_LENGTH: usize = 247;

/// Namespace and name of a node, both valid.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeName {
    namespace: String,
    name: String,
}

impl NodeName {
    /// Parses a fully qualified name such as `/left/tactile_pose_fusion`.
    ///
    /// # Errors
    /// [`NameError`] if the name is not absolute, or a part of it is invalid.
    pub fn parse(fqn: &str) -> Result<Self, NameError> {
        validate_full(fqn).map_err(|reason| NameError::new("node name", fqn, reason))?;
        let (namespace, name) = fqn.rsplit_once('/').unwrap_or(("", fqn));
        let namespace = if namespace.is_empty() { "/" } else { namespace };
        Ok(NodeName { namespace: namespace.to_owned(), name: name.to_owned() })
    }

    /// The namespace, such as `/` or `/left`.
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// The name without the namespace.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Resolves a topic or service name for this node, see [`resolve_name`].
    ///
    /// # Errors
    /// [`NameError`] if the name is invalid.
    pub fn resolve(&self, name: &str) -> Result<String, NameError> {
        resolve_name(name, &self.namespace, &self.name)
    }
}

impl fmt::Display for NodeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.namespace.trim_end_matches('/'), self.name)
    }
}

/// A name that ROS 2 doesn't accept, with the reason.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{name}` is not a valid {what}: {reason}")]
pub struct NameError {
    what: &'static str,
    name: String,
    reason: String,
}

impl NameError {
    fn new(what: &'static str, name: &str, reason: impl Into<String>) -> Self {
        NameError { what, name: one_line(name), reason: reason.into() }
    }

    /// The reason, without the name.
    pub fn reason(&self) -> &str {
        &self.reason
    }
}

/// Makes a topic or service name absolute, as `rcl_expand_topic_name` does: `~` is the node, `{node}`, `{ns}` and
/// `{namespace}` are replaced, and a relative name is put below the namespace. Remapping is not applied.
///
/// # Errors
/// [`NameError`] if the name, or the absolute name, is invalid.
pub fn resolve_name(name: &str, node_ns: &str, node_name: &str) -> Result<String, NameError> {
    let refuse = |reason: &str| NameError::new("topic name", name, reason);
    validate_relative(name).map_err(refuse)?;
    let below_ns = |tail: &str| format!("{}/{tail}", node_ns.trim_end_matches('/'));
    let mut rest = name;
    let mut full = String::new();
    if let Some(tail) = name.strip_prefix('~') {
        full = below_ns(node_name);
        rest = tail;
    }
    while let Some((before, after)) = rest.split_once('{') {
        let (substitution, after) = after.split_once('}').unwrap_or((after, ""));
        full.push_str(before);
        full.push_str(match substitution {
            "node" => node_name,
            "ns" | "namespace" => node_ns,
            _ => return Err(refuse("only {node}, {ns} and {namespace} can be substituted")),
        });
        rest = after;
    }
    full.push_str(rest);
    if !full.starts_with('/') {
        full = below_ns(&full);
    }
    validate_full(&full)
        .map_err(|reason| if full == name { refuse(reason) } else { refuse(&format!("as {full}, {reason}")) })?;
    Ok(full)
}

/// Like `rcl_validate_topic_name`, but also refuses `~x`, which rcl's check misses.
fn validate_relative(name: &str) -> Result<(), &'static str> {
    if name.is_empty() {
        return Err("it must not be empty");
    }
    if name.ends_with('/') {
        return Err("it must not end with '/'");
    }
    if name.strip_prefix('~').is_some_and(|tail| !tail.is_empty() && !tail.starts_with('/')) {
        return Err("'~' must be followed by '/'");
    }
    let mut substitution: Option<usize> = None;
    for (idx, character) in name.char_indices() {
        match (character, substitution) {
            ('{', None) => substitution = Some(idx),
            ('}', Some(_)) => substitution = None,
            ('{' | '}', _) => return Err("'{' and '}' must come in pairs"),
            ('~', None) if idx == 0 => {}
            ('~', None) => return Err("'~' must be its first character"),
            ('/', None) | ('_', _) => {}
            _ if character.is_ascii_alphanumeric() => {}
            _ => return Err("it may hold only letters, digits, '_', '/', '~' and substitutions in '{}'"),
        }
    }
    if substitution.is_some() {
        return Err("'{' and '}' must come in pairs");
    }
    if starts_with_digit(name) {
        return Err("no part of it may start with a digit");
    }
    Ok(())
}

/// Like `rmw_validate_full_topic_name`. The rules are the same for a node's full name.
fn validate_full(name: &str) -> Result<(), &'static str> {
    if !name.starts_with('/') {
        return Err("it must start with '/'");
    }
    if name.ends_with('/') {
        return Err("it must not end with '/'");
    }
    if !name.chars().all(|character| character.is_ascii_alphanumeric() || matches!(character, '_' | '/')) {
        return Err("it may hold only letters, digits, '_' and '/'");
    }
    if name.contains("//") {
        return Err("it must not hold '//'");
    }
    if starts_with_digit(name) {
        return Err("no part of it may start with a digit");
    }
    if name.len() > MAX_NAME_LENGTH {
        return Err("it is longer than 247 characters");
    }
    Ok(())
}

fn starts_with_digit(name: &str) -> bool {
    name.split('/').any(|token| token.starts_with(|first: char| first.is_ascii_digit()))
}

/// Pattern of node names in a parameter file: names, `*` for one name, and `**` for any number of names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct NodePattern {
    tokens: Vec<Token>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Token {
    Name(String),
    One,
    Any,
}

impl NodePattern {
    /// Parses a pattern. The leading slash is optional, as in rcl.
    pub(super) fn parse(text: &str) -> Result<Self, &'static str> {
        let tokens = text.strip_prefix('/').unwrap_or(text).split('/').map(|token| match token {
            "" => Err("it must not be empty or hold '//'"),
            "*" => Ok(Token::One),
            "**" => Ok(Token::Any),
            _ if token.contains('*') => Err("'*' and '**' stand for whole names, not for parts of one"),
            _ if !token.chars().all(|character| character.is_ascii_alphanumeric() || character == '_') => {
                Err("it may hold only letters, digits, '_', '/' and '*'")
            }
            _ if starts_with_digit(token) => Err("no part of it may start with a digit"),
            _ => Ok(Token::Name(token.to_owned())),
        });
        Ok(NodePattern { tokens: tokens.collect::<Result<_, _>>()? })
    }

    /// True if the last part of the pattern is a wildcard, so that it matches nodes of any name.
    pub(super) fn is_any_node(&self) -> bool {
        matches!(self.tokens.last(), Some(Token::One | Token::Any))
    }

    /// True if a node matches.
    pub(super) fn matches(&self, node_fqn: &str) -> bool {
        let names: Vec<&str> = node_fqn.split('/').filter(|name| !name.is_empty()).collect();
        // reached[i]: the tokens so far match the first i names.
        let mut reached = vec![false; names.len() + 1];
        reached[0] = true;
        for token in &self.tokens {
            let mut next = vec![false; names.len() + 1];
            let mut any = false;
            for (idx, next) in next.iter_mut().enumerate() {
                let after_previous = idx > 0 && reached[idx - 1];
                any |= reached[idx];
                *next = match token {
                    Token::Any => any,
                    Token::One => after_previous,
                    Token::Name(name) => after_previous && names[idx - 1] == name,
                };
            }
            reached = next;
        }
        reached.last().copied().unwrap_or(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_resolve_as_rcl_expands_them() {
        let table = [
            ("taxels", "/left", "/left/taxels"),
            ("taxels", "/", "/taxels"),
            ("/taxels", "/left", "/taxels"),
            ("a/b", "/left", "/left/a/b"),
            ("~", "/left", "/left/fusion"),
            ("~", "/", "/fusion"),
            ("~/index/wrench", "/left", "/left/fusion/index/wrench"),
            ("~/index/wrench", "/", "/fusion/index/wrench"),
            ("{node}/x", "/left", "/left/fusion/x"),
            ("{ns}/x", "/left", "/left/x"),
            ("{namespace}/{node}/x", "/left", "/left/fusion/x"),
            ("/a/{node}_x", "/", "/a/fusion_x"),
            ("~/{node}", "/", "/fusion/fusion"),
        ];
        for (name, namespace, full) in table {
            assert_eq!(resolve_name(name, namespace, "fusion").as_deref(), Ok(full), "{name} in {namespace}");
        }
    }

    #[test]
    fn names_that_rcl_refuses_are_refused() {
        let refused = [
            "", "/", "a/", "1a", "a/1b", "a b", "a~", "~a", "a/~/b", "{node", "node}", "{{node}}", "{host}", "a//b",
            "a-b", "{ns}/x", "é", "{a/b}", "~/", "{}",
        ];
        for name in refused {
            assert!(resolve_name(name, "/", "fusion").is_err(), "{name}");
        }
        assert_eq!(
            resolve_name("a-b", "/", "fusion").unwrap_err().to_string(),
            "`a-b` is not a valid topic name: it may hold only letters, digits, '_', '/', '~' and substitutions in '{}'"
        );
        assert_eq!(
            resolve_name("{ns}/x", "/", "fusion").unwrap_err().to_string(),
            "`{ns}/x` is not a valid topic name: as //x, it must not hold '//'"
        );
        assert!(resolve_name(&"x".repeat(247), "/", "fusion").is_err());
        assert!(resolve_name(&"x".repeat(246), "/", "fusion").is_ok());
    }

    #[test]
    fn a_node_name_splits_into_namespace_and_name() {
        let node = NodeName::parse("/left/tactile_pose_fusion").unwrap();
        assert_eq!((node.namespace(), node.name()), ("/left", "tactile_pose_fusion"));
        assert_eq!(node.to_string(), "/left/tactile_pose_fusion");
        let node = NodeName::parse("/tactile_pose_fusion").unwrap();
        assert_eq!((node.namespace(), node.name()), ("/", "tactile_pose_fusion"));
        assert_eq!(node.to_string(), "/tactile_pose_fusion");
        for refused in ["", "/", "fusion", "/a//b", "/a/", "/1", "/a b"] {
            assert!(NodeName::parse(refused).is_err(), "{refused}");
        }
    }

    /// Each row was tried with rcl 10.1 (Kilted) through rclpy: which of three nodes accept a section with this name.
    #[test]
    fn wildcards_match_the_nodes_that_rcl_matches() {
        let nodes = ["/node2", "/ns/node2", "/a/b/node2"];
        let table = [
            ("/**", [true, true, true]),
            ("**", [true, true, true]),
            ("/*", [true, false, false]),
            ("*", [true, false, false]),
            ("/**/node2", [true, true, true]),
            ("**/node2", [true, true, true]),
            ("/*/node2", [false, true, false]),
            ("*/node2", [false, true, false]),
            ("/ns/*", [false, true, false]),
            ("ns/*", [false, true, false]),
            ("/ns/**", [false, true, false]),
            ("/ns/node2", [false, true, false]),
            ("ns/node2", [false, true, false]),
            ("node2", [true, false, false]),
            ("/node2", [true, false, false]),
            ("/**/*", [true, true, true]),
            ("/*/*", [false, true, false]),
            ("/ns/**/node2", [false, true, false]),
            ("/a/**/node2", [false, false, true]),
            ("/*/**", [true, true, true]),
        ];
        for (pattern, matched) in table {
            let parsed = NodePattern::parse(pattern).unwrap();
            assert_eq!(nodes.map(|node| parsed.matches(node)), matched, "{pattern}");
        }
        for refused in ["/ns/no*", "", "/", "a//b", "a/", "1a", "a b", "***", "a/b-c"] {
            assert!(NodePattern::parse(refused).is_err(), "{refused}");
        }
    }
}
