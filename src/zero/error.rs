//! Errors of the zero.

use std::path::PathBuf;

use crate::bag::{BagError, BaselineError, InputError};
use crate::calibration::CalibrationFileError;
use crate::fusion::CalibrationError;

/// A zero that is not used. Each message is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum ZeroError {
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Baseline(#[from] BaselineError),
    #[error(transparent)]
    File(#[from] CalibrationFileError),
    #[error("{path}: was judged with another model {model} than this one; calibrate again")]
    OtherModel { path: PathBuf, model: String },
    #[error(
        "the first {seconds} s are asked for as zero load and the recording has {got_s:.1} s; name a time at its begin in which nothing touches the glove"
    )]
    PastTheEnd { seconds: f64, got_s: f64 },
    #[error(transparent)]
    Setup(#[from] crate::fusion::SetupError),
    #[error(transparent)]
    Fusion(#[from] crate::fusion::FusionError),
    #[error(
        "region {region}: {got_s:.2} s at zero load came with joint angles, at least {need_s} s needed to find the artifact of this donning (calibration.min_s); check that the stamps of taxels and joints are of one clock, and move the hand in the air for longer"
    )]
    ArtifactTooShort { region: String, got_s: f64, need_s: f64 },
    #[error(
        "region {region}: its joints {missing} are in no message; other joints that are: {seen}; correct region.{region}.joints, or the topic or names of the joint source"
    )]
    MissingJoints { region: String, missing: String, seen: String },
    #[error("region {region}: {error}; calibrate again")]
    Artifact { region: String, error: crate::fusion::ArtifactError },
    #[error("{path}: region {region}: {error}; calibrate again")]
    ArtifactInFile { path: PathBuf, region: String, error: crate::fusion::ArtifactError },
    #[error("region {region}: {error}")]
    Loaded { region: String, error: CalibrationError },
    #[error(
        "region {region}: calibration looks loaded: {percent:.0} % of its frames read more than {limit}, at most {limit_percent:.0} % may (calibration.max_force, calibration.max_loaded_fraction): something touches the glove there, or the model is of another glove; tell when nothing does, by --calibrate-first with fewer seconds, --in-air FROM..TO or --zero-load-below FORCE"
    )]
    LoadedInBag { region: String, percent: f64, limit: crate::units::Newton, limit_percent: f64 },
    #[error(
        "region {region}: the zero of {file} doesn't hold in this recording: {percent:.0} % of the frames that are annotated as zero load read more than {limit}, at most {limit_percent:.0} % may (calibration.max_force, calibration.max_loaded_fraction); calibrate again after putting the glove on"
    )]
    LoadedHere { region: String, file: String, percent: f64, limit: crate::units::Newton, limit_percent: f64 },
    #[error(
        "region {region}: none of the {n_frames} frames of the calibration gave an estimate ({flags}), so nothing tells whether the glove was loaded; correct what the flag names and calibrate again"
    )]
    Unjudged { region: String, n_frames: u64, flags: crate::fusion::Flags },
    #[error(
        "region {region}: {percent:.0} % of the frames of the calibration had no joint angles of their time; check that the stamps of taxels and joints are of one clock"
    )]
    WithoutPose { region: String, percent: f64 },
    #[error(
        "region {region}: no angle of its joints came, so nothing tells whether the hand moved; look at the driver and topic of the joint source, and calibrate again"
    )]
    NoAngles { region: String },
    #[error(
        "region {region}: the hand hardly moved: its joints went through {moved_rad:.2} rad at most, {needed_rad} rad needed (calibration.min_joint_span); open and close the hand in the air and calibrate again"
    )]
    Still { region: String, moved_rad: f64, needed_rad: f64 },
    #[error(
        "region {region}: joint {joint} went through {degrees:.0}\u{b0}, more than a turn, which no joint of a hand does; are its angles in degrees? (joint.*.degrees)"
    )]
    TooFar { region: String, joint: String, degrees: f64 },
}
