//! DDS, through ros2-client on RustDDS.

mod cdr_bytes;
mod client;
mod discovered;
mod farewell;

use std::net::{IpAddr, Ipv4Addr};
use std::rc::Rc;
use std::time::Duration;

use futures::stream::{LocalBoxStream, StreamExt, unfold};
use ros2_client::action::{ActionServerQosPolicies, FeedbackMessage};
#[cfg(feature = "security")]
use ros2_client::dds::rustdds::DomainParticipantSecurityConfigFiles;
use ros2_client::dds::rustdds::{
    BackgroundThreads, DomainParticipant, DomainParticipantBuilder, GUID, RTPSEntity, Topic,
};
use ros2_client::qos::{Durability, Reliability};
use ros2_client::{
    ActionServer, ActionTypeName, Context, Message, MessageTypeName, Name, Node, NodeName as WireNodeName, NodeOptions,
    QosProfile, ReadResult, RmwRequestId, Server, ServiceMapping, ServiceTypeName,
};

use self::cdr_bytes::{AsCdr, CdrBytes};
use super::{
    Action, ActionQos, Answer, Arrival, Fault, LEAVE, Publish, Publisher, Pulse, Refused, Request, Requests, Settle,
    Subscribe, Subscription, TopicType,
};
use crate::config::NodeName;
use crate::msg::{CalibrateFeedback, CalibrateGoal, CalibrateResult};
use crate::ros::wire::clock::system_now;
use crate::ros::wire::environment::{Environment, ServiceStyle};
use crate::ros::wire::error::NodeError;
use crate::ros::wire::error::create;
use crate::ros::wire::graph::Around;
#[cfg(feature = "security")]
use crate::ros::wire::security::{Keys, Security, SecurityError};
use crate::ros::wire::stopwatch::Stopwatch;
use crate::ros::wire::threads;
use crate::units::Stamp;

/// Time for the middleware to announce that entities are gone. A dropped RustDDS participant stops sending at once and
/// doesn't report when it has told everyone; any entity not announced stays in the graph until its lease expires.
const FAREWELL: Duration = Duration::from_millis(100);

/// How long peers remember a silent RustDDS participant: five of its announcements.
const LEASE: Duration = Duration::from_secs(50);

/// After such a pause peers may have forgotten it, because its last announcement may be 10 s old. They meet it as a new
/// one, but RustDDS continues from their earlier acknowledgements: nothing would ever be sent or received again.
const FORGOTTEN: Duration = Duration::from_secs(40);

/// How long a response waits for its client to be known. Discovery takes milliseconds, and longer on a busy machine.
const CLIENT: Duration = Duration::from_secs(1);
const CLIENT_POLL: Duration = Duration::from_millis(2);

/// How often an action's requests are polled; a calibration takes seconds.
const POLL: Duration = Duration::from_millis(20);

pub(in crate::ros) struct Participant {
    node: Node,
    context: Context,
    mapping: ServiceMapping,
    note: Option<String>,
    threads: BackgroundThreads,
    guid: [u8; 16],
    domain_id: u16,
    /// Reads which nodes there are, since somebody asked.
    roll: Option<discovered::Roll>,
}

