//! The notes of a shard on the disk, with the checksums of its files: a shard that was damaged on its way is refused.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::notes::{ShardNotes, hex};
use crate::location;
use crate::sessions::hash_file;

/// The file that makes a dataset a shard, below its folder.
pub(super) const FILE: &str = "meta/tpf_shard.json";

/// Contents of the file.
#[derive(Serialize, Deserialize)]
struct Sealed {
    notes: ShardNotes,
    /// SHA-256 of each other file, by its path below the folder.
    files: BTreeMap<String, String>,
    /// SHA-256 of the notes and of these.
    sha256: String,
}

/// The text of the file for the shard in `folder`, whose other files are all there.
///
/// # Errors
/// [`io::Error`] when one of them can't be read.
pub(super) fn seal(folder: &Path, notes: &ShardNotes) -> io::Result<String> {
    let mut files = BTreeMap::new();
    for path in files_below(folder)? {
        let name = path.strip_prefix(folder).unwrap_or(&path).to_string_lossy().into_owned();
        if name != FILE {
            files.insert(name, sha256_of(&path)?);
        }
    }
    let sha256 = of_notes(notes, &files)?;
    Ok(serde_json::to_string_pretty(&Sealed { notes: notes.clone(), files, sha256 })? + "\n")
}

/// The notes of the shard in `folder`, if it is still what was sealed.
///
/// # Errors
/// The reason, in words.
pub(super) fn open(folder: &Path) -> Result<ShardNotes, String> {
    let text = match location::read_text(&folder.join(FILE)) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return Err("is no shard; expected what `tpf export --lerobot DIR --shard I/N` wrote".to_owned());
        }
        text => text.map_err(|error| format!("{FILE}: {error}"))?,
    };
    let sealed: Sealed = serde_json::from_str(&text).map_err(|error| format!("{FILE}: {error}"))?;
    let damaged = |name: &str, why: &str| format!("is damaged: {name} {why}; export this shard again");
    if of_notes(&sealed.notes, &sealed.files).ok().as_ref() != Some(&sealed.sha256) {
        return Err(damaged(FILE, "was changed after it was written"));
    }
    for (name, expected) in &sealed.files {
        match sha256_of(&folder.join(name)) {
            Ok(got) if got == *expected => {}
            Ok(_) => return Err(damaged(name, "was changed after it was written")),
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Err(damaged(name, "is missing")),
            Err(error) => return Err(format!("{name}: {error}")),
        }
    }
    Ok(sealed.notes)
}

/// Every file below a folder, in any order.
fn files_below(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let (mut files, mut folders) = (Vec::new(), vec![folder.to_path_buf()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder)? {
            let entry = entry?;
            if entry.file_type()?.is_dir() { folders.push(entry.path()) } else { files.push(entry.path()) }
        }
    }
    Ok(files)
}

fn of_notes(notes: &ShardNotes, files: &BTreeMap<String, String>) -> io::Result<String> {
    Ok(hex(Sha256::digest(serde_json::to_string(&(notes, files))?)))
}

fn sha256_of(path: &Path) -> io::Result<String> {
    let mut hash = Sha256::new();
    hash_file(&mut hash, path)?;
    Ok(hex(hash.finalize()))
}
