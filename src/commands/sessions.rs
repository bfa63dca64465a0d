//! Bags as sessions: where they are, what they are called, and why reading one stopped.

use std::path::{Path, PathBuf};

use super::Failure;
use super::setup::shown;
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

/// The bags that paths stand for: each is a bag, or a folder with bags in it, which come in the order of their names.
pub(super) fn find_bags(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut bags = Vec::new();
    for path in paths {
        if path.is_file() || is_bag_folder(path)? {
            bags.push(path.clone());
            continue;
        }
        let mut inside = Vec::new();
        for entry in entries(path)? {
            if entry.is_dir() && is_bag_folder(&entry)? {
                inside.push(entry);
            }
        }
        if inside.is_empty() {
            return Err(Failure(format!(
                "{}: expected a bag or a folder of bags, found none; give .mcap files or bag folders",
                path.display()
            )));
        }
        inside.sort();
        bags.extend(inside);
    }
    Ok(bags)
}

fn is_bag_folder(path: &Path) -> Result<bool, Failure> {
    if path.join("metadata.yaml").is_file() {
        return Ok(true);
    }
    Ok(entries(path)?.iter().any(|entry| entry.extension().is_some_and(|extension| extension == "mcap")))
}

fn entries(path: &Path) -> Result<Vec<PathBuf>, Failure> {
    let unreadable = |error: std::io::Error| Failure(format!("{}: {error}", path.display()));
    std::fs::read_dir(path)
        .map_err(unreadable)?
        .map(|entry| entry.map(|entry| entry.path()).map_err(unreadable))
        .collect()
}
