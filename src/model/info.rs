//! Information about an open model, for the start-up log, diagnostics, reports and `inspect`.

use std::collections::BTreeMap;
use std::fmt;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use serde::{Serialize, Serializer};

use super::error::one_line;
use super::onnx::{DimensionValue, ValueInfoProto, data_type};
use crate::fusion::{Contract, ForceUnit, TouchOutput};

/// Information about a model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ModelInfo {
    /// The file.
    #[serde(serialize_with = "lossy_path")]
    pub path: PathBuf,
    /// SHA-256 of the file's bytes, in hex.
    pub sha256: String,
    /// Length of the file, bytes.
    pub size_bytes: u64,
    /// The runtime that runs it. Absent if the model was only inspected.
    pub backend: Option<BackendInfo>,
    /// The tensor contract. If the model was only inspected, `has_base` is taken from the file and not tested.
    #[serde(serialize_with = "contract")]
    pub contract: Contract,
    /// Source of the contract's unit.
    pub unit_from: Origin,
    /// Source of the contract's rate.
    pub rate_from: Origin,
    /// Number of windows that the graph takes at once.
    pub batch: Batch,
    /// `metadata_props` as in the file.
    pub metadata: BTreeMap<String, String>,
    /// Program that wrote the file, with its version.
    pub producer: String,
    /// Version of the ONNX format.
    pub ir_version: i64,
    /// Version of the standard operator set.
    pub opset: i64,
    /// Inputs in the file's order, without weights.
    pub inputs: Vec<TensorInfo>,
    /// Outputs in the file's order.
    pub outputs: Vec<TensorInfo>,
    /// Why the built-in code can't run it. Absent if it can.
    pub not_builtin: Option<String>,
    /// Number of windows per call at which it runs fastest.
    pub batch_hint: NonZeroUsize,
    /// Notes for the user: fallbacks, defaults that are used, unused outputs.
    pub notes: Vec<String>,
}

impl ModelInfo {
    /// An entry of the metadata, if it has one that is not empty.
    pub fn noted(&self, key: &str) -> Option<&str> {
        self.metadata.get(key).map(|value| value.trim()).filter(|value| !value.is_empty())
    }
}

/// Runtime of a model, and where it comes from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct BackendInfo {
    /// Name of the runtime.
    pub runtime: RuntimeName,
    /// Its version, or `unknown`.
    pub version: String,
    /// Path of the shared library, for ONNX Runtime.
    #[serde(serialize_with = "lossy_optional_path", skip_serializing_if = "Option::is_none")]
    pub library: Option<PathBuf>,
    /// If the built-in code runs the model: the runtime with which its results were compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub checked_against: Option<Box<BackendInfo>>,
}

impl BackendInfo {
    /// The built-in code, compared with a runtime.
    pub(super) fn builtin(runtime: BackendInfo) -> Self {
        BackendInfo {
            runtime: RuntimeName::Builtin,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            library: None,
            checked_against: Some(Box::new(runtime)),
        }
    }
}

impl fmt::Display for BackendInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.runtime, self.version)?;
        if let Some(library) = &self.library {
            write!(f, " ({})", library.display())?;
        }
        match &self.checked_against {
            Some(runtime) => write!(f, ", checked against {runtime}"),
            None => Ok(()),
        }
    }
}

/// Runtimes for models.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RuntimeName {
    /// The built-in code, for the networks that `tpf train` makes.
    Builtin,
    /// ONNX Runtime, loaded from a shared library at start.
    OnnxRuntime,
    /// RTen, built in.
    Rten,
}

impl fmt::Display for RuntimeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            RuntimeName::Builtin => "built-in code",
            RuntimeName::OnnxRuntime => "ONNX Runtime",
            RuntimeName::Rten => "RTen",
        })
    }
}

/// Source of a value of the contract.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// Metadata of the model.
    Metadata,
    /// The parameters.
    Parameters,
    /// Neither gives it: the paper's value is used.
    Default,
}

/// Number of windows that a graph takes at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Batch {
    /// Any number of windows.
    Dynamic,
    /// One window. Batches are run window by window.
    One,
}

