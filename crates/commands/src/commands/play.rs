//! `tpf play`: a bag's messages on their topics, at their times.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use tactile_pose_fusion::bag::{BagChannel, BagReader};
use tactile_pose_fusion::config::NodeName;
use tactile_pose_fusion::msg::definition::TypeTree;
use tactile_pose_fusion::ros::args::RosArgs;
use tactile_pose_fusion::ros::environment::Environment;
use tactile_pose_fusion::ros::{NotPlayed, PlayedTopic, Player, TopicType, remap};
use tactile_pose_fusion::units::Stamp;

use super::{Failure, Outcome, counted, interrupt, print, say};

/// The node that plays, unless it is given another name.
const NODE: &str = "/tpf_play";

/// Longest time without looking for an interrupt.
const NAP: Duration = Duration::from_millis(50);

/// Later than any busy machine is.
const LATE: Duration = Duration::from_millis(300);

/// Publishes a bag's topics at the times at which they were recorded.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// MCAP or .db3 files or bag folders; several are parts of one recording
    #[arg(required = true, value_name = "BAG")]
    bags: Vec<PathBuf>,
    /// How many times faster than it was recorded
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = rate)]
    rate: f64,
    /// Begin again at the end, until interrupted
    #[arg(long = "loop")]
    again: bool,
    /// Publish the time of the recording on /clock, so many times a second of the wall
    #[arg(long, value_name = "HZ", num_args = 0..=1, default_missing_value = "100", value_parser = rate)]
    clock: Option<f64>,
    /// Play these topics only
    #[arg(long, value_name = "TOPIC", num_args = 1..)]
    topics: Vec<String>,
    /// Time for subscribers to find the topics before the first message, s
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0, value_parser = delay)]
    delay: f64,
    /// --ros-args and what ROS 2 has after it: -r, --enclave
    #[arg(value_name = "--ros-args ...", last = true)]
    ros: Vec<String>,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let ros_args = RosArgs::parse(&args.ros)?;
    let environment = Environment::from_vars(|name| std::env::var(name).ok(), &ros_args.enclave)?;
    environment.notes.iter().for_each(|note| say(note));
    let node = remap::node_name(&ros_args.remaps, &NodeName::parse(NODE)?)?;
    let mut reader = super::sessions::open(&args.bags)?;
    let wanted: Vec<&str> = args.topics.iter().map(String::as_str).collect();
    reader.scan(&wanted)?;
    for topic in &wanted {
        reader.required(topic)?;
    }
    interrupt::listen_live()?;
    let mut play = Play {
        player: Player::join(&node, &environment, &ros_args.remaps, args.clock.is_some())?,
        topics: BTreeMap::new(),
        by_name: BTreeMap::new(),
        played: 0,
        not_played: BTreeMap::new(),
    };
    play.player.note().iter().for_each(|note| say(note));
    for channel in reader.channels() {
        play.add(channel, args)?;
    }
    sleep_until(Instant::now() + Duration::from_secs_f64(args.delay));
    loop {
        play.once(&mut reader, args)?;
        if !args.again || interrupt::happened() {
            break;
        }
        reader = BagReader::open(&args.bags)?;
    }
    let Play { player, by_name, played, not_played, .. } = play;
    player.leave();
    for loss in reader.losses() {
        say(&loss.to_string());
    }
    for ((topic, reason), n) in &not_played {
        let why = match reason {
            NotPlayed::Encoding => "not plain little-endian CDR",
            NotPlayed::Refused => "a reliable subscriber has not taken those before",
        };
        say(&format!("topic {topic}: {n} messages not played: {why}"));
    }
    print(&format!("{} on {}\n", counted(played, "message"), counted(by_name.len() as u64, "topic")))?;
    Ok(if not_played.is_empty() && reader.losses().is_empty() { Outcome::Done } else { Outcome::InputLost })
}

