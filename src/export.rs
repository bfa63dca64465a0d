//! Exports sessions to LeRobot datasets and to tables, for learning tools and spreadsheets. [`run`] does this for bags.

mod card;
mod episode;
mod lerobot;
mod loaded;
mod outputs;
mod request;
mod rows;
mod run;
mod stats;
mod summary;

use std::path::{Path, PathBuf};

use crate::bag::{BagError, InputError};
use crate::columns::{Cells, ColumnsError};
use crate::glove::SeveralModels;
use crate::model::ModelError;
use crate::observer::Cancelled;
use crate::protocol::Annotations;
use crate::recording::{EstimateTrack, SampleError, Samples};
use crate::sessions::{SessionError, Shard};
use crate::units::{GramForce, Stamp};

pub use episode::{Episode, Layout};
pub use lerobot::{Dataset, DatasetSpec, Joined, join};
pub use request::{Request, Targets};
pub use rows::{TableLayout, rows};
pub use run::run;
pub use summary::{BagSummary, EpisodeSummary, Failed, Summary};

/// A session to export.
#[derive(Debug)]
pub struct SessionToExport<'a> {
    /// Its name.
    pub name: String,
    /// True if the data are simulated, not recorded.
    pub synthetic: bool,
    /// `[regions]`.
    pub estimates: &'a [EstimateTrack],
    /// `[regions]`: the true force at each estimate. `None` if the bag has none.
    pub truth: &'a [Option<Vec<Option<GramForce>>>],
    /// `[regions]`: its tangential part, x y z in the frame of the patch; `None` where the bag tells none.
    pub tangential_truth: &'a [Option<Vec<Option<[GramForce; 3]>>>],
    /// Taxels and joint angles.
    pub samples: &'a Samples,
    /// Annotations of the protocol.
    pub annotations: &'a Annotations,
}

/// One column of the frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Feature {
    /// Its name. It has no slashes, because LeRobot refuses them.
    pub name: String,
    /// Names of its elements, if they have names.
    pub names: Option<Vec<String>>,
    /// One cell per frame.
    pub cells: Cells,
}

/// An export that is not possible. Each message is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum ExportError {
    #[error("{0}")]
    Columns(#[from] ColumnsError),
    #[error("{path}: {error}")]
    Io { path: String, error: std::io::Error },
    #[error(
        "--fps {fps} is faster than {what}, which comes {rate_hz:.0} times a second: frames would repeat it; give a lower --fps"
    )]
    Rate { what: String, rate_hz: f64, fps: u32 },
    #[error(
        "--tactile-window-ms {window_ms} is {n} samples of tactile source {source_name}, which sends {rate_hz:.0} a second; expected 1 to {most}"
    )]
    Window { window_ms: u32, source_name: String, rate_hz: f64, n: usize, most: usize },
    #[error("{what}: got {n} samples, expected at least 2")]
    TooFew { what: String, n: usize },
    #[error(
        "tactile source {source_name} sends {got:.0} samples a second, in the first bag {expected:.0}: export it to a dataset of its own"
    )]
    OtherRate { source_name: String, expected: f64, got: f64 },
    #[error(
        "region {region} has tangential forces, in the first bag it has none: export it to a dataset and tables of its own"
    )]
    OtherAxes { region: String },
    #[error("it has the joints {got}, the first bag {expected}: export it to a dataset of its own")]
    OtherJoints { expected: String, got: String },
    #[error(
        "region {region}: its estimates are not in the order of their stamps at {at}, expected one run of time: cut the bag there"
    )]
    Order { region: String, at: Stamp },
    #[error("no frame of any region has an estimate, so there is nothing to export")]
    NoEstimate,
    #[error(
        "its stamps span {seconds:.0} s and hold {n} estimates, which can't be one episode: cut the bag at its gaps"
    )]
    Sparse { seconds: f64, n: usize },
    #[error("{0}")]
    Json(#[from] serde_json::Error),
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Sample(#[from] SampleError),
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error(transparent)]
    Models(#[from] SeveralModels),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error("{bag}: {reason}")]
    InBag { bag: String, reason: String },
    #[error("{path}: the folder {folder} is not there: create it first")]
    NoFolder { path: PathBuf, folder: PathBuf },
    #[error("{path}: is there already, and a dataset is never replaced: remove it, or choose another name")]
    DatasetExists { path: PathBuf },
    #[error("{path} is there already; give another name, or --overwrite")]
    TableExists { path: PathBuf },
    #[error("{path}: {reason}")]
    Shard { path: PathBuf, reason: String },
    #[error("there is no shard to join; expected what `tpf export --lerobot DIR --shard I/N` wrote")]
    NoShards,
    #[error("shard {shard} is twice, in {first} and in {other}; leave one of them out")]
    ShardTwice { shard: Shard, first: PathBuf, other: PathBuf },
    #[error("{n} of {of} shards are missing: {names}; export them by `tpf export --lerobot DIR --shard`")]
    MissingShards { n: usize, of: usize, names: String },
    #[error(
        "{first} and {other} were exported with different {what}, {ours} and {theirs}; join only shards of one export"
    )]
    MixedShards { first: PathBuf, other: PathBuf, what: String, ours: String, theirs: String },
    #[error("none of {n} bags could be exported; the first: {first}")]
    NoneExported { n: usize, first: String },
}

impl ExportError {
    /// An error in a bag.
    fn in_bag(bag: &Path, reason: &dyn std::fmt::Display) -> Self {
        ExportError::InBag { bag: bag.display().to_string(), reason: reason.to_string() }
    }
}
