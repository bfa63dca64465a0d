//! The zero of the forces: finds it, checks whether it belongs to the glove and is reliable, and gives it to a core.
//!
//! The node, replay, calibrate, train, eval, export and characterize all use this module, so they find the same zero.
//! Train and characterize run no model, so they don't check whether models read force in it. The others accept or refuse
//! the same zero with the same message. With `calibration.insist`, a zero that fails a check is used with a note.

mod artifact;
mod error;
mod judge;
mod movement;
mod recorded;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use crate::bag::Rest;
pub use artifact::{ArtifactCollector, ArtifactTimes, TimedArtifact};
pub use error::ZeroError;
pub use judge::{LoadCheck, limits};
pub use movement::Movement;
pub use recorded::{Wanted, find, find_with};

use crate::calibration::{Calibration, CalibrationFileError};
use crate::config::Config;
use crate::fusion::{
    ArtifactFilter, ArtifactFit, Baseline, Contract, ForceGain, Fusion, RegionConfig, RegionIdx, RegionTerms,
    SetupError, TactileSourceIdx,
};

/// SHA-256 of each model, by the model's name in the parameters.
pub type ModelHashes = BTreeMap<String, String>;

/// Properties of the models that a zero depends on.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KnownModels {
    /// SHA-256 of each model.
    pub hashes: ModelHashes,
    /// `[models]`, in the order of the configuration: the artifact model, if it has one.
    pub artifacts: Vec<Option<TimedArtifact>>,
    /// `[models]`: the artifact models of a model of several regions, by the region's name.
    pub of_regions: Vec<BTreeMap<String, TimedArtifact>>,
}

impl KnownModels {
    /// From name, hash and contract of each model, in the order of the configuration.
    pub fn new<'m>(models: impl IntoIterator<Item = (&'m str, &'m str, &'m Contract)>) -> Self {
        let mut known = KnownModels::default();
        for (name, sha256, contract) in models {
            known.hashes.insert(name.to_owned(), sha256.to_owned());
            known.artifacts.push(contract.artifact.clone().map(|artifact| (artifact, contract.rate_hz)));
            let of_region = |terms: &RegionTerms| (Arc::clone(&terms.artifact), contract.rate_hz);
            let of_regions = contract.regions.iter().map(|(name, terms)| (name.clone(), of_region(terms)));
            known.of_regions.push(of_regions.collect());
        }
        known
    }

    /// `[regions]`: the artifact model of each region's model.
    fn artifacts_of_regions(&self, cfg: &Config) -> Vec<Option<TimedArtifact>> {
        let of_region = |region: &RegionConfig| {
            let model = region.model.position();
            let of_several = self.of_regions.get(model).and_then(|of_regions| of_regions.get(&region.name).cloned());
            of_several.or_else(|| self.artifacts.get(model).cloned().flatten())
        };
        cfg.fusion().regions().iter().map(of_region).collect()
    }
}

/// Calibration of a donning.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Donning {
    /// `[tactile sources]`
    pub baselines: Vec<Baseline>,
    /// `[regions]`: gains and offsets of the artifact, for models with an artifact model, if the calibration has them.
    pub artifacts: Vec<Option<ArtifactFit>>,
    /// `[regions]`: force gains from known touches. Empty if there are none.
    pub force_gains: Vec<Option<ForceGain>>,
}

impl Donning {
    /// The baselines of a core, its artifacts as they are now, and its force gains. No baselines if one is missing.
    pub fn of(fusion: &Fusion) -> Self {
        let regions = || fusion.config().region_idxs();
        let sources = fusion.config().tactile_source_idxs();
        let baselines: Option<_> = sources.map(|source| fusion.baseline(source).cloned()).collect();
        Donning {
            baselines: baselines.unwrap_or_default(),
            artifacts: regions().map(|region| fusion.artifact(region).and_then(ArtifactFilter::fit)).collect(),
            force_gains: regions().map(|region| fusion.force_gain(region).copied()).collect(),
        }
    }

    /// Gives a core its baselines, artifacts and force gains.
    ///
    /// # Errors
    /// [`SetupError`] if the number of sources, regions, taxels or joints differs, or if a gain is out of range.
    pub fn install(&self, fusion: &mut Fusion) -> Result<(), SetupError> {
        for (source_idx, baseline) in self.baselines.iter().enumerate() {
            fusion.handle_baseline(TactileSourceIdx::at(source_idx), baseline.clone())?;
        }
        for (region_idx, artifact) in self.artifacts.iter().enumerate() {
            if let Some(artifact) = artifact {
                fusion.handle_artifact(RegionIdx::at(region_idx), artifact.clone())?;
            }
        }
        for (region_idx, gain) in self.force_gains.iter().enumerate() {
            if let Some(gain) = gain {
                fusion.handle_force_gain(RegionIdx::at(region_idx), gain)?;
            }
        }
        Ok(())
    }
}

/// Source of a zero, for summaries and files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "from")]
pub enum ZeroFrom {
    /// A calibration file.
    File {
        /// Path of the file, as given.
        file: String,
    },
    /// The annotated spans at zero load.
    Annotations {
        /// `[tactile sources]`, s.
        seconds: Vec<f64>,
    },
    /// The first seconds.
    First {
        /// `[tactile sources]`, s.
        seconds: Vec<f64>,
    },
    /// Live topics.
    Live {
        /// Number of tactile samples.
        frames: u32,
    },
}

