//! `tpf replay`: a recorded bag in, newtons and contact out.

mod each;

use std::num::{NonZero, NonZeroUsize};
use std::path::{Path, PathBuf};

use tactile_pose_fusion::bag::BagError;
use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::replay::{self, Options, Recording, ReplayError, Replayed};
use tactile_pose_fusion::sessions::Shard;

use super::setup::{ModelArgs, ParamArgs};
use super::zero::ZeroArgs;
use super::{Failure, Outcome, interrupt, print, say};
use crate::report::progress::Shown;

/// Reads bags, fuses taxels and joint angles through the models, and writes wrench and contact to a new bag.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// MCAP or .db3 file or bag folder: one recording; several are parts of one, merged by time
    #[arg(required = true, value_name = "BAG")]
    bags: Vec<PathBuf>,
    #[command(flatten)]
    params: ParamArgs,
    /// Bag to write: NAME.mcap for a file, any other name for a bag folder; with --each the folder of the bags
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    models: ModelArgs,
    #[command(flatten)]
    zero: ZeroArgs,
    /// Frames in one inference call, unless set as many as the model runs fastest with; 1 gives the bytes of the live node
    #[arg(long, value_name = "N", value_parser = batch)]
    batch: Option<NonZeroUsize>,
    /// Cores to use, as many as there are unless set; the output is the same on any number
    #[arg(long, value_name = "N")]
    jobs: Option<NonZero<usize>>,
    /// Copy everything in the input into the output, untouched
    #[arg(long)]
    merge: bool,
    /// Take every bag, also those in folders, as a recording of its own, and write each to NAME.mcap in OUT
    #[arg(long)]
    each: bool,
    /// Only every N-th of these bags, from the I-th on, counted from 0: I = 0 .. N-1
    #[arg(long, value_name = "I/N", requires = "each")]
    shard: Option<Shard>,
    /// With --each, keep the outputs that are there already and whole, and replay only the other bags
    #[arg(long, requires = "each", conflicts_with = "overwrite")]
    resume: bool,
    /// Replace an output that is already there
    #[arg(long)]
    overwrite: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    if args.each {
        return each::run(args);
    }
    let mut cfg = args.params.load()?;
    args.models.apply(&mut cfg)?;
    interrupt::listen();
    let replayed = replay(args, cfg, &args.bags, &args.output).map_err(|ended| match ended {
        Ended::Failed(failure) | Ended::Cancelled(failure) => failure,
    })?;
    replayed.warnings().iter().for_each(|warning| say(warning));
    let summary = replayed.summary();
    print(&if args.json { serde_json::to_string_pretty(&summary)? + "\n" } else { summary.to_string() })?;
    Ok(if replayed.is_complete() { Outcome::Done } else { Outcome::InputLost })
}

/// Why there is no replay of a recording.
enum Ended {
    Failed(Failure),
    Cancelled(Failure),
}

/// Replays one recording.
fn replay(args: &Args, cfg: Config, bags: &[PathBuf], output: &Path) -> Result<Replayed, Ended> {
    let mut options =
        Options { overwrite: args.overwrite, merge: args.merge, batch: args.batch, ..Options::new(output) };
    options.jobs = args.jobs.unwrap_or(options.jobs);
    let recording = Recording { bags, zero: args.zero.wanted() };
    replay::run(cfg, recording, &options, &Shown::bytes("replay")).map_err(|error| match error {
        ReplayError::Bag(BagError::Exists { path }) => Ended::Failed(Failure(format!(
            "{}: is there already; choose another name, or give --overwrite",
            path.display()
        ))),
        ReplayError::Cancelled(error) => Ended::Cancelled(error.into()),
        error => Ended::Failed(error.into()),
    })
}

fn batch(text: &str) -> Result<NonZeroUsize, String> {
    let batch = text.parse().ok().filter(|batch: &NonZeroUsize| batch.get() <= 4096);
    batch.ok_or_else(|| format!("expected 1 to 4096 frames, got {text:?}"))
}
