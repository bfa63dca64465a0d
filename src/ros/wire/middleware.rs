//! The interface to the middleware. Code above it names neither DDS nor Zenoh, and has one path for both.

mod dds;
#[cfg(feature = "zenoh")]
mod zenoh;

use std::time::Duration;

use futures::future::LocalBoxFuture;
use futures::stream::LocalBoxStream;
use ros2_client::action::{
    CancelGoalRequest, CancelGoalResponse, FeedbackMessage, GetResultRequest, GetResultResponse, GoalId,
    SendGoalRequest, SendGoalResponse,
};
use ros2_client::action_msgs::GoalStatusArray;
use ros2_client::{Message, QosProfile};

use super::environment::{Environment, Middleware};
use super::error::NodeError;
use super::graph::{Around, Endpoint};
use crate::config::NodeName;
use crate::msg::definition::TypeTree;
use crate::msg::{CalibrateFeedback, CalibrateGoal, CalibrateResult};
use crate::units::Stamp;

/// Time limit for a middleware to leave.
const LEAVE: Duration = Duration::from_millis(700);

/// A node in the graph, which creates entities by their absolute names.
pub(in crate::ros) enum Participant {
    /// On DDS.
    Dds(Box<dds::Participant>),
    /// On Zenoh, compatible with rmw_zenoh.
    #[cfg(feature = "zenoh")]
    Zenoh(Box<zenoh::Participant>),
}

/// The type of a topic.
#[derive(Debug, Clone, Copy)]
pub enum TopicType<'a> {
    /// A type with a struct in this node, by its canonical name.
    Known(&'a str),
    /// Any other type, with its definition.
    Defined(&'a TypeTree),
}

impl TopicType<'_> {
    /// Its canonical name.
    pub fn name(&self) -> &str {
        match self {
            TopicType::Known(name) => name,
            TopicType::Defined(tree) => tree.type_name(),
        }
    }
}

/// Sends the messages of a topic.
pub(in crate::ros) trait Publish: Send {
    /// Sends a message in little-endian CDR, after its encapsulation header.
    ///
    /// # Errors
    /// [`Refused`] when the message was sent to nobody.
    fn publish(&self, cdr: Vec<u8>) -> Result<(), Refused>;

    /// True if somebody subscribes, as far as the middleware knows.
    fn has_subscribers(&self) -> bool;
}

/// Receives the messages of a topic.
pub(in crate::ros) trait Subscribe: Send {
    /// The messages, without end.
    fn arrivals(&self) -> LocalBoxStream<'_, Result<Arrival, Fault>>;
}

/// Returns the reason if the middleware no longer sends or receives. It is polled all the time.
pub(in crate::ros) type Pulse = Box<dyn FnMut() -> Option<String> + Send>;

pub(in crate::ros) type Publisher = Box<dyn Publish>;
pub(in crate::ros) type Subscription = Box<dyn Subscribe>;

/// The middleware refused a message: a reliable subscriber has not acknowledged earlier ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::ros) struct Refused;

/// A received message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::ros) struct Arrival {
    /// The message in CDR, after its encapsulation header.
    pub(in crate::ros) cdr: Vec<u8>,
    /// Receipt time, by the system clock.
    pub(in crate::ros) received: Stamp,
    /// Its sender, if the middleware reports it.
    pub(in crate::ros) publisher: Option<[u8; 16]>,
}

/// Waits until reliable subscribers have received everything published, up to a limit. Publishers dropped before that
/// resend nothing.
pub(in crate::ros) type Settle = Box<dyn Fn(Duration) + Send>;

/// The other nodes' entities in the graph.
pub(in crate::ros) trait Discovered: Send {
    /// Publishers of others.
    fn publishers(&self) -> Vec<Endpoint>;
    /// Subscriptions of others.
    fn subscriptions(&self) -> Vec<Endpoint>;
}

/// Reports the other nodes' entities in the graph, as long as it is kept.
pub(in crate::ros) type Neighbours = Box<dyn Discovered>;

/// Messages lost before they could be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::ros) struct Fault {
    pub(in crate::ros) n_messages: u64,
    pub(in crate::ros) reason: &'static str,
    pub(in crate::ros) text: String,
}

