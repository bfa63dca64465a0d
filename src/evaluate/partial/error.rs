//! Why partials can't be merged.

use std::path::PathBuf;

use crate::columns::ColumnsError;
use crate::evaluate::EvaluateError;
use crate::observer::Cancelled;

/// Why partials can't be merged. Each text is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum MergeError {
    #[error(transparent)]
    Columns(#[from] ColumnsError),
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error("{path}: is no partial; expected a file that `tpf eval --partial` wrote")]
    NoPartial { path: PathBuf },
    #[error("{path}: was written by {got}, and this is {expected}; write all partials by this version")]
    Version { path: PathBuf, got: String, expected: String },
    #[error("{path}: is damaged: {reason}; write it again by `tpf eval --partial`")]
    Damaged { path: PathBuf, reason: String },
    #[error(
        "{first} and {other} were scored with different {what}, {ours} and {theirs}; merge only what was scored alike"
    )]
    Mixed { first: PathBuf, other: PathBuf, what: String, ours: String, theirs: String },
    #[error("{bag} is twice, in {first}{same} and in {other}; leave one of them out")]
    Twice { bag: String, first: PathBuf, other: PathBuf, same: String },
    #[error("{n} of {of} bags are in no partial: {names}; score them by `tpf eval --partial`")]
    Missing { n: usize, of: usize, names: String },
    #[error("{n} of {of} shards are missing: {names}; score them by `tpf eval --partial --shard`")]
    MissingShards { n: usize, of: usize, names: String },
    #[error("{n} bags are in partials and not expected: {names}; leave their partials out, or expect them")]
    Unexpected { n: usize, names: String },
    #[error("there is no bag in {n} partials; expected at least one")]
    NoBags { n: usize },
}