impl Participant {
    pub(super) fn join(name: &NodeName, environment: &Environment, style: ServiceStyle) -> Result<Self, NodeError> {
        let mut participant = DomainParticipantBuilder::new(environment.domain_id);
        if environment.localhost_only {
            participant = participant.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        #[cfg(feature = "security")]
        let (participant, note) = secured(participant, environment.security.as_ref())?;
        #[cfg(not(feature = "security"))]
        let note = None;
        let participant = participant.build().map_err(|error| create("DDS participant", &error))?;
        let (threads, guid) = (participant.background_threads(), participant.guid().to_bytes());
        let context =
            Context::from_domain_participant(participant).map_err(|error| create("DDS participant", &error))?;
        let wire_name = WireNodeName::new(name.namespace(), name.name()).map_err(|error| create("node", &error))?;
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let node = context.new_node(wire_name, options).map_err(|error| create("node", &error))?;
        let mapping = match style {
            ServiceStyle::Enhanced => ServiceMapping::Enhanced,
            ServiceStyle::Cyclone => ServiceMapping::Cyclone,
        };
        Ok(Participant { node, context, mapping, note, threads, guid, domain_id: environment.domain_id, roll: None })
    }

    pub(super) fn note(&self) -> Option<String> {
        self.note.clone()
    }

    pub(super) fn pulse(&self) -> Pulse {
        let threads = self.threads.clone();
        let mut look = Stopwatch::start();
        Box::new(move || {
            let paused = std::mem::replace(&mut look, Stopwatch::start()).elapsed();
            if paused > FORGOTTEN {
                let (paused_s, lease_s) = (paused.as_secs(), LEASE.as_secs());
                return Some(format!(
                    "this process stood still for {paused_s} s, and its peers have forgotten it after {lease_s} s, so the process ends; start it anew"
                ));
            }
            threads.ended().map(threads::has_ended)
        })
    }

    pub(super) fn settle(&self) -> Settle {
        let participant = self.context.domain_participant();
        Box::new(move |limit| {
            participant.flush(limit);
        })
    }

    pub(super) fn neighbours(&self) -> super::Neighbours {
        Box::new(discovered::Neighbours(self.context.domain_participant()))
    }

    pub(super) fn around(&mut self) -> Result<Around, NodeError> {
        let roll = match &mut self.roll {
            Some(roll) => roll,
            none => none.insert(discovered::Roll::new(&mut self.node, &self.context)?),
        };
        let neighbours = discovered::Neighbours(self.context.domain_participant());
        Ok(Around {
            nodes: roll.nodes(),
            publishers: super::Discovered::publishers(&neighbours),
            subscriptions: super::Discovered::subscriptions(&neighbours),
            servers: neighbours.servers(),
        })
    }

    pub(super) fn leave(self) {
        let Participant { node, context, guid, domain_id, .. } = self;
        // It joins its threads, and waits for them as long as the network blocks them.
        threads::within(LEAVE, move || {
            drop(node);
            std::thread::sleep(FAREWELL);
            drop(context);
        });
        farewell::send(guid, domain_id);
    }

    pub(super) fn publisher(
        &mut self,
        topic: &str,
        ty: TopicType<'_>,
        qos: &QosProfile,
    ) -> Result<Publisher, NodeError> {
        let qos = offered(qos);
        let handle = self.topic(topic, ty, &qos)?;
        let publisher = self.node.create_publisher::<CdrBytes>(&handle, Some(qos));
        Ok(Box::new(TopicPublisher {
            publisher: publisher.map_err(|error| create(topic, &error))?,
            participant: self.context.domain_participant(),
            topic: format!("rt{topic}"),
        }))
    }

    pub(super) fn subscription(
        &mut self,
        topic: &str,
        ty: TopicType<'_>,
        qos: &QosProfile,
    ) -> Result<Subscription, NodeError> {
        let handle = self.topic(topic, ty, qos)?;
        let subscription = self.node.create_subscription::<CdrBytes>(&handle, Some(qos.clone()));
        Ok(Box::new(subscription.map_err(|error| create(topic, &error))?))
    }

    pub(super) fn server<Q, A>(
        &mut self,
        service: &str,
        type_name: &str,
        qos: &QosProfile,
    ) -> Result<Requests<Q, A>, NodeError>
    where
        Q: Message + Clone + 'static,
        A: Message + 'static,
    {
        let (package, kind) = ends(type_name);
        let server = self.node.create_server::<Q, A>(
            self.mapping,
            &wire(service)?,
            &ServiceTypeName::new(package, kind),
            qos.clone(),
            qos.clone(),
        );
        let server = Rc::new(server.map_err(|error| create(service, &error))?);
        let clients = self.clients(service);
        let requests = unfold((server, clients), async |(server, clients)| {
            Some((receive(&server, &clients).await, (server, clients)))
        });
        Ok(requests.boxed_local())
    }

    fn clients(&self, service: &str) -> Clients {
        Clients {
            participant: self.context.domain_participant(),
            topic: format!("rr{service}Reply").into(),
            mapping: self.mapping,
        }
    }

    /// ros2-client keeps the type names of an action private, so its own action server is taken apart here.
    pub(super) fn action(&mut self, action: &str, qos: &ActionQos) -> Result<Action, NodeError> {
        let policies = ActionServerQosPolicies {
            goal_service: qos.services.clone(),
            result_service: qos.services.clone(),
            cancel_service: qos.services.clone(),
            feedback_publisher: qos.feedback.clone(),
            status_publisher: qos.status.clone(),
        };
        let kind = ActionTypeName::new("tactile_pose_fusion", "Calibrate");
        let server = self.node.create_action_server(self.mapping, &wire(action)?, &kind, policies);
        let server: Rc<Calibrate> = Rc::new(server.map_err(|error| create(action, &error))?);
        let (feedback, status) = (Rc::clone(&server), Rc::clone(&server));
        let clients = |service| self.clients(&format!("{action}/_action/{service}"));
        let [goals, cancels, results] = ["send_goal", "cancel_goal", "get_result"].map(clients);
        Ok(Action {
            goals: polled(&server, goals, Calibrate::receive_goal, Calibrate::send_goal_response),
            cancels: polled(&server, cancels, Calibrate::receive_cancel_request, Calibrate::send_cancel_response),
            results: polled(&server, results, Calibrate::receive_result_request, Calibrate::send_result),
            feedback: Box::new(move |FeedbackMessage { goal_id, feedback: message }| {
                feedback.send_feedback(goal_id, message).map_err(|_| Refused)
            }),
            status: Box::new(move |statuses| status.send_goal_statuses(statuses).map_err(|_| Refused)),
        })
    }

    fn topic(&self, topic: &str, ty: TopicType<'_>, qos: &QosProfile) -> Result<Topic, NodeError> {
        let (package, kind) = ends(ty.name());
        let created = self.node.create_topic(&wire(topic)?, MessageTypeName::new(package, kind), qos);
        created.map_err(|error| create(topic, &error))
    }
}

/// QoS that a publisher offers. For each subscriber that joins a volatile topic, RustDDS 0.15.1 as released notes every
/// message published before, one by one; the copy in third_party/rustdds notes one range. A topic that offers its last
/// messages to late subscribers needs neither, and a best effort subscriber is sent none of them. A reliable subscriber
/// would be, so its topics stay volatile.
fn offered(qos: &QosProfile) -> QosProfile {
    match (qos.reliability, qos.durability) {
        (Reliability::BestEffort, Durability::Volatile) => qos.clone().durability(Durability::TransientLocal),
        _ => qos.clone(),
    }
}

/// Gives a participant its keys. If there are none and none are enforced, a note reports that.
#[cfg(feature = "security")]
fn secured(
    participant: DomainParticipantBuilder,
    security: Option<&Security>,
) -> Result<(DomainParticipantBuilder, Option<String>), SecurityError> {
    let Some(security) = security else { return Ok((participant, None)) };
    match security.keys() {
        Ok(Keys { folder, note }) => {
            let no_password = String::new(); // SROS2 encrypts no key
            let files = DomainParticipantSecurityConfigFiles::with_ros_default_names(folder, no_password);
            Ok((participant.builtin_security(files), note))
        }
        Err(error) if security.enforce => Err(error),
        Err(error) => Ok((participant, Some(format!("talking in the clear, which Permissive allows: {error}")))),
    }
}

type Calibrate = ActionServer<CalibrateGoal, CalibrateResult, CalibrateFeedback>;

/// Takes a request, if there is one.
type Take<Q> = fn(&Calibrate) -> ReadResult<Option<(RmwRequestId, Q)>>;

/// A publisher, and the graph that knows its subscribers.
struct TopicPublisher {
    publisher: ros2_client::Publisher<CdrBytes>,
    participant: DomainParticipant,
    /// Its name in DDS.
    topic: String,
}

impl Publish for TopicPublisher {
    fn publish(&self, cdr: Vec<u8>) -> Result<(), Refused> {
        self.publisher.publish(CdrBytes(cdr)).map_err(|_| Refused)
    }

