//! Touches as stretches of time: when they were, when they were detected, and what was detected that wasn't there.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::metric::{Metric, Undefined};
use super::statistics::Distribution;
use crate::units::{Stamp, nanos};

/// A stretch of frames in touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Touch {
    /// First frame in touch.
    pub onset: Stamp,
    /// First frame no longer in touch; the last known frame where the data ends or has a gap first.
    pub offset: Stamp,
    /// Whether the onset was seen. It isn't when data begins, or resumes after a gap, in touch.
    pub onset_seen: bool,
    /// Whether the offset was seen.
    pub offset_seen: bool,
}

impl Touch {
    /// How long it lasted, as far as it was seen, in nanoseconds.
    pub fn nanos(&self) -> i64 {
        self.offset.nanos_since(self.onset)
    }
}

/// A series that can't be followed through time.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum ContactError {
    #[error("{name} has {got} frames and there are {stamps} stamps; align them frame by frame")]
    Lengths { name: &'static str, stamps: usize, got: usize },
    #[error(
        "frame {idx} is stamped {stamp}, not after {before} of the frame before; split the series where time jumps"
    )]
    Order { idx: usize, stamp: Stamp, before: Stamp },
}

/// How a series of frames becomes touches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Touching {
    /// Frames further apart than this are a gap, over which nothing is known: a touch ends there unseen.
    pub max_gap: Duration,
    /// Touches that are closer than this are one. Zero keeps every frame's word.
    pub join_within: Duration,
    /// Touches shorter than this after joining are dropped, and counted. Zero keeps them all.
    pub at_least: Duration,
}

impl Default for Touching {
    /// A gap of 50 ms as for model frames, and no debounce.
    fn default() -> Self {
        Touching { max_gap: Duration::from_millis(50), join_within: Duration::ZERO, at_least: Duration::ZERO }
    }
}

/// The touches of a series of frames, in time order.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Touches {
    /// The touches.
    pub all: Vec<Touch>,
    /// Touches dropped because they were too short.
    pub n_too_short: u64,
    /// Gaps in the series.
    pub n_gaps: u64,
    /// Time known to be in touch, ns, before joining and dropping.
    pub touch_ns: i64,
    /// Time known to be without touch, ns, before joining and dropping.
    pub air_ns: i64,
}

impl Touches {
    /// Follows a series of states through time. The time from one frame to the next belongs to the first one's state.
    ///
    /// Of the truth pass `force >= threshold`; of estimates `contact_raw` or `contact`. Leave out frames without a
    /// value: where that takes longer than `max_gap`, it is a gap. A truth that hovers around the threshold chatters:
    /// join and drop what is shorter than a touch can be.
    ///
    /// # Shapes
    /// `stamps`, `states`: `[n_frames]`.
    /// # Errors
    /// [`ContactError`] when they differ in length, or a stamp is not after the one before.
    pub fn of(stamps: &[Stamp], states: &[bool], rule: Touching) -> Result<Self, ContactError> {
        if stamps.len() != states.len() {
            return Err(ContactError::Lengths { name: "contact", stamps: stamps.len(), got: states.len() });
        }
        let mut touches = Touches::default();
        let mut open: Option<Touch> = None;
        let mut previous: Option<Stamp> = None;
        for (idx, (&stamp, &state)) in stamps.iter().zip(states).enumerate() {
            let mut known_before = false;
            if let Some(before) = previous {
                if stamp <= before {
                    return Err(ContactError::Order { idx, stamp, before });
                }
                known_before = stamp.nanos_since(before) <= nanos(rule.max_gap);
                if known_before {
                    let time = if open.is_some() { &mut touches.touch_ns } else { &mut touches.air_ns };
                    *time = time.saturating_add(stamp.nanos_since(before));
                } else {
                    touches.n_gaps += 1;
                    touches.all.extend(open.take().map(|touch| Touch { offset: before, ..touch }));
                }
            }
            match &mut open {
                None if state => {
                    open = Some(Touch { onset: stamp, offset: stamp, onset_seen: known_before, offset_seen: false });
                }
                Some(touch) => {
                    touch.offset = stamp;
                    if !state {
                        touch.offset_seen = true;
                        touches.all.extend(open.take());
                    }
                }
                None => {}
            }
            previous = Some(stamp);
        }
        touches.all.extend(open);
        touches.debounce(rule);
        Ok(touches)
    }

