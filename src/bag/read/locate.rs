//! From the path that a person gives to the files of the bag behind it.

use std::cmp::Ordering;
use std::io::Read;
use std::path::{Path, PathBuf};

use mcap::MAGIC;

use super::BagError;
use super::channels::ChannelTable;
use super::sqlite::SQLITE_MAGIC;
use super::storage::{first_log_time, summary};
use super::unpacked::Unpacked;
use crate::bag::error::one_line;
use crate::bag::layout::{self, METADATA_FILE};
use crate::units::{NANOS_PER_SEC, Stamp};

const ROS1_MAGIC: &[u8] = b"#ROSBAG V";

/// How files of bags end; a `.zstd` or `.zst` may follow.
const EXTENSIONS: [&str; 2] = ["mcap", "db3"];

/// Longest pause from one part of a split recording to the next: the recorder goes on in the next file with the message
/// that comes after the last one of this.
const MAX_PAUSE_NS: i64 = NANOS_PER_SEC;

/// The files of one input, in the order in which they are read.
#[derive(Debug)]
pub(super) struct Files {
    pub(super) paths: Vec<PathBuf>,
    /// The recorder left no list of files: it was stopped in mid-write, so a file may be empty.
    pub(super) unlisted: bool,
    /// What a person should know about how they were found.
    pub(super) note: Option<String>,
}

/// The recordings that a path stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recordings {
    /// Each is a `.mcap` file, or the folder of one recording; in the order of their names.
    pub paths: Vec<PathBuf>,
    /// What a person should know about how they were found.
    pub note: Option<String>,
}

/// The files behind `input`: itself, or those of a bag folder.
pub(super) fn files(input: &Path) -> Result<Files, BagError> {
    let metadata = std::fs::metadata(input).map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => BagError::NotFound { path: input.to_path_buf() },
        _ => BagError::io(input, "open", error),
    })?;
    if metadata.is_dir() {
        return folder(input);
    }
    if !metadata.is_file() {
        return Err(not_a_bag(input, "it is no regular file, which a bag must be".to_owned()));
    }
    Ok(Files { paths: vec![input.to_path_buf()], unlisted: false, note: None })
}

fn folder(folder: &Path) -> Result<Files, BagError> {
    let listing_path = folder.join(METADATA_FILE);
    if listing_path.is_file() {
        return Ok(Files { paths: listed(folder, &listing_path)?, unlisted: false, note: None });
    }
    let Contents { mut files, .. } = contents(folder)?;
    if files.is_empty() {
        return Err(not_a_bag(folder, "the folder holds no .mcap or .db3 file and no metadata.yaml".to_owned()));
    }
    files.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    if files.len() == 1 {
        return Ok(Files { paths: files, unlisted: true, note: None });
    }
    if !are_parts_of_one(&files)? {
        let names = files.iter().map(|path| name_of(path)).collect();
        return Err(BagError::Several { path: folder.to_path_buf(), names });
    }
    let note = format!(
        "{}: no metadata.yaml; {} to {} follow one another in number and time and are read as one split recording",
        folder.display(),
        name_of(&files[0]),
        name_of(&files[files.len() - 1])
    );
    Ok(Files { paths: files, unlisted: true, note: Some(note) })
}

