//! What is exported, and how.

use std::path::{Path, PathBuf};

use super::ExportError;
use crate::model::BackendChoice;
use crate::sessions::{InAir, Shard};
use crate::zero::Wanted;

/// What is exported, and how.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    /// One recording each, which becomes one episode.
    pub bags: &'a [PathBuf],
    /// What is written.
    pub targets: Targets<'a>,
    /// Frames a second of the dataset, 1 to 10,000.
    pub fps: u32,
    /// How far back the tactile samples of a frame reach, ms, 1 to 10,000.
    pub tactile_window_ms: u32,
    /// What was done in these bags, in words.
    pub task: &'a str,
    /// The model that makes estimates; `None` for those in the bags where they hold some, else the models of the parameters.
    pub model: Option<&'a Path>,
    /// What runs the models; `None` for what the parameters say.
    pub backend: Option<BackendChoice>,
    /// Where the zero of the forces is from.
    pub zero: Wanted<'a>,
    /// What tells when nothing touches the glove; `None` for the annotations of the bags.
    pub in_air: Option<&'a InAir>,
    /// Whether a bag without the true force of the parameters is at fault.
    pub needs_truth: bool,
    /// Which share of the bags is exported, to a dataset that [`join`](super::join) takes; `None` for all of them. All bags
    /// are needed: the first that can be exported decides the layout of every shard.
    pub shard: Option<Shard>,
}

impl<'a> Request<'a> {
    /// Frames at 30 Hz, each with the tactile samples of 100 ms, by the estimates in the bags or the models of the
    /// parameters.
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

/// What an export writes: any of these.
#[derive(Debug, Clone, Copy, Default)]
pub struct Targets<'a> {
    /// Folder of a LeRobotDataset v3, which must not be there yet.
    pub lerobot: Option<&'a Path>,
    /// Every frame of every region as Parquet.
    pub parquet: Option<&'a Path>,
    /// Every frame of every region as CSV.
    pub csv: Option<&'a Path>,
    /// Whether a table that is there is replaced; a dataset never is.
    pub overwrite: bool,
}

impl Targets<'_> {
    /// Whether all of them can be written, before any work is done.
    ///
    /// # Errors
    /// [`ExportError::NoFolder`], [`ExportError::DatasetExists`] or [`ExportError::TableExists`].
    pub fn check(&self) -> Result<(), ExportError> {
        for path in self.paths() {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.is_dir());
            if let Some(folder) = folder {
                return Err(ExportError::NoFolder { path: path.to_owned(), folder: folder.to_owned() });
            }
        }
        if let Some(path) = self.lerobot.filter(|path| path.symlink_metadata().is_ok()) {
            return Err(ExportError::DatasetExists { path: path.to_owned() });
        }
        let mut tables = [self.parquet, self.csv].into_iter().flatten();
        match tables.find(|path| path.exists() && !self.overwrite) {
            Some(path) => Err(ExportError::TableExists { path: path.to_owned() }),
            None => Ok(()),
        }
    }

    pub(super) fn paths(&self) -> impl Iterator<Item = &Path> {
        [self.lerobot, self.parquet, self.csv].into_iter().flatten()
    }
}
