//! Why no parameter file was written.

use std::path::PathBuf;

use super::ask::InitError;
use crate::model::ModelError;

/// Why no parameter file was written. Each text is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum InitFileError {
    #[error(transparent)]
    Init(#[from] InitError),
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error("{} is there already; give another name, or --overwrite", path.display())]
    Exists { path: PathBuf },
    #[error("{}: {reason}", path.display())]
    Path { path: PathBuf, reason: String },
    #[error("the bags make no parameter file that loads: {reason}")]
    DoesNotLoad { reason: String },
}
