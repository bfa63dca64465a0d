//! Pose-related artifacts: what a region's taxels read because joints bend, and how it is taken out of them.
//!
//! Above their zero the taxels of a region read
//!
//! ```text
//! y_i = sum_j g_ij h_ij(angle j and its history) + o_i + k_i f + noise
//! ```
//!
//! Training knows the shapes `h`, how a light touch spreads over the taxels `k`, and how gains vary ([`ArtifactModel`]). The
//! calibration of a donning finds its gains `g` and offsets `o`, and how uncertain they are together ([`ArtifactFitter`]). Gains wander
//! while the glove is worn, and offsets drift: an [`ArtifactFilter`] follows the gains, and the offsets of a model that knows their drift, together with the touch `f`, so
//! that a touch is not learned as a change of gains.

mod donning;
mod drift;
mod falls;
mod filter;
mod fit;
mod history;
mod learn;
mod noise;

use serde::{Deserialize, Serialize};

pub use donning::DonningFrames;
pub use filter::{Adaptation, ArtifactFilter, Following};
pub use fit::{ArtifactFit, ArtifactFitter};
pub use history::JointHistory;
pub use learn::learn_artifact;

/// Functions of a joint angle that a shape is a sum of: the angle, its square, how far its means over the two spans of
/// [`HISTORY_S`] lie from it, and how far its play operators of the two widths of [`PLAY_RAD`] do.
pub const ARTIFACT_BASIS: usize = 6;

/// The functions of models without friction: all but the play operators.
pub const FRICTIONLESS_BASIS: usize = 4;

/// Time constants of the means over a joint's past, s: skin and foam that settle within a movement, and over a grasp.
pub const HISTORY_S: [f64; 2] = [0.35, 2.5];

/// Half of the widths of play operators, rad: fabric that friction holds follows a joint only when it is so far away. Sums of such are
/// the usual model of hysteresis (Prandtl and Ishlinskii).
pub const PLAY_RAD: [f64; 2] = [0.1, 0.3];

/// Columns that a network gets after the taxels if its artifact model has [`trust_inputs`](ArtifactModel::trust_inputs).
pub const TRUST_INPUTS: usize = 2;

/// Time of one measurement, s.
const BLOCK_S: f64 = 0.05;

/// What the slopes of the artifact don't tell of errors of the angles: its variance, in that of noise of the angles, as errors of their own of
/// each taxel. It stays for so many measurements.
const ALIKE_BLOCKS: f64 = 4.0;

/// Misfit of the shapes that a measurement counts as noise of its own, as a share of it: it stays for several measurements. With
/// less, a touch that is held is learned away more easily. Chosen on validation data (docs/validation).
const MISFIT_SHARE: f64 = 1.5;

/// Share of the residual that is left in the mean of a block, for a model that does not know its noise: where offsets are those of the
/// calibration, and where their drift, which is part of the residual, is a state of its own.
const RESIDUAL_SHARE: f64 = 0.6;
const RESIDUAL_SHARE_WITH_DRIFT: f64 = 0.25;

/// Time constant of the drift of offsets, s: taxels and their electronics warm up and settle.
const DRIFT_TIME_S: f64 = 300.0;

/// The most gains that are followed: the cost of a step grows with their square.
const MAX_GAINS: usize = 400;

