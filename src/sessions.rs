//! Reads recorded sessions for evaluation and export: annotations, the tared true force, and the estimates of models or
//! of the recording.

mod compared;
mod error;
mod in_air;
mod labelled;
mod modelled;
mod shard;
mod touches;

use std::io::Read as _;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

pub use compared::{Compared, compare};
pub use error::SessionError;
pub use in_air::{InAir, MARGIN, annotated, without_annotations};
pub use labelled::{Labelled, NeedsTruth};
pub use modelled::{ModelRun, Modelled, hold_estimates, read_estimates, recorded, run_models};
pub use shard::{Shard, ShardError};
pub use touches::{KnownForces, RegionTouches, TruthReading, force_gains, live_force_gains};

use crate::bag::{BagError, BagReader, Recordings, recordings_at, shown};
use crate::location;
use crate::observer::Observer;

/// Name of a session in results: the name of its bag without folder and extension.
pub fn session_name(bag: &Path) -> String {
    bag.file_stem().map_or_else(|| shown(bag), |name| name.to_string_lossy().into_owned())
}

/// The recordings at these paths. Each path is a recording, or a folder with several, which is noted.
///
/// # Errors
/// [`BagError`] if there are none.
pub fn find_bags(paths: &[PathBuf], observer: &dyn Observer) -> Result<Vec<PathBuf>, BagError> {
    let mut bags = Vec::new();
    for path in paths {
        let Recordings { paths, note } = recordings_at(path)?;
        bags.extend(paths);
        note.iter().for_each(|note| observer.note(note));
    }
    Ok(bags)
}

/// SHA-256 of the concatenated files of a bag, in hexadecimal.
///
/// # Errors
/// [`SessionError`] if a file can't be read.
pub fn fingerprint(bag: &Path) -> Result<String, SessionError> {
    let mut hash = Sha256::new();
    for path in BagReader::open(&[bag.to_path_buf()])?.files() {
        hash_file(&mut hash, path).map_err(|error| SessionError::at(path, &error))?;
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Adds the content of a file to a hash.
pub(crate) fn hash_file(hash: &mut Sha256, path: &Path) -> std::io::Result<()> {
    let mut file = location::open(path)?;
    let mut buffer = vec![0; 1 << 20];
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(()),
            n => hash.update(&buffer[..n]),
        }
    }
}