    fn has_subscribers(&self) -> bool {
        self.participant.sends_to(&self.topic, |_| true)
    }
}

impl Subscribe for ros2_client::Subscription<CdrBytes> {
    fn arrivals(&self) -> LocalBoxStream<'_, Result<Arrival, Fault>> {
        let arrival = |incoming| match incoming {
            Ok((CdrBytes(cdr), info)) => {
                let info: ros2_client::MessageInfo = info;
                Ok(Arrival {
                    cdr,
                    received: info.received_timestamp().map_or_else(system_now, |at| Stamp(at.to_nanos())),
                    publisher: Some(info.publisher_gid().to_bytes16()),
                })
            }
            Err(error) => {
                let error: ros2_client::ReadError = error;
                Err(Fault { n_messages: 1, reason: "unreadable", text: error.to_string() })
            }
        };
        self.async_stream_seed(AsCdr).map(arrival).boxed_local()
    }
}

/// The clients of a service, as far as its responses reach them.
#[derive(Clone)]
struct Clients {
    participant: DomainParticipant,
    /// The topic of the responses.
    topic: Rc<str>,
    mapping: ServiceMapping,
}

impl Clients {
    /// Waits until a response to this request reaches who asked, at most for a while.
    ///
    /// A client that knows our response writer may ask before we know its response reader, and what a volatile writer
    /// sends before that is lost. rmw_fastrtps and rmw_cyclonedds wait in their servers for the same reason.
    async fn wait_for(&self, id: RmwRequestId) {
        let asked_by = GUID::from(id.writer_gid);
        let is_client = |reader: &GUID| match self.mapping {
            // The second half is a number of Cyclone's own.
            ServiceMapping::Cyclone => reader.to_bytes()[..8] == asked_by.to_bytes()[..8],
            // Fast DDS tells its reader in a request, others their writer.
            _ if asked_by.entity_id.kind().is_reader() => *reader == asked_by,
            _ => reader.prefix == asked_by.prefix,
        };
        let begun = Stopwatch::start();
        while !self.participant.sends_to(&self.topic, is_client) && begun.elapsed() < CLIENT {
            tokio::time::sleep(CLIENT_POLL).await;
        }
    }
}

