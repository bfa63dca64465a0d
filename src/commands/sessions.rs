//! Bags as sessions: where they are, what they are called, and why reading one stopped.

use std::path::{Path, PathBuf};

use super::progress::Said;
use super::{Failure, say};
use crate::bag::BagReader;
use crate::recording::RecordingError;
use crate::sessions;
pub(super) use crate::sessions::session_name;

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

/// The recordings that paths stand for: each is one, or a folder of several. Says what was found in a folder.
pub(super) fn find_bags(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    Ok(sessions::find_bags(paths, &Said)?)
}

/// Opens one recording, or several that are parts of one. Says how the files of a folder are read.
pub(super) fn open(bags: &[PathBuf]) -> Result<BagReader, Failure> {
    let reader = BagReader::open(bags)?;
    reader.notes().iter().for_each(|note| say(note));
    Ok(reader)
}
