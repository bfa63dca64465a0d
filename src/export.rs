//! Sessions in the forms that learning tools and tables read: LeRobot datasets, and frames as rows.

mod card;
mod episode;
mod lerobot;
mod rows;
mod stats;

use crate::columns::{Cells, ColumnsError};
use crate::protocol::Annotations;
use crate::recording::{EstimateTrack, Samples};
use crate::units::{GramForce, Stamp};

pub use episode::{Episode, Layout};
pub use lerobot::{Dataset, DatasetSpec};
pub use rows::{columns, rows};

/// A session that is to be exported.
#[derive(Debug)]
pub struct Session<'a> {
    /// What it is called.
    pub name: String,
    /// Whether it is no recording but made by a simulator.
    pub synthetic: bool,
    /// `[regions]`.
    pub estimates: &'a [EstimateTrack],
    /// `[regions]`: the true force at each estimate; `None` where the bag tells none.
    pub truth: &'a [Option<Vec<Option<GramForce>>>],
    /// Taxels and joint angles.
    pub samples: &'a Samples,
    /// What the protocol asked for.
    pub annotations: &'a Annotations,
}

/// One column of frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Feature {
    /// Without slashes, which LeRobot refuses.
    pub name: String,
    /// Names of its elements, where each has one.
    pub names: Option<Vec<String>>,
    /// One a frame.
    pub cells: Cells,
}

/// Why a session can't be exported. Each text is one line.
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
}
