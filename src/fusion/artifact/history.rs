//! Joint angles and their past, as the functions that shapes are sums of.

use super::noise::JointNoise;
use super::{ARTIFACT_BASIS, HISTORY_S, PLAY_RAD};

/// No joint of a hand turns so far, rad: such angles are as good as none, and would stay in the means of the past for minutes.
const MAX_ANGLE: f32 = 100.0;

/// The first of the functions that are play operators.
const FIRST_PLAY: usize = ARTIFACT_BASIS - PLAY_RAD.len();

/// Running means and play operators of joint angles, and the functions of them that artifact shapes are sums of. Angles with
/// noise are smoothed before.
#[derive(Debug, Clone)]
pub struct JointHistory {
    /// Share of a mean that is left after a frame.
    decay: [f64; HISTORY_S.len()],
    noise: JointNoise,
    /// `[joints, HISTORY_S]`, rad.
    means: Vec<f64>,
    /// `[joints, PLAY_RAD]`, rad: an angle that follows the joint's only when it is so far away, as fabric that friction holds.
    held: Vec<f64>,
    has_begun: bool,
    /// `[joints, ARTIFACT_BASIS]`, and by how much each changes with the angle of the frame, for each rad.
    basis: Vec<f64>,
    slopes: Vec<f64>,
}

impl JointHistory {
    /// No angles yet.
    pub fn new(n_joints: usize, rate_hz: f64) -> Self {
        JointHistory {
            decay: HISTORY_S.map(|time_s| (-1.0 / (rate_hz * time_s)).exp()),
            noise: JointNoise::new(n_joints, rate_hz),
            means: vec![0.0; n_joints * HISTORY_S.len()],
            held: vec![0.0; n_joints * PLAY_RAD.len()],
            has_begun: false,
            basis: vec![0.0; n_joints * ARTIFACT_BASIS],
            slopes: vec![0.0; n_joints * ARTIFACT_BASIS],
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
        let past = self.means.chunks_exact_mut(HISTORY_S.len()).zip(self.held.chunks_exact_mut(PLAY_RAD.len()));
        let functions = self.basis.chunks_exact_mut(ARTIFACT_BASIS).zip(self.slopes.chunks_exact_mut(ARTIFACT_BASIS));
        for (joint, ((means, held), (basis, slopes))) in past.zip(functions).enumerate() {
            let (smoothed, lag_s) = self.noise.smoothed(joint);
            // The mean over the past tells the speed: a steady movement is smoothed without a lag.
            let ahead = if self.has_begun { lag_s / HISTORY_S[0] * (smoothed - means[0]) } else { 0.0 };
            let angle = smoothed + ahead;
            (basis[0], basis[1]) = (angle, angle * angle);
            (slopes[0], slopes[1]) = (1.0, 2.0 * angle);
            slopes[2..FIRST_PLAY].fill(-1.0);
            for ((mean, left), basis) in means.iter_mut().zip(left).zip(&mut basis[2..FIRST_PLAY]) {
                *mean = angle + (*mean - angle) * left;
                *basis = *mean - angle;
            }
            let play = basis[FIRST_PLAY..].iter_mut().zip(&mut slopes[FIRST_PLAY..]);
            for ((held, width), (basis, slope)) in held.iter_mut().zip(PLAY_RAD).zip(play) {
                let before = if self.has_begun { *held } else { angle };
                *held = before.clamp(angle - width, angle + width);
                *basis = *held - angle;
                *slope = if *held == before { -1.0 } else { 0.0 };
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

    /// `[joints, ARTIFACT_BASIS]`: by how much these change with the angle of the last frame, for each rad.
    pub(super) fn slopes(&self) -> &[f64] {
        &self.slopes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn friction_holds_an_angle_until_it_is_far_enough_away() {
        let mut history = JointHistory::new(1, 100.0);
        let mut at = 0.5;
        let mut play = |angle: f32| {
            // So slowly that its means over the past come along, and nothing counts as noise.
            (1..=4000).for_each(|step| history.advance(&[at + (angle - at) * step as f32 / 4000.0], 1));
            at = angle;
            let of_play = |all: &[f64]| -> [f64; 2] { [all[FIRST_PLAY], all[FIRST_PLAY + 1]] };
            (of_play(history.basis()), of_play(history.slopes()))
        };
        let is_near =
            |found: [f64; 2], expected: [f64; 2]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3);
        assert_eq!(play(0.5), ([0.0; 2], [-1.0; 2]));
        let (functions, slopes) = play(0.7);
        assert!(is_near(functions, [-0.1, -0.2]), "{functions:?}");
        assert_eq!(slopes, [0.0, -1.0]); // 0.2 rad are within the wider play
        let (functions, _) = play(0.65);
        assert!(is_near(functions, [-0.05, -0.15]), "{functions:?}");
        let (functions, _) = play(0.0);
        assert!(is_near(functions, [0.1, 0.3]), "{functions:?}");
        history.clear();
        history.advance(&[0.9], 1);
        assert_eq!(history.basis()[FIRST_PLAY..], [0.0; 2]);
    }
}
