//! A node that publishes existing messages as bytes.

use std::time::Duration;

use ros2_client::qos::{Durability, History};

use crate::config::NodeName;
use crate::msg::WireType;
use crate::ros::wire::clock::ClockMessage;
use crate::ros::wire::entities::Graph;
use crate::ros::wire::environment::Environment;
use crate::ros::wire::error::NodeError;
use crate::ros::wire::middleware::{Publisher, TopicType};
use crate::ros::wire::remap::{self, NameKind, Remap};
use crate::units::Stamp;

/// First two bytes of a message in plain little-endian CDR, which the middleware sends.
const PLAIN_LITTLE_ENDIAN: [u8; 2] = [0, 1];

/// Time limit for reliable subscribers to take the last messages.
const SETTLING_LIMIT: Duration = Duration::from_millis(500);

/// Time for other subscribers, which don't acknowledge: a subscriber drops unread messages when the publisher leaves.
const READING_TIME: Duration = Duration::from_millis(250);

/// A node that publishes stored messages.
pub struct Player {
    publishers: Vec<Publisher>,
    clock: Option<Publisher>,
    graph: Graph,
    node: NodeName,
    remaps: Vec<Remap>,
}

/// A topic of a player.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlayedTopic(usize);

/// The reason why a message was not published.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum NotPlayed {
    /// It is in another encoding than plain little-endian CDR.
    Encoding,
    /// A reliable subscriber has not taken earlier messages.
    Refused,
}

impl Player {
    /// Joins the graph as `node`.
    ///
    /// # Errors
    /// [`NodeError`] when the middleware can't start, or a name is invalid.
    pub fn join(node: &NodeName, environment: &Environment, remaps: &[Remap], clock: bool) -> Result<Self, NodeError> {
        let mut graph = Graph::join(node, environment, remaps)?;
        let reliable = crate::ros::wire::qos::service_qos();
        let clock = match clock {
            true => Some(graph.publisher("/clock", TopicType::Known(ClockMessage::TYPE_NAME), &reliable)?),
            false => None,
        };
        Ok(Player { publishers: Vec::new(), clock, graph, node: node.clone(), remaps: remaps.to_vec() })
    }

    /// Notes for the user about the graph.
    pub fn note(&self) -> Option<String> {
        self.graph.note()
    }

    /// Leaves the graph when reliable subscribers have everything published, at most half a second, and others had
    /// time.
    pub fn leave(self) {
        let Player { publishers, clock, graph, .. } = self;
        graph.settle()(SETTLING_LIMIT);
        std::thread::sleep(READING_TIME);
        drop((publishers, clock));
        graph.leave();
    }

    /// Adds a topic by its absolute name. Publishing waits for a slow reliable subscriber, on DDS up to 100 ms.
    ///
    /// # Errors
    /// [`NodeError`] when the middleware refuses it.
    pub fn add(&mut self, topic: &str, ty: TopicType<'_>) -> Result<PlayedTopic, NodeError> {
        let topic = remap::name(&self.remaps, &self.node, NameKind::Topic, topic)?;
        let qos = crate::ros::wire::qos::service_qos()
            .history(History::KeepLast { depth: 1000 })
            .durability(Durability::Volatile);
        self.publishers.push(self.graph.publisher(&topic, ty, &qos)?);
        Ok(PlayedTopic(self.publishers.len() - 1))
    }

    /// Publishes a message.
    ///
    /// # Errors
    /// [`NotPlayed`] for a message that nobody received.
    pub fn publish(&self, topic: PlayedTopic, cdr: &[u8]) -> Result<(), NotPlayed> {
        if !cdr.starts_with(&PLAIN_LITTLE_ENDIAN) {
            return Err(NotPlayed::Encoding);
        }
        self.publishers[topic.0].publish(cdr.to_vec()).map_err(|_| NotPlayed::Refused)
    }

    /// Publishes the time, if `/clock` was requested.
    pub fn tell_time(&self, now: Stamp) {
        if let Some(publisher) = &self.clock {
            let _ = publisher.publish(crate::msg::to_cdr(&ClockMessage { clock: now.into() })); // the next is as good
        }
    }
}