/// Artifact of a region, as training learned it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArtifactModel {
    /// Taxels of the region.
    pub n_taxels: usize,
    /// Joints of the region.
    pub n_joints: usize,
    /// `[taxels, joints, functions]`, taxel units: the shapes of a donning whose gains are 1. There are [`ARTIFACT_BASIS`] functions, or
    /// the first [`FRICTIONLESS_BASIS`] of them.
    pub shapes: Vec<f64>,
    /// `[taxels, joints]`: variance of the gains over donnings; their mean is 1.
    pub gain_variance: Vec<f64>,
    /// Standard deviation of a gain over minutes of one donning, as a share of the gain.
    pub slip: f64,
    /// How much of that change all taxels of a joint share, 0 to 1.
    pub slip_common: f64,
    /// Time constant of that change, s.
    pub slip_time_s: f64,
    /// `[taxels]`, taxel units for each gF: how a light touch spreads.
    pub touch: Vec<f64>,
    /// `[taxels]`, taxel units squared: variance of what shapes and gains don't explain without load.
    pub residual: Vec<f64>,
    /// `[taxels]`, taxel units: standard deviation of each offset over many minutes of one donning, as the zero of the taxels
    /// drifts. Empty if offsets are not followed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub drift: Vec<f64>,
    /// `[taxels]`, taxel units squared: variance of the noise of a frame, and of what shapes have wrong though gains and offsets follow,
    /// on donnings that the shapes are not of. Both empty if that is not known: a share of `residual` stands for it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub noise: Vec<f64>,
    /// As `noise`: of what shapes have wrong.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub misfit: Vec<f64>,
    /// True if a calibration says how uncertain offsets are, together with the gains, which slip meanwhile, and if the filter starts from that. Without
    /// it, gains are taken for constant in a calibration, and its offsets for exact.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub uncertain_offsets: bool,
    /// True if the network also gets how far the taxels can be trusted: [`TRUST_INPUTS`] columns after them
    /// ([`ArtifactFilter::write_trust`]).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub trust_inputs: bool,
}

/// An artifact model, a fit of it or a state that can't be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ArtifactError(pub(super) String);

impl ArtifactModel {
    /// Columns of a network's tactile input beside the taxels.
    pub fn n_trust_inputs(&self) -> usize {
        if self.trust_inputs { TRUST_INPUTS } else { 0 }
    }

    /// Columns of a network's tactile input.
    pub fn n_columns(&self) -> usize {
        self.n_taxels + self.n_trust_inputs()
    }

    /// Functions of a joint that each shape is a sum of.
    fn n_functions(&self) -> usize {
        self.shapes.len() / self.n_gains()
    }

    /// Number of gains.
    pub fn n_gains(&self) -> usize {
        self.n_taxels * self.n_joints
    }

    /// Checks that all parts have their sizes and are numbers that can be worked with.
    ///
    /// # Errors
    /// [`ArtifactError`], whose text says what was expected.
    pub fn check(&self) -> Result<(), ArtifactError> {
        let refuse = |text: String| Err(ArtifactError(text));
        let (n, joints) = (self.n_taxels, self.n_joints);
        let n_gains = n.checked_mul(joints).filter(|n_gains| (1..=MAX_GAINS).contains(n_gains));
        let Some(n_gains) = n_gains else {
            return refuse(format!("{n} taxels and {joints} joints, expected 1 to {MAX_GAINS} pairs of them"));
        };
        let sizes = [FRICTIONLESS_BASIS, ARTIFACT_BASIS].map(|n_functions| n_gains * n_functions);
        if !sizes.contains(&self.shapes.len()) {
            return refuse(format!("{} numbers in shapes, expected {} or {}", self.shapes.len(), sizes[0], sizes[1]));
        }
        for (name, values, expected) in [
            ("gain_variance", &self.gain_variance, n_gains),
            ("touch", &self.touch, n),
            ("residual", &self.residual, n),
        ] {
            if values.len() != expected {
                return refuse(format!("{} numbers in {name}, expected {expected}", values.len()));
            }
        }
        for (name, values) in [
            ("shapes", &self.shapes),
            ("gain_variance", &self.gain_variance),
            ("touch", &self.touch),
            ("residual", &self.residual),
        ] {
            if values.iter().any(|value| !value.is_finite() || value.abs() > 1e12) {
                return refuse(format!("a number in {name} that is not finite, or beyond 1e12"));
            }
        }
        for (name, values) in [("gain_variance", &self.gain_variance), ("residual", &self.residual)] {
            if values.iter().any(|value| *value <= 0.0) {
                return refuse(format!("a variance in {name} that is not positive"));
            }
        }
        if self.touch.iter().all(|touch| *touch == 0.0) {
            return refuse("touch is 0 for every taxel".to_owned());
        }
        if !self.drift.is_empty() && self.drift.len() != n {
            return refuse(format!("{} numbers in drift, expected {n} or none", self.drift.len()));
        }
        if self.drift.iter().any(|value| !(*value >= 0.0 && *value <= 1e6)) {
            return refuse("a number in drift that is not 0 to 1000000".to_owned());
        }
        for (name, values) in [("noise", &self.noise), ("misfit", &self.misfit)] {
            if values.len() != if self.noise.is_empty() && self.misfit.is_empty() { 0 } else { n } {
                return refuse(format!(
                    "{} numbers in {name}, expected {n}, or none in both noise and misfit",
                    values.len()
                ));
            }
            if values.iter().any(|value| !(*value >= 0.0 && *value <= 1e12)) {
                return refuse(format!("a variance in {name} that is not 0 to 1e12"));
            }
        }
        if self.uncertain_offsets && self.drift.is_empty() {
            return refuse("uncertain_offsets without drift: offsets are not followed".to_owned());
        }
        if self.noise.contains(&0.0) {
            return refuse("a variance in noise that is 0".to_owned());
        }
        let within = |value: f64, least: f64, most: f64| value >= least && value <= most;
        if !within(self.slip, 0.0, 10.0) || !within(self.slip_common, 0.0, 1.0) || !within(self.slip_time_s, 0.1, 1e6) {
            return refuse(format!(
                "slip {}, slip_common {}, slip_time_s {}, expected 0 to 10, 0 to 1 and 0.1 to 1000000",
                self.slip, self.slip_common, self.slip_time_s
            ));
        }
        Ok(())
    }

