//! `tpf characterize`: which joints move which taxels of a glove, how large its artifacts are, and what else it does.

use std::path::PathBuf;

use tactile_pose_fusion::characterization::{MIN_GAIN, Request, run as characterize};
use tactile_pose_fusion::files;

use super::in_air::InAirArgs;
use super::sessions::find_bags;
use super::setup::ParamArgs;
use super::zero::ZeroArgs;
use super::{Failure, Outcome, check_output, interrupt, print, say, tell};
use crate::report::characterization;
use crate::report::progress::Shown;

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
    #[command(flatten)]
    in_air: InAirArgs,
    /// Suggest joints as long as each adds this share to what is explained of the artifact
    #[arg(long, value_name = "SHARE", default_value_t = MIN_GAIN, value_parser = share)]
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

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    interrupt::listen();
    args.report.as_deref().map_or(Ok(()), |path| check_output(path, args.overwrite))?;
    let cfg = args.params.load_with_truth(args.truth.as_deref())?;
    let bags = find_bags(&args.bags)?;
    let request = Request {
        in_air: args.in_air.told(),
        zero: args.zero.wanted(),
        min_gain: args.min_gain,
        needs_truth: args.truth.is_some(),
        ..Request::new(&bags)
    };
    let result = characterize(&cfg, &request, &Shown::bytes("characterize"))?;
    print(&if args.json { serde_json::to_string_pretty(&result)? + "\n" } else { characterization::text(&result) })?;
    if let Some(path) = &args.report {
        let written = files::write(path, characterization::page(&result).html().as_bytes(), args.overwrite);
        written.map_err(|error| Failure(format!("{}: {error}", path.display())))?;
        tell(&format!("report: {}", path.display()));
    }
    let losses: Vec<&String> = result.sessions.iter().flat_map(|session| &session.losses).collect();
    losses.iter().for_each(|loss| say(&format!("input lost: {loss}")));
    Ok(if losses.is_empty() { Outcome::Done } else { Outcome::InputLost })
}

/// A share, from the command line.
fn share(text: &str) -> Result<f64, String> {
    let share: f64 = text.parse().map_err(|_| format!("expected a share, got {text:?}"))?;
    if (0.0..1.0).contains(&share) { Ok(share) } else { Err(format!("{share} is outside of [0, 1)")) }
}
