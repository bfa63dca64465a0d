//! Another calibration file for a running node, by a request that sets `calibration.file`.
//!
//! Everyone who may set parameters then decides which file this process reads, and `~/calibrate` writes to it. So the
//! file must lie in the folder of the calibration file that the node was started with, and must be a calibration that
//! fits: nobody makes the node read, wait for or replace any other file.

use std::path::{Path, PathBuf};

use ros2_client::parameters::raw;
use tokio::sync::oneshot;

use super::engine::Command;
use super::lifecycle::State;
use super::parameters::{from_raw, shown, to_raw};
use super::shared::Shared;
use crate::config::{Config, ParamValue};
use crate::ros::wire::args::Severity;
use crate::zero::{self, KnownModels, Zero};

/// The parameter that names the file.
const KEY: &str = "calibration.file";

/// Puts the calibration that these changes name into use, if they name one. Returns the changes with the file's full path.
///
/// # Errors
/// The reason in one line; the zero is what it was, and nothing is to be set.
pub(super) async fn load(shared: &Shared, changes: &[raw::Parameter]) -> Result<Vec<raw::Parameter>, String> {
    let mut changes = changes.to_vec();
    let Some(last) = changes.iter().rposition(|change| change.name == KEY) else { return Ok(changes) };
    let Some(ParamValue::Str(asked)) = from_raw(&changes[last].value) else {
        return Err(format!("{KEY} must be a string: the path of a calibration file"));
    };
    if !matches!(shared.managed.state(), State::Inactive | State::Active) {
        let state = shared.managed.state().label();
        return Err(format!("{KEY} is checked with the models, and the node is {state}; configure it first"));
    }
    let path = admitted(shared.calibration_folder.as_deref(), &asked)?;
    for change in changes.iter_mut().filter(|change| change.name == KEY) {
        change.value = to_raw(Some(&ParamValue::Str(path.display().to_string())), None);
    }
    let mut tried = shared.parameters.borrow().clone();
    tried.set(&changes)?;
    if shared.calibrating.replace(true) {
        return Err("a calibration is under way; wait until it is over".to_owned());
    }
    let loaded = put_into_use(shared, tried.config().clone(), path).await;
    shared.calibrating.set(false);
    loaded.map(|()| changes)
}

async fn put_into_use(shared: &Shared, cfg: Config, path: PathBuf) -> Result<(), String> {
    let known: KnownModels = shared.known.borrow().clone();
    let from = path.display().to_string();
    let reading = tokio::task::spawn_blocking(move || zero::from_file(&path, &cfg, &known));
    let Zero { donning, notes, .. } =
        reading.await.map_err(|error| error.to_string())?.map_err(|error| error.to_string())?;
    let (reply, installed) = oneshot::channel();
    let told = shared.commands.send(Command::Calibrated(Box::new(donning), from.clone(), reply));
    let gone = || Err("the thread that estimates has ended; restart the node".to_owned());
    if told.is_ok() { installed.await.unwrap_or_else(|_| gone()) } else { gone() }?;
    shared.managed.calibration.take(); // from now on the parameter names it
    notes.into_iter().for_each(|note| shared.outbox.log(Severity::Warn, note));
    shared.outbox.log(Severity::Info, format!("calibration {from}"));
    Ok(())
}

/// The full path of a file in the folder from which calibrations may be loaded. The refusal is the same for any other
/// path, so that it tells nothing about other folders.
fn admitted(folder: Option<&Path>, asked: &str) -> Result<PathBuf, String> {
    let Some(folder) = folder else {
        return Err(format!(
            "{KEY} can be set while the node runs if it was started with a calibration file, because files are taken from its folder alone; start it with {KEY} or --calibration"
        ));
    };
    let refused = || {
        format!(
            "{KEY}: no file {} in {}: this node takes calibrations only from the folder of the file that it was started with",
            shown(asked),
            folder.display()
        )
    };
    let inside = folder.canonicalize().map_err(|_| refused())?;
    let path = inside.join(asked).canonicalize().map_err(|_| refused())?;
    if path.starts_with(&inside) && path.is_file() { Ok(path) } else { Err(refused()) }
}

/// The folder from which calibrations may be loaded: that of the file of the start.
pub(super) fn folder(file: &Path) -> PathBuf {
    match file.parent() {
        Some(parent) if parent != Path::new("") => parent.to_owned(),
        _ => PathBuf::from("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_in_the_folder_of_the_start_are_admitted() {
        let root = tempfile::tempdir().unwrap();
        let zeros = root.path().join("zeros");
        std::fs::create_dir_all(zeros.join("old")).unwrap();
        for file in ["zeros/a.yaml", "zeros/old/b.yaml", "secret.yaml"] {
            std::fs::write(root.path().join(file), "").unwrap();
        }
        std::os::unix::fs::symlink(root.path().join("secret.yaml"), zeros.join("link.yaml")).unwrap();
        let admitted = |asked: &str| admitted(Some(&zeros), asked);
        let full = |file: &str| root.path().canonicalize().unwrap().join(file);
        assert_eq!(admitted("a.yaml"), Ok(full("zeros/a.yaml")));
        assert_eq!(admitted(&full("zeros/old/b.yaml").display().to_string()), Ok(full("zeros/old/b.yaml")));
        for asked in ["../secret.yaml", "/etc/passwd", "/nowhere", "link.yaml", "old", "missing.yaml", "", "/dev/zero"]
        {
            let text = admitted(asked).unwrap_err();
            assert!(text.starts_with(&format!("calibration.file: no file {asked} in ")), "{text}");
        }
        assert!(
            super::admitted(None, "a.yaml").unwrap_err().ends_with("start it with calibration.file or --calibration")
        );
        assert_eq!(folder(Path::new("zero.yaml")), Path::new("."));
        assert_eq!(folder(Path::new("/z/zero.yaml")), Path::new("/z"));
    }
}
