//! A node that publishes messages that are there already, as bytes.

use ros2_client::Publisher;
use ros2_client::qos::{Durability, History};

use super::cdr_bytes::CdrBytes;
use super::entities::Graph;
use super::environment::Environment;
use super::interfaces::Clock;
use super::node::NodeError;
use super::remap::{self, NameKind, Remap};
use crate::config::NodeName;
use crate::units::Stamp;

/// First two bytes of a message in plain little-endian CDR, which is what the middleware sends.
const PLAIN_LITTLE_ENDIAN: [u8; 2] = [0, 1];

/// A node that plays messages.
pub struct Player {
    publishers: Vec<Publisher<CdrBytes>>,
    clock: Option<Publisher<CdrBytes>>,
    graph: Graph,
    node: NodeName,
    remaps: Vec<Remap>,
}

/// A topic of a player.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlayedTopic(usize);

/// Why a message was not played.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum NotPlayed {
    /// It is in another encoding than plain little-endian CDR.
    Encoding,
    /// A reliable subscriber has not taken what came before.
    Refused,
}

impl Player {
    /// Joins the graph as `node`.
    ///
    /// # Errors
    /// [`NodeError`] when the middleware can't start, or a name is none.
    pub fn join(node: &NodeName, environment: &Environment, remaps: &[Remap], clock: bool) -> Result<Self, NodeError> {
        let mut graph = Graph::join(node, environment, remaps, false)?;
        let reliable = super::entities::service_qos();
        let clock = match clock {
            true => Some(graph.publisher("/clock", "rosgraph_msgs/msg/Clock", &reliable)?),
            false => None,
        };
        Ok(Player { publishers: Vec::new(), clock, graph, node: node.clone(), remaps: remaps.to_vec() })
    }

    /// Leaves the graph.
    pub fn leave(self) {
        let Player { publishers, clock, graph, .. } = self;
        drop((publishers, clock));
        graph.leave();
    }

    /// Adds a topic by its absolute name and type, such as `sensor_msgs/msg/JointState`. Publishing waits up to 100 ms
    /// for a reliable subscriber that is slow.
    ///
    /// # Errors
    /// [`NodeError`] when the middleware refuses it.
    pub fn add(&mut self, topic: &str, type_name: &str) -> Result<PlayedTopic, NodeError> {
        let topic = remap::name(&self.remaps, &self.node, NameKind::Topic, topic)?;
        let qos =
            super::entities::service_qos().history(History::KeepLast { depth: 1000 }).durability(Durability::Volatile);
        self.publishers.push(self.graph.publisher(&topic, type_name, &qos)?);
        Ok(PlayedTopic(self.publishers.len() - 1))
    }

    /// Publishes a message.
    ///
    /// # Errors
    /// [`NotPlayed`] for a message that nobody got.
    pub fn publish(&self, topic: PlayedTopic, cdr: &[u8]) -> Result<(), NotPlayed> {
        if !cdr.starts_with(&PLAIN_LITTLE_ENDIAN) {
            return Err(NotPlayed::Encoding);
        }
        self.publishers[topic.0].publish(CdrBytes(cdr.to_vec())).map_err(|_| NotPlayed::Refused)
    }

    /// Says what time it is, where `/clock` was asked for.
    pub fn tell_time(&self, now: Stamp) {
        if let Some(publisher) = &self.clock {
            let _ = publisher.publish(CdrBytes(crate::msg::to_cdr(&Clock { clock: now.into() }))); // the next is as good
        }
    }
}
