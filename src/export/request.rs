//! Options of an export.

use std::path::{Path, PathBuf};

use super::ExportError;
use crate::bag::shown;
use crate::location;
use crate::model::BackendChoice;
use crate::sessions::{InAir, Shard};
use crate::zero::Wanted;

/// Options of an export.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    /// Recordings. Each becomes one episode.
    pub bags: &'a [PathBuf],
    /// Outputs.
    pub targets: Targets<'a>,
    /// Frames per second of the dataset, 1 to 10,000.
    pub fps: u32,
    /// Length of the tactile window of a frame, ms, 1 to 10,000.
    pub tactile_window_ms: u32,
    /// Description of the task in these bags.
    pub task: &'a str,
    /// Model for the estimates. `None` uses the estimates of a bag if it has some, or else the models of the
    /// parameters.
    pub model: Option<&'a Path>,
    /// Runtime for the models. `None` uses the parameter.
    pub backend: Option<BackendChoice>,
    /// Source of the zero of the forces.
    pub zero: Wanted<'a>,
    /// Times in which nothing touches the glove. `None` uses the annotations of the bags.
    pub in_air: Option<&'a InAir>,
    /// True if a bag fails without the true force that the parameters name.
    pub needs_truth: bool,
    /// The shard of the bags to export, to a dataset that [`join`](super::join) reads. `None` exports all bags. `bags`
    /// must always have all bags, because the first one that can be exported defines the layout of every shard.
    pub shard: Option<Shard>,
}

impl<'a> Request<'a> {
    /// Options for 30 frames per second, each with the tactile samples of 100 ms. The estimates are from the bags or
    /// from the models of the parameters.
    pub fn new(bags: &'a [PathBuf], targets: Targets<'a>) -> Self {
        Request {
            bags,
            targets,
            fps: 30,
            tactile_window_ms: 100,
            task: "manipulation with a tactile glove",
            model: None,
            backend: None,
            zero: Wanted::Any,
            in_air: None,
            needs_truth: false,
            shard: None,
        }
    }
}

/// Outputs of an export, one or more.
#[derive(Debug, Clone, Copy, Default)]
pub struct Targets<'a> {
    /// Folder of a LeRobotDataset v3, which must not exist.
    pub lerobot: Option<&'a Path>,
    /// Parquet file with every frame of every region.
    pub parquet: Option<&'a Path>,
    /// CSV file with every frame of every region.
    pub csv: Option<&'a Path>,
    /// True if an existing table is replaced. A dataset is never replaced.
    pub overwrite: bool,
}

impl Targets<'_> {
    /// Checks that all of them can be written, before the work begins.
    ///
    /// # Errors
    /// [`ExportError::NoFolder`], [`ExportError::DatasetExists`] or [`ExportError::TableExists`].
    pub fn check(&self) -> Result<(), ExportError> {
        for path in self.paths() {
            let Some(path) = location::local(path) else { continue };
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.is_dir());
            if let Some(folder) = folder {
                return Err(ExportError::NoFolder { path: path.to_path_buf(), folder: folder.to_owned() });
            }
        }
        let tables = [self.parquet, self.csv].into_iter().flatten().map(|path| (path, self.overwrite));
        for (path, overwrite) in self.lerobot.map(|path| (path, false)).into_iter().chain(tables) {
            location::check_output(path, overwrite).map_err(|error| match error.kind() {
                std::io::ErrorKind::AlreadyExists if self.lerobot == Some(path) => {
                    ExportError::DatasetExists { path: path.to_owned() }
                }
                std::io::ErrorKind::AlreadyExists => ExportError::TableExists { path: path.to_owned() },
                _ => ExportError::Io { path: shown(path), error },
            })?;
        }
        Ok(())
    }

    pub(super) fn paths(&self) -> impl Iterator<Item = &Path> {
        [self.lerobot, self.parquet, self.csv].into_iter().flatten()
    }
}
