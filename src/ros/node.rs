//! The node from start to end: joins the graph, starts its threads, waits for the end, leaves.

pub mod diagnostics;
pub mod health;
pub mod lifecycle;
pub mod watchdog;

mod calibrate_action;
mod calibrating;
mod calibration_file;
mod calibrator;
mod engine;
pub(in crate::ros) mod interfaces;
mod known_touches;
pub(in crate::ros) mod loading;
mod managed;
mod order;
mod outbox;
pub(in crate::ros) mod parameters;
mod services;
mod serving;
mod shared;
mod visuals;
mod watched;
mod worn;

pub use calibrator::{Calibrator, IN_AIR, Purpose, Sample, TOUCH};
pub use engine::Record;
pub use interfaces::{DIAGNOSTICS_TYPE, Health, read_diagnostics};
pub use watched::Watched;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::time::Duration;

use ros2_client::QosProfile;
use ros2_client::qos::Durability;
use tokio::sync::mpsc;

use super::wire::args::{RosArgs, Severity};
use super::wire::clock::{Clock, ClockMessage};
use super::wire::entities::{Graph, InputName, Names};
use super::wire::environment::Environment;
use super::wire::error::NodeError;
use super::wire::graph::Wanted;
use super::wire::middleware::{Publisher, TopicType};
use super::wire::qos::{self, Side, reliable_qos};
use super::wire::threads::{self, runtime};
use crate::config::{Config, ParamTree, Publishing};
use crate::fusion::{JointSourceIdx, TactileSourceIdx};
use crate::leave;
use crate::msg::binding::{BindingError, FrameStore, FramesBinding, JointBinding, SampleBinding, TaxelBinding};
use crate::msg::definition::{Definitions, TypeTree};
use crate::msg::{ContactArray, Image, MarkerArray, TFMessage, WireType, WrenchStamped, to_cdr, type_hash};
use engine::{Command, Engine, InputTopic, Outputs};
use interfaces::{DiagnosticArray, Log, TransitionEvent};
use outbox::{LogConfig, OutIdx, Pictures, Rosout};
use parameters::{ParameterEvent, Parameters};
use serving::{Duties, News};
use shared::Managed;
use visuals::{Drawing, Selection, patch_frames};

/// How often the node checks if it should end.
const LOOK: Duration = Duration::from_millis(20);

// Time limit for each part to end, so that the node leaves the graph within two seconds even if one of them hangs.
const SERVING_LIMIT: Duration = Duration::from_millis(200);
const ENGINE_LIMIT: Duration = Duration::from_millis(400);
const PUBLISHING_LIMIT: Duration = Duration::from_millis(300);

/// Inputs for building a node.
#[derive(Debug)]
pub struct Setup {
    /// The configuration from the parameters.
    pub cfg: Config,
    /// The parameters themselves.
    pub tree: ParamTree,
    /// The arguments after `--ros-args`.
    pub args: RosArgs,
    /// The settings from the environment.
    pub environment: Environment,
    /// Calibration file that replaces the one from the parameters.
    pub calibration: Option<PathBuf>,
    /// File for recording handled inputs and outputs.
    pub recorder: Option<SyncSender<Record>>,
}

