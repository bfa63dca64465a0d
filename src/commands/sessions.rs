//! Bags as sessions: where they are, what they are called, and why reading one stopped.

use std::path::{Path, PathBuf};

use super::Failure;
use super::setup::shown;
use crate::bag::bags_at;
use crate::recording::RecordingError;

/// Why the reading of a session ended before its end.
pub(super) enum Stopped {
    /// The session is at fault.
    Recording(RecordingError),
    /// Something else is, or the user.
    Failure(Failure),
}

impl From<RecordingError> for Stopped {
    fn from(error: RecordingError) -> Self {
        Stopped::Recording(error)
    }
}

impl From<Failure> for Stopped {
    fn from(failure: Failure) -> Self {
        Stopped::Failure(failure)
    }
}

impl Stopped {
    /// The failure, with the bag where that is at fault.
    pub(super) fn of_bag(self, bag: &Path) -> Failure {
        match self {
            Stopped::Recording(error) => Failure(format!("{}: {error}", bag.display())),
            Stopped::Failure(failure) => failure,
        }
    }
}

/// What a session is called in results: its bag, without the folder it lies in.
pub(super) fn session_name(bag: &Path) -> String {
    bag.file_stem().map_or_else(|| shown(bag), |name| name.to_string_lossy().into_owned())
}

/// The bags that paths stand for: each is a bag, or a folder with bags in it.
pub(super) fn find_bags(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut bags = Vec::new();
    for path in paths {
        bags.extend(bags_at(path)?);
    }
    Ok(bags)
}
