//! Learns an artifact model from donnings: shapes that all of them share, by alternating least squares, and how gains vary.

use nalgebra::{DMatrix, DVector};

use super::donning::{AIR_DEVIATIONS, AIR_GF, AIR_S, Donning, DonningFrames, LIGHT_GF, STRIDE};
use super::drift;
use super::{ARTIFACT_BASIS, ArtifactError, ArtifactModel, HISTORY_S};

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
const SLIP: f64 = 0.3;
const SLIP_COMMON: f64 = 0.35;
const SLIP_TIME_S: f64 = 90.0;

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
    let drift = drift::learn(&donnings, &shapes, &residual, SLIP, rate_hz);
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
        drift,
        trust_inputs: false,
    };
    model.check()?;
    Ok(model)
}

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
