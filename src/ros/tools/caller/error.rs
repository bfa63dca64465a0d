//! Why a call did not do what was asked.

use crate::ros::wire::error::NodeError;

/// Why a call did not do what was asked. Each text is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum CallError {
    #[error("no node {node} answers within {after_s} s: {}", instead(here, *domain_id))]
    Absent { node: String, after_s: f64, here: Vec<String>, domain_id: u16 },
    #[error("node {node} is there, but is no node of this package; name one with --node")]
    Foreign { node: String },
    #[error(
        "{n} nodes are called {node}, so a call would reach all of them; stop all but one, or give each its own namespace (-r __ns:=/left)"
    )]
    Several { node: String, n: usize },
    #[error("node {node} has not answered {what} for {after_s} s; does it run with the same RMW_IMPLEMENTATION?")]
    NoAnswer { node: String, what: String, after_s: f64 },
    #[error("node {node} left the graph before it answered")]
    Left { node: String },
    #[error(
        "the answer of node {node} to {what} can't be read: {reason}; does it run with the same RMW_IMPLEMENTATION?"
    )]
    Unread { node: String, what: String, reason: String },
    /// The node's own words.
    #[error("{0}")]
    Refused(String),
    #[error("interrupted")]
    Interrupted,
    #[error("{name:?} is not a parameter of node {node}; list them with `tpf call parameters`")]
    Unknown { node: String, name: String },
    #[error(transparent)]
    Graph(#[from] NodeError),
}

/// Which nodes of this package there are instead of one that is asked for, and what to do.
pub fn instead(here: &[String], domain_id: u16) -> String {
    match here {
        [] => format!(
            "there is none of this package in domain {domain_id}; start it (tpf run), or correct ROS_DOMAIN_ID or RMW_IMPLEMENTATION"
        ),
        [one] => format!("there is {one}; name it with --node"),
        several => format!("there are {}; name one with --node", several.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_that_is_absent_is_told_with_those_that_are_there() {
        let absent = |here: &[&str]| {
            let here = here.iter().map(|name| (*name).to_owned()).collect();
            CallError::Absent { node: "/n".to_owned(), after_s: 5.0, here, domain_id: 3 }.to_string()
        };
        assert!(absent(&[]).starts_with("no node /n answers within 5 s: there is none of this package in domain 3;"));
        assert_eq!(absent(&["/left/n"]), "no node /n answers within 5 s: there is /left/n; name it with --node");
        assert!(absent(&["/l/n", "/r/n"]).ends_with("there are /l/n, /r/n; name one with --node"));
    }
}
