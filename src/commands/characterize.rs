//! `tpf characterize`: which joints move which taxels of a glove, how large its artifacts are, and what else it does.

mod fragment;
mod load;
mod page;
mod scan;
mod text;

use std::collections::BTreeSet;
use std::path::PathBuf;

use serde::Serialize;

use self::load::{InAir, Loader};
use self::scan::{NamedTiming, Scan, common_joints};
use super::sessions::{find_bags, session_name};
use super::setup::ParamArgs;
use super::zero::ZeroArgs;
use super::{Failure, Outcome, interrupt, print, say};
use crate::characterize::{RegionReport, SessionFrames, characterize};
use crate::config::Config;
use crate::files;

/// Characterizes a glove from recordings: joints that move its taxels, artifact size, hysteresis, drift, noise, clocks.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Bags, or folders of bags: one recording each, of one donning of the glove
    #[arg(required = true, value_name = "BAG")]
    bags: Vec<PathBuf>,
    #[command(flatten)]
    params: ParamArgs,
    /// Topic of the true force, instead of the one in the parameters
    #[arg(long, value_name = "TOPIC")]
    truth: Option<String>,
    #[command(flatten)]
    zero: ZeroArgs,
    /// When nothing touches the glove, in seconds from the first taxels of each bag, or `all`; instead of annotations
    #[arg(long, value_name = "FROM..TO|all", allow_hyphen_values = true)]
    in_air: Option<InAir>,
    /// Suggest joints as long as each adds this share to what is explained of the artifact
    #[arg(long, value_name = "SHARE", default_value_t = 0.005, value_parser = share)]
    min_gain: f64,
    /// Print everything as JSON
    #[arg(long)]
    json: bool,
    /// Write everything as a page to look at, with tables and plots
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
    /// Replace a report that is already there
    #[arg(long, requires = "report")]
    overwrite: bool,
}

/// Everything that was found.
#[derive(Debug, Serialize)]
pub(super) struct Characterized {
    tool_version: &'static str,
    /// Whether some recording was made by a simulator.
    synthetic: bool,
    sessions: Vec<SessionSummary>,
    regions: Vec<RegionResult>,
    /// Joints that are not looked at, and why.
    joints_left_out: Vec<String>,
    /// What the recordings lack, and what is not told for that.
    missing: Vec<String>,
    /// Lines for the parameter file, below `ros__parameters`.
    parameters: String,
}

/// What results say of a session.
#[derive(Debug, Serialize)]
pub(super) struct SessionSummary {
    name: String,
    bag: String,
    glove: String,
    user: String,
    synthetic: bool,
    /// What tells the time in the air.
    in_air: String,
    /// Where the baseline comes from.
    zero: String,
    /// Timing of each tactile source.
    tactile: Vec<NamedTiming>,
    /// Timing of each joint source.
    joints: Vec<NamedTiming>,
    losses: Vec<String>,
}

/// What was found of a region.
#[derive(Debug, Serialize)]
pub(super) struct RegionResult {
    region: String,
    /// Its taxels as indices into a sample of the source.
    taxels: Vec<usize>,
    /// Its joints by the parameters.
    configured_joints: Vec<String>,
    #[serde(flatten)]
    report: RegionReport,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    interrupt::listen();
    if let Some(path) = args.report.as_deref().filter(|path| path.exists() && !args.overwrite) {
        return Err(Failure(format!("{} is there already; give another name, or --overwrite", path.display())));
    }
    let cfg = args.params.load_with_truth(args.truth.as_deref())?;
    let result = find(args, &cfg)?;
    print(&if args.json { serde_json::to_string_pretty(&result)? + "\n" } else { text::text(&result) })?;
    if let Some(path) = &args.report {
        let written = files::replace(path, page::page(&result).html().as_bytes());
        written.map_err(|error| Failure(format!("{}: {error}", path.display())))?;
        say(&format!("report: {}", path.display()));
    }
    let losses: Vec<&String> = result.sessions.iter().flat_map(|session| &session.losses).collect();
    losses.iter().for_each(|loss| say(&format!("input lost: {loss}")));
    Ok(if losses.is_empty() { Outcome::Done } else { Outcome::InputLost })
}

fn find(args: &Args, cfg: &Config) -> Result<Characterized, Failure> {
    let bags = find_bags(&args.bags)?;
    let scans = bags.iter().map(|bag| Scan::of(bag, cfg)).collect::<Result<Vec<_>, _>>()?;
    if let Some(in_air) = args.in_air {
        for scan in &scans {
            in_air.check(scan)?.iter().for_each(|note| say(note));
        }
    }
    let (found, joints_left_out) = common_joints(cfg, &scans);
    let (joints, sources): (Vec<String>, Vec<usize>) = found.into_iter().unzip();
    let loader = Loader { cfg, joints: &joints, in_air: args.in_air, is_truth_needed: args.truth.is_some() };
    let mut by_region: Vec<Vec<SessionFrames>> = vec![Vec::new(); cfg.fusion.regions.len()];
    let (mut sessions, mut missing) = (Vec::new(), Vec::new());
    for (bag, scan) in bags.iter().zip(scans) {
        let loaded = loader.load(bag, &scan, &args.zero)?;
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
        say(&format!("the bags are of several gloves, {gloves}, and are taken as one; give those of one glove"));
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
        interrupt::check()?;
        regions.push(RegionResult {
            region: region.name.clone(),
            taxels: region.taxels.clone(),
            configured_joints: region.joints.clone(),
            report: characterize(frames, &joints, region.taxels.len(), args.min_gain),
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

/// A share, from the command line.
fn share(text: &str) -> Result<f64, String> {
    let share: f64 = text.parse().map_err(|_| format!("expected a share, got {text:?}"))?;
    if (0.0..1.0).contains(&share) { Ok(share) } else { Err(format!("{share} is outside of [0, 1)")) }
}
