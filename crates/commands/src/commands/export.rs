//! `tpf export`: sessions as a LeRobot dataset, or as tables.

use std::path::PathBuf;

use tactile_pose_fusion::export::{self, Request, Targets};
use tactile_pose_fusion::sessions::Shard;

use super::in_air::InAirArgs;
use super::sessions::find_bags;
use super::setup::{ModelArgs, ParamArgs};
use super::zero::ZeroArgs;
use super::{Failure, Outcome, interrupt, print, say};
use crate::report::progress::Shown;

/// Ends of names of tables.
const CSV: &str = "csv";
const PARQUET: &str = "parquet";

/// Writes force, contact, artifact, taxels and joint angles for those who learn from them: as a LeRobot dataset at its
/// own rate, or as a table of all frames.
///
/// Estimates are those in the bag where it holds some (of `tpf run --record` or `tpf replay --merge`), else the models of
/// the parameters make them as `tpf replay` does.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("outputs").required(true).multiple(true))]
pub(super) struct Args {
    /// Bags, or folders of bags: one recording each, which becomes one episode
    #[arg(required = true, value_name = "BAG")]
    bags: Vec<PathBuf>,
    #[command(flatten)]
    params: ParamArgs,
    /// Write a LeRobotDataset v3 to this folder, which must not be there yet
    #[arg(long, value_name = "DIR", group = "outputs")]
    lerobot: Option<PathBuf>,
    /// Write every frame of every region as Parquet
    #[arg(long, value_name = "FILE", group = "outputs")]
    parquet: Option<PathBuf>,
    /// Write every frame of every region as CSV
    #[arg(long, value_name = "FILE", group = "outputs")]
    csv: Option<PathBuf>,
    /// Write a table: CSV or Parquet, by the end of the name (.csv, .parquet)
    #[arg(short, long, value_name = "FILE", group = "outputs", conflicts_with_all = ["csv", "parquet"], value_parser = table)]
    output: Option<PathBuf>,
    /// Frames a second of the LeRobot dataset
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    fps: u32,
    /// How far back the tactile samples of a frame reach, at their own rate
    #[arg(long, value_name = "MS", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    tactile_window_ms: u32,
    /// What was done in these bags, in words: the task of the LeRobot dataset
    #[arg(long, value_name = "TEXT", default_value = "manipulation with a tactile glove")]
    task: String,
    #[command(flatten)]
    models: ModelArgs,
    #[command(flatten)]
    zero: ZeroArgs,
    #[command(flatten)]
    in_air: InAirArgs,
    /// Topic of the true force for the tables, instead of the one in the parameters
    #[arg(long, value_name = "TOPIC")]
    truth: Option<String>,
    /// Only every N-th bag of those that were found, from the I-th on, counted from 0 (I = 0 .. N-1), for `tpf merge --lerobot`
    #[arg(long, value_name = "I/N", requires = "lerobot", conflicts_with_all = ["parquet", "csv"])]
    shard: Option<Shard>,
    /// Replace a table that is already there; a dataset is never replaced
    #[arg(long)]
    overwrite: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    interrupt::listen();
    let targets = args.targets();
    targets.check()?;
    let cfg = args.params.load_with_truth(args.truth.as_deref())?;
    let bags = find_bags(&args.bags)?;
    let request = Request {
        fps: args.fps,
        tactile_window_ms: args.tactile_window_ms,
        task: &args.task,
        model: args.models.path(),
        backend: args.models.choice(),
        zero: args.zero.wanted(),
        in_air: args.in_air.told(),
        needs_truth: args.truth.is_some(),
        shard: args.shard,
        ..Request::new(&bags, targets)
    };
    let summary = export::run(&cfg, &request, &Shown::steps("export"))?;
    summary.notes().iter().for_each(|note| say(note));
    print(&if args.json { serde_json::to_string_pretty(&summary)? + "\n" } else { summary.to_string() })?;
    Ok(if summary.has_lost() { Outcome::InputLost } else { Outcome::Done })
}

impl Args {
    fn targets(&self) -> Targets<'_> {
        let named = |end: &str| self.output.as_deref().filter(|path| path.extension().is_some_and(|of| of == end));
        Targets {
            lerobot: self.lerobot.as_deref(),
            parquet: self.parquet.as_deref().or(named(PARQUET)),
            csv: self.csv.as_deref().or(named(CSV)),
            overwrite: self.overwrite,
        }
    }
}

/// A table whose name tells its format.
fn table(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension() {
        Some(end) if end == CSV || end == PARQUET => Ok(path),
        _ => Err("expected a name that ends in .csv or .parquet; for a LeRobotDataset, use --lerobot DIR".to_owned()),
    }
}
