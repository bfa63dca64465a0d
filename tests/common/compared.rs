//! Forces of two backends for the same model, beside each other.

use tactile_pose_fusion::fusion::{Contract, Forces, SharedWindows};
use tactile_pose_fusion::model::Model;

/// Windows that are compared, each a frame after the one before it.
const N: usize = 24;

/// What windows are made of: readings between two bounds, and angles up to one, from steps within the noise to what no
/// converter and no joint gives.
const SCALES: [([f32; 2], f32); 4] =
    [([0.0, 1.0], 0.01), ([-30.0, 30.0], 1.0), ([-4095.0, 4095.0], 20.0), ([-1e5, 1e5], 3.0)];

/// Frames with readings up to a size, of both signs where `both`, and angles within a limit.
pub struct Frames {
    pub tactile: Vec<f32>,
    pub pose: Vec<f32>,
}

pub fn frames(contract: &Contract, seed: usize, taxels: [f32; 2], angle: f32) -> Frames {
    let n_frames = N + contract.window.get() - 1;
    let unit = |at: usize| ((at * 7919 + seed * 104_729 + 13) as f64 * 0.754_877_666).fract() as f32;
    let tactile = (0..n_frames * contract.n_columns()).map(|at| taxels[0] + (taxels[1] - taxels[0]) * unit(at));
    let pose = (0..n_frames * contract.n_joints).map(|at| angle * (2.0 * unit(at + 1_000_003) - 1.0));
    Frames { tactile: tactile.collect(), pose: pose.collect() }
}

/// Forces in newtons.
pub fn forces(model: &mut Model, frames: &Frames) -> Vec<f64> {
    let starts: Vec<usize> = (0..N).collect();
    let mut forces = Forces::default();
    let windows = SharedWindows { starts: &starts, ids: &[], tactile: &frames.tactile, pose: &frames.pose };
    model.regressor.run(windows, &mut forces).unwrap();
    let unit = model.info.contract.unit;
    forces.force.iter().chain(&forces.base).map(|force| unit.to_newton(*force).0).collect()
}

pub fn farthest(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Whether two backends give the same forces at every scale, to a hundredth of a gram-force or what sums in another
/// order may make of them.
///
/// # Errors
/// How far apart they are, and where.
pub fn is_close(a: &mut Model, b: &mut Model) -> Result<(), String> {
    for (seed, (taxels, angle)) in SCALES.into_iter().enumerate() {
        let frames = frames(&a.info.contract, seed, taxels, angle);
        let (a, b) = (forces(a, &frames), forces(b, &frames));
        let largest = b.iter().fold(0.0f64, |largest, force| largest.max(force.abs()));
        let far = farthest(&a, &b);
        if far > 1e-4 + 2e-5 * largest {
            return Err(format!("{far} N of {largest} N at {taxels:?}"));
        }
    }
    Ok(())
}
