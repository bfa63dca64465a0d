//! Bags as sessions: where they are, and what they are called.

use std::path::PathBuf;

use super::progress::Said;
use super::{Failure, tell};
use crate::bag::BagReader;
use crate::sessions;

/// The recordings that paths stand for: each is one, or a folder of several. Says what was found in a folder.
pub(super) fn find_bags(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    Ok(sessions::find_bags(paths, &Said)?)
}

/// Opens one recording, or several that are parts of one. Says how the files of a folder are read.
pub(super) fn open(bags: &[PathBuf]) -> Result<BagReader, Failure> {
    let reader = BagReader::open(bags)?;
    reader.notes().iter().for_each(|note| tell(note));
    Ok(reader)
}
