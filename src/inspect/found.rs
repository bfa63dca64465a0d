//! A bag or a model, by its path.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::report::{BagReport, InspectError};
use crate::bag::{Recordings, recordings_at};
use crate::location;
use crate::model::{self, ModelInfo};
use crate::observer::Observer;

/// The bag or the model at a path.
#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Inspected {
    /// A bag.
    Bag(Box<BagReport>),
    /// An ONNX model.
    Model(Box<ModelInfo>),
}

/// Reads the bag, or the ONNX model, at `path`. Message types that a bag doesn't define are looked for in the folder
/// `definitions`, then along `AMENT_PREFIX_PATH`.
///
/// # Errors
/// [`InspectError`] when it can't be read, or the observer cancels.
pub fn inspect(path: &Path, definitions: Option<&Path>, observer: &dyn Observer) -> Result<Inspected, InspectError> {
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("onnx")) {
        return Ok(Inspected::Model(Box::new(model::inspect(path)?)));
    }
    Ok(Inspected::Bag(Box::new(BagReport::read(path, definitions, observer)?)))
}

/// Each path, or the recordings that are files in it where it is a folder of several; and what is to be said of it, a line
/// each.
pub fn recordings(paths: &[PathBuf]) -> (Vec<PathBuf>, Vec<String>) {
    let mut found = Vec::new();
    let mut notes = Vec::new();
    for path in paths {
        match recordings_at(path) {
            Ok(Recordings { paths, note })
                if paths.iter().any(|one| one.parent() == Some(path) && location::is_file(one)) =>
            {
                found.extend(paths);
                notes.extend(note);
            }
            _ => found.push(path.clone()),
        }
    }
    (found, notes)
}

/// Each path, or all recordings in it where it is a folder of several, also those that are folders.
pub fn all_recordings(paths: &[PathBuf]) -> Vec<PathBuf> {
    let of_path = |path: &PathBuf| match recordings_at(path) {
        Ok(Recordings { paths, .. }) if !paths.is_empty() => paths,
        _ => vec![path.clone()],
    };
    paths.iter().flat_map(of_path).collect()
}
