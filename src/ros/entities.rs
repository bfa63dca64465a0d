//! The node's topics and services: their names after remapping, and the DDS entities behind them.

use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;

use ros2_client::dds::rustdds::{DomainParticipantBuilder, RTPSEntity};
use ros2_client::qos::{Durability, History, Reliability, WhenFull};
use ros2_client::{
    Context, Message, MessageTypeName, Name, Node, NodeName as WireNodeName, NodeOptions, Publisher, QosProfile,
    Server, ServiceMapping, ServiceTypeName, Subscription,
};

use super::cdr_bytes::CdrBytes;
use super::environment::{Environment, ServiceStyle};
use super::farewell;
use super::node::NodeError;
use super::remap::{self, NameKind, Remap};
use crate::config::{Config, NameError, NodeName};
use crate::msg::EstimateTopics;

/// The names that the node's inputs and outputs go by.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Names {
    /// `[tactile sources, then joint sources]`.
    pub inputs: Vec<String>,
    /// Where estimates go.
    pub estimates: EstimateTopics,
}

impl Names {
    /// The names that a configuration and remaps make.
    ///
    /// # Errors
    /// [`NameError`] when a remap's names can't be expanded.
    pub fn new(cfg: &Config, remaps: &[Remap]) -> Result<Self, NameError> {
        let topic = |absolute: &str| remap::name(remaps, &cfg.node, NameKind::Topic, absolute);
        let tactile = cfg.tactile.iter().map(|input| input.name.as_str());
        let inputs = tactile.chain(cfg.joints.iter().map(|input| input.name.as_str())).map(topic);
        let estimates = EstimateTopics::of_node(&cfg.node.to_string(), &cfg.fusion);
        Ok(Names {
            inputs: inputs.collect::<Result<_, _>>()?,
            estimates: EstimateTopics {
                wrenches: estimates.wrenches.iter().map(|name| topic(name)).collect::<Result<_, _>>()?,
                contacts: topic(&estimates.contacts)?,
            },
        })
    }
}

/// How long the middleware gets to tell that entities are gone. A RustDDS participant that is dropped stops sending at
/// once and doesn't say when it has told everyone; what it has not told stays in the graph until its lease is over.
const FAREWELL: Duration = Duration::from_millis(100);

/// What makes entities.
pub(super) struct Graph {
    pub(super) node: Node,
    context: Context,
    name: NodeName,
    mapping: ServiceMapping,
    remaps: Vec<Remap>,
}

impl Graph {
    /// Joins the graph as a node.
    pub(super) fn join(
        name: &NodeName,
        environment: &Environment,
        remaps: &[Remap],
        rosout: bool,
    ) -> Result<Self, NodeError> {
        let mut participant = DomainParticipantBuilder::new(environment.domain_id);
        if environment.localhost_only {
            participant = participant.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        let failed = |what: &str| {
            let what = what.to_owned();
            move |error: &dyn std::fmt::Display| NodeError::Create { what, reason: error.to_string() }
        };
        let participant = participant.build().map_err(|error| failed("DDS participant")(&error))?;
        let context =
            Context::from_domain_participant(participant).map_err(|error| failed("DDS participant")(&error))?;
        let wire_name = WireNodeName::new(name.namespace(), name.name()).map_err(|error| failed("node")(&error))?;
        let options = NodeOptions::new().enable_rosout(rosout).start_parameter_services(false);
        let node = context.new_node(wire_name, options).map_err(|error| failed("node")(&error))?;
        let mapping = match environment.services {
            ServiceStyle::Enhanced => ServiceMapping::Enhanced,
            ServiceStyle::Cyclone => ServiceMapping::Cyclone,
        };
        Ok(Graph { node, context, name: name.clone(), mapping, remaps: remaps.to_vec() })
    }

    /// Leaves the graph, when everything that was made here has been dropped.
    pub(super) fn leave(self) {
        let Graph { node, context, .. } = self;
        drop(node);
        std::thread::sleep(FAREWELL);
        let (guid, domain_id) = (context.domain_participant().guid().to_bytes(), context.domain_id());
        drop(context);
        farewell::send(guid, domain_id);
    }

    /// A publisher on an absolute name.
    pub(super) fn publisher(
        &mut self,
        topic: &str,
        type_name: &str,
        qos: &QosProfile,
    ) -> Result<Publisher<CdrBytes>, NodeError> {
        let handle = self.topic(topic, type_name, qos)?;
        self.node.create_publisher(&handle, Some(qos.clone())).map_err(|error| create(topic, &error))
    }

    /// A subscription of an absolute name.
    pub(super) fn subscription<M: 'static>(
        &mut self,
        topic: &str,
        type_name: &str,
        qos: &QosProfile,
    ) -> Result<Subscription<M>, NodeError> {
        let handle = self.topic(topic, type_name, qos)?;
        self.node.create_subscription(&handle, Some(qos.clone())).map_err(|error| create(topic, &error))
    }

    /// A server of a service of this node, such as `~/tare`, of a type such as `std_srvs/Trigger`.
    pub(super) fn server<Q, A>(&mut self, service: &str, type_name: &str) -> Result<Server<Q, A>, NodeError>
    where
        Q: Message + Clone + 'static,
        A: Message + 'static,
    {
        let name = self.service_name(service)?;
        let (package, kind) = type_name.split_once('/').unwrap_or(("", type_name));
        let server = self.node.create_server(
            self.mapping,
            &wire(&name)?,
            &ServiceTypeName::new(package, kind),
            service_qos(),
            service_qos(),
        );
        server.map_err(|error| create(&name, &error))
    }

    /// The absolute name of a service or action of this node after remapping.
    pub(super) fn service_name(&self, service: &str) -> Result<String, NodeError> {
        let absolute = self.name.resolve(service)?;
        Ok(remap::name(&self.remaps, &self.name, NameKind::Service, &absolute)?)
    }

    /// The absolute name of a topic of this node after remapping.
    pub(super) fn topic_name(&self, topic: &str) -> Result<String, NodeError> {
        let absolute = self.name.resolve(topic)?;
        Ok(remap::name(&self.remaps, &self.name, NameKind::Topic, &absolute)?)
    }

    pub(super) fn mapping(&self) -> ServiceMapping {
        self.mapping
    }

    fn topic(
        &self,
        topic: &str,
        type_name: &str,
        qos: &QosProfile,
    ) -> Result<ros2_client::dds::rustdds::Topic, NodeError> {
        let mut parts = type_name.split('/');
        let (package, kind) = (parts.next().unwrap_or_default(), parts.next_back().unwrap_or_default());
        let created = self.node.create_topic(&wire(topic)?, MessageTypeName::new(package, kind), qos);
        created.map_err(|error| create(topic, &error))
    }
}

/// An absolute name as ros2-client has it.
pub(super) fn wire(absolute: &str) -> Result<Name, NodeError> {
    Name::parse(absolute).map_err(|error| create(absolute, &error))
}

/// `rmw_qos_profile_services_default`.
pub(super) fn service_qos() -> QosProfile {
    QosProfile::publisher_default().history(History::KeepLast { depth: 10 })
}

/// Reliable, the last `depth`, and never waiting for a reader.
pub(super) fn reliable_qos(depth: usize, durability: Durability) -> QosProfile {
    let qos = QosProfile::publisher_default().reliability(Reliability::Reliable { when_full: WhenFull::Fail });
    qos.history(History::KeepLast { depth }).durability(durability)
}

pub(super) fn create(what: &str, error: &dyn std::fmt::Display) -> NodeError {
    NodeError::Create { what: what.to_owned(), reason: error.to_string() }
}