/// Baselines of all tactile sources, and the check that is still to be done.
#[derive(Debug)]
pub struct Zero {
    /// Where they are from.
    pub from: ZeroFrom,
    /// The calibration of the donning.
    pub donning: Donning,
    /// Notes for the user.
    pub notes: Vec<String>,
    /// The check by the model while the recording is read. `None` if the recording doesn't show when it is without
    /// load.
    pub check: Option<LoadCheck>,
}

impl Zero {
    /// A zero without a further check.
    pub fn new(from: ZeroFrom, donning: Donning) -> Self {
        Zero { from, donning, notes: Vec::new(), check: None }
    }

    /// Gives a core its baselines, artifacts and force gains.
    ///
    /// # Errors
    /// [`SetupError`] if the number of taxels or joints differs.
    pub fn install(&self, fusion: &mut Fusion) -> Result<(), SetupError> {
        self.donning.install(fusion)
    }

    /// The calibration as a file for this glove and user, and for these models.
    pub fn to_calibration(&self, cfg: &Config, models: &ModelHashes) -> Calibration {
        let names = cfg.fusion().tactile_sources().iter().map(|source| source.name.clone());
        let sources: BTreeMap<String, Baseline> = names.zip(self.donning.baselines.iter().cloned()).collect();
        let text = |value: &Option<String>| value.clone().unwrap_or_default();
        let mut calibration = Calibration::new(&text(&cfg.glove), &text(&cfg.user), self.from.to_string(), sources);
        calibration.models.clone_from(models);
        for (region, artifact) in cfg.fusion().regions().iter().zip(&self.donning.artifacts) {
            calibration.artifacts.extend(artifact.clone().map(|artifact| (region.name.clone(), artifact)));
        }
        for (region, gain) in cfg.fusion().regions().iter().zip(&self.donning.force_gains) {
            calibration.force_gains.extend(gain.map(|gain| (region.name.clone(), gain)));
        }
        calibration
    }
}

impl std::fmt::Display for ZeroFrom {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let spans = |seconds: &[f64]| seconds.iter().map(|s| format!("{s:.2} s")).collect::<Vec<_>>().join(", ");
        match self {
            ZeroFrom::File { file } => write!(f, "calibration {file}"),
            ZeroFrom::Annotations { seconds } => write!(f, "zero-load stretches, {}", spans(seconds)),
            ZeroFrom::First { seconds } => write!(f, "the first {}", spans(seconds)),
            ZeroFrom::Live { frames } => write!(f, "{frames} live frames"),
        }
    }
}

/// The zero in a calibration file. The file must be for this glove, this user, these sources and these models.
///
/// # Errors
/// [`ZeroError::File`] if it is not a calibration file, or is for another glove, user or source;
/// [`ZeroError::OtherModel`] if it was checked with another model, unless `calibration.insist` is set;
/// [`ZeroError::ArtifactInFile`] if an artifact in it doesn't fit its model.
pub fn from_file(path: &Path, cfg: &Config, models: &KnownModels) -> Result<Zero, ZeroError> {
    let text = |value: &Option<String>| value.clone().unwrap_or_default();
    let sources = cfg.fusion().tactile_sources();
    let mut notes = Vec::new();
    let calibration = match Calibration::load(path, &text(&cfg.glove), &text(&cfg.user), sources) {
        Err(error @ CalibrationFileError::Mismatch { .. }) => {
            notes.extend(forgiven(cfg, ZeroError::File(error))?);
            Calibration::load(path, "", "", sources)?
        }
        loaded => loaded?,
    };
    for (model, hash) in &models.hashes {
        match calibration.models.get(model) {
            Some(known) if known != hash => {
                let error = ZeroError::OtherModel { path: path.to_path_buf(), model: model.clone() };
                notes.extend(forgiven(cfg, error)?);
            }
            Some(_) => {}
            None => notes.push(format!(
                "{}: does not say that it was judged with model {model}, so nothing tells whether the glove was loaded then",
                path.display()
            )),
        }
    }
    let baselines = sources.iter().filter_map(|source| calibration.sources.get(&source.name).cloned()).collect();
    let mut artifacts = Vec::new();
    for (region, model) in cfg.fusion().regions().iter().zip(models.artifacts_of_regions(cfg)) {
        let fit = model.as_ref().and_then(|_| calibration.artifacts.get(&region.name).cloned());
        if let (Some((model, _)), Some(fit)) = (&model, &fit) {
            fit.check(model).map_err(|error| {
                let (path, region) = (path.to_path_buf(), region.name.clone());
                ZeroError::ArtifactInFile { path, region, error }
            })?;
        }
        if model.is_some() && fit.is_none() {
            notes.push(format!(
                "{}: does not tell the artifact of region {}, so the mean of the training donnings is taken out and not followed; calibrate again",
                path.display(),
                region.name
            ));
        }
        artifacts.push(fit);
    }
    let force_gains =
        cfg.fusion().regions().iter().map(|region| calibration.force_gains.get(&region.name).copied()).collect();
    let from = ZeroFrom::File { file: path.display().to_string() };
    Ok(Zero { notes, ..Zero::new(from, Donning { baselines, artifacts, force_gains }) })
}

/// A note on a zero that fails a check but is used, because of `calibration.insist`.
///
/// # Errors
/// The error itself, if `calibration.insist` is not set.
fn forgiven(cfg: &Config, error: ZeroError) -> Result<Option<String>, ZeroError> {
    if !cfg.calibration.insist {
        return Err(error);
    }
    Ok(Some(format!("{error}; used all the same, because calibration.insist is set")))
}
