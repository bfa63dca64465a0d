//! Errors of a replay.

use std::path::PathBuf;

use crate::bag::{BagError, InputError};
use crate::fusion::{FusionError, SetupError};
use crate::model::ModelError;
use crate::observer::Cancelled;
use crate::zero::ZeroError;

/// A recording that can't be replayed to its end. Each message is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum ReplayError {
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error(transparent)]
    Setup(#[from] SetupError),
    #[error(transparent)]
    Zero(#[from] ZeroError),
    #[error(transparent)]
    Fusion(#[from] FusionError),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error(
        "topic {topic} is already in the input, --merge would mix two runs; choose another --node, or leave --merge out"
    )]
    TopicTaken { topic: String },
    #[error("{path}: is there already, but not whole; remove it, or give --overwrite")]
    NotWhole { path: PathBuf },
    #[error(
        "{path}: is there already without topic {topic}, so it is of another replay; remove it, or choose another folder"
    )]
    OtherTopics { path: PathBuf, topic: String },
    #[error(
        "tactile source {name}: none of its {rows} rows could be used, {wrong_length} had another length than tactile.{name}.n_taxels = {n_taxels}; correct it"
    )]
    Idle { name: String, rows: u64, wrong_length: u64, n_taxels: usize },
}
