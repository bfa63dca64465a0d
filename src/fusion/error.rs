//! Setup errors and runtime errors.

use super::artifact::ArtifactError;
use super::calibration::Baseline;
use super::config::{FusionConfig, RegionConfig, TactileSource};
use super::gain::GainError;
use super::regressor::{RegressError, Regressor};

/// Regions, models and baselines that don't fit each other.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum SetupError {
    #[error("region.{region} has model {got} of {n_models}, counted from 0; give the core that model")]
    NoModel { region: String, got: usize, n_models: usize },
    #[error("region.{region} has tactile source {got} of {n_sources}, counted from 0; list that source")]
    NoTactileSource { region: String, got: usize, n_sources: usize },
    #[error(
        "region.{region}.taxels has taxel {got}, a sample of its source has {n_taxels}; list taxels below {n_taxels}"
    )]
    NoTaxel { region: String, got: usize, n_taxels: usize },
    #[error(
        "region.{region}.taxels has {got} taxels, its model takes {expected}; list the {expected} that it was trained on"
    )]
    Taxels { region: String, expected: usize, got: usize },
    #[error(
        "region.{region}.joints has {got} joints, its model takes {expected}; list the {expected} that it was trained on"
    )]
    Joints { region: String, expected: usize, got: usize },
    #[error(
        "region.{region}.joints is {got:?}, its model was trained on {expected:?}; name the same joints in the same order; if yours have other names, give those of the model, in the order of yours, in region.{region}.model_joints"
    )]
    JointNames { region: String, expected: Vec<String>, got: Vec<String> },
    #[error("region.{region}: its model has no pose input and region.{region}.joints is not empty; remove the joints")]
    NoPose { region: String },
    #[error("region.{region}.joints is not empty and there is no joint source; set joint_sources")]
    NoJointSource { region: String },
    #[error(
        "region.{region}: its model runs at {got} Hz, other regions of tactile source {source_name} at {expected} Hz; give them models of one rate"
    )]
    Rate { region: String, source_name: String, expected: f64, got: f64 },
    #[error(
        "baseline of tactile source {source_name} has {got} taxels, expected {expected}; calibrate this glove again"
    )]
    Baseline { source_name: String, expected: usize, got: usize },
    #[error("artifact of region {region}: {error}; calibrate this glove again")]
    Artifact { region: String, error: ArtifactError },
    #[error("force gain of region {region}: {error}; give it its known touches again")]
    Gain { region: String, error: GainError },
    #[error("baseline of tactile source {source_name} is not finite at taxel {taxel_idx}; calibrate this glove again")]
    BaselineNotFinite { source_name: String, taxel_idx: usize },
}

/// Runtime errors, after a valid start.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FusionError {
    /// A model's runtime gave up.
    #[error(transparent)]
    Model(#[from] RegressError),
}

pub(super) fn check_region(
    region: &RegionConfig,
    cfg: &FusionConfig,
    regressors: &[Box<dyn Regressor>],
) -> Result<(), SetupError> {
    let name = || region.name.clone();
    let (got, n_models) = (region.model, regressors.len());
    let regressor = regressors.get(got).ok_or_else(|| SetupError::NoModel { region: name(), got, n_models })?;
    let contract = regressor.contract();
    let (got, n_sources) = (region.source.0, cfg.tactile_sources.len());
    let source = cfg.tactile_sources.get(got);
    let source = source.ok_or_else(|| SetupError::NoTactileSource { region: name(), got, n_sources })?;
    let n_taxels = source.n_taxels;
    if let Some(&got) = region.taxels.iter().find(|taxel| **taxel >= n_taxels) {
        return Err(SetupError::NoTaxel { region: name(), got, n_taxels });
    }
    if contract.n_taxels != region.taxels.len() {
        return Err(SetupError::Taxels { region: name(), expected: contract.n_taxels, got: region.taxels.len() });
    }
    if contract.n_region_joints() == 0 && !region.joints.is_empty() {
        return Err(SetupError::NoPose { region: name() });
    }
    let n_joints = contract.n_region_joints();
    if n_joints != region.joints.len() {
        return Err(SetupError::Joints { region: name(), expected: n_joints, got: region.joints.len() });
    }
    let known = if region.model_joints.is_empty() { &region.joints } else { &region.model_joints };
    if contract.joints.as_ref().is_some_and(|joints| joints != known) {
        let expected = contract.joints.clone().unwrap_or_default();
        return Err(SetupError::JointNames { region: name(), expected, got: known.clone() });
    }
    if !region.joints.is_empty() && cfg.joint_sources.is_empty() {
        return Err(SetupError::NoJointSource { region: name() });
    }
    let first = cfg.regions.iter().find(|other| other.source == region.source);
    let first = first.and_then(|first| regressors.get(first.model));
    let expected = first.map_or(contract.rate_hz, |first| first.contract().rate_hz);
    if expected != contract.rate_hz {
        let source_name = source.name.clone();
        return Err(SetupError::Rate { region: name(), source_name, expected, got: contract.rate_hz });
    }
    Ok(())
}

pub(super) fn check_baseline(baseline: &Baseline, source: &TactileSource) -> Result<(), SetupError> {
    let expected = source.n_taxels;
    for got in [baseline.median.len(), baseline.noise.len(), baseline.faulty.len()] {
        if got != expected {
            return Err(SetupError::Baseline { source_name: source.name.clone(), expected, got });
        }
    }
    match baseline.median.iter().position(|median| !median.is_finite()) {
        Some(taxel_idx) => Err(SetupError::BaselineNotFinite { source_name: source.name.clone(), taxel_idx }),
        None => Ok(()),
    }
}
