//! Touches of known force in a recording, measured by a load cell or given by a person, with their estimates.

use std::ops::Range;

use super::EstimateTrack;
use crate::fusion::KnownTouch;
use crate::protocol::KnownTouches;
use crate::units::{GramForce, NANOS_PER_SEC, Newton, Stamp};

/// A touch is measured while its force is at least this share of its peak. On the rise and fall, one of the two forces
/// may lag.
const HELD: f64 = 0.7;

/// Minimum time that a touch must be held, ns: 0.1 s, minus one frame at 100 Hz.
const HELD_NS: i64 = 90_000_000;

/// Minimum number of frames in a touch whose times a person gives.
const HELD_FRAMES: usize = 10;

/// A touch of known force, with its times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedTouch {
    /// Force and estimate, averaged over the frames in which it was held.
    pub touch: KnownTouch,
    /// First frame above the smallest force that counts.
    pub from: Stamp,
    /// Last frame above it.
    pub to: Stamp,
}

/// Touches measured by a load cell that are strong and long enough for a gain, in order of time.
///
/// # Shapes
/// `truth`: `[frames]`, tared, for the frames of `track`.
pub fn known_touches(track: &EstimateTrack, truth: &[Option<GramForce>]) -> Vec<TimedTouch> {
    let force = |idx: usize| truth.get(idx).copied().flatten().map_or(f64::NAN, |force| force.0);
    let touch = |Held { frames, held }: Held| {
        let n = held.len() as f64;
        let estimates: Option<f64> = held.iter().map(|idx| Some(track.force[*idx]?.0)).sum();
        let mean = held.iter().map(|idx| force(*idx)).sum::<f64>() / n;
        let touch = KnownTouch { force: GramForce(mean).into(), estimate: Newton(estimates? / n) };
        Some(TimedTouch { touch, from: track.stamp[frames.start], to: track.stamp[frames.end - 1] })
    };
    held_touches(&track.stamp, &force).filter_map(touch).collect()
}

/// End of the first `n` touches that are strong and long enough for a gain, from the readings of a load cell alone.
/// `None` if there are fewer.
pub fn end_of_touches(readings: impl Iterator<Item = (Stamp, GramForce)>, n: usize) -> Option<Stamp> {
    let (stamps, forces): (Vec<Stamp>, Vec<f64>) = readings.map(|(stamp, force)| (stamp, force.0)).unzip();
    let last = n.checked_sub(1)?;
    held_touches(&stamps, &|idx| forces[idx]).nth(last).map(|touch| stamps[touch.frames.end - 1])
}

/// A touch that was held.
struct Held {
    /// Frames above the smallest force that counts.
    frames: Range<usize>,
    /// Frames near its peak.
    held: Vec<usize>,
}

fn held_touches(stamps: &[Stamp], force: &impl Fn(usize) -> f64) -> impl Iterator<Item = Held> {
    let mut at = 0;
    std::iter::from_fn(move || {
        while at < stamps.len() {
            let from = at;
            while at < stamps.len() && force(at) >= KnownTouches::LIGHTEST.0 {
                at += 1;
            }
            let frames = from..at;
            at += usize::from(at == from);
            let peak = frames.clone().map(force).fold(0.0, f64::max);
            let held: Vec<usize> = frames.clone().filter(|idx| force(*idx) >= HELD * peak).collect();
            if let (Some(first), Some(last)) = (held.first(), held.last())
                && stamps[*last].nanos_since(stamps[*first]) >= HELD_NS
            {
                return Some(Held { frames, held });
            }
        }
        None
    })
}

/// A touch whose force a person knows, from a kitchen scale or a weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToldTouch {
    /// The force, N.
    pub force: Newton,
    /// Start of the touch, s after the first frame.
    pub from_s: f64,
    /// End of the touch, s after the first frame.
    pub to_s: f64,
}

/// The estimates during a touch that a person gives. `None` if fewer than ten frames have one.
pub fn told_touch(track: &EstimateTrack, told: &ToldTouch) -> Option<TimedTouch> {
    let first = *track.stamp.first()?;
    let after = |seconds: f64| first.offset((seconds * NANOS_PER_SEC as f64) as i64);
    let (from, to) = (after(told.from_s), after(told.to_s));
    let held = track.stamp.iter().zip(&track.force).filter(|(stamp, _)| **stamp >= from && **stamp <= to);
    let estimates: Vec<f64> = held.filter_map(|(_, force)| force.map(|force| force.0)).collect();
    let mean = estimates.iter().sum::<f64>() / estimates.len() as f64;
    let touch = KnownTouch { force: told.force, estimate: Newton(mean) };
    (estimates.len() >= HELD_FRAMES).then_some(TimedTouch { touch, from, to })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames at 100 Hz, with estimates of 0.8 times the truth.
    fn track(truth_gf: &[f64]) -> (EstimateTrack, Vec<Option<GramForce>>) {
        let mut track = EstimateTrack::default();
        for (k, force) in truth_gf.iter().enumerate() {
            track.stamp.push(Stamp(10_000_000 * k as i64));
            track.force.push(Some(Newton::from(GramForce(0.8 * force))));
        }
        (track, truth_gf.iter().map(|force| Some(GramForce(*force))).collect())
    }

    #[test]
    fn touches_count_where_they_are_held_and_strong_enough() {
        let mut truth = vec![0.0; 100];
        truth[10..30].fill(100.0);
        truth[30..40].fill(40.0); // fall: below 0.7 of the peak
        truth[50..56].fill(200.0); // a tap
        truth[60..90].fill(20.0); // too weak
        let (estimates, truth) = track(&truth);
        let touches = known_touches(&estimates, &truth);
        assert_eq!(touches.len(), 1);
        assert_eq!((touches[0].from, touches[0].to), (Stamp(100_000_000), Stamp(390_000_000)));
        let readings = || estimates.stamp.iter().copied().zip(truth.iter().map(|force| force.unwrap()));
        assert_eq!(end_of_touches(readings(), 1), Some(touches[0].to));
        assert_eq!((end_of_touches(readings(), 0), end_of_touches(readings(), 2)), (None, None));
        let KnownTouch { force, estimate } = touches[0].touch;
        assert!((GramForce::from(force).0 - 100.0).abs() < 1e-9 && (estimate.0 / force.0 - 0.8).abs() < 1e-9);
    }

    #[test]
    fn a_touch_with_a_frame_that_has_no_estimate_or_no_truth_is_not_held() {
        let (mut estimates, mut truth) = track(&[100.0; 30]);
        truth[15] = None;
        assert_eq!(known_touches(&estimates, &truth).len(), 2);
        estimates.force[20] = None;
        assert_eq!(known_touches(&estimates, &truth).len(), 1);
    }

    #[test]
    fn a_touch_is_told_by_its_force_and_time() {
        let (estimates, _) = track(&[100.0; 100]);
        let told = ToldTouch { force: Newton(1.0), from_s: 0.1, to_s: 0.3 };
        let touch = told_touch(&estimates, &told).unwrap().touch;
        assert!(touch.force == Newton(1.0) && (GramForce::from(touch.estimate).0 - 80.0).abs() < 1e-9);
        assert_eq!(told_touch(&estimates, &ToldTouch { from_s: 0.95, to_s: 2.0, ..told }), None);
    }
}
