//! Checkpoints: a run on disk.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::super::error::TrainError;
use super::super::network::Network;
use super::adam::Adam;
use super::config::TrainConfig;
use super::validation::Validation;
use crate::files;

/// Version of the file.
pub(super) const FORMAT: u32 = 1;

/// Size limit of a checkpoint: far above that of the paper's network, about 4 MiB.
const MAX_BYTES: u64 = 1 << 30;

/// A run between two steps: all data needed to resume, and the best network so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    pub(super) format: u32,
    pub(super) tool_version: String,
    /// [`Dataset::fingerprint`](super::super::Dataset::fingerprint) of the data.
    pub(super) dataset: String,
    pub(super) cfg: TrainConfig,
    pub(super) step: u64,
    pub(super) network: Network,
    pub(super) adam: Adam,
    pub(super) best: Option<Best>,
}

/// The best network so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Best {
    pub(super) step: u64,
    pub(super) validation: Validation,
    pub(super) network: Network,
}

impl Checkpoint {
    /// Writes it under a temporary name beside `path`, then renames it: a crash leaves the previous file.
    ///
    /// # Errors
    /// [`TrainError::File`].
    pub fn save(&self, path: &Path) -> Result<(), TrainError> {
        let failed = |reason: std::io::Error| TrainError::File { path: path.to_path_buf(), reason };
        let text = serde_json::to_vec(self).map_err(|e| failed(e.into()))?;
        files::replace(path, &text).map_err(failed)
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// [`TrainError::File`], [`TrainError::Checkpoint`].
    pub fn load(path: &Path) -> Result<Self, TrainError> {
        let failed = |reason| TrainError::File { path: path.to_path_buf(), reason };
        let refuse = |reason: String| TrainError::Checkpoint { path: path.to_path_buf(), reason };
        let size = std::fs::metadata(path).map_err(failed)?.len();
        if size > MAX_BYTES {
            return Err(refuse(format!("a file of {size} bytes")));
        }
        let text = std::fs::read(path).map_err(failed)?;
        let checkpoint: Checkpoint = serde_json::from_slice(&text).map_err(|e| refuse(e.to_string()))?;
        if checkpoint.format != FORMAT {
            return Err(refuse(format!("format {}, this version reads {FORMAT}", checkpoint.format)));
        }
        checkpoint.network.check().map_err(|e| refuse(e.to_string()))?;
        if let Some(best) = &checkpoint.best {
            best.network.check().map_err(|e| refuse(e.to_string()))?;
        }
        Ok(checkpoint)
    }

    /// Steps done.
    pub fn step(&self) -> u64 {
        self.step
    }

    /// The settings of the run.
    pub fn config(&self) -> &TrainConfig {
        &self.cfg
    }

    /// The network after the last step.
    pub fn last(&self) -> &Network {
        &self.network
    }

    /// The best network so far; the last one if none was selected.
    pub fn best(&self) -> &Network {
        self.best.as_ref().map_or(&self.network, |best| &best.network)
    }
}
