//! Errors of sessions.

use std::fmt::Display;
use std::path::Path;

use crate::bag::{BagError, InputError};
use crate::fusion::SetupError;
use crate::observer::Cancelled;
use crate::recording::RecordingError;

/// A session that can't be read or estimated. Each message is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum SessionError {
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Setup(#[from] SetupError),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error("{path}: {reason}")]
    At { path: String, reason: String },
}

impl SessionError {
    /// An error in a file or bag.
    pub fn at(path: &Path, reason: &dyn Display) -> Self {
        SessionError::At { path: path.display().to_string(), reason: reason.to_string() }
    }

    /// The error with the name of the bag, if the bag's content caused it.
    pub(crate) fn of_bag(self, bag: &Path) -> Self {
        match self {
            SessionError::Recording(error) => SessionError::at(bag, &error),
            other => other,
        }
    }
}
