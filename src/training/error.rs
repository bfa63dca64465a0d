//! Why a model can't be trained.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use crate::bag::BagError;
use crate::eval::SplitError;
use crate::evaluate::EvaluateError;
use crate::fusion::{RegressError, SetupError};
use crate::observer::Cancelled;
use crate::sessions::SessionError;
use crate::train::{DatasetError, TrainError};

/// Why a model can't be trained. Each text is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum TrainingError {
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Setup(#[from] SetupError),
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error(transparent)]
    Train(#[from] TrainError),
    #[error(transparent)]
    Split(#[from] SplitError),
    #[error(transparent)]
    Network(#[from] RegressError),
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error("{path}: {reason}")]
    At { path: String, reason: String },
    #[error(
        "the parameters have {n} regions; give --region with the one to train for, of {names}; --kind adaptive takes several"
    )]
    SeveralRegions { n: usize, names: String },
    #[error("--region {name}: the parameters have {names}")]
    NoSuchRegion { name: String, names: String },
    #[error("--region names {name} twice; give each region once")]
    RegionTwice { name: String },
    #[error("--kind {kind} is trained for one region; give one --region, or train --kind adaptive for several")]
    OneRegion { kind: &'static str },
    #[error(
        "{path}: has no true force of any of these regions: it has no topic {topics}; leave the bag out, or name other regions"
    )]
    NoTruthOfAny { path: String, topics: String },
    #[error("region {region}: no bag has a true force of it; leave it out of --region, or add a bag with {topic}")]
    NoBag { region: String, topic: String },
    #[error(
        "regions {first} and {other} are trained for {first_hz} and {other_hz} frames/s; give both model.*.rate_hz alike"
    )]
    Rates { first: String, other: String, first_hz: f64, other_hz: f64 },
    #[error(
        "--hold-out needs one model for all regions of --region in the parameters, because it scores them by it; they have {n}"
    )]
    HoldOutModels { n: usize },
    #[error(
        "region.{region}.joints is empty and --kind {kind} needs joint angles; name the joints, or train --kind tactile-only"
    )]
    NoJoints { region: String, kind: &'static str },
    #[error(
        "region {region}: no force sensor tells its true force; set truth_sources and truth.*.topic in the parameters, or give --truth TOPIC"
    )]
    NoTruth { region: String },
    #[error(
        "--light-touches and --held-touches are for --kind adaptive: the taxels of other models keep the artifact of pose"
    )]
    LightTouches,
    #[error("--held-touches is {got}, expected 0 to {most} copies of each session")]
    HeldTouches { got: usize, most: usize },
    #[error(
        "--kind adaptive gives the normal force only; for --axes 3 train --kind pose-aware, tactile-only or early-fusion"
    )]
    AdaptiveAxes,
    #[error(
        "--axes 3 needs a true force of three axes, and truth.{truth} has one; set truth.{truth}.fields to the paths of x, y and z in the parameters"
    )]
    OneAxis { truth: String },
    #[error("{}: expected a name that ends with .onnx", path.display())]
    NotOnnx { path: PathBuf },
    #[error("{}: is already there; choose another name, or give --overwrite", path.display())]
    Exists { path: PathBuf },
    #[error("{}: is already there; choose another name of the model, or give --overwrite", path.display())]
    FoldExists { path: PathBuf },
    #[error(
        "{}: an interrupted run left it; give --resume to go on from there, or --overwrite to begin anew",
        path.display()
    )]
    Unfinished { path: PathBuf },
    #[error(
        "{}: was made with other settings than this command's; give the same ones, or leave --resume out",
        path.display()
    )]
    OtherSettings { path: PathBuf },
    #[error(
        "interrupted at step {step} of {steps}; nothing is lost: give the same command with --resume to go on from {}",
        checkpoint.display()
    )]
    Interrupted { step: u64, steps: u64, checkpoint: PathBuf },
    #[error(
        "{session}: does not say who wore the glove, so no model can be trained without its user; --hold-out donnings needs no users"
    )]
    NoUser { session: String },
    #[error("all bags are of one {what}, so nothing is left to train on without it; give bags of two or more")]
    OneGroup { what: &'static str },
    #[error("no run was finished")]
    NoRun,
}

impl TrainingError {
    /// An error in a file or bag.
    pub(super) fn at(path: &Path, reason: &dyn Display) -> Self {
        TrainingError::At { path: path.display().to_string(), reason: reason.to_string() }
    }
}
