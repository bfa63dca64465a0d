//! What is known of a model once it is open: for the start-up log, diagnostics, reports and `inspect`.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use serde::{Serialize, Serializer};

use super::error::one_line;
use super::onnx::{DimensionValue, ValueInfoProto, data_type};
use crate::fusion::{Contract, ForceUnit, TouchOutput};

/// Everything that is known of a model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ModelInfo {
    /// The file.
    #[serde(serialize_with = "lossy_path")]
    pub path: PathBuf,
    /// SHA-256 of the file's bytes, in hex.
    pub sha256: String,
    /// Length of the file, bytes.
    pub size_bytes: u64,
    /// What runs it; absent when it was only inspected.
    pub backend: Option<BackendInfo>,
    /// What it promises. Where it was only inspected, `has_base` is what the file says, untried.
    #[serde(serialize_with = "contract")]
    pub contract: Contract,
    /// Where the unit of the contract comes from.
    pub unit_from: Origin,
    /// Where the rate of the contract comes from.
    pub rate_from: Origin,
    /// How many windows the graph takes at once.
    pub batch: Batch,
    /// `metadata_props` as they stand in the file.
    pub metadata: BTreeMap<String, String>,
    /// Who wrote the file, with its version.
    pub producer: String,
    /// Version of the ONNX format.
    pub ir_version: i64,
    /// Version of the standard operators.
    pub opset: i64,
    /// Inputs in the file's order, weights left out.
    pub inputs: Vec<TensorInfo>,
    /// Outputs in the file's order.
    pub outputs: Vec<TensorInfo>,
    /// Why our own code can't run it; absent for the paper's network.
    pub not_builtin: Option<String>,
    /// Windows of one call that it runs fastest with.
    pub batch_hint: usize,
    /// Notes for the user: fallbacks, defaults in use, unused outputs.
    pub notes: Vec<String>,
}

/// What runs a model, and where it comes from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct BackendInfo {
    /// Which runtime.
    pub runtime: RuntimeName,
    /// Its version; `unknown` if it can't be read.
    pub version: String,
    /// The shared library, for ONNX Runtime.
    #[serde(serialize_with = "lossy_optional_path", skip_serializing_if = "Option::is_none")]
    pub library: Option<PathBuf>,
    /// The runtime that our own code was held against, where that is what runs it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub checked_against: Option<Box<BackendInfo>>,
}

impl BackendInfo {
    /// Our own code, held against a runtime.
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
    /// Our own code for the paper's network.
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

/// Where a fact of the contract comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// The model's own metadata.
    Metadata,
    /// The parameters.
    Parameters,
    /// Not specified: the paper's value is used.
    Default,
}

/// How many windows a graph takes at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Batch {
    /// Any number.
    Dynamic,
    /// One; batches are run window by window.
    One,
}

/// A tensor that a model takes or gives.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct TensorInfo {
    /// Its name in the file.
    pub name: String,
    /// Its element type, or what it is when it is no tensor.
    pub dtype: String,
    /// Its shape, where at least the rank is known.
    pub shape: Option<Vec<Dim>>,
}

/// One dimension of a tensor.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Dim {
    /// A size.
    Fixed(u64),
    /// Known at run time, by the name the exporter gave it; `?` when it gave none.
    Dynamic(String),
}

impl TensorInfo {
    pub(super) fn read(value: &ValueInfoProto) -> Self {
        let tensor_type = value.r#type.as_ref().and_then(|r#type| r#type.tensor_type.as_ref());
        let dim = |value: &Option<DimensionValue>| match value {
            // Some exporters write a negative size where they mean a dynamic one.
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

    /// The shape as text on one line, `[N, 64, 16]`.
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

/// A force unit as metadata and parameters spell it.
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

/// The contract for machines; `fusion` itself knows no formats.
fn contract<S: Serializer>(contract: &Contract, serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Json<'a> {
        window: usize,
        taxels: usize,
        n_joints: usize,
        rate_hz: f64,
        unit: &'static str,
        force_axes: usize,
        has_base: bool,
        artifact: bool,
        touch: Option<TouchOutput>,
        joints: &'a Option<Vec<String>>,
        pose_range_rad: Option<Vec<[f64; 2]>>,
        mdf_n: Option<f64>,
    }
    let ranges = contract.pose_range.as_ref();
    Json {
        window: contract.window,
        taxels: contract.n_taxels,
        n_joints: contract.n_joints,
        rate_hz: contract.rate_hz,
        unit: unit_name(contract.unit),
        force_axes: contract.axes.n(),
        has_base: contract.has_base,
        artifact: contract.artifact.is_some(),
        touch: contract.touch,
        joints: &contract.joints,
        pose_range_rad: ranges.map(|ranges| ranges.iter().map(|range| [range.min, range.max]).collect()),
        mdf_n: contract.mdf.map(|mdf| mdf.0),
    }
    .serialize(serializer)
}
