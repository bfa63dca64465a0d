//! Decodes raw messages to samples for the core. Bag replay and the live node share it, so both read a message in the
//! same way.

mod clock;
mod frames;
mod hand;
mod joints;
mod samples;
mod sequence;
mod stamp;
mod static_frames;
mod taxels;
mod truth;

pub use frames::FrameStore;
pub use hand::{HandFields, HandPaths, hand_paths, hand_stamp};
pub(crate) use hand::{MANUS, NAMED_POSES, TF};
pub use joints::{JointBinding, JointFields, JointMessage, NamesFrom};
pub use samples::SampleBinding;
pub use stamp::{Since, StampFrom, StampUnit};
pub use static_frames::{FramesBinding, static_topic};
pub use taxels::{CountFrom, PeriodFrom, TaxelBinding, TaxelFields, TaxelSamples};
pub use truth::{ForceFields, ForceReading, TruthBinding, TruthFields};

use super::cdr::CdrError;
use super::definition::TypeTree;
use super::dynamic::{FieldError, FieldPlan, MessageCondition, ReadAs, ReadError};

/// A topic to read: its name, its type, and the fields to read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic<Fields> {
    /// Absolute name.
    pub name: String,
    /// Canonical name of its message type.
    pub type_name: String,
    /// [`TaxelFields`], [`JointFields`] or [`TruthFields`].
    pub fields: Fields,
}

/// Fields that can't be bound to a message type.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BindingError {
    /// A path doesn't lead to a field of the required type.
    #[error("{role}: {error}")]
    Field {
        /// The parameter that names the field.
        role: &'static str,
        /// The error.
        error: FieldError,
    },
    /// The type has no stamp, and the parameters don't name one.
    #[error(
        "stamp: {type_name} has no field that is known to be its stamp; give a field path, or 'receipt' for the time of arrival"
    )]
    NoStamp {
        /// The type.
        type_name: String,
    },
    /// The field of a message counter is not an integer.
    #[error("sequence: field '{path}' of {type_name} is {found}, but a whole number must be there; leave it out")]
    NoCounter {
        /// The path.
        path: String,
        /// The type.
        type_name: String,
        /// Type of the field.
        found: String,
    },
    /// The field of a stamp can't be a stamp.
    #[error("stamp: field '{path}' of {type_name} is {found}, {problem}")]
    Stamp {
        /// The path.
        path: String,
        /// The type.
        type_name: String,
        /// Type of the field.
        found: String,
        /// The problem and the remedy.
        problem: &'static str,
    },
    /// A constant of the parameters is invalid.
    #[error("{role}: expected {expected}, got {got}")]
    Constant {
        /// The parameter.
        role: &'static str,
        /// The expected value.
        expected: &'static str,
        /// The value found.
        got: String,
    },
}

