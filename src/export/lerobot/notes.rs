//! Notes of a shard of a dataset.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::{DatasetSpec, io};
use crate::config::Config;
use crate::export::{ExportError, Request};
use crate::location;
use crate::sessions::Shard;

/// Notes of a shard.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct ShardNotes {
    pub(crate) version: String,
    pub(crate) shard: Shard,
    /// In all shards.
    pub(crate) n_bags: usize,
    /// Everything else that episodes depend on besides the bags.
    pub(crate) made_by: BTreeMap<String, String>,
    pub(super) spec: DatasetSpec,
    /// In the order of the shard.
    pub(crate) bags: Vec<ShardBag>,
}

/// A bag of a shard.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct ShardBag {
    pub(crate) bag: String,
    pub(crate) synthetic: bool,
    /// Why it has no episode.
    pub(crate) error: Option<String>,
}

impl ShardNotes {
    /// Of a share of so many bags that are exported like this.
    ///
    /// # Errors
    /// [`ExportError`] when a file that is named can't be read.
    pub(crate) fn new(shard: Shard, n_bags: usize, cfg: &Config, request: &Request<'_>) -> Result<Self, ExportError> {
        let sha256 = |bytes: &[u8]| hex(Sha256::digest(bytes));
        let of_file = |path: &Path| Ok::<_, ExportError>(sha256(&location::read(path).map_err(io(path))?));
        let mut same = cfg.clone();
        let mut models = Vec::new();
        for model in same.models_mut() {
            let path = std::mem::take(&mut model.spec.path); // machines may have the same file in other places
            let is_read = request.model.is_none() && location::exists(&path).map_err(io(&path))?;
            models.push(if is_read { of_file(&path)? } else { "none".to_owned() });
        }
        let zero = match request.zero {
            crate::zero::Wanted::File(path) => of_file(path)?,
            other => format!("{other:?}"),
        };
        let made_by = [
            ("parameters", sha256(format!("{same:?}").as_bytes())),
            ("models", models.join(", ")),
            ("model", request.model.map(of_file).transpose()?.unwrap_or_else(|| "not given".to_owned())),
            ("backend", format!("{:?}", request.backend)),
            ("zero", zero),
            ("in the air", format!("{:?}", request.in_air)),
            ("--fps", request.fps.to_string()),
            ("--tactile-window-ms", request.tactile_window_ms.to_string()),
            ("--task", request.task.to_owned()),
        ];
        Ok(ShardNotes {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            shard,
            n_bags,
            made_by: made_by.map(|(name, value)| (name.to_owned(), value)).into(),
            spec: DatasetSpec { fps: request.fps, task: request.task.to_owned(), robot_type: cfg.glove.clone() },
            bags: Vec::new(),
        })
    }
}

/// SHA-256 in hexadecimal.
pub(super) fn hex(hash: impl AsRef<[u8]>) -> String {
    hash.as_ref().iter().map(|byte| format!("{byte:02x}")).collect()
}
