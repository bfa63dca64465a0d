//! Learns an artifact model from donnings: shapes that all of them share, by alternating least squares, and how gains vary.

use nalgebra::{DMatrix, DVector};

use super::drift;
use super::history::JointHistory;
use super::{ARTIFACT_BASIS, ArtifactError, ArtifactModel, HISTORY_S};

/// True forces below this are none, gF, and how long it must have been so and stay so, s. Where the force sensor is noisier, the limit
/// is so many standard deviations of its noise: one in fifty frames is lost to it then.
const AIR_GF: f32 = 1.5;
const AIR_S: f64 = 0.2;
const AIR_DEVIATIONS: f32 = 3.5;

/// True forces of a light touch, gF: how it spreads over the taxels is learned from these.
const LIGHT_GF: std::ops::Range<f32> = 5.0..30.0;

/// One of so many frames in the air is taken for the shapes: neighbours say nearly the same.
pub(super) const STRIDE: usize = 7;

/// Frames that shapes and the pattern of touch need at least.
const LEAST_FRAMES: usize = 200;

/// Rounds of the alternation.
const ROUNDS: usize = 12;

/// How strongly a gain is drawn to 1, and a weight to 0, as a share of the mean square of what they multiply.
const GAIN_PULL: f64 = 0.02;
const WEIGHT_PULL: f64 = 1e-2;

/// Variance of gains that is believed before any donning is seen, as of so many donnings, and its bounds.
const PRIOR_VARIANCE: f64 = 0.1;
const PRIOR_DONNINGS: f64 = 1.0;
const VARIANCE_BOUNDS: (f64, f64) = (0.01, 0.5);

/// How gains change within a donning; results hardly depend on it (docs/validation).
pub(super) const SLIP: f64 = 0.3;
const SLIP_COMMON: f64 = 0.35;
const SLIP_TIME_S: f64 = 90.0;

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
    /// `[frames, joints * ARTIFACT_BASIS]`
    basis: Vec<f64>,
    pub(super) air: Vec<usize>,
    light: Vec<usize>,
    /// `[taxels, joints]`
    pub(super) gains: Vec<f64>,
    /// `[taxels]`
    offset: Vec<f64>,
}

/// The artifact model of donnings, by the frames that may be learned from.
///
/// # Errors
/// [`ArtifactError`] when there are too few frames in the air, or of light touch.
pub fn learn_artifact(
    donnings: &[DonningFrames<'_>],
    (n_taxels, n_joints): (usize, usize),
    rate_hz: f64,
) -> Result<ArtifactModel, ArtifactError> {
    let mut donnings: Vec<Donning<'_>> =
        donnings.iter().map(|frames| Donning::new(*frames, (n_taxels, n_joints), rate_hz)).collect();
    donnings.retain(|donning| donning.air.len() >= LEAST_FRAMES);
    let n_light: usize = donnings.iter().map(|donning| donning.light.len()).sum();
    let refuse = |what: String| Err(ArtifactError(what));
    if donnings.is_empty() {
        return refuse(format!(
            "no session has {LEAST_FRAMES} frames in the air to learn from: with joint angles, {} s after the first frame, and {AIR_S} s before and after each true force of {AIR_GF} gF or of {AIR_DEVIATIONS} deviations of the force sensor's noise",
            2.0 * HISTORY_S[1]
        ));
    }
    if n_light < LEAST_FRAMES {
        let (from, to) = (LIGHT_GF.start, LIGHT_GF.end);
        return refuse(format!(
            "{n_light} frames of {from} to {to} gF, at least {LEAST_FRAMES} needed: they tell how a light touch spreads"
        ));
    }
    let mut shapes = vec![0.0; n_taxels * n_joints * ARTIFACT_BASIS];
    for taxel in 0..n_taxels {
        fit_taxel(&mut donnings, taxel, &mut shapes)?;
    }
    let n = donnings.len() as f64;
    let over_donnings = |of: &dyn Fn(&Donning<'_>) -> f64| donnings.iter().map(of).sum::<f64>();
    let gain_variance = (0..n_taxels * n_joints).map(|gain| {
        let squares = over_donnings(&|donning| (donning.gains[gain] - 1.0).powi(2));
        let variance = (squares + PRIOR_DONNINGS * PRIOR_VARIANCE) / (n + PRIOR_DONNINGS);
        variance.clamp(VARIANCE_BOUNDS.0, VARIANCE_BOUNDS.1)
    });
    let residual = (0..n_taxels).map(|taxel| {
        let variance = over_donnings(&|donning| donning.residual(taxel, &shapes)) / n;
        variance.max(f64::MIN_POSITIVE.sqrt())
    });
    let touch = (0..n_taxels).map(|taxel| {
        let sums = donnings.iter().map(|donning| donning.touch(taxel, &shapes));
        let (product, square) = sums.fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1));
        product / square
    });
    let (gain_variance, residual, touch): (_, Vec<f64>, _) =
        (gain_variance.collect(), residual.collect(), touch.collect());
    let drift: Vec<f64> =
        (0..n_taxels).map(|taxel| drift::learn(&donnings, taxel, &shapes, residual[taxel], rate_hz)).collect();
    let drifts = drift.iter().any(|deviation| *deviation > 0.0);
    let model = ArtifactModel {
        n_taxels,
        n_joints,
        gain_variance,
        slip: SLIP,
        slip_common: SLIP_COMMON,
        slip_time_s: SLIP_TIME_S,
        touch,
        residual,
        shapes,
        drift: if drifts { drift } else { Vec::new() },
        trust_inputs: false,
    };
    model.check()?;
    Ok(model)
}