struct Play {
    player: Player,
    /// By the id of the bag's channel; none for one that is not played.
    topics: BTreeMap<usize, Option<PlayedTopic>>,
    by_name: BTreeMap<(String, String), PlayedTopic>,
    played: u64,
    not_played: BTreeMap<(String, NotPlayed), u64>,
}

impl Play {
    fn add(&mut self, channel: &BagChannel, args: &Args) -> Result<Option<PlayedTopic>, Failure> {
        if let Some(known) = self.topics.get(&channel.id) {
            return Ok(*known);
        }
        let asked_for = args.topics.is_empty() || args.topics.contains(&channel.topic);
        let type_name = tactile_pose_fusion::msg::canonical_type_name(channel.type_name());
        let is_message = channel.message_encoding == "cdr" && type_name.contains("/msg/");
        if asked_for && !is_message {
            let (encoding, topic) = (&channel.message_encoding, &channel.topic);
            say(&format!("topic {topic}: {type_name:?} in {encoding:?} is no ROS 2 message; left out"));
        }
        let played = match asked_for && is_message {
            false => None,
            true => {
                let name = (channel.topic.clone(), type_name);
                Some(match self.by_name.get(&name) {
                    Some(known) => *known,
                    None => {
                        let tree = channel.schema.as_ref().and_then(|schema| {
                            let text = String::from_utf8_lossy(&schema.data);
                            TypeTree::from_encoded(&name.1, &schema.encoding, &text).ok()
                        });
                        let ty = tree.as_ref().map_or(TopicType::Known(&name.1), TopicType::Defined);
                        let added = self.player.add(&name.0, ty)?;
                        self.by_name.insert(name, added);
                        added
                    }
                })
            }
        };
        self.topics.insert(channel.id, played);
        Ok(played)
    }

    /// Plays a bag from its beginning to its end, or until there is an interrupt.
    fn once(&mut self, reader: &mut BagReader, args: &Args) -> Result<(), Failure> {
        let step = args.clock.map(|hz| Duration::from_secs_f64(1.0 / hz));
        let mut began: Option<(Instant, Stamp)> = None;
        let mut next_clock = Instant::now();
        while let Some(message) = reader.next_message()? {
            let (start, first) = began.get_or_insert_with(|| (Instant::now(), message.log_time));
            let since = Duration::from_secs_f64(message.log_time.nanos_since(*first).max(0) as f64 * 1e-9 / args.rate);
            // A process that was stopped goes on where it was, and doesn't make up for it.
            let late = Instant::now().saturating_duration_since(*start + since);
            if late > LATE {
                *start += late;
                next_clock += late;
            }
            let (start, first) = (*start, *first);
            let due = start + since;
            while let Some(step) = step
                && next_clock <= due
            {
                if !sleep_until(next_clock) {
                    return Ok(());
                }
                let passed = next_clock.saturating_duration_since(start).as_secs_f64() * args.rate;
                self.player.tell_time(first.offset((passed * 1e9) as i64));
                next_clock += step;
            }
            if !sleep_until(due) {
                return Ok(());
            }
            let Some(topic) = self.add(message.channel, args)? else { continue };
            match self.player.publish(topic, message.data) {
                Ok(()) => self.played += 1,
                Err(reason) => *self.not_played.entry((message.channel.topic.clone(), reason)).or_default() += 1,
            }
        }
        Ok(())
    }
}

/// Sleeps; false when there was an interrupt meanwhile.
fn sleep_until(due: Instant) -> bool {
    loop {
        if interrupt::happened() {
            return false;
        }
        let left = due.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return true;
        }
        std::thread::sleep(left.min(NAP));
    }
}

fn rate(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(rate) if (0.001..=10_000.0).contains(&rate) => Ok(rate),
        _ => Err(format!("expected 0.001 to 10000, got {text:?}")),
    }
}

fn delay(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(delay) if (0.0..=3600.0).contains(&delay) => Ok(delay),
        _ => Err(format!("expected 0 to 3600 s, got {text:?}")),
    }
}
