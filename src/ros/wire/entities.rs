//! The node's topics and services: their names after remapping, and the entities behind them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use ros2_client::qos::Durability;
use ros2_client::{Message, QosProfile};

use super::environment::Environment;
use super::error::NodeError;
use super::graph::Around;
use super::middleware::{
    Action, ActionClient, ActionQos, Client, Neighbours, Participant, Publisher, Requests, Settle, Subscription,
    TopicType,
};
use super::qos::{reliable_qos, service_qos};
use super::remap::{self, NameKind, Remap};
use super::threads;
use crate::config::{Config, NameError, NodeName, Publishing};
use crate::leave;
use crate::msg::EstimateTopics;
use crate::msg::binding::static_topic;

/// How often the middleware is checked.
const LOOK: Duration = Duration::from_millis(250);

/// The names of the node's inputs and outputs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Names {
    /// Each topic once, in the order in which tactile sources, then joint sources, first name it.
    pub inputs: Vec<InputName>,
    /// Topics of the force sensors, in the order of the parameters.
    pub truth: Vec<String>,
    /// Topics of the estimates.
    pub estimates: EstimateTopics,
    /// Topics of pictures.
    pub visuals: VisualTopics,
}

/// Names of the topics for pictures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VisualTopics {
    /// Markers of all regions, then the image of each: empty if they are never published.
    pub pictures: Vec<String>,
    /// Frames of the patches, if they are published.
    pub frames: Option<String>,
}

impl VisualTopics {
    fn new(cfg: &Config, topic: impl Fn(&str) -> Result<String, NameError>) -> Result<Self, NameError> {
        let node = cfg.node.to_string();
        let images = cfg.fusion().regions().iter().map(|region| format!("{node}/{}/taxels_image", region.name));
        let pictures = [format!("{node}/markers")].into_iter().chain(images);
        let is_wanted = cfg.live.visuals.publishing != Publishing::Never;
        Ok(VisualTopics {
            pictures: pictures.filter(|_| is_wanted).map(|name| topic(&name)).collect::<Result<_, _>>()?,
            frames: cfg.live.visuals.tf.then(|| topic("/tf_static")).transpose()?,
        })
    }

    /// All of them.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.pictures.iter().chain(&self.frames).map(String::as_str)
    }
}

/// A topic that feeds the core; listed once, even if several sources read from it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputName {
    /// Its name.
    pub topic: String,
    /// Canonical name of its message type.
    pub type_name: String,
    /// Indices of the tactile sources that are read from it.
    pub tactile: Vec<usize>,
    /// Indices of the joint sources that are read from it.
    pub joints: Vec<usize>,
    /// Indices of the joint sources whose frames that don't change it tells.
    pub frames: Vec<usize>,
}

impl Names {
    /// The names from a configuration and remaps.
    ///
    /// # Errors
    /// [`NameError`] when a remap's names can't be expanded.
    pub fn new(cfg: &Config, remaps: &[Remap]) -> Result<Self, NameError> {
        let topic = |absolute: &str| remap::name(remaps, &cfg.node, NameKind::Topic, absolute);
        let mut inputs = Vec::new();
        for (source, input) in cfg.tactile().iter().enumerate() {
            named(&mut inputs, topic(&input.name)?, &input.type_name).tactile.push(source);
        }
        for (source, input) in cfg.joints().iter().enumerate() {
            named(&mut inputs, topic(&input.name)?, &input.type_name).joints.push(source);
            if let Some(frames) = static_topic(input) {
                named(&mut inputs, topic(&frames)?, &input.type_name).frames.push(source);
            }
        }
        let estimates = EstimateTopics::of_node(&cfg.node.to_string(), cfg.fusion());
        Ok(Names {
            inputs,
            truth: cfg.truth().iter().map(|truth| topic(&truth.name)).collect::<Result<_, _>>()?,
            estimates: EstimateTopics {
                wrenches: estimates.wrenches.iter().map(|name| topic(name)).collect::<Result<_, _>>()?,
                contacts: topic(&estimates.contacts)?,
            },
            visuals: VisualTopics::new(cfg, topic)?,
        })
    }
}

/// The input of a name and type: an existing one, or a new one.
fn named<'n>(inputs: &'n mut Vec<InputName>, topic: String, type_name: &str) -> &'n mut InputName {
    let known = inputs.iter().position(|input| input.topic == topic && input.type_name == type_name);
    let idx = known.unwrap_or_else(|| {
        let (tactile, joints, frames) = (Vec::new(), Vec::new(), Vec::new());
        inputs.push(InputName { topic, type_name: type_name.to_owned(), tactile, joints, frames });
        inputs.len() - 1
    });
    &mut inputs[idx]
}

/// Creates entities. Dropping it leaves the graph: a DDS participant that is only dropped may still run discovery.
pub(in crate::ros) struct Graph {
    /// `None` after leaving.
    participant: Option<Participant>,
    /// True after leaving; read by the check of the middleware.
    left: Arc<AtomicBool>,
    name: NodeName,
    remaps: Vec<Remap>,
}

