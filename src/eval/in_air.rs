//! Estimates while nothing touches the glove, by the pose that was asked for. This needs no true force.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::metric::{Metric, Undefined};
use super::scored_frames::ScoredFrames;
use super::statistics::Distribution;
use crate::histogram::Histogram;
use crate::units::{Stamp, nanos};

/// Estimates while nothing touches the glove.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct InAir {
    /// Time from frame to frame, gaps left out.
    pub minutes: f64,
    /// Frames with an estimate.
    pub n_frames: u64,
    /// Frames without one.
    pub n_without_estimate: u64,
    /// Contacts that were told: none of them can be true.
    pub n_false_touches: u64,
    /// The same a minute.
    pub per_minute: Metric,
    /// Size of the estimated force, gF, in steps of 1/1024 gF; percentiles to 0.2 %. Absent without estimates.
    pub abs_force_gf: Option<Distribution>,
}

/// The same in all, and by the pose that was asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InAirReport {
    /// In all.
    #[serde(flatten)]
    pub total: InAir,
    /// By pose.
    pub by_pose: BTreeMap<String, InAir>,
}

/// Sizes of forces, each to the next 1/1024 gF: so their sum does not depend on their order, and takes as little memory for a
/// thousand sessions as for one.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Sizes {
    /// The middle of a bin is within 0.2 % of all in it.
    pub(super) histogram: Histogram<8>,
    /// 1/1024 gF.
    pub(super) sum: u64,
    /// The smallest and the largest, 1/1024 gF; `None` without any.
    pub(super) ends: Option<(u64, u64)>,
}

/// Steps of sizes in one gF.
const STEPS: f64 = 1024.0;

/// A larger size, which no force has, counts as this: so sums are whole numbers that doubles hold.
const MAX_SIZE: u64 = 1 << 40;
pub(super) const MAX_SUM: u64 = 1 << 53;

impl Sizes {
    fn handle(&mut self, size_gf: f64) {
        let steps = ((size_gf * STEPS).round() as u64).min(MAX_SIZE);
        self.histogram.handle(steps);
        self.sum = self.sum.saturating_add(steps).min(MAX_SUM);
        self.ends = Some(self.ends.map_or((steps, steps), |(least, most)| (least.min(steps), most.max(steps))));
    }

    /// Whether there is a smallest and a largest where there is any, and only there.
    pub(super) fn is_whole(&self) -> bool {
        self.ends.is_some() == (self.histogram.n() > 0)
    }

    fn merge(&mut self, other: &Sizes) {
        self.histogram.merge(&other.histogram);
        self.sum = self.sum.saturating_add(other.sum).min(MAX_SUM);
        self.ends = match (self.ends, other.ends) {
            (Some(ours), Some(theirs)) => Some((ours.0.min(theirs.0), ours.1.max(theirs.1))),
            (ours, theirs) => ours.or(theirs),
        };
    }

    fn distribution(&self) -> Option<Distribution> {
        let (least, most) = self.ends?;
        let (min, max) = (least as f64 / STEPS, most as f64 / STEPS);
        let n = self.histogram.n();
        let at = |idx: u64| (self.histogram.at(idx).unwrap_or(0.0) / STEPS).clamp(min, max);
        Some(Distribution::by_order(n, self.sum as f64 / STEPS / n as f64, at))
    }
}

/// Gathers [`InAir`], session by session.
///
/// A contact that is still told shortly after the hand let go is late, not false: it counts once the slack is over.
#[derive(Debug, Clone, PartialEq)]
pub struct InAirTally {
    slack_ns: i64,
    max_gap_ns: i64,
    pub(super) by_pose: BTreeMap<String, Sums>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Sums {
    pub(super) air_ns: i64,
    pub(super) n_without_estimate: u64,
    pub(super) n_false_touches: u64,
    pub(super) sizes: Sizes,
}

impl InAirTally {
    /// Nothing yet. Frames further apart than `max_gap` are a gap, over which nothing is known.
    pub fn new(slack: Duration, max_gap: Duration) -> Self {
        InAirTally { slack_ns: nanos(slack), max_gap_ns: nanos(max_gap), by_pose: BTreeMap::new() }
    }

    /// Takes the frames of a session.
    pub fn handle_session(&mut self, frames: &ScoredFrames) {
        let mut rest: Option<Rest> = None;
        for (idx, &stamp) in frames.stamp.iter().enumerate() {
            let Some(asked) = frames.asked.get(frames.origin[idx]).filter(|asked| asked.zero_load) else {
                rest = None;
                continue;
            };
            if !self.by_pose.contains_key(&asked.pose) {
                self.by_pose.insert(asked.pose.clone(), Sums::default());
            }
            let Some(sums) = self.by_pose.get_mut(&asked.pose) else { continue };
            match frames.estimate_gf[idx] {
                Some(force) => sums.sizes.handle(force.abs()),
                None => sums.n_without_estimate += 1,
            }
            let known = rest.as_ref().filter(|rest| stamp.nanos_since(rest.last) <= self.max_gap_ns);
            let (from, was_in_contact) = match known {
                Some(rest) => {
                    sums.air_ns += stamp.nanos_since(rest.last);
                    (rest.from, rest.in_contact)
                }
                None => (stamp, false),
            };
            let counts = stamp.nanos_since(from) > self.slack_ns;
            let in_contact = counts && frames.contact[idx];
            sums.n_false_touches += u64::from(in_contact && !was_in_contact);
            rest = Some(Rest { from, last: stamp, in_contact });
        }
    }

