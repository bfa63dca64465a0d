//! A model that runs: one runtime behind the contract, batches cut to what it takes.

use std::path::Path;

use super::contract::Terms;
use super::error::one_line;
use super::info::Batch;
use crate::fusion::{Contract, Forces, RegressError, Regressor, Windows};

/// An open graph in one of the runtimes.
pub(super) trait Runtime: std::fmt::Debug + Send {
    /// The most windows that are given to [`infer`](Runtime::infer) at once.
    fn max_batch(&self) -> usize;

    /// Runs `windows`, all of one length, and appends what each output gives to the buffer at its place.
    ///
    /// `outputs` may be shorter than the list that the graph was opened with: then only the first ones are wanted.
    fn infer(&mut self, windows: Windows<'_>, outputs: &mut [Vec<f32>]) -> Result<(), String>;
}

/// A model ready to run.
#[derive(Debug)]
pub(super) struct Session {
    /// The file's name, for errors.
    label: String,
    runtime: Box<dyn Runtime>,
    contract: Contract,
    max_batch: usize,
    output_names: Vec<String>,
}

impl Session {
    pub(super) fn new(path: &Path, runtime: Box<dyn Runtime>, terms: &Terms) -> Self {
        let max_batch = match terms.batch {
            Batch::One => 1,
            Batch::Dynamic => runtime.max_batch(),
        };
        Session {
            label: one_line(&path.display().to_string()),
            runtime,
            contract: terms.contract.clone(),
            max_batch,
            output_names: terms.tensors.outputs(),
        }
    }

    /// The file's name, for errors.
    pub(super) fn label(&self) -> &str {
        &self.label
    }

    /// Says that the base output can't stand in for the force.
    pub(super) fn drop_base(&mut self) {
        self.contract.has_base = false;
    }

    /// Runs `windows` and replaces what `outputs` held, in the order force, base, residual.
    pub(super) fn infer(&mut self, windows: Windows<'_>, outputs: &mut [Vec<f32>]) -> Result<(), String> {
        outputs.iter_mut().for_each(Vec::clear);
        let tactile_len = self.contract.window * self.contract.n_taxels;
        let pose_len = self.contract.window * self.contract.n_joints;
        let fits = |len: usize, of_one: usize| windows.n.checked_mul(of_one) == Some(len);
        if !fits(windows.tactile.len(), tactile_len) || !fits(windows.pose.len(), pose_len) {
            return Err(format!(
                "expected {} windows of {tactile_len} tactile and {pose_len} pose numbers, got {} and {}",
                windows.n,
                windows.tactile.len(),
                windows.pose.len(),
            ));
        }
        let mut done = 0;
        while done < windows.n {
            let n = self.max_batch.min(windows.n - done);
            let part = Windows {
                n,
                tactile: &windows.tactile[done * tactile_len..(done + n) * tactile_len],
                pose: &windows.pose[done * pose_len..(done + n) * pose_len],
            };
            self.runtime.infer(part, outputs).map_err(|said| one_line(&said))?;
            for (name, output) in self.output_names.iter().zip(outputs.iter()) {
                let given = output.len().saturating_sub(done);
                if given != n {
                    let name = one_line(name);
                    return Err(format!("output {name} gave {given} values for {n} windows, expected one each"));
                }
            }
            done += n;
        }
        Ok(())
    }
}

impl Regressor for Session {
    fn contract(&self) -> &Contract {
        &self.contract
    }

    fn run(&mut self, windows: Windows<'_>, out: &mut Forces) -> Result<(), RegressError> {
        out.base.clear();
        let mut outputs = [std::mem::take(&mut out.force), std::mem::take(&mut out.base)];
        let wanted = if self.contract.has_base { 2 } else { 1 };
        let result = self.infer(windows, &mut outputs[..wanted]);
        [out.force, out.base] = outputs;
        result.map_err(|what| RegressError(format!("model {}: {what}", self.label)))
    }
}
