//! The tensor contract of model files, and the runtimes that run them.
//!
//! Every model file is loaded in the same way ([`load`]): it is read once, its graph, weights and metadata are checked,
//! a runtime opens it, and trial runs check what the file can't guarantee. The result is a [`Regressor`], which is the
//! runtime, or the built-in code if it gives the same forces, and a [`ModelInfo`].

use std::io::Read;
use std::num::{NonZero, NonZeroUsize};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use self::builtin::Builtin;
use self::causal::Causal;
use self::contract::Terms;
use self::error::one_line;
use self::metadata::Metadata;
use self::onnx::{Message, ModelProto};
use self::paper::Paper;
use self::session::{InferenceSession, Runtime};
use crate::fusion::{ForceAxes, ForceUnit, Regressor};
use crate::location;

mod builtin;
mod causal;
mod comparison;
mod contract;
mod error;
pub mod first_run;
mod info;
pub mod metadata;
mod network;
pub mod onnx;
mod onnxruntime;
mod paper;
mod probe;
mod rten;
mod session;
mod trial;
mod weights;

pub use error::ModelError;
pub use info::{BackendInfo, Batch, Dim, ModelInfo, Origin, RuntimeName, TensorInfo, unit_name};

/// Largest file that is read. The paper's network has half a MiB.
const MAX_FILE_MIB: u64 = 64;

/// Number of windows per call in a runtime. More gain nothing.
const WINDOWS_AT_ONCE: NonZeroUsize = NonZeroUsize::new(32).expect("it is above 0");

/// Name of the vector instructions that the built-in code uses on this machine, for reports of its speed.
pub fn vectors() -> &'static str {
    tactile_pose_fusion_kernels::vectors()
}

/// Runtime to use for a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum BackendChoice {
    /// The built-in code if the model is the paper's network or the causal network of adaptive models. Otherwise ONNX
    /// Runtime if it is found, or else RTen.
    #[default]
    Auto,
    /// Only the built-in code.
    Builtin,
    /// Only ONNX Runtime.
    OnnxRuntime,
    /// RTen, which needs no installation.
    Rten,
}

/// Names of the contract's tensors in a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TensorNames {
    /// Input: taxels.
    pub tactile: String,
    /// Input: joint angles. A model without this input doesn't use the pose.
    pub pose: String,
    /// Output: the force.
    pub force: String,
    /// Output: the force of the tactile branch alone. Optional.
    pub force_base: String,
    /// Output: the artifact that the pose explains. Optional.
    pub force_residual: String,
    /// Output: the probability that something touches the region. Optional.
    pub touch: String,
}

impl Default for TensorNames {
    fn default() -> Self {
        TensorNames {
            tactile: "tactile".into(),
            pose: "pose".into(),
            force: "force".into(),
            force_base: "force_base".into(),
            force_residual: "force_residual".into(),
            touch: "touch".into(),
        }
    }
}

/// A model to load, with its parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelSpec {
    /// The ONNX file.
    pub path: PathBuf,
    /// Runtime to use.
    pub backend: BackendChoice,
    /// Unit of the forces, if the model's metadata doesn't give it.
    pub unit: Option<ForceUnit>,
    /// Model frames per second, if the model's metadata doesn't give it.
    pub rate_hz: Option<f64>,
    /// The glove that is worn. A model of another glove is refused.
    pub glove: Option<String>,
    /// Another glove whose model is accepted.
    pub of_glove: Option<String>,
    /// Names of the tensors.
    pub names: TensorNames,
    /// Maximum number of threads on which the built-in code runs many overlapping windows. With 1, the default, no thread is
    /// started. The forces are the same for any number.
    pub threads: NonZero<usize>,
}

impl ModelSpec {
    /// A model without parameters of its own.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        ModelSpec {
            path: path.into(),
            backend: BackendChoice::default(),
            unit: None,
            rate_hz: None,
            glove: None,
            of_glove: None,
            names: TensorNames::default(),
            threads: NonZero::<usize>::MIN,
        }
    }
}

/// A model that is ready to run.
#[derive(Debug)]
pub struct Model {
    /// Runs the model.
    pub regressor: Box<dyn Regressor>,
    /// Information about it.
    pub info: ModelInfo,
}

