//! Summary at the end of a replay: inputs, outputs and losses.

use std::collections::BTreeMap;
use std::fmt::{self, Write};

use serde::Serialize;

use super::stages::BusySeconds;
use crate::bag::{TopicCounters, shown};
use crate::fusion::{Counters, Fusion};
use crate::model::{BackendInfo, ModelInfo};
use crate::zero::ZeroFrom;

/// A model that was used.
#[derive(Debug, Clone, Serialize)]
pub struct ModelSummary {
    name: String,
    file: String,
    sha256: String,
    backend: Option<BackendInfo>,
    /// Notes on the model, such as why another runtime runs it.
    notes: Vec<String>,
}

impl ModelSummary {
    pub(super) fn new(name: &str, info: &ModelInfo) -> Self {
        let (file, sha256) = (shown(&info.path), info.sha256.clone());
        ModelSummary { name: name.to_owned(), file, sha256, backend: info.backend.clone(), notes: info.notes.clone() }
    }
}

/// Result of a replay.
#[derive(Debug)]
pub struct Replayed {
    pub(super) inputs: Vec<String>,
    pub(super) output: String,
    pub(super) zero: ZeroFrom,
    pub(super) models: Vec<ModelSummary>,
    pub(super) data_s: f64,
    pub(super) wall_s: f64,
    pub(super) jobs: usize,
    pub(super) busy: BusySeconds,
    pub(super) topics: BTreeMap<String, TopicCounters>,
    pub(super) estimates_sha256: String,
    pub(super) losses: Vec<String>,
    pub(super) doubts: Vec<String>,
    pub(super) written: Vec<String>,
    pub(super) core: Fusion,
}

impl Replayed {
    /// The result in numbers.
    pub fn summary(&self) -> Summary<'_> {
        Summary {
            inputs: &self.inputs,
            output: &self.output,
            baseline: &self.zero,
            models: &self.models,
            data_s: self.data_s,
            wall_s: self.wall_s,
            jobs: self.jobs,
            busy_s: self.busy,
            topics: &self.topics,
            counters: self.core.counters(),
            estimates_sha256: &self.estimates_sha256,
            losses: &self.losses,
        }
    }

    /// Warnings for the user, one line each.
    pub fn warnings(&self) -> Vec<String> {
        let warnings = warnings(&self.losses, &self.topics, &self.core);
        self.written.iter().cloned().chain(warnings).chain(self.doubts.iter().cloned()).collect()
    }

    /// True if everything in the input could be read and decoded.
    pub fn is_complete(&self) -> bool {
        self.losses.is_empty() && self.topics.values().all(|counters| counters.first_error.is_none())
    }
}

/// Numbers of a replay. `tpf replay` prints its text, and with `--json` its fields.
#[derive(Debug, Serialize)]
pub struct Summary<'a> {
    /// Paths of the bags, as given.
    pub inputs: &'a [String],
    /// Path of the bag that was written.
    pub output: &'a str,
    /// Source of the zero.
    pub baseline: &'a ZeroFrom,
    /// In the order of the configuration.
    pub models: &'a [ModelSummary],
    /// Stamps of the frames, last minus first.
    pub data_s: f64,
    /// Elapsed time of the replay, s.
    pub wall_s: f64,
    /// Number of cores that it was allowed to use.
    pub jobs: usize,
    /// Working time of each stage.
    pub busy_s: BusySeconds,
    /// Counts of messages that were read and that could not be read, by topic.
    pub topics: &'a BTreeMap<String, TopicCounters>,
    /// Counts by source and region.
    #[serde(flatten)]
    pub counters: Counters<'a>,
    /// SHA-256 of all estimates that were written.
    pub estimates_sha256: &'a str,
    /// Data of the input that were lost.
    pub losses: &'a [String],
}

impl Summary<'_> {
    fn frames(&self) -> u64 {
        self.counters.tactile.iter().map(|source| source.counts.frames).sum()
    }

    fn estimates(&self) -> u64 {
        self.counters.regions.iter().map(|region| region.counts.estimates).sum()
    }
}

