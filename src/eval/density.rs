//! How often each force is estimated where each is true: the frames in bins of both.

use serde::Serialize;

/// Edges of the bins, gF: ten a decade, among them the 2.5 gF from which on a force is touch. What is below the first is in
/// the first bin, whatever its sign, and what is beyond the last in the last.
///
/// # Source
/// Preferred numbers of ISO 3, series R10.
const EDGES_GF: [f64; 34] = [
    1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0, 10.0, 12.5, 16.0, 20.0, 25.0, 31.5, 40.0, 50.0, 63.0, 80.0,
    100.0, 125.0, 160.0, 200.0, 250.0, 315.0, 400.0, 500.0, 630.0, 800.0, 1000.0, 1250.0, 1600.0, 2000.0,
];

/// Bins of each force.
pub(super) const N_BINS: usize = EDGES_GF.len() + 1;

/// Frames by true and by estimated force.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ForceDensity {
    /// `[n_bins - 1]`: edges of the bins of either force, gF. The first bin is all below the first edge, the last one all from
    /// the last edge on.
    pub edges_gf: Vec<f64>,
    /// `[bins of the true force][bins of the estimated force]`: frames that have both.
    pub frames: Vec<Vec<u64>>,
}

impl ForceDensity {
    /// Of the frames of a bin of the true force, the share in each bin of the estimated one; `None` without frames.
    ///
    /// # Shapes
    /// `[bins of the estimated force]`
    pub fn shares(&self, truth_bin: usize) -> Option<Vec<f64>> {
        let frames = self.frames.get(truth_bin)?;
        let n: u64 = frames.iter().sum();
        (n > 0).then(|| frames.iter().map(|of_bin| *of_bin as f64 / n as f64).collect())
    }
}

/// Gathers [`ForceDensity`], session by session.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DensityTally {
    /// `[true][estimated]`
    pub(super) frames: Vec<[u64; N_BINS]>,
}

impl Default for DensityTally {
    fn default() -> Self {
        DensityTally { frames: vec![[0; N_BINS]; N_BINS] }
    }
}

impl DensityTally {
    /// Takes frames; those without truth or estimate are left out.
    ///
    /// # Shapes
    /// `truth_gf`, `estimate_gf`: `[n_frames]`.
    pub(super) fn add(&mut self, truth_gf: &[f64], estimate_gf: &[f64]) {
        for (truth, estimate) in truth_gf.iter().zip(estimate_gf) {
            if truth.is_finite() && estimate.is_finite() {
                self.frames[bin(*truth)][bin(*estimate)] += 1;
            }
        }
    }

    /// Adds the frames of another tally.
    pub(super) fn merge(&mut self, other: &DensityTally) {
        for (ours, theirs) in self.frames.iter_mut().flatten().zip(other.frames.iter().flatten()) {
            *ours += theirs;
        }
    }

    /// The density of all frames so far; `None` without frames.
    pub(super) fn density(&self) -> Option<ForceDensity> {
        let has_frames = self.frames.iter().flatten().any(|n| *n > 0);
        let frames = || self.frames.iter().map(|of_truth| of_truth.to_vec()).collect();
        has_frames.then(|| ForceDensity { edges_gf: EDGES_GF.to_vec(), frames: frames() })
    }
}

fn bin(force_gf: f64) -> usize {
    EDGES_GF.partition_point(|edge| *edge <= force_gf)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frame_with_both_forces_is_in_one_bin_of_each() {
        let mut tally = DensityTally::default();
        tally.add(&[-3.0, 2.5, 2.49, 9000.0, f64::NAN, 1.0], &[0.0, 2.4, 2.5, 1e9, 1.0, f64::NAN]);
        let density = tally.density().unwrap();
        let touch = 1 + EDGES_GF.iter().position(|edge| *edge == 2.5).unwrap();
        assert_eq!(density.frames.iter().flatten().sum::<u64>(), 4);
        assert_eq!([density.frames[0][0], density.frames[N_BINS - 1][N_BINS - 1]], [1, 1]);
        assert_eq!([density.frames[touch][touch - 1], density.frames[touch - 1][touch]], [1, 1]);
        assert_eq!(density.shares(touch).map(|shares| shares[touch - 1]), Some(1.0));
        assert_eq!(density.shares(3), None);
        assert!(EDGES_GF.is_sorted());
    }

    #[test]
    fn tallies_add_up_and_an_empty_one_tells_nothing() {
        let (mut a, mut b) = (DensityTally::default(), DensityTally::default());
        assert_eq!(a.density(), None);
        b.add(&[10.0, 20.0], &[10.0, 25.0]);
        a.merge(&b);
        a.merge(&b);
        assert_eq!(a.density().unwrap().frames.iter().flatten().sum::<u64>(), 4);
    }
}
