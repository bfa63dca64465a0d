//! Topics of a live graph, recorded as a bag: the rest of `tpf init` reads it as any other.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use tactile_pose_fusion::bag::{BEST_EFFORT_QOS, BagWriter, NewChannel, OutChannel, WriteOptions, printable};
use tactile_pose_fusion::msg::definition::Definitions;
use tactile_pose_fusion::msg::{TFMessage, WireType, type_hash};
use tactile_pose_fusion::ros::{Delivery, Endpoint, Listening, SubscribedTopic, TopicType};

use crate::commands::live::RosArguments;
use crate::commands::{Failure, interrupt, say};
use crate::report::progress::Progress;

/// The node that looks, unless it is given another name.
const NODE: &str = "/tpf_init";

/// How long the graph is looked at for who is there: at least, at most, and after the last change.
const LOOK: [Duration; 3] = [Duration::from_secs(2), Duration::from_secs(6), Duration::from_millis(1500)];

/// Between two looks.
const NAP: Duration = Duration::from_millis(100);

/// Topics that are listened to.
const MOST_TOPICS: usize = 256;

/// Types of topics that no glove sends on: they say how nodes are, or are too large to look at.
const UNUSED: [&str; 12] = [
    "diagnostic_msgs/msg/DiagnosticArray",
    "foxglove_msgs/msg/CompressedVideo",
    "lifecycle_msgs/msg/TransitionEvent",
    "nav_msgs/msg/OccupancyGrid",
    "rcl_interfaces/msg/Log",
    "rcl_interfaces/msg/ParameterEvent",
    "rosgraph_msgs/msg/Clock",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/PointCloud2",
    "std_msgs/msg/String",
    "visualization_msgs/msg/MarkerArray",
];

/// What only a live graph needs.
#[derive(Debug, clap::Args)]
pub(super) struct LiveArgs {
    /// Look at the topics of a live graph, instead of bags: move the hand, bend the fingers and press something meanwhile
    #[arg(long, conflicts_with = "bags")]
    pub(super) live: bool,
    /// With --live: for so long
    #[arg(long, value_name = "S", requires = "live", default_value_t = 10.0, value_parser = crate::commands::zero::seconds)]
    pub(super) seconds: f64,
    #[command(flatten)]
    ros: RosArguments,
}

/// A topic that is recorded.
struct Seen {
    endpoint: Endpoint,
    channel: OutChannel,
    n_messages: u64,
}

/// A recording of the graph, in a folder of its own.
pub(super) struct Recorded {
    folder: tempfile::TempDir,
    /// Lines for the parameter file: what came, how often, and with which QoS.
    pub(super) told: Vec<String>,
}

impl Recorded {
    /// The bag.
    pub(super) fn bag(&self) -> PathBuf {
        self.folder.path().join("live.mcap")
    }
}

/// Records what is published for so long.
pub(super) fn record(args: &LiveArgs, folder: Option<&Path>) -> Result<Recorded, Failure> {
    let place = args.ros.place(NODE)?;
    let definitions = Definitions::new(folder, &place.environment.prefixes);
    let mut listening = place.join()?;
    let found = look(&listening)?;
    let recorded = Recorded { folder: tempfile::tempdir()?, told: Vec::new() };
    let mut bag = BagWriter::create(&recorded.bag(), WriteOptions::default())?;
    let mut seen = Vec::new();
    for endpoint in wanted(found) {
        match subscribe(&mut listening, &mut bag, &definitions, &endpoint) {
            Ok(channel) => seen.push(Seen { endpoint, channel, n_messages: 0 }),
            Err(Failure(why)) => say(&format!("not looked at: {}: {}", endpoint.topic, printable(&why))),
        }
    }
    if seen.is_empty() {
        return Err(Failure(
            "no topic in this graph can be looked at; start the drivers of glove and hand, correct ROS_DOMAIN_ID, or record a bag"
                .to_owned(),
        ));
    }
    let n_topics = seen.len();
    say(&format!(
        "looking at {n_topics} topics for {} s: bend all fingers, and press something with each",
        args.seconds
    ));
    let listener = listening.start()?;
    let (begun, limit) = (Instant::now(), Duration::from_secs_f64(args.seconds));
    let mut progress = Progress::time("look", limit);
    while begun.elapsed() < limit {
        if interrupt::happened() {
            listener.leave();
            return Err(Failure("interrupted; nothing was written".to_owned()));
        }
        let mut next = listener.next(NAP);
        while let Some(incoming) = next {
            let SubscribedTopic(idx) = incoming.topic;
            if let Ok(cdr) = &incoming.cdr {
                seen[idx].n_messages += 1;
                bag.write(seen[idx].channel, 0, incoming.received, incoming.received, cdr)?;
            }
            next = listener.poll();
        }
        progress.set(begun.elapsed().as_millis() as u64);
    }
    drop(progress);
    let missed = listener.missed();
    listener.leave();
    if missed > 0 {
        say(&format!("{missed} messages came too fast to be looked at; rates are lower than those sent"));
    }
    bag.finish()?;
    if seen.iter().all(|seen| seen.n_messages == 0) {
        let topics: Vec<&str> = seen.iter().take(5).map(|seen| seen.endpoint.topic.as_str()).collect();
        return Err(Failure(format!(
            "nothing came in {} s on {n_topics} topics, {}; look at the drivers",
            args.seconds,
            topics.join(", ")
        )));
    }
    let told = seen.iter().map(|seen| seen.told(args.seconds)).collect();
    Ok(Recorded { told, ..recorded })
}

