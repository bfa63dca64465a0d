//! A node that calls a running node of this package: lifecycle, zero, parameters.

mod error;
mod parameters;

use std::time::{Duration, Instant};

use futures::StreamExt;
use futures::future::LocalBoxFuture;
use ros2_client::Message;
use ros2_client::action::{GoalId, GoalStatusEnum, SendGoalRequest};
use ros2_client::qos::Durability;

pub use error::{CallError, instead};
pub use parameters::NodeParameter;

use crate::config::NodeName;
use crate::leave;
use crate::msg::{CalibrateFeedback, CalibrateGoal, CalibrateResult, Duration as WireDuration, from_cdr};
use crate::ros::node::interfaces::{
    ChangeStateRequest, ChangeStateResponse, Empty, GetStateResponse, Log, Transition, TriggerResponse,
};
use crate::ros::wire::args::Severity;
use crate::ros::wire::clock::system_now;
use crate::ros::wire::entities::Graph;
use crate::ros::wire::environment::Environment;
use crate::ros::wire::error::NodeError;
use crate::ros::wire::graph::Around;
use crate::ros::wire::middleware::{Servers, Subscription, TopicType};
use crate::ros::wire::qos::reliable_qos;
use crate::ros::wire::remap::Remap;
use crate::ros::wire::threads::runtime;
use crate::units::{Stamp, nanos};

/// How often it is checked whether the server is there, and whether this process is to end.
const LOOK: Duration = Duration::from_millis(50);

/// How long a service has been the only one of its name before it is called: a second node of that name is found in this
/// time.
const SETTLING: Duration = Duration::from_millis(300);

/// Longest time for an answer that needs no work.
const ANSWER: Duration = Duration::from_secs(10);

/// Longest time for an answer after work: models are loaded for a transition, and for the judgement of a zero.
const WORK: Duration = Duration::from_secs(120);

/// Longest time for the end of a calibration that is cancelled: this process must end within two seconds.
const CANCEL: Duration = Duration::from_secs(1);

/// How long a line about a refusal may take from the node's log to here.
const WORD: Duration = Duration::from_millis(500);

/// A node beside the one that it calls.
pub struct Caller {
    graph: Graph,
    runtime: tokio::runtime::Runtime,
    node: NodeName,
    domain_id: u16,
    /// Longest time to find the node.
    patience: Duration,
}

impl Caller {
    /// Joins the graph as `name`, to call `node`, which must be found within `patience` at each call.
    ///
    /// # Errors
    /// [`NodeError`] when the middleware can't start.
    pub fn join(
        name: &NodeName,
        environment: &Environment,
        remaps: &[Remap],
        node: NodeName,
        patience: Duration,
    ) -> Result<Self, NodeError> {
        let graph = Graph::join(name, environment, remaps)?;
        Ok(Caller { graph, runtime: runtime()?, node, domain_id: environment.domain_id, patience })
    }

    /// Notes for the user about the graph.
    pub fn note(&self) -> Option<String> {
        self.graph.note()
    }

    /// Leaves the graph.
    pub fn leave(self) {
        let Caller { graph, runtime, .. } = self;
        drop(runtime);
        graph.leave();
    }

    /// The lifecycle state: unconfigured, inactive, active or finalized, or one between them.
    ///
    /// # Errors
    /// [`CallError`]
    pub fn state(&mut self) -> Result<String, CallError> {
        let state: GetStateResponse =
            self.call("~/get_state", "lifecycle_msgs/srv/GetState", Empty::default(), ANSWER)?;
        Ok(state.current_state.label)
    }

    /// Runs a transition by its label, such as "activate"; gives the state after it.
    ///
    /// # Errors
    /// [`CallError`]; with [`CallError::Refused`] the state is what it was.
    pub fn change_state(&mut self, label: &str) -> Result<String, CallError> {
        let (rosout, since) = (self.rosout()?, system_now());
        let request = ChangeStateRequest { transition: Transition { id: 0, label: label.to_owned() } };
        let changed: ChangeStateResponse =
            self.call("~/change_state", "lifecycle_msgs/srv/ChangeState", request, WORK)?;
        match changed.success {
            true => self.state(),
            false => Err(self.refused(&rosout, since, &format!("{label} failed"))),
        }
    }

