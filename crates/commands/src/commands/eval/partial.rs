//! `tpf eval --partial` and `--shard`: the statistics of some bags, for `tpf merge`.

use std::path::{Path, PathBuf};

use clap::parser::ValueSource;
use tactile_pose_fusion::evaluate::{Partial, PartialOut, run_partial};
use tactile_pose_fusion::sessions::Shard;

use super::super::sessions::find_bags;
use super::super::{Failure, Outcome, WORDS, command, print, say};
use super::{Args, scored};
use crate::report::progress::Shown;

/// Which bags, and where their statistics go.
#[derive(Debug, clap::Args)]
pub(super) struct PartialArgs {
    /// Write statistics that `tpf merge` puts together with those of other bags, instead of scores
    #[arg(long, value_name = "OUT.parquet", conflicts_with_all = ["report", "parquet", "gate", "by"])]
    pub(super) partial: Option<PathBuf>,
    /// Only every N-th bag of those that were found, from the I-th on, counted from 0: I = 0 .. N-1
    #[arg(long, value_name = "I/N", requires = "partial")]
    pub(super) shard: Option<Shard>,
}

/// Options that change no score, or that every process has its own of.
const NOT_OF_SCORES: [&str; 14] = [
    "bags",
    "by",
    "gate",
    "update_refs",
    "junit",
    "jsonl",
    "report",
    "parquet",
    "frames",
    "partial",
    "shard",
    "jobs",
    "json",
    "overwrite",
];

/// Writes the statistics of the bags.
pub(super) fn run(args: &Args, path: &Path) -> Result<Outcome, Failure> {
    let all = find_bags(&args.bags)?;
    let shard = args.partial.shard;
    let bags = shard.unwrap_or(Shard::WHOLE).bags(&all);
    let (named, options) = (named(args), options());
    let out = PartialOut { path, named: &named, options: &options, shard: shard.map(|shard| (shard, all.len())) };
    let partial =
        scored(args, &bags, |cfg, request, each| Ok(run_partial(cfg, request, out, &Shown::bytes("eval"), each)?))?;
    partial.bags.iter().flat_map(|bag| &bag.warnings).for_each(|warning| say(warning));
    partial.bags.iter().filter_map(|bag| bag.error.as_ref()).for_each(|error| say(&format!("not scored: {error}")));
    print(&if args.json { serde_json::to_string_pretty(&partial)? + "\n" } else { text(&partial) })?;
    Ok(if partial.has_lost() { Outcome::InputLost } else { Outcome::Done })
}

/// The bags and folders of the command line.
pub(super) fn named(args: &Args) -> Vec<String> {
    args.bags.iter().map(|bag| bag.display().to_string()).collect()
}

fn text(partial: &Partial) -> String {
    let n_failed = partial.bags.iter().filter(|bag| bag.error.is_some()).count();
    format!("{} of {} bags in {}\n", partial.bags.len() - n_failed, partial.bags.len(), partial.partial)
}

/// The options of the command line that decide scores, in the order of `--help`: the same however the work was shared out, and
/// whatever was written of it.
pub(super) fn options() -> Vec<String> {
    given_options().unwrap_or_default()
}

fn given_options() -> Option<Vec<String>> {
    let all = command();
    let of_eval = all.find_subcommand("eval")?;
    let given = command().try_get_matches_from(WORDS.get()?).ok()?;
    let given = given.subcommand_matches("eval")?;
    let mut words = Vec::new();
    for arg in of_eval.get_arguments().filter(|arg| !NOT_OF_SCORES.contains(&arg.get_id().as_str())) {
        let (id, Some(long)) = (arg.get_id().as_str(), arg.get_long()) else { continue };
        if !matches!(given.try_contains_id(id), Ok(true)) || given.value_source(id) != Some(ValueSource::CommandLine) {
            continue;
        }
        if !arg.get_action().takes_values() {
            words.push(format!("--{long}"));
            continue;
        }
        for value in given.get_raw(id).into_iter().flatten() {
            words.extend([format!("--{long}"), value.to_string_lossy().into_owned()]);
        }
    }
    Some(words)
}