/// Runs a node until SIGINT or SIGTERM, and leaves the graph.
///
/// # Errors
/// [`NodeError`] when it can't start: a topic, type, model or calibration doesn't match the parameters. Also when one
/// of its threads or the middleware's has ended.
pub fn run(setup: Setup) -> Result<(), NodeError> {
    leave::listen();
    let Setup { mut cfg, tree, args, environment, calibration, recorder } = setup;
    cfg.set_kept_taxels(cfg.live.visuals.publishing != Publishing::Never);
    let names = Names::new(&cfg, &args.remaps)?;
    let definitions = Definitions::new(cfg.live.message_definitions.as_deref(), &environment.prefixes);
    let bindings = input_bindings(&cfg, &names, &definitions)?;
    let clock = Arc::new(Clock::new(cfg.use_sim_time));

    let mut graph = Graph::join(&cfg.node, &environment, &args.remaps)?;
    let inputs = inputs(&mut graph, &cfg, &tree, &names, bindings)?;
    let truth = known_touches::subscribe(&mut graph, &cfg, &tree, &names, &definitions)?;
    let (mut publishers, outputs, transition_event, parameter_events) = publishers(&mut graph, &tree, &names)?;
    let (pictures, no_pictures) = pictures(&mut graph, &cfg, &tree, &names)?;
    let frames = match &names.visuals.frames {
        Some(topic) => {
            let qos = qos::with_overrides(qos::static_frames(), &tree, topic, Side::Publisher)?;
            publishers.push(graph.publisher(topic, TopicType::Known(TFMessage::TYPE_NAME), &qos)?);
            Some(OutIdx(publishers.len() - 1))
        }
        None => None,
    };
    let subscribed = names.inputs.iter().map(|input| &input.topic).chain(names.truth.iter().take(truth.len()));
    let entities = subscribed.map(|topic| (topic.clone(), Side::Subscription));
    let published = names.estimates.names().chain(names.visuals.names());
    let entities = entities.chain(published.map(|name| (name.to_owned(), Side::Publisher)));
    let of_others = qos::check_all_used(&tree, &entities.collect::<Vec<_>>())?;
    let sim_clock = match cfg.use_sim_time {
        true => {
            let ty = TopicType::Known(ClockMessage::TYPE_NAME);
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
    let (max_wait, settle) = (cfg.fusion().timing().max_age, graph.settle());
    let selection = pictures.as_ref().map(|_| Selection::new(&cfg));
    let (outbox, publishing) = outbox::start(publishers, pictures, rosout, log, Arc::clone(&clock), max_wait, settle)?;
    let notes = environment.notes.iter().cloned().chain(graph.note()).chain(no_pictures);
    notes.for_each(|note| outbox.log(Severity::Warn, note));
    if let Some(to) = frames {
        outbox.send(to, to_cdr(&patch_frames(&cfg, clock.now())), None);
    }
    if !of_others.is_empty() {
        let keys = of_others.join(", ");
        outbox.log(Severity::Warn, format!("not followed, because this node has no such topics: {keys}"));
    }
    let (commands, engine_commands) = mpsc::unbounded_channel();
    let engine = Engine {
        cfg: cfg.clone(),
        clock: Arc::clone(&clock),
        outbox: outbox.clone(),
        outputs,
        recorder,
        neighbours: graph.neighbours(),
        selection,
    };
    let runtime = runtime()?;
    let reading = threads::spawn("engine", move || runtime.block_on(engine.run(inputs, engine_commands)))?;

    let first_file = calibration.as_deref().or(cfg.calibration.file.as_deref());
    let duties = Duties {
        calibration_folder: first_file.map(calibration_file::folder),
        managed: Managed::new(transition_event, calibration),
        parameters: Parameters::new(tree, cfg.clone()),
        commands: commands.clone(),
        outbox: outbox.clone(),
        clock,
        parameter_events,
        node_name: cfg.node.to_string(),
        sim_clock,
        truth,
    };
    let (serving, news) = serving::start(graph, duties)?;
    let (graph, outcome) = watch(&news);
    outbox.log(Severity::Info, "leaving");
    // An inference takes well under a millisecond, but a part that hangs must not keep the node in the graph.
    let graph = graph.or_else(|| serving.last_news(&news));
    serving.end(SERVING_LIMIT);
    let _ = commands.send(Command::Stop);
    threads::ends_within(&reading, ENGINE_LIMIT);
    publishing.end(PUBLISHING_LIMIT);
    drop(graph);
    match leave::failure() {
        Some(why) => Err(NodeError::Ended(why.to_owned())),
        None => outcome,
    }
}

/// Waits until the process should end or the node can't be started; returns its graph, if it exists by then.
fn watch(news: &Receiver<News>) -> (Option<Graph>, Result<(), NodeError>) {
    let mut graph = None;
    while !leave::asked() {
        match news.recv_timeout(LOOK) {
            Ok(News::Serving(serving)) => graph = Some(serving),
            Ok(News::Failed(error)) => return (graph, Err(error)),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => std::thread::sleep(LOOK), // a panic, which has asked by now
        }
    }
    (graph, Ok(()))
}

/// The type of each input, and the binding that turns its messages into samples: one per source, tactile sources first.
///
/// # Errors
/// [`NodeError`] when a type is unknown, or lacks something that the parameters ask for.
pub fn input_bindings(
    cfg: &Config,
    names: &Names,
    definitions: &Definitions,
) -> Result<Vec<(TypeTree, Vec<SampleBinding>)>, NodeError> {
    let frames: Vec<FrameStore> = cfg.joints().iter().map(|_| FrameStore::default()).collect();
    let of_input = |input: &InputName| {
        let tree = definitions.tree(&input.type_name)?;
        let mut bindings = Vec::new();
        for &source in &input.tactile {
            let binding = TaxelBinding::compile(&cfg.tactile()[source].fields, &tree);
            let binding = Box::new(binding.map_err(|error| refused(&input.topic, error))?);
            bindings.push(SampleBinding::Taxels(TactileSourceIdx::at(source), binding));
        }
        for &source in &input.joints {
            let binding = JointBinding::compile_with(&cfg.joints()[source].fields, &tree, &frames[source]);
            let binding = Box::new(binding.map_err(|error| refused(&input.topic, error))?);
            bindings.push(SampleBinding::Joints(JointSourceIdx::at(source), binding));
        }
        for &source in &input.frames {
            let binding = FramesBinding::compile(&cfg.joints()[source].fields, &tree, &frames[source]);
            let binding = binding.map_err(|error| refused(&input.topic, error))?;
            bindings.push(SampleBinding::Frames(JointSourceIdx::at(source), binding));
        }
        Ok((tree, bindings))
    };
    names.inputs.iter().map(of_input).collect()
}

fn refused(topic: &str, error: BindingError) -> NodeError {
    NodeError::Binding { topic: topic.to_owned(), error: Box::new(error) }
}

fn inputs(
    graph: &mut Graph,
    cfg: &Config,
    tree: &ParamTree,
    names: &Names,
    bindings: Vec<(TypeTree, Vec<SampleBinding>)>,
) -> Result<Vec<InputTopic>, NodeError> {
    let mut inputs = Vec::new();
    let of_inputs = names.inputs.iter().zip(wanted(cfg, tree, names, &bindings)?).zip(bindings);
    for ((input, wanted), (ty, bindings)) in of_inputs {
        let qos = input_qos(tree, input)?;
        let subscription = graph.subscription(&input.topic, TopicType::Defined(&ty), &qos)?;
        inputs.push(InputTopic { wanted, subscription, bindings });
    }
    Ok(inputs)
}

/// The QoS of an input. Frames that don't change are published once, long before.
fn input_qos(tree: &ParamTree, input: &InputName) -> Result<QosProfile, NodeError> {
    let default = match input.frames.is_empty() {
        true => qos::input_default(),
        false => qos::frames(),
    };
    Ok(qos::with_overrides(default, tree, &input.topic, Side::Subscription)?)
}

/// The requirements of the sources for each input; none of what need not come. `[inputs][sources]`
///
/// # Errors
/// [`NodeError`] for an override of QoS that this node doesn't support.
pub fn wanted(
    cfg: &Config,
    tree: &ParamTree,
    names: &Names,
    bindings: &[(TypeTree, Vec<SampleBinding>)],
) -> Result<Vec<Vec<Wanted>>, NodeError> {
    let of_input = |(input, (ty, bindings)): (&InputName, &(TypeTree, Vec<SampleBinding>))| {
        let qos = input_qos(tree, input)?;
        let of_source = |binding: &SampleBinding| {
            let key = match binding {
                SampleBinding::Taxels(source, _) => {
                    format!("tactile.{}", cfg.fusion().tactile_sources()[source.position()].name)
                }
                SampleBinding::Joints(source, _) => {
                    format!("joint.{}", cfg.fusion().joint_sources()[source.position()].name)
                }
                SampleBinding::Frames(..) => return None,
            };
            let (topic, type_name) = (input.topic.clone(), ty.type_name().to_owned());
            Some(Wanted { key, topic, type_name, type_hash: type_hash(ty), qos: qos.clone() })
        };
        Ok(bindings.iter().filter_map(of_source).collect())
    };
    names.inputs.iter().zip(bindings).map(of_input).collect()
}

/// Publishers of pictures, if they may be published; or a note why they can't be.
///
/// # Errors
/// [`NodeError`] if the parameters ask for pictures that can't be published, and for an override of QoS that this node
/// doesn't support.
fn pictures(
    graph: &mut Graph,
    cfg: &Config,
    tree: &ParamTree,
    names: &Names,
) -> Result<(Option<Pictures>, Option<String>), NodeError> {
    let mut publishers = Vec::new();
    for (idx, topic) in names.visuals.pictures.iter().enumerate() {
        let qos = qos::with_overrides(qos::pictures(), tree, topic, Side::Publisher)?;
        let type_name = if idx == 0 { MarkerArray::TYPE_NAME } else { Image::TYPE_NAME };
        match graph.publisher(topic, TopicType::Known(type_name), &qos) {
            Ok(publisher) => publishers.push(publisher),
            // Permissions of a secured graph that are older than pictures.
            Err(error) if cfg.live.visuals.publishing == Publishing::Auto => {
                let note = format!("no markers and images: {error}; allow them, or set visualization.publish: never");
                return Ok((None, Some(note)));
            }
            Err(error) => return Err(error),
        }
    }
    let always = cfg.live.visuals.publishing == Publishing::Always;
    Ok(((!publishers.is_empty()).then(|| Pictures { publishers, drawing: Drawing::new(cfg), always }), None))
}

type Publishers = (Vec<Publisher>, Outputs, OutIdx, OutIdx);

fn publishers(graph: &mut Graph, tree: &ParamTree, names: &Names) -> Result<Publishers, NodeError> {
    let mut publishers = Vec::new();
    let (mut estimates, mut offers) = (Vec::new(), Vec::new());
    let last = names.estimates.wrenches.len();
    for (idx, topic) in names.estimates.names().enumerate() {
        let qos = qos::with_overrides(qos::output_default(), tree, topic, Side::Publisher)?;
        let type_name = if idx < last { WrenchStamped::TYPE_NAME } else { ContactArray::TYPE_NAME };
        estimates.push(OutIdx(publishers.len()));
        publishers.push(graph.publisher(topic, TopicType::Known(type_name), &qos)?);
        offers.push((topic.to_owned(), qos));
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
    Ok((publishers, Outputs { wrenches: estimates, contacts, diagnostics, offers }, transition_event, parameter_events))
}
