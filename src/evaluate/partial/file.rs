//! A partial on the disk: a Parquet table with a group of rows a bag, and notes on what all of them have in common.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::error::MergeError;
use super::fingerprint::Fingerprint;
use super::{PartialBag, PartialOut, hex, is_there, table};
use crate::columns::{ColumnFile, TableReader};
use crate::evaluate::EvaluateError;
use crate::evaluate::scored::{BagPart, Head};
use crate::sessions::Shard;

/// Form of the table and its notes.
const FORMAT: &str = "3";

/// Names of the notes.
const FORMAT_NOTE: &str = "tpf_partial";
const VERSION_NOTE: &str = "made_by";
const HEAD_NOTE: &str = "tpf_head";
const CHECKSUM_NOTE: &str = "tpf_checksum";

/// Notes of a partial, which are read before its statistics.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Notes {
    pub(super) fingerprint: Fingerprint,
    /// `None` of no bags.
    pub(super) head: Option<Head>,
    /// Bags and folders of the command line.
    pub(super) named: Vec<String>,
    /// Its options that decide scores.
    pub(super) command_options: Vec<String>,
    /// Which share of all bags this is, and how many there are in all.
    pub(super) shard: Option<(Shard, usize)>,
    /// `[groups]`
    pub(super) bags: Vec<BagNote>,
}

/// Note on a bag of a partial, which is read before its statistics.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct BagNote {
    pub(super) bag: String,
    pub(super) sha256: Option<String>,
    pub(super) is_scored: bool,
    /// Which of the bags of this partial it is, in the order in which they were given.
    pub(super) nth: usize,
    /// Of its rows.
    checksum: String,
}

/// A partial that is written; under its name once it is whole.
pub(super) struct PartialFile {
    file: ColumnFile,
    bags: Vec<BagNote>,
}

impl PartialFile {
    pub(super) fn create(path: &Path) -> Result<Self, EvaluateError> {
        let made_by = made_by(env!("CARGO_PKG_VERSION"));
        let notes = [(FORMAT_NOTE, FORMAT.to_owned()), (VERSION_NOTE, made_by)];
        // It replaces only what is there as the work begins.
        let file = ColumnFile::create(path, &table::columns(), &notes, is_there(path)?)?;
        Ok(PartialFile { file, bags: Vec::new() })
    }

    /// Adds the `nth` of the bags that were given.
    pub(super) fn write(&mut self, nth: usize, part: &BagPart) -> Result<PartialBag, EvaluateError> {
        let in_bag = |error: serde_json::Error| EvaluateError::in_bag(&part.bag, &error);
        let cells = table::cells(part).map_err(in_bag)?;
        self.file.write(&cells)?;
        let (bag, sha256) = (part.bag.clone(), part.sha256.clone());
        let checksum = table::checksum(&cells);
        let is_scored = part.outcome.is_ok();
        self.bags.push(BagNote { bag: bag.clone(), sha256: sha256.clone(), is_scored, nth, checksum });
        let summary = part.outcome.as_ref().ok().map(|scored| &scored.summary);
        Ok(PartialBag {
            bag,
            sha256,
            error: part.outcome.as_ref().err().cloned(),
            has_losses: summary.is_some_and(|summary| !summary.losses.is_empty()),
            warnings: summary.map(|summary| summary.warnings.clone()).unwrap_or_default(),
        })
    }

    /// Gives it its name.
    pub(super) fn finish(
        self,
        out: PartialOut<'_>,
        fingerprint: Fingerprint,
        head: Option<Head>,
    ) -> Result<(), EvaluateError> {
        let PartialFile { mut file, bags } = self;
        let notes = Notes {
            fingerprint,
            head,
            named: out.named.to_vec(),
            command_options: out.options.to_vec(),
            shard: out.shard,
            bags,
        };
        let text = serde_json::to_string(&notes).map_err(|error| EvaluateError::OfCaller(error.into()))?;
        file.note(CHECKSUM_NOTE, hex(Sha256::digest(&text)));
        file.note(HEAD_NOTE, text);
        file.seal()?;
        Ok(file.finish()?)
    }
}

/// A partial that is read.
pub(super) struct PartialReader {
    pub(super) path: PathBuf,
    table: TableReader,
    pub(super) notes: Notes,
}

impl PartialReader {
    /// Opens a partial of this version.
    pub(super) fn open(path: &Path) -> Result<Self, MergeError> {
        let damaged = |reason: String| MergeError::Damaged { path: path.to_path_buf(), reason };
        let table = TableReader::open_sealed(path)?;
        let no_partial = || MergeError::NoPartial { path: path.to_path_buf() };
        let format = table.note(FORMAT_NOTE).ok_or_else(no_partial)?;
        let (made_by_ours, got) = (made_by(env!("CARGO_PKG_VERSION")), table.note(VERSION_NOTE).unwrap_or("nobody"));
        if format != FORMAT || got != made_by_ours {
            let (got, expected) = (format!("{got}, form {format}"), format!("{made_by_ours}, form {FORMAT}"));
            return Err(MergeError::Version { path: path.to_path_buf(), got, expected });
        }
        table.expect(&table::columns())?;
        let text = table.note(HEAD_NOTE).unwrap_or_default();
        if table.note(CHECKSUM_NOTE) != Some(hex(Sha256::digest(text)).as_str()) {
            return Err(damaged("its notes were changed after it was written".to_owned()));
        }
        let notes: Notes = serde_json::from_str(text).map_err(|error| damaged(format!("its notes: {error}")))?;
        if notes.bags.len() != table.n_groups() || (notes.head.is_none() && !notes.bags.is_empty()) {
            let told = format!("it holds {} groups of rows, its notes tell of {}", table.n_groups(), notes.bags.len());
            return Err(damaged(told));
        }
        Ok(PartialReader { path: path.to_path_buf(), table, notes })
    }

    /// The result of one of its bags.
    pub(super) fn part(&self, idx: usize) -> Result<BagPart, MergeError> {
        let damaged = |reason: String| MergeError::Damaged { path: self.path.clone(), reason };
        let note = self.notes.bags.get(idx).ok_or_else(|| damaged("it has no such bag".to_owned()))?;
        let cells = self.table.group(idx)?;
        if table::checksum(&cells) != note.checksum {
            return Err(damaged(format!("the statistics of {} were changed after it was written", note.bag)));
        }
        let n_series = self.notes.head.as_ref().map_or(0, |head| head.series.len());
        let part = table::part(cells, n_series).map_err(damaged)?;
        if part.bag != note.bag || part.outcome.is_ok() != note.is_scored {
            return Err(damaged(format!("its notes and rows contradict each other about {}", note.bag)));
        }
        Ok(part)
    }
}

/// The version note of a partial.
fn made_by(version: &str) -> String {
    format!("tactile_pose_fusion {version}")
}
