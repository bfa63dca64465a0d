//! Parameter files as Python gives them.

use std::path::PathBuf;

use pyo3::prelude::*;
use tactile_pose_fusion::config::{Config, Origin, ParamTree, ParamValue, load_tree};
use tactile_pose_fusion::model::BackendChoice;

use crate::error::{Kind, exception, raise};
use crate::work;

/// Topics, taxels, joints, models and thresholds: what parameter files say.
#[pyclass(frozen, module = "tactile_pose_fusion._core")]
pub(crate) struct Parameters {
    tree: ParamTree,
    backend: Option<BackendChoice>,
    cfg: Config,
}

#[pymethods]
impl Parameters {
    #[new]
    #[pyo3(signature = (files, overrides, node, backend))]
    fn new(
        py: Python<'_>,
        files: Vec<PathBuf>,
        overrides: Vec<String>,
        node: &str,
        backend: Option<&str>,
    ) -> PyResult<Self> {
        let mut tree = work::quietly(py, || load_tree(&files, node))?;
        for rule in &overrides {
            let set = tree.set_override(rule).map_err(|error| exception(Kind::Parameter, error.to_string()))?;
            if !set {
                let line = format!("{rule} is for another node than {node}; correct it or the node");
                return Err(exception(Kind::Parameter, line));
            }
        }
        let backend = backend.map(backend_of).transpose()?;
        let cfg = configuration(&tree, backend)?;
        Ok(Parameters { tree, backend, cfg })
    }

    /// What a person should know about them, a line each.
    fn notes(&self) -> Vec<String> {
        self.cfg.note_on_others().into_iter().collect()
    }

    /// Names of the regions, in their order.
    fn regions(&self) -> Vec<String> {
        self.cfg.fusion().regions().iter().map(|region| region.name.clone()).collect()
    }
}

impl Parameters {
    /// What they say.
    pub(crate) fn config(&self) -> Config {
        self.cfg.clone()
    }

    /// What they say, with the true force on another topic: that of the only force sensor, or of one that they don't have.
    pub(crate) fn with_truth(&self, topic: Option<&str>) -> PyResult<Config> {
        let Some(topic) = topic else { return Ok(self.config()) };
        let sources = match self.tree.get("truth_sources").map(|param| &param.value) {
            Some(ParamValue::StrArray(sources)) => sources.clone(),
            _ => Vec::new(),
        };
        let source = match sources.as_slice() {
            [] => "truth",
            [only] => only,
            several => {
                let several = several.join(", ");
                let line = format!(
                    "truth stands for one force sensor, the parameters have {several}; set truth.NAME.topic in the parameters"
                );
                return Err(exception(Kind::Parameter, line));
            }
        };
        let mut tree = self.tree.clone();
        tree.set("truth_sources", ParamValue::StrArray(vec![source.to_owned()]), Origin::CommandLine);
        tree.set(&format!("truth.{source}.topic"), ParamValue::Str(topic.to_owned()), Origin::CommandLine);
        configuration(&tree, self.backend)
    }
}

fn configuration(tree: &ParamTree, backend: Option<BackendChoice>) -> PyResult<Config> {
    let mut cfg = Config::from_tree(tree).map_err(|error| raise(&error))?;
    if let Some(backend) = backend {
        cfg.models_mut().iter_mut().for_each(|model| model.spec.backend = backend);
    }
    Ok(cfg)
}

fn backend_of(name: &str) -> PyResult<BackendChoice> {
    match name {
        "auto" => Ok(BackendChoice::Auto),
        "builtin" => Ok(BackendChoice::Builtin),
        "onnxruntime" => Ok(BackendChoice::OnnxRuntime),
        "rten" => Ok(BackendChoice::Rten),
        other => {
            let line = format!("backend: expected auto, builtin, onnxruntime or rten, got {other:?}");
            Err(exception(Kind::Parameter, line))
        }
    }
}