impl<'s> Donning<'s> {
    fn new(frames: DonningFrames<'s>, (n_taxels, n_joints): (usize, usize), rate_hz: f64) -> Self {
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
        Donning { frames, n_taxels, n_joints, basis, air, light, gains, offset }
    }

    pub(super) fn basis(&self, frame: usize) -> &[f64] {
        let width = self.n_joints * ARTIFACT_BASIS;
        &self.basis[frame * width..(frame + 1) * width]
    }

    pub(super) fn tactile(&self, frame: usize, taxel: usize) -> f64 {
        f64::from(self.frames.tactile[frame * self.n_taxels + taxel])
    }

    /// A taxel's artifact at a frame, by its shapes `[joints, ARTIFACT_BASIS]`.
    pub(super) fn artifact(&self, frame: usize, taxel: usize, shapes: &[f64]) -> f64 {
        let of_joints = self.basis(frame).chunks_exact(ARTIFACT_BASIS).zip(shapes.chunks_exact(ARTIFACT_BASIS));
        let gains = &self.gains[taxel * self.n_joints..(taxel + 1) * self.n_joints];
        let sum: f64 = of_joints.zip(gains).map(|((basis, shape), gain)| gain * dot(basis, shape)).sum();
        sum + self.offset[taxel]
    }

