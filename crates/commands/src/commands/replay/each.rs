//! `tpf replay --each`: many recordings, each to a bag of its own.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;
use tactile_pose_fusion::files;
use tactile_pose_fusion::replay::is_there;
use tactile_pose_fusion::sessions::{Shard, session_name};

use super::super::sessions::find_bags;
use super::super::{Failure, Outcome, interrupt, print, say};
use super::{Args, Ended, replay};

/// The result of the replay of one recording.
#[derive(Default, Serialize)]
struct Replayed {
    bag: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    output: Option<String>,
    /// Whether the output was there before.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    kept: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    summary: Option<serde_json::Value>,
    #[serde(skip)]
    text: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

/// Replays each recording to `NAME.mcap` in the output folder. One that fails is named, and the others are replayed.
pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let mut cfg = args.params.load()?;
    args.models.apply(&mut cfg)?;
    interrupt::listen();
    let all = find_bags(&args.bags)?;
    let outputs = outputs(&all, &args.output)?;
    let shard = args.shard.unwrap_or(Shard::WHOLE);
    let failed = |error: std::io::Error| Failure(format!("{}: {error}", args.output.display()));
    files::make_folder(&args.output).map_err(failed)?;
    let (mut found, mut n_failed, mut is_complete) = (Vec::new(), 0, true);
    let own = shard.bags(&all);
    for (bag, output) in own.iter().zip(shard.bags(&outputs)) {
        let of_bag = Replayed { bag: bag.display().to_string(), ..Replayed::default() };
        let place = Some(output.display().to_string());
        let done = match if args.resume { is_there(&cfg, &output) } else { Ok(false) } {
            Ok(true) => Ok(None),
            Ok(false) => replay(args, cfg.clone(), std::slice::from_ref(bag), &output).map(Some),
            Err(error) => Err(Ended::Failed(error.into())),
        };
        match done {
            Ok(None) => found.push(Replayed { output: place, kept: true, ..of_bag }),
            Ok(Some(replayed)) => {
                replayed.warnings().iter().for_each(|warning| say(&format!("{}: {warning}", bag.display())));
                is_complete &= replayed.is_complete();
                let summary = replayed.summary();
                let (text, summary) = (summary.to_string(), Some(serde_json::to_value(&summary)?));
                found.push(Replayed { output: place, summary, text, ..of_bag });
            }
            Err(Ended::Cancelled(failure)) => return Err(failure),
            Err(Ended::Failed(Failure(error))) => {
                say(&format!("not replayed: {}: {error}", bag.display()));
                n_failed += 1;
                found.push(Replayed { error: Some(error), ..of_bag });
            }
        }
    }
    print(&if args.json { serde_json::to_string_pretty(&found)? + "\n" } else { text(&found, &args.output) })?;
    Ok(if n_failed > 0 || !is_complete { Outcome::InputLost } else { Outcome::Done })
}

fn text(found: &[Replayed], folder: &Path) -> String {
    let texts: Vec<&str> = found.iter().filter(|one| one.error.is_none()).map(|one| one.text.as_str()).collect();
    let kept = match found.iter().filter(|one| one.kept).count() {
        0 => String::new(),
        n => format!(", {n} of them from before"),
    };
    format!("{}{} of {} bags in {}{kept}\n", texts.concat(), texts.len(), found.len(), folder.display())
}

/// Where each recording goes.
fn outputs(bags: &[PathBuf], folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let mut named: BTreeMap<String, &PathBuf> = BTreeMap::new();
    let mut outputs = Vec::new();
    for bag in bags {
        let name = session_name(bag);
        if let Some(other) = named.insert(name.clone(), bag) {
            let (other, bag) = (other.display(), bag.display());
            return Err(Failure(format!(
                "{other} and {bag} would both become {name}.mcap; replay them to two folders"
            )));
        }
        outputs.push(folder.join(format!("{name}.mcap")));
    }
    Ok(outputs)
}
