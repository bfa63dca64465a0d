//! `tpf inspect`: what is in a bag or a model, and what of it can feed the fusion.

mod bag_text;
mod format;
mod model_text;

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::progress::Shown;
use super::setup::shown;
use super::{Failure, Outcome, print, say};
use crate::bag::{Recordings, recordings_at};
use crate::inspect::BagReport;
use crate::model::{self, ModelInfo};

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

/// What is told of one path.
#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum Report {
    Bag(Box<BagReport>),
    Model(Box<ModelInfo>),
    /// It can be neither.
    Refused {
        path: String,
        error: String,
    },
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let mut reports = Vec::new();
    let mut failures = Vec::new();
    let mut outcome = Outcome::Done;
    for (idx, path) in recordings(&args.paths).iter().enumerate() {
        let report = match inspect(path, args.message_definitions.as_deref()) {
            Ok(report) => report,
            Err(Failure(error)) => {
                let error = format::printable(&error);
                failures.push(Failure(error.clone()));
                Report::Refused { path: shown(path), error }
            }
        };
        if let Report::Bag(bag) = &report
            && !bag.losses.is_empty()
        {
            bag.losses.iter().for_each(|loss| say(&format!("input lost: {}", format::printable(loss))));
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

/// Each path, or the recordings in it where it is a folder of several files.
fn recordings(paths: &[PathBuf]) -> Vec<PathBuf> {
    let of_path = |path: &PathBuf| match recordings_at(path) {
        Ok(Recordings { paths, note }) if paths.iter().any(|found| found.parent() == Some(path) && found.is_file()) => {
            note.iter().for_each(|note| say(&format::printable(note)));
            paths
        }
        _ => vec![path.clone()],
    };
    paths.iter().flat_map(of_path).collect()
}

fn inspect(path: &Path, definitions: Option<&Path>) -> Result<Report, Failure> {
    if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("onnx")) {
        return Ok(Report::Model(Box::new(model::inspect(path)?)));
    }
    Ok(Report::Bag(Box::new(BagReport::read(path, definitions, &Shown::bytes("inspect"))?)))
}

impl Report {
    fn text(&self) -> String {
        match self {
            Report::Bag(bag) => bag_text::text(bag),
            Report::Model(model) => model_text::text(model),
            Report::Refused { .. } => String::new(),
        }
    }
}
