//! Trial runs when a model is loaded. They check what the file can't guarantee, on windows that are the same at every
//! start.

use std::path::Path;

use super::contract::Terms;
use super::error::ModelError;
use super::session::InferenceSession;
use super::trial::{Frames, SCALES, Scale};
use crate::fusion::{Contract, SharedWindows};

/// Number of windows in a trial batch.
const N: usize = 3;

/// Forces in batches of 1 and of 3 may differ by rounding, because kernels for other sizes add in another order.
/// Share of the largest force of the trial, or of the force that its readings would have by the steepest slope of all trials.
const BATCH_TOLERANCE: f32 = 1e-4;

/// Readings up to this size give log odds of touch whose rounding changes no probability by more than the tolerance.
const USUAL_READING: f32 = 4095.0;

/// A base that doesn't depend on the pose has the same bits for any pose. The tolerance leaves room for graph
/// optimizers.
const BASE_TOLERANCE: f32 = 1e-6; // of the largest force of the trial

/// Lower limit on the largest force of a trial, in the model's unit. A model that gives zero for small windows does so
/// by terms that cancel, and only their rounding errors remain.
const SMALLEST_SCALE: f32 = 0.1;

/// Descriptions of the trial windows, for messages.
const WINDOW_NAMES: [&str; N] = ["a small trial window", "a window of zeros", "a second small trial window"];

/// Runs the trials, with readings and poses of every scale. Returns notes for
/// [`ModelInfo::notes`](super::ModelInfo::notes).
///
/// # Errors
/// [`ModelError::Runtime`], [`ModelError::NonFiniteOutput`], [`ModelError::NoProbability`], [`ModelError::MixesWindows`],
/// [`ModelError::Convention`].
pub(super) fn check(path: &Path, session: &mut InferenceSession, terms: &Terms) -> Result<Vec<String>, ModelError> {
    let (mut base_moves, mut notes, mut slope) = (false, Vec::new(), 0.0_f32);
    for (idx, scale) in SCALES.iter().enumerate() {
        let trial = Trial::new(&terms.contract, scale);
        let names = terms.tensors.outputs();
        let batched = match run(path, session, names.len(), trial.batch()) {
            Ok(batched) => batched,
            Err(refused) if idx == 0 => return Err(refused),
            Err(_) => continue, // a model that refuses such readings gives no wrong force
        };
        if idx == 0 {
            check_finite(path, &names, &batched)?;
        }
        let mut outputs = names.iter().zip(&batched);
        if let Some((name, _)) = outputs.find(|(_, output)| output.iter().any(|value| !value.is_finite()))
            && notes.is_empty()
        {
            let scale = scale.name;
            notes.push(format!(
                "output {name} is no finite number with {scale} readings: such estimates are flagged NON_FINITE"
            ));
        }
        let touch_idx = terms.tensors.touch_idx();
        if let Some(touch_idx) = touch_idx {
            check_probability(path, &names[touch_idx], &batched[touch_idx])?;
        }
        let forces = batched.iter().enumerate().filter(|(idx, _)| Some(*idx) != touch_idx);
        let forces: Vec<&Vec<f32>> = forces.map(|(_, output)| output).collect();
        if scale.most() >= 1.0 {
            slope = forces.iter().fold(slope, |slope, output| slope.max(moved_from_zero(output) / scale.most()));
        }
        let finite = forces.into_iter().flatten().filter(|value| value.is_finite());
        let largest = finite.fold(SMALLEST_SCALE, |largest, value| largest.max(value.abs()));
        // Terms that large may cancel, and rounding is a share of the terms.
        let largest_terms = largest.max(slope * scale.most());
        let largest_odds = (scale.most() / USUAL_READING).max(1.0);
        for window_idx in 0..N {
            let alone = run(path, session, names.len(), trial.window(window_idx))?;
            for (idx, ((name, batched), alone)) in names.iter().zip(&batched).zip(&alone).enumerate() {
                let size = if Some(idx) == touch_idx { largest_odds } else { largest_terms };
                let batched = batched.chunks(session.axes_of(idx)).nth(window_idx).unwrap_or_default();
                let mut pairs = batched.iter().copied().zip(alone.iter().copied());
                if let Some((batched, alone)) =
                    pairs.find(|(batched, alone)| differ(*batched, *alone, BATCH_TOLERANCE * size))
                {
                    let (path, output, scale) = (path.to_path_buf(), name.clone(), scale.name);
                    return Err(ModelError::MixesWindows { path, output, scale, alone, batched });
                }
            }
        }
        let base_idx = terms.tensors.base_idx();
        if let (Some(base), Some(residual), Some(base_idx)) = (&terms.tensors.base, &terms.tensors.residual, base_idx) {
            let outputs = [&batched[0], &batched[base_idx], &batched[base_idx + 1]];
            check_convention(path, &names[0], base, residual, outputs, largest)?;
        }
        if let Some(base_idx) = base_idx.filter(|_| terms.contract.n_joints > 0) {
            let moved = run(path, session, names.len(), trial.batch_with_other_poses())?;
            let mut pairs = moved[base_idx].iter().zip(&batched[base_idx]);
            base_moves |= pairs.any(|(moved, base)| differ(*moved, *base, BASE_TOLERANCE * largest));
        }
    }
    if let Some(base) = terms.tensors.base.as_ref().filter(|_| base_moves) {
        session.drop_base();
        notes.push(format!(
            "output {base} moves when only the pose moves, so it can't stand in when the pose is stale: it is not used"
        ));
    }
    Ok(notes)
}

