//! The frames of a donning that an artifact model is learned from: what is in the air, what is a light touch, and what shapes leave.

use super::history::JointHistory;
use super::{ARTIFACT_BASIS, HISTORY_S};

/// True forces below this are none, gF, and how long it must have been so and stay so, s. Where the force sensor is noisier, the limit
/// is so many standard deviations of its noise: one in fifty frames is lost to it then.
pub(super) const AIR_GF: f32 = 1.5;
pub(super) const AIR_S: f64 = 0.2;
pub(super) const AIR_DEVIATIONS: f32 = 3.5;

/// True forces of a light touch, gF: how it spreads over the taxels is learned from these.
pub(super) const LIGHT_GF: std::ops::Range<f32> = 5.0..30.0;

/// One of so many frames in the air is taken for the shapes: neighbours say nearly the same.
pub(super) const STRIDE: usize = 7;

/// The frames of a donning, in the order of time.
#[derive(Debug, Clone, Copy)]
pub struct DonningFrames<'a> {
    /// `[n, taxels]`, above the baseline.
    pub tactile: &'a [f32],
    /// `[n, joints]`, rad.
    pub pose: &'a [f32],
    /// `[n]`, gF: NaN where it is unknown.
    pub truth_gf: &'a [f32],
    /// `[n]`: changes wherever frames are missing.
    pub epoch: &'a [u32],
    /// `[n]`: whether a frame may be learned from.
    pub learned: &'a [bool],
}

/// Data of a donning to learn from.
pub(super) struct Donning<'s> {
    frames: DonningFrames<'s>,
    n_taxels: usize,
    pub(super) n_joints: usize,
    pub(super) n_functions: usize,
    /// `[frames, joints, functions]`
    basis: Vec<f64>,
    pub(super) air: Vec<usize>,
    pub(super) light: Vec<usize>,
    /// `[taxels, joints]`
    pub(super) gains: Vec<f64>,
    /// `[taxels]`
    pub(super) offset: Vec<f64>,
}

impl<'s> Donning<'s> {
    pub(super) fn new(frames: DonningFrames<'s>, (n_taxels, n_joints): (usize, usize), rate_hz: f64) -> Self {
        let mut history = JointHistory::new(n_joints, rate_hz);
        let mut basis = Vec::with_capacity(frames.truth_gf.len() * n_joints * ARTIFACT_BASIS);
        for (idx, pose) in frames.pose.chunks_exact(n_joints.max(1)).enumerate() {
            if idx > 0 && frames.epoch[idx] != frames.epoch[idx - 1] {
                history.clear();
            }
            history.advance(pose, 1);
            basis.extend_from_slice(history.basis());
        }
        let reach = (AIR_S * rate_hz) as usize;
        let air_gf = AIR_GF.max(AIR_DEVIATIONS * noise_gf(frames.truth_gf));
        let loaded: Vec<usize> = (0..frames.truth_gf.len())
            .filter(|&idx| frames.truth_gf[idx].is_nan() || frames.truth_gf[idx].abs() >= air_gf)
            .collect();
        let is_air = |idx: usize| {
            let next = loaded.partition_point(|&loaded| loaded + reach < idx);
            loaded.get(next).is_none_or(|&loaded| loaded > idx + reach)
        };
        // Means over the past of joints need a while to be what they are.
        let settle = (2.0 * HISTORY_S[1] * rate_hz) as usize;
        let learned = (settle..frames.truth_gf.len()).filter(|&idx| frames.learned[idx]);
        let air = learned.clone().filter(|&idx| is_air(idx)).collect();
        let light = learned.filter(|&idx| LIGHT_GF.contains(&frames.truth_gf[idx])).collect();
        let (gains, offset) = (vec![1.0; n_taxels * n_joints], vec![0.0; n_taxels]);
        Donning { frames, n_taxels, n_joints, n_functions: ARTIFACT_BASIS, basis, air, light, gains, offset }
    }

