//! Explains why no messages arrive on a topic, from the entities discovered in the graph. Pure.

use ros2_client::QosProfile;
use ros2_client::qos::{Durability, Reliability};

/// A publisher or subscription of another node.
#[derive(Debug, Clone, PartialEq)]
pub struct Endpoint {
    /// Absolute name of its topic.
    pub topic: String,
    /// Canonical name of its type.
    pub type_name: String,
    /// RIHS01 hash of its type, if it announces one.
    pub type_hash: Option<String>,
    /// QoS that it offers or requests.
    pub qos: QosProfile,
}

impl Endpoint {
    /// The part of its QoS that decides who matches, in words: `reliable, volatile`. DDS tells no history of others.
    pub fn matching_in_words(&self) -> String {
        let reliability = match self.qos.reliability {
            Reliability::Reliable { .. } => "reliable",
            Reliability::BestEffort => "best effort",
        };
        let durability = if self.qos.durability == Durability::Volatile { "volatile" } else { "transient local" };
        format!("{reliability}, {durability}")
    }
}

/// A server of a service of another node.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Server {
    /// Absolute name of the service.
    pub service: String,
    /// Canonical name of its type.
    pub type_name: String,
}

/// The other nodes of a graph, and all of their entities.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Around {
    /// Full names, sorted; a name is there as often as there are nodes with it.
    pub nodes: Vec<String>,
    /// Publishers.
    pub publishers: Vec<Endpoint>,
    /// Subscriptions.
    pub subscriptions: Vec<Endpoint>,
    /// Servers of services, those of actions among them.
    pub servers: Vec<Server>,
}

/// The service by which a node of this package is known: its goals of a calibration.
const CALIBRATE: (&str, &str) = ("/calibrate/_action/send_goal", "tactile_pose_fusion/action/Calibrate_SendGoal");

impl Around {
    /// Full names of the nodes of this package, sorted; a name is there as often as there are nodes with it.
    pub fn fusion_nodes(&self) -> Vec<&str> {
        let (service, type_name) = CALIBRATE;
        let of_ours = self.servers.iter().filter(|server| server.type_name == type_name);
        let mut names: Vec<&str> = of_ours.filter_map(|server| server.service.strip_suffix(service)).collect();
        names.sort_unstable();
        names
    }
}

/// A subscription of this node.
#[derive(Debug, Clone, PartialEq)]
pub struct Wanted {
    /// The parameters that define it: `tactile.glove`.
    pub key: String,
    /// Absolute name of its topic.
    pub topic: String,
    /// Canonical name of its type.
    pub type_name: String,
    /// RIHS01 hash of its type in this node.
    pub type_hash: String,
    /// QoS that it requests.
    pub qos: QosProfile,
}

/// Maximum number of other topics named.
const SHOWN: usize = 3;

impl Wanted {
    /// Why no messages arrive, and what to do.
    pub fn why_absent(&self, publishers: &[Endpoint]) -> String {
        let Wanted { key, topic, type_name, .. } = self;
        let on_topic: Vec<&Endpoint> = publishers.iter().filter(|endpoint| endpoint.topic == *topic).collect();
        if on_topic.is_empty() {
            let mut elsewhere: Vec<&str> = publishers
                .iter()
                .filter(|endpoint| endpoint.type_name == *type_name)
                .map(|endpoint| endpoint.topic.as_str())
                .collect();
            elsewhere.sort_unstable();
            elsewhere.dedup();
            if elsewhere.is_empty() {
                return format!(
                    "nobody publishes {topic}: start its driver, or correct {key}.topic, the node's namespace or ROS_DOMAIN_ID"
                );
            }
            elsewhere.truncate(SHOWN);
            return format!(
                "nobody publishes {topic}, but {type_name} comes on {}: correct {key}.topic or the node's namespace",
                elsewhere.join(", ")
            );
        }
        let Some(of_type) = on_topic.iter().find(|endpoint| endpoint.type_name == *type_name) else {
            return format!(
                "{topic} is published as {}, and this node reads {type_name}: correct {key}.type or {key}.topic",
                on_topic[0].type_name
            );
        };
        match incompatible(&of_type.qos, &self.qos) {
            Some((policy, why)) => format!(
                "{topic} is published, but {why}: change qos_overrides.{topic}.subscription.{policy}, or the publisher's QoS"
            ),
            None => match self.other_definition(publishers) {
                Some(text) => text,
                None => {
                    format!("{topic} has a publisher of the right type and QoS that sends nothing: look at its driver")
                }
            },
        }
    }

    /// Warning that a publisher has another definition of the type than this node, so its messages are read wrongly.
    pub fn other_definition(&self, publishers: &[Endpoint]) -> Option<String> {
        let Wanted { topic, type_name, type_hash, .. } = self;
        let differs = |endpoint: &&Endpoint| endpoint.type_hash.as_ref().is_some_and(|hash| hash != type_hash);
        let of_type = |endpoint: &&Endpoint| endpoint.topic == *topic && endpoint.type_name == *type_name;
        publishers.iter().filter(of_type).find(differs)?;
        Some(format!(
            "{topic} is published with another definition of {type_name} than this node has: give it the publisher's .msg files by message_definitions or AMENT_PREFIX_PATH"
        ))
    }
}

