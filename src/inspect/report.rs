//! Report on a bag.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::candidates::{Candidates, candidates};
use super::gather::{Gather, Key, key_of};
use super::stamps::StampStats;
use super::topic::Topic;
use super::view::View;
use crate::bag::{BagError, BagReader, BagStats, TopicStats, printable, shown};
use crate::location;
use crate::model::ModelError;
use crate::observer::{Cancelled, Observer, check};
use crate::units::NANOS_PER_SEC;

/// Why a bag or a model can't be inspected.
#[derive(Debug, thiserror::Error)]
pub enum InspectError {
    /// It can't be read.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// A model can't be read.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The folder with definitions of types can't be used.
    #[error("{path}: {error}; give the folder that holds PACKAGE/msg/TYPE.msg")]
    Definitions {
        /// The folder.
        path: String,
        /// Why not.
        error: std::io::Error,
    },
    /// It was to end.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Report on a bag.
#[derive(Debug, Serialize)]
pub struct BagReport {
    /// The path that it was read from.
    pub path: String,
    /// Names of the files of a bag folder; of a single file, its own.
    pub files: Vec<String>,
    /// Size of its files.
    pub size_bytes: u64,
    /// Messages that were read.
    pub n_messages: u64,
    /// Messages that the file says it holds, where it does.
    pub n_messages_stated: Option<u64>,
    /// Earliest log time, ns.
    pub first_ns: Option<i64>,
    /// Latest log time, ns.
    pub last_ns: Option<i64>,
    /// Time between the two, s.
    pub duration_s: Option<f64>,
    /// In order of name.
    pub topics: Vec<TopicReport>,
    /// Topics that are not told of because there are too many; their messages are counted.
    #[serde(skip_serializing_if = "is_zero")]
    pub n_more_topics: usize,
    /// Topics of it that can feed the fusion.
    #[serde(flatten)]
    pub candidates: Candidates,
    /// Losses: parts that could not be read.
    pub losses: Vec<String>,
}

/// Report on a topic.
#[derive(Debug, Serialize)]
pub struct TopicReport {
    /// By log time.
    #[serde(flatten)]
    pub stats: TopicStats,
    /// By the stamps in the messages, where there are any.
    pub stamps: Option<StampStats>,
    /// Why the messages could not be looked into, or what was left out of the look.
    pub notes: Vec<String>,
    /// Why the messages could not be looked into.
    #[serde(skip)]
    pub unread: Option<String>,
}

fn is_zero(n: &usize) -> bool {
    *n == 0
}

impl BagReport {
    /// Reads the bag at `path` from its first message to its last; types that it doesn't define are looked for in the folder
    /// `definitions`, then along `AMENT_PREFIX_PATH`.
    ///
    /// # Errors
    /// [`InspectError`] when the bag can't be read, or the observer cancels.
    pub fn read(path: &Path, definitions: Option<&Path>, observer: &dyn Observer) -> Result<Self, InspectError> {
        let mut reader = BagReader::open_as_written(&[path.to_path_buf()])?;
        if let Some(folder) = definitions {
            let refuse = |error| InspectError::Definitions { path: shown(folder), error };
            location::only_folder_here(folder).map_err(refuse)?;
            reader.look_for_definitions_in(folder)?;
        }
        reader.notes().iter().for_each(|note| observer.note(&printable(note)));
        let mut gather = Gather::new(reader.definitions().clone());
        loop {
            check(observer)?;
            observer.progress(reader.bytes_read(), reader.bytes_total());
            let Some(message) = reader.next_message()? else { break };
            gather.handle(&message);
        }
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
            unread: topic.look.as_ref().err().cloned(),
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
        Ok(within) if location::is_folder(path) => within.display().to_string(),
        _ => file.file_name().map_or_else(|| shown(file), |name| name.to_string_lossy().into_owned()),
    };
    reader.files().map(name).collect()
}
