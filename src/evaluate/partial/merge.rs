//! Partials folded in a fixed order, to what one run over all of their bags gives.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::error::MergeError;
use super::file::{Notes, PartialReader};
use super::{command, few};
use crate::evaluate::Evaluated;
use crate::evaluate::results::Gathered;
use crate::evaluate::scored::Head;
use crate::observer::{Observer, check};
use crate::sessions::Shard;

/// Partials that are kept open; more are opened again for each bag.
const MOST_OPEN: usize = 256;

/// The bags that must be there, in the order of the result.
#[derive(Debug, Clone, Copy)]
pub struct Expected<'a> {
    /// All of them.
    pub bags: &'a [PathBuf],
    /// The folder that they were found in, where it was named instead of them.
    pub folder: Option<&'a Path>,
}

/// A bag, and where its statistics are.
struct Place {
    partial: usize,
    group: usize,
    nth: usize,
    bag: String,
}

/// Folds partials to what one run over their bags gives, in the order of `expected` where it is given. Else the order is that
/// of the list that shards were taken from, and of bags that were chosen in another way that of their paths.
///
/// # Errors
/// [`MergeError`] when one is no partial of this version or damaged, they were not scored alike, a bag is twice or missing, or
/// no bag could be scored.
pub fn merge(
    partials: &[PathBuf],
    expected: Option<Expected<'_>>,
    observer: &dyn Observer,
) -> Result<Evaluated, MergeError> {
    let mut notes: Vec<Notes> = Vec::new();
    let mut open: BTreeMap<usize, PartialReader> = BTreeMap::new();
    for (idx, path) in partials.iter().enumerate() {
        check(observer)?;
        let reader = PartialReader::open(path)?;
        notes.push(reader.notes.clone());
        if idx < MOST_OPEN {
            open.insert(idx, reader);
        }
    }
    refuse_mixtures(partials, &notes)?;
    let places = in_order(partials, &notes, expected.map(|expected| expected.bags))?;
    // A partial in which no bag was scored may have been made for other series: those depend on what bags hold.
    let has_scores = |notes: &&Notes| notes.bags.iter().any(|bag| bag.is_scored);
    let head = notes.iter().find(has_scores).or(notes.iter().find(|notes| notes.head.is_some()));
    let head = head.and_then(|notes| notes.head.clone()).ok_or(MergeError::NoBags { n: partials.len() })?;
    let mut gathered = Gathered::default();
    for (turn, place) in places.iter().enumerate() {
        check(observer)?;
        observer.progress(turn as u64, places.len() as u64);
        let part = match open.get(&place.partial) {
            Some(reader) => reader.part(place.group)?,
            None => PartialReader::open(&partials[place.partial])?.part(place.group)?,
        };
        gathered.handle(turn, part)?;
    }
    let mut merged = gathered.finish(&head)?;
    let options = places.first().map(|place| notes[place.partial].command_options.as_slice()).unwrap_or_default();
    merged.command = command(&named(&notes, &places, expected), options);
    Ok(merged)
}

/// The bags and folders that one command line names to score these bags in this order.
fn named(notes: &[Notes], places: &[Place], expected: Option<Expected<'_>>) -> Vec<String> {
    let folder = expected.and_then(|expected| expected.folder);
    if let Some(folder) = folder {
        return vec![folder.display().to_string()];
    }
    let all_alike =
        |first: &Notes| notes.len() == 1 || notes.iter().all(|one| one.shard.is_some() && one.named == first.named);
    match notes.first().filter(|first| expected.is_none() && all_alike(first)) {
        Some(first) => first.named.clone(),
        None => places.iter().map(|place| place.bag.clone()).collect(),
    }
}

/// Refuses partials that were not scored alike.
fn refuse_mixtures(partials: &[PathBuf], notes: &[Notes]) -> Result<(), MergeError> {
    let mixed = |first: usize, other: usize, what: &str, values: [String; 2]| {
        let [ours, theirs] = values;
        let (first, other) = (partials[first].clone(), partials[other].clone());
        Err(MergeError::Mixed { first, other, what: what.to_owned(), ours, theirs })
    };
    let short = |sha256: &str| format!("SHA-256 {}", sha256.get(..12).unwrap_or(sha256));
    let first = notes.first().map(|notes| &notes.fingerprint);
    for (other_idx, other) in notes.iter().enumerate() {
        let (Some(ours), theirs) = (first, &other.fingerprint) else { continue };
        if ours.parameters != theirs.parameters {
            return mixed(0, other_idx, "parameters", [short(&ours.parameters), short(&theirs.parameters)]);
        }
        let value = |of: &BTreeMap<String, String>, name: &String| of.get(name).cloned().unwrap_or_default();
        let mut names = ours.options.keys().chain(theirs.options.keys());
        if let Some(name) = names.find(|name| ours.options.get(*name) != theirs.options.get(*name)) {
            let values = [value(&ours.options, name), value(&theirs.options, name)];
            return mixed(0, other_idx, &format!("options ({name})"), values);
        }
        if ours.folds != theirs.folds {
            let told = |folds: &[String]| folds.iter().map(|sha256| short(sha256)).collect::<Vec<_>>().join(", ");
            return mixed(0, other_idx, "held-out models", [told(&ours.folds), told(&theirs.folds)]);
        }
    }
    let is_scored = |notes: &Notes| notes.bags.iter().any(|bag| bag.is_scored);
    let heads = notes.iter().enumerate().filter(|(_, notes)| is_scored(notes));
    let mut heads = heads.filter_map(|(idx, notes)| Some((idx, notes.head.as_ref()?)));
    let Some((first_idx, first)) = heads.next() else { return Ok(()) };
    for (other_idx, other) in heads {
        let names = |head: &Head| {
            head.series
                .iter()
                .map(|one| one.name.clone())
                .filter(|name| !name.is_empty())
                .collect::<Vec<_>>()
                .join(", ")
        };
        if first.series != other.series || first.n_compared != other.n_compared || first.split != other.split {
            return mixed(first_idx, other_idx, "models", [names(first), names(other)]);
        }
        let sums = |head: &Head| head.models.iter().map(|model| model.sha256.clone()).collect::<Vec<_>>();
        if let Some((a, b)) = sums(first).iter().zip(&sums(other)).find(|(a, b)| a != b) {
            return mixed(first_idx, other_idx, "models", [short(a), short(b)]);
        }
    }
    Ok(())
}

