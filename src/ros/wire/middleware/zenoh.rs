//! Zenoh, in the layout of rmw_zenoh: keys with the hash of the type, liveliness tokens as the graph, queryables as
//! services. ros2-client's own Zenoh backend gives unknown types a hash of zeros, which matches nothing.
//!
//! # Source
//! docs/design.md of rmw_zenoh.

mod client;
mod config;
mod hashes;
mod keys;
mod publisher;
mod server;
mod subscription;

use std::time::{Duration, Instant};

use ::zenoh::liveliness::LivelinessToken;
use ::zenoh::{Session, Wait};
use ros2_client::action::FeedbackMessage;
use ros2_client::action_msgs::GoalStatusArray;
use ros2_client::{Message, QosProfile};
use serde::Serialize;

use self::keys::{Kind, NodeKeys, Token};
use super::{
    Action, ActionClient, ActionQos, Client, LEAVE, Publish, Publisher, Pulse, Requests, Sender, Subscription,
    TopicType,
};
use crate::config::NodeName;
use crate::msg::{CalibrateFeedback, encode, type_hash};
use crate::ros::wire::environment::ZenohVars;
use crate::ros::wire::error::NodeError;
use crate::ros::wire::error::create;
use crate::ros::wire::graph::{Around, Endpoint, Server};
use crate::ros::wire::threads;

/// How long a session may take to reach the router of its host before a note is logged.
const REACH: Duration = Duration::from_secs(1);

pub(in crate::ros) struct Participant {
    session: Session,
    keys: NodeKeys,
    n_entities: u64,
    token: LivelinessToken,
}

/// Makes an entity known to others.
struct Entity {
    /// The key of its data or its requests.
    key: String,
    gid: [u8; 16],
    /// The entity stays in the graph until this is dropped.
    token: LivelinessToken,
}

impl Participant {
    pub(super) fn join(name: &NodeName, domain_id: u16, vars: &ZenohVars) -> Result<Self, NodeError> {
        let failed = |error: ::zenoh::Error| create("Zenoh session", &one_line(&error));
        let config = config::of(vars).map_err(failed)?;
        let session = ::zenoh::open(config).wait().map_err(failed)?;
        let keys = NodeKeys::new(domain_id, &session.zid().to_string(), name.namespace(), name.name());
        let token = session.liveliness().declare_token(keys.node()).wait().map_err(failed)?;
        Ok(Participant { session, keys, n_entities: 0, token })
    }

    /// Note for the user: no other node can be reached.
    pub(super) fn note(&self) -> Option<String> {
        let reached = || {
            let info = self.session.info();
            info.routers_zid().wait().chain(info.peers_zid().wait()).next().is_some()
        };
        let deadline = Instant::now() + REACH;
        while !reached() {
            if Instant::now() >= deadline {
                let text = "no Zenoh router or peer is reached yet, so nobody finds this node; start a router: ros2 run \
                            rmw_zenoh_cpp rmw_zenohd";
                return Some(text.to_owned());
            }
            std::thread::sleep(REACH / 50);
        }
        None
    }

    pub(super) fn pulse(&self) -> Pulse {
        let session = self.session.clone();
        Box::new(move || session.is_closed().then(|| threads::has_ended("Zenoh session")))
    }

    pub(super) fn leave(self) {
        let Participant { session, token, .. } = self;
        threads::within(LEAVE, move || {
            drop(token);
            let _ = session.close().wait(); // the rest of it ends with the process
        });
    }

    pub(super) fn publisher(
        &mut self,
        topic: &str,
        ty: TopicType<'_>,
        qos: &QosProfile,
    ) -> Result<Publisher, NodeError> {
        let entity = self.topic(Kind::Publisher, topic, ty, qos)?;
        let publisher = publisher::declare(&self.session, entity, qos);
        Ok(Box::new(publisher.map_err(|error| create(topic, &one_line(&error)))?))
    }

    pub(super) fn subscription(
        &mut self,
        topic: &str,
        ty: TopicType<'_>,
        qos: &QosProfile,
    ) -> Result<Subscription, NodeError> {
        let entity = self.topic(Kind::Subscription, topic, ty, qos)?;
        let subscription = subscription::declare(&self.session, entity, qos);
        Ok(Box::new(subscription.map_err(|error| create(topic, &one_line(&error)))?))
    }

    pub(super) fn server<Q, A>(
        &mut self,
        service: &str,
        type_name: &str,
        qos: &QosProfile,
    ) -> Result<Requests<Q, A>, NodeError>
    where
        Q: Message + 'static,
        A: Message + 'static,
    {
        let entity = self.topic(Kind::Server, service, TopicType::Known(type_name), qos)?;
        server::declare(&self.session, entity).map_err(|error| create(service, &one_line(&error)))
    }

