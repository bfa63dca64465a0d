//! Runs models in RTen, which is compiled in, so that nothing has to be installed.

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use ::rten::{Model as Graph, NodeId, RunOptions, ThreadPool};
use rten_tensor::{NdTensorView, TensorView};

use super::contract::Terms;
use super::info::{BackendInfo, RuntimeName};
use super::session::Runtime;
use crate::fusion::Windows;

/// RTen's version in this build. A test compares it with `Cargo.lock`.
pub(super) const VERSION: &str = "0.27.0";

/// RTen allocates memory on every run. The paper's network costs about the same per window for 16 to 128 windows at
/// once, and more at 256.
const MAX_BATCH: usize = 64;

/// A graph in RTen. It runs on a single thread.
pub(super) struct Rten {
    graph: Graph,
    tactile: NodeId,
    pose: Option<NodeId>,
    outputs: Vec<NodeId>,
    options: RunOptions,
    /// Number of taxels and of joints in a frame.
    sizes: [usize; 2],
}

impl fmt::Debug for Rten {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Rten").field("graph", &self.graph).finish_non_exhaustive()
    }
}

/// Describes this runtime.
pub(super) fn info() -> BackendInfo {
    BackendInfo { runtime: RuntimeName::Rten, version: VERSION.to_string(), library: None, checked_against: None }
}

/// Opens a model.
pub(super) fn open(bytes: &[u8], terms: &Terms) -> Result<Rten, String> {
    let graph = guarded(|| Graph::load(bytes.to_vec()).map_err(|e| e.to_string()))?;
    let node = |name: &String| graph.node_id(name).map_err(|e| format!("RTen {VERSION} does not find {name}: {e}"));
    let pool = ThreadPool::with_num_threads(1);
    let contract = &terms.contract;
    Ok(Rten {
        tactile: node(&terms.tensors.tactile)?,
        pose: terms.tensors.pose.as_ref().map(node).transpose()?,
        outputs: terms.tensors.outputs().iter().map(node).collect::<Result<_, _>>()?,
        options: RunOptions::default().with_thread_pool(Some(Arc::new(pool))),
        sizes: [contract.n_columns(), contract.n_joints],
        graph,
    })
}

impl Runtime for Rten {
    fn max_batch(&self) -> usize {
        MAX_BATCH
    }

    fn infer(&mut self, windows: Windows<'_>, outputs: &mut [Vec<f32>]) -> Result<(), String> {
        let [n_columns, n_joints] = self.sizes;
        let window = windows.tactile.len() / (windows.n * n_columns).max(1);
        let tactile = NdTensorView::from_data([windows.n, window, n_columns], windows.tactile);
        let mut inputs = vec![(self.tactile, tactile.into())];
        if let Some(pose) = self.pose {
            inputs.push((pose, NdTensorView::from_data([windows.n, window, n_joints], windows.pose).into()));
        }
        let wanted = &self.outputs[..outputs.len()];
        let options = self.options.clone();
        let values = guarded(|| self.graph.run(inputs, wanted, Some(options)).map_err(|e| e.to_string()))?;
        for (output, value) in outputs.iter_mut().zip(&values) {
            let tensor: TensorView<'_, f32> = value.try_into().map_err(|e| format!("RTen {VERSION}: {e}"))?;
            output.extend(tensor.iter());
        }
        Ok(())
    }
}

/// Runs RTen and turns a panic into an error. RTen panics on some invalid graphs, and a bad model must not end the
/// node.
fn guarded<T>(run: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    match catch_unwind(AssertUnwindSafe(run)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(said)) => Err(format!("RTen {VERSION}: {said}")),
        Err(panic) => {
            let said = panic.downcast_ref::<String>().map(String::as_str);
            let said = said.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no reason given");
            Err(format!("RTen {VERSION} gave up on the graph: {said}"))
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_version_that_is_reported_is_the_one_that_is_built_in() {
        let lock = include_str!("../../Cargo.lock");
        let built_in = format!("name = \"rten\"\nversion = \"{}\"", super::VERSION);
        assert!(
            lock.replace("\r\n", "\n").contains(&built_in),
            "Cargo.lock holds another rten than {}",
            super::VERSION
        );
    }
}