/// Where every bag is, in the order of the result.
fn in_order(partials: &[PathBuf], notes: &[Notes], expected: Option<&[PathBuf]>) -> Result<Vec<Place>, MergeError> {
    let mut by_path: BTreeMap<&str, usize> = BTreeMap::new();
    let mut by_content: BTreeMap<&str, (usize, &str)> = BTreeMap::new();
    for (idx, bag) in notes.iter().enumerate().flat_map(|(idx, notes)| notes.bags.iter().map(move |bag| (idx, bag))) {
        let twice = |first: usize, same: String| {
            let (first, other) = (partials[first].clone(), partials[idx].clone());
            MergeError::Twice { bag: bag.bag.clone(), first, other, same }
        };
        if let Some(first) = by_path.insert(&bag.bag, idx) {
            return Err(twice(first, String::new()));
        }
        let Some(sha256) = bag.sha256.as_deref() else { continue };
        if let Some((first, name)) = by_content.insert(sha256, (idx, &bag.bag)) {
            return Err(twice(first, format!(" as {name}")));
        }
    }
    let all = notes.iter().enumerate().flat_map(|(partial, notes)| {
        let bags = notes.bags.iter().enumerate();
        bags.map(move |(group, bag)| Place { partial, group, nth: bag.nth, bag: bag.bag.clone() })
    });
    let mut all: Vec<Place> = all.collect();
    let by_shard = shard_places(partials, notes, expected.is_none())?;
    match (expected, by_shard) {
        (Some(expected), _) => {
            let wanted: BTreeMap<&Path, usize> =
                expected.iter().enumerate().map(|(idx, bag)| (bag.as_path(), idx)).collect();
            let found: BTreeSet<&Path> = all.iter().map(|place| Path::new(&place.bag)).collect();
            let missing: Vec<String> = expected
                .iter()
                .filter(|bag| !found.contains(bag.as_path()))
                .map(|bag| bag.display().to_string())
                .collect();
            if !missing.is_empty() {
                let (n, of) = (missing.len(), expected.len());
                return Err(MergeError::Missing { n, of, names: few(&missing) });
            }
            let is_wanted = |place: &&Place| wanted.contains_key(Path::new(&place.bag));
            let others: Vec<String> =
                all.iter().filter(|place| !is_wanted(place)).map(|place| place.bag.clone()).collect();
            if !others.is_empty() {
                return Err(MergeError::Unexpected { n: others.len(), names: few(&others) });
            }
            all.sort_by_key(|place| wanted.get(Path::new(&place.bag)).copied());
        }
        (None, Some(shards)) => all.sort_by_key(|place| shards[place.partial].place(place.nth)),
        (None, None) => all.sort_by(|a, b| Path::new(&a.bag).cmp(Path::new(&b.bag))),
    }
    Ok(all)
}

/// The shards, where every partial is one of the same number; `None` where bags were chosen in another way.
fn shard_places(partials: &[PathBuf], notes: &[Notes], needs_all: bool) -> Result<Option<Vec<Shard>>, MergeError> {
    let shards: Option<Vec<_>> = notes.iter().map(|notes| notes.shard).collect();
    let Some(shards) = shards else { return Ok(None) };
    let Some(&(first, n_bags)) = shards.first() else { return Ok(None) };
    for (idx, (shard, n)) in shards.iter().enumerate() {
        if shard.of() != first.of() || *n != n_bags {
            let told = |shard: Shard, n: usize| format!("{shard} of {n} bags");
            return Err(MergeError::Mixed {
                first: partials[0].clone(),
                other: partials[idx].clone(),
                what: "shards".to_owned(),
                ours: told(first, n_bags),
                theirs: told(*shard, *n),
            });
        }
        if let Some(before) = shards[..idx].iter().position(|(other, _)| other == shard) {
            let (first, other) = (partials[before].clone(), partials[idx].clone());
            return Err(MergeError::Twice { bag: format!("shard {shard}"), first, other, same: String::new() });
        }
        let (got, expected) = (notes[idx].bags.len(), shard.n_of(n_bags));
        if got != expected {
            let reason = format!("shard {shard} of {n_bags} bags holds {got} bags, expected {expected}");
            return Err(MergeError::Damaged { path: partials[idx].clone(), reason });
        }
    }
    if needs_all && shards.len() < first.of() {
        let has = |index: &usize| shards.iter().any(|(shard, _)| shard.index() == *index);
        // A file can claim any number of shards: only the first few are looked for.
        let names = (0..first.of()).filter(|index| !has(index)).take(6);
        let names: Vec<String> = names.map(|index| format!("{index}/{}", first.of())).collect();
        let n = first.of() - shards.len();
        return Err(MergeError::MissingShards { n, of: first.of(), names: names.join(", ") });
    }
    Ok(Some(shards.into_iter().map(|(shard, _)| shard).collect()))
}
