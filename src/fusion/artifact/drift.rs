//! Learns from donnings how far the zero of each taxel drifts: by how much more its offset differs after minutes than after seconds.

use nalgebra::{DMatrix, DVector};

use super::donning::{Donning, STRIDE, dot};
use super::fit::ALIKE_FRAMES;
use super::{ARTIFACT_BASIS, DRIFT_TIME_S};

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
        let offsets = offsets(donning, taxel, shapes, (residual, slip), rate_hz);
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

/// The offset of a taxel in each block with enough frames in the air, beyond that of the whole donning, and the mean time of
/// these frames, s. Gains may have slipped in each block.
fn offsets(
    donning: &Donning<'_>,
    taxel: usize,
    shapes: &[f64],
    (residual, slip): (f64, f64),
    rate_hz: f64,
) -> Vec<(f64, f64)> {
    let (shapes, joints) = (donning.shapes_of(taxel, shapes), donning.n_joints);
    let block_of = |frame: usize| (frame as f64 / rate_hz / BLOCK_S) as usize;
    let width = joints + 1;
    let mut row = DVector::from_element(width, 1.0);
    let mut offsets = Vec::new();
    for air in donning.air.chunk_by(|frame, next| block_of(*frame) == block_of(*next)) {
        if air.len() < LEAST_FRAMES {
            continue;
        }
        let (mut left, mut right) = (DMatrix::zeros(width, width), DVector::zeros(width));
        let weight = STRIDE as f64 / (residual * ALIKE_FRAMES);
        for &frame in air.iter().step_by(STRIDE) {
            let of_joints = donning.basis(frame).chunks_exact(ARTIFACT_BASIS).zip(shapes.chunks_exact(ARTIFACT_BASIS));
            for (joint, (basis, shape)) in of_joints.enumerate() {
                row[joint] = donning.gains[taxel * joints + joint] * dot(basis, shape);
            }
            left.ger(weight, &row, &row, 1.0);
            let artifact = row.rows(0, joints).sum() + donning.offset[taxel];
            right.axpy(weight * (donning.tactile(frame, taxel) - artifact), &row, 1.0);
        }
        (0..joints).for_each(|joint| left[(joint, joint)] += slip.powi(-2));
        left[(joints, joints)] += LEAST_CERTAINTY / residual;
        if let Some(found) = left.cholesky().map(|factors| factors.solve(&right)) {
            let middle = air.iter().map(|frame| *frame as f64).sum::<f64>() / air.len() as f64;
            offsets.push((middle / rate_hz, found[joints]));
        }
    }
    offsets
}