    /// Takes a quick zero; gives what the node says of it.
    ///
    /// # Errors
    /// [`CallError`]; with [`CallError::Refused`] the zero is what it was.
    pub fn tare(&mut self) -> Result<String, CallError> {
        let tared: TriggerResponse = self.call("~/tare", "std_srvs/srv/Trigger", Empty::default(), WORK)?;
        if tared.success { Ok(tared.message) } else { Err(CallError::Refused(tared.message)) }
    }

    /// Calibrates for `duration`; zero takes the duration from the node's parameters. If this process is asked to end
    /// meanwhile, the calibration is cancelled.
    ///
    /// # Errors
    /// [`CallError`]; with [`CallError::Refused`] and [`CallError::Interrupted`] the zero is what it was.
    pub fn calibrate(
        &mut self,
        duration: Duration,
        on_feedback: &mut dyn FnMut(&CalibrateFeedback),
    ) -> Result<CalibrateResult, CallError> {
        let action = self.node.resolve("~/calibrate").map_err(NodeError::from)?;
        let client = self.graph.action_client(&action)?;
        self.find(&client.goals.n_servers)?;
        let (rosout, since) = (self.rosout()?, system_now());
        let goal_id = GoalId::new_random();
        let goal = CalibrateGoal { duration: WireDuration::from_nanos(nanos(duration)) };
        let asked = (client.goals.ask)(SendGoalRequest { goal_id, goal });
        if !self.wait(&client.goals.n_servers, asked, "~/calibrate", ANSWER)?.accepted {
            return Err(self.refused(&rosout, since, "the goal was rejected"));
        }
        let mut result = (client.results)(goal_id);
        let mut feedback = client.feedback.fuse();
        let mut heard = Instant::now();
        let mut cancelled = None::<Instant>;
        loop {
            let next = self.runtime.block_on(async {
                tokio::select! {
                    result = &mut result => Some(Ok(result)),
                    Some(message) = feedback.next() => Some(Err(message)),
                    () = tokio::time::sleep(LOOK) => None,
                }
            });
            match next {
                Some(Ok(answered)) => {
                    let ended = answered.map_err(|reason| self.unread("~/calibrate", reason))?;
                    return match (ended.result.success, ended.status) {
                        (true, _) => Ok(ended.result),
                        (false, GoalStatusEnum::Canceled) if cancelled.is_some() => Err(CallError::Interrupted),
                        (false, _) => Err(CallError::Refused(ended.result.message)),
                    };
                }
                Some(Err(message)) if message.goal_id == goal_id => {
                    heard = Instant::now();
                    on_feedback(&message.feedback);
                }
                Some(Err(_)) => {}
                None => {
                    // Another thread ends the process soon after it was asked to: only a moment is left for the answer.
                    if leave::asked() && cancelled.is_none() {
                        cancelled = Some(Instant::now());
                        let asked = (client.cancels)(goal_id);
                        let _ = self.wait(&client.goals.n_servers, asked, "~/calibrate", CANCEL); // the result tells more
                    }
                    if cancelled.is_some_and(|since| since.elapsed() > CANCEL) {
                        return Err(CallError::Interrupted);
                    }
                    if (client.goals.n_servers)() == 0 {
                        return Err(CallError::Left { node: self.node.to_string() });
                    }
                    if heard.elapsed() > WORK {
                        return Err(self.no_answer("~/calibrate", WORK));
                    }
                }
            }
        }
    }

    /// Calls a service of the node by a name such as `~/tare`.
    fn call<Q, A>(&mut self, service: &str, type_name: &str, question: Q, limit: Duration) -> Result<A, CallError>
    where
        Q: Message + Clone + 'static,
        A: Message + 'static,
    {
        let name = self.node.resolve(service).map_err(NodeError::from)?;
        let client = self.graph.client::<Q, A>(&name, type_name)?;
        self.find(&client.n_servers)?;
        let asked = (client.ask)(question);
        self.wait(&client.n_servers, asked, service, limit)
    }

