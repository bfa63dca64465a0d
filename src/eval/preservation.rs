//! Effect of the pose correction on true contacts: a correction that erases artifacts may erase touches too.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::contact::{Touch, Touches, millis};
use super::metric::{Metric, Undefined};
use super::statistics::Distribution;
use crate::units::nanos;

/// Fate of one true touch, between the base estimate and the corrected one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "fate", rename_all = "snake_case")]
pub enum Fate {
    /// Detected in both.
    Kept {
        /// Corrected onset minus base onset, ms, neither counted from before the true onset; absent when one wasn't
        /// seen.
        delay_ms: Option<f64>,
    },
    /// Detected by the base alone: the correction removed it.
    Removed,
    /// Detected by the corrected estimate alone.
    Gained,
    /// Detected by neither.
    InNeither,
}

/// A true touch and what became of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchFate {
    /// The true touch.
    pub touch: Touch,
    /// Its fate.
    pub fate: Fate,
}

/// Contact preservation, gathered session by session.
///
/// A touch is detected when a detected one overlaps it or is at most `slack` apart. Its delay counts from the true
/// onset at the earliest: a base estimate that was in contact long before, because a finger bent, didn't detect this
/// touch early, and a correction that drops the false part doesn't delay it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PreservationTally {
    slack_ns: i64,
    tolerated_ms: f64,
    pub(super) counts: Preservation,
    pub(super) delay_ms: Vec<f64>,
    pub(super) base_ns: i64,
    pub(super) lost_ns: i64,
}

impl PreservationTally {
    /// An empty tally; a kept touch is delayed when its onset comes more than `tolerated` later.
    pub fn new(slack: Duration, tolerated: Duration) -> Self {
        PreservationTally {
            slack_ns: nanos(slack),
            tolerated_ms: millis(nanos(tolerated)),
            ..PreservationTally::default()
        }
    }

    /// Follows the true touches of one session from the base estimate to the corrected one; one fate each, in time
    /// order.
    pub fn handle_session(&mut self, truth: &Touches, base: &Touches, corrected: &Touches) -> Vec<TouchFate> {
        truth
            .all
            .iter()
            .map(|touch| TouchFate { touch: *touch, fate: self.handle_touch(touch, base, corrected) })
            .collect()
    }

    fn handle_touch(&mut self, touch: &Touch, base: &Touches, corrected: &Touches) -> Fate {
        let in_base = &base.all[base.overlapping(touch, self.slack_ns)];
        let in_corrected = &corrected.all[corrected.overlapping(touch, self.slack_ns)];
        for contact in in_base {
            let Some(shared) = intersection(touch, contact) else { continue };
            let kept = in_corrected.iter().filter_map(|kept| intersection(&shared, kept));
            self.base_ns = self.base_ns.saturating_add(shared.nanos());
            let kept_ns = kept.map(|kept| kept.nanos()).fold(0, i64::saturating_add);
            self.lost_ns = self.lost_ns.saturating_add(shared.nanos().saturating_sub(kept_ns));
        }
        self.counts.n_true += 1;
        match (in_base.first(), in_corrected.first()) {
            (Some(base), Some(corrected)) => {
                self.counts.n_kept += 1;
                let known = |contact: &Touch| contact.onset_seen || contact.onset < touch.onset;
                let delay_ms = (known(base) && known(corrected) && touch.onset_seen).then(|| {
                    let entry = |contact: &Touch| contact.onset.max(touch.onset);
                    millis(entry(corrected).nanos_since(entry(base)))
                });
                match delay_ms {
                    Some(delay) => {
                        self.counts.n_delayed += u64::from(delay > self.tolerated_ms);
                        self.delay_ms.push(delay);
                    }
                    None => self.counts.n_delay_unseen += 1,
                }
                Fate::Kept { delay_ms }
            }
            (Some(_), None) => {
                self.counts.n_removed += 1;
                Fate::Removed
            }
            (None, Some(_)) => {
                self.counts.n_gained += 1;
                Fate::Gained
            }
            (None, None) => {
                self.counts.n_in_neither += 1;
                Fate::InNeither
            }
        }
    }

    /// Adds the touches of another tally, as if its sessions had come here.
    pub(super) fn merge(&mut self, other: &PreservationTally) {
        let (counts, theirs) = (&mut self.counts, &other.counts);
        counts.n_true += theirs.n_true;
        counts.n_kept += theirs.n_kept;
        counts.n_delayed += theirs.n_delayed;
        counts.n_delay_unseen += theirs.n_delay_unseen;
        counts.n_removed += theirs.n_removed;
        counts.n_gained += theirs.n_gained;
        counts.n_in_neither += theirs.n_in_neither;
        self.delay_ms.extend_from_slice(&other.delay_ms);
        self.base_ns = self.base_ns.saturating_add(other.base_ns);
        self.lost_ns = self.lost_ns.saturating_add(other.lost_ns);
    }

    /// Contact preservation in the sessions so far.
    pub fn preservation(&self) -> Preservation {
        let counts = &self.counts;
        let lost = if self.base_ns > 0 {
            Metric::Value(self.lost_ns as f64 / self.base_ns as f64)
        } else {
            Metric::undefined(Undefined::NoTouch)
        };
        Preservation {
            kept: Metric::ratio(counts.n_kept, counts.n_kept + counts.n_removed, Undefined::NoTouch),
            lost_time: lost,
            delay_ms: Distribution::of(&self.delay_ms),
            ..*counts
        }
    }
}

/// The time that two touches share; `None` when they share no moment.
fn intersection(a: &Touch, b: &Touch) -> Option<Touch> {
    let (onset, offset) = (a.onset.max(b.onset), a.offset.min(b.offset));
    (onset <= offset).then_some(Touch { onset, offset, ..*a })
}

/// How many true contacts of the base estimate survive the pose correction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Preservation {
    /// True touches.
    pub n_true: u64,
    /// Those detected by both.
    pub n_kept: u64,
    /// Those of them that the corrected estimate detected later, by more than is tolerated.
    pub n_delayed: u64,
    /// Those of them whose delay isn't known, because data began or broke off there.
    pub n_delay_unseen: u64,
    /// Those detected by the base alone.
    pub n_removed: u64,
    /// Those detected by the corrected estimate alone.
    pub n_gained: u64,
    /// Those detected by neither.
    pub n_in_neither: u64,
    /// Share of the touches detected by the base that the corrected estimate detects too.
    pub kept: Metric,
    /// Share of the time in which the base was rightly in contact and the corrected estimate was not.
    pub lost_time: Metric,
    /// Delay of the kept ones, ms, negative when the correction brings them earlier; absent when none is known.
    pub delay_ms: Option<Distribution>,
}

impl Default for Preservation {
    fn default() -> Self {
        let nothing = Metric::undefined(Undefined::NoTouch);
        Preservation {
            n_true: 0,
            n_kept: 0,
            n_delayed: 0,
            n_delay_unseen: 0,
            n_removed: 0,
            n_gained: 0,
            n_in_neither: 0,
            kept: nothing,
            lost_time: nothing,
            delay_ms: None,
        }
    }
}
