//! Bags as sessions: where they are, and what they are called.

use std::path::PathBuf;

#[cfg(feature = "ros")]
use tactile_pose_fusion::bag::BagReader;
use tactile_pose_fusion::sessions;

use super::Failure;
#[cfg(feature = "ros")]
use super::tell;
use crate::report::progress::Said;

/// The recordings that paths stand for: each is one, or a folder of several. Says what was found in a folder.
pub(super) fn find_bags(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    Ok(sessions::find_bags(paths, &Said)?)
}

/// Opens one recording, or several that are parts of one. Says how the files of a folder are read.
#[cfg(feature = "ros")]
pub(super) fn open(bags: &[PathBuf]) -> Result<BagReader, Failure> {
    let reader = BagReader::open(bags)?;
    reader.notes().iter().for_each(|note| tell(note));
    Ok(reader)
}
