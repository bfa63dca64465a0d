//! What donnings show over minutes: how far gains slip and the zero of each taxel drifts, by how much more they differ after minutes than
//! after seconds; and what shapes have wrong, beside the noise of a frame.

use nalgebra::{DMatrix, DVector};

use super::DRIFT_TIME_S;
use super::donning::{Donning, STRIDE, dot};
use super::fit::ALIKE_FRAMES;

/// Time of one offset and its gains, s, and the frames in the air that they need.
const BLOCK_S: f64 = 20.0;
const LEAST_FRAMES: usize = 300;

/// Two blocks that are no farther apart than the first, s, are near; those that are at least as far apart as the second are far.
const NEAR_S: f64 = 45.0;
const FAR_S: f64 = 120.0;

/// Keeps an offset bounded where nothing tells it, as a share of the certainty of one frame.
const LEAST_CERTAINTY: f64 = 1e-9;

/// Pairs of blocks of a donning, for something that wanders in it.
#[derive(Default)]
struct Pairs {
    near: PairSums,
    far: PairSums,
}

/// How many pairs, half of the squares of their differences, and the part of the variance that these show.
#[derive(Default)]
struct PairSums {
    n: f64,
    squares: f64,
    shown: f64,
}

impl Pairs {
    /// Takes a pair that is so far apart, s, its difference, and the part of the variance that half of its square shows.
    fn add(&mut self, apart_s: f64, difference: f64, shown: f64) {
        let sums = match apart_s {
            _ if apart_s <= NEAR_S => &mut self.near,
            _ if apart_s >= FAR_S => &mut self.far,
            _ => return,
        };
        sums.n += 1.0;
        sums.squares += 0.5 * difference.powi(2);
        sums.shown += shown;
    }

    /// Standard deviation of what wanders; 0 where far pairs differ by no more than near ones. None without both.
    fn deviation(&self) -> Option<f64> {
        let Pairs { near, far } = self;
        if near.n == 0.0 || far.n == 0.0 {
            return None;
        }
        // What two blocks differ by for other reasons is the same for both.
        let more = far.squares / far.n - near.squares / near.n;
        let shown = far.shown / far.n - near.shown / near.n;
        (shown > 0.0).then(|| (more / shown).max(0.0).sqrt())
    }
}

/// What is known of a taxel in one donning.
pub(super) struct TaxelFit<'a> {
    /// `[joints, functions]`
    pub(super) shapes: &'a [f64],
    /// `[joints]`
    pub(super) gains: &'a [f64],
    pub(super) offset: f64,
    /// Variance of what shapes and constant gains don't explain.
    pub(super) residual: f64,
    /// Deviation of the slip, as a share of a gain.
    pub(super) slip: f64,
}

impl<'a> TaxelFit<'a> {
    /// By the shapes of all taxels, `[taxels, joints, functions]`, and what was fitted to the donning.
    fn of(donning: &'a Donning<'_>, taxel: usize, shapes: &'a [f64], residual: f64, slip: f64) -> Self {
        let (shapes, gains) = (donning.shapes_of(taxel, shapes), donning.gains_of(taxel));
        TaxelFit { shapes, gains, offset: donning.offset[taxel], residual, slip }
    }
}

/// What shapes leave of a taxel though gains and offset follow.
#[derive(Default, Clone, Copy)]
pub(super) struct Left {
    n: f64,
    squares: f64,
    n_pairs: f64,
    /// Half of the squares of its differences from frame to frame.
    differences: f64,
}

impl Left {
    pub(super) fn add(&mut self, other: Left) {
        self.n += other.n;
        self.squares += other.squares;
        self.n_pairs += other.n_pairs;
        self.differences += other.differences;
    }

    /// Variances of the noise of a frame, and of what shapes have wrong, which stays from one frame to the next. None without frames.
    pub(super) fn noise_and_misfit(&self) -> Option<(f64, f64)> {
        if self.n_pairs == 0.0 {
            return None;
        }
        let noise = self.differences / self.n_pairs;
        Some((noise.max(f64::MIN_POSITIVE.sqrt()), (self.squares / self.n - noise).max(0.0)))
    }
}

/// Some seconds of a taxel in the air, in which gains may have slipped: its frames, and by how much gains, as shares of them, and the offset
/// differ there from those of the whole donning.
struct Block<'d> {
    air: &'d [usize],
    change: DVector<f64>,
    /// `[joints + 1, joints + 1]`: the part of each true change that each of these has.
    told: DMatrix<f64>,
}

impl Block<'_> {
    /// Mean time of the frames, s.
    fn middle_s(&self, rate_hz: f64) -> f64 {
        self.air.iter().map(|frame| *frame as f64).sum::<f64>() / self.air.len() as f64 / rate_hz
    }
}

