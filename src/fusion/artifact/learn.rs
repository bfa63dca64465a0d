//! Learns an artifact model from donnings: shapes that all of them share, by alternating least squares, and how gains vary.

use nalgebra::{DMatrix, DVector};

use super::donning::{AIR_DEVIATIONS, AIR_GF, AIR_S, Donning, DonningFrames, LIGHT_GF, STRIDE};
use super::drift::{self, Left, TaxelFit};
use super::{ArtifactError, ArtifactModel, FRICTIONLESS_BASIS, HISTORY_S};

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

/// How gains change within a donning: by this standard deviation, as a share of a gain, where training does not tell it.
const SLIP: f64 = 0.3;
const SLIP_COMMON: f64 = 0.35;
const SLIP_TIME_S: f64 = 90.0;

/// The slip of a glove that is worn, in that of the training sessions, which are made with care, and its bounds: worn, it slips at once, too.
/// Chosen on validation data (docs/validation).
const WORN_SLIP: f64 = 1.5;
const SLIP_BOUNDS: (f64, f64) = (0.1, 0.8);

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
    // One donning does not tell friction from how its gains slip.
    if let [donning] = donnings.as_mut_slice() {
        donning.keep_functions(FRICTIONLESS_BASIS);
    }
    let n_functions = donnings[0].n_functions;
    let width = n_joints * n_functions;
    let mut shapes = vec![0.0; n_taxels * width];
    let sums: Vec<Vec<Sums>> =
        (0..n_taxels).map(|taxel| donnings.iter().map(|donning| Sums::of(donning, taxel)).collect()).collect();
    for (taxel, (sums, of_taxel)) in sums.iter().zip(shapes.chunks_exact_mut(width)).enumerate() {
        let (found, gains) = shapes_and_gains(sums.iter(), (n_joints, n_functions), taxel)?;
        of_taxel.copy_from_slice(found.as_slice());
        for ((donning, sums), gains) in donnings.iter_mut().zip(sums).zip(&gains) {
            donning.gains[taxel * n_joints..(taxel + 1) * n_joints].copy_from_slice(gains.as_slice());
            donning.offset[taxel] = sums.offset(of_taxel, gains);
        }
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
    // The shapes of one donning have taken a part of its slip.
    let learned = drift::learn_slip(&donnings, &shapes, &residual, (SLIP, SLIP_TIME_S), rate_hz);
    let learned = learned.filter(|_| donnings.len() > 1);
    let slip = learned.map_or(SLIP, |slip| slip.clamp(SLIP_BOUNDS.0 / WORN_SLIP, SLIP_BOUNDS.1 / WORN_SLIP));
    let drift = drift::learn(&donnings, &shapes, &residual, slip, rate_hz);
    let (noise, misfit) = noise_and_misfit(&donnings, &sums, &residual, slip, rate_hz)?;
    let uncertain_offsets = !drift.is_empty() && !noise.is_empty();
    let model = ArtifactModel {
        n_taxels,
        n_joints,
        gain_variance,
        slip: learned.map_or(SLIP, |_| WORN_SLIP * slip),
        slip_common: SLIP_COMMON,
        slip_time_s: SLIP_TIME_S,
        touch,
        residual,
        shapes,
        drift,
        noise,
        misfit,
        uncertain_offsets,
        trust_inputs: false,
    };
    model.check()?;
    Ok(model)
}

