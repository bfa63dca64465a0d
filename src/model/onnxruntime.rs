//! Runs models in ONNX Runtime, which is loaded from a shared library if one is found.

mod library;

use std::fmt;

use ort::session::builder::GraphOptimizationLevel;
use ort::session::{HasSelectedOutputs, OutputSelector, RunOptions, Session as Graph, SessionInputValue};
use ort::value::TensorRef;

use super::contract::Terms;
use super::info::{BackendInfo, RuntimeName};
use super::session::Runtime;
use crate::fusion::Windows;

/// The paper's network costs about the same per window for 8 to 64 windows at once, and more from 128 on. A small limit
/// also reduces the memory that ONNX Runtime keeps.
const MAX_BATCH: usize = 32;

/// A graph in ONNX Runtime. It runs on the calling thread.
pub(super) struct OnnxRuntime {
    graph: Graph,
    tactile: String,
    pose: Option<String>,
    outputs: Vec<String>,
    /// Output selections: `options[n - 1]` selects the first `n` outputs.
    options: Vec<RunOptions<HasSelectedOutputs>>,
    /// Number of taxels and of joints in a frame.
    sizes: [usize; 2],
}

impl fmt::Debug for OnnxRuntime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OnnxRuntime")
            .field("tactile", &self.tactile)
            .field("outputs", &self.outputs)
            .finish_non_exhaustive()
    }
}

/// The library that this process uses. The first call loads it.
///
/// # Errors
/// Where the library was searched for, and why no candidate could be used.
pub(super) fn info() -> Result<BackendInfo, String> {
    let library = library::loaded()?;
    Ok(BackendInfo {
        runtime: RuntimeName::OnnxRuntime,
        version: library.version.clone(),
        library: Some(library.path.clone()),
        checked_against: None,
    })
}

/// Opens a model.
///
/// # Errors
/// The library's error message, or why there is no library.
pub(super) fn open(bytes: &[u8], terms: &Terms) -> Result<OnnxRuntime, String> {
    let library = library::loaded()?;
    let said = |e: ort::Error| format!("ONNX Runtime {}: {e}", library.version);
    let outputs = terms.tensors.outputs();
    let contract = &terms.contract;
    Ok(OnnxRuntime {
        graph: build(library, bytes).map_err(said)?,
        tactile: terms.tensors.tactile.clone(),
        pose: terms.tensors.pose.clone(),
        options: (1..=outputs.len()).map(|n| select(&outputs[..n])).collect::<Result<_, _>>().map_err(said)?,
        outputs,
        sizes: [contract.n_columns(), contract.n_joints],
    })
}

/// Builds a session with one thread: two threads in one session are slower than two sessions.
fn build(library: &library::Library, bytes: &[u8]) -> Result<Graph, ort::Error> {
    Graph::builder(&library.environment)?
        .with_intra_threads(1)?
        .with_inter_threads(1)?
        .with_optimization_level(GraphOptimizationLevel::All)?
        .with_log_level(ort::logging::LogLevel::Fatal)?
        .commit_from_memory(bytes)
}

fn select(outputs: &[String]) -> Result<RunOptions<HasSelectedOutputs>, ort::Error> {
    let selector = outputs.iter().fold(OutputSelector::no_default(), |selector, name| selector.with(name));
    Ok(RunOptions::new()?.with_outputs(selector))
}

impl Runtime for OnnxRuntime {
    fn max_batch(&self) -> usize {
        MAX_BATCH
    }

    fn infer(&mut self, windows: Windows<'_>, outputs: &mut [Vec<f32>]) -> Result<(), String> {
        let [n_columns, n_joints] = self.sizes;
        let window = windows.tactile.len() / (windows.n * n_columns).max(1);
        let said = |e: ort::Error| format!("ONNX Runtime: {e}");
        let tactile = TensorRef::from_array_view(([windows.n, window, n_columns], windows.tactile)).map_err(said)?;
        let mut inputs: Vec<(&str, SessionInputValue<'_>)> = vec![(&self.tactile, tactile.into())];
        if let Some(pose) = &self.pose {
            let values = TensorRef::from_array_view(([windows.n, window, n_joints], windows.pose)).map_err(said)?;
            inputs.push((pose, values.into()));
        }
        let Some(options) = outputs.len().checked_sub(1).and_then(|idx| self.options.get(idx)) else {
            return Err(format!("ONNX Runtime: {} outputs wanted of {}", outputs.len(), self.outputs.len()));
        };
        let values = self.graph.run_with_options(inputs, options).map_err(said)?;
        for (output, name) in outputs.iter_mut().zip(&self.outputs) {
            let value = values.get(name).ok_or_else(|| format!("ONNX Runtime: output {name} did not come back"))?;
            let (_, forces) = value.try_extract_tensor::<f32>().map_err(said)?;
            output.extend_from_slice(forces);
        }
        Ok(())
    }
}
