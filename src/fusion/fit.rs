//! Checks that regions fit their models, and baselines their sources.

use super::artifact::ArtifactError;
use super::calibration::Baseline;
use super::config::{FusionConfig, RegionConfig, TactileSource};
use super::error::SetupError;
use super::regressor::{Contract, Regressor};

/// Checks that a region of a configuration fits its model.
pub(super) fn check_region(
    region: &RegionConfig,
    cfg: &FusionConfig,
    regressors: &[Box<dyn Regressor>],
) -> Result<(), SetupError> {
    let name = || region.name.clone();
    let (got, n_models) = (region.model.position(), regressors.len());
    let regressor = regressors.get(got).ok_or_else(|| SetupError::NoModel { region: name(), got, n_models })?;
    let of_region = regressor.contract().of_region(&region.name);
    let no_terms = || SetupError::OtherRegions {
        region: name(),
        known: regressor.contract().regions.keys().cloned().collect::<Vec<_>>().join(", "),
    };
    let contract = of_region.as_deref().ok_or_else(no_terms)?;
    check_contract(contract, region)?;
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
    if !region.joints.is_empty() && cfg.joint_sources().is_empty() {
        return Err(SetupError::NoJointSource { region: name() });
    }
    let first = cfg.regions().iter().find(|other| other.source == region.source);
    let first = first.and_then(|first| regressors.get(first.model.position()));
    let expected = first.map_or(contract.rate_hz, |first| first.contract().rate_hz);
    if expected != contract.rate_hz {
        let source_name = cfg.tactile_source(region.source).map(|source| source.name.clone()).unwrap_or_default();
        return Err(SetupError::Rate { region: name(), source_name, expected, got: contract.rate_hz });
    }
    Ok(())
}

/// Checks that the parts of a contract fit each other.
fn check_contract(contract: &Contract, region: &RegionConfig) -> Result<(), SetupError> {
    let name = || region.name.clone();
    if !(contract.rate_hz > 0.0 && contract.rate_hz.is_finite()) {
        return Err(SetupError::NoRate { region: name(), got: contract.rate_hz });
    }
    let Some(artifact) = &contract.artifact else { return Ok(()) };
    let fits = |what: &str, got: usize, expected: usize| match got == expected {
        true => Ok(()),
        false => Err(ArtifactError(format!("{got} {what}, the model takes {expected}"))),
    };
    let checked = artifact.check().and_then(|()| fits("taxels", artifact.n_taxels, contract.n_taxels));
    let checked = checked.and_then(|()| match contract.n_joints {
        0 => Ok(()),
        n_joints => fits("joints", artifact.n_joints, n_joints),
    });
    checked.map_err(|error| SetupError::ArtifactModel { region: name(), error })
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
