//! How far the joints of a finger are bent, and how the effect of a bend differs from taxel to taxel.

use crate::random::Noise;
use crate::sim::hand::{Finger, HandPose};

/// Weight of the finger's own joints DIP, PIP, MCP flexion and abduction in the strain at its tip.
///
/// # Source
/// Pose-aware tactile gloves, Observation 3: nearby joints act most, DIP and PIP over MCP over other fingers.
pub(super) const LOCALITY: [f64; 4] = [1.0, 0.7, 0.3, 0.15];
/// Angles of a full bend, rad: with DIP and PIP here, the artifact is the design's `bend_artifact`.
pub(super) const FULL_RAD: [f64; 4] = [1.1, 1.5, 1.3, 0.35];
/// The same for a thumb: IP, MCP, CMC flexion and abduction have smaller ranges.
const FULL_THUMB_RAD: [f64; 4] = [1.1, 0.9, 0.8, 0.8];
pub(super) const FULL_BEND: f64 = LOCALITY[0] + LOCALITY[1];
const COMMON: f64 = 0.6; // share that all taxels have in common, the rest is each one's own

/// Current bend of a finger's joints, as fractions of a full bend.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bends(pub(super) [f64; 4]);

impl Bends {
    pub(super) fn of(pose: &HandPose, finger: Finger) -> Self {
        let angles = pose.finger(finger);
        let full_rad = if finger == Finger::Thumb { FULL_THUMB_RAD } else { FULL_RAD };
        Bends(std::array::from_fn(|j| angles[j] / full_rad[j]))
    }

    /// Bend at the fingertip: 1 for DIP and PIP fully bent.
    pub(super) fn local(&self) -> f64 {
        self.0.iter().zip(LOCALITY).map(|(bend, weight)| bend * weight).sum::<f64>() / FULL_BEND
    }

    /// Total flexion of the finger, which tilts the tip.
    pub(super) fn flexion(&self) -> f64 {
        (self.0[0] + self.0[1] + self.0[2]) / 3.0
    }
}

/// Weight of each taxel, 1 on average over the taxels: [`COMMON`] is the same for all, the rest differs.
pub(super) fn pattern(n_taxels: usize, hardware: &mut Noise) -> Vec<f64> {
    let own: Vec<f64> = (0..n_taxels).map(|_| hardware.normal((1.0 - COMMON) / COMMON)).collect();
    let mean = own.iter().sum::<f64>() / n_taxels as f64;
    own.iter().map(|own| 1.0 + own - mean).collect()
}
