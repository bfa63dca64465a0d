//! The other nodes' entities in the graph, as RustDDS has discovered them.

use std::collections::BTreeMap;

use ros2_client::builtin_topics::ros_discovery;
use ros2_client::dds::rustdds::{DomainParticipant, QosPolicies, QosPolicyBuilder, RTPSEntity, TopicKind, policy};
use ros2_client::entities_info::ParticipantEntitiesInfo;
use ros2_client::{Context, Node, QosProfile, Subscription};

use super::super::Discovered;
use crate::ros::wire::error::{NodeError, create};
use crate::ros::wire::graph::{Endpoint, Server};

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

impl Neighbours {
    /// Servers of others.
    pub(super) fn servers(&self) -> Vec<Server> {
        let own = self.0.guid().prefix;
        let readers = self.0.discovered_readers().into_iter().take(MOST);
        let of_others = readers.filter(|reader| reader.subscription_topic_data.key().prefix != own);
        let server = |reader: ros2_client::dds::rustdds::discovery::DiscoveredReaderData| {
            let topic = &reader.subscription_topic_data;
            server(topic.topic_name(), topic.type_name())
        };
        of_others.filter_map(server).collect()
    }
}

/// Reads the topic on which each participant says which nodes it has.
pub(super) struct Roll {
    said: Subscription<ParticipantEntitiesInfo>,
    own: [u8; 16],
    /// Full names of the nodes of each participant.
    nodes: BTreeMap<[u8; 16], Vec<String>>,
}

impl Roll {
    pub(super) fn new(node: &mut Node, context: &Context) -> Result<Self, NodeError> {
        let name = ros_discovery::TOPIC_NAME;
        let qos = QosPolicyBuilder::new()
            .durability(policy::Durability::TransientLocal)
            .reliable(ros2_client::dds::rustdds::Duration::ZERO)
            .history(policy::History::KeepLast { depth: MOST as i32 })
            .build();
        let participant = context.domain_participant();
        let type_name = ros_discovery::TYPE_NAME.to_owned();
        let topic = participant.create_topic(name.to_owned(), type_name, &qos, TopicKind::NoKey);
        let topic = topic.map_err(|error| create(name, &error))?;
        let said = node.create_subscription(&topic, Some(QosProfile::from(&qos)));
        let said = said.map_err(|error| create(name, &error))?;
        Ok(Roll { said, own: participant.guid().to_bytes(), nodes: BTreeMap::new() })
    }

    /// Full names of the nodes of others, sorted.
    pub(super) fn nodes(&mut self) -> Vec<String> {
        // What can't be read names no node. Strangers can send any number of them, so the work is bounded.
        for _ in 0..MOST {
            match self.said.take() {
                Ok(None) => break,
                Err(_) => {}
                Ok(Some((info, _))) => {
                    let gid = info.gid().to_bytes16();
                    let name = |node: &ros2_client::entities_info::NodeEntitiesInfo| {
                        format!("{}/{}", node.namespace().trim_end_matches('/'), node.name())
                    };
                    let is_new = !self.nodes.contains_key(&gid);
                    if gid != self.own && !(is_new && self.nodes.len() == MOST) {
                        self.nodes.insert(gid, info.nodes().iter().take(MOST).map(name).collect());
                    }
                }
            }
        }
        let mut nodes: Vec<String> = self.nodes.values().flatten().cloned().collect();
        nodes.sort_unstable();
        nodes
    }
}

/// A server by the topic of its requests; `None` for any other topic.
fn server(topic: &str, type_name: &str) -> Option<Server> {
    let service = topic.strip_prefix("rq")?.strip_suffix("Request")?;
    let type_name = canonical(type_name);
    let type_name = type_name.strip_suffix("_Request").unwrap_or(&type_name);
    Some(Server { service: service.to_owned(), type_name: type_name.to_owned() })
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
        let goals = server(
            "rq/left/n/calibrate/_action/send_goalRequest",
            "tactile_pose_fusion::action::dds_::Calibrate_SendGoal_Request_",
        );
        let expected = Server {
            service: "/left/n/calibrate/_action/send_goal".to_owned(),
            type_name: "tactile_pose_fusion/action/Calibrate_SendGoal".to_owned(),
        };
        assert_eq!(goals, Some(expected));
        assert_eq!(server("rt/taxels", "x::msg::dds_::T_"), None);
        assert_eq!(type_hash(b"typehash=RIHS01_ab;"), Some("RIHS01_ab".to_owned()));
        assert_eq!(type_hash(b"enclave=/;typehash=RIHS01_ab"), Some("RIHS01_ab".to_owned()));
        assert_eq!(type_hash(b"typehash=;"), None);
        assert_eq!(type_hash(&[0xff, 0xfe]), None);
    }
}