/// Input or output tensor of a model.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct TensorInfo {
    /// Its name in the file.
    pub name: String,
    /// Element type, or the kind of value if it is not a tensor.
    pub dtype: String,
    /// Shape, if at least the rank is known.
    pub shape: Option<Vec<Dim>>,
}

/// One dimension of a tensor.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Dim {
    /// Known size.
    Fixed(u64),
    /// Size that is known only at run time, with the exporter's name for it, or `?`.
    Dynamic(String),
}

impl TensorInfo {
    pub(super) fn read(value: &ValueInfoProto) -> Self {
        let tensor_type = value.r#type.as_ref().and_then(|r#type| r#type.tensor_type.as_ref());
        let dim = |value: &Option<DimensionValue>| match value {
            // Some exporters write a negative size for a dynamic dimension.
            Some(DimensionValue::DimValue(size)) => u64::try_from(*size).map_or(Dim::Dynamic("?".into()), Dim::Fixed),
            Some(DimensionValue::DimParam(name)) if !name.is_empty() => Dim::Dynamic(name.clone()),
            _ => Dim::Dynamic("?".into()),
        };
        TensorInfo {
            name: value.name.clone(),
            dtype: tensor_type.map_or("no tensor".into(), |tensor| data_type::name(tensor.elem_type)),
            shape: tensor_type
                .and_then(|tensor| tensor.shape.as_ref())
                .map(|shape| shape.dim.iter().map(|d| dim(&d.value)).collect()),
        }
    }

    /// Shape on one line, as `[N, 64, 16]`.
    pub fn shape_text(&self) -> String {
        let Some(dims) = &self.shape else { return "of unknown rank".to_string() };
        let dims: Vec<String> = dims.iter().map(ToString::to_string).collect();
        one_line(&format!("[{}]", dims.join(", ")))
    }
}

impl fmt::Display for TensorInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} {}", one_line(&self.name), self.dtype, self.shape_text())
    }
}

impl fmt::Display for Dim {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Dim::Fixed(size) => write!(f, "{size}"),
            Dim::Dynamic(name) => f.write_str(name),
        }
    }
}

/// Name of a force unit in metadata and parameters.
pub fn unit_name(unit: ForceUnit) -> &'static str {
    match unit {
        ForceUnit::GramForce => "gF",
        ForceUnit::Newton => "N",
        ForceUnit::KilogramForce => "kgf",
        ForceUnit::Millinewton => "mN",
    }
}

fn lossy_path<S: Serializer>(path: &std::path::Path, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&path.to_string_lossy())
}

fn lossy_optional_path<S: Serializer>(path: &Option<PathBuf>, serializer: S) -> Result<S::Ok, S::Error> {
    path.as_ref().map(|path| path.to_string_lossy()).serialize(serializer)
}

/// Serializes the contract here, because `fusion` knows no file formats.
fn contract<S: Serializer>(contract: &Contract, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Json<'a> {
        window: usize,
        taxels: usize,
        columns: usize,
        n_joints: usize,
        rate_hz: f64,
        unit: &'static str,
        force_axes: usize,
        has_base: bool,
        artifact: bool,
        touch: Option<TouchOutput>,
        joints: &'a Option<Vec<String>>,
        #[serde(skip_serializing_if = "BTreeMap::is_empty")]
        regions: BTreeMap<&'a str, &'a [String]>,
        pose_range_rad: Option<Vec<[f64; 2]>>,
        mdf_n: Option<f64>,
    }
    let ranges = contract.pose_range.as_ref();
    Json {
        window: contract.window.get(),
        taxels: contract.n_taxels,
        columns: contract.n_columns(),
        n_joints: contract.n_joints,
        rate_hz: contract.rate_hz,
        unit: unit_name(contract.unit),
        force_axes: contract.axes.n(),
        has_base: contract.has_base,
        artifact: contract.has_artifact(),
        touch: contract.touch,
        joints: &contract.joints,
        regions: contract.regions.iter().map(|(name, terms)| (name.as_str(), terms.joints.as_slice())).collect(),
        pose_range_rad: ranges.map(|ranges| ranges.iter().map(|range| [range.min, range.max]).collect()),
        mdf_n: contract.mdf.map(|mdf| mdf.0),
    }
    .serialize(serializer)
}