    /// Adds the frames of another tally, as if its sessions had come here.
    pub(super) fn merge(&mut self, other: &InAirTally) {
        for (pose, sums) in &other.by_pose {
            self.by_pose.entry(pose.clone()).or_default().merge(sums);
        }
    }

    /// The estimates in the air so far; `None` when no frame was in the air.
    pub fn report(&self) -> Option<InAirReport> {
        let mut all = Sums::default();
        self.by_pose.values().for_each(|sums| all.merge(sums));
        let by_pose = self.by_pose.iter().map(|(pose, sums)| (pose.clone(), sums.in_air())).collect();
        (!self.by_pose.is_empty()).then(|| InAirReport { total: all.in_air(), by_pose })
    }
}

#[derive(Debug)]
struct Rest {
    from: Stamp,
    last: Stamp,
    in_contact: bool,
}

impl Sums {
    fn merge(&mut self, other: &Sums) {
        self.air_ns = self.air_ns.saturating_add(other.air_ns);
        self.n_without_estimate += other.n_without_estimate;
        self.n_false_touches += other.n_false_touches;
        self.sizes.merge(&other.sizes);
    }

    fn in_air(&self) -> InAir {
        let minutes = self.air_ns as f64 / 60e9;
        InAir {
            minutes,
            n_frames: self.sizes.histogram.n(),
            n_without_estimate: self.n_without_estimate,
            n_false_touches: self.n_false_touches,
            per_minute: if minutes > 0.0 {
                Metric::finite(self.n_false_touches as f64 / minutes)
            } else {
                Metric::undefined(Undefined::NoAirTime)
            },
            abs_force_gf: self.sizes.distribution(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::scored_frames::Asked;
    use super::*;

    /// Frames 10 ms apart: what was asked, the force, and whether contact was told.
    fn frames(of: &[(usize, Option<f64>, bool)]) -> ScoredFrames {
        let asked = |pose: &str, zero_load| Asked { pose: pose.to_owned(), zero_load };
        ScoredFrames {
            stamp: (0..of.len() as i64).map(|idx| Stamp(idx * 10_000_000)).collect(),
            truth_gf: vec![f64::NAN; of.len()],
            estimate_gf: of.iter().map(|frame| frame.1).collect(),
            contact: of.iter().map(|frame| frame.2).collect(),
            pose_age_ns: vec![None; of.len()],
            origin: of.iter().map(|frame| frame.0).collect(),
            asked: vec![asked("fist", true), asked("tap", false), asked("flat", true)],
            ..ScoredFrames::default()
        }
    }

    fn tally(of: &[(usize, Option<f64>, bool)]) -> InAirReport {
        let mut tally = InAirTally::new(Duration::from_millis(20), Duration::from_millis(50));
        tally.handle_session(&frames(of));
        tally.report().unwrap()
    }

    #[test]
    fn contact_is_false_only_where_nothing_touches_and_the_slack_is_over() {
        let (held, air) = ((1, Some(50.0), true), (2, Some(-1.0), true));
        let report = tally(&[held, held, air, air, air, air, air, (2, Some(1.0), false), air, held]);
        assert_eq!(report.total.n_false_touches, 2, "one that lasts past 20 ms, and one that begins anew");
        assert_eq!(report.by_pose["flat"].n_frames, 7);
        assert!(!report.by_pose.contains_key("tap"), "loaded");
        assert!((report.total.minutes * 60.0 - 0.06).abs() < 1e-12);
        assert_eq!(report.total.abs_force_gf.unwrap().max, 1.0, "the size, whatever its sign");
    }

    #[test]
    fn sizes_are_those_of_every_frame_to_two_thousandths_however_sessions_are_added() {
        let force = |idx: usize| ((idx * 7919 % 4001) as f64).powi(2) * 1e-5 - 20.0;
        let sessions: Vec<_> = (0..10)
            .map(|session| {
                let of: Vec<_> = (0..400).map(|idx| (0, Some(force(session * 400 + idx)), false)).collect();
                let mut tally = InAirTally::new(Duration::from_millis(20), Duration::from_millis(50));
                tally.handle_session(&frames(&of));
                tally
            })
            .collect();
        let sum = |order: &mut dyn Iterator<Item = usize>| {
            let mut sum = InAirTally::new(Duration::from_millis(20), Duration::from_millis(50));
            order.for_each(|session| sum.merge(&sessions[session]));
            sum.report().unwrap()
        };
        let found = sum(&mut (0..10));
        assert_eq!(found, sum(&mut (0..10).rev()));
        let all: Vec<f64> = (0..4000).map(|idx| force(idx).abs()).collect();
        let (exact, found) = (Distribution::of(&all).unwrap(), found.total.abs_force_gf.unwrap());
        let values = |of: Distribution| [of.mean, of.p5, of.p50, of.p95, of.min, of.max];
        for (got, exact) in values(found).into_iter().zip(values(exact)) {
            assert!((got - exact).abs() <= exact * 0.002 + 0.0011, "{got}, expected {exact}");
        }
        assert_eq!(found.n, 4000);
    }

    #[test]
    fn a_touch_belongs_to_the_pose_in_which_it_began() {
        let still = |pose| (pose, Some(0.0), false);
        let report =
            tally(&[still(0), still(0), still(0), (0, Some(9.0), true), (2, Some(9.0), true), (2, None, false)]);
        assert_eq!(report.by_pose["fist"].n_false_touches, 1);
        assert_eq!(report.by_pose["flat"].n_false_touches, 0);
        assert_eq!((report.by_pose["flat"].n_frames, report.by_pose["flat"].n_without_estimate), (1, 1));
    }
}