impl Graph {
    /// Joins the graph as a node. If the middleware stops sending and receiving, the process ends.
    pub(in crate::ros) fn join(
        name: &NodeName,
        environment: &Environment,
        remaps: &[Remap],
    ) -> Result<Self, NodeError> {
        let participant = Participant::join(name, environment)?;
        let (mut pulse, left) = (participant.pulse(), Arc::new(AtomicBool::new(false)));
        let has_left = Arc::clone(&left);
        threads::spawn("watch", move || {
            while !has_left.load(Ordering::Acquire) {
                if let Some(why) = pulse().filter(|_| !has_left.load(Ordering::Acquire)) {
                    return leave::fail(why);
                }
                std::thread::sleep(LOOK);
            }
        })?;
        Ok(Graph { participant: Some(participant), left, name: name.clone(), remaps: remaps.to_vec() })
    }

    /// Notes for the user about the graph.
    pub(in crate::ros) fn note(&self) -> Option<String> {
        self.participant.as_ref().and_then(Participant::note)
    }

    /// The other nodes' entities in the graph, if the middleware provides them.
    pub(in crate::ros) fn neighbours(&self) -> Option<Neighbours> {
        self.participant.as_ref().and_then(Participant::neighbours)
    }

    /// Waits until reliable subscribers have received everything published.
    pub(in crate::ros) fn settle(&self) -> Settle {
        self.participant.as_ref().expect("only dropping takes it").settle()
    }

    /// Leaves the graph, after all entities created here have been dropped.
    pub(in crate::ros) fn leave(self) {
        drop(self);
    }

    fn participant(&mut self) -> &mut Participant {
        self.participant.as_mut().expect("only dropping takes it")
    }

    /// A publisher on an absolute name.
    pub(in crate::ros) fn publisher(
        &mut self,
        topic: &str,
        ty: TopicType<'_>,
        qos: &QosProfile,
    ) -> Result<Publisher, NodeError> {
        self.participant().publisher(topic, ty, qos)
    }

    /// A subscription of an absolute name.
    pub(in crate::ros) fn subscription(
        &mut self,
        topic: &str,
        ty: TopicType<'_>,
        qos: &QosProfile,
    ) -> Result<Subscription, NodeError> {
        self.participant().subscription(topic, ty, qos)
    }

    /// A server of a service of this node, such as `~/tare`, of a type such as `std_srvs/srv/Trigger`.
    pub(in crate::ros) fn server<Q, A>(&mut self, service: &str, type_name: &str) -> Result<Requests<Q, A>, NodeError>
    where
        Q: Message + Clone + 'static,
        A: Message + 'static,
    {
        let name = self.service_name(service)?;
        self.participant().server(&name, type_name, &service_qos())
    }

    /// The calibrate action of this node, such as `~/calibrate`.
    pub(in crate::ros) fn action(&mut self, action: &str) -> Result<Action, NodeError> {
        let name = self.service_name(action)?;
        self.participant().action(&name, &action_qos())
    }

    /// A client of a service of another node, by its absolute name before remapping.
    pub(in crate::ros) fn client<Q, A>(&mut self, service: &str, type_name: &str) -> Result<Client<Q, A>, NodeError>
    where
        Q: Message + Clone + 'static,
        A: Message + 'static,
    {
        let name = remap::name(&self.remaps, &self.name, NameKind::Service, service)?;
        self.participant().client(&name, type_name, &service_qos())
    }

    /// A client of the calibrate action of another node, by its absolute name before remapping.
    pub(in crate::ros) fn action_client(&mut self, action: &str) -> Result<ActionClient, NodeError> {
        let name = remap::name(&self.remaps, &self.name, NameKind::Service, action)?;
        self.participant().action_client(&name, &action_qos())
    }

    /// The other nodes and all of their entities, by now.
    pub(in crate::ros) fn around(&mut self) -> Result<Around, NodeError> {
        self.participant().around()
    }

    /// The absolute name of a topic of this node after remapping.
    pub(in crate::ros) fn topic_name(&self, topic: &str) -> Result<String, NodeError> {
        let absolute = self.name.resolve(topic)?;
        Ok(remap::name(&self.remaps, &self.name, NameKind::Topic, &absolute)?)
    }

    /// The absolute name of a service or action of this node after remapping.
    fn service_name(&self, service: &str) -> Result<String, NodeError> {
        let absolute = self.name.resolve(service)?;
        Ok(remap::name(&self.remaps, &self.name, NameKind::Service, &absolute)?)
    }
}

fn action_qos() -> ActionQos {
    ActionQos {
        services: service_qos(),
        feedback: reliable_qos(10, Durability::Volatile),
        status: reliable_qos(1, Durability::TransientLocal),
    }
}

impl Drop for Graph {
    fn drop(&mut self) {
        self.left.store(true, Ordering::Release);
        if let Some(participant) = self.participant.take() {
            participant.leave();
        }
    }
}
