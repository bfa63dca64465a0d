//! The node from start to end: joins the graph, starts its threads, answers services, leaves.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::Duration;

use futures::StreamExt;
use ros2_client::qos::Durability;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc;

use super::args::{RosArgs, Severity};
use super::calibrate_action;
use super::clock::Clock;
use super::definitions::{Definitions, LookupError};
use super::engine::{Command, Engine, Input, Outputs, Record};
use super::entities::{Graph, Names, reliable_qos};
use super::environment::Environment;
use super::interfaces::{self, DiagnosticArray, Log, TransitionEvent};
use super::managed::Managed;
use super::middleware::{Publisher, Subscription, TopicType};
use super::outbox::{self, LogConfig, OutIdx, Outbox, Rosout};
use super::parameters::{ParameterEvent, Parameters};
use super::qos::{self, QosError, Side};
use super::security::SecurityError;
use super::services;
use crate::config::{Config, NameError, ParamTree};
use crate::fusion::{JointSourceIdx, TactileSourceIdx};
use crate::msg::binding::{BindingError, JointBinding, SampleBinding, TaxelBinding};
use crate::msg::definition::TypeTree;
use crate::msg::{ContactArray, WireType, WrenchStamped, from_cdr};

/// What a node is made from.
#[derive(Debug)]
pub struct Setup {
    /// What the parameters say.
    pub cfg: Config,
    /// The parameters themselves.
    pub tree: ParamTree,
    /// What stood after `--ros-args`.
    pub args: RosArgs,
    /// What the environment says.
    pub environment: Environment,
    /// Calibration file instead of that of the parameters.
    pub calibration: Option<PathBuf>,
    /// Where handled inputs and outputs are recorded to.
    pub recorder: Option<SyncSender<Record>>,
}

