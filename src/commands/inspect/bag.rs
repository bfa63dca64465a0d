//! A bag in one pass, in memory that grows with the number of topics alone.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::candidates::{Candidates, View, candidates};
use super::force::Skin;
use super::format::printable;
use super::stamps::StampStats;
use super::topic::Topic;
use super::{Failure, say, shown};
use crate::bag::{BagChannel, BagMessage, BagReader, BagStats, TopicStats};
use crate::commands::progress::Progress;
use crate::msg::canonical_type_name;
use crate::msg::definition::Definitions;
use crate::units::NANOS_PER_SEC;

/// What is told of a bag.
#[derive(Debug, Serialize)]
pub(super) struct BagReport {
    pub(super) path: String,
    /// Names of the files of a bag folder; of a single file, its own.
    pub(super) files: Vec<String>,
    pub(super) size_bytes: u64,
    /// Messages that were read.
    pub(super) n_messages: u64,
    /// Messages that the file says it holds, where it does.
    pub(super) n_messages_stated: Option<u64>,
    /// Log times, ns.
    pub(super) first_ns: Option<i64>,
    pub(super) last_ns: Option<i64>,
    pub(super) duration_s: Option<f64>,
    /// In order of name.
    pub(super) topics: Vec<TopicReport>,
    /// Topics that are not told of because there are too many; their messages are counted.
    #[serde(skip_serializing_if = "is_zero")]
    pub(super) n_more_topics: usize,
    #[serde(flatten)]
    pub(super) candidates: Candidates,
    /// What could not be read.
    pub(super) losses: Vec<String>,
}

/// What is told of a topic.
#[derive(Debug, Serialize)]
pub(super) struct TopicReport {
    /// By log time.
    #[serde(flatten)]
    pub(super) stats: TopicStats,
    /// By the stamps in the messages, where there are any.
    pub(super) stamps: Option<StampStats>,
    /// Why the messages could not be looked into, or what was left out of the look.
    pub(super) notes: Vec<String>,
}

type Key = (String, String, String);

fn key_of(topic: &str, type_name: &str, encoding: &str) -> Key {
    let type_name = if type_name.is_empty() { String::new() } else { canonical_type_name(type_name) };
    (topic.to_owned(), type_name, encoding.to_owned())
}

/// Topics that are told of. A robot has some hundred; a hostile bag may have millions.
const MAX_TOPICS: usize = 4096;

/// What all topics together may have: bytes of definitions that are read, and fields with numbers that are looked at.
const MAX_DEFINITION_BYTES: usize = 64 << 20;
const MAX_FIELDS: usize = 300_000;

fn is_zero(n: &usize) -> bool {
    *n == 0
}

/// What runs while messages come.
#[derive(Default)]
struct Gather {
    stats: BagStats,
    /// Where types that the bag doesn't define are looked for.
    definitions: Definitions,
    /// The same of the stamps, as if they were log times.
    stamps: BagStats,
    topics: Vec<Topic>,
    by_key: BTreeMap<Key, usize>,
    /// Place in `topics` of each channel, by its id; `None` of those that are not told of.
    by_channel: BTreeMap<usize, Option<usize>>,
    n_more_topics: usize,
    /// Messages of those.
    n_more_messages: u64,
    definition_bytes: usize,
    n_fields: usize,
    /// The newest of arrays that are named as taxels are.
    skins: Vec<Skin>,
}

impl Gather {
    fn topic(&mut self, channel: &BagChannel) -> Option<usize> {
        if let Some(&idx) = self.by_channel.get(&channel.id) {
            return idx;
        }
        let key = key_of(&channel.topic, channel.type_name(), &channel.message_encoding);
        let known = self.by_key.get(&key).copied();
        let idx = known.or_else(|| {
            if self.topics.len() == MAX_TOPICS {
                self.n_more_topics += 1; // as often as it is defined anew
                return None;
            }
            let topic = self.look_into(channel);
            self.topics.push(topic);
            self.by_key.insert(key, self.topics.len() - 1);
            Some(self.topics.len() - 1)
        });
        self.by_channel.insert(channel.id, idx);
        idx
    }

    /// The topic of a channel, looked into as long as the topics before it have left anything to spend on that.
    fn look_into(&mut self, channel: &BagChannel) -> Topic {
        let len = channel.schema.as_ref().map_or(0, |schema| schema.data.len());
        self.definition_bytes = self.definition_bytes.saturating_add(len);
        if self.definition_bytes > MAX_DEFINITION_BYTES || self.n_fields > MAX_FIELDS {
            return Topic::unseen(channel, "the definitions of the other topics are too long to look into this one");
        }
        let topic = Topic::new(channel, &self.definitions);
        self.n_fields += topic.look.as_ref().map_or(0, |look| look.numeric.len());
        topic
    }

    fn handle(&mut self, message: &BagMessage<'_>) {
        let Some(idx) = self.topic(message.channel) else {
            self.n_more_messages += 1;
            return;
        };
        self.stats.handle_message(message);
        if let Some(stamp) = self.topics[idx].handle(message) {
            self.stamps.handle_message(&BagMessage { log_time: stamp, ..*message });
        }
        self.topics[idx].follow(idx, message.data, &mut self.skins);
    }
}

