//! Bags as sessions: where they are, what they are called, and why reading one stopped.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::setup::shown;
use super::{Failure, say};
use crate::bag::{BagReader, Recordings, recordings_at};
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

/// The recordings that paths stand for: each is one, or a folder of several. Says what was found in a folder.
pub(super) fn find_bags(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut bags = Vec::new();
    for path in paths {
        let Recordings { paths, note } = recordings_at(path)?;
        bags.extend(paths);
        note.iter().for_each(|note| say(note));
    }
    Ok(bags)
}

/// Opens one recording, or several that are parts of one. Says how the files of a folder are read.
pub(super) fn open(bags: &[PathBuf]) -> Result<BagReader, Failure> {
    let reader = BagReader::open(bags)?;
    reader.notes().iter().for_each(|note| say(note));
    Ok(reader)
}

/// SHA-256 of the files of a bag one after the other, in hexadecimal.
pub(super) fn fingerprint(bag: &Path) -> Result<String, Failure> {
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 20];
    for path in BagReader::open(&[bag.to_path_buf()])?.files() {
        let failed = |error: std::io::Error| Failure(format!("{}: {error}", path.display()));
        let mut file = File::open(path).map_err(failed)?;
        loop {
            match file.read(&mut buffer).map_err(failed)? {
                0 => break,
                n => hash.update(&buffer[..n]),
            }
        }
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}
