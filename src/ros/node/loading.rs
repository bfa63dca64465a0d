//! Builds a running core from the configuration: models, and the calibration that belongs to them.

use std::path::Path;

use super::engine::Configured;
use crate::config::Config;
use crate::fusion::{Fusion, Receipts};
use crate::location;
use crate::model::{self, ModelInfo};
use crate::ros::wire::args::Severity;
use crate::zero::{self, KnownModels};

/// A core, and the messages about it.
pub(super) struct Loaded {
    pub(super) core: Configured,
    /// The models, as a calibration must fit them.
    pub(super) known: KnownModels,
    pub(super) notes: Vec<(Severity, String)>,
}

/// Loads models and calibration.
///
/// A calibration requested by name must fit. The calibration from the parameters may be missing or may not fit:
/// then the node starts uncalibrated, gives the reason, and waits to be calibrated.
///
/// # Errors
/// One line that names the file and what is wrong.
pub(super) fn load(cfg: &Config, calibration: Option<&Path>) -> Result<Loaded, String> {
    calibration.into_iter().chain(cfg.calibration.file.as_deref()).try_for_each(here)?;
    let (mut fusion, infos) = fusion(cfg)?;
    let mut notes = Vec::new();
    for (model, info) in cfg.models().iter().zip(&infos) {
        let path = model.spec.path.display();
        let runs = info.backend.as_ref().map(|backend| format!(" in {backend}")).unwrap_or_default();
        notes.push((Severity::Info, format!("model {}: {path}{runs}", model.name)));
        notes.extend(info.notes.iter().map(|note| (Severity::Info, format!("model {}: {note}", model.name))));
    }
    let named = cfg.models().iter().map(|model| model.name.as_str()).zip(&infos);
    let known = KnownModels::new(named.map(|(name, info)| (name, info.sha256.as_str(), &info.contract)));
    let mut installed = None;
    let uncalibrated =
        "until then no force is published: calibrate (tpf call calibrate), or start with --calibration FILE";
    match (calibration, &cfg.calibration.file) {
        (Some(path), _) => installed = Some(install(&mut fusion, cfg, path, &known)?),
        (None, None) => notes.push((Severity::Warn, "calibration.file is not set; no force is published until you calibrate (tpf call calibrate), or start with --calibration FILE".to_owned())),
        (None, Some(path)) if !path.exists() => {
            notes.push((Severity::Warn, format!("{}: no calibration there yet; {uncalibrated}", path.display())));
        }
        (None, Some(path)) => match install(&mut fusion, cfg, path, &known) {
            Ok(found) => installed = Some(found),
            Err(reason) => notes.push((Severity::Error, format!("{reason}; {uncalibrated}"))),
        },
    }
    let from = installed.map(|(from, said)| {
        notes.extend(said.into_iter().map(|note| (Severity::Warn, note)));
        notes.push((Severity::Info, format!("calibration {from}")));
        from
    });
    let runs = |info: &ModelInfo| info.backend.as_ref().map_or_else(|| "unknown".to_owned(), ToString::to_string);
    let models = cfg
        .models()
        .iter()
        .zip(&infos)
        .map(|(model, info)| (model.name.clone(), format!("{} in {}", model.spec.path.display(), runs(info))));
    let core = Configured { models: models.collect(), calibration: from, fusion };
    Ok(Loaded { core, known, notes })
}

/// Refuses the URI of a calibration file: a node that waits for a store could neither publish nor end in time.
fn here(calibration: &Path) -> Result<(), String> {
    let why = "a node reads and writes its calibration on its own machine only: copy it, and give a path";
    match location::is_remote(calibration) {
        true => Err(format!("{}: {why}", calibration.display())),
        false => Ok(()),
    }
}

/// Loads models and calibration as a start does; gives the core and the messages about it.
///
/// # Errors
/// As [`load`].
pub(in crate::ros) fn rehearse(
    cfg: &Config,
    calibration: Option<&Path>,
) -> Result<(Fusion, Vec<(Severity, String)>), String> {
    load(cfg, calibration).map(|Loaded { core, notes, .. }| (core.fusion, notes))
}

/// A core that has received no input yet, without a baseline.
///
/// # Errors
/// One line that names the model and what is wrong.
pub(super) fn fusion(cfg: &Config) -> Result<(Fusion, Vec<ModelInfo>), String> {
    let mut infos = Vec::new();
    let mut regressors = Vec::new();
    for model_cfg in cfg.models() {
        let loaded = model::load(&model_cfg.spec).map_err(|error| error.to_string())?;
        infos.push(loaded.info);
        regressors.push(loaded.regressor);
    }
    let fusion_cfg = cfg.fusion().clone().with_receipts(Receipts::Live);
    let fusion = Fusion::new(fusion_cfg, regressors).map_err(|error| error.to_string())?;
    Ok((fusion, infos))
}

/// Gives a core the baselines of a file that fits. Returns the file's name and the messages about it.
fn install(
    fusion: &mut Fusion,
    cfg: &Config,
    path: &Path,
    known: &KnownModels,
) -> Result<(String, Vec<String>), String> {
    let zero = zero::from_file(path, cfg, known).map_err(|error| error.to_string())?;
    zero.install(fusion).map_err(|error| error.to_string())?;
    Ok((path.display().to_string(), zero.notes))
}
