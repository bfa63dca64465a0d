//! The other nodes and their topics: who has the same name, and which types and QoS don't match. Pure.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::super::monitored::Monitored;
use super::{Finding, Level};
use crate::ros::wire::clock::system_now;
use crate::ros::wire::graph::{Around, Endpoint, incompatible};

/// A topic of other nodes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Topic {
    /// Its name.
    pub name: String,
    /// Its types; more than one is a problem.
    pub types: Vec<String>,
    /// QoS of each publisher, as far as it decides who matches, in words.
    pub publishers: Vec<String>,
    /// QoS of each subscription, as far as it decides who matches, in words.
    pub subscriptions: Vec<String>,
}

/// The topics of a graph.
pub(super) fn topics(around: &Around) -> Vec<Topic> {
    let mut topics: BTreeMap<&str, Topic> = BTreeMap::new();
    let mut add = |endpoint: &'_ Endpoint, is_publisher: bool, name| {
        let topic = topics.entry(name).or_insert_with(|| Topic {
            name: endpoint.topic.clone(),
            types: Vec::new(),
            publishers: Vec::new(),
            subscriptions: Vec::new(),
        });
        if !topic.types.contains(&endpoint.type_name) {
            topic.types.push(endpoint.type_name.clone());
        }
        let side = if is_publisher { &mut topic.publishers } else { &mut topic.subscriptions };
        side.push(endpoint.matching_in_words());
    };
    around.publishers.iter().for_each(|endpoint| add(endpoint, true, endpoint.topic.as_str()));
    around.subscriptions.iter().for_each(|endpoint| add(endpoint, false, endpoint.topic.as_str()));
    topics.into_values().collect()
}

/// Names, types and QoS that don't match.
pub(super) fn examine(around: &Around, domain_id: u16) -> Vec<Finding> {
    let mut findings = Vec::new();
    let topics = topics(around);
    if around.nodes.is_empty() && topics.is_empty() {
        let text = format!(
            "no other node is in domain {domain_id}: start the drivers of glove and hand, or correct ROS_DOMAIN_ID or RMW_IMPLEMENTATION here or there"
        );
        return vec![Finding::new("nodes", Level::Warning, text)];
    }
    let mut names: BTreeMap<&str, usize> = BTreeMap::new();
    around.nodes.iter().for_each(|name| *names.entry(name).or_default() += 1);
    let twice = names.iter().filter(|(_, n)| **n > 1);
    findings.extend(twice.map(|(name, n)| {
        let text = format!(
            "{n} nodes are called {name}: calls reach all of them and their topics mix; stop all but one, or give each its own namespace (-r __ns:=/left)"
        );
        Finding::new("nodes", Level::Problem, text)
    }));
    if findings.is_empty() {
        let shown: Vec<&str> = names.keys().copied().take(6).collect();
        let more = if names.len() > shown.len() { ", ..." } else { "" };
        let text = format!("{} besides this one, no two with one name: {}{more}", names.len(), shown.join(", "));
        findings.push(Finding::new("nodes", Level::Ok, text));
    }
    let n_before = findings.len();
    findings.extend(topics.iter().filter(|topic| topic.types.len() > 1).map(|topic| {
        let text = format!(
            "{} has several types, {}: nodes with different types get nothing from each other; correct the type or the name in one of them",
            topic.name,
            topic.types.join(" and ")
        );
        Finding::new("topics", Level::Problem, text)
    }));
    findings.extend(mismatches(around));
    if findings.len() == n_before {
        let text =
            format!("{} topics; on each, the types and QoS of all publishers and subscriptions match", topics.len());
        findings.push(Finding::new("topics", Level::Ok, text));
    }
    findings
}

/// Publishers and subscriptions of one topic and type that don't match; each mismatch of a topic once.
fn mismatches(around: &Around) -> Vec<Finding> {
    let mut told = BTreeSet::new();
    let mut findings = Vec::new();
    for publisher in &around.publishers {
        let same = |other: &&Endpoint| other.topic == publisher.topic && other.type_name == publisher.type_name;
        for subscription in around.subscriptions.iter().filter(same) {
            let topic = &publisher.topic;
            if let Some((policy, why)) = incompatible(&publisher.qos, &subscription.qos)
                && told.insert((topic, policy))
            {
                let text = format!(
                    "a subscriber of {topic} gets nothing from a publisher: it is published {why}; change {policy} of one of both"
                );
                findings.push(Finding::new("topics", Level::Warning, text));
            }
            if let (Some(here), Some(there)) = (&publisher.type_hash, &subscription.type_hash)
                && here != there
                && told.insert((topic, "definition"))
            {
                let text = format!(
                    "publisher and subscriber of {topic} have different definitions of {}: build both from the same message files",
                    publisher.type_name
                );
                findings.push(Finding::new("topics", Level::Warning, text));
            }
        }
    }
    findings
}

