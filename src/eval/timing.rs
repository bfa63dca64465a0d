//! How regularly estimates came, and how old the pose was that they were made with. It needs no true force.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::contact::millis;
use super::metric::{Metric, Undefined};
use super::scored_frames::ScoredFrames;
use super::statistics::Distribution;
use crate::units::nanos;

/// Frames over time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Frames.
    pub n_frames: u64,
    /// Those without an estimate.
    pub n_without_estimate: u64,
    /// Time from frame to frame, s, gaps left out.
    pub seconds: f64,
    /// Frames a second in that time.
    pub rate_hz: Metric,
    /// From a frame to the next, ms, gaps left out; absent for fewer than two frames.
    pub interval_ms: Option<Distribution>,
    /// Intervals that are too long to be bridged.
    pub n_gaps: u64,
    /// The longest of them, ms; absent without gaps.
    pub longest_gap_ms: Option<f64>,
    /// Age of the oldest joint angle of a frame, ms; absent where no frame has one.
    pub pose_age_ms: Option<Distribution>,
    /// Frames whose pose age isn't known: the joints were not there, or the model takes none.
    pub n_pose_unknown: u64,
}

impl Timing {
    /// The timing of a session's frames; intervals longer than `max_gap` are gaps.
    pub fn of(frames: &ScoredFrames, max_gap: Duration) -> Self {
        let (mut intervals, mut gaps) = (Vec::new(), Vec::new());
        let mut left_out = frames.resumes.iter().copied().peekable();
        for (idx, pair) in frames.stamp.windows(2).enumerate() {
            while left_out.next_if(|resumed| *resumed <= idx).is_some() {}
            if left_out.peek() == Some(&(idx + 1)) {
                continue; // frames in between were not asked about: no gap of the data
            }
            let interval = pair[1].nanos_since(pair[0]);
            if interval <= nanos(max_gap) { &mut intervals } else { &mut gaps }.push(millis(interval));
        }
        let seconds = intervals.iter().sum::<f64>() / 1e3;
        let ages: Vec<f64> = frames.pose_age_ns.iter().flatten().map(|age| millis(*age)).collect();
        Timing {
            n_frames: frames.stamp.len() as u64,
            n_without_estimate: frames.estimate_gf.iter().filter(|estimate| estimate.is_none()).count() as u64,
            seconds,
            rate_hz: if seconds > 0.0 {
                Metric::finite(intervals.len() as f64 / seconds)
            } else {
                Metric::undefined(Undefined::NoFrames)
            },
            interval_ms: Distribution::of(&intervals),
            n_gaps: gaps.len() as u64,
            longest_gap_ms: gaps.iter().copied().reduce(f64::max),
            n_pose_unknown: (frames.pose_age_ns.len() - ages.len()) as u64,
            pose_age_ms: Distribution::of(&ages),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Stamp;

    #[test]
    fn gaps_are_those_of_the_data_and_not_of_what_was_left_out() {
        let ms = [0, 10, 20, 200, 210, 5000, 5010];
        let frames = ScoredFrames {
            stamp: ms.iter().map(|ms| Stamp(ms * 1_000_000)).collect(),
            estimate_gf: vec![Some(0.0), Some(0.0), None, Some(0.0), Some(0.0), Some(0.0), Some(0.0)],
            pose_age_ns: vec![Some(0), Some(0), None, Some(5_000_000), Some(0), Some(0), Some(0)],
            resumes: vec![0, 5],
            ..ScoredFrames::default()
        };
        let timing = Timing::of(&frames, Duration::from_millis(50));
        assert_eq!((timing.n_gaps, timing.longest_gap_ms), (1, Some(180.0)));
        assert_eq!(timing.rate_hz, Metric::Value(100.0));
        assert_eq!((timing.n_without_estimate, timing.n_pose_unknown), (1, 1));
        assert_eq!(timing.pose_age_ms.unwrap().max, 5.0);
    }
}
