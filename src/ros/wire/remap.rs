//! Remapping of the node's name and of topics and services, by the rules of rcl.

use crate::config::{NameError, NodeName, resolve_name};

/// One rule, `[node:]from:=to`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remap {
    /// The only node that it applies to; every node if `None`.
    node: Option<String>,
    what: What,
    to: String,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum What {
    NodeName,
    Namespace,
    /// A rule for topic names, service names, or both.
    Names {
        from: String,
        topics: bool,
        services: bool,
    },
}

/// Kind of a name: some rules apply to one kind only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NameKind {
    /// A topic.
    Topic,
    /// A service, or an action.
    Service,
}

impl Remap {
    /// Parses the argument after `-r`.
    ///
    /// # Errors
    /// The expected syntax, in words.
    pub fn parse(rule: &str) -> Result<Self, String> {
        let (left, to) = rule.split_once(":=").ok_or("expected from:=to")?;
        if to.is_empty() {
            return Err("nothing stands after :=".to_owned());
        }
        let (scheme, target) = match left.split_once("://") {
            Some(("rostopic", target)) => (Some(NameKind::Topic), target),
            Some(("rosservice", target)) => (Some(NameKind::Service), target),
            Some((other, _)) => return Err(format!("{other}:// is not known; expected rostopic:// or rosservice://")),
            None => (None, left),
        };
        let (node, from) = match target.split_once(':') {
            Some((node, from)) if !node.is_empty() => (Some(node.to_owned()), from),
            Some(_) => return Err("nothing stands before ':'".to_owned()),
            None => (None, target),
        };
        let what = match from {
            "__node" | "__name" if scheme.is_none() => What::NodeName,
            "__ns" if scheme.is_none() => What::Namespace,
            "" => return Err("nothing stands before :=".to_owned()),
            _ => What::Names {
                from: from.to_owned(),
                topics: scheme != Some(NameKind::Service),
                services: scheme != Some(NameKind::Topic),
            },
        };
        match what {
            What::NodeName if to.contains('/') => {
                return Err("a node's name holds no '/'; use __ns for the rest".into());
            }
            What::Namespace if !to.starts_with('/') => {
                return Err(format!("a namespace is absolute: write __ns:=/{to}"));
            }
            _ => {}
        }
        Ok(Remap { node, what, to: to.to_owned() })
    }

    fn is_for(&self, node_name: &str) -> bool {
        self.node.as_deref().is_none_or(|node| node == node_name)
    }
}

/// The node's full name after the rules for it; the first rule of each kind wins.
///
/// # Errors
/// [`NameError`] when the result is not a valid name.
pub fn node_name(remaps: &[Remap], default: &NodeName) -> Result<NodeName, NameError> {
    let first = |what: &What| {
        remaps.iter().find(|rule| rule.what == *what && rule.is_for(default.name())).map(|rule| rule.to.as_str())
    };
    let namespace = first(&What::Namespace).unwrap_or(default.namespace()).trim_end_matches('/');
    NodeName::parse(&format!("{namespace}/{}", first(&What::NodeName).unwrap_or(default.name())))
}

/// The name of an absolute topic or service of this node after remapping.
///
/// # Errors
/// [`NameError`] when a rule's names can't be expanded.
pub fn name(remaps: &[Remap], node: &NodeName, kind: NameKind, absolute: &str) -> Result<String, NameError> {
    for rule in remaps.iter().filter(|rule| rule.is_for(node.name())) {
        let What::Names { from, topics, services } = &rule.what else { continue };
        let applies = if kind == NameKind::Topic { *topics } else { *services };
        if applies && resolve_name(from, node.namespace(), node.name())? == absolute {
            return resolve_name(&rule.to, node.namespace(), node.name());
        }
    }
    Ok(absolute.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rules(rules: &[&str]) -> Vec<Remap> {
        rules.iter().map(|rule| Remap::parse(rule).unwrap()).collect()
    }

    fn node(fqn: &str) -> NodeName {
        NodeName::parse(fqn).unwrap()
    }

    #[test]
    fn the_node_takes_the_first_name_and_namespace_that_it_is_given() {
        let default = node("/tactile_pose_fusion");
        let named = |list: &[&str]| node_name(&rules(list), &default).unwrap().to_string();
        assert_eq!(named(&[]), "/tactile_pose_fusion");
        assert_eq!(named(&["__node:=left", "__name:=right", "__ns:=/robot"]), "/robot/left");
        assert_eq!(named(&["other:__node:=left", "tactile_pose_fusion:__ns:=/a/b"]), "/a/b/tactile_pose_fusion");
        assert_eq!(named(&["__ns:=/"]), "/tactile_pose_fusion");
    }

    #[test]
    fn topics_are_compared_and_replaced_in_full() {
        let node = node("/ns/fusion");
        let topic = |list: &[&str], absolute: &str| name(&rules(list), &node, NameKind::Topic, absolute).unwrap();
        assert_eq!(topic(&["taxels:=/glove/raw"], "/ns/taxels"), "/glove/raw");
        assert_eq!(topic(&["taxels:=raw"], "/ns/taxels"), "/ns/raw");
        assert_eq!(topic(&["/taxels:=raw"], "/ns/taxels"), "/ns/taxels");
        assert_eq!(topic(&["~/contacts:=/contacts"], "/ns/fusion/contacts"), "/contacts");
        assert_eq!(topic(&["a:=b", "a:=c"], "/ns/a"), "/ns/b");
        assert_eq!(topic(&["other:a:=b", "fusion:a:=c"], "/ns/a"), "/ns/c");
        assert_eq!(topic(&["rosservice://a:=b"], "/ns/a"), "/ns/a");
        let service = name(&rules(&["rosservice://~/tare:=/zero"]), &node, NameKind::Service, "/ns/fusion/tare");
        assert_eq!(service.unwrap(), "/zero");
    }

    #[test]
    fn rules_that_mean_nothing_are_refused() {
        for (rule, reason) in [
            ("a", "expected from:=to"),
            ("a:=", "nothing stands after :="),
            (":=b", "nothing stands before :="),
            (":a:=b", "nothing stands before ':'"),
            ("ros://a:=b", "ros:// is not known; expected rostopic:// or rosservice://"),
            ("__ns:=robot", "a namespace is absolute: write __ns:=/robot"),
            ("__node:=a/b", "a node's name holds no '/'; use __ns for the rest"),
        ] {
            assert_eq!(Remap::parse(rule).unwrap_err(), reason, "{rule}");
        }
    }
}