/// Warning that a subscription to our messages gets nothing, because it requests more than is offered.
///
/// `offered`: QoS of our publisher of `topic`.
pub fn why_not_received(topic: &str, offered: &QosProfile, subscriptions: &[Endpoint]) -> Option<String> {
    let on_topic = subscriptions.iter().filter(|endpoint| endpoint.topic == topic);
    let (policy, why) = on_topic.filter_map(|endpoint| incompatible(offered, &endpoint.qos)).next()?;
    Some(format!(
        "a subscriber of {topic} gets nothing: {why}: change qos_overrides.{topic}.publisher.{policy}, or the subscriber's QoS"
    ))
}

/// The first policy in which a subscription doesn't match a publisher, and how.
pub fn incompatible(offered: &QosProfile, asked: &QosProfile) -> Option<(&'static str, &'static str)> {
    let is_reliable = |qos: &QosProfile| matches!(qos.reliability, Reliability::Reliable { .. });
    // No limit counts as the longest.
    let is_longer = |offered: Option<std::time::Duration>, asked: Option<std::time::Duration>| match (offered, asked) {
        (_, None) => false,
        (None, Some(_)) => true,
        (Some(offered), Some(asked)) => offered > asked,
    };
    if is_reliable(asked) && !is_reliable(offered) {
        return Some(("reliability", "as best effort, where reliable is asked for"));
    }
    if asked.durability == Durability::TransientLocal && offered.durability == Durability::Volatile {
        return Some(("durability", "as volatile, where transient_local is asked for"));
    }
    if is_longer(offered.deadline, asked.deadline) {
        return Some(("deadline", "with a longer deadline than is asked for"));
    }
    if is_longer(offered.liveliness_lease, asked.liveliness_lease) {
        return Some(("liveliness_lease_duration", "with a longer liveliness lease than is asked for"));
    }
    None
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use ros2_client::qos::WhenFull;

    use super::*;

    fn qos() -> QosProfile {
        QosProfile::subscription_default()
    }

    fn reliable() -> QosProfile {
        qos().reliability(Reliability::Reliable { when_full: WhenFull::Fail })
    }

    fn wanted(qos: QosProfile) -> Wanted {
        let (key, topic) = ("tactile.glove".to_owned(), "/taxels".to_owned());
        Wanted { key, topic, type_name: "a/msg/Taxels".to_owned(), type_hash: "RIHS01_1".to_owned(), qos }
    }

    fn publisher(topic: &str, type_name: &str, qos: QosProfile) -> Endpoint {
        Endpoint { topic: topic.to_owned(), type_name: type_name.to_owned(), type_hash: None, qos }
    }

    #[test]
    fn each_reason_names_what_to_change() {
        let table = [
            (wanted(qos()), vec![], "nobody publishes /taxels: start its driver, or correct tactile.glove.topic"),
            (
                wanted(qos()),
                vec![publisher("/left/taxels", "a/msg/Taxels", qos()), publisher("/x", "b/msg/X", qos())],
                "nobody publishes /taxels, but a/msg/Taxels comes on /left/taxels: correct tactile.glove.topic",
            ),
            (
                wanted(qos()),
                vec![publisher("/taxels", "b/msg/X", qos())],
                "/taxels is published as b/msg/X, and this node reads a/msg/Taxels: correct tactile.glove.type",
            ),
            (
                wanted(reliable()),
                vec![publisher("/taxels", "a/msg/Taxels", qos())],
                "/taxels is published, but as best effort, where reliable is asked for: change qos_overrides./taxels.subscription.reliability",
            ),
            (
                wanted(qos().durability(Durability::TransientLocal)),
                vec![publisher("/taxels", "a/msg/Taxels", reliable())],
                "/taxels is published, but as volatile, where transient_local is asked for",
            ),
            (
                wanted(QosProfile { deadline: Some(Duration::from_millis(5)), ..qos() }),
                vec![publisher("/taxels", "a/msg/Taxels", reliable())],
                "/taxels is published, but with a longer deadline",
            ),
            (
                wanted(qos()),
                vec![publisher("/taxels", "a/msg/Taxels", qos())],
                "/taxels has a publisher of the right type",
            ),
        ];
        for (wanted, publishers, expected) in table {
            let text = wanted.why_absent(&publishers);
            assert!(text.starts_with(expected), "{text}");
        }
    }

    #[test]
    fn another_definition_of_the_same_type_is_told() {
        let mut endpoint = publisher("/taxels", "a/msg/Taxels", qos());
        assert_eq!(wanted(qos()).other_definition(std::slice::from_ref(&endpoint)), None, "it tells no hash");
        endpoint.type_hash = Some("RIHS01_1".to_owned());
        assert_eq!(wanted(qos()).other_definition(std::slice::from_ref(&endpoint)), None);
        endpoint.type_hash = Some("RIHS01_2".to_owned());
        assert!(wanted(qos()).other_definition(&[endpoint]).unwrap().contains("message_definitions"));
    }

    #[test]
    fn a_subscriber_that_asks_for_more_than_is_offered_is_told() {
        let asks = [publisher("/contacts", "a/msg/C", reliable())];
        let text = why_not_received("/contacts", &qos(), &asks).unwrap();
        assert!(text.contains("qos_overrides./contacts.publisher.reliability"), "{text}");
        assert_eq!(why_not_received("/contacts", &reliable(), &asks), None);
        assert_eq!(why_not_received("/other", &qos(), &asks), None);
    }
}
