//! What donnings show over minutes: how far the zero of each taxel drifts, by how much more its offset differs after minutes than after
//! seconds; and what shapes have wrong, beside the noise of a frame.

use nalgebra::{DMatrix, DVector};

use super::DRIFT_TIME_S;
use super::donning::{Donning, STRIDE, dot};
use super::fit::ALIKE_FRAMES;

/// Time of one offset, s, and the frames in the air that it needs.
const BLOCK_S: f64 = 20.0;
const LEAST_FRAMES: usize = 300;

/// Two offsets that are no farther apart than the first, s, are near; those that are at least as far apart as the second are far.
const NEAR_S: f64 = 45.0;
const FAR_S: f64 = 120.0;

/// Keeps an offset bounded where nothing tells it, as a share of the certainty of one frame.
const LEAST_CERTAINTY: f64 = 1e-9;

/// Pairs of offsets: how many, half of the squares of their differences, and how alike a drift leaves them.
#[derive(Default)]
struct Pairs {
    n: f64,
    squares: f64,
    alike: f64,
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
    let (mut near, mut far) = (Pairs::default(), Pairs::default());
    for donning in donnings {
        let fit = TaxelFit {
            shapes: donning.shapes_of(taxel, shapes),
            gains: donning.gains_of(taxel),
            offset: donning.offset[taxel],
            residual,
            slip,
        };
        let offsets: Vec<(f64, f64)> = blocks(donning, taxel, &fit, rate_hz)
            .map(|block| (block.middle_s(rate_hz), block.change[donning.n_joints]))
            .collect();
        for (idx, (first_s, first)) in offsets.iter().enumerate() {
            for (other_s, other) in &offsets[idx + 1..] {
                let apart_s = other_s - first_s;
                let pairs = match apart_s {
                    _ if apart_s <= NEAR_S => &mut near,
                    _ if apart_s >= FAR_S => &mut far,
                    _ => continue,
                };
                pairs.n += 1.0;
                pairs.squares += 0.5 * (other - first).powi(2);
                pairs.alike += (-apart_s / DRIFT_TIME_S).exp();
            }
        }
    }
    if near.n == 0.0 || far.n == 0.0 {
        return 0.0;
    }
    // What two offsets differ by for other reasons than drift is the same for both.
    let more = far.squares / far.n - near.squares / near.n;
    (more / (near.alike / near.n - far.alike / far.n)).max(0.0).sqrt()
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
    of_air
        .filter(|air| air.len() >= LEAST_FRAMES)
        .filter_map(move |air| change(donning, taxel, fit, air).map(|change| Block { air, change }))
}

/// What the gains and 1 are multiplied with at a frame.
fn write_row(donning: &Donning<'_>, fit: &TaxelFit<'_>, frame: usize, row: &mut DVector<f64>) {
    let of_joints =
        donning.basis(frame).chunks_exact(donning.n_functions).zip(fit.shapes.chunks_exact(donning.n_functions));
    for (joint, (basis, shape)) in of_joints.enumerate() {
        row[joint] = fit.gains[joint] * dot(basis, shape);
    }
}

/// By how much gains, as shares of them, and the offset differ in these frames from those of the whole donning.
fn change(donning: &Donning<'_>, taxel: usize, fit: &TaxelFit<'_>, air: &[usize]) -> Option<DVector<f64>> {
    let joints = donning.n_joints;
    let mut row = DVector::from_element(joints + 1, 1.0);
    let (mut left, mut right) = (DMatrix::zeros(joints + 1, joints + 1), DVector::zeros(joints + 1));
    let weight = STRIDE as f64 / (fit.residual * ALIKE_FRAMES);
    for &frame in air.iter().step_by(STRIDE) {
        write_row(donning, fit, frame, &mut row);
        left.ger(weight, &row, &row, 1.0);
        let artifact = row.rows(0, joints).sum() + fit.offset;
        right.axpy(weight * (donning.tactile(frame, taxel) - artifact), &row, 1.0);
    }
    (0..joints).for_each(|joint| left[(joint, joint)] += fit.slip.powi(-2));
    left[(joints, joints)] += LEAST_CERTAINTY / fit.residual;
    Some(left.cholesky()?.solve(&right))
}

fn what_is_left(donning: &Donning<'_>, taxel: usize, fit: &TaxelFit<'_>, Block { air, change }: &Block<'_>) -> Left {
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