/// The findings on a running node of this package, from its diagnostics.
pub(super) fn of_node(name: &str, node: &Monitored) -> Vec<Finding> {
    let part = format!("node {name}");
    let mut findings: Vec<Finding> = Vec::new();
    for health in &node.diagnostics {
        let level = match health.level {
            "OK" => Level::Ok,
            "WARN" => Level::Warning,
            _ => Level::Problem,
        };
        let of_what = health.name.split_once(": ").map_or(health.name.as_str(), |(_, of_what)| of_what);
        findings.push(Finding::new(&part, level, format!("{of_what}: {}", health.message)));
    }
    if let Some(age_s) = node.diagnostics_late_s(system_now()) {
        let text = format!(
            "it last said how it is {age_s:.0} s ago, and does so once a second: it hangs, or the machine is too busy"
        );
        findings.push(Finding::new(&part, Level::Warning, text));
    }
    if findings.is_empty() {
        let text = "it is in the graph, and says nothing on /diagnostics: it hangs, or its QoS there was changed; look at its log";
        findings.push(Finding::new(&part, Level::Warning, text));
    }
    if !node.regions.is_empty() {
        findings.push(Finding::new(&part, Level::Ok, node.headline(system_now())));
    }
    findings
}

#[cfg(test)]
mod tests {
    use ros2_client::QosProfile;
    use ros2_client::qos::{Reliability, WhenFull};

    use super::*;

    fn endpoint(topic: &str, type_name: &str, reliable: bool, hash: &str) -> Endpoint {
        let qos = match reliable {
            true => QosProfile::subscription_default().reliability(Reliability::Reliable { when_full: WhenFull::Fail }),
            false => QosProfile::subscription_default(),
        };
        Endpoint { topic: topic.to_owned(), type_name: type_name.to_owned(), type_hash: Some(hash.to_owned()), qos }
    }

    fn told(around: &Around) -> Vec<(Level, String)> {
        examine(around, 3).into_iter().map(|found| (found.level, found.text)).collect()
    }

    #[test]
    fn a_graph_in_order_is_ok_and_an_empty_one_is_told() {
        let found = told(&Around::default());
        assert!(found.len() == 1 && found[0].1.starts_with("no other node is in domain 3"), "{found:?}");
        let around = Around {
            nodes: vec!["/a".to_owned(), "/b".to_owned()],
            publishers: vec![endpoint("/x", "a/msg/X", true, "RIHS01_1")],
            subscriptions: vec![endpoint("/x", "a/msg/X", false, "RIHS01_1")],
            servers: Vec::new(),
        };
        assert!(told(&around).iter().all(|(level, _)| *level == Level::Ok), "{:?}", told(&around));
        assert_eq!(topics(&around)[0].publishers, ["reliable, volatile"]);
    }

    #[test]
    fn names_types_qos_and_definitions_that_do_not_match_are_told() {
        let around = Around {
            nodes: vec!["/a".to_owned(), "/a".to_owned()],
            publishers: vec![endpoint("/x", "a/msg/X", false, "RIHS01_1"), endpoint("/y", "a/msg/Y", true, "RIHS01_2")],
            subscriptions: vec![
                endpoint("/x", "a/msg/X", true, "RIHS01_9"),
                endpoint("/x", "a/msg/X", true, "RIHS01_9"),
                endpoint("/y", "a/msg/Z", true, "RIHS01_2"),
            ],
            servers: Vec::new(),
        };
        let found = told(&around);
        for begin in [
            "2 nodes are called /a",
            "/y has several types, a/msg/Y and a/msg/Z",
            "a subscriber of /x gets nothing from a publisher: it is published as best effort, where reliable is asked for; change reliability",
            "publisher and subscriber of /x have different definitions of a/msg/X",
        ] {
            assert_eq!(found.iter().filter(|(_, text)| text.starts_with(begin)).count(), 1, "{begin}: {found:?}");
        }
        assert!(found.iter().all(|(level, _)| *level != Level::Ok), "{found:?}");
    }
}
