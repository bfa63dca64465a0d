//! Windows that a network computed here and its runtime are both tried on at load.

use super::super::probe::Lcg;
use crate::fusion::{Contract, Forces, SharedWindows};

/// Windows of the trial: enough frames for every scale of readings.
const N_TRIAL: usize = 64;

/// Our own code adds in another order than a runtime does.
const TOLERANCE: f32 = 1e-4; // of the largest force of the trial

/// The largest force of the trial counts as at least this, in the model's unit.
const SMALLEST_SCALE: f32 = 0.1;

/// Readings of the trial, one scale after the other: at rest, small, and as large as sensors count.
const TRIAL_SCALES: [f32; 4] = [0.0, 1.0, 50.0, 2000.0];

/// Whether forces are the same but for rounding; how far apart they are, where they aren't.
pub(super) fn differ(runtime: &Forces, own: &Forces) -> Result<(), String> {
    let all = |forces: &Forces| forces.force.iter().chain(&forces.base).copied().collect::<Vec<f32>>();
    let (runtime, own) = (all(runtime), all(own));
    let scale = runtime.iter().fold(SMALLEST_SCALE, |scale, force| scale.max(force.abs()));
    for (expected, got) in runtime.iter().zip(&own) {
        let distance = (expected - got).abs();
        if distance.is_nan() || distance > TOLERANCE * scale {
            return Err(format!("our own code gives {got} where the runtime gives {expected}"));
        }
    }
    Ok(())
}

/// Overlapping windows of made-up frames, the same at every start.
pub(super) struct Trial {
    starts: Vec<usize>,
    tactile: Vec<f32>,
    pose: Vec<f32>,
}

impl Trial {
    pub(super) fn new(contract: &Contract) -> Self {
        let mut random = Lcg::new();
        let n_frames = N_TRIAL + contract.window - 1;
        let scale = |frame: usize| TRIAL_SCALES[frame * TRIAL_SCALES.len() / n_frames];
        let ranges = contract.pose_range.as_deref().unwrap_or_default();
        let range = |joint: usize| ranges.get(joint).map_or((-0.5, 0.5), |range| (range.min as f32, range.max as f32));
        let tactile = (0..n_frames * contract.n_taxels).map(|at| scale(at / contract.n_taxels) * random.next_unit());
        let tactile = tactile.collect();
        let pose = (0..n_frames * contract.n_joints).map(|at| {
            let (min, max) = range(at % contract.n_joints);
            min + (max - min) * random.next_unit()
        });
        Trial { starts: (0..N_TRIAL).collect(), tactile, pose: pose.collect() }
    }

    pub(super) fn windows(&self) -> SharedWindows<'_> {
        SharedWindows { starts: &self.starts, tactile: &self.tactile, pose: &self.pose }
    }
}
