//! Gates of `tpf eval`: their file, and the reference values beside it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use tactile_pose_fusion::eval::{Check, Gates, Scored};
use tactile_pose_fusion::evaluate::Evaluated;
use tactile_pose_fusion::files;
use tactile_pose_fusion::location;

use super::super::{Failure, tell};

/// A file of gates that was read.
pub(super) struct GateFile {
    gates: Gates,
    /// Where the reference values are kept, where gates need them.
    reference: Option<PathBuf>,
}

impl GateFile {
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        let in_file = |error: &dyn std::fmt::Display| {
            let error = error.to_string();
            Failure(format!("{}: {}", path.display(), error.lines().next().unwrap_or_default()))
        };
        let text = location::read_text(path).map_err(|error| in_file(&error))?;
        let gates: Gates = serde_saphyr::from_str(&text).map_err(|error| in_file(&error))?;
        gates.check().map_err(|error| in_file(&error))?;
        let beside = |file: &PathBuf| match location::local(file) {
            Some(file) => path.parent().unwrap_or(Path::new("")).join(file),
            None => file.clone(),
        };
        let reference = gates.reference.as_ref().map(beside);
        Ok(GateFile { gates, reference })
    }

    /// Holds what was judged against the gates; with `update`, what was found becomes the reference first.
    pub(super) fn judge(&self, result: &Evaluated, update: bool) -> Result<Vec<Check>, Failure> {
        let Some(judged) = result.models.last() else { return Ok(Vec::new()) };
        let scored = Scored { all: &judged.by, free_movement: &judged.free_movement, contacts: &judged.contacts };
        let reference = match (&self.reference, update) {
            (None, true) => {
                return Err(Failure(
                    "--update-refs: no gate has a reference; give the file of gates a line `reference: FILE`"
                        .to_owned(),
                ));
            }
            (None, false) => BTreeMap::new(),
            (Some(path), true) => {
                let found = self.gates.references(scored);
                let text = serde_json::to_string_pretty(&found)? + "\n";
                let failed = |error: std::io::Error| Failure(format!("{}: {error}", path.display()));
                files::replace(path, text.as_bytes()).map_err(failed)?;
                tell(&format!("{}: now holds {} reference values", path.display(), found.len()));
                found
            }
            (Some(path), false) => read_reference(path)?,
        };
        Ok(self.gates.judge(scored, &reference))
    }
}

fn read_reference(path: &Path) -> Result<BTreeMap<String, f64>, Failure> {
    let text = location::read_text(path)
        .map_err(|error| Failure(format!("{}: {error}; --update-refs writes it", path.display())))?;
    serde_json::from_str(&text).map_err(|error| Failure(format!("{}: {error}", path.display())))
}