    pub(super) fn action(&mut self, action: &str, qos: &ActionQos) -> Result<Action, NodeError> {
        let part = |name: &str| format!("{action}/_action/{name}");
        let own = |name: &str| format!("tactile_pose_fusion/action/Calibrate_{name}");
        let feedback_type = own("FeedbackMessage");
        let feedback = self.publisher(&part("feedback"), TopicType::Known(&feedback_type), &qos.feedback)?;
        let status =
            self.publisher(&part("status"), TopicType::Known("action_msgs/msg/GoalStatusArray"), &qos.status)?;
        Ok(Action {
            goals: self.server(&part("send_goal"), &own("SendGoal"), &qos.services)?,
            cancels: self.server(&part("cancel_goal"), "action_msgs/srv/CancelGoal", &qos.services)?,
            results: self.server(&part("get_result"), &own("GetResult"), &qos.services)?,
            feedback: sender::<FeedbackMessage<CalibrateFeedback>>(feedback),
            status: sender::<GoalStatusArray>(status),
        })
    }

    pub(super) fn client<Q, A>(
        &mut self,
        service: &str,
        type_name: &str,
        qos: &QosProfile,
    ) -> Result<Client<Q, A>, NodeError>
    where
        Q: Message + 'static,
        A: Message + 'static,
    {
        let entity = self.topic(Kind::Client, service, TopicType::Known(type_name), qos)?;
        let servers = self.keys.servers(service);
        Ok(client::of_service(&self.session, entity, servers))
    }

    pub(super) fn action_client(&mut self, action: &str, qos: &ActionQos) -> Result<ActionClient, NodeError> {
        let part = |name: &str| format!("{action}/_action/{name}");
        let own = |name: &str| format!("tactile_pose_fusion/action/Calibrate_{name}");
        let feedback_type = own("FeedbackMessage");
        let feedback = self.subscription(&part("feedback"), TopicType::Known(&feedback_type), &qos.feedback)?;
        let servers = self.keys.servers(&part("send_goal"));
        let mut entity =
            |name: &str, type_name: &str| self.topic(Kind::Client, name, TopicType::Known(type_name), &qos.services);
        let goals = (entity(&part("send_goal"), &own("SendGoal"))?, servers);
        let cancels = entity(&part("cancel_goal"), "action_msgs/srv/CancelGoal")?;
        let results = entity(&part("get_result"), &own("GetResult"))?;
        Ok(client::of_action(&self.session, goals, cancels, results, feedback))
    }

    /// The other sessions' nodes and entities, by the tokens that are alive.
    pub(super) fn around(&self) -> Around {
        let own = self.session.zid().to_string();
        let mut around = Around::default();
        for token in client::tokens(&self.session, &self.keys.all()) {
            let endpoint = |token: Token| Endpoint {
                topic: token.name,
                type_name: token.type_name,
                type_hash: Some(token.hash),
                qos: token.qos,
            };
            match Token::parse(&token).filter(|token| token.session != own) {
                Some(token) if token.kind == "NN" => around.nodes.push(token.node),
                Some(token) if token.kind == "MP" => around.publishers.push(endpoint(token)),
                Some(token) if token.kind == "MS" => around.subscriptions.push(endpoint(token)),
                Some(Token { kind, name, type_name, .. }) if kind == "SS" => {
                    around.servers.push(Server { service: name, type_name });
                }
                _ => {}
            }
        }
        around.nodes.sort_unstable();
        around
    }

    /// Puts an entity into the graph.
    fn topic(&mut self, kind: Kind, name: &str, ty: TopicType<'_>, qos: &QosProfile) -> Result<Entity, NodeError> {
        let hash = match ty {
            TopicType::Defined(tree) => type_hash(tree),
            TopicType::Known(type_name) => hashes::of(type_name).ok_or_else(|| {
                create(name, &format!("{type_name} is not defined here, and Zenoh needs the hash of its definition"))
            })?,
        };
        self.n_entities += 1;
        let token_key = self.keys.entity(self.n_entities, kind, name, ty.name(), &hash, qos);
        let token = self.session.liveliness().declare_token(token_key.as_str()).wait();
        Ok(Entity {
            key: self.keys.data(name, ty.name(), &hash),
            gid: keys::gid(&token_key),
            token: token.map_err(|error| create(name, &one_line(&error)))?,
        })
    }
}

fn sender<M: Serialize + 'static>(publisher: Publisher) -> Sender<M> {
    Box::new(move |message| publisher.publish(encode(&message)))
}

fn one_line(error: &::zenoh::Error) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}
