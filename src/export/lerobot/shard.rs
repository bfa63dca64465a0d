//! Joins the shards of a dataset, which several processes wrote, to the dataset that a single process writes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;

use super::notes::ShardNotes;
use super::{Dataset, N_COUNTING, io, sealed};
use crate::columns::{Cells, TableReader};
use crate::export::{Episode, ExportError, Failed, Feature};
use crate::location;
use crate::observer::{Observer, check};

/// Result of joining shards.
#[derive(Debug, Serialize)]
pub struct Joined {
    /// Path of the dataset.
    pub output: String,
    /// Bags in the dataset, in their order.
    pub bags: Vec<String>,
    /// Bags that could not be exported.
    pub failed: Vec<Failed>,
}

/// Joins the shards of a dataset, in any order: the result is, byte for byte, that of one export of all bags.
///
/// # Errors
/// [`ExportError`] when one is no shard of this version or damaged, they are not of the same export, one is missing or
/// twice, or `out` can't be written; there is then no dataset.
pub fn join(out: &Path, shards: &[PathBuf], observer: &dyn Observer) -> Result<Joined, ExportError> {
    let mut found: BTreeMap<usize, Source> = BTreeMap::new();
    for path in shards {
        let source = Source::open(path)?;
        if let Some((_, first)) = found.first_key_value() {
            first.refuse_mixture(&source)?;
        }
        let shard = source.notes.shard;
        if let Some(other) = found.insert(shard.index(), source) {
            let other = other.folder;
            return Err(ExportError::ShardTwice { shard, first: other, other: path.clone() });
        }
    }
    let Some(notes) = found.first_key_value().map(|(_, first)| first.notes.clone()) else {
        return Err(ExportError::NoShards);
    };
    let of = notes.shard.of();
    if found.len() < of {
        let missing = (0..of).filter(|index| !found.contains_key(index)).take(6);
        let names: Vec<String> = missing.map(|index| format!("{index}/{of}")).collect();
        return Err(ExportError::MissingShards { n: of - found.len(), of, names: names.join(", ") });
    }
    let mut dataset = Dataset::create(out, notes.spec)?;
    let mut joined = Joined { output: out.display().to_string(), bags: Vec::new(), failed: Vec::new() };
    for place in 0..notes.n_bags {
        check(observer)?;
        observer.progress(place as u64, notes.n_bags as u64);
        let Some(source) = found.get_mut(&(place % of)) else { return Err(ExportError::NoShards) };
        let bag = source.notes.bags[place / of].clone();
        match bag.error {
            Some(error) => joined.failed.push(Failed { bag: bag.bag, error }),
            None => {
                let episode = source.next_episode(bag.synthetic)?;
                dataset.refuse_other_features(&episode, &source.folder)?;
                dataset.handle_episode(episode)?;
                joined.bags.push(bag.bag);
            }
        }
    }
    match (joined.bags.is_empty(), joined.failed.first()) {
        (true, Some(first)) => Err(ExportError::NoneExported { n: joined.failed.len(), first: first.error.clone() }),
        _ => {
            dataset.finish()?;
            Ok(joined)
        }
    }
}

/// A shard that is being read.
struct Source {
    folder: PathBuf,
    notes: ShardNotes,
    /// Names of the elements of each feature.
    names: BTreeMap<String, Option<Vec<String>>>,
    table: Option<TableReader>,
    n_files: usize,
    group: usize,
}

impl Source {
    fn open(folder: &Path) -> Result<Self, ExportError> {
        let refuse = |reason: String| ExportError::Shard { path: folder.to_path_buf(), reason };
        let notes = sealed::open(folder).map_err(refuse)?;
        let expected = notes.shard.n_of(notes.n_bags);
        if notes.bags.len() != expected {
            return Err(refuse(format!("its notes tell of {} bags, expected {expected}", notes.bags.len())));
        }
        let path = folder.join("meta/info.json");
        let text = location::read_text(&path).map_err(io(&path))?;
        let info: Value = serde_json::from_str(&text).map_err(|error| refuse(format!("info.json: {error}")))?;
        let features = info["features"].as_object().ok_or_else(|| refuse("info.json: no features".to_owned()))?;
        let names = |feature: &Value| serde_json::from_value(feature["names"].clone()).ok().flatten();
        let names = features.iter().map(|(name, feature)| (name.clone(), names(feature))).collect();
        Ok(Source { folder: folder.to_path_buf(), notes, names, table: None, n_files: 0, group: 0 })
    }

    /// Refuses a shard of another export.
    fn refuse_mixture(&self, other: &Source) -> Result<(), ExportError> {
        let (a, b) = (&self.notes, &other.notes);
        let mixed = |what: &str, ours: String, theirs: String| {
            let (first, other) = (self.folder.clone(), other.folder.clone());
            Err(ExportError::MixedShards { first, other, what: what.to_owned(), ours, theirs })
        };
        if a.version != b.version {
            return mixed("versions", a.version.clone(), b.version.clone());
        }
        if (a.shard.of(), a.n_bags) != (b.shard.of(), b.n_bags) {
            let told = |notes: &ShardNotes| format!("{} of {} bags", notes.shard, notes.n_bags);
            return mixed("shards", told(a), told(b));
        }
        let value = |notes: &ShardNotes, name: &String| notes.made_by.get(name).cloned().unwrap_or_default();
        match a.made_by.keys().find(|name| a.made_by.get(*name) != b.made_by.get(*name)) {
            Some(name) => mixed(name, value(a, name), value(b, name)),
            None => Ok(()),
        }
    }

    /// Reads its next episode.
    fn next_episode(&mut self, synthetic: bool) -> Result<Episode, ExportError> {
        let table = loop {
            match self.table.take().filter(|table| self.group < table.n_groups()) {
                Some(table) => break table,
                None => {
                    let path = super::numbered(&self.folder.join("data"), self.n_files);
                    self.table = Some(TableReader::open(&path)?);
                    (self.n_files, self.group) = (self.n_files + 1, 0);
                }
            }
        };
        let mut cells = table.group(self.group)?;
        let mut columns: Vec<String> = table.columns().iter().map(|(name, _)| name.clone()).collect();
        self.group += 1;
        self.table = Some(table);
        let n_own = columns.len().checked_sub(N_COUNTING).ok_or_else(|| ExportError::Shard {
            path: self.folder.clone(),
            reason: "its table lacks the columns of a dataset".to_owned(),
        })?;
        columns.truncate(n_own);
        cells.truncate(n_own);
        let n_frames = cells.first().map_or(0, Cells::n_rows);
        let feature =
            |(name, cells): (String, Cells)| Feature { names: self.names.get(&name).cloned().flatten(), name, cells };
        let features = columns.into_iter().zip(cells).map(feature).collect();
        Ok(Episode { n_frames, synthetic, skipped_s: 0.0, known: Vec::new(), features })
    }
}