/// Standard deviation of each offset over many minutes, `[taxels]`, taxel units, with this variance of what shapes and gains don't
/// explain, and this deviation of the slip. Empty where the sessions are too short to tell.
pub(super) fn learn(donnings: &[Donning<'_>], shapes: &[f64], residual: &[f64], slip: f64, rate_hz: f64) -> Vec<f64> {
    let of_taxel = |(taxel, residual): (usize, &f64)| of_taxel(donnings, taxel, shapes, (*residual, slip), rate_hz);
    let drift: Vec<f64> = residual.iter().enumerate().map(of_taxel).collect();
    if drift.iter().any(|deviation| *deviation > 0.0) { drift } else { Vec::new() }
}

fn of_taxel(donnings: &[Donning<'_>], taxel: usize, shapes: &[f64], (residual, slip): (f64, f64), rate_hz: f64) -> f64 {
    let mut pairs = Pairs::default();
    for donning in donnings {
        let fit = TaxelFit::of(donning, taxel, shapes, residual, slip);
        let blocks: Vec<Block<'_>> = blocks(donning, taxel, &fit, rate_hz).collect();
        for (first, other) in pairs_of(&blocks) {
            let apart_s = other.middle_s(rate_hz) - first.middle_s(rate_hz);
            let difference = other.change[donning.n_joints] - first.change[donning.n_joints];
            pairs.add(apart_s, difference, 1.0 - (-apart_s / DRIFT_TIME_S).exp());
        }
    }
    pairs.deviation().unwrap_or(0.0)
}

/// Standard deviation of the slip of gains, as a share of a gain, where `slip` is assumed and the time constant is `time_s`. None where the
/// sessions are too short to tell.
pub(super) fn learn_slip(
    donnings: &[Donning<'_>],
    shapes: &[f64],
    residual: &[f64],
    (slip, time_s): (f64, f64),
    rate_hz: f64,
) -> Option<f64> {
    let mut pairs = Pairs::default();
    for donning in donnings {
        for (taxel, residual) in residual.iter().enumerate() {
            let fit = TaxelFit::of(donning, taxel, shapes, *residual, slip);
            let blocks: Vec<Block<'_>> = blocks(donning, taxel, &fit, rate_hz).collect();
            for (first, other) in pairs_of(&blocks) {
                let apart_s = other.middle_s(rate_hz) - first.middle_s(rate_hz);
                let alike = (-apart_s / time_s).exp();
                for joint in 0..donning.n_joints {
                    let shown = |of: usize| {
                        let (first, other) = (first.told[(joint, of)], other.told[(joint, of)]);
                        0.5 * (first * first + other * other) - alike * first * other
                    };
                    let difference = other.change[joint] - first.change[joint];
                    pairs.add(apart_s, difference, (0..donning.n_joints).map(shown).sum());
                }
            }
        }
    }
    pairs.deviation()
}

fn pairs_of<T>(blocks: &[T]) -> impl Iterator<Item = (&T, &T)> {
    blocks.iter().enumerate().flat_map(|(idx, first)| blocks[idx + 1..].iter().map(move |other| (first, other)))
}

/// What a donning leaves of a taxel, where gains and offset follow it.
pub(super) fn left(donning: &Donning<'_>, taxel: usize, fit: &TaxelFit<'_>, rate_hz: f64) -> Left {
    let mut sum = Left::default();
    blocks(donning, taxel, fit, rate_hz).for_each(|block| sum.add(what_is_left(donning, taxel, fit, &block)));
    sum
}

/// Each block of a taxel with enough frames in the air.
fn blocks<'d>(
    donning: &'d Donning<'_>,
    taxel: usize,
    fit: &TaxelFit<'_>,
    rate_hz: f64,
) -> impl Iterator<Item = Block<'d>> {
    let block_of = move |frame: usize| (frame as f64 / rate_hz / BLOCK_S) as usize;
    let of_air = donning.air.chunk_by(move |frame, next| block_of(*frame) == block_of(*next));
    of_air.filter(|air| air.len() >= LEAST_FRAMES).filter_map(move |air| block(donning, taxel, fit, air))
}

/// What the gains and 1 are multiplied with at a frame.
fn write_row(donning: &Donning<'_>, fit: &TaxelFit<'_>, frame: usize, row: &mut DVector<f64>) {
    let of_joints =
        donning.basis(frame).chunks_exact(donning.n_functions).zip(fit.shapes.chunks_exact(donning.n_functions));
    for (joint, (basis, shape)) in of_joints.enumerate() {
        row[joint] = fit.gains[joint] * dot(basis, shape);
    }
}

/// The block of these frames. None where readings are beyond what can be solved.
fn block<'d>(donning: &Donning<'_>, taxel: usize, fit: &TaxelFit<'_>, air: &'d [usize]) -> Option<Block<'d>> {
    let joints = donning.n_joints;
    let mut row = DVector::from_element(joints + 1, 1.0);
    let (mut seen, mut right) = (DMatrix::zeros(joints + 1, joints + 1), DVector::zeros(joints + 1));
    let weight = STRIDE as f64 / (fit.residual * ALIKE_FRAMES);
    for &frame in air.iter().step_by(STRIDE) {
        write_row(donning, fit, frame, &mut row);
        seen.ger(weight, &row, &row, 1.0);
        let artifact = row.rows(0, joints).sum() + fit.offset;
        right.axpy(weight * (donning.tactile(frame, taxel) - artifact), &row, 1.0);
    }
    let mut left = seen.clone();
    (0..joints).for_each(|joint| left[(joint, joint)] += fit.slip.powi(-2));
    left[(joints, joints)] += LEAST_CERTAINTY / fit.residual;
    let factors = left.cholesky()?;
    Some(Block { air, change: factors.solve(&right), told: factors.solve(&seen) })
}

fn what_is_left(
    donning: &Donning<'_>,
    taxel: usize,
    fit: &TaxelFit<'_>,
    Block { air, change, .. }: &Block<'_>,
) -> Left {
    let joints = donning.n_joints;
    let mut row = DVector::from_element(joints + 1, 1.0);
    let mut at = |frame: usize| {
        write_row(donning, fit, frame, &mut row);
        donning.tactile(frame, taxel) - row.rows(0, joints).sum() - fit.offset - row.dot(change)
    };
    let mut sum = Left::default();
    for idx in (0..air.len()).step_by(STRIDE) {
        let left = at(air[idx]);
        sum.n += 1.0;
        sum.squares += left * left;
        if air.get(idx + 1) == Some(&(air[idx] + 1)) {
            sum.n_pairs += 1.0;
            sum.differences += 0.5 * (at(air[idx + 1]) - left).powi(2);
        }
    }
    sum
}
