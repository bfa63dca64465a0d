//! `tpf eval`: what a model, or the estimates in a bag, are worth against the true force.

mod gates;
mod pose_quality;
mod render;
mod report;
mod tables;

use std::num::NonZero;
use std::path::PathBuf;

use clap::ValueEnum;

use self::gates::GateFile;
use self::pose_quality::PoseQualityArgs;
pub(super) use self::render::short_text;
use self::tables::FrameFile;
use super::checks::{self, CheckArgs};
use super::in_air::InAirArgs;
use super::progress::Shown;
use super::sessions::find_bags;
use super::setup::{BackendArgs, ParamArgs};
use super::split::SplitArgs;
use super::zero::ZeroArgs;
use super::{Failure, Outcome, interrupt, print, say};
use crate::eval::GroupBy;
use crate::evaluate::{self, Evaluated, JudgeTouch, Request};
use crate::files;
use crate::fusion::TouchLevels;

/// Scores force and contact against the true force: per session, user, glove and substage, in the shape of the paper.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Bags, or folders of bags: one recording each, of one donning of the glove
    #[arg(required = true, value_name = "BAG")]
    bags: Vec<PathBuf>,
    #[command(flatten)]
    params: ParamArgs,
    /// Model to score; without it the estimates in the bags, where they hold some, else the models of the parameters
    #[arg(long, value_name = "ONNX")]
    model: Option<PathBuf>,
    /// Score this model too, and test what --model gains over it; may be given several times, the first is the baseline
    #[arg(long, value_name = "ONNX")]
    compare: Vec<PathBuf>,
    #[command(flatten)]
    backend: BackendArgs,
    /// Topic of the true force, instead of the one in the parameters
    #[arg(long, value_name = "TOPIC")]
    truth: Option<String>,
    #[command(flatten)]
    split: SplitArgs,
    /// Score every frame, not only those that `tpf train` keeps for the test: for recordings never trained on
    #[arg(long, conflicts_with_all = ["split", "test_share"])]
    whole: bool,
    /// Judge touch by a force of 2.5 gF as in the paper, or by this probability of touch, of models that give one; without it
    /// as the node decides contact
    #[arg(long, value_name = "force|PROBABILITY", value_parser = touch)]
    touch: Option<JudgeTouch>,
    /// Score each bag, and all of it, by the models MODEL.without-*.onnx that were trained without it, as `tpf train
    /// --hold-out` writes them; also for --compare
    #[arg(long, requires = "model", conflicts_with_all = ["split", "test_share"])]
    held_out: bool,
    /// Take the first N touches of each session as known: they fit what its forces are multiplied by, as `tpf calibrate
    /// --touches` does, and what follows them is scored
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(3..))]
    known_touches: Option<u16>,
    #[command(flatten)]
    zero: ZeroArgs,
    #[command(flatten)]
    in_air: InAirArgs,
    /// Also print the scores of each of these groups
    #[arg(long, value_enum, value_delimiter = ',')]
    by: Vec<ByArg>,
    /// Hold what --model scored, or the estimates in the bags, against these limits; leaves with 1 where one is not met
    #[arg(long, value_name = "GATES.yaml")]
    gate: Option<PathBuf>,
    /// Make what was scored the reference of the gates
    #[arg(long, requires = "gate")]
    update_refs: bool,
    #[command(flatten)]
    checks: CheckArgs,
    #[command(flatten)]
    pose_quality: PoseQualityArgs,
    /// Write everything as a page to look at: tables, plots, and the stretches of the best and the worst estimates
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
    /// Also write the scores as Parquet, one row a model and group
    #[arg(long, value_name = "OUT.parquet")]
    parquet: Option<PathBuf>,
    /// Also write every scored frame as Parquet: truth, estimate, base, contact, and what was asked for
    #[arg(long, value_name = "OUT.parquet")]
    frames: Option<PathBuf>,
    /// Replace a report or a table that is already there
    #[arg(long)]
    overwrite: bool,
    /// Bags that are read side by side; as many as there are cores unless set
    #[arg(short, long, value_name = "N")]
    jobs: Option<NonZero<usize>>,
    /// Print everything as JSON
    #[arg(long)]
    json: bool,
}

