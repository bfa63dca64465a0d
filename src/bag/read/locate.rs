//! From the path that a person gives to the files of the bag behind it.

use std::path::{Path, PathBuf};

use super::BagError;
use super::channels::ChannelTable;
use super::foreign::not_a_bag;
use super::names::natural_order;
use super::storage::{first_log_time, summary};
use crate::bag::error::one_line;
use crate::bag::layout::{self, METADATA_FILE};
use crate::bag::shown;
use crate::location::{self, Entry, Found, Place};
use crate::units::{NANOS_PER_SEC, Stamp};

/// How files of bags end; a `.zstd` or `.zst` may follow.
const EXTENSIONS: [&str; 2] = ["mcap", "db3"];

/// Longest pause from one part of a split recording to the next: the recorder goes on in the next file with the message
/// that comes after the last one of this.
const MAX_PAUSE_NS: i64 = NANOS_PER_SEC;

/// The files of one input, in the order in which they are read.
#[derive(Debug)]
pub(super) struct Files {
    pub(super) places: Vec<Place>,
    /// The recorder left no list of files: it was stopped in mid-write, so a file may be empty.
    pub(super) unlisted: bool,
    /// A note for a person on how they were found.
    pub(super) note: Option<String>,
}

/// The recordings that a path stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recordings {
    /// Each is a `.mcap` file, or the folder of one recording; in the order of their names.
    pub paths: Vec<PathBuf>,
    /// A note for a person on how they were found.
    pub note: Option<String>,
}

/// The files behind `input`: itself, or those of a bag folder.
pub(super) fn files(input: &Path) -> Result<Files, BagError> {
    let found = location::find(input).map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => BagError::NotFound { path: input.to_path_buf() },
        _ => BagError::io(input, "open", error),
    })?;
    match found {
        Found::Folder => folder(input),
        Found::File(place) => Ok(Files { places: vec![place], unlisted: false, note: None }),
        Found::Other => Err(not_a_bag(input, "it is no regular file, which a bag must be".to_owned())),
    }
}

/// Most bags in a folder that are named, where one of them is meant.
const MOST_NAMED: usize = 3;

/// Size of a bag's files as they are stored. None of them is unpacked or copied.
///
/// # Errors
/// [`BagError`] when there is no bag, or a file can't be opened.
pub fn stored_bytes(bag: &Path) -> Result<u64, BagError> {
    files(bag)?.places.iter().try_fold(0_u64, |total, place| {
        let size = place.open().and_then(|file| file.size());
        Ok(total.saturating_add(size.map_err(|error| BagError::io(place.path(), "open", error))?))
    })
}

fn folder(folder: &Path) -> Result<Files, BagError> {
    let listing_path = folder.join(METADATA_FILE);
    if is_file(&listing_path)? {
        return Ok(Files { places: listed(folder, &listing_path)?, unlisted: false, note: None });
    }
    let Contents { mut files, folders } = contents(folder)?;
    if files.is_empty() {
        let mut why = "the folder holds no .mcap or .db3 file and no metadata.yaml".to_owned();
        let bags = if folders.is_empty() {
            Vec::new()
        } else {
            recordings_at(folder).map_or_else(|_| Vec::new(), |found| found.paths)
        };
        // A folder without any stands for itself.
        if bags.first().is_some_and(|bag| bag != folder) {
            let named: Vec<String> = bags.iter().take(MOST_NAMED).map(|bag| shown(bag)).collect();
            let n_more = bags.len() - named.len();
            let more = if n_more > 0 { format!(" and {n_more} more") } else { String::new() };
            why.push_str(&format!("; folders in it are bags, name one: {}{more}", named.join(", ")));
        }
        return Err(not_a_bag(folder, why));
    }
    files.sort_by(by_name);
    if files.len() == 1 {
        return Ok(Files { places: files, unlisted: true, note: None });
    }
    if !are_parts_of_one(&files)? {
        let names = files.iter().map(|place| name_of(place.path())).collect();
        return Err(BagError::Several { path: folder.to_path_buf(), names });
    }
    let note = format!(
        "{}: no metadata.yaml; {} to {} follow one another in number and time and are read as one split recording",
        folder.display(),
        name_of(files[0].path()),
        name_of(files[files.len() - 1].path())
    );
    Ok(Files { places: files, unlisted: true, note: Some(note) })
}

