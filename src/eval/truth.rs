//! Dynamic taring: a load cell drifts, and wherever the hand is known to be in the air its reading is the drift itself.

use serde::{Deserialize, Serialize};

use super::scoring::Scoring;
use crate::units::{GramForce, Stamp};

/// An annotated stretch of time without load, from `from` up to but without `to`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ZeroLoad {
    /// Begin, inclusive.
    pub from: Stamp,
    /// End, exclusive.
    pub to: Stamp,
}

/// Why a true force can't be tared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum TruthError {
    #[error("zero-load stretch from {from} ends at {to}, expected its end after its begin; correct the annotation")]
    Backwards { from: Stamp, to: Stamp },
    #[error("zero-load stretches overlap: one ends at {first_to}, the next begins at {second_from}; merge them")]
    Overlap { first_to: Stamp, second_from: Stamp },
    #[error(
        "none of {n_stretches} zero-load stretches holds a finite force; check that annotation and truth share a clock"
    )]
    NoZeroLoad { n_stretches: usize },
}

/// Median of one zero-load stretch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TareKnot {
    /// Middle between the first and the last sample of the stretch.
    pub at: Stamp,
    /// Median of its samples.
    pub tare: GramForce,
    /// Number of its samples.
    pub n_samples: usize,
}

/// Gathers the zero-load samples of a recording: the first of the two passes that taring takes.
///
/// Samples may come in any order. Memory holds the zero-load samples and nothing of the rest.
#[derive(Debug, Clone)]
pub struct TareBuilder {
    stretches: Vec<Gathered>,
}

#[derive(Debug, Clone)]
struct Gathered {
    bounds: ZeroLoad,
    first: Stamp,
    last: Stamp,
    forces: Vec<f64>,
}

impl TareBuilder {
    /// A builder for the given stretches, in any order.
    ///
    /// # Errors
    /// [`TruthError`] when a stretch ends before it begins, or two overlap.
    pub fn new(stretches: &[ZeroLoad]) -> Result<Self, TruthError> {
        let mut sorted = stretches.to_vec();
        sorted.sort_by_key(|stretch| stretch.from);
        if let Some(&ZeroLoad { from, to }) = sorted.iter().find(|stretch| stretch.to <= stretch.from) {
            return Err(TruthError::Backwards { from, to });
        }
        if let Some(pair) = sorted.windows(2).find(|pair| pair[1].from < pair[0].to) {
            return Err(TruthError::Overlap { first_to: pair[0].to, second_from: pair[1].from });
        }
        let empty = |bounds| Gathered { bounds, first: Stamp(i64::MAX), last: Stamp(i64::MIN), forces: Vec::new() };
        Ok(TareBuilder { stretches: sorted.into_iter().map(empty).collect() })
    }

    /// Takes one sample of the truth as it was measured. Samples outside the stretches and non-finite ones are not
    /// used.
    pub fn handle_force(&mut self, stamp: Stamp, force: GramForce) {
        let after = self.stretches.partition_point(|stretch| stretch.bounds.from <= stamp);
        let Some(stretch) = after.checked_sub(1).and_then(|idx| self.stretches.get_mut(idx)) else { return };
        if stamp < stretch.bounds.to && force.0.is_finite() {
            stretch.first = stretch.first.min(stamp);
            stretch.last = stretch.last.max(stamp);
            stretch.forces.push(force.0);
        }
    }

    /// The tare over time.
    ///
    /// # Errors
    /// [`TruthError::NoZeroLoad`] when no stretch holds a sample.
    pub fn finish(self) -> Result<TareCurve, TruthError> {
        let n_stretches = self.stretches.len();
        let mut curve = TareCurve { knots: Vec::new(), unused: Vec::new() };
        for mut stretch in self.stretches {
            match median(&mut stretch.forces) {
                Some(tare) => curve.knots.push(TareKnot {
                    at: Stamp((i128::from(stretch.first.0) + i128::from(stretch.last.0)).div_euclid(2) as i64),
                    tare: GramForce(tare),
                    n_samples: stretch.forces.len(),
                }),
                None => curve.unused.push(stretch.bounds),
            }
        }
        if curve.knots.is_empty() { Err(TruthError::NoZeroLoad { n_stretches }) } else { Ok(curve) }
    }
}

/// Median, the mean of the middle two where their number is even. Reorders `forces`, which are finite.
fn median(forces: &mut [f64]) -> Option<f64> {
    let n = forces.len();
    if n == 0 {
        return None;
    }
    let (below, &mut upper, _) = forces.select_nth_unstable_by(n / 2, f64::total_cmp);
    if n % 2 == 1 {
        return Some(upper);
    }
    let lower = below.iter().copied().max_by(f64::total_cmp).unwrap_or(upper);
    Some(lower / 2.0 + upper / 2.0)
}

/// The tare of the truth over time.
///
/// The median of each zero-load stretch holds at the stretch's middle. Between two middles the tare is interpolated
/// linearly in time; before the first and after the last it is held. Drift that is linear in time is so removed exactly
/// between the first middle and the last. A long stretch, in which drift is not linear, is better annotated as several.
///
/// # Source
/// Pose-aware tactile gloves, Sec. VI-A ("dynamic taring"), and Sec. IV: free movement in the air after each stage, "to
/// calibrate for potential drift in the force ground truth". The interpolation is ours; the paper gives none.
#[derive(Debug, Clone, PartialEq)]
pub struct TareCurve {
    knots: Vec<TareKnot>,
    unused: Vec<ZeroLoad>,
}

impl TareCurve {
    /// The tare at a point in time: what to subtract from a force measured then.
    pub fn at(&self, stamp: Stamp) -> GramForce {
        let after = self.knots.partition_point(|knot| knot.at <= stamp);
        let before = after.checked_sub(1).and_then(|idx| self.knots.get(idx));
        match (before, self.knots.get(after)) {
            (Some(before), Some(after)) => {
                let span = (i128::from(after.at.0) - i128::from(before.at.0)) as f64;
                let share = (i128::from(stamp.0) - i128::from(before.at.0)) as f64 / span;
                GramForce(before.tare.0 + share * (after.tare.0 - before.tare.0))
            }
            (Some(knot), None) | (None, Some(knot)) => knot.tare,
            (None, None) => GramForce(0.0), // a curve has a knot: `finish` refuses others
        }
    }

    /// Subtracts the tare from a force measured at `stamp`: the second pass. NaN stays NaN.
    pub fn tared(&self, stamp: Stamp, force: GramForce) -> GramForce {
        GramForce(force.0 - self.at(stamp).0)
    }

    /// The medians it goes through, in time order.
    pub fn knots(&self) -> &[TareKnot] {
        &self.knots
    }

    /// Stretches that hold no finite sample, and so told nothing.
    pub fn unused(&self) -> &[ZeroLoad] {
        &self.unused
    }
}

/// How well the tared truth keeps what the touch threshold was chosen by: that zero load stays below it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ZeroLoadCheck {
    /// Finite zero-load samples.
    pub n_samples: u64,
    /// Of these, those at or above the touch threshold after taring.
    pub n_touch: u64,
    /// The largest force among them after taring, gF; 0 when none is above 0.
    pub largest_gf: f64,
}

impl ZeroLoadCheck {
    /// Takes one tared zero-load sample.
    pub fn handle_force(&mut self, scoring: &Scoring, tared: GramForce) {
        if tared.0.is_finite() {
            self.n_samples += 1;
            self.n_touch += u64::from(scoring.is_touch(tared.0));
            self.largest_gf = self.largest_gf.max(tared.0);
        }
    }
}