impl BagReport {
    /// Reads the bag at `path` from its first message to its last; types that it doesn't define are looked for in a folder.
    pub(super) fn read(path: &Path, definitions: Option<&Path>) -> Result<Self, Failure> {
        let mut reader = BagReader::open_as_written(&[path.to_path_buf()])?;
        definitions.iter().for_each(|folder| reader.look_for_definitions_in(folder));
        reader.notes().iter().for_each(|note| say(&printable(note)));
        let mut gather = Gather { definitions: reader.definitions().clone(), ..Gather::default() };
        let mut progress = Progress::bytes("inspect", reader.bytes_total());
        loop {
            progress.set(reader.bytes_read());
            let Some(message) = reader.next_message()? else { break };
            gather.handle(&message);
        }
        drop(progress);
        for channel in reader.channels() {
            gather.topic(channel); // those without a message
        }
        let topics = topics(&gather);
        let first_ns = topics.iter().filter_map(|topic| topic.stats.first_ns).min();
        let last_ns = topics.iter().filter_map(|topic| topic.stats.last_ns).max();
        let span = first_ns.zip(last_ns).map(|(first, last)| last.saturating_sub(first));
        Ok(BagReport {
            path: shown(path),
            files: files(path, &reader),
            size_bytes: reader.bytes_total(),
            n_messages: topics.iter().map(|topic| topic.stats.n_messages).sum::<u64>() + gather.n_more_messages,
            n_messages_stated: reader.summary().n_messages,
            first_ns,
            last_ns,
            duration_s: span.map(|ns| ns as f64 / NANOS_PER_SEC as f64),
            candidates: candidates(&views(&gather, &topics), &gather.skins),
            topics,
            n_more_topics: gather.n_more_topics,
            losses: reader.losses().iter().map(ToString::to_string).collect(),
        })
    }
}

/// A report a topic, in order of name, those without a message among them.
fn topics(gather: &Gather) -> Vec<TopicReport> {
    let by_key = |stats: &BagStats| -> BTreeMap<Key, TopicStats> {
        let keyed = |stats: TopicStats| (key_of(&stats.topic, &stats.type_name, &stats.message_encoding), stats);
        stats.topics().into_iter().map(keyed).collect()
    };
    let (mut stats, stamps) = (by_key(&gather.stats), by_key(&gather.stamps));
    let report = |(key, &idx): (&Key, &usize)| {
        let topic = &gather.topics[idx];
        let look = topic.look.as_ref().ok();
        let field = look.and_then(|look| look.stamp_path());
        let mut of_topic = stats.remove(key).unwrap_or_else(|| without_messages(topic));
        of_topic.type_name.clone_from(&topic.type_name);
        TopicReport {
            stamps: look
                .zip(field)
                .filter(|_| of_topic.n_messages > 0)
                .map(|(look, field)| look.stamps.stats(field, stamps.get(key))),
            notes: notes(topic),
            stats: of_topic,
        }
    };
    gather.by_key.iter().map(report).collect()
}

fn without_messages(topic: &Topic) -> TopicStats {
    TopicStats {
        topic: topic.name.clone(),
        type_name: topic.type_name.clone(),
        message_encoding: topic.encoding.clone(),
        n_messages: 0,
        bytes: 0,
        first_ns: None,
        last_ns: None,
        rate_hz: None,
        interval_p50_ms: None,
        interval_p99_ms: None,
        interval_max_ms: None,
        jitter_ms: None,
        n_gaps: 0,
        n_out_of_order: 0,
        n_lost_by_sequence: None,
    }
}

fn notes(topic: &Topic) -> Vec<String> {
    let look = match &topic.look {
        Ok(look) => look,
        Err(reason) => return vec![format!("not looked into: {reason}")],
    };
    let mut notes = Vec::new();
    if let Some(first) = &look.first_error {
        notes.push(format!("{} messages could not be read, the first: {first}", look.n_unreadable));
    }
    if topic.type_name == "sensor_msgs/msg/PointCloud2" {
        notes.push("a field of its points is read by its name, such as field: \"data[].z\"".to_owned());
    }
    if look.n_too_long > 0 {
        notes.push(format!("{} messages over 1 MiB were not searched for arrays", look.n_too_long));
    }
    if look.n_more_arrays > 0 {
        notes.push(format!("{} further arrays of the type were not looked at", look.n_more_arrays));
    }
    notes
}

fn views<'a>(gather: &'a Gather, reports: &'a [TopicReport]) -> Vec<View<'a>> {
    let view = |(report, &idx): (&'a TopicReport, &usize)| {
        let topic = &gather.topics[idx];
        let look = topic.look.as_ref().ok()?;
        let stats = Some(&report.stats).filter(|stats| stats.n_messages > 0);
        Some(View { topic, look, stats, stamps: report.stamps.as_ref() })
    };
    reports.iter().zip(gather.by_key.values()).filter_map(view).collect()
}

/// Names of the files behind a path: within a folder, as they lie in it.
fn files(path: &Path, reader: &BagReader) -> Vec<String> {
    let name = |file: &Path| match file.strip_prefix(path) {
        Ok(within) if path.is_dir() => within.display().to_string(),
        _ => file.file_name().map_or_else(|| shown(file), |name| name.to_string_lossy().into_owned()),
    };
    reader.files().map(name).collect()
}
