//! What the message and model modules are told: where in a message the numbers lie, and which model file to run.

use std::path::PathBuf;

use crate::fusion::ForceUnit;

/// Where a sample's stamp comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StampFrom {
    /// A field of the message, by path, of type `builtin_interfaces/msg/Time`.
    Field(String),
    /// The time of receipt: `log_time` in a bag.
    Receipt,
}

/// Where a count comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CountFrom {
    /// Always one.
    One,
    /// Always this many, at least 1.
    Constant(usize),
    /// An integer field of the message, by path.
    Field(String),
}

/// Where the time between rows comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PeriodFrom {
    /// Nowhere: there is one row.
    None,
    /// Always this many nanoseconds, more than 0.
    Constant(i64),
    /// A field of the message, by path, of type `builtin_interfaces/msg/Duration`.
    Field(String),
}

/// Where joint names come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NamesFrom {
    /// A string array of the message, by path.
    Field(String),
    /// Always these, in the order of the positions.
    Constant(Vec<String>),
}

/// Where a taxel message keeps its samples.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TaxelFields {
    /// Stamp of the last row.
    pub stamp: StampFrom,
    /// Path of the numbers, `[rows, taxels]`, row-major.
    pub values: String,
    /// Consecutive samples in a message.
    pub rows: CountFrom,
    /// Taxels in a row, where the message tells it.
    pub cols: Option<CountFrom>,
    /// Time between rows.
    pub row_period: PeriodFrom,
    /// Path of the sender's message count, where it has one.
    pub sequence: Option<String>,
}

/// Where a joint message keeps its angles.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JointFields {
    /// Stamp of the angles.
    pub stamp: StampFrom,
    /// Path of the angles.
    pub positions: String,
    /// Names of the angles, in their order.
    pub names: NamesFrom,
}

/// Which runtime runs a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BackendChoice {
    /// ONNX Runtime where it is found, else RTen.
    #[default]
    Auto,
    /// ONNX Runtime, or an error.
    OnnxRuntime,
    /// RTen, which is part of this program.
    Rten,
}

/// The names of a model's inputs and outputs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TensorNames {
    /// Input `[N, window, taxels]`.
    pub tactile: String,
    /// Input `[N, window, joints]`.
    pub pose: String,
    /// Output: the force.
    pub force: String,
    /// Output: the force of the tactile branch alone, where the model has it.
    pub force_base: String,
    /// Output: what the pose adds to it, where the model has it.
    pub force_residual: String,
}

/// A model file and what the parameters say about it.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelSpec {
    /// The ONNX file.
    pub path: PathBuf,
    /// The runtime.
    pub backend: BackendChoice,
    /// Unit of its forces, where the parameters say it.
    pub unit: Option<ForceUnit>,
    /// Frames a second, where the parameters say it; more than 0.
    pub rate_hz: Option<f64>,
    /// Its inputs and outputs by name.
    pub names: TensorNames,
}
