//! Errors of parameter files and configurations.

use super::names::NameError;
use crate::fusion::SetupError;

/// A configuration that is refused. Every message gives place, key, value, and what was expected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// The parameter file can't be read.
    #[error("{file}: can't be read: {reason}")]
    Read {
        /// The file.
        file: String,
        /// The error of the system.
        reason: String,
    },
    /// The parameter file, or an override, is malformed.
    #[error(transparent)]
    Params(#[from] ParamError),
    /// Regions and sources don't fit each other.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The node's name is invalid.
    #[error(transparent)]
    NodeName(#[from] NameError),
    /// The node has no such parameter.
    #[error("{origin}: {key} is not a parameter of this node: {hint}")]
    Unknown {
        /// Where it was set.
        origin: String,
        /// The dotted key.
        key: String,
        /// The key that was probably meant.
        hint: String,
    },
    /// A value has the wrong type.
    #[error("{origin}: {key} = {value} is of type {got}, expected {expected}")]
    WrongType {
        /// Where it was set.
        origin: String,
        /// The dotted key.
        key: String,
        /// The value.
        value: String,
        /// Its type.
        got: &'static str,
        /// The parameter's type.
        expected: String,
    },
    /// A value is out of range.
    #[error("{origin}: {key} = {value} must be {range}")]
    OutOfRange {
        /// Where it was set.
        origin: String,
        /// The dotted key.
        key: String,
        /// The value.
        value: String,
        /// The allowed range.
        range: String,
    },
    /// A required parameter is not set.
    #[error("{files}: {key} is required: {about}")]
    Missing {
        /// The files that were read.
        files: String,
        /// The dotted key.
        key: String,
        /// Its meaning.
        about: String,
    },
    /// A value is in conflict with others.
    #[error("{origin}: {key} = {value} {problem}")]
    Refused {
        /// Where it was set.
        origin: String,
        /// The dotted key.
        key: String,
        /// The value.
        value: String,
        /// The conflict.
        problem: String,
    },
}

/// A parameter file or an override that can't be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ParamError {
    /// The text is not YAML, or uses YAML that parameter files may not use.
    #[error("{file}:{line}: not a parameter file: {reason}")]
    Yaml {
        /// The file.
        file: String,
        /// Line number, from 1.
        line: usize,
        /// The error.
        reason: String,
    },
    /// A key above `ros__parameters` is not a node name.
    #[error("{file}:{line}: `{name}` is not a valid node name: {reason}")]
    NodeName {
        /// The file.
        file: String,
        /// Line number, from 1.
        line: usize,
        /// The name with its namespaces.
        name: String,
        /// The error.
        reason: &'static str,
    },
    /// There is a value where `ros__parameters` was expected.
    #[error(
        "{file}:{line}: `{name}` has no `ros__parameters:` (two underscores) below it: write the parameters below that key"
    )]
    NoParametersKey {
        /// The file.
        file: String,
        /// Line number, from 1.
        line: usize,
        /// The name with its namespaces.
        name: String,
    },
    /// A parameter has no value.
    #[error("{file}:{line}: {key} has no value: give it one, or remove the key")]
    NoValue {
        /// The file.
        file: String,
        /// Line number, from 1.
        line: usize,
        /// The dotted key.
        key: String,
    },
    /// A section sets a parameter twice.
    #[error("{file}:{line}: {key} was already set in line {first_line}: keep one of them")]
    Duplicate {
        /// The file.
        file: String,
        /// Line number, from 1.
        line: usize,
        /// The dotted key.
        key: String,
        /// Line of the first value.
        first_line: usize,
    },
    /// An array can't be a parameter.
    #[error("{file}:{line}: {key} is not an array of one type: {reason}")]
    Array {
        /// The file.
        file: String,
        /// Line number, from 1.
        line: usize,
        /// The dotted key.
        key: String,
        /// The error.
        reason: String,
    },
    /// No section is for the node.
    #[error(
        "{files}: no parameters for the node {node}: the file has {names}; put them under `/**` for a node of any name, or \
         under `{node}` for this one only"
    )]
    NoSection {
        /// The files, separated by commas.
        files: String,
        /// The node's full name.
        node: String,
        /// The names that the files have.
        names: String,
    },
    /// An override is not of the form `key:=value`.
    #[error("command line: `-p {rule}` is not an override: {reason}")]
    Override {
        /// The text after `-p`.
        rule: String,
        /// The error.
        reason: String,
    },
}
