//! Trial runs at load: what a file can't promise is tried once, on windows that are the same at every start.

use std::path::Path;

use super::contract::Terms;
use super::error::ModelError;
use super::session::Session;
use crate::fusion::{Contract, SharedWindows};

/// Windows of a trial batch.
const N: usize = 3;

/// Batch 1 and batch 3 may differ by float rounding: kernels for other sizes add in another order.
const BATCH_TOLERANCE: f32 = 1e-4; // of the largest force of the trial

/// A base that truly has no path from the pose comes out bit by bit the same; this leaves room for graph optimizers.
const BASE_TOLERANCE: f32 = 1e-6; // of the largest force of the trial

/// The largest force of the trial counts as at least this, in the model's unit: a model that says zero to small windows
/// does so by terms that cancel, and what is left is their rounding.
const SMALLEST_SCALE: f32 = 0.1;

/// What the trial windows are, for people.
const WINDOW_NAMES: [&str; N] = ["a small trial window", "a window of zeros", "a second small trial window"];

/// Runs the trials. The notes that come back are for [`ModelInfo::notes`](super::ModelInfo::notes).
///
/// # Errors
/// [`ModelError::Runtime`], [`ModelError::NonFiniteOutput`], [`ModelError::MixesWindows`], [`ModelError::Convention`].
pub(super) fn check(path: &Path, session: &mut Session, terms: &Terms) -> Result<Vec<String>, ModelError> {
    let names = terms.tensors.outputs();
    let trial = Trial::new(&terms.contract);
    let batched = run(path, session, names.len(), trial.batch())?;
    for (name, output) in names.iter().zip(&batched) {
        if let Some((idx, value)) = output.iter().enumerate().find(|(_, value)| !value.is_finite()) {
            return Err(ModelError::NonFiniteOutput {
                path: path.to_path_buf(),
                output: name.clone(),
                value: *value,
                window: WINDOW_NAMES[idx].to_string(),
            });
        }
    }
    let scale = batched.iter().flatten().fold(SMALLEST_SCALE, |scale, value| scale.max(value.abs()));

    for window_idx in 0..N {
        let alone = run(path, session, names.len(), trial.window(window_idx))?;
        for ((name, batched), alone) in names.iter().zip(&batched).zip(&alone) {
            let (batched, alone) = (batched[window_idx], alone[0]);
            if differ(batched, alone, BATCH_TOLERANCE * scale) {
                return Err(ModelError::MixesWindows {
                    path: path.to_path_buf(),
                    output: name.clone(),
                    alone,
                    batched,
                });
            }
        }
    }

    let mut notes = Vec::new();
    if let Some(base_name) = &terms.tensors.base {
        if let Some(residual_name) = &terms.tensors.residual {
            check_convention(path, &names[0], base_name, residual_name, &batched, scale)?;
        }
        if terms.contract.n_joints > 0 {
            let moved = run(path, session, names.len(), trial.batch_with_other_poses())?;
            if moved[1].iter().zip(&batched[1]).any(|(moved, base)| differ(*moved, *base, BASE_TOLERANCE * scale)) {
                session.drop_base();
                notes.push(format!(
                    "output {base_name} moves when only the pose moves, so it can't stand in when the pose is stale: it is not used"
                ));
            }
        }
    }
    Ok(notes)
}

fn run(
    path: &Path,
    session: &mut Session,
    n_outputs: usize,
    windows: SharedWindows<'_>,
) -> Result<Vec<Vec<f32>>, ModelError> {
    let mut outputs = vec![Vec::new(); n_outputs];
    let ran = session.infer(windows, &mut outputs);
    ran.map_err(|said| ModelError::Runtime {
        path: path.to_path_buf(),
        reason: format!("a trial run of {} windows failed: {said}", windows.starts.len()),
    })?;
    Ok(outputs)
}

/// Whether two forces lie further apart than `tolerance`; a NaN differs from everything.
fn differ(a: f32, b: f32, tolerance: f32) -> bool {
    let distance = (a - b).abs();
    distance.is_nan() || distance > tolerance
}

/// The paper's convention: what the residual branch predicts is the artifact, and it is taken away.
fn check_convention(
    path: &Path,
    force: &str,
    base: &str,
    residual: &str,
    outputs: &[Vec<f32>],
    scale: f32,
) -> Result<(), ModelError> {
    let [forces, bases, residuals] = outputs else { return Ok(()) };
    let far = |a: f32, b: f32| differ(a, b, BATCH_TOLERANCE * scale);
    let windows: Vec<[f32; 3]> = (0..N).map(|idx| [forces[idx], bases[idx], residuals[idx]]).collect();
    let Some([got, b, r]) = windows.iter().copied().find(|[f, b, r]| far(*f, b - r)) else { return Ok(()) };
    let added = windows.iter().all(|[f, b, r]| !far(*f, b + r));
    Err(ModelError::Convention {
        path: path.to_path_buf(),
        force: force.to_string(),
        base: base.to_string(),
        residual: residual.to_string(),
        got,
        expected: b - r,
        hint: if added { "; this one adds its residual: export it with the other sign" } else { "" },
    })
}

/// Pseudo-random windows, the same at every start, with one of zeros among them: a hand in the air.
struct Trial {
    starts: [usize; N],
    tactile: Vec<f32>,
    pose: Vec<f32>,
    other_pose: Vec<f32>,
}

impl Trial {
    fn new(contract: &Contract) -> Self {
        let mut random = Lcg::new();
        let n_tactile = contract.window * contract.n_taxels;
        let n_pose = contract.window * contract.n_joints;
        let mut tactile: Vec<f32> = (0..N * n_tactile).map(|_| random.next_unit()).collect();
        let mut pose: Vec<f32> = (0..N * n_pose)
            .map(|idx| {
                let joint = idx % contract.n_joints;
                let range = contract.pose_range.as_ref().and_then(|ranges| ranges.get(joint));
                let (min, max) = range.map_or((-0.5, 0.5), |range| (range.min as f32, range.max as f32));
                min + (max - min) * random.next_unit()
            })
            .collect();
        let mut other_pose = pose.clone();
        other_pose.rotate_left(n_pose);
        tactile[n_tactile..2 * n_tactile].fill(0.0);
        pose[n_pose..2 * n_pose].fill(0.0);
        Trial { starts: std::array::from_fn(|idx| idx * contract.window), tactile, pose, other_pose }
    }

    fn batch(&self) -> SharedWindows<'_> {
        SharedWindows { starts: &self.starts, tactile: &self.tactile, pose: &self.pose }
    }

    fn batch_with_other_poses(&self) -> SharedWindows<'_> {
        SharedWindows { starts: &self.starts, tactile: &self.tactile, pose: &self.other_pose }
    }

    fn window(&self, idx: usize) -> SharedWindows<'_> {
        let part = |values: &'_ [f32]| idx * (values.len() / N)..(idx + 1) * (values.len() / N);
        SharedWindows { starts: &[0], tactile: &self.tactile[part(&self.tactile)], pose: &self.pose[part(&self.pose)] }
    }
}

/// Knuth's 64-bit linear congruential generator: enough for trial windows, and the same everywhere.
pub(super) struct Lcg(u64);

impl Lcg {
    /// The same at every start.
    pub(super) fn new() -> Self {
        Lcg(0x7470_665f_7472_6961)
    }

    /// A number in `[0, 1)`.
    pub(super) fn next_unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u32 << 24) as f32 // the top 24 bits, exact in f32
    }
}
