//! A glove as described by its parameters, with its models ready to run.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use crate::config::{self, Config, ConfigError, DEFAULT_NODE};
use crate::fusion::{Fusion, RegionConfig, Regressor, SetupError};
use crate::model::{self, ModelError, ModelInfo};
use crate::observer::Observer;
use crate::zero::KnownModels;

/// A glove that can't be loaded.
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
    /// Loads the glove of a parameter file, for the node with the default name. Paths of models are relative to the
    /// file.
    ///
    /// # Errors
    /// [`GloveError`] if a parameter is refused, or if a model can't be loaded.
    pub fn load(params: impl AsRef<Path>) -> Result<Self, GloveError> {
        Self::new(config::load(params.as_ref(), DEFAULT_NODE)?)
    }

    /// Loads the glove of a configuration.
    ///
    /// # Errors
    /// [`GloveError`] if a model can't be loaded.
    pub fn new(cfg: Config) -> Result<Self, GloveError> {
        let models = Models::load(&cfg)?;
        Ok(Glove { cfg, models })
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.cfg
    }

    /// Information about each model, in the order of the configuration.
    pub fn models(&self) -> &[ModelInfo] {
        &self.models.infos
    }

    /// The core that computes forces from samples. Its estimates have the flag UNCALIBRATED until it gets a zero, with
    /// [`Fusion::handle_baseline`] or [`Zero::install`](crate::zero::Zero::install).
    ///
    /// # Errors
    /// [`GloveError::Setup`] if a region doesn't fit its model.
    pub fn into_core(self) -> Result<Fusion, GloveError> {
        Ok(Fusion::new(self.cfg.fusion().clone(), self.models.regressors)?)
    }
}

/// Models that are ready to run, in the order of a configuration.
#[derive(Debug)]
pub struct Models {
    /// Information about each model.
    pub infos: Vec<ModelInfo>,
    /// The models, ready to run.
    pub regressors: Vec<Box<dyn Regressor>>,
}

impl Models {
    /// Loads the models of a configuration.
    ///
    /// # Errors
    /// [`ModelError`] if one can't be used.
    pub fn load(cfg: &Config) -> Result<Self, ModelError> {
        let mut models = Models { infos: Vec::new(), regressors: Vec::new() };
        for model_cfg in cfg.models() {
            let model = model::load(&model_cfg.spec)?;
            models.infos.push(model.info);
            models.regressors.push(model.regressor);
        }
        Ok(models)
    }

    /// The runtime of each model, a line each.
    pub fn runtimes(&self, cfg: &Config) -> Vec<String> {
        let told = cfg.models().iter().zip(&self.infos).filter_map(|(model_cfg, info)| {
            let (name, path) = (&model_cfg.name, model_cfg.spec.path.display());
            info.backend.as_ref().map(|backend| format!("model {name}: {path} in {backend}"))
        });
        told.collect()
    }

    /// Notes for a person on the models, such as assumptions about them, a line each.
    pub fn notes(&self, cfg: &Config) -> Vec<String> {
        let of_model = cfg.models().iter().zip(&self.infos).flat_map(|(model_cfg, info)| {
            info.notes.iter().map(move |note| format!("model {}: {note}", model_cfg.name))
        });
        of_model.collect()
    }

    /// Tells the notes, and to those who ask what runs each model.
    pub fn tell(&self, cfg: &Config, observer: &dyn Observer) {
        self.runtimes(cfg).iter().for_each(|runtime| observer.detail(runtime));
        self.notes(cfg).iter().for_each(|note| observer.note(note));
    }

    /// Number of frames per inference call at which these models run fastest.
    pub fn batch_hint(&self) -> NonZeroUsize {
        self.infos.iter().map(|info| info.batch_hint).max().unwrap_or(NonZeroUsize::MIN)
    }
}

/// Properties of the models of a configuration that a zero depends on.
pub fn known(cfg: &Config, models: &[ModelInfo]) -> KnownModels {
    let named = cfg.models().iter().map(|model| model.name.as_str()).zip(models);
    KnownModels::new(named.map(|(name, info)| (name, info.sha256.as_str(), &info.contract)))
}

/// Error: the configuration has several models, and one should be replaced.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "--model stands for one model, the parameters have {}: {}; set -p model.NAME.path:=FILE for each",
    names.len(),
    names.join(", ")
)]
pub struct SeveralModels {
    /// Names of the models in the configuration.
    pub names: Vec<String>,
}

/// Replaces the file of the only model in a configuration, and gives its regions the joints that this model names
/// ([`take_joints_of_models`], whose notes are returned). A file that can't be read changes no joints: [`Models::load`] says what is wrong.
///
/// # Errors
/// [`SeveralModels`] if it has more than one.
pub fn replace_model(cfg: &mut Config, path: PathBuf) -> Result<Vec<String>, SeveralModels> {
    let [only] = cfg.models_mut() else {
        return Err(SeveralModels { names: cfg.models().iter().map(|model| model.name.clone()).collect() });
    };
    only.spec.path = path;
    let info = model::inspect_spec(&only.spec);
    Ok(info.map(|info| take_joints_of_models(cfg, &[info])).unwrap_or_default())
}

/// Gives each region the joints that its model names, where they are more or fewer of the same ones, and none where its model has no
/// pose input. So the parameters of one model can also run the models that it is compared with. Returns a note for each region that
/// changes. Other joints stay, and are refused by [`Fusion::new`].
pub fn take_joints_of_models(cfg: &mut Config, models: &[ModelInfo]) -> Vec<String> {
    let taken = |region: &RegionConfig| -> Option<Vec<String>> {
        let contract = models.get(region.model.position())?.contract.of_region(&region.name)?;
        if contract.n_region_joints() == 0 {
            return Some(Vec::new());
        }
        let named = contract.joints.as_ref().filter(|_| region.model_joints.is_empty() && !region.joints.is_empty())?;
        let has_all = |all: &[String], part: &[String]| part.iter().all(|joint| all.contains(joint));
        (has_all(named, &region.joints) || has_all(&region.joints, named)).then(|| named.clone())
    };
    let note = |region: &RegionConfig| {
        let taken = taken(region).filter(|taken| *taken != region.joints)?;
        let name = &region.name;
        Some(match taken.is_empty() {
            true => format!("region {name}: its model has no pose input, so its joints are not used"),
            false => format!(
                "region {name}: its model takes the joints {}, in place of the {} in region.{name}.joints",
                taken.join(", "),
                region.joints.len()
            ),
        })
    };
    let notes = cfg.fusion().regions().iter().filter_map(note).collect();
    cfg.take_joints(taken);
    notes
}
