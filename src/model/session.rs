//! A model in a runtime. Large calls are split into batches of the size that the runtime takes.

use std::path::Path;

use super::contract::Terms;
use super::error::one_line;
use super::info::Batch;
use crate::fusion::{Contract, Forces, RegressError, Regressor, SharedWindows, Windows};

/// A graph that is open in a runtime.
pub(super) trait Runtime: std::fmt::Debug + Send {
    /// Maximum number of windows per call of [`infer`](Runtime::infer).
    fn max_batch(&self) -> usize;

    /// Runs `windows`, all of the same length, and appends each output to the buffer with its index.
    ///
    /// `outputs` may be shorter than the list that the graph was opened with: then only the first outputs are computed.
    fn infer(&mut self, windows: Windows<'_>, outputs: &mut [Vec<f32>]) -> Result<(), String>;
}

/// A model ready to run.
#[derive(Debug)]
pub(super) struct InferenceSession {
    /// File name, for errors.
    label: String,
    runtime: Box<dyn Runtime>,
    contract: Contract,
    max_batch: usize,
    output_names: Vec<String>,
    /// Place of the touch among them.
    touch_idx: Option<usize>,
    /// Windows that share frames, one below the other.
    tactile: Vec<f32>,
    pose: Vec<f32>,
}

impl InferenceSession {
    pub(super) fn new(path: &Path, runtime: Box<dyn Runtime>, terms: &Terms) -> Self {
        let max_batch = match terms.batch {
            Batch::One => 1,
            Batch::Dynamic => runtime.max_batch(),
        };
        InferenceSession {
            label: one_line(&path.display().to_string()),
            runtime,
            contract: terms.contract.clone(),
            max_batch,
            output_names: terms.tensors.outputs(),
            touch_idx: terms.tensors.touch_idx(),
            tactile: Vec::new(),
            pose: Vec::new(),
        }
    }

    /// File name, for errors.
    pub(super) fn label(&self) -> &str {
        &self.label
    }

    /// Numbers that an output gives for a window.
    pub(super) fn axes_of(&self, output_idx: usize) -> usize {
        if self.touch_idx == Some(output_idx) { 1 } else { self.contract.axes.n() }
    }

    /// Says that the base output can't stand in for the force.
    pub(super) fn drop_base(&mut self) {
        self.contract.has_base = false;
    }

    /// Runs `windows` and replaces the contents of `outputs`, in the order of
    /// [`Tensors::outputs`](super::contract::Tensors::outputs).
    pub(super) fn infer(&mut self, windows: SharedWindows<'_>, outputs: &mut [Vec<f32>]) -> Result<(), String> {
        outputs.iter_mut().for_each(Vec::clear);
        check(windows, &self.contract)?;
        let Contract { window, n_joints, .. } = self.contract;
        let n_columns = self.contract.n_columns();
        let mut done = 0;
        for starts in windows.starts.chunks(self.max_batch) {
            let part = Windows {
                n: starts.len(),
                tactile: one_below_the_other(windows.tactile, starts, window.get(), n_columns, &mut self.tactile),
                pose: one_below_the_other(windows.pose, starts, window.get(), n_joints, &mut self.pose),
            };
            self.runtime.infer(part, outputs).map_err(|said| one_line(&said))?;
            for (idx, (name, output)) in self.output_names.iter().zip(outputs.iter()).enumerate() {
                let (axes, n) = (self.axes_of(idx), starts.len());
                let given = output.len().saturating_sub(done * axes);
                if given != n * axes {
                    let name = one_line(name);
                    let expected = if axes == 1 { "one each".to_owned() } else { format!("{axes} each") };
                    let hint =
                        if given == 3 * n { "; a force of three axes needs the shape [N, 3] in the file" } else { "" };
                    return Err(format!(
                        "output {name} gave {given} values for {n} windows, expected {expected}{hint}"
                    ));
                }
            }
            done += starts.len();
        }
        Ok(())
    }
}

/// Refuses windows that reach beyond their frames, and frames of another size than the model's input.
pub(super) fn check(windows: SharedWindows<'_>, contract: &Contract) -> Result<(), String> {
    let SharedWindows { starts, ids, tactile, pose } = windows;
    let n_columns = contract.n_columns();
    let n_frames = tactile.len() / n_columns.max(1);
    let fits = |len: usize, width: usize| n_frames * width == len;
    if !fits(tactile.len(), n_columns) || !fits(pose.len(), contract.n_joints) {
        return Err(format!(
            "expected frames of {} tactile and {} pose numbers, got {} and {}",
            n_columns,
            contract.n_joints,
            tactile.len(),
            pose.len(),
        ));
    }
    if !ids.is_empty() && ids.len() != starts.len() {
        return Err(format!("expected the places of {} windows or of none, got {}", starts.len(), ids.len()));
    }
    let rises = starts.is_sorted_by(|earlier, later| earlier < later);
    if !rises || starts.last().is_some_and(|last| last.saturating_add(contract.window.get()) > n_frames) {
        return Err(format!("expected windows of {} frames that rise, within {n_frames} frames", contract.window));
    }
    Ok(())
}

/// The windows one after the other: a borrowed slice if none overlap, otherwise copied into `buffer`.
fn one_below_the_other<'v>(
    frames: &'v [f32],
    starts: &[usize],
    window: usize,
    width: usize,
    buffer: &'v mut Vec<f32>,
) -> &'v [f32] {
    let (Some(first), Some(last)) = (starts.first(), starts.last()) else { return &[] };
    if last - first == (starts.len() - 1) * window {
        return &frames[first * width..(last + window) * width];
    }
    buffer.clear();
    starts.iter().for_each(|start| buffer.extend_from_slice(&frames[start * width..(start + window) * width]));
    buffer
}

impl Regressor for InferenceSession {
    fn contract(&self) -> &Contract {
        &self.contract
    }

    fn run(&mut self, windows: SharedWindows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        out.clear();
        let (has_touch, has_base) = (self.contract.touch.is_some(), self.contract.has_base);
        let Forces { force, base, touch } = std::mem::take(out);
        let mut outputs = if has_touch { [force, touch, base] } else { [force, base, touch] };
        let wanted = 1 + usize::from(has_touch) + usize::from(has_base);
        let result = self.infer(windows, &mut outputs[..wanted]);
        let [force, second, third] = outputs;
        let (touch, base) = if has_touch { (second, third) } else { (third, second) };
        *out = Forces { force, base, touch };
        result.map_err(|what| RegressError(format!("model {}: {what}", self.label)))
    }
}