async fn receive<Q, A>(server: &Rc<Server<Q, A>>, clients: &Clients) -> Result<Request<Q, A>, String>
where
    Q: Message + 'static,
    A: Message + 'static,
{
    let (id, question) = server.async_receive_request().await.map_err(|error| error.to_string())?;
    let (server, clients) = (Rc::clone(server), clients.clone());
    let answer: Answer<A> = Box::new(move |response| {
        let sent = async move {
            clients.wait_for(id).await;
            server.async_send_response(id, response).await.map_err(|error| error.to_string())
        };
        Box::pin(sent)
    });
    Ok(Request { question, answer })
}

/// The requests of one of an action's services. The action server takes them only when it is asked to.
fn polled<Q: 'static, A: 'static, E: std::fmt::Display + 'static>(
    server: &Rc<Calibrate>,
    clients: Clients,
    receive: Take<Q>,
    send: fn(&Calibrate, RmwRequestId, A) -> Result<(), E>,
) -> Requests<Q, A> {
    let requests = unfold((Rc::clone(server), clients), move |(server, clients)| async move {
        let received = loop {
            match receive(&server).transpose() {
                Some(received) => break received,
                None => tokio::time::sleep(POLL).await,
            }
        };
        let (by, of) = (Rc::clone(&server), clients.clone());
        let request = received.map(|(id, question)| {
            let answer: Answer<A> = Box::new(move |response| {
                let sent = async move {
                    of.wait_for(id).await;
                    send(&by, id, response).map_err(|error| error.to_string())
                };
                Box::pin(sent)
            });
            Request { question, answer }
        });
        Some((request.map_err(|error| error.to_string()), (server, clients)))
    });
    requests.boxed_local()
}

/// Package and short name of a type.
fn ends(type_name: &str) -> (&str, &str) {
    let mut parts = type_name.split('/');
    (parts.next().unwrap_or_default(), parts.next_back().unwrap_or_default())
}

/// An absolute name in ros2-client's type.
fn wire(absolute: &str) -> Result<Name, NodeError> {
    Name::parse(absolute).map_err(|error| create(absolute, &error))
}