    fn debounce(&mut self, rule: Touching) {
        let mut joined: Vec<Touch> = Vec::with_capacity(self.all.len());
        for touch in self.all.drain(..) {
            match joined.last_mut() {
                // Across a gap of the data nothing is joined: what happened there isn't known.
                Some(last)
                    if last.offset_seen
                        && touch.onset_seen
                        && touch.onset.nanos_since(last.offset) < nanos(rule.join_within) =>
                {
                    *last = Touch { onset: last.onset, onset_seen: last.onset_seen, ..touch };
                }
                _ => joined.push(touch),
            }
        }
        let n_joined = joined.len();
        joined.retain(|touch| touch.nanos() >= nanos(rule.at_least));
        self.n_too_short = (n_joined - joined.len()) as u64;
        self.all = joined;
    }

    /// The touches of `self` that overlap `touch` when both may be `slack_ns` apart: a range of indices, found by
    /// search.
    pub(super) fn overlapping(&self, touch: &Touch, slack_ns: i64) -> std::ops::Range<usize> {
        let from = self.all.partition_point(|other| other.offset.offset(slack_ns) < touch.onset);
        let to = self.all.partition_point(|other| other.onset <= touch.offset.offset(slack_ns));
        from..to.max(from)
    }
}

/// How true touches were detected, gathered session by session.
///
/// A true touch and a detected one belong together when they overlap in time, or are at most `slack` apart. A latency
/// is signed, detected minus true: negative when detection came first. The onset is taken between a true touch and the
/// first detected one that overlaps it, if that one overlaps no earlier true touch; the offset between a true touch and
/// the last detected one, if that one overlaps no later true touch. So a detection that lumps two touches together
/// gives one onset and one offset, not four numbers that mean nothing. A true touch during which there was no estimate
/// is a missed one.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DetectionTally {
    slack_ns: i64,
    pub(super) counts: Detection,
    pub(super) onset_ms: Vec<f64>,
    pub(super) offset_ms: Vec<f64>,
    pub(super) air_ns: i64,
}

impl DetectionTally {
    /// An empty tally. With a `slack` of zero only what overlaps belongs together; a detector with debounce needs more.
    pub fn new(slack: Duration) -> Self {
        DetectionTally { slack_ns: nanos(slack), ..DetectionTally::default() }
    }

    /// Matches the detected touches of one session to the true ones.
    pub fn handle_session(&mut self, truth: &Touches, detected: &Touches) {
        let slack = self.slack_ns;
        let counts = &mut self.counts;
        for (idx, touch) in truth.all.iter().enumerate() {
            let found = &detected.all[detected.overlapping(touch, slack)];
            let (Some(first), Some(last)) = (found.first(), found.last()) else {
                counts.n_missed += 1;
                continue;
            };
            if truth.overlapping(first, slack).start < idx {
                counts.n_merged += 1;
            } else if first.onset_seen && touch.onset_seen {
                self.onset_ms.push(millis(first.onset.nanos_since(touch.onset)));
            } else {
                counts.n_onset_unseen += 1;
            }
            if truth.overlapping(last, slack).end == idx + 1 {
                if last.offset_seen && touch.offset_seen {
                    self.offset_ms.push(millis(last.offset.nanos_since(touch.offset)));
                } else {
                    counts.n_offset_unseen += 1;
                }
            }
        }
        for (idx, touch) in detected.all.iter().enumerate() {
            match truth.all[truth.overlapping(touch, slack)].first() {
                None => counts.air.n += 1,
                Some(first) => counts.n_split += u64::from(detected.overlapping(first, slack).start < idx),
            }
        }
        counts.n_true += truth.all.len() as u64;
        counts.n_detected += detected.all.len() as u64;
        counts.n_true_too_short += truth.n_too_short;
        self.air_ns = self.air_ns.saturating_add(truth.air_ns);
    }

