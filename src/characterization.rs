//! Characterizes how a glove responds to movements of the hand, from the bags of its sessions.
//!
//! [`characterize`](crate::characterize) is the analysis. This module reads the bags for it and collects the results.

mod fragment;
mod load;
mod scan;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;

pub use self::scan::NamedTiming;
pub use crate::sessions::InAir;

use self::load::GloveLoader;
use self::scan::{Scan, common_joints};
use crate::bag::{BagError, InputError};
use crate::characterize::{RegionReport, SessionFrames, characterize};
use crate::config::Config;
use crate::fusion::SetupError;
use crate::observer::{Cancelled, Observer, check};
use crate::recording::RecordingError;
use crate::sessions::{SessionError, session_name};
use crate::zero::Wanted;

/// Minimum share of the artifact that a joint must explain in addition to others to be suggested.
pub const MIN_GAIN: f64 = 0.005;

/// Options of a characterization.
#[derive(Debug, Clone, Copy)]
pub struct Request<'a> {
    /// Recordings, each of one donning of the glove.
    pub bags: &'a [PathBuf],
    /// Source of the zero of the taxels.
    pub zero: Wanted<'a>,
    /// Times at which nothing touches the glove. `None` uses the annotations.
    pub in_air: Option<&'a InAir>,
    /// Minimum share of the artifact that a suggested joint must explain in addition to others, in `[0, 1)`.
    pub min_gain: f64,
    /// True if a bag fails without the true force that the parameters name.
    pub needs_truth: bool,
}

impl<'a> Request<'a> {
    /// Options for sessions with annotations.
    pub fn new(bags: &'a [PathBuf]) -> Self {
        Request { bags, zero: Wanted::Any, in_air: None, min_gain: MIN_GAIN, needs_truth: false }
    }
}

/// A glove that can't be characterized. Each message is one line.
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
    /// An error in a bag.
    fn in_bag(bag: &Path, reason: &dyn std::fmt::Display) -> Self {
        CharacterizeError::InBag { bag: bag.display().to_string(), reason: reason.to_string() }
    }
}

/// Results of a characterization.
#[derive(Debug, Serialize)]
pub struct Characterized {
    /// Version of this crate.
    pub tool_version: &'static str,
    /// True if some recording is simulated.
    pub synthetic: bool,
    /// One per bag, in their order.
    pub sessions: Vec<SessionSummary>,
    /// In the order of the parameters.
    pub regions: Vec<RegionResult>,
    /// Joints that were not examined, with reasons.
    pub joints_left_out: Vec<String>,
    /// Data that the recordings lack, and results that are missing because of it.
    pub missing: Vec<String>,
    /// Lines for the parameter file, below `ros__parameters`.
    pub parameters: String,
}

/// Summary of a session.
#[derive(Debug, Serialize)]
pub struct SessionSummary {
    /// Name: the bag without its folder.
    pub name: String,
    /// Path of the bag.
    pub bag: String,
    /// `?` if unknown.
    pub glove: String,
    /// `?` if unknown.
    pub user: String,
    /// True if it is simulated.
    pub synthetic: bool,
    /// Source for the time in the air.
    pub in_air: String,
    /// Source of the baseline.
    pub zero: String,
    /// Timing of each tactile source.
    pub tactile: Vec<NamedTiming>,
    /// Timing of each joint source.
    pub joints: Vec<NamedTiming>,
    /// Data of the bag that were lost.
    pub losses: Vec<String>,
}

/// Results for a region.
#[derive(Debug, Serialize)]
pub struct RegionResult {
    /// Its name.
    pub region: String,
    /// Its taxels as indices into a sample of the source.
    pub taxels: Vec<usize>,
    /// Its joints in the parameters.
    pub configured_joints: Vec<String>,
    /// Behaviour of its taxels.
    #[serde(flatten)]
    pub report: RegionReport,
}

/// Characterizes a glove from the bags of its sessions.
///
/// # Errors
/// [`CharacterizeError`] if a bag can't be read, if the time in the air is unknown, or if the observer cancels.
pub fn run(cfg: &Config, request: &Request<'_>, observer: &dyn Observer) -> Result<Characterized, CharacterizeError> {
    let bags = request.bags;
    let scans = bags.iter().map(|bag| Scan::of(bag, cfg, observer)).collect::<Result<Vec<_>, _>>()?;
    let (found, joints_left_out) = common_joints(cfg, &scans);
    let (joints, sources): (Vec<String>, Vec<usize>) = found.into_iter().unzip();
    let loader = GloveLoader { cfg, joints: &joints, request, observer };
    let mut by_region: Vec<Vec<SessionFrames>> = vec![Vec::new(); cfg.fusion().regions().len()];
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
    let without_truth = cfg.fusion().regions().iter().zip(cfg.truth_of_region()).filter(|(_, truth)| truth.is_none());
    missing.extend(without_truth.map(|(region, _)| {
        format!(
            "region {}: no force sensor in the parameters (truth_sources, --truth), so no forces are told",
            region.name
        )
    }));
    let mut regions = Vec::new();
    for (region, frames) in cfg.fusion().regions().iter().zip(&by_region) {
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
