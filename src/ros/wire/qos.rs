//! QoS of topics, and its overrides by parameters: `qos_overrides.<topic>.<publisher|subscription>.<policy>`.

use std::time::Duration;

use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History, Liveliness, Reliability, WhenFull};

use crate::config::{Param, ParamTree, ParamValue, QOS_OVERRIDES};

/// Direction in which an entity uses a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Side {
    /// It publishes.
    Publisher,
    /// It subscribes.
    Subscription,
}

impl Side {
    fn name(self) -> &'static str {
        match self {
            Side::Publisher => "publisher",
            Side::Subscription => "subscription",
        }
    }
}

/// An override that this node doesn't support.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{origin}: {key} = {value} {problem}")]
pub struct QosError {
    origin: String,
    key: String,
    value: String,
    problem: String,
}

/// Default QoS of outputs: best effort, the last 10, volatile (which DDS offers as transient local: see its
/// middleware).
pub fn output_default() -> QosProfile {
    QosProfile::subscription_default().history(History::KeepLast { depth: 10 })
}

/// Default QoS of inputs: best effort, which matches best effort and reliable publishers, and the last 100. A machine
/// that can't keep up loses samples, which are counted, and is never more than these behind.
pub fn input_default() -> QosProfile {
    QosProfile::subscription_default().history(History::KeepLast { depth: 100 })
}

/// Default QoS of pictures: reliable, because RViz asks for it.
pub fn pictures() -> QosProfile {
    reliable_qos(5, Durability::Volatile)
}

/// QoS of frames that don't change, as tf2 publishes them.
pub(in crate::ros) fn static_frames() -> QosProfile {
    reliable_qos(1, Durability::TransientLocal)
}

/// QoS of an input that tells frames that don't change, which are published once, long before, by several nodes.
pub fn frames() -> QosProfile {
    reliable_qos(100, Durability::TransientLocal)
}

/// QoS of `/rosout`, `rcl_qos_profile_rosout_default`: late subscribers get the lines of the last 10 s.
pub(in crate::ros) fn rosout() -> QosProfile {
    let qos = reliable_qos(1000, Durability::TransientLocal);
    QosProfile { lifespan: Some(Duration::from_secs(10)), ..qos }
}

/// The QoS of one entity after the overrides for it.
///
/// # Errors
/// [`QosError`] for an unknown policy or value.
pub fn with_overrides(default: QosProfile, tree: &ParamTree, topic: &str, side: Side) -> Result<QosProfile, QosError> {
    let prefix = format!("{QOS_OVERRIDES}{topic}.{}.", side.name());
    let mut qos = default;
    for (key, param) in tree.iter().filter(|(key, _)| key.starts_with(&prefix)) {
        apply(&mut qos, &key[prefix.len()..], &param.value, side).map_err(|problem| refused(key, param, problem))?;
    }
    Ok(qos)
}

/// `rmw_qos_profile_services_default`.
pub(in crate::ros) fn service_qos() -> QosProfile {
    QosProfile::publisher_default().history(History::KeepLast { depth: 10 })
}

/// Reliable, the last `depth`, never waiting for a subscriber.
pub(in crate::ros) fn reliable_qos(depth: usize, durability: Durability) -> QosProfile {
    let qos = QosProfile::publisher_default().reliability(Reliability::Reliable { when_full: WhenFull::Fail });
    qos.history(History::KeepLast { depth }).durability(durability)
}

/// Refuses overrides for entities that this node doesn't have. Overrides in a section for nodes of any name may belong
/// to other nodes: they are returned.
///
/// # Errors
/// [`QosError`] naming the existing entities.
pub fn check_all_used(tree: &ParamTree, entities: &[(String, Side)]) -> Result<Vec<String>, QosError> {
    let mut of_others = Vec::new();
    let prefixes = entities.iter().map(|(topic, side)| format!("{topic}.{}.", side.name())).collect::<Vec<_>>();
    for (key, param) in tree.iter() {
        let Some(rest) = key.strip_prefix(QOS_OVERRIDES) else { continue };
        if !prefixes.iter().any(|prefix| rest.starts_with(prefix)) {
            if param.origin.is_shared() {
                of_others.push(key.to_owned());
                continue;
            }
            let known: Vec<&str> = prefixes.iter().map(|prefix| prefix.trim_end_matches('.')).collect();
            let problem = format!("is for nothing that this node has: {}", known.join(", "));
            return Err(refused(key, param, problem));
        }
    }
    Ok(of_others)
}

fn refused(key: &str, param: &Param, problem: String) -> QosError {
    QosError { origin: param.origin.to_string(), key: key.to_owned(), value: param.value.to_string(), problem }
}