/// Loads a model: checks the file, opens it in a runtime, and does trial runs.
///
/// # Errors
/// [`ModelError`] for the first violation of the contract that can be found before the first window.
pub fn load(spec: &ModelSpec) -> Result<Model, ModelError> {
    let opened = open(spec)?;
    let path = spec.path.as_path();
    let mut info = opened.info;
    if !opened.is_known {
        let untried = first_run::check(spec, &info.sha256)?;
        info.notes.extend(untried.map(|why| format!("it was not tried in a process of its own: {why}")));
    }
    let not_builtin = |reason: String| ModelError::NotBuiltin { path: spec.path.clone(), reason };
    let own = match (spec.backend, opened.own) {
        (BackendChoice::Auto, own) => own.ok(),
        (BackendChoice::Builtin, own) => Some(own.map_err(not_builtin)?),
        (BackendChoice::OnnxRuntime | BackendChoice::Rten, _) => None,
    };
    // RTen is part of the program: where it shows that the built-in code is right, no library is loaded.
    if let Some(own) = &own
        && let Ok((runtime, backend)) = open_rten(&opened.bytes, &opened.terms)
    {
        let mut session = InferenceSession::new(path, runtime, &opened.terms);
        if let Ok(notes) = probe::check(path, &mut session, &opened.terms)
            && let Ok(builtin) = Builtin::of(&mut session, own, spec.threads.get())
        {
            info.notes.extend(notes);
            return Ok(run_by(builtin, backend, info));
        }
    }
    let (runtime, backend, instead) = choose_runtime(spec, &opened.bytes, &opened.terms)?;
    let mut session = InferenceSession::new(path, runtime, &opened.terms);
    info.notes.extend(probe::check(path, &mut session, &opened.terms)?);
    match own.map(|own| Builtin::of(&mut session, &own, spec.threads.get())) {
        Some(Ok(builtin)) => return Ok(run_by(builtin, backend, info)),
        Some(Err(reason)) if spec.backend == BackendChoice::Builtin => return Err(not_builtin(reason)),
        Some(Err(reason)) => {
            info.notes.push(format!("{} runs it: {reason}", backend.runtime));
            info.not_builtin = Some(reason);
        }
        None => {}
    }
    info.notes.extend(instead);
    info.contract = session.contract().clone();
    info.backend = Some(backend);
    Ok(Model { regressor: Box::new(session), info })
}

/// A model in the built-in code, which a runtime has checked.
fn run_by(builtin: Builtin, checked_against: BackendInfo, mut info: ModelInfo) -> Model {
    info.contract = builtin.contract().clone();
    info.batch_hint = builtin::WINDOWS_AT_ONCE;
    info.backend = Some(BackendInfo::builtin(checked_against));
    Model { regressor: Box::new(builtin), info }
}

/// A network that the built-in code can run.
enum Own {
    Paper(Box<Paper>),
    Causal(Box<Causal>),
}

/// The network, if the built-in code can run it; otherwise the reason.
fn own_network(model: &ModelProto, terms: &Terms) -> Result<Own, String> {
    match (terms.batch, &terms.tensors.touch) {
        (Batch::One, _) => Err("its batch is fixed at 1".to_owned()),
        (Batch::Dynamic, _) if terms.contract.axes == ForceAxes::Patch => Err("its force has three axes".to_owned()),
        (Batch::Dynamic, Some(_)) => causal::find(model, terms).map(|causal| Own::Causal(Box::new(causal))),
        (Batch::Dynamic, None) => paper::find(model, terms).map(|paper| Own::Paper(Box::new(paper))),
    }
}

/// Reads the contract of a file, with the default names and without a runtime.
///
/// # Errors
/// [`ModelError`] for the first violation of the contract.
pub fn inspect(path: &Path) -> Result<ModelInfo, ModelError> {
    inspect_spec(&ModelSpec::new(path))
}

/// Reads the contract of a file, with the names and values of the parameters and without a runtime.
///
/// # Errors
/// [`ModelError`] for the first violation of the contract.
pub fn inspect_spec(spec: &ModelSpec) -> Result<ModelInfo, ModelError> {
    open(spec).map(|opened| opened.info)
}

/// A file that passed every check that needs no runtime.
struct Opened {
    bytes: Vec<u8>,
    /// The network that the built-in code runs, or why it can't run the model.
    own: Result<Own, String>,
    /// True if it is exactly one of our networks, so that its behaviour in a runtime is known and needs no separate
    /// process.
    is_known: bool,
    terms: Terms,
    info: ModelInfo,
}