    /// Waits until there is one server, and has been for a moment.
    fn find(&mut self, n_servers: &Servers) -> Result<(), CallError> {
        self.graph.around()?; // on DDS, this begins to read the names of nodes, in case that there is no such server
        let (began, mut found) = (Instant::now(), None::<Instant>);
        loop {
            match n_servers() {
                0 => found = None,
                _ => found = found.or_else(|| Some(Instant::now())),
            }
            if found.is_some_and(|found| found.elapsed() >= SETTLING) {
                let n = n_servers();
                return if n > 1 { Err(CallError::Several { node: self.node.to_string(), n }) } else { Ok(()) };
            }
            if leave::asked() {
                return Err(CallError::Interrupted);
            }
            if found.is_none() && began.elapsed() >= self.patience {
                let around = self.graph.around()?;
                return Err(self.absent(&around));
            }
            std::thread::sleep(LOOK);
        }
    }

    fn absent(&self, around: &Around) -> CallError {
        let node = self.node.to_string();
        if around.nodes.contains(&node) && !around.fusion_nodes().contains(&node.as_str()) {
            return CallError::Foreign { node };
        }
        let here = around.fusion_nodes().into_iter().map(str::to_owned).collect();
        CallError::Absent { node, after_s: self.patience.as_secs_f64(), here, domain_id: self.domain_id }
    }

    fn wait<A>(
        &self,
        n_servers: &Servers,
        mut asked: LocalBoxFuture<'static, Result<A, String>>,
        what: &str,
        limit: Duration,
    ) -> Result<A, CallError> {
        let began = Instant::now();
        loop {
            let answered = self.runtime.block_on(async { tokio::time::timeout(LOOK, &mut asked).await });
            match answered {
                Ok(answered) => return answered.map_err(|reason| self.unread(what, reason)),
                Err(_) if n_servers() == 0 => return Err(CallError::Left { node: self.node.to_string() }),
                // A request to cancel is sent when this process was asked to end, and has a moment.
                Err(_) if leave::asked() && limit > CANCEL => return Err(CallError::Interrupted),
                Err(_) if began.elapsed() >= limit => return Err(self.no_answer(what, limit)),
                Err(_) => {}
            }
        }
    }

    fn no_answer(&self, what: &str, limit: Duration) -> CallError {
        CallError::NoAnswer { node: self.node.to_string(), what: what.to_owned(), after_s: limit.as_secs_f64() }
    }

    fn unread(&self, what: &str, reason: String) -> CallError {
        CallError::Unread { node: self.node.to_string(), what: what.to_owned(), reason }
    }

    /// The log of all nodes.
    fn rosout(&mut self) -> Result<Subscription, NodeError> {
        let qos = reliable_qos(100, Durability::TransientLocal);
        self.graph.subscription("/rosout", TopicType::Known(<Log as crate::msg::WireType>::TYPE_NAME), &qos)
    }

    /// A refusal whose reason the node tells in its log only.
    fn refused(&self, rosout: &Subscription, since: Stamp, what: &str) -> CallError {
        let logged = async {
            let mut lines = rosout.arrivals();
            while let Some(line) = lines.next().await {
                let Some(log) = line.ok().and_then(|line| from_cdr::<Log>(&line.cdr).ok()) else { continue };
                let is_bad = log.level >= Severity::Warn as u8;
                if is_bad && log.name == self.node.name() && Stamp::from(log.stamp) >= since {
                    return Some(log.msg);
                }
            }
            None
        };
        let said = self.runtime.block_on(async { tokio::time::timeout(WORD, logged).await });
        CallError::Refused(match said.ok().flatten() {
            Some(said) => format!("{what}: {said}"),
            None => format!("{what}; the log of {} says why", self.node),
        })
    }
}