/// The publishers of a graph, when no more are found.
fn look(listening: &Listening) -> Result<Vec<Endpoint>, Failure> {
    let [at_least, at_most, quiet] = LOOK;
    let (begun, mut changed) = (Instant::now(), Instant::now());
    let mut n_known = 0;
    loop {
        let Some(found) = listening.publishers() else {
            return Err(Failure(
                "this middleware doesn't tell which topics there are; record a bag (ros2 bag record -a -s mcap) and give it instead of --live"
                    .to_owned(),
            ));
        };
        if found.len() != n_known {
            (n_known, changed) = (found.len(), Instant::now());
        }
        let looked = begun.elapsed();
        if looked >= at_most || looked >= at_least && n_known > 0 && changed.elapsed() >= quiet {
            return Ok(found);
        }
        if interrupt::happened() {
            return Err(Failure("interrupted; nothing was written".to_owned()));
        }
        std::thread::sleep(NAP);
    }
}

/// The topics to listen to: each once, in the order of their names, without those that no glove sends on.
fn wanted(found: Vec<Endpoint>) -> Vec<Endpoint> {
    let mut by_topic: BTreeMap<String, Endpoint> = BTreeMap::new();
    for endpoint in found {
        if UNUSED.contains(&endpoint.type_name.as_str()) || endpoint.topic.contains("/_action/") {
            continue;
        }
        match by_topic.get(&endpoint.topic) {
            Some(known) if known.type_name != endpoint.type_name => say(&printable(&format!(
                "{} is published as {} and as {}; looking at the first",
                endpoint.topic, known.type_name, endpoint.type_name
            ))),
            Some(_) if endpoint.type_name != TFMessage::TYPE_NAME => say(&printable(&format!(
                "{} has several publishers; if they are drivers of one device, stop all but one and try again",
                endpoint.topic
            ))),
            Some(_) => {}
            None => drop(by_topic.insert(endpoint.topic.clone(), endpoint)),
        }
    }
    if by_topic.len() > MOST_TOPICS {
        say(&format!("looking at {MOST_TOPICS} of {} topics, the first by name", by_topic.len()));
    }
    by_topic.into_values().take(MOST_TOPICS).collect()
}

/// Subscribes to a topic, and makes its channel in the bag.
fn subscribe(
    listening: &mut Listening,
    bag: &mut BagWriter,
    definitions: &Definitions,
    endpoint: &Endpoint,
) -> Result<OutChannel, Failure> {
    let Endpoint { topic, type_name, type_hash: sent, .. } = endpoint;
    let tree = definitions.tree(type_name)?;
    let (schema_text, hash) = (definitions.schema_text(type_name)?, type_hash(&tree));
    if sent.as_ref().is_some_and(|sent| *sent != hash) {
        say(&printable(&format!(
            "{topic} is published with another definition of {type_name} than is known here: give the publisher's .msg files by --message-definitions or AMENT_PREFIX_PATH"
        )));
    }
    let channel = bag.add_live_input(NewChannel {
        topic,
        type_name,
        schema_text: &schema_text,
        qos_yaml: BEST_EFFORT_QOS,
        type_hash: &hash,
    })?;
    listening.subscribe(topic, TopicType::Defined(&tree), Delivery::Data)?;
    Ok(channel)
}

impl Seen {
    /// One line for the parameter file.
    fn told(&self, seconds: f64) -> String {
        let Endpoint { topic, type_name, .. } = &self.endpoint;
        let rate = self.n_messages as f64 / seconds;
        printable(&format!("{topic}: {type_name}, {rate:.1} Hz, offered {}", self.endpoint.matching_in_words()))
    }
}