    /// Adds the touches of another tally, as if its sessions had come here.
    pub(super) fn merge(&mut self, other: &DetectionTally) {
        let (counts, theirs) = (&mut self.counts, &other.counts);
        counts.n_true += theirs.n_true;
        counts.n_true_too_short += theirs.n_true_too_short;
        counts.n_detected += theirs.n_detected;
        counts.n_missed += theirs.n_missed;
        counts.n_merged += theirs.n_merged;
        counts.n_split += theirs.n_split;
        counts.n_onset_unseen += theirs.n_onset_unseen;
        counts.n_offset_unseen += theirs.n_offset_unseen;
        counts.air.n += theirs.air.n;
        self.onset_ms.extend_from_slice(&other.onset_ms);
        self.offset_ms.extend_from_slice(&other.offset_ms);
        self.air_ns = self.air_ns.saturating_add(other.air_ns);
    }

    /// Detected onset minus true onset, ms, in the order of the touches.
    pub fn onsets_ms(&self) -> &[f64] {
        &self.onset_ms
    }

    /// Detected offset minus true offset, ms, in the order of the touches.
    pub fn offsets_ms(&self) -> &[f64] {
        &self.offset_ms
    }

    /// The detection of touches in the sessions so far.
    pub fn detection(&self) -> Detection {
        let minutes = self.air_ns as f64 / 60e9;
        let per_minute = if minutes > 0.0 {
            Metric::finite(self.counts.air.n as f64 / minutes)
        } else {
            Metric::undefined(Undefined::NoAirTime)
        };
        Detection {
            onset_ms: Distribution::of(&self.onset_ms),
            offset_ms: Distribution::of(&self.offset_ms),
            air: AirTouches { minutes, per_minute, ..self.counts.air },
            ..self.counts
        }
    }
}

/// How true touches were detected; see [`DetectionTally`] for the rule.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Detection {
    /// True touches.
    pub n_true: u64,
    /// Stretches of truth at or above the threshold that were too short to be a touch.
    pub n_true_too_short: u64,
    /// Detected touches.
    pub n_detected: u64,
    /// True touches that overlap no detected one.
    pub n_missed: u64,
    /// True touches whose onset drowned in a detection that began with an earlier true touch.
    pub n_merged: u64,
    /// Detected touches whose true touch was detected before them: one touch seen as several.
    pub n_split: u64,
    /// Detected onset minus true onset, ms; absent when no onset has one.
    pub onset_ms: Option<Distribution>,
    /// Onsets that belong together and aren't known, because data began or broke off there.
    pub n_onset_unseen: u64,
    /// Detected offset minus true offset, ms; absent when no offset has one.
    pub offset_ms: Option<Distribution>,
    /// Offsets that belong together and aren't known, because data ended or broke off there.
    pub n_offset_unseen: u64,
    /// Detected touches that overlap no true one.
    pub air: AirTouches,
}

/// Touches detected while the hand was in the air.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AirTouches {
    /// Detected touches that overlap no true one, nor lie within the slack of one: those are late, not false.
    pub n: u64,
    /// Time in the air, minutes: that of frames without true touch, gaps left out.
    pub minutes: f64,
    /// False touches a minute.
    pub per_minute: Metric,
}

impl Default for AirTouches {
    fn default() -> Self {
        AirTouches { n: 0, minutes: 0.0, per_minute: Metric::undefined(Undefined::NoAirTime) }
    }
}

pub(super) fn millis(nanos: i64) -> f64 {
    nanos as f64 / 1e6
}
