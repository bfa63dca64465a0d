//! Setup errors and runtime errors.

use super::artifact::ArtifactError;
use super::gain::GainError;
use super::idx::{JointSourceIdx, RegionIdx, TactileSourceIdx};
use super::regressor::RegressError;

/// Sources, regions, models and baselines that don't fit each other.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum SetupError {
    #[error("tactile source {source_name} has no taxels; give the number of taxels in a sample")]
    EmptySource { source_name: String },
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
    #[error("region.{region}: its model runs at {got} Hz; give it a rate above 0")]
    NoRate { region: String, got: f64 },
    #[error(
        "region.{region}: its model is of the regions {known}; name the region as one of them, or give it another model"
    )]
    OtherRegions { region: String, known: String },
    #[error("region.{region}: artifact of its model: {error}; export the model again")]
    ArtifactModel { region: String, error: ArtifactError },
    #[error("region.{region}.contact: force_off = {off} N must be below force_on = {on} N")]
    ForceThresholds { region: String, on: f64, off: f64 },
    #[error("region.{region}.contact: touch_off = {off} must be below touch_on = {on}")]
    TouchThresholds { region: String, on: f64, off: f64 },
    #[error("{got} contact thresholds for {expected} regions; give one for each")]
    NThresholds { expected: usize, got: usize },
    #[error("there is no region {}, counted from 0, among {n_regions}; give one of this core", got.position())]
    UnknownRegion { got: RegionIdx, n_regions: usize },
    #[error("there is no tactile source {}, counted from 0, among {n_sources}; give one of this core", got.position())]
    UnknownTactileSource { got: TactileSourceIdx, n_sources: usize },
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
    /// An event of a tactile source that this core doesn't have.
    #[error("taxels came of tactile source {}, counted from 0, of {n_sources}; give the core that source", got.position())]
    NoTactileSource {
        /// The source of the event.
        got: TactileSourceIdx,
        /// Tactile sources of the core.
        n_sources: usize,
    },
    /// An event of a joint source that this core doesn't have.
    #[error("joint angles came of joint source {}, counted from 0, of {n_sources}; give the core that source", got.position())]
    NoJointSource {
        /// The source of the event.
        got: JointSourceIdx,
        /// Joint sources of the core.
        n_sources: usize,
    },
}
