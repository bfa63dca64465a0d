//! What turns one raw message into samples for the core: shared by bag replay and the live node, so that both read a
//! message alike.

mod hand;
mod joints;
mod samples;
mod taxels;
mod truth;

pub use hand::{HandFields, hand_paths};
pub use joints::{JointBinding, JointFields, JointMessage, NamesFrom};
pub use samples::SampleBinding;
pub use taxels::{CountFrom, PeriodFrom, TaxelBinding, TaxelFields, TaxelMessage};
pub use truth::{TruthBinding, TruthFields};

use super::definition::TypeTree;
use super::dynamic::{FieldError, FieldPlan, ReadAs, ReadError};
use crate::units::Stamp;

/// Where the stamp of a message is taken from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StampFrom {
    /// A `builtin_interfaces/Time` of the message.
    Field(String),
    /// When the message was received: `log_time` in a bag. For types without a stamp, and only when it is asked for.
    Receipt,
}

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
    /// A message counter that wraps too early to be told from lost messages.
    #[error(
        "sequence: field '{path}' of {type_name} is {found}, but an unsigned counter of at least 32 bits must be there; leave it out"
    )]
    NarrowSequence {
        /// The path.
        path: String,
        /// The type.
        type_name: String,
        /// What the field is.
        found: String,
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
    /// A short name for counters, the same for every error of a kind.
    pub fn reason(&self) -> &'static str {
        match self {
            SampleError::Read(_) => "unreadable",
            SampleError::Empty { .. } => "empty",
            SampleError::Shape { .. } | SampleError::Uneven { .. } | SampleError::NotOneForce { .. } => "shape",
            SampleError::RowPeriod { .. } => "row_period",
            SampleError::Coordinates { .. } | SampleError::Points { .. } | SampleError::Beside { .. } => "points",
            SampleError::JointCount { .. } => "joint_count",
        }
    }
}

/// Compiled [`StampFrom`].
#[derive(Debug, Clone)]
enum StampPlan {
    Field(FieldPlan),
    Receipt,
}

impl StampPlan {
    fn compile(from: Option<&StampFrom>, tree: &TypeTree) -> Result<Self, BindingError> {
        match from {
            Some(StampFrom::Field(path)) => Ok(StampPlan::Field(plan("stamp", tree, path, ReadAs::Stamp)?)),
            Some(StampFrom::Receipt) => Ok(StampPlan::Receipt),
            None => Err(BindingError::NoStamp { type_name: tree.type_name().to_owned() }),
        }
    }

    fn read(&self, cdr: &[u8], received: Stamp) -> Result<Stamp, ReadError> {
        match self {
            StampPlan::Field(plan) => plan.read_stamp(cdr),
            StampPlan::Receipt => Ok(received),
        }
    }
}

fn plan(role: &'static str, tree: &TypeTree, path: &str, read_as: ReadAs) -> Result<FieldPlan, BindingError> {
    FieldPlan::compile(tree, path, read_as).map_err(|error| BindingError::Field { role, error })
}
