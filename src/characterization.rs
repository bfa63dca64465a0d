//! What a glove does when the hand moves: the bags of its sessions in, [`Characterized`] out.
//!
//! [`characterize`](crate::characterize) is the analysis; this reads bags for it and puts what it finds together.

mod fragment;
mod load;
mod scan;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;

pub use self::scan::NamedTiming;
pub use crate::sessions::InAir;

use self::load::Loader;
use self::scan::{Scan, common_joints};
use crate::bag::{BagError, InputError};
use crate::characterize::{RegionReport, SessionFrames, characterize};
use crate::config::Config;
use crate::fusion::SetupError;
use crate::observer::{Cancelled, Observer, check};
use crate::recording::RecordingError;
use crate::sessions::{SessionError, session_name};
use crate::zero::Wanted;

/// A joint is suggested as long as it adds this share to what is explained of the artifact.
pub const MIN_GAIN: f64 = 0.005;

/// What a glove is characterized from.
#[derive(Debug, Clone, Copy)]
pub struct Request<'a> {
    /// One recording each, of one donning of the glove.
    pub bags: &'a [PathBuf],
    /// Where the zero of the taxels is from.
    pub zero: Wanted<'a>,
    /// When nothing touches the glove; `None` for what the annotations say.
    pub in_air: Option<&'a InAir>,
    /// Least share that a suggested joint adds to what is explained of the artifact, in `[0, 1)`.
    pub min_gain: f64,
    /// Whether a bag without the true force of the parameters is at fault.
    pub needs_truth: bool,
}

impl<'a> Request<'a> {
    /// Sessions that are annotated.
    pub fn new(bags: &'a [PathBuf]) -> Self {
        Request { bags, zero: Wanted::Any, in_air: None, min_gain: MIN_GAIN, needs_truth: false }
    }
}

/// Why a glove can't be characterized. Each text is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum CharacterizeError {
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Recording(#[from] RecordingError),
    #[error(transparent)]
    Setup(#[from] SetupError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error("{bag}: {reason}")]
    InBag { bag: String, reason: String },
}

impl CharacterizeError {
    /// What is wrong with a bag.
    fn in_bag(bag: &Path, reason: &dyn std::fmt::Display) -> Self {
        CharacterizeError::InBag { bag: bag.display().to_string(), reason: reason.to_string() }
    }
}

/// Everything that was found.
#[derive(Debug, Serialize)]
pub struct Characterized {
    /// Version of this crate.
    pub tool_version: &'static str,
    /// Whether some recording was made by a simulator.
    pub synthetic: bool,
    /// One a bag, in their order.
    pub sessions: Vec<SessionSummary>,
    /// In the order of the parameters.
    pub regions: Vec<RegionResult>,
    /// Joints that are not looked at, and why.
    pub joints_left_out: Vec<String>,
    /// What the recordings lack, and what is not told for that.
    pub missing: Vec<String>,
    /// Lines for the parameter file, below `ros__parameters`.
    pub parameters: String,
}

/// What results say of a session.
#[derive(Debug, Serialize)]
pub struct SessionSummary {
    /// What it is called: its bag without the folder.
    pub name: String,
    /// Path of the bag.
    pub bag: String,
    /// `?` where nothing tells it.
    pub glove: String,
    /// `?` where nothing tells it.
    pub user: String,
    /// Whether it was made by a simulator.
    pub synthetic: bool,
    /// What tells the time in the air.
    pub in_air: String,
    /// Where the baseline comes from.
    pub zero: String,
    /// Timing of each tactile source.
    pub tactile: Vec<NamedTiming>,
    /// Timing of each joint source.
    pub joints: Vec<NamedTiming>,
    /// What was lost of the bag.
    pub losses: Vec<String>,
}

/// What was found of a region.
#[derive(Debug, Serialize)]
pub struct RegionResult {
    /// Its name.
    pub region: String,
    /// Its taxels as indices into a sample of the source.
    pub taxels: Vec<usize>,
    /// Its joints by the parameters.
    pub configured_joints: Vec<String>,
    /// What its taxels do.
    #[serde(flatten)]
    pub report: RegionReport,
}

/// Characterizes a glove from the bags of its sessions.
///
/// # Errors
/// [`CharacterizeError`] when a bag can't be read, nothing tells when its hand was in the air, or the observer cancels.
pub fn run(cfg: &Config, request: &Request<'_>, observer: &dyn Observer) -> Result<Characterized, CharacterizeError> {
    let bags = request.bags;
    let scans = bags.iter().map(|bag| Scan::of(bag, cfg, observer)).collect::<Result<Vec<_>, _>>()?;
    let (found, joints_left_out) = common_joints(cfg, &scans);
    let (joints, sources): (Vec<String>, Vec<usize>) = found.into_iter().unzip();
    let loader = Loader { cfg, joints: &joints, request, observer };
    let mut by_region: Vec<Vec<SessionFrames>> = vec![Vec::new(); cfg.fusion.regions.len()];
    let (mut sessions, mut missing) = (Vec::new(), Vec::new());
    for (bag, scan) in bags.iter().zip(scans) {
        let loaded = loader.load(bag, &scan)?;
        by_region.iter_mut().zip(loaded.regions).for_each(|(sessions, frames)| sessions.push(frames));
        missing.extend(loaded.missing);
        let named = |noted: Option<String>, set: &Option<String>| noted.or(set.clone()).unwrap_or("?".to_owned());
        sessions.push(SessionSummary {
            name: session_name(bag),
            bag: bag.display().to_string(),
            glove: named(loaded.notes.glove, &cfg.glove),
            user: named(loaded.notes.user, &cfg.user),
            synthetic: loaded.notes.synthetic,
            in_air: loaded.in_air,
            zero: loaded.zero,
            tactile: scan.tactile,
            joints: scan.joints,
            losses: loaded.losses,
        });
    }
    let gloves: BTreeSet<&str> = sessions.iter().map(|session: &SessionSummary| session.glove.as_str()).collect();
    if gloves.len() > 1 {
        let gloves = gloves.into_iter().collect::<Vec<_>>().join(", ");
        observer
            .warn(&format!("the bags are of several gloves, {gloves}, and are taken as one; give those of one glove"));
    }
    let without_truth = cfg.fusion.regions.iter().zip(&cfg.truth_of_region).filter(|(_, truth)| truth.is_none());
    missing.extend(without_truth.map(|(region, _)| {
        format!(
            "region {}: no force sensor in the parameters (truth_sources, --truth), so no forces are told",
            region.name
        )
    }));
    let mut regions = Vec::new();
    for (region, frames) in cfg.fusion.regions.iter().zip(&by_region) {
        check(observer)?;
        regions.push(RegionResult {
            region: region.name.clone(),
            taxels: region.taxels.clone(),
            configured_joints: region.joints.clone(),
            report: characterize(frames, &joints, region.taxels.len(), request.min_gain),
        });
    }
    let synthetic = sessions.iter().any(|session| session.synthetic);
    let parameters = fragment::parameters(&regions, cfg, &sources, synthetic);
    Ok(Characterized {
        tool_version: env!("CARGO_PKG_VERSION"),
        synthetic,
        sessions,
        regions,
        joints_left_out,
        missing,
        parameters,
    })
}