fn touch(text: &str) -> Result<JudgeTouch, String> {
    if text == "force" {
        return Ok(JudgeTouch::Force);
    }
    let on = text.parse::<f64>().ok().filter(|on| *on > 0.0 && *on < 1.0);
    let on = on.ok_or("expected force, or a probability between 0 and 1 such as 0.8")?;
    Ok(JudgeTouch::Levels(TouchLevels::from_on(on)))
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ByArg {
    User,
    Session,
    Stage,
    Substage,
}

impl From<ByArg> for GroupBy {
    fn from(by: ByArg) -> Self {
        match by {
            ByArg::User => GroupBy::User,
            ByArg::Session => GroupBy::Session,
            ByArg::Stage => GroupBy::Stage,
            ByArg::Substage => GroupBy::Substage,
        }
    }
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    interrupt::listen();
    if args.gate.is_none() && args.checks.are_wanted() {
        return Err(Failure("--junit and --jsonl write how gates went; give --gate GATES.yaml".to_owned()));
    }
    let outputs = [&args.report, &args.parquet, &args.frames];
    if let Some(path) = outputs.into_iter().flatten().find(|path| path.exists() && !args.overwrite) {
        return Err(Failure(format!("{} is there already; give another name, or --overwrite", path.display())));
    }
    let gates = args.gate.as_deref().map(GateFile::read).transpose()?;
    let mut result = evaluate(args)?;
    if let Some(gates) = &gates {
        result.checks = gates.judge(&result, args.update_refs)?;
        args.checks.write("tpf eval", &result.checks)?;
    }
    result.sessions.iter().flat_map(|session| &session.warnings).for_each(|warning| say(warning));
    result.failed.iter().for_each(|failed| say(&format!("not scored: {}", failed.error)));
    if let Some(path) = &args.report {
        let written = files::replace(path, report::page(&result).html().as_bytes());
        written.map_err(|error| Failure(format!("{}: {error}", path.display())))?;
        say(&format!("report: {}", path.display()));
    }
    if let Some(path) = &args.parquet {
        tables::write_scores(path, &result)?;
    }
    print(&if args.json {
        serde_json::to_string_pretty(&result)? + "\n"
    } else {
        render::text(&result, &args.by.iter().map(|by| GroupBy::from(*by)).collect::<Vec<_>>())
    })?;
    let lost = !result.failed.is_empty() || result.sessions.iter().any(|session| !session.losses.is_empty());
    Ok(match (checks::are_met(&result.checks), lost) {
        (false, _) => Outcome::NotMet,
        (true, true) => Outcome::InputLost,
        (true, false) => Outcome::Done,
    })
}

/// Scores, and gives everything that was found.
fn evaluate(args: &Args) -> Result<Evaluated, Failure> {
    let cfg = args.params.load_with_truth(args.truth.as_deref())?;
    let split = if args.whole { None } else { Some(args.split.split(0.0)?) };
    let bags = find_bags(&args.bags)?;
    let everything = Request::new(&bags);
    let request = Request {
        model: args.model.as_deref(),
        compare: &args.compare,
        backend: args.backend.choice(),
        split,
        zero: args.zero.wanted(),
        in_air: args.in_air.told(),
        needs_truth: args.truth.is_some(),
        pose_levels: args.pose_quality.levels()?,
        held_out: args.held_out,
        known_touches: args.known_touches.map(usize::from),
        touch: args.touch.unwrap_or_default(),
        jobs: args.jobs.map_or(everything.jobs, NonZero::get),
        ..everything
    };
    let mut frames = args.frames.as_deref().map(FrameFile::new);
    let result = evaluate::run_with(cfg, &request, &Shown::bytes("eval"), |series, session| {
        let written = frames.iter_mut().try_for_each(|frames| frames.handle_session(series, session));
        written.map_err(|failure| failure.to_string().into())
    })?;
    frames.map_or(Ok(()), FrameFile::finish)?;
    Ok(result)
}
