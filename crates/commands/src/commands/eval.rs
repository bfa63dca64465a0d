//! `tpf eval`: what a model, or the estimates in a bag, are worth against the true force.

mod deliver;
mod gates;
mod partial;
mod pose_quality;

use std::num::NonZero;
use std::path::PathBuf;

pub(super) use self::deliver::{ByArg, Delivery};
use self::partial::PartialArgs;
use self::pose_quality::PoseQualityArgs;
use super::checks::CheckArgs;
use super::in_air::InAirArgs;
use super::sessions::find_bags;
use super::setup::{BackendArgs, ParamArgs};
use super::split::SplitArgs;
use super::zero::ZeroArgs;
use super::{Failure, Outcome, interrupt};
use crate::report::evaluation::FrameFile;
use crate::report::progress::Shown;
use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::evaluate::{self, Evaluated, JudgeTouch, Request, Series, SessionToScore};
use tactile_pose_fusion::fusion::TouchLevels;

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
    #[command(flatten)]
    partial: PartialArgs,
    /// Replace a report, a table or a partial that is already there
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

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    interrupt::listen();
    let delivery = args.delivery();
    delivery.check(&[&args.frames, &args.partial.partial])?;
    if let Some(path) = &args.partial.partial {
        return partial::run(args, path);
    }
    delivery.deliver(evaluate(args)?)
}

impl Args {
    fn delivery(&self) -> Delivery<'_> {
        Delivery {
            command: "tpf eval",
            gate: self.gate.as_deref(),
            update_refs: self.update_refs,
            checks: &self.checks,
            report: self.report.as_deref(),
            parquet: self.parquet.as_deref(),
            overwrite: self.overwrite,
            by: &self.by,
            json: self.json,
        }
    }
}

/// Scores, and gives everything that was found.
fn evaluate(args: &Args) -> Result<Evaluated, Failure> {
    let bags = find_bags(&args.bags)?;
    scored(args, &bags, |cfg, request, each| {
        let mut result = evaluate::run_with(cfg, request, &Shown::bytes("eval"), each)?;
        result.command = evaluate::command(&partial::named(args), &partial::options());
        Ok(result)
    })
}

type Each<'e> = dyn FnMut(&[Series], &SessionToScore) -> Result<(), Box<dyn std::error::Error + Send + Sync>> + 'e;

/// Asks for the scores of bags in the way that the command line says, and writes their frames where it says so.
fn scored<T>(
    args: &Args,
    bags: &[PathBuf],
    score: impl FnOnce(Config, &Request<'_>, &mut Each<'_>) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let cfg = args.params.load_with_truth(args.truth.as_deref())?;
    let split = if args.whole { None } else { Some(args.split.split(0.0)?) };
    let everything = Request::new(bags);
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
    let mut frames = args.frames.as_deref().map(|path| FrameFile::new(path, args.overwrite));
    let result = score(cfg, &request, &mut |series, session| {
        let written = frames.iter_mut().try_for_each(|frames| frames.handle_session(series, session));
        written.map_err(|error| error.to_string().into())
    })?;
    frames.map_or(Ok(()), FrameFile::finish)?;
    Ok(result)
}
