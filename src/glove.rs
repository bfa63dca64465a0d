//! A glove as its parameters describe it, with its models ready to run.

use std::path::{Path, PathBuf};

use crate::config::{self, Config, ConfigError, DEFAULT_NODE};
use crate::fusion::{Fusion, RegionConfig, Regressor, SetupError};
use crate::model::{self, ModelError, ModelInfo};
use crate::observer::Observer;
use crate::zero::KnownModels;

/// Why there is no glove to work with.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum GloveError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error(transparent)]
    Setup(#[from] SetupError),
}

/// A configuration and its models.
#[derive(Debug)]
pub struct Glove {
    cfg: Config,
    models: Models,
}

impl Glove {
    /// The glove of a parameter file, for the node of the default name. Models are found beside the file.
    ///
    /// # Errors
    /// [`GloveError`] when a parameter is refused or a model can't be loaded.
    pub fn load(params: impl AsRef<Path>) -> Result<Self, GloveError> {
        Self::new(config::load(params.as_ref(), DEFAULT_NODE)?)
    }

    /// The glove of a configuration.
    ///
    /// # Errors
    /// [`GloveError`] when a model can't be loaded.
    pub fn new(cfg: Config) -> Result<Self, GloveError> {
        let models = Models::load(&cfg)?;
        Ok(Glove { cfg, models })
    }

    /// What the parameters say.
    pub fn config(&self) -> &Config {
        &self.cfg
    }

    /// What is known of each model, in the order of the configuration.
    pub fn models(&self) -> &[ModelInfo] {
        &self.models.infos
    }

    /// The core that turns samples into forces. It says UNCALIBRATED until it is given a zero:
    /// [`Fusion::handle_baseline`], or [`Zero::install`](crate::zero::Zero::install).
    ///
    /// # Errors
    /// [`GloveError::Setup`] when a region doesn't fit its model.
    pub fn into_core(self) -> Result<Fusion, GloveError> {
        Ok(Fusion::new(self.cfg.fusion, self.models.regressors)?)
    }
}

/// Models that are ready to run, in the order of a configuration.
#[derive(Debug)]
pub struct Models {
    /// What is known of each.
    pub infos: Vec<ModelInfo>,
    /// What runs each.
    pub regressors: Vec<Box<dyn Regressor>>,
}

impl Models {
    /// Loads the models of a configuration.
    ///
    /// # Errors
    /// [`ModelError`] when one can't be used.
    pub fn load(cfg: &Config) -> Result<Self, ModelError> {
        let mut models = Models { infos: Vec::new(), regressors: Vec::new() };
        for model_cfg in &cfg.models {
            let model = model::load(&model_cfg.spec)?;
            models.infos.push(model.info);
            models.regressors.push(model.regressor);
        }
        Ok(models)
    }

    /// What runs each model, a line each.
    pub fn runtimes(&self, cfg: &Config) -> Vec<String> {
        let told = cfg.models.iter().zip(&self.infos).filter_map(|(model_cfg, info)| {
            let (name, path) = (&model_cfg.name, model_cfg.spec.path.display());
            info.backend.as_ref().map(|backend| format!("model {name}: {path} in {backend}"))
        });
        told.collect()
    }

    /// What a person should know of the models, such as what is assumed of them, a line each.
    pub fn notes(&self, cfg: &Config) -> Vec<String> {
        let of_model = cfg.models.iter().zip(&self.infos).flat_map(|(model_cfg, info)| {
            info.notes.iter().map(move |note| format!("model {}: {note}", model_cfg.name))
        });
        of_model.collect()
    }

    /// Tells the notes, and to those who ask what runs each model.
    pub fn tell(&self, cfg: &Config, observer: &dyn Observer) {
        self.runtimes(cfg).iter().for_each(|runtime| observer.detail(runtime));
        self.notes(cfg).iter().for_each(|note| observer.note(note));
    }

    /// Frames of one inference call with which these models run fastest.
    pub fn batch_hint(&self) -> usize {
        self.infos.iter().map(|info| info.batch_hint).max().unwrap_or(1)
    }
}

/// What a zero must know of the models of a configuration.
pub fn known(cfg: &Config, models: &[ModelInfo]) -> KnownModels {
    let named = cfg.models.iter().map(|model| model.name.as_str()).zip(models);
    KnownModels::new(named.map(|(name, info)| (name, info.sha256.as_str(), &info.contract)))
}

/// More than one model, where one was to be replaced.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "--model stands for one model, the parameters have {}: {}; set -p model.NAME.path:=FILE for each",
    names.len(),
    names.join(", ")
)]
pub struct SeveralModels {
    /// Of the configuration.
    pub names: Vec<String>,
}

/// Puts another file in the place of the only model of a configuration.
///
/// # Errors
/// [`SeveralModels`] when it has more than one.
pub fn replace_model(cfg: &mut Config, path: PathBuf) -> Result<(), SeveralModels> {
    let [only] = cfg.models.as_mut_slice() else {
        return Err(SeveralModels { names: cfg.models.iter().map(|model| model.name.clone()).collect() });
    };
    only.spec.path = path;
    Ok(())
}

/// Takes the joints from regions whose model has no pose input, so that the parameters of a pose-aware model also run the
/// tactile-only one that it is compared with; a note for each.
pub fn drop_unused_joints(cfg: &mut Config, models: &[ModelInfo]) -> Vec<String> {
    let without_pose = |region: &&mut RegionConfig| models[region.model].contract.n_region_joints() == 0;
    let mut notes = Vec::new();
    for region in cfg.fusion.regions.iter_mut().filter(without_pose).filter(|region| !region.joints.is_empty()) {
        notes.push(format!("region {}: its model has no pose input, so its joints are not used", region.name));
        region.joints.clear();
        region.model_joints.clear();
    }
    notes
}