/// The requests of a service as they arrive; dropping this ends the service. An item that is not a request gives the
/// reason why a request can't be read.
pub(in crate::ros) type Requests<Q, A> = LocalBoxStream<'static, Result<Request<Q, A>, String>>;

/// A request that waits for its answer.
pub(in crate::ros) struct Request<Q, A> {
    pub(in crate::ros) question: Q,
    pub(in crate::ros) answer: Answer<A>,
}

/// Sends a response to the client; an error gives the reason why it couldn't.
pub(in crate::ros) type Answer<A> = Box<dyn FnOnce(A) -> LocalBoxFuture<'static, Result<(), String>>>;

/// The three services and two topics of our `Calibrate` action.
pub(in crate::ros) struct Action {
    pub(in crate::ros) goals: Requests<SendGoalRequest<CalibrateGoal>, SendGoalResponse>,
    pub(in crate::ros) cancels: Requests<CancelGoalRequest, CancelGoalResponse>,
    pub(in crate::ros) results: Requests<GetResultRequest, GetResultResponse<CalibrateResult>>,
    pub(in crate::ros) feedback: Sender<FeedbackMessage<CalibrateFeedback>>,
    pub(in crate::ros) status: Sender<GoalStatusArray>,
}

/// Sends messages of one type.
pub(in crate::ros) type Sender<M> = Box<dyn Fn(M) -> Result<(), Refused>>;

/// The servers of a service of another node, as this node reaches them.
pub(in crate::ros) struct Client<Q, A> {
    /// Number of servers that would get a request now. May take a moment.
    pub(in crate::ros) n_servers: Servers,
    pub(in crate::ros) ask: Ask<Q, A>,
}

/// Number of servers that would get a request now.
pub(in crate::ros) type Servers = Box<dyn Fn() -> usize>;

/// Sends a request; gives the response, or the reason why there is none. It waits for a response as long as it is kept.
pub(in crate::ros) type Ask<Q, A> = Box<dyn Fn(Q) -> LocalBoxFuture<'static, Result<A, String>>>;

/// The `Calibrate` action of another node.
pub(in crate::ros) struct ActionClient {
    pub(in crate::ros) goals: Client<SendGoalRequest<CalibrateGoal>, SendGoalResponse>,
    pub(in crate::ros) cancels: Ask<GoalId, CancelGoalResponse>,
    pub(in crate::ros) results: Ask<GoalId, GetResultResponse<CalibrateResult>>,
    /// Of any goal.
    pub(in crate::ros) feedback: LocalBoxStream<'static, FeedbackMessage<CalibrateFeedback>>,
}

/// QoS of an action's parts.
pub(in crate::ros) struct ActionQos {
    pub(in crate::ros) services: QosProfile,
    pub(in crate::ros) feedback: QosProfile,
    pub(in crate::ros) status: QosProfile,
}

impl Participant {
    /// Joins the graph on the middleware that the environment names.
    pub(in crate::ros) fn join(name: &NodeName, environment: &Environment) -> Result<Self, NodeError> {
        match &environment.middleware {
            Middleware::Dds(style) => {
                Ok(Participant::Dds(Box::new(dds::Participant::join(name, environment, *style)?)))
            }
            #[cfg(feature = "zenoh")]
            Middleware::Zenoh(vars) => {
                Ok(Participant::Zenoh(Box::new(zenoh::Participant::join(name, environment.domain_id, vars)?)))
            }
        }
    }

    /// Notes for the user about the graph.
    pub(in crate::ros) fn note(&self) -> Option<String> {
        match self {
            Participant::Dds(participant) => participant.note(),
            #[cfg(feature = "zenoh")]
            Participant::Zenoh(participant) => participant.note(),
        }
    }

    /// The check of whether the middleware still works.
    pub(in crate::ros) fn pulse(&self) -> Pulse {
        match self {
            Participant::Dds(participant) => participant.pulse(),
            #[cfg(feature = "zenoh")]
            Participant::Zenoh(participant) => participant.pulse(),
        }
    }

    /// The wait for subscribers. On Zenoh, leaving does this.
    pub(in crate::ros) fn settle(&self) -> Settle {
        match self {
            Participant::Dds(participant) => participant.settle(),
            #[cfg(feature = "zenoh")]
            Participant::Zenoh(_) => Box::new(|_| ()),
        }
    }