fn check_finite(path: &Path, names: &[String], outputs: &[Vec<f32>]) -> Result<(), ModelError> {
    for (name, output) in names.iter().zip(outputs) {
        if let Some((idx, value)) = output.iter().enumerate().find(|(_, value)| !value.is_finite()) {
            return Err(ModelError::NonFiniteOutput {
                path: path.to_path_buf(),
                output: name.clone(),
                value: *value,
                window: WINDOW_NAMES[idx * N / output.len()].to_string(),
            });
        }
    }
    Ok(())
}

/// A touch output must be a probability, not the value before the sigmoid.
fn check_probability(path: &Path, name: &str, output: &[f32]) -> Result<(), ModelError> {
    let is_probability = |value: &&f32| !value.is_finite() || (0.0..=1.0).contains(*value);
    match output.iter().find(|value| !is_probability(value)) {
        None => Ok(()),
        Some(&value) => Err(ModelError::NoProbability { path: path.to_path_buf(), output: name.to_owned(), value }),
    }
}

fn run(
    path: &Path,
    session: &mut InferenceSession,
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

/// True if two forces differ by more than `tolerance`, or if only one of them is finite.
fn differ(a: f32, b: f32, tolerance: f32) -> bool {
    match (a.is_finite(), b.is_finite()) {
        (true, true) => (a - b).abs() > tolerance,
        (a, b) => a != b,
    }
}

/// How far the largest force of a batch lies from that of its window of zeros.
fn moved_from_zero(output: &[f32]) -> f32 {
    let of_window = output.len() / N;
    let zero = output[of_window..].iter().take(of_window).cycle();
    let moved = output.iter().zip(zero).map(|(force, zero)| (force - zero).abs());
    moved.filter(|moved| moved.is_finite()).fold(0.0, f32::max)
}

/// Checks the paper's convention: the residual branch predicts the artifact, which is subtracted.
fn check_convention(
    path: &Path,
    force: &str,
    base: &str,
    residual: &str,
    [forces, bases, residuals]: [&Vec<f32>; 3],
    scale: f32,
) -> Result<(), ModelError> {
    let far = |a: f32, b: f32| differ(a, b, BATCH_TOLERANCE * scale);
    // Of each window, or of each axis of it.
    let windows = forces.iter().zip(bases).zip(residuals).map(|((force, base), residual)| [*force, *base, *residual]);
    let windows: Vec<[f32; 3]> = windows.collect();
    // Where one of them is no number, nothing says how they belong together.
    let windows: Vec<[f32; 3]> =
        windows.into_iter().filter(|window| window.iter().all(|value| value.is_finite())).collect();
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

/// Windows of one scale. One of them is zero, like a hand in the air.
struct Trial {
    starts: [usize; N],
    frames: Frames,
    other_pose: Vec<f32>,
}

impl Trial {
    fn new(contract: &Contract, scale: &Scale) -> Self {
        let mut frames = Frames::new(contract, scale, N * contract.window.get());
        let of_one = |width: usize| contract.window.get() * width;
        let other_pose = {
            let mut pose = frames.pose.clone();
            pose.rotate_left(of_one(contract.n_joints));
            pose
        };
        for (values, n) in
            [(&mut frames.tactile, of_one(contract.n_columns())), (&mut frames.pose, of_one(contract.n_joints))]
        {
            values[n..2 * n].fill(0.0);
        }
        Trial { starts: std::array::from_fn(|idx| idx * contract.window.get()), frames, other_pose }
    }

    fn batch(&self) -> SharedWindows<'_> {
        self.frames.windows(&self.starts)
    }

    fn batch_with_other_poses(&self) -> SharedWindows<'_> {
        SharedWindows { pose: &self.other_pose, ..self.batch() }
    }

    fn window(&self, idx: usize) -> SharedWindows<'_> {
        let part = |values: &'_ [f32]| idx * (values.len() / N)..(idx + 1) * (values.len() / N);
        let Frames { tactile, pose } = &self.frames;
        SharedWindows { starts: &[0], ids: &[], tactile: &tactile[part(tactile)], pose: &pose[part(pose)] }
    }
}