/// Variances of the noise of a frame and of what shapes have wrong, `[taxels]` each: in each donning, for shapes of the others, because
/// shapes fit the donnings that they were learned from better than any new one. Empty where there are no others, or too few frames.
fn noise_and_misfit(
    donnings: &[Donning<'_>],
    sums: &[Vec<Sums>],
    residual: &[f64],
    slip: f64,
    rate_hz: f64,
) -> Result<(Vec<f64>, Vec<f64>), ArtifactError> {
    let (mut noise, mut misfit) = (Vec::new(), Vec::new());
    if donnings.len() < 2 {
        return Ok((noise, misfit));
    }
    for (taxel, (sums, residual)) in sums.iter().zip(residual).enumerate() {
        let mut left = Left::default();
        for (idx, (donning, of_donning)) in donnings.iter().zip(sums).enumerate() {
            let others = sums.iter().enumerate().filter(|(other, _)| *other != idx).map(|(_, sums)| sums);
            let (shapes, _) = shapes_and_gains(others, (donning.n_joints, donning.n_functions), taxel)?;
            let shapes = shapes.as_slice();
            let gains = of_donning.gains(shapes, donning.n_joints, taxel)?;
            let offset = of_donning.offset(shapes, &gains);
            let fit = TaxelFit { shapes, gains: gains.as_slice(), offset, residual: *residual, slip };
            left.add(drift::left(donning, taxel, &fit, rate_hz));
        }
        let Some((of_frame, of_shapes)) = left.noise_and_misfit() else { return Ok((Vec::new(), Vec::new())) };
        noise.push(of_frame);
        misfit.push(of_shapes);
    }
    Ok((noise, misfit))
}

/// The shapes of a taxel, `[joints, functions]`, and its gains in each donning, by the sums of these.
fn shapes_and_gains<'s>(
    sums: impl Iterator<Item = &'s Sums> + Clone,
    (n_joints, n_functions): (usize, usize),
    taxel: usize,
) -> Result<(DVector<f64>, Vec<DVector<f64>>), ArtifactError> {
    let width = n_joints * n_functions;
    let mut shapes = DVector::zeros(width);
    let mut gains: Vec<DVector<f64>> = sums.clone().map(|_| DVector::from_element(n_joints, 1.0)).collect();
    for _ in 0..ROUNDS {
        let (mut left, mut right) = (DMatrix::zeros(width, width), DVector::zeros(width));
        for (gains, Sums { squares, products, .. }) in gains.iter().zip(sums.clone()) {
            let gain = |at: usize| gains[at / n_functions];
            left += DMatrix::from_fn(width, width, |row, column| gain(row) * gain(column) * squares[(row, column)]);
            right += DVector::from_fn(width, |row, _| gain(row) * products[row]);
        }
        let pull = WEIGHT_PULL * left.trace() / width as f64 + f64::MIN_POSITIVE;
        shapes = solve(left, right, pull, taxel)?;
        for (gains, sums) in gains.iter_mut().zip(sums.clone()) {
            *gains = sums.gains(shapes.as_slice(), n_joints, taxel)?;
        }
        // The mean gain is 1 by definition: shapes take its size.
        for joint in 0..n_joints {
            let mean = gains.iter().map(|gains| gains[joint]).sum::<f64>() / gains.len() as f64;
            if mean > 0.05 {
                gains.iter_mut().for_each(|gains| gains[joint] /= mean);
                let of_joint = joint * n_functions..(joint + 1) * n_functions;
                shapes.as_mut_slice()[of_joint].iter_mut().for_each(|weight| *weight *= mean);
            }
        }
    }
    Ok((shapes, gains))
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
    fn of(donning: &Donning<'_>, taxel: usize) -> Self {
        let width = donning.n_joints * donning.n_functions;
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

    /// The gains of the donning, `[joints]`, for these shapes.
    fn gains(&self, shapes: &[f64], n_joints: usize, taxel: usize) -> Result<DVector<f64>, ArtifactError> {
        let n = shapes.len() / n_joints;
        let joint = |row: usize, column: usize| {
            let (rows, columns) = (row * n, column * n);
            let pairs = (0..n).flat_map(|a| (0..n).map(move |b| (rows + a, columns + b)));
            pairs.map(|(a, b)| shapes[a] * shapes[b] * self.squares[(a, b)]).sum::<f64>()
        };
        let left = DMatrix::from_fn(n_joints, n_joints, joint);
        let pull = GAIN_PULL * left.trace() / n_joints as f64 + f64::MIN_POSITIVE;
        let right = DVector::from_fn(n_joints, |row, _| {
            let of_joint = row * n..(row + 1) * n;
            of_joint.map(|at| shapes[at] * self.products[at]).sum::<f64>() + pull
        });
        solve(left, right, pull, taxel)
    }

    /// The offset of the donning for these shapes and gains.
    fn offset(&self, shapes: &[f64], gains: &DVector<f64>) -> f64 {
        let n = shapes.len() / gains.len();
        let weights = shapes.iter().enumerate().map(|(at, shape)| gains[at / n] * shape);
        self.mean - weights.zip(&self.means).map(|(weight, mean)| weight * mean).sum::<f64>()
    }
}

fn solve(mut left: DMatrix<f64>, right: DVector<f64>, pull: f64, taxel: usize) -> Result<DVector<f64>, ArtifactError> {
    (0..left.nrows()).for_each(|idx| left[(idx, idx)] += pull);
    let found = left.cholesky().map(|factors| factors.solve(&right));
    found.filter(|found| found.iter().all(|value| value.is_finite())).ok_or_else(|| {
        ArtifactError(format!("taxel {taxel} or the joints never move in the air, so nothing tells its artifact"))
    })
}
