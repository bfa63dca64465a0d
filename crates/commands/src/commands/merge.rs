//! `tpf merge`: what several processes did, put together to what one would have done.

use std::path::{Path, PathBuf};

use tactile_pose_fusion::evaluate::{self, Expected};
use tactile_pose_fusion::export;
use tactile_pose_fusion::location::{self, Entry};

use super::checks::CheckArgs;
use super::eval::{ByArg, Delivery};
use super::sessions::find_bags;
use super::{Failure, Outcome, interrupt, print, say};
use crate::report::progress::Shown;

/// Puts together what several processes did: partials of `tpf eval --partial`, or shards of a dataset. The result is the same
/// as that of one process over all bags, byte for byte.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Partials, or folders of them; with --lerobot shards of a dataset
    #[arg(required = true, value_name = "PARTIAL")]
    partials: Vec<PathBuf>,
    /// Join the shards that `tpf export --lerobot DIR --shard I/N` wrote to this dataset, which must not be there yet
    #[arg(long, value_name = "DIR", conflicts_with_all = ["expect", "by", "gate", "report", "parquet"])]
    lerobot: Option<PathBuf>,
    /// Refuse where one of these bags is missing, and take their order: a folder of bags, or a text with one path a line
    #[arg(long, value_name = "LIST|FOLDER")]
    expect: Option<PathBuf>,
    /// Also print the scores of each of these groups
    #[arg(long, value_enum, value_delimiter = ',')]
    by: Vec<ByArg>,
    /// Hold what was scored against these limits; leaves with 1 where one is not met
    #[arg(long, value_name = "GATES.yaml")]
    gate: Option<PathBuf>,
    /// Make what was scored the reference of the gates
    #[arg(long, requires = "gate")]
    update_refs: bool,
    #[command(flatten)]
    checks: CheckArgs,
    /// Write everything as a page to look at
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
    /// Also write the scores as Parquet, one row a model and group
    #[arg(long, value_name = "OUT.parquet")]
    parquet: Option<PathBuf>,
    /// Replace a report or a table that is already there
    #[arg(long)]
    overwrite: bool,
    /// Print everything as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    interrupt::listen();
    if let Some(out) = &args.lerobot {
        return join(args, out);
    }
    let delivery = Delivery {
        command: "tpf eval", // JUnit and JSON lines are the same as well
        gate: args.gate.as_deref(),
        update_refs: args.update_refs,
        checks: &args.checks,
        report: args.report.as_deref(),
        parquet: args.parquet.as_deref(),
        overwrite: args.overwrite,
        by: &args.by,
        json: args.json,
    };
    delivery.check(&[])?;
    let bags = args.expect.as_deref().map(expected).transpose()?;
    let folder = args.expect.as_deref().filter(|path| location::is_folder(path));
    let expected = bags.as_deref().map(|bags| Expected { bags, folder });
    let partials = partials(&args.partials)?;
    delivery.deliver(evaluate::merge(&partials, expected, &Shown::steps("merge"))?)
}

/// Joins the shards of a dataset.
fn join(args: &Args, out: &Path) -> Result<Outcome, Failure> {
    let joined = export::join(out, &args.partials, &Shown::steps("merge"))?;
    joined.failed.iter().for_each(|failed| say(&format!("not exported: {}", failed.error)));
    let n = joined.bags.len();
    let text = format!("{n} of {} bags in {}\n", n + joined.failed.len(), joined.output);
    print(&if args.json { serde_json::to_string_pretty(&joined)? + "\n" } else { text })?;
    Ok(if joined.failed.is_empty() { Outcome::Done } else { Outcome::InputLost })
}

/// The partials that paths stand for: each is one, or a folder of several.
fn partials(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut partials = Vec::new();
    for path in paths {
        if !location::is_folder(path) {
            partials.push(path.clone());
            continue;
        }
        let failed = |error: std::io::Error| Failure(format!("{}: {error}", path.display()));
        let mut found = Vec::new();
        for Entry { path: entry, .. } in location::list(path).map_err(failed)? {
            let is_hidden = entry.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
            if entry.extension().is_some_and(|extension| extension == "parquet") && !is_hidden {
                found.push(entry);
            }
        }
        if found.is_empty() {
            return Err(Failure(format!("{}: no partial in this folder; expected NAME.parquet", path.display())));
        }
        found.sort();
        partials.extend(found);
    }
    Ok(partials)
}

/// The bags that must be there.
fn expected(path: &Path) -> Result<Vec<PathBuf>, Failure> {
    if location::is_folder(path) {
        return find_bags(&[path.to_path_buf()]);
    }
    let failed = |error: std::io::Error| Failure(format!("{}: {error}", path.display()));
    let text = location::read_text(path).map_err(failed)?;
    let bags = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let bags: Vec<PathBuf> = bags.map(|line| PathBuf::from(location::in_word(line.into()))).collect();
    match bags.is_empty() {
        true => Err(Failure(format!("{}: no bag in this list; expected one path a line", path.display()))),
        false => Ok(bags),
    }
}
