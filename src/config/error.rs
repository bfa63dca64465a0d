//! Why a configuration is refused.

use super::names::NameError;
use super::param_file::ParamError;

/// A configuration that is refused. Every text names where, which key, what came and what was expected.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// The parameter file can't be read.
    #[error("{file}: can't be read: {reason}")]
    Read {
        /// The file.
        file: String,
        /// What the system says.
        reason: String,
    },
    /// The parameter file, or an override, is malformed.
    #[error(transparent)]
    Params(#[from] ParamError),
    /// The node's own name is no name.
    #[error(transparent)]
    NodeName(#[from] NameError),
    /// A key that this node doesn't know.
    #[error("{origin}: {key} is not a parameter of this node: {hint}")]
    Unknown {
        /// Where it was set.
        origin: String,
        /// The dotted key.
        key: String,
        /// What may have been meant.
        hint: String,
    },
    /// A value of another type.
    #[error("{origin}: {key} = {value} is a {got}, expected {expected}")]
    WrongType {
        /// Where it was set.
        origin: String,
        /// The dotted key.
        key: String,
        /// What came.
        value: String,
        /// Its type.
        got: &'static str,
        /// The parameter's type.
        expected: String,
    },
    /// A value that its key doesn't allow.
    #[error("{origin}: {key} = {value} must be {range}")]
    OutOfRange {
        /// Where it was set.
        origin: String,
        /// The dotted key.
        key: String,
        /// What came.
        value: String,
        /// What is allowed.
        range: String,
    },
    /// A key that must be set and isn't.
    #[error("{files}: {key} is required: {about}")]
    Missing {
        /// The files that were read.
        files: String,
        /// The dotted key.
        key: String,
        /// What it means.
        about: String,
    },
    /// A value that doesn't go together with others.
    #[error("{origin}: {key} = {value} {problem}")]
    Refused {
        /// Where it was set.
        origin: String,
        /// The dotted key.
        key: String,
        /// What came.
        value: String,
        /// What is wrong with it.
        problem: String,
    },
}
