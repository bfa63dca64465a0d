//! Touches that are held: whether they stay found, and whether their force stays.
//!
//! A correction that follows the artifact may take a touch that lasts for a part of it. A held touch shows this: what a
//! second after its onset was found, and with its force, should still be so at its end.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::contact::{Touch, Touches};
use super::metric::{Metric, Undefined};
use crate::units::{NANOS_PER_SEC, Stamp};

/// A touch that lasts as long as this is held, ns. The presses and taps of the paper's protocol are shorter.
const HELD_NS: i64 = 5 * NANOS_PER_SEC;

/// The time after the onset that later times are compared with, ns: around one second.
const AT_1_S_NS: Range<i64> = NANOS_PER_SEC / 2..3 * NANOS_PER_SEC / 2;

/// Bounds of the mean true force of a held touch, gF: around 5 and 10 gF, and more.
const EDGES_GF: [f64; 4] = [2.5, 7.5, 15.0, 50.0];

/// Held touches of about the same force.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HeldTouches {
    /// Lower bound of the mean true force, gF, inclusive.
    pub from_gf: f64,
    /// Upper bound, gF, exclusive; absent for the last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub to_gf: Option<f64>,
    /// Touches of at least 5 s whose onset was seen.
    pub n: u64,
    /// Frames of them with an estimate, from half a second after the onset on.
    pub n_frames: u64,
    /// Share of the frames with contact, 0.5 to 1.5 s after the onset.
    pub found_at_1_s: Metric,
    /// Share of the frames with contact after that.
    pub found_later: Metric,
    /// Estimated force as a share of the true one, 0.5 to 1.5 s after the onset: the sums over these frames.
    pub gain_at_1_s: Metric,
    /// The same after that.
    pub gain_later: Metric,
}

impl HeldTouches {
    /// Share of the force at one second that is left later: the quotient of the gains.
    pub fn force_kept(&self) -> Metric {
        match (self.gain_at_1_s, self.gain_later) {
            (Metric::Value(early), Metric::Value(later)) if early > 0.0 => Metric::finite(later / early),
            (Metric::Value(_), Metric::Value(_)) => Metric::undefined(Undefined::NoTouch),
            (Metric::Value(_), undefined) | (undefined, _) => undefined,
        }
    }
}

/// Gathers [`HeldTouches`], session by session.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct HeldTally {
    pub(super) bins: [Sums; EDGES_GF.len()],
}

#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Sums {
    pub(super) n: u64,
    pub(super) at_1_s: Part,
    pub(super) later: Part,
}

/// Frames of a part of the held touches.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Part {
    pub(super) n: u64,
    pub(super) n_found: u64,
    pub(super) truth_gf: f64,
    pub(super) estimate_gf: f64,
}

impl HeldTally {
    /// Takes the frames of one session that have truth and estimate, and its true touches.
    ///
    /// # Shapes
    /// `stamps`, `truth_gf`, `estimate_gf`, `contact`: `[n_frames]`.
    pub(super) fn handle_session(
        &mut self,
        touches: &Touches,
        stamps: &[Stamp],
        truth_gf: &[f64],
        estimate_gf: &[f64],
        contact: &[bool],
    ) {
        for touch in touches.all.iter().filter(|touch| is_held(touch)) {
            let from = stamps.partition_point(|stamp| *stamp < touch.onset.offset(AT_1_S_NS.start));
            let to = stamps.partition_point(|stamp| *stamp < touch.offset);
            if from >= to {
                continue;
            }
            let mean_gf = truth_gf[from..to].iter().sum::<f64>() / (to - from) as f64;
            let bin = EDGES_GF.iter().rposition(|edge| mean_gf >= *edge).unwrap_or(0);
            let sums = &mut self.bins[bin];
            sums.n += 1;
            for idx in from..to {
                let is_early = stamps[idx].nanos_since(touch.onset) < AT_1_S_NS.end;
                let part = if is_early { &mut sums.at_1_s } else { &mut sums.later };
                part.n += 1;
                part.n_found += u64::from(contact[idx]);
                part.truth_gf += truth_gf[idx];
                part.estimate_gf += estimate_gf[idx];
            }
        }
    }

    /// Adds the touches of another tally, as if its sessions had come here.
    pub(super) fn merge(&mut self, other: &HeldTally) {
        for (ours, theirs) in self.bins.iter_mut().zip(&other.bins) {
            ours.n += theirs.n;
            ours.at_1_s.merge(&theirs.at_1_s);
            ours.later.merge(&theirs.later);
        }
    }

