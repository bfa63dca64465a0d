//! A bag in one pass, in memory that grows with the number of topics alone.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::candidates::{Candidates, View, candidates};
use super::stamps::StampStats;
use super::topic::Topic;
use super::{Failure, shown};
use crate::bag::{BagChannel, BagMessage, BagReader, BagStats, TopicStats};
use crate::commands::progress::Progress;
use crate::msg::canonical_type_name;
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

/// What runs while messages come.
#[derive(Default)]
struct Gather {
    stats: BagStats,
    /// The same of the stamps, as if they were log times.
    stamps: BagStats,
    topics: Vec<Topic>,
    by_key: BTreeMap<Key, usize>,
    /// Place in `topics` of each channel, by its id.
    by_channel: BTreeMap<usize, usize>,
}

impl Gather {
    fn topic(&mut self, channel: &BagChannel) -> usize {
        if let Some(&idx) = self.by_channel.get(&channel.id) {
            return idx;
        }
        let key = key_of(&channel.topic, channel.type_name(), &channel.message_encoding);
        let idx = *self.by_key.entry(key).or_insert_with(|| {
            self.topics.push(Topic::new(channel));
            self.topics.len() - 1
        });
        self.by_channel.insert(channel.id, idx);
        idx
    }

    fn handle(&mut self, message: &BagMessage<'_>) {
        self.stats.handle_message(message);
        let idx = self.topic(message.channel);
        if let Some(stamp) = self.topics[idx].handle(message) {
            self.stamps.handle_message(&BagMessage { log_time: stamp, ..*message });
        }
    }
}

impl BagReport {
    /// Reads the bag at `path` from its first message to its last.
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        let mut reader = BagReader::open(&[path.to_path_buf()])?;
        let mut gather = Gather::default();
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
            files: files(path),
            size_bytes: reader.bytes_total(),
            n_messages: topics.iter().map(|topic| topic.stats.n_messages).sum(),
            n_messages_stated: reader.summary().n_messages,
            first_ns,
            last_ns,
            duration_s: span.map(|ns| ns as f64 / NANOS_PER_SEC as f64),
            candidates: candidates(&views(&gather, &topics)),
            topics,
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

/// Names of the files behind a path that the reader has opened: those that `metadata.yaml` lists, else all there are.
fn files(path: &Path) -> Vec<String> {
    #[derive(Deserialize)]
    struct Document {
        rosbag2_bagfile_information: Listing,
    }
    #[derive(Deserialize)]
    struct Listing {
        relative_file_paths: Vec<String>,
    }
    let name = |path: PathBuf| path.file_name().map(|name| name.to_string_lossy().into_owned());
    if !path.is_dir() {
        return name(path.to_path_buf()).into_iter().collect();
    }
    let listing = std::fs::read_to_string(path.join("metadata.yaml")).unwrap_or_default();
    if let Ok(document) = serde_saphyr::from_str::<Document>(&listing) {
        return document.rosbag2_bagfile_information.relative_file_paths;
    }
    let entries = std::fs::read_dir(path).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut names: Vec<String> =
        entries.filter(|path| path.extension().is_some_and(|extension| extension == "mcap")).filter_map(name).collect();
    names.sort();
    names
}