/// Whether files are the parts of one recording whose recorder didn't come to list them: named `NAME_0.mcap`,
/// `NAME_1.mcap` and so on, each going on where the one before it ends.
fn are_parts_of_one(files: &[PathBuf]) -> Result<bool, BagError> {
    let mut before: Option<(String, u64)> = None;
    for path in files {
        let file_name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
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
    for (idx, path) in files.iter().enumerate() {
        let is_last = idx + 1 == files.len();
        let span = match summary(path, 0, &mut ChannelTable::default())?.and_then(|found| found.statistics) {
            Some(statistics) => statistics.span,
            None if is_last => first_log_time(path).unwrap_or_default().map(|first| (first, first)),
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

fn name_of(path: &Path) -> String {
    path.file_name().map(|name| one_line(&name.to_string_lossy())).unwrap_or_default()
}

/// What of a folder's entries tells whether it is a bag.
#[derive(Default)]
struct Contents {
    files: Vec<PathBuf>,
    folders: Vec<PathBuf>,
}

fn contents(folder: &Path) -> Result<Contents, BagError> {
    let unlisted = |error| BagError::io(folder, "list", error);
    let mut contents = Contents::default();
    for entry in std::fs::read_dir(folder).map_err(unlisted)? {
        let path = entry.map_err(unlisted)?.path();
        if path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.')) {
            continue; // hidden: written by someone at this moment, or left by what synchronizes files
        }
        let is_bag = path.file_name().is_some_and(|name| bag_stem(&name.to_string_lossy()).is_some());
        if path.is_dir() {
            contents.folders.push(path);
        } else if is_bag && path.is_file() {
            contents.files.push(path);
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
    if !path.is_dir() || path.join(METADATA_FILE).is_file() {
        return Ok(Recordings { paths: vec![path.to_path_buf()], note: None });
    }
    let Recordings { mut paths, note } = in_folder(path)?;
    let mut notes: Vec<String> = note.into_iter().collect();
    let mut folders = contents(path)?.folders;
    folders.sort();
    for folder in folders {
        if folder.join(METADATA_FILE).is_file() {
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
        return Ok(Recordings { paths: files, note: None });
    }
    match folder(path) {
        Ok(Files { note, .. }) => Ok(Recordings { paths: vec![path.to_path_buf()], note }),
        Err(BagError::Several { names, .. }) => {
            files.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
            let note = format!("{}: {} recordings, each by itself: {}", path.display(), names.len(), names.join(", "));
            Ok(Recordings { paths: files, note: Some(note) })
        }
        Err(error) => Err(error),
    }
}

fn listed(folder: &Path, listing_path: &Path) -> Result<Vec<PathBuf>, BagError> {
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
    let mut paths = Vec::new();
    for relative in &listing.relative_file_paths {
        let path = folder.join(relative);
        // Bags of early layouts name the folder in the path as well.
        let in_folder = Path::new(relative).file_name().map(|name| folder.join(name));
        // A recorder that was stopped has packed files that it lists by their names of before.
        let packed = folder.join(format!("{relative}.zstd"));
        match [Some(path), in_folder, Some(packed)].into_iter().flatten().find(|path| path.is_file()) {
            Some(path) => paths.push(path),
            None => {
                let relative = one_line(relative);
                return refuse(format!("lists {relative}, which is not there: put it back, or `ros2 bag reindex`"));
            }
        }
    }
    Ok(paths)
}

/// The error for a file that doesn't begin as MCAP does: it says what the file looks like.
pub(super) fn not_mcap(path: &Path) -> BagError {
    let mut start = Vec::new();
    let read = Unpacked::open(path).map(|unpacked| unpacked.file.take(64).read_to_end(&mut start));
    match read {
        Err(error) => return error,
        Ok(Err(error)) => return BagError::io(path, "read", error),
        Ok(Ok(_)) => {}
    }
    let is_listing = path.file_name().is_some_and(|name| name == METADATA_FILE);
    let why = if start.is_empty() {
        "it is empty".to_owned()
    } else if is_listing {
        "it describes a bag: give the folder that it lies in".to_owned()
    } else if start.starts_with(ROS1_MAGIC) {
        ros1_advice(path)
    } else if SQLITE_MAGIC.starts_with(&start) {
        format!("it is a sqlite3 (.db3) bag, cut off after {} bytes", start.len())
    } else if MAGIC.starts_with(&start) {
        format!("it is cut off after {} bytes", start.len())
    } else if start.iter().all(|&byte| byte == 0) {
        "it begins with zeros, as files do after a power failure".to_owned()
    } else if is_text(&start) {
        "it looks like text, expected a .mcap or .db3 file".to_owned()
    } else {
        let shown: Vec<String> = start.iter().take(MAGIC.len()).map(|byte| format!("{byte:02x}")).collect();
        format!("it begins with the bytes {}, expected those of MCAP or sqlite3", shown.join(" "))
    };
    not_a_bag(path, why)
}

/// The commands that make an MCAP bag of one of ROS 1, for a shell.
fn ros1_advice(path: &Path) -> String {
    let quoted = |path: &Path| format!("'{}'", one_line(&path.to_string_lossy()).replace('\'', "'\\''"));
    format!(
        "it is a ROS 1 bag: `pip install rosbags`, then `rosbags-convert --src {} --dst {} --dst-storage mcap` makes an MCAP bag of it",
        quoted(path),
        quoted(&path.with_extension(""))
    )
}

/// Whether these first bytes of a file are text; the last character may be cut in two.
fn is_text(start: &[u8]) -> bool {
    let valid = match std::str::from_utf8(start) {
        Ok(text) => text,
        Err(error) if error.error_len().is_none() => {
            std::str::from_utf8(&start[..error.valid_up_to()]).unwrap_or_default()
        }
        Err(_) => return false,
    };
    !valid.is_empty() && valid.chars().all(|c| !c.is_control() || c.is_whitespace())
}

fn not_a_bag(path: &Path, why: String) -> BagError {
    BagError::NotABag { path: path.to_path_buf(), why }
}

/// Order of names in which `bag_2` comes before `bag_10`.
pub(super) fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a, b);
    while !left.is_empty() && !right.is_empty() {
        let (left_run, left_rest) = split_run(left);
        let (right_run, right_rest) = split_run(right);
        let by_run = match (left_run.as_bytes()[0].is_ascii_digit(), right_run.as_bytes()[0].is_ascii_digit()) {
            (true, true) => {
                let (left_digits, right_digits) = (left_run.trim_start_matches('0'), right_run.trim_start_matches('0'));
                left_digits.len().cmp(&right_digits.len()).then_with(|| left_digits.cmp(right_digits))
            }
            _ => left_run.cmp(right_run),
        };
        if by_run != Ordering::Equal {
            return by_run;
        }
        (left, right) = (left_rest, right_rest);
    }
    left.len().cmp(&right.len()).then_with(|| a.cmp(b))
}

/// The leading digits of a text that is not empty, or all that stands in front of its first digit; and the rest.
fn split_run(text: &str) -> (&str, &str) {
    let starts_with_digit = text.starts_with(|c: char| c.is_ascii_digit());
    let end = text.find(|c: char| c.is_ascii_digit() != starts_with_digit).unwrap_or(text.len());
    text.split_at(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_split_bag_sort_by_their_numbers() {
        let mut names = ["b_10.mcap", "b_2.mcap", "b.mcap", "b_1.mcap", "a_3.mcap", "b_02.mcap"];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, ["a_3.mcap", "b.mcap", "b_1.mcap", "b_02.mcap", "b_2.mcap", "b_10.mcap"]);
    }
}
