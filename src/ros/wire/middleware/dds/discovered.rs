//! The other nodes' entities in the graph, as RustDDS has discovered them.

use ros2_client::QosProfile;
use ros2_client::dds::rustdds::{DomainParticipant, QosPolicies, RTPSEntity};

use super::super::Discovered;
use crate::ros::wire::graph::Endpoint;

/// Prefix of the type hash in the user data of a ROS 2 endpoint.
const TYPE_HASH: &str = "typehash=";

/// Maximum number of endpoints read: strangers can create any number of them.
const MOST: usize = 4096;

/// The endpoints that a participant has discovered, without its own.
pub(super) struct Neighbours(pub(super) DomainParticipant);

impl Discovered for Neighbours {
    fn publishers(&self) -> Vec<Endpoint> {
        let own = self.0.guid().prefix;
        let writers = self.0.discovered_writers().into_iter().take(MOST);
        let of_others = writers.filter(|writer| writer.publication_topic_data.key.prefix != own);
        let endpoint = |writer: ros2_client::dds::rustdds::discovery::DiscoveredWriterData| {
            let topic = &writer.publication_topic_data;
            endpoint(&topic.topic_name, &topic.type_name, &topic.qos(), &writer.user_data)
        };
        of_others.filter_map(endpoint).collect()
    }

    fn subscriptions(&self) -> Vec<Endpoint> {
        let own = self.0.guid().prefix;
        let readers = self.0.discovered_readers().into_iter().take(MOST);
        let of_others = readers.filter(|reader| reader.subscription_topic_data.key().prefix != own);
        let endpoint = |reader: ros2_client::dds::rustdds::discovery::DiscoveredReaderData| {
            let topic = &reader.subscription_topic_data;
            endpoint(topic.topic_name(), topic.type_name(), &topic.qos(), &[])
        };
        of_others.filter_map(endpoint).collect()
    }
}

/// An endpoint with its ROS 2 names; `None` if it is not a ROS 2 topic.
fn endpoint(topic: &str, type_name: &str, qos: &QosPolicies, user_data: &[u8]) -> Option<Endpoint> {
    Some(Endpoint {
        topic: topic.strip_prefix("rt")?.to_owned(),
        type_name: canonical(type_name),
        type_hash: type_hash(user_data),
        qos: QosProfile::from(qos),
    })
}

/// `sensor_msgs::msg::dds_::JointState_` as `sensor_msgs/msg/JointState`.
fn canonical(dds: &str) -> String {
    let parts: Vec<&str> = dds.split("::").filter(|part| *part != "dds_").collect();
    parts.join("/").trim_end_matches('_').to_owned()
}

/// The hash in `typehash=RIHS01_...;`.
fn type_hash(user_data: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(user_data);
    let hash = text.split(TYPE_HASH).nth(1)?.split(';').next()?;
    hash.starts_with("RIHS01_").then(|| hash.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_hashes_are_those_of_ros() {
        assert_eq!(canonical("sensor_msgs::msg::dds_::JointState_"), "sensor_msgs/msg/JointState");
        assert_eq!(canonical("x"), "x");
        assert_eq!(type_hash(b"typehash=RIHS01_ab;"), Some("RIHS01_ab".to_owned()));
        assert_eq!(type_hash(b"enclave=/;typehash=RIHS01_ab"), Some("RIHS01_ab".to_owned()));
        assert_eq!(type_hash(b"typehash=;"), None);
        assert_eq!(type_hash(&[0xff, 0xfe]), None);
    }
}
