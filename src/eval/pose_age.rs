//! Force error by the age of the pose that it was corrected with.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::contact::millis;
use super::metric::{Metric, Undefined};
use super::metrics::MetricError;
use crate::units::nanos;

/// Bounds of pose age that can't be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PoseAgeError {
    /// Bounds that aren't ascending.
    #[error("bounds of pose age are {0:?}, expected ascending durations above zero")]
    Bounds(Vec<Duration>),
}

/// A range of pose age.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseAge {
    /// Zero: every joint was measured at the frame or interpolated.
    Fresh,
    /// Held joints, the oldest of them this old.
    Held {
        /// Older than this, ms.
        over_ms: f64,
        /// Up to this, ms; absent for the last range.
        to_ms: Option<f64>,
    },
    /// Unknown, or the model takes no pose.
    Unknown,
}

/// Force error over one range of pose age.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseAgeBin {
    /// The range.
    pub age: PoseAge,
    /// Frames with truth and estimate.
    pub n: u64,
    /// Mean absolute error, gF.
    pub mae_gf: Metric,
    /// Mean of estimate minus truth, gF.
    pub bias_gf: Metric,
}

/// Gathers force errors by pose age.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseAgeTally {
    bounds_ns: Vec<i64>,
    /// Fresh, one a bound, past the last bound, unknown.
    pub(super) sums: Vec<Sums>,
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sums {
    pub(super) n: u64,
    pub(super) abs_error: f64,
    pub(super) error: f64,
}

impl Default for PoseAgeTally {
    /// Held up to 10, 20, 30 and 50 ms: frames at 100 Hz, to the age at which a pose is stale by default.
    fn default() -> Self {
        PoseAgeTally::with_bounds([10, 20, 30, 50].map(|ms: i64| ms * 1_000_000).to_vec())
    }
}

impl PoseAgeTally {
    /// An empty tally with upper bounds (inclusive) of the ranges of held poses.
    ///
    /// # Errors
    /// [`PoseAgeError::Bounds`] when they aren't ascending and above zero.
    pub fn new(bounds: &[Duration]) -> Result<Self, PoseAgeError> {
        let bounds_ns: Vec<i64> = bounds.iter().map(|&bound| nanos(bound)).collect();
        if bounds_ns.first().is_some_and(|&first| first <= 0) || bounds_ns.windows(2).any(|pair| pair[0] >= pair[1]) {
            return Err(PoseAgeError::Bounds(bounds.to_vec()));
        }
        Ok(PoseAgeTally::with_bounds(bounds_ns))
    }

    fn with_bounds(bounds_ns: Vec<i64>) -> Self {
        let sums = vec![Sums::default(); bounds_ns.len() + 3];
        PoseAgeTally { bounds_ns, sums }
    }

    /// Adds aligned frames. Frames whose truth or estimate is NaN or infinite have no error and aren't counted here.
    ///
    /// # Shapes
    /// `truth`, `estimate`: `[n_frames]`, gF; `pose_age_ns`: `[n_frames]`, `None` where it is unknown.
    /// # Errors
    /// [`MetricError`] when they differ in length.
    pub fn add(&mut self, truth: &[f64], estimate: &[f64], pose_age_ns: &[Option<i64>]) -> Result<(), MetricError> {
        if truth.len() != estimate.len() {
            return Err(MetricError::Lengths { truth: truth.len(), estimate: estimate.len() });
        }
        if truth.len() != pose_age_ns.len() {
            return Err(MetricError::OtherLengths { name: "pose age", truth: truth.len(), got: pose_age_ns.len() });
        }
        for ((truth, estimate), &age) in truth.iter().zip(estimate).zip(pose_age_ns) {
            let error = estimate - truth;
            if truth.is_finite() && estimate.is_finite() {
                let range = self.range_of(age);
                let sums = &mut self.sums[range];
                sums.n += 1;
                sums.abs_error += error.abs();
                sums.error += error;
            }
        }
        Ok(())
    }

    /// Adds the frames of another tally of the same bounds, as if its sessions had come here.
    pub(super) fn merge(&mut self, other: &PoseAgeTally) {
        for (ours, theirs) in self.sums.iter_mut().zip(&other.sums) {
            ours.n += theirs.n;
            ours.abs_error += theirs.abs_error;
            ours.error += theirs.error;
        }
    }

    fn range_of(&self, age: Option<i64>) -> usize {
        match age {
            None => self.sums.len() - 1,
            Some(age) if age <= 0 => 0,
            Some(age) => 1 + self.bounds_ns.partition_point(|&bound| bound < age),
        }
    }

    /// The error of each range, those without frames too.
    pub fn bins(&self) -> Vec<PoseAgeBin> {
        let over = std::iter::once(0).chain(self.bounds_ns.iter().copied());
        let to = self.bounds_ns.iter().map(|&bound| Some(millis(bound))).chain([None]);
        let held = over.zip(to).map(|(over, to_ms)| PoseAge::Held { over_ms: millis(over), to_ms });
        let ages = std::iter::once(PoseAge::Fresh).chain(held).chain([PoseAge::Unknown]);
        let bin = |(age, sums): (PoseAge, &Sums)| PoseAgeBin {
            age,
            n: sums.n,
            mae_gf: Metric::mean(sums.abs_error, sums.n, Undefined::NoFrames),
            bias_gf: Metric::mean(sums.error, sums.n, Undefined::NoFrames),
        };
        ages.zip(&self.sums).map(bin).collect()
    }
}
