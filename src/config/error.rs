//! Why a parameter file or a configuration is refused.

use super::names::NameError;

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
    #[error("{origin}: {key} = {value} is of type {got}, expected {expected}")]
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

/// A parameter file, or an override, that can't be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ParamError {
    /// The text is not YAML, or not such YAML as a parameter file may be.
    #[error("{file}:{line}: not a parameter file: {reason}")]
    Yaml {
        /// The file.
        file: String,
        /// From 1.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// A key above `ros__parameters` that is no node name.
    #[error("{file}:{line}: `{name}` is not a valid node name: {reason}")]
    NodeName {
        /// The file.
        file: String,
        /// From 1.
        line: usize,
        /// The name with its namespaces.
        name: String,
        /// What is wrong.
        reason: &'static str,
    },
    /// A value where `ros__parameters` was expected.
    #[error(
        "{file}:{line}: `{name}` has no `ros__parameters:` (two underscores) below it: write the parameters below that key"
    )]
    NoParametersKey {
        /// The file.
        file: String,
        /// From 1.
        line: usize,
        /// The name with its namespaces.
        name: String,
    },
    /// A parameter without a value.
    #[error("{file}:{line}: {key} has no value: give it one, or remove the key")]
    NoValue {
        /// The file.
        file: String,
        /// From 1.
        line: usize,
        /// The dotted key.
        key: String,
    },
    /// A parameter that a section sets twice.
    #[error("{file}:{line}: {key} was already set in line {first_line}: keep one of them")]
    Duplicate {
        /// The file.
        file: String,
        /// From 1.
        line: usize,
        /// The dotted key.
        key: String,
        /// Line of the other one.
        first_line: usize,
    },
    /// An array that no parameter can have.
    #[error("{file}:{line}: {key} is not an array of one type: {reason}")]
    Array {
        /// The file.
        file: String,
        /// From 1.
        line: usize,
        /// The dotted key.
        key: String,
        /// What is wrong.
        reason: String,
    },
    /// No section is meant for the node.
    #[error(
        "{files}: no parameters for the node {node}: the file has {names}; put them under `/**` for a node of any name, or \
         under `{node}` for this one only"
    )]
    NoSection {
        /// The files, separated by commas.
        files: String,
        /// The node's full name.
        node: String,
        /// The names that are there.
        names: String,
    },
    /// An override that is not `key:=value`.
    #[error("command line: `-p {rule}` is not an override: {reason}")]
    Override {
        /// What came after `-p`.
        rule: String,
        /// What is wrong.
        reason: String,
    },
}