    pub(super) fn shapes_of<'m>(&self, taxel: usize, shapes: &'m [f64]) -> &'m [f64] {
        let width = self.n_joints * ARTIFACT_BASIS;
        &shapes[taxel * width..(taxel + 1) * width]
    }

    /// Variance of what the model leaves in the air.
    fn residual(&self, taxel: usize, shapes: &[f64]) -> f64 {
        let shapes = self.shapes_of(taxel, shapes);
        let left = |&frame: &usize| (self.tactile(frame, taxel) - self.artifact(frame, taxel, shapes)).powi(2);
        self.air.iter().map(left).sum::<f64>() / self.air.len() as f64
    }

    /// Sums of force times what a taxel reads of it, and of force squared, over light touches.
    fn touch(&self, taxel: usize, shapes: &[f64]) -> (f64, f64) {
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

/// Finds the shapes of a taxel, and its gains and offset in each donning.
fn fit_taxel(donnings: &mut [Donning<'_>], taxel: usize, shapes: &mut [f64]) -> Result<(), ArtifactError> {
    let n_joints = donnings[0].n_joints;
    let width = n_joints * ARTIFACT_BASIS;
    let shapes = &mut shapes[taxel * width..(taxel + 1) * width];
    let sums: Vec<Sums> = donnings.iter().map(|donning| Sums::of(donning, taxel, width)).collect();
    for _ in 0..ROUNDS {
        let (mut left, mut right) = (DMatrix::zeros(width, width), DVector::zeros(width));
        for (donning, Sums { squares, products, .. }) in donnings.iter().zip(&sums) {
            let gain = |at: usize| donning.gains[taxel * n_joints + at / ARTIFACT_BASIS];
            left += DMatrix::from_fn(width, width, |row, column| gain(row) * gain(column) * squares[(row, column)]);
            right += DVector::from_fn(width, |row, _| gain(row) * products[row]);
        }
        let pull = WEIGHT_PULL * left.trace() / width as f64 + f64::MIN_POSITIVE;
        let found = solve(left, right, pull, taxel)?;
        shapes.copy_from_slice(found.as_slice());
        for (donning, Sums { squares, products, .. }) in donnings.iter_mut().zip(&sums) {
            let gains = &mut donning.gains[taxel * n_joints..(taxel + 1) * n_joints];
            let joint = |row: usize, column: usize| {
                let (rows, columns) = (row * ARTIFACT_BASIS, column * ARTIFACT_BASIS);
                let pairs = (0..ARTIFACT_BASIS).flat_map(|a| (0..ARTIFACT_BASIS).map(move |b| (rows + a, columns + b)));
                pairs.map(|(a, b)| shapes[a] * shapes[b] * squares[(a, b)]).sum::<f64>()
            };
            let left = DMatrix::from_fn(n_joints, n_joints, joint);
            let pull = GAIN_PULL * left.trace() / n_joints as f64 + f64::MIN_POSITIVE;
            let right = DVector::from_fn(n_joints, |row, _| {
                let of_joint = row * ARTIFACT_BASIS..(row + 1) * ARTIFACT_BASIS;
                of_joint.map(|at| shapes[at] * products[at]).sum::<f64>() + pull
            });
            gains.copy_from_slice(solve(left, right, pull, taxel)?.as_slice());
        }
        // The mean gain is 1 by definition: shapes take its size.
        for joint in 0..n_joints {
            let of = |donning: &Donning<'_>| donning.gains[taxel * n_joints + joint];
            let mean = donnings.iter().map(of).sum::<f64>() / donnings.len() as f64;
            if mean > 0.05 {
                donnings.iter_mut().for_each(|donning| donning.gains[taxel * n_joints + joint] /= mean);
                shapes[joint * ARTIFACT_BASIS..(joint + 1) * ARTIFACT_BASIS]
                    .iter_mut()
                    .for_each(|weight| *weight *= mean);
            }
        }
    }
    for (donning, Sums { means, mean, .. }) in donnings.iter_mut().zip(&sums) {
        let gain = |at: usize| donning.gains[taxel * n_joints + at / ARTIFACT_BASIS];
        donning.offset[taxel] = mean - (0..width).map(|at| gain(at) * shapes[at] * means[at]).sum::<f64>();
    }
    Ok(())
}

/// Sums over frames in the air that the rounds need of a taxel and a donning.
struct Sums {
    /// Of products of the basis functions, and of those with the taxel; all without their means.
    squares: DMatrix<f64>,
    products: DVector<f64>,
    /// Of the basis functions, and of the taxel.
    means: DVector<f64>,
    mean: f64,
}

impl Sums {
    fn of(donning: &Donning<'_>, taxel: usize, width: usize) -> Self {
        let frames: Vec<usize> = donning.air.iter().copied().step_by(STRIDE).collect();
        let n = frames.len() as f64;
        let (mut means, mut mean) = (DVector::zeros(width), 0.0);
        for &frame in &frames {
            means.iter_mut().zip(donning.basis(frame)).for_each(|(mean, value)| *mean += value / n);
            mean += donning.tactile(frame, taxel) / n;
        }
        let (mut squares, mut products) = (DMatrix::zeros(width, width), DVector::zeros(width));
        let mut centered = DVector::zeros(width);
        for &frame in &frames {
            let basis = donning.basis(frame).iter().zip(&means);
            centered.iter_mut().zip(basis).for_each(|(centered, (value, mean))| *centered = value - mean);
            squares.ger(1.0, &centered, &centered, 1.0);
            products.axpy(donning.tactile(frame, taxel) - mean, &centered, 1.0);
        }
        Sums { squares, products, means, mean }
    }
}

fn solve(mut left: DMatrix<f64>, right: DVector<f64>, pull: f64, taxel: usize) -> Result<DVector<f64>, ArtifactError> {
    (0..left.nrows()).for_each(|idx| left[(idx, idx)] += pull);
    let found = left.cholesky().map(|factors| factors.solve(&right));
    found.filter(|found| found.iter().all(|value| value.is_finite())).ok_or_else(|| {
        ArtifactError(format!("taxel {taxel} or the joints never move in the air, so nothing tells its artifact"))
    })
}

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
