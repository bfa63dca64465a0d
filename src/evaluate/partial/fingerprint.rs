//! Fingerprint of all that statistics depend on besides the bags: partials are merged only where it is the same.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::{hex, is_there, sha256_of};
use crate::config::Config;
use crate::evaluate::held_out::folds_of;
use crate::evaluate::{EvaluateError, Request};
use crate::zero::Wanted;

/// All that statistics depend on besides the bags, but for the models, which the series name.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Fingerprint {
    /// Of this package.
    pub(super) version: String,
    /// SHA-256 of all parameters, those that are not in any file too.
    pub(super) parameters: String,
    /// By name.
    pub(super) options: BTreeMap<String, String>,
    /// SHA-256 of the models that were trained without users or donnings, where each bag is scored by one of them.
    pub(super) folds: Vec<String>,
}

impl Fingerprint {
    /// # Errors
    /// [`EvaluateError`] when a file that is named can't be read.
    pub(super) fn of(cfg: &Config, request: &Request<'_>) -> Result<Self, EvaluateError> {
        // Every field is named, so that a new one is not forgotten. The models are in what series tell.
        let Request {
            bags: _,
            model,
            compare,
            backend,
            split,
            zero,
            in_air,
            needs_truth,
            pose_levels,
            known_touches,
            held_out,
            touch,
            jobs: _,
        } = request;
        let mut cfg = cfg.clone();
        // Machines may have the same files in other places.
        cfg.models_mut().iter_mut().for_each(|model| model.spec.path = named(&model.spec.path));
        let calibration = cfg.calibration.file.take();
        let calibration = match &calibration {
            Some(file) if is_there(file)? => Some(sha256_of(file)?),
            _ => None,
        };
        let zero = match zero {
            Wanted::File(path) => format!("file with SHA-256 {}", sha256_of(path)?),
            other => format!("{other:?}"),
        };
        let mut folds = Vec::new();
        if *held_out {
            for path in compare.iter().map(PathBuf::as_path).chain(*model) {
                for fold in folds_of(path)? {
                    folds.push(sha256_of(&fold)?);
                }
            }
        }
        let options = [
            ("model", model.map_or("that of bags or parameters".to_owned(), |_| "given".to_owned())),
            ("backend", format!("{backend:?}")),
            ("split", format!("{split:?}")),
            ("zero", zero),
            ("calibration", calibration.unwrap_or_else(|| "none".to_owned())),
            ("in the air", format!("{in_air:?}")),
            ("needs truth", needs_truth.to_string()),
            ("pose made worse", format!("{pose_levels:?}")),
            ("known touches", format!("{known_touches:?}")),
            ("held out", held_out.to_string()),
            ("touch", format!("{touch:?}")),
        ];
        Ok(Fingerprint {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            parameters: hex(Sha256::digest(format!("{cfg:?}"))),
            options: options.map(|(name, value)| (name.to_owned(), value)).into(),
            folds,
        })
    }
}

fn named(path: &std::path::Path) -> PathBuf {
    path.file_name().map(PathBuf::from).unwrap_or_default()
}