fn apply(qos: &mut QosProfile, policy: &str, value: &ParamValue, side: Side) -> Result<(), String> {
    let depth = |qos: &QosProfile| match qos.history {
        History::KeepLast { depth } => depth,
        History::KeepAll => 10,
    };
    match (policy, value) {
        ("reliability", ParamValue::Str(text)) => match text.as_str() {
            "best_effort" => qos.reliability = Reliability::BestEffort,
            // A publisher never waits for a subscriber: messages that can't be sent are counted.
            "reliable" => qos.reliability = Reliability::Reliable { when_full: WhenFull::Fail },
            "system_default" => {}
            _ => return Err("must be \"reliable\", \"best_effort\" or \"system_default\"".to_owned()),
        },
        ("durability", ParamValue::Str(text)) => match text.as_str() {
            "volatile" => qos.durability = Durability::Volatile,
            "transient_local" => qos.durability = Durability::TransientLocal,
            "system_default" => {}
            _ => return Err("must be \"volatile\", \"transient_local\" or \"system_default\"".to_owned()),
        },
        ("history", ParamValue::Str(text)) => match text.as_str() {
            "keep_last" => qos.history = History::KeepLast { depth: depth(qos) },
            "keep_all" => qos.history = History::KeepAll,
            "system_default" => {}
            _ => return Err("must be \"keep_last\", \"keep_all\" or \"system_default\"".to_owned()),
        },
        ("depth", ParamValue::Int(depth @ 1..=100_000)) => {
            if qos.history != History::KeepAll {
                qos.history = History::KeepLast { depth: *depth as usize };
            }
        }
        ("depth", _) => return Err("must be an int in [1, 100000]".to_owned()),
        ("deadline", ParamValue::Int(ns @ 0..)) => qos.deadline = span(*ns),
        ("liveliness_lease_duration", ParamValue::Int(ns @ 0..)) => qos.liveliness_lease = span(*ns),
        ("lifespan", ParamValue::Int(ns @ 0..)) if side == Side::Publisher => qos.lifespan = span(*ns),
        ("liveliness", ParamValue::Str(text)) if matches!(text.as_str(), "automatic" | "system_default") => {
            qos.liveliness = Liveliness::Automatic;
        }
        ("liveliness", ParamValue::Str(_)) => {
            return Err("must be \"automatic\": this node asserts no liveliness of its own".to_owned());
        }
        ("reliability" | "durability" | "history" | "liveliness", _) => return Err("must be a string".to_owned()),
        ("deadline" | "liveliness_lease_duration" | "lifespan", _) => {
            return Err("must be an int of nanoseconds, 0 for no limit; lifespan is for publishers".to_owned());
        }
        _ => {
            return Err(
                "is no policy: expected reliability, durability, history, depth, deadline, lifespan, liveliness or \
                        liveliness_lease_duration"
                    .to_owned(),
            );
        }
    }
    Ok(())
}

/// As in rmw, 0 and the largest number mean no limit.
fn span(ns: i64) -> Option<Duration> {
    (ns != 0 && ns != i64::MAX).then(|| Duration::from_nanos(ns.unsigned_abs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::parse_param_file;

    fn tree(lines: &str) -> ParamTree {
        tree_of("/n", lines)
    }

    fn tree_of(section: &str, lines: &str) -> ParamTree {
        let text = format!("{section}:\n  ros__parameters:\n    qos_overrides:\n{lines}");
        parse_param_file(&text, "p.yaml", "/n").unwrap()
    }

    #[test]
    fn an_override_of_another_nodes_topic_in_a_shared_section_is_handed_back() {
        let tree =
            tree_of("/**", "      /camera: {publisher: {depth: 3}}\n      /taxels: {subscription: {depth: 3}}\n");
        let of_others = check_all_used(&tree, &[("/taxels".to_owned(), Side::Subscription)]).unwrap();
        assert_eq!(of_others, ["qos_overrides./camera.publisher.depth"]);
    }

    #[test]
    fn an_override_changes_the_policies_that_it_names() {
        let tree = tree("      /taxels:\n        subscription: {reliability: reliable, depth: 5, deadline: 1000000}\n");
        let qos = with_overrides(input_default(), &tree, "/taxels", Side::Subscription).unwrap();
        assert_eq!(qos.reliability, Reliability::Reliable { when_full: WhenFull::Fail });
        assert_eq!(qos.history, History::KeepLast { depth: 5 });
        assert_eq!(qos.deadline, Some(Duration::from_millis(1)));
        assert_eq!(qos.durability, Durability::Volatile);
        assert_eq!(with_overrides(input_default(), &tree, "/joints", Side::Subscription).unwrap(), input_default());
        assert_eq!(with_overrides(output_default(), &tree, "/taxels", Side::Publisher).unwrap(), output_default());
    }

    #[test]
    fn an_override_that_does_nothing_is_refused() {
        let taxels = [("/taxels".to_owned(), Side::Subscription)];
        let refused = |lines: &str| {
            let tree = tree(lines);
            let of_taxels = with_overrides(input_default(), &tree, "/taxels", Side::Subscription).map(|_| ());
            of_taxels.and_then(|()| check_all_used(&tree, &taxels).map(|_| ())).unwrap_err().to_string()
        };
        let text = refused("      /taxels: {subscription: {reliability: maybe}}\n");
        assert_eq!(
            text,
            "p.yaml:4: qos_overrides./taxels.subscription.reliability = \"maybe\" must be \"reliable\", \"best_effort\" or \"system_default\""
        );
        assert!(refused("      /taxels: {subscription: {depth: 0}}\n").ends_with("must be an int in [1, 100000]"));
        assert!(refused("      /taxels: {subscription: {dept: 3}}\n").contains("is no policy: expected reliability"));
        let text = refused("      /taxel: {subscription: {depth: 3}}\n");
        assert!(text.ends_with("is for nothing that this node has: /taxels.subscription"), "{text}");
    }
}