/// Whether files are the parts of one recording whose recorder didn't come to list them: named `NAME_0.mcap`,
/// `NAME_1.mcap` and so on, each going on where the one before it ends.
fn are_parts_of_one(files: &[Place]) -> Result<bool, BagError> {
    let mut before: Option<(String, u64)> = None;
    for place in files {
        let file_name = place.path().file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let Some((name, number)) = bag_stem(&file_name).and_then(|stem| stem.rsplit_once('_')) else {
            return Ok(false);
        };
        let Ok(number) = number.parse::<u64>() else { return Ok(false) };
        if before.is_some_and(|(known, last)| known != name || last.checked_add(1) != Some(number)) {
            return Ok(false);
        }
        before = Some((name.to_owned(), number));
    }
    let mut end: Option<Stamp> = None;
    for (idx, place) in files.iter().enumerate() {
        let is_last = idx + 1 == files.len();
        let span = match summary(place, 0, &mut ChannelTable::default())?.and_then(|found| found.statistics) {
            Some(statistics) => statistics.span,
            None if is_last => first_log_time(place).unwrap_or_default().map(|first| (first, first)),
            None => return Ok(false),
        };
        let Some((begin, last)) = span else {
            // An empty part is one that a recorder opened and never came to write to.
            if is_last { break } else { return Ok(false) }
        };
        if end.is_some_and(|end| !(0..=MAX_PAUSE_NS).contains(&begin.nanos_since(end))) {
            return Ok(false);
        }
        end = Some(last);
    }
    Ok(true)
}

/// The file at a path. That a store can't be asked doesn't mean that it is not there.
fn file_at(path: &Path) -> Result<Option<Place>, BagError> {
    match location::find(path) {
        Ok(Found::File(place)) => Ok(Some(place)),
        Err(error) if location::is_remote(path) && error.kind() != std::io::ErrorKind::NotFound => {
            Err(BagError::io(path, "open", error))
        }
        Ok(_) | Err(_) => Ok(None),
    }
}

fn is_file(path: &Path) -> Result<bool, BagError> {
    file_at(path).map(|found| found.is_some())
}

fn by_name(a: &Place, b: &Place) -> std::cmp::Ordering {
    natural_order(&a.path().to_string_lossy(), &b.path().to_string_lossy())
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|name| one_line(&name.to_string_lossy())).unwrap_or_default()
}

/// The entries of a folder that tell whether it is a bag.
#[derive(Default)]
struct Contents {
    files: Vec<Place>,
    folders: Vec<PathBuf>,
}

fn contents(folder: &Path) -> Result<Contents, BagError> {
    let unlisted = |error| BagError::io(folder, "list", error);
    let mut contents = Contents::default();
    for Entry { path, found } in location::list(folder).map_err(unlisted)? {
        if path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.')) {
            continue; // hidden: written by someone at this moment, or left by what synchronizes files
        }
        let is_bag = path.file_name().is_some_and(|name| bag_stem(&name.to_string_lossy()).is_some());
        match found {
            Found::Folder => contents.folders.push(path),
            Found::File(place) if is_bag => contents.files.push(place),
            Found::File(_) | Found::Other => {}
        }
    }
    Ok(contents)
}

/// The name of a bag's file without its ending; `None` of any other file.
fn bag_stem(name: &str) -> Option<&str> {
    let name = name.strip_suffix(".zstd").or_else(|| name.strip_suffix(".zst")).unwrap_or(name);
    let (stem, extension) = name.rsplit_once('.')?;
    EXTENSIONS.contains(&extension).then_some(stem)
}