    /// Held touches by force, those that there are.
    pub(super) fn report(&self) -> Vec<HeldTouches> {
        let of = |(bin, sums): (usize, &Sums)| HeldTouches {
            from_gf: EDGES_GF[bin],
            to_gf: EDGES_GF.get(bin + 1).copied(),
            n: sums.n,
            n_frames: sums.at_1_s.n + sums.later.n,
            found_at_1_s: sums.at_1_s.found(),
            found_later: sums.later.found(),
            gain_at_1_s: sums.at_1_s.gain(),
            gain_later: sums.later.gain(),
        };
        self.bins.iter().enumerate().filter(|(_, sums)| sums.n > 0).map(of).collect()
    }
}

impl Part {
    fn merge(&mut self, other: &Part) {
        self.n += other.n;
        self.n_found += other.n_found;
        self.truth_gf += other.truth_gf;
        self.estimate_gf += other.estimate_gf;
    }

    fn found(&self) -> Metric {
        Metric::ratio(self.n_found, self.n, Undefined::NoTouch)
    }

    fn gain(&self) -> Metric {
        match self.truth_gf > 0.0 {
            true => Metric::finite(self.estimate_gf / self.truth_gf),
            false => Metric::undefined(Undefined::NoTouch),
        }
    }
}

fn is_held(touch: &Touch) -> bool {
    touch.onset_seen && touch.nanos() >= HELD_NS
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::super::contact::Touching;
    use super::*;

    /// A touch of a force for so many seconds at 100 Hz, after a second of air, and its estimate by the time since onset.
    fn report(force_gf: f64, seconds: usize, estimate: impl Fn(f64) -> (f64, bool)) -> Vec<HeldTouches> {
        let n = 100 * (seconds + 2);
        let stamps: Vec<Stamp> = (0..n).map(|idx| Stamp(idx as i64 * 10_000_000)).collect();
        let time_s = |idx: usize| (idx as f64 - 100.0) / 100.0;
        let truth: Vec<f64> = (0..n).map(|idx| if (100..n - 100).contains(&idx) { force_gf } else { 0.0 }).collect();
        let (estimates, contact): (Vec<f64>, Vec<bool>) = (0..n).map(|idx| estimate(time_s(idx))).unzip();
        let states: Vec<bool> = truth.iter().map(|force| *force >= 2.5).collect();
        let rule = Touching { max_gap: Duration::from_millis(50), ..Touching::default() };
        let touches = Touches::of(&stamps, &states, rule).unwrap();
        let mut tally = HeldTally::default();
        tally.handle_session(&touches, &stamps, &truth, &estimates, &contact);
        tally.report()
    }

    #[test]
    fn a_touch_that_is_learned_away_is_lost_and_its_force_is_not_kept() {
        let found = report(5.0, 60, |t| if t < 10.0 { (4.0, true) } else { (1.0, false) });
        assert_eq!((found.len(), found[0].n, found[0].from_gf, found[0].to_gf), (1, 1, 2.5, Some(7.5)));
        assert_eq!(found[0].found_at_1_s, Metric::Value(1.0));
        assert_eq!(found[0].gain_at_1_s.value().map(|gain| (gain * 1e9).round()), Some(8e8));
        let (later, kept) = (found[0].found_later.value().unwrap(), found[0].force_kept().value().unwrap());
        assert!((later - 8.5 / 58.5).abs() < 1e-9, "{later}");
        assert!((kept - (8.5 * 4.0 + 50.0) / 58.5 / 4.0).abs() < 1e-9, "{kept}");
    }

    #[test]
    fn a_touch_that_stays_is_kept_and_a_short_one_is_not_held() {
        let found = report(100.0, 20, |_| (90.0, true));
        assert_eq!((found[0].from_gf, found[0].to_gf), (50.0, None));
        assert_eq!((found[0].found_later, found[0].force_kept()), (Metric::Value(1.0), Metric::Value(1.0)));
        assert!(report(100.0, 4, |_| (90.0, true)).is_empty());
    }

    #[test]
    fn what_read_nothing_at_one_second_has_no_share_to_keep() {
        let found = report(5.0, 10, |_| (0.0, false));
        assert_eq!(found[0].force_kept(), Metric::undefined(Undefined::NoTouch));
    }
}