    /// Forgets all but the first functions of each joint.
    pub(super) fn keep_functions(&mut self, n_functions: usize) {
        let of_joints = self.basis.chunks_exact(self.n_functions);
        self.basis = of_joints.flat_map(|of_joint| &of_joint[..n_functions]).copied().collect();
        self.n_functions = n_functions;
    }

    pub(super) fn basis(&self, frame: usize) -> &[f64] {
        let width = self.n_joints * self.n_functions;
        &self.basis[frame * width..(frame + 1) * width]
    }

    pub(super) fn tactile(&self, frame: usize, taxel: usize) -> f64 {
        f64::from(self.frames.tactile[frame * self.n_taxels + taxel])
    }

    /// A taxel's artifact at a frame, by its shapes `[joints, functions]`.
    pub(super) fn artifact(&self, frame: usize, taxel: usize, shapes: &[f64]) -> f64 {
        let of_joints = self.basis(frame).chunks_exact(self.n_functions).zip(shapes.chunks_exact(self.n_functions));
        let sum: f64 = of_joints.zip(self.gains_of(taxel)).map(|((basis, shape), gain)| gain * dot(basis, shape)).sum();
        sum + self.offset[taxel]
    }

    pub(super) fn shapes_of<'m>(&self, taxel: usize, shapes: &'m [f64]) -> &'m [f64] {
        let width = self.n_joints * self.n_functions;
        &shapes[taxel * width..(taxel + 1) * width]
    }

    pub(super) fn gains_of(&self, taxel: usize) -> &[f64] {
        &self.gains[taxel * self.n_joints..(taxel + 1) * self.n_joints]
    }

    /// Variance of what the model leaves in the air.
    pub(super) fn residual(&self, taxel: usize, shapes: &[f64]) -> f64 {
        let shapes = self.shapes_of(taxel, shapes);
        let left = |&frame: &usize| (self.tactile(frame, taxel) - self.artifact(frame, taxel, shapes)).powi(2);
        self.air.iter().map(left).sum::<f64>() / self.air.len() as f64
    }

    /// Sums of force times what a taxel reads of it, and of force squared, over light touches.
    pub(super) fn touch(&self, taxel: usize, shapes: &[f64]) -> (f64, f64) {
        let shapes = self.shapes_of(taxel, shapes);
        self.light.iter().fold((0.0, 0.0), |(product, square), &frame| {
            let force = f64::from(self.frames.truth_gf[frame]);
            let reads = self.tactile(frame, taxel) - self.artifact(frame, taxel, shapes);
            (product + force * reads, square + force * force)
        })
    }
}

/// Standard deviation of the noise of a force sensor, gF: of its second differences, by their median. Touches are slow and rare beside it.
fn noise_gf(truth_gf: &[f32]) -> f32 {
    let second = |of: &[f32]| (of[0] - 2.0 * of[1] + of[2]).abs();
    let mut differences: Vec<f32> =
        truth_gf.windows(3).map(second).filter(|difference| difference.is_finite()).collect();
    if differences.is_empty() {
        return 0.0;
    }
    let middle = differences.len() / 2;
    let median = *differences.select_nth_unstable_by(middle, f32::total_cmp).1;
    median / (NORMAL_MEDIAN * 6.0_f32.sqrt())
}

/// The median of the absolute value of a normal variable of deviation 1.
const NORMAL_MEDIAN: f32 = 0.6745;

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noise_of_a_force_sensor_is_found_beside_its_touches() {
        let mut state = 7_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1 << 23) as f32 - 1.0
        };
        // The sum of three uniform numbers of variance 1/3 is nearly normal, of variance 1.
        let touch = |frame: usize| if frame % 300 < 80 { 200.0 } else { 0.0 };
        let noisy: Vec<f32> = (0..6000).map(|frame| touch(frame) + 2.0 * (uniform() + uniform() + uniform())).collect();
        let noise = noise_gf(&noisy);
        assert!((noise - 2.0).abs() < 0.2, "{noise}");
        assert_eq!(noise_gf(&[0.0; 50]), 0.0);
        assert_eq!(noise_gf(&[f32::NAN, 1.0]), 0.0);
    }
}