    /// Variance of what the model leaves of a taxel in the mean of so many frames.
    fn unexplained(&self, taxel: usize, n_frames: usize) -> f64 {
        match (self.noise.get(taxel), self.misfit.get(taxel)) {
            (Some(noise), Some(misfit)) => noise / n_frames as f64 + MISFIT_SHARE * misfit,
            _ if self.drift.is_empty() => RESIDUAL_SHARE * self.residual[taxel],
            _ => RESIDUAL_SHARE_WITH_DRIFT * self.residual[taxel],
        }
    }

    /// By how much a taxel's artifact changes with the angle of a joint, for each rad, at a gain of 1.
    ///
    /// # Shapes
    /// `slopes`: `[joints, ARTIFACT_BASIS]`, those of the functions of the joints.
    fn slope(&self, taxel: usize, joint: usize, slopes: &[f64]) -> f64 {
        let (gain, n_functions) = (taxel * self.n_joints + joint, self.n_functions());
        let weights = &self.shapes[gain * n_functions..(gain + 1) * n_functions];
        weights.iter().zip(&slopes[joint * ARTIFACT_BASIS..]).map(|(weight, slope)| weight * slope).sum()
    }

    /// Writes the shapes for basis functions of the joints.
    ///
    /// # Shapes
    /// `basis`: `[joints, ARTIFACT_BASIS]`; `out`: `[taxels, width]`, of which the first `[joints]` of each taxel are written.
    fn write_shapes(&self, basis: &[f64], width: usize, out: &mut [f64]) {
        let n_functions = self.n_functions();
        let of_taxel = self.n_joints * n_functions;
        for (out, shapes) in out.chunks_exact_mut(width).zip(self.shapes.chunks_exact(of_taxel)) {
            let pairs = shapes.chunks_exact(n_functions).zip(basis.chunks_exact(ARTIFACT_BASIS));
            for (out, (shape, basis)) in out.iter_mut().zip(pairs) {
                *out = shape.iter().zip(basis).map(|(weight, value)| weight * value).sum();
            }
        }
    }
}

/// Frames of a measurement.
fn block_frames(rate_hz: f64) -> usize {
    (BLOCK_S * rate_hz).round().max(1.0) as usize
}

#[cfg(test)]
mod tests;
