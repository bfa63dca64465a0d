//! What turns one raw message into samples for the core: shared by bag replay and the live node, so that both read a
//! message alike.

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
pub use hand::{HandFields, hand_paths, hand_stamp};
pub use joints::{JointBinding, JointFields, JointMessage, NamesFrom};
pub use samples::SampleBinding;
pub use stamp::{Since, StampFrom, StampUnit};
pub use static_frames::{FramesBinding, static_topic};
pub use taxels::{CountFrom, PeriodFrom, TaxelBinding, TaxelFields, TaxelMessage};
pub use truth::{ForceFields, ForceReading, TruthBinding, TruthFields};

use super::cdr::CdrError;
use super::definition::TypeTree;
use super::dynamic::{FieldError, FieldPlan, MessageCondition, ReadAs, ReadError};

/// A topic to read: what it is called, what is on it, and where in its messages the fields are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic<Fields> {
    /// Absolute name.
    pub name: String,
    /// Canonical name of its message type.
    pub type_name: String,
    /// [`TaxelFields`], [`JointFields`] or [`TruthFields`].
    pub fields: Fields,
}

/// Why fields can't be bound to a message type.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BindingError {
    /// A path does not lead to what is needed.
    #[error("{role}: {error}")]
    Field {
        /// What the field is for: the key of the parameters.
        role: &'static str,
        /// What is wrong with it.
        error: FieldError,
    },
    /// Nothing says where stamps come from, and the type has none.
    #[error(
        "stamp: {type_name} has no field that is known to be its stamp; give a field path, or 'receipt' for the time of arrival"
    )]
    NoStamp {
        /// The type.
        type_name: String,
    },
    /// A message counter that is no whole number.
    #[error("sequence: field '{path}' of {type_name} is {found}, but a whole number must be there; leave it out")]
    NoCounter {
        /// The path.
        path: String,
        /// The type.
        type_name: String,
        /// What the field is.
        found: String,
    },
    /// A stamp that can't be one.
    #[error("stamp: field '{path}' of {type_name} is {found}, {problem}")]
    Stamp {
        /// The path.
        path: String,
        /// The type.
        type_name: String,
        /// What the field is.
        found: String,
        /// What is wrong with it, and what to write.
        problem: &'static str,
    },
    /// A constant that can't be right.
    #[error("{role}: expected {expected}, got {got}")]
    Constant {
        /// What it is for: the key of the parameters.
        role: &'static str,
        /// What must be there.
        expected: &'static str,
        /// What came.
        got: String,
    },
}

/// Why a message holds no sample. Each is a drop to be counted under [`reason`](Self::reason).
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SampleError {
    /// The bytes are not what the definition says.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// It is for another source.
    #[error("a {type_name} is not for this source: only {wanted} is, and it has {got}")]
    NotForSource {
        /// The type.
        type_name: String,
        /// What the parameters ask for.
        wanted: String,
        /// What the field is instead.
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
    /// Rows and columns don't make up the values.
    #[error("a {type_name} of {rows} rows x {cols} taxels holds {n_values} values; expected {}", rows.saturating_mul(*cols))]
    Shape {
        /// The type.
        type_name: String,
        /// Rows that the message or the parameters state.
        rows: u64,
        /// Taxels that the message or the parameters state.
        cols: u64,
        /// Values in the message.
        n_values: usize,
    },
    /// The values don't divide into the rows.
    #[error("a {type_name} of {rows} rows holds {n_values} values, which don't divide into them")]
    Uneven {
        /// The type.
        type_name: String,
        /// Rows that the message or the parameters state.
        rows: u64,
        /// Values in the message.
        n_values: usize,
    },
    /// Several rows, and no time between them.
    #[error(
        "a {type_name} of {rows} rows has a row period of {row_period_ns} ns; expected more than 0: set row_period"
    )]
    RowPeriod {
        /// The type.
        type_name: String,
        /// Rows in the message.
        rows: u64,
        /// What came; 0 when nothing says.
        row_period_ns: i64,
    },
    /// A force that is not one number.
    #[error(
        "a {type_name} holds {n_values} numbers where the force must be one; name one of them, such as forces[0].z"
    )]
    NotOneForce {
        /// The type.
        type_name: String,
        /// Numbers at the path.
        n_values: usize,
    },
    /// Coordinates that are not three a point.
    #[error("a {type_name} holds {n_values} coordinates, which are not three a point")]
    Coordinates {
        /// The type.
        type_name: String,
        /// Numbers in the message.
        n_values: usize,
    },
    /// Fewer points than a hand has.
    #[error(
        "a {type_name} holds {n_points} points where at least {wanted} are wanted: correct hand.layout or hand.points"
    )]
    Points {
        /// The type.
        type_name: String,
        /// Points in the message.
        n_points: usize,
        /// Points up to the last one of the hand.
        wanted: usize,
    },
    /// Names, validities or orientations that are not as many as the points.
    #[error("a {type_name} holds {n_points} points and {n_beside} names, validities or orientations; expected as many")]
    Beside {
        /// The type.
        type_name: String,
        /// Points in the message.
        n_points: usize,
        /// What stands beside them.
        n_beside: usize,
    },
    /// Names and angles of joints are not equally many.
    #[error("a {type_name} names {n_names} joints and holds {n_positions} positions; expected as many of both")]
    JointCount {
        /// The type.
        type_name: String,
        /// Names, of the message or the parameters.
        n_names: usize,
        /// Positions in the message.
        n_positions: usize,
    },
}

impl SampleError {
    /// Whether nothing is wrong with the message: it is for another source.
    pub fn is_for_another(&self) -> bool {
        matches!(self, SampleError::NotForSource { .. } | SampleError::Kept)
    }

    /// Whether what it told is kept, so that nothing is lost.
    pub fn is_kept(&self) -> bool {
        *self == SampleError::Kept
    }

    /// A short name for counters, the same for every error of a kind.
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

/// Whether a message is for a source, compiled; all messages are where nothing is asked for.
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