    /// The other nodes' entities in the graph; `None` if the middleware isn't asked, as on Zenoh.
    pub(in crate::ros) fn neighbours(&self) -> Option<Neighbours> {
        match self {
            Participant::Dds(participant) => Some(participant.neighbours()),
            #[cfg(feature = "zenoh")]
            Participant::Zenoh(_) => None,
        }
    }

    /// The other nodes and all of their entities, by now. May wait for answers of the network, up to half a second.
    pub(in crate::ros) fn around(&mut self) -> Result<Around, NodeError> {
        match self {
            Participant::Dds(participant) => participant.around(),
            #[cfg(feature = "zenoh")]
            Participant::Zenoh(participant) => Ok(participant.around()),
        }
    }

    /// Leaves the graph, after all entities created here have been dropped. Takes less than a second.
    pub(in crate::ros) fn leave(self) {
        match self {
            Participant::Dds(participant) => participant.leave(),
            #[cfg(feature = "zenoh")]
            Participant::Zenoh(participant) => participant.leave(),
        }
    }

    /// A publisher on an absolute name.
    pub(in crate::ros) fn publisher(
        &mut self,
        topic: &str,
        ty: TopicType<'_>,
        qos: &QosProfile,
    ) -> Result<Publisher, NodeError> {
        match self {
            Participant::Dds(participant) => participant.publisher(topic, ty, qos),
            #[cfg(feature = "zenoh")]
            Participant::Zenoh(participant) => participant.publisher(topic, ty, qos),
        }
    }

    /// A subscription of an absolute name.
    pub(in crate::ros) fn subscription(
        &mut self,
        topic: &str,
        ty: TopicType<'_>,
        qos: &QosProfile,
    ) -> Result<Subscription, NodeError> {
        match self {
            Participant::Dds(participant) => participant.subscription(topic, ty, qos),
            #[cfg(feature = "zenoh")]
            Participant::Zenoh(participant) => participant.subscription(topic, ty, qos),
        }
    }

    /// A server of an absolute name and a type such as `std_srvs/srv/Trigger`.
    pub(in crate::ros) fn server<Q, A>(
        &mut self,
        service: &str,
        type_name: &str,
        qos: &QosProfile,
    ) -> Result<Requests<Q, A>, NodeError>
    where
        Q: Message + Clone + 'static,
        A: Message + 'static,
    {
        match self {
            Participant::Dds(participant) => participant.server(service, type_name, qos),
            #[cfg(feature = "zenoh")]
            Participant::Zenoh(participant) => participant.server(service, type_name, qos),
        }
    }

    /// An action of an absolute name and of type `tactile_pose_fusion/action/Calibrate`.
    pub(in crate::ros) fn action(&mut self, action: &str, qos: &ActionQos) -> Result<Action, NodeError> {
        match self {
            Participant::Dds(participant) => participant.action(action, qos),
            #[cfg(feature = "zenoh")]
            Participant::Zenoh(participant) => participant.action(action, qos),
        }
    }

    /// A client of a service of another node, by an absolute name and a type such as `std_srvs/srv/Trigger`.
    pub(in crate::ros) fn client<Q, A>(
        &mut self,
        service: &str,
        type_name: &str,
        qos: &QosProfile,
    ) -> Result<Client<Q, A>, NodeError>
    where
        Q: Message + Clone + 'static,
        A: Message + 'static,
    {
        match self {
            Participant::Dds(participant) => participant.client(service, type_name, qos),
            #[cfg(feature = "zenoh")]
            Participant::Zenoh(participant) => participant.client(service, type_name, qos),
        }
    }

    /// A client of an action of another node, of type `tactile_pose_fusion/action/Calibrate`.
    pub(in crate::ros) fn action_client(&mut self, action: &str, qos: &ActionQos) -> Result<ActionClient, NodeError> {
        match self {
            Participant::Dds(participant) => participant.action_client(action, qos),
            #[cfg(feature = "zenoh")]
            Participant::Zenoh(participant) => participant.action_client(action, qos),
        }
    }
}
