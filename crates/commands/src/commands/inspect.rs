//! `tpf inspect`: what is in a bag or a model, and what of it can feed the fusion.

use std::path::PathBuf;

use serde::Serialize;
use tactile_pose_fusion::bag::printable;
use tactile_pose_fusion::inspect::{self, Inspected};

use super::setup::shown;
use super::{Failure, Outcome, interrupt, print, say};
use crate::report::inspection;
use crate::report::progress::Shown;

/// Tells what is in bags and models: topics and their timing, which of them can be tactile, joints or force, contracts.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// MCAP or .db3 files, bag folders or ONNX models; each is told of by itself
    #[arg(required = true, value_name = "PATH")]
    paths: Vec<PathBuf>,
    /// Folder with the .msg files of types that a bag doesn't define, searched before AMENT_PREFIX_PATH
    #[arg(long, value_name = "FOLDER")]
    message_definitions: Option<PathBuf>,
    /// Print one JSON document: an array with a report a path
    #[arg(long)]
    json: bool,
}

/// The report on one path.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Report {
    Found(Inspected),
    Refused(Refused),
}

/// A path that is neither a bag nor a model.
#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename = "refused")]
struct Refused {
    path: String,
    error: String,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    interrupt::listen();
    let mut reports = Vec::new();
    let mut failures = Vec::new();
    let mut outcome = Outcome::Done;
    let (paths, notes) = inspect::recordings(&args.paths);
    notes.iter().for_each(|note| say(&printable(note)));
    for (idx, path) in paths.iter().enumerate() {
        let report = match inspect::inspect(path, args.message_definitions.as_deref(), &Shown::bytes("inspect")) {
            Ok(found) => Report::Found(found),
            Err(error) => {
                let error = printable(&error.to_string());
                failures.push(Failure(error.clone()));
                Report::Refused(Refused { path: shown(path), error })
            }
        };
        if let Report::Found(Inspected::Bag(bag)) = &report
            && !bag.losses.is_empty()
        {
            bag.losses.iter().for_each(|loss| say(&format!("input lost: {}", printable(loss))));
            outcome = Outcome::InputLost;
        }
        if !args.json {
            let text = report.text();
            print(&if idx > 0 && !text.is_empty() { format!("\n{text}") } else { text })?;
        }
        reports.push(report);
    }
    if args.json {
        print(&(serde_json::to_string_pretty(&reports)? + "\n"))?;
    }
    // The last one is the caller's to say.
    match failures.pop() {
        None => Ok(outcome),
        Some(last) => {
            failures.iter().for_each(|failure| say(&format!("tpf: {failure}")));
            Err(last)
        }
    }
}

impl Report {
    fn text(&self) -> String {
        match self {
            Report::Found(Inspected::Bag(bag)) => inspection::bag(bag),
            Report::Found(Inspected::Model(model)) => inspection::model(model),
            Report::Refused(_) => String::new(),
        }
    }
}