/// Why a node can't start or go on. Each text is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum NodeError {
    #[error(transparent)]
    Name(#[from] NameError),
    #[error(transparent)]
    Qos(#[from] QosError),
    #[error("ROS_SECURITY_STRATEGY=Enforce: {0}")]
    Security(#[from] SecurityError),
    #[error(transparent)]
    Lookup(#[from] LookupError),
    #[error("topic {topic}: {error}")]
    Binding { topic: String, error: Box<BindingError> },
    #[error("{what}: can't be created: {reason}")]
    Create { what: String, reason: String },
    #[error("{what}: {source}")]
    System { what: &'static str, source: std::io::Error },
    #[error("{0}")]
    Configure(String),
}

/// What the services share.
pub(super) struct Shared {
    pub(super) parameters: RefCell<Parameters>,
    pub(super) managed: Managed,
    pub(super) commands: mpsc::UnboundedSender<Command>,
    pub(super) outbox: Outbox,
    pub(super) clock: Arc<Clock>,
    pub(super) parameter_events: OutIdx,
    /// SHA-256 of each model in use.
    pub(super) hashes: RefCell<BTreeMap<String, String>>,
    /// Whether a calibration is under way.
    pub(super) calibrating: Cell<bool>,
    pub(super) node_name: String,
}

/// Runs a node until SIGINT or SIGTERM, and leaves the graph.
///
/// # Errors
/// [`NodeError`] when it can't start: a topic, type, model or calibration is not what the parameters say.
pub fn run(setup: Setup) -> Result<(), NodeError> {
    let Setup { cfg, tree, args, environment, calibration, recorder } = setup;
    let names = Names::new(&cfg, &args.remaps)?;
    let definitions = Definitions::new(cfg.live.message_definitions.as_deref(), &environment.prefixes);
    let bindings = input_bindings(&cfg, &names, &definitions)?;
    let clock = Arc::new(Clock::new(cfg.use_sim_time));

    let mut graph = Graph::join(&cfg.node, &environment, &args.remaps)?;
    let inputs = inputs(&mut graph, &tree, &names, bindings)?;
    let (publishers, outputs, transition_event, parameter_events) = publishers(&mut graph, &tree, &names)?;
    let entities = names.inputs.iter().map(|name| (name.clone(), Side::Subscription));
    let entities = entities.chain(names.estimates.names().map(|name| (name.to_owned(), Side::Publisher)));
    qos::check_all_used(&tree, &entities.collect::<Vec<_>>())?;
    let sim_clock = match cfg.use_sim_time {
        true => {
            let ty = TopicType::Known(interfaces::Clock::TYPE_NAME);
            Some(graph.subscription("/clock", ty, &qos::output_default())?)
        }
        false => None,
    };
    let rosout = match args.rosout {
        true => Some(Rosout {
            publisher: graph.publisher("/rosout", TopicType::Known(Log::TYPE_NAME), &qos::rosout())?,
            logger: cfg.node.name().to_owned(),
        }),
        false => None,
    };

    let log = LogConfig { level: args.log_level, stderr: args.stderr };
    let (outbox, publishing) = outbox::start(publishers, rosout, log, Arc::clone(&clock))
        .map_err(|source| NodeError::System { what: "thread", source })?;
    environment.notes.iter().cloned().chain(graph.note()).for_each(|note| outbox.log(Severity::Warn, note));
    let (commands, engine_commands) = mpsc::unbounded_channel();
    let engine = Engine { cfg: cfg.clone(), clock: Arc::clone(&clock), outbox: outbox.clone(), outputs, recorder };
    let runtime = runtime()?;
    let work = move || runtime.block_on(engine.run(inputs, engine_commands));
    let reading = std::thread::Builder::new().name("engine".into()).spawn(work);
    let reading = reading.map_err(|source| NodeError::System { what: "thread", source })?;

    let shared = Rc::new(Shared {
        managed: Managed::new(transition_event, calibration),
        parameters: RefCell::new(Parameters::new(tree, cfg.clone())),
        commands: commands.clone(),
        outbox: outbox.clone(),
        clock: Arc::clone(&clock),
        parameter_events,
        hashes: RefCell::default(),
        calibrating: Cell::new(false),
        node_name: cfg.node.to_string(),
    });
    let runtime = self::runtime()?;
    let outcome = tokio::task::LocalSet::new().block_on(&runtime, async {
        services::start(&mut graph, &shared)?;
        calibrate_action::start(&mut graph, &shared)?;
        if let Some(subscription) = sim_clock {
            tokio::task::spawn_local(follow(subscription, Arc::clone(&clock)));
        }
        let what = "signals";
        let mut interrupt = signal(SignalKind::interrupt()).map_err(|source| NodeError::System { what, source })?;
        let mut terminate = signal(SignalKind::terminate()).map_err(|source| NodeError::System { what, source })?;
        let starting = async {
            match shared.managed.autostart(&shared).await {
                Ok(()) => std::future::pending().await,
                Err(error) => error,
            }
        };
        tokio::select! {
            _ = interrupt.recv() => Ok(()),
            _ = terminate.recv() => Ok(()),
            error = starting => Err(error),
        }
    });
    outbox.log(Severity::Info, "leaving");
    let _ = commands.send(Command::Stop);
    // An inference takes well under a millisecond; whatever else holds the engine must not hold the node in the graph.
    for _ in 0..200 {
        if reading.is_finished() {
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    drop(shared);
    publishing.end();
    graph.leave();
    outcome
}

/// Sets the clock by the time that is told on `/clock`.
async fn follow(subscription: Subscription, clock: Arc<Clock>) {
    let mut times = subscription.arrivals();
    while let Some(time) = times.next().await {
        if let Ok(time) = time
            && let Ok(message) = from_cdr::<interfaces::Clock>(&time.cdr)
        {
            clock.handle_clock(message.clock.into());
        }
    }
}

pub(super) fn runtime() -> Result<tokio::runtime::Runtime, NodeError> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    runtime.map_err(|source| NodeError::System { what: "runtime", source })
}

/// The type of each input and what turns its messages into samples, tactile sources first.
///
/// # Errors
/// [`NodeError`] when a type is not known, or has not what the parameters say.
pub fn input_bindings(
    cfg: &Config,
    names: &Names,
    definitions: &Definitions,
) -> Result<Vec<(TypeTree, SampleBinding)>, NodeError> {
    let mut bindings = Vec::new();
    for (idx, topic) in cfg.tactile.iter().enumerate() {
        let tree = definitions.tree(&topic.type_name)?;
        let binding = TaxelBinding::compile(&topic.fields, &tree);
        let binding = binding.map_err(|error| refused(&names.inputs[bindings.len()], error))?;
        bindings.push((tree, SampleBinding::Taxels(TactileSourceIdx(idx), Box::new(binding))));
    }
    for (idx, topic) in cfg.joints.iter().enumerate() {
        let tree = definitions.tree(&topic.type_name)?;
        let binding = JointBinding::compile(&topic.fields, &tree);
        let binding = binding.map_err(|error| refused(&names.inputs[bindings.len()], error))?;
        bindings.push((tree, SampleBinding::Joints(JointSourceIdx(idx), Box::new(binding))));
    }
    Ok(bindings)
}

fn refused(topic: &str, error: BindingError) -> NodeError {
    NodeError::Binding { topic: topic.to_owned(), error: Box::new(error) }
}

fn inputs(
    graph: &mut Graph,
    tree: &ParamTree,
    names: &Names,
    bindings: Vec<(TypeTree, SampleBinding)>,
) -> Result<Vec<Input>, NodeError> {
    let mut inputs = Vec::new();
    for (topic, (ty, binding)) in names.inputs.iter().zip(bindings) {
        let qos = qos::with_overrides(qos::input_default(), tree, topic, Side::Subscription)?;
        let subscription = graph.subscription(topic, TopicType::Defined(&ty), &qos)?;
        inputs.push(Input { topic: topic.clone(), subscription, binding });
    }
    Ok(inputs)
}

type Publishers = (Vec<Publisher>, Outputs, OutIdx, OutIdx);

fn publishers(graph: &mut Graph, tree: &ParamTree, names: &Names) -> Result<Publishers, NodeError> {
    let mut publishers = Vec::new();
    let mut estimates = Vec::new();
    let last = names.estimates.wrenches.len();
    for (idx, topic) in names.estimates.names().enumerate() {
        let qos = qos::with_overrides(qos::output_default(), tree, topic, Side::Publisher)?;
        let type_name = if idx < last { WrenchStamped::TYPE_NAME } else { ContactArray::TYPE_NAME };
        estimates.push(OutIdx(publishers.len()));
        publishers.push(graph.publisher(topic, TopicType::Known(type_name), &qos)?);
    }
    let mut add = |topic: &str, type_name, qos| -> Result<OutIdx, NodeError> {
        publishers.push(graph.publisher(topic, TopicType::Known(type_name), &qos)?);
        Ok(OutIdx(publishers.len() - 1))
    };
    let diagnostics = add("/diagnostics", DiagnosticArray::TYPE_NAME, reliable_qos(10, Durability::Volatile))?;
    let parameter_events =
        add("/parameter_events", ParameterEvent::TYPE_NAME, reliable_qos(1000, Durability::Volatile))?;
    let transitions = graph.topic_name("~/transition_event")?;
    publishers.push(graph.publisher(
        &transitions,
        TopicType::Known(TransitionEvent::TYPE_NAME),
        &reliable_qos(10, Durability::Volatile),
    )?);
    let transition_event = OutIdx(publishers.len() - 1);
    let contacts = estimates.pop().unwrap_or(OutIdx(0));
    Ok((publishers, Outputs { wrenches: estimates, contacts, diagnostics }, transition_event, parameter_events))
}
