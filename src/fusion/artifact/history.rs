//! Joint angles and their past, as the functions that shapes are sums of.

use super::noise::JointNoise;
use super::{ARTIFACT_BASIS, HISTORY_S};

/// No joint of a hand turns so far, rad: such angles are as good as none, and would stay in the means of the past for minutes.
const MAX_ANGLE: f32 = 100.0;

/// Running means of joint angles, and the functions of both that artifact shapes are sums of. Angles with noise are smoothed
/// before.
#[derive(Debug, Clone)]
pub struct JointHistory {
    /// Share of a mean that is left after a frame.
    decay: [f64; HISTORY_S.len()],
    noise: JointNoise,
    /// `[joints, HISTORY_S]`, rad.
    means: Vec<f64>,
    has_begun: bool,
    /// `[joints, ARTIFACT_BASIS]`
    basis: Vec<f64>,
}

impl JointHistory {
    /// No angles yet.
    pub fn new(n_joints: usize, rate_hz: f64) -> Self {
        JointHistory {
            decay: HISTORY_S.map(|time_s| (-1.0 / (rate_hz * time_s)).exp()),
            noise: JointNoise::new(n_joints, rate_hz),
            means: vec![0.0; n_joints * HISTORY_S.len()],
            has_begun: false,
            basis: vec![0.0; n_joints * ARTIFACT_BASIS],
        }
    }

    /// True if angles are such as joints can have.
    pub fn takes(pose: &[f32]) -> bool {
        pose.iter().all(|angle| angle.abs() <= MAX_ANGLE)
    }

    /// Forgets the past: the next angles are taken to have been held for long.
    pub fn clear(&mut self) {
        self.has_begun = false;
    }

    /// True if there are angles.
    pub fn has_begun(&self) -> bool {
        self.has_begun
    }

    /// Takes the angles of a frame, `n_frames` after the last one.
    ///
    /// # Shapes
    /// `pose`: `[joints]`, rad.
    pub fn advance(&mut self, pose: &[f32], n_frames: i32) {
        let left = self.decay.map(|decay| if self.has_begun { decay.powi(n_frames) } else { 0.0 });
        self.noise.advance(pose, n_frames, !self.has_begun);
        let rows = self.means.chunks_exact_mut(HISTORY_S.len()).zip(self.basis.chunks_exact_mut(ARTIFACT_BASIS));
        for (joint, (means, basis)) in rows.enumerate() {
            let (smoothed, lag_s) = self.noise.smoothed(joint);
            // The mean over the past tells the speed: a steady movement is smoothed without a lag.
            let ahead = if self.has_begun { lag_s / HISTORY_S[0] * (smoothed - means[0]) } else { 0.0 };
            let angle = smoothed + ahead;
            (basis[0], basis[1]) = (angle, angle * angle);
            for ((mean, left), basis) in means.iter_mut().zip(left).zip(&mut basis[2..]) {
                *mean = angle + (*mean - angle) * left;
                *basis = *mean - angle;
            }
        }
        self.has_begun = true;
    }

    /// Standard deviation of the noise of a joint's angle, rad, as it was measured so far.
    pub(super) fn noise(&self, joint: usize) -> f64 {
        self.noise.deviation(joint)
    }

    /// `[joints, ARTIFACT_BASIS]` of the last frame.
    pub fn basis(&self) -> &[f64] {
        &self.basis
    }
}