fn open(spec: &ModelSpec) -> Result<Opened, ModelError> {
    let path = spec.path.as_path();
    let malformed = |reason: String| ModelError::Malformed { path: path.to_path_buf(), reason };
    let bytes = read(path)?;
    let model = ModelProto::decode(bytes.as_slice()).map_err(|e| malformed(one_line(&e.to_string())))?;
    let graph = model.graph.as_ref().ok_or_else(|| malformed("it holds no graph".to_string()))?;
    weights::check(path, &model)?;
    let metadata = Metadata::parse(path, &model.metadata_props)?;
    let terms = contract::settle(graph, &metadata, spec)?;
    let standard = |domain: &str| domain.is_empty() || domain == "ai.onnx";
    let opset = model.opset_import.iter().find(|opset| standard(&opset.domain)).map_or(0, |opset| opset.version);
    let own = own_network(&model, &terms);
    let info = ModelInfo {
        path: path.to_path_buf(),
        sha256: Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect(),
        size_bytes: bytes.len() as u64,
        backend: None,
        contract: terms.contract.clone(),
        unit_from: terms.unit_from,
        rate_from: terms.rate_from,
        batch: terms.batch,
        metadata: metadata.entries,
        producer: one_line(&format!("{} {}", model.producer_name, model.producer_version)),
        ir_version: model.ir_version,
        opset,
        inputs: terms.inputs.clone(),
        outputs: terms.outputs.clone(),
        batch_hint: WINDOWS_AT_ONCE,
        not_builtin: own.as_ref().err().cloned(),
        notes: terms.notes.clone(),
    };
    let is_known = own.is_ok() && model.graph.as_ref().is_some_and(paper::needs_every_node);
    Ok(Opened { bytes, own, is_known, terms, info })
}

fn read(path: &Path) -> Result<Vec<u8>, ModelError> {
    let failed = |reason| ModelError::Read { path: path.to_path_buf(), reason };
    let limit = MAX_FILE_MIB << 20;
    let mut bytes = Vec::new();
    location::open(path).map_err(failed)?.take(limit + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > limit {
        return Err(ModelError::TooLarge { path: path.to_path_buf(), limit_mib: MAX_FILE_MIB });
    }
    Ok(bytes)
}

/// A runtime that has opened a graph, what it is, and what stands against ONNX Runtime where it is another.
type Chosen = (Box<dyn Runtime>, BackendInfo, Option<String>);

fn open_rten(bytes: &[u8], terms: &Terms) -> Result<(Box<dyn Runtime>, BackendInfo), String> {
    Ok((Box::new(rten::open(bytes, terms)?), rten::info()))
}

/// Opens the graph in the runtime that was asked for. Under `auto`, what stands against ONNX Runtime comes with it.
fn choose_runtime(spec: &ModelSpec, bytes: &[u8], terms: &Terms) -> Result<Chosen, ModelError> {
    let failed = |reason: String| ModelError::Runtime { path: spec.path.clone(), reason: one_line(&reason) };
    let (against, is_told) = match spec.backend {
        BackendChoice::Rten => {
            let (runtime, backend) = open_rten(bytes, terms).map_err(failed)?;
            return Ok((runtime, backend, None));
        }
        BackendChoice::OnnxRuntime => {
            let backend = onnxruntime::info();
            let backend = backend.map_err(|reason| ModelError::NoOnnxRuntime { path: spec.path.clone(), reason })?;
            return Ok((Box::new(onnxruntime::open(bytes, terms).map_err(failed)?), backend, None));
        }
        BackendChoice::Auto | BackendChoice::Builtin => match onnxruntime::info() {
            Ok(backend) => match onnxruntime::open(bytes, terms) {
                Ok(runtime) => return Ok((Box::new(runtime), backend, None)),
                Err(said) => (format!("{backend} refuses the model ({})", one_line(&said)), true),
            },
            // If nobody named a library, nobody misses it, and -v tells what runs.
            Err(missing) => {
                (format!("ONNX Runtime can't be used ({missing})"), std::env::var_os("ORT_DYLIB_PATH").is_some())
            }
        },
    };
    let (runtime, backend) = open_rten(bytes, terms).map_err(|said| failed(format!("{said}; {against}")))?;
    Ok((runtime, backend, is_told.then(|| format!("{against}: RTen takes its place"))))
}