/// The recordings that a path stands for: one file is one, a folder with a `metadata.yaml` is one, and any other folder
/// stands for those in it and in the folders in it. A folder without any stands for itself, so that opening it tells what
/// is wrong.
///
/// # Errors
/// [`BagError`] when a folder can't be listed.
pub fn recordings_at(path: &Path) -> Result<Recordings, BagError> {
    if !location::is_folder(path) || is_file(&path.join(METADATA_FILE))? {
        return Ok(Recordings { paths: vec![path.to_path_buf()], note: None });
    }
    let Recordings { mut paths, note } = in_folder(path)?;
    let mut notes: Vec<String> = note.into_iter().collect();
    let mut folders = contents(path)?.folders;
    folders.sort();
    for folder in folders {
        if is_file(&folder.join(METADATA_FILE))? {
            paths.push(folder);
            continue;
        }
        let found = in_folder(&folder)?;
        paths.extend(found.paths);
        notes.extend(found.note);
    }
    if paths.is_empty() {
        paths.push(path.to_path_buf());
    }
    Ok(Recordings { paths, note: (!notes.is_empty()).then(|| notes.join("; ")) })
}

/// The recordings that the files of a folder without a `metadata.yaml` are: the folder itself where they are one.
fn in_folder(path: &Path) -> Result<Recordings, BagError> {
    let mut files = contents(path)?.files;
    if files.is_empty() {
        return Ok(Recordings { paths: Vec::new(), note: None });
    }
    match folder(path) {
        Ok(Files { note, .. }) => Ok(Recordings { paths: vec![path.to_path_buf()], note }),
        Err(BagError::Several { names, .. }) => {
            files.sort_by(by_name);
            let files = files.iter().map(|place| place.path().to_path_buf()).collect();
            let note = format!("{}: {} recordings, each by itself: {}", path.display(), names.len(), names.join(", "));
            Ok(Recordings { paths: files, note: Some(note) })
        }
        Err(error) => Err(error),
    }
}

fn listed(folder: &Path, listing_path: &Path) -> Result<Vec<Place>, BagError> {
    let listing = layout::read(listing_path)?;
    let refuse = |why: String| Err(BagError::Metadata { path: listing_path.to_path_buf(), why });
    if !matches!(listing.storage_identifier.as_str(), "mcap" | "sqlite3") {
        let got = one_line(&listing.storage_identifier);
        return refuse(format!(
            "storage_identifier is {got:?}, expected \"mcap\" or \"sqlite3\": convert it with `ros2 bag convert`"
        ));
    }
    let (mode, format) = (listing.compression_mode.to_ascii_lowercase(), listing.compression_format.as_str());
    let is_packed = !matches!(mode.as_str(), "" | "none");
    if is_packed && !(matches!(mode.as_str(), "file" | "message" | "storage") && matches!(format, "" | "zstd")) {
        let (mode, format) = (one_line(&mode), one_line(format));
        return refuse(format!(
            "compression_mode is {mode:?} with compression_format {format:?}, expected file or message with zstd: convert it with `ros2 bag convert`"
        ));
    }
    if listing.relative_file_paths.is_empty() {
        return refuse("relative_file_paths is empty: rebuild it with `ros2 bag reindex`".to_owned());
    }
    let mut places = Vec::new();
    for relative in &listing.relative_file_paths {
        let path = folder.join(relative);
        // Bags of early layouts name the folder in the path as well.
        let in_folder = Path::new(relative).file_name().map(|name| folder.join(name));
        // A recorder that was stopped has packed files that it lists by their names of before.
        let packed = folder.join(format!("{relative}.zstd"));
        let names = [Some(path), in_folder, Some(packed)].into_iter().flatten();
        let mut found = names.map(|path| file_at(&path)).filter_map(Result::transpose);
        match found.next().transpose()? {
            Some(place) => places.push(place),
            None => {
                let relative = one_line(relative);
                return refuse(format!("lists {relative}, which is not there: put it back, or `ros2 bag reindex`"));
            }
        }
    }
    Ok(places)
}