impl fmt::Display for Summary<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let times = self.data_s / self.wall_s.max(1e-9);
        writeln!(f, "{}: {} frames, {} estimates", self.output, self.frames(), self.estimates())?;
        writeln!(f, "  {:.2} s of data in {:.2} s: {times:.1} x real time", self.data_s, self.wall_s)?;
        writeln!(f, "  zero from {}", self.baseline)?;
        for source in &self.counters.tactile {
            let c = &source.counts;
            let rate = source.measured_rate_hz.map(|rate| format!(" at {rate:.1} Hz")).unwrap_or_default();
            let counts = listed(&[
                ("messages in bursts, their samples spread in time", c.bursts),
                ("messages lost by the sender's count", c.lost_messages),
                ("frames interpolated, where samples were late or missing", c.missing_frames),
                ("gaps over timing.max_gap_ms", c.gaps),
                ("time jumps", c.time_jumps),
            ]);
            let drops = dropped(&[
                ("duplicate", c.duplicate),
                ("out of order", c.out_of_order),
                ("wrong length", c.wrong_length),
                ("no row period", c.no_row_period),
                ("empty", c.empty),
            ]);
            writeln!(
                f,
                "  tactile {}: {} messages, {} of {} samples used, {} frames{rate}{counts}{drops}",
                source.name, c.messages, c.used, c.rows, c.frames
            )?;
        }
        for source in &self.counters.joints {
            let c = &source.counts;
            let counts = listed(&[
                ("lacked some joints", c.partial),
                ("with a NaN or infinity", c.non_finite),
                ("time jumps", c.time_jumps),
            ]);
            let drops = dropped(&[
                ("without a known joint", c.unknown),
                ("duplicate", c.duplicate),
                ("out of order", c.out_of_order),
                ("without a finite angle", c.nothing_finite),
                ("malformed", c.malformed),
            ]);
            writeln!(f, "  joints {}: {} of {} messages used{counts}{drops}", source.name, c.used, c.messages)?;
        }
        for region in &self.counters.regions {
            let c = &region.counts;
            let degraded = listed(&[
                ("tactile-only, because joint angles are missing", c.base_only),
                ("with the last pose held", c.held_pose),
                ("with a pose beyond the training data", c.pose_out_of_range),
                ("late", c.late),
                ("contacts", c.onsets),
            ]);
            let without = listed(&[
                ("while the window fills", c.warmup),
                ("uncalibrated", c.uncalibrated),
                ("because joint angles are too old", c.stale_pose),
                ("not finite", c.non_finite),
                ("frozen", c.frozen),
            ]);
            let without = if without.is_empty() { without } else { format!("; no estimate{without}") };
            writeln!(f, "  region {}: {} estimates{degraded}{without}", region.name, c.estimates)?;
        }
        writeln!(f, "  estimates sha256 {} (equal sums, equal estimates)", self.estimates_sha256)
    }
}

/// Warnings for a user who sees only stderr.
pub(super) fn warnings(losses: &[String], topics: &BTreeMap<String, TopicCounters>, fusion: &Fusion) -> Vec<String> {
    let mut warnings: Vec<String> = losses.iter().map(|loss| format!("input lost: {loss}")).collect();
    for (topic, counters) in topics {
        if let Some(first) = &counters.first_error {
            let n: u64 = counters.unreadable.values().sum();
            warnings.push(format!("{topic}: {n} messages could not be read, the first: {first}"));
        }
        if counters.clock_restarts > 0 {
            let n = counters.clock_restarts;
            warnings.push(format!(
                "{topic}: the device's clock was set or started anew {n} times; its stamps were mapped anew each time"
            ));
        }
    }
    for (source_idx, source) in fusion.config().tactile_source_idxs().zip(fusion.counters().tactile) {
        warnings.extend(fusion.rate_fault(source_idx).map(|fault| fault.to_string()));
        let (name, c) = (source.name, &source.counts);
        for (n, what) in [
            (c.frozen, "while all its taxels stood still for longer than their noise allows: was its driver running?"),
            (c.stuck, "while some of its taxels stood still and others moved: look at their wiring"),
            (c.interleaved, "of two senders in turn: record one"),
            (c.non_finite, "with a NaN or an infinite reading: look at its driver"),
        ] {
            if n > 0 {
                warnings.push(format!("tactile source {name}: {n} of {} rows came {what}", c.used));
            }
        }
    }
    warnings
}

/// Counts that are not zero, as `, 3 gaps, 1 time jump`.
fn listed(counts: &[(&str, u64)]) -> String {
    counts.iter().filter(|(_, n)| *n > 0).fold(String::new(), |mut text, (what, n)| {
        let what = if *n == 1 { one_of(what) } else { (*what).to_owned() };
        let _ = write!(text, ", {n} {what}"); // writing to a String never fails
        text
    })
}

/// The words for one of what begins with a plural: `frame interpolated, ...`.
fn one_of(what: &str) -> String {
    let plural = ["gaps", "time jumps", "frames", "messages"].into_iter().find(|plural| what.starts_with(plural));
    plural
        .map_or_else(|| what.to_owned(), |plural| format!("{}{}", plural.trim_end_matches('s'), &what[plural.len()..]))
}

/// Drops that are not zero, as `; dropped 3 duplicate, 1 empty`.
fn dropped(counts: &[(&str, u64)]) -> String {
    listed(counts).strip_prefix(", ").map(|drops| format!("; dropped {drops}")).unwrap_or_default()
}