/// A message without a usable sample. The message is dropped and counted under [`reason`](Self::reason).
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SampleError {
    /// The bytes don't match the definition.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The message is for another source.
    #[error("a {type_name} is not for this source: only {wanted} is, and it has {got}")]
    NotForSource {
        /// The type.
        type_name: String,
        /// The condition in the parameters.
        wanted: String,
        /// The value found.
        got: String,
    },
    /// It tells frames that don't change, which are kept: no sample by themselves.
    #[error("transforms that don't change are kept, and are no sample")]
    Kept,
    /// There are no rows, or no values.
    #[error("a {type_name} without values: {rows} rows, {n_values} values")]
    Empty {
        /// The type.
        type_name: String,
        /// Rows that the message states.
        rows: u64,
        /// Values in it.
        n_values: usize,
    },
    /// The number of values is not rows times columns.
    #[error("a {type_name} of {rows} rows x {cols} taxels holds {n_values} values; expected {}", rows.saturating_mul(*cols))]
    Shape {
        /// The type.
        type_name: String,
        /// Rows, from the message or the parameters.
        rows: u64,
        /// Taxels, from the message or the parameters.
        cols: u64,
        /// Values in the message.
        n_values: usize,
    },
    /// The number of values is not a multiple of the number of rows.
    #[error("a {type_name} of {rows} rows holds {n_values} values, which don't divide into them")]
    Uneven {
        /// The type.
        type_name: String,
        /// Rows, from the message or the parameters.
        rows: u64,
        /// Values in the message.
        n_values: usize,
    },
    /// There are several rows, but the time between them is not known.
    #[error(
        "a {type_name} of {rows} rows has a row period of {row_period_ns} ns; expected more than 0: set row_period"
    )]
    RowPeriod {
        /// The type.
        type_name: String,
        /// Rows in the message.
        rows: u64,
        /// The row period; 0 if it is not known.
        row_period_ns: i64,
    },
    /// The force is not a single number.
    #[error(
        "a {type_name} holds {n_values} numbers where the force must be one; name one of them, such as forces[0].z"
    )]
    NotOneForce {
        /// The type.
        type_name: String,
        /// Numbers at the path.
        n_values: usize,
    },
    /// The number of coordinates is not three per point.
    #[error("a {type_name} holds {n_values} coordinates, which are not three a point")]
    Coordinates {
        /// The type.
        type_name: String,
        /// Numbers in the message.
        n_values: usize,
    },
    /// The message has too few points for a hand.
    #[error(
        "a {type_name} holds {n_points} points where at least {wanted} are wanted: correct hand.layout or hand.points"
    )]
    Points {
        /// The type.
        type_name: String,
        /// Points in the message.
        n_points: usize,
        /// Number of points up to the last one of the hand.
        wanted: usize,
    },
    /// The number of names, validity flags or orientations differs from the number of points.
    #[error("a {type_name} holds {n_points} points and {n_beside} names, validities or orientations; expected as many")]
    Beside {
        /// The type.
        type_name: String,
        /// Points in the message.
        n_points: usize,
        /// Number of names, flags or orientations.
        n_beside: usize,
    },
    /// The number of names differs from the number of angles.
    #[error("a {type_name} names {n_names} joints and holds {n_positions} positions; expected as many of both")]
    JointCount {
        /// The type.
        type_name: String,
        /// Names, from the message or the parameters.
        n_names: usize,
        /// Positions in the message.
        n_positions: usize,
    },
}

impl SampleError {
    /// True if the message is correct, but for another source.
    pub fn is_for_another(&self) -> bool {
        matches!(self, SampleError::NotForSource { .. } | SampleError::Kept)
    }

    /// Whether what it told is kept, so that nothing is lost.
    pub fn is_kept(&self) -> bool {
        *self == SampleError::Kept
    }

    /// Short name for counters, the same for all errors of a kind.
    pub fn reason(&self) -> &'static str {
        match self {
            SampleError::Read(ReadError { fault: CdrError::NoMatch { .. }, .. }) => "no_match",
            SampleError::Read(_) => "unreadable",
            SampleError::NotForSource { .. } | SampleError::Kept => "not_for_source",
            SampleError::Empty { .. } => "empty",
            SampleError::Shape { .. } | SampleError::Uneven { .. } | SampleError::NotOneForce { .. } => "shape",
            SampleError::RowPeriod { .. } => "row_period",
            SampleError::Coordinates { .. } | SampleError::Points { .. } | SampleError::Beside { .. } => "points",
            SampleError::JointCount { .. } => "joint_count",
        }
    }
}

/// Compiled condition that selects the messages of a source. Without one, all messages are for the source.
#[derive(Debug, Clone)]
struct OnlyPlan {
    condition: Option<(MessageCondition, String)>,
    type_name: String,
}

impl OnlyPlan {
    fn compile(only: Option<&String>, tree: &TypeTree) -> Result<Self, BindingError> {
        let compiled = |text: &String| match MessageCondition::compile(tree, text) {
            Ok(condition) => Ok((condition, text.clone())),
            Err(error) => Err(BindingError::Field { role: "only", error }),
        };
        Ok(OnlyPlan { condition: only.map(compiled).transpose()?, type_name: tree.type_name().to_owned() })
    }

    fn admit(&self, cdr: &[u8]) -> Result<(), SampleError> {
        let Some((condition, wanted)) = &self.condition else { return Ok(()) };
        let refused =
            |got| SampleError::NotForSource { type_name: self.type_name.clone(), wanted: wanted.clone(), got };
        condition.holds(cdr)?.map_err(refused)
    }
}

fn plan(role: &'static str, tree: &TypeTree, path: &str, read_as: ReadAs) -> Result<FieldPlan, BindingError> {
    FieldPlan::compile(tree, path, read_as).map_err(|error| BindingError::Field { role, error })
}
