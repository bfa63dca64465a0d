//! Where bags are and outputs go: a path on this machine, or a URI of an object store or a web server.
//!
//! Paths and URIs are both [`Path`]s everywhere else; here it is decided which one it is. `file://` is a path of this machine.
//! `s3://`, `gs://`, `az://`, `http://` and `https://` need the feature `cloud`, and are refused in one line without it.

#[cfg(not(feature = "cloud"))]
mod absent;
#[cfg(feature = "cloud")]
mod credentials;
#[cfg(feature = "cloud")]
mod object;
mod place;
#[cfg(feature = "cloud")]
mod remote;
#[cfg(feature = "cloud")]
mod store;
#[cfg(feature = "cloud")]
mod trouble;
#[cfg(feature = "cloud")]
mod upload;
mod uri;
#[cfg(feature = "cloud")]
mod wire;

use std::borrow::Cow;
use std::ffi::OsString;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use tempfile::TempPath;

#[cfg(not(feature = "cloud"))]
use absent as object;
#[cfg(not(feature = "cloud"))]
use absent as remote;
#[cfg(not(feature = "cloud"))]
use absent as upload;
pub use place::{Place, Reader};
use uri::Where;

/// The kind of thing at a location.
#[derive(Debug, Clone)]
pub enum Found {
    /// A file.
    File(Place),
    /// A folder: in an object store, the start of the names of some objects.
    Folder,
    /// Something else, as a socket.
    Other,
}

/// An entry of a folder.
#[derive(Debug, Clone)]
pub struct Entry {
    /// The folder's location with the name behind it.
    pub path: PathBuf,
    /// The kind of the entry.
    pub found: Found,
}

/// Whether a path is a URI of something that is not on this machine.
pub fn is_remote(path: &Path) -> bool {
    matches!(uri::of(path), Where::Remote(_))
}

/// The path on this machine that `path` or a `file://` URI stands for; `None` of what is elsewhere.
pub fn local(path: &Path) -> Option<Cow<'_, Path>> {
    match uri::of(path) {
        Where::Here(path) => Some(path),
        Where::Remote(_) => None,
    }
}

/// A word of a command line with a URI in it, alone or behind `--option=` or `-o`: a `file://` URI becomes the path that it stands
/// for, and a password or a signature, for which a URI is refused later, is taken out, so that no message can hold it.
pub fn in_word(word: OsString) -> OsString {
    let Some(text) = word.to_str() else { return word };
    let value_at = match text.find('=') {
        Some(at) if text.starts_with("--") => at + 1,
        _ if text.starts_with('-') && text.get(2..).is_some_and(|rest| rest.starts_with("file:")) => 2,
        _ => 0,
    };
    let (option, value) = text.split_at(value_at);
    if let Where::Here(Cow::Owned(path)) = uri::of(Path::new(value)) {
        let mut word = OsString::from(option);
        word.push(path);
        return word;
    }
    uri::without_secrets(text).map(OsString::from).unwrap_or(word)
}

/// Finds the kind of thing at `path`.
///
/// # Errors
/// `NotFound`, or why it can't be told.
pub fn find(path: &Path) -> io::Result<Found> {
    match uri::of(path) {
        Where::Remote(uri) => remote::find(path, uri?),
        Where::Here(here) => {
            let metadata = std::fs::metadata(&here)?;
            Ok(match () {
                () if metadata.is_dir() => Found::Folder,
                () if metadata.is_file() => Found::File(Place::new(here.into_owned(), None)),
                () => Found::Other,
            })
        }
    }
}

/// Whether something is at `path`.
///
/// # Errors
/// Why it can't be told, as when a store can't be reached.
pub fn exists(path: &Path) -> io::Result<bool> {
    match local(path) {
        Some(here) => Ok(std::fs::symlink_metadata(here).is_ok()),
        None => match find(path) {
            Ok(_) => Ok(true),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(error) => Err(error),
        },
    }
}

/// Whether a file is at `path`; `false` where that can't be told, as opening it tells why.
pub fn is_file(path: &Path) -> bool {
    matches!(find(path), Ok(Found::File(_)))
}

/// Whether a folder is at `path`; `false` where that can't be told.
pub fn is_folder(path: &Path) -> bool {
    matches!(find(path), Ok(Found::Folder))
}

/// Entries of a folder, in no order.
///
/// # Errors
/// Why it can't be listed.
pub fn list(folder: &Path) -> io::Result<Vec<Entry>> {
    let here = match uri::of(folder) {
        Where::Remote(uri) => return remote::list(folder, uri?),
        Where::Here(here) => here,
    };
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(here)? {
        let path = entry?.path();
        // What went away since is not there.
        if let Ok(found) = find(&path) {
            entries.push(Entry { path, found });
        }
    }
    Ok(entries)
}

/// Opens a file for reading.
///
/// # Errors
/// `NotFound`, or why it can't be read.
pub fn open(path: &Path) -> io::Result<Reader> {
    Place::at(path)?.open()
}

/// All bytes of a file.
///
/// # Errors
/// As [`open()`].
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The text of a file.
///
/// # Errors
/// As [`open()`], and `InvalidData` where it is no UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    open(path)?.read_to_string(&mut text)?;
    Ok(text)
}

/// Refuses a URI of an output that is made on this machine only.
///
/// # Errors
/// One line that says so.
pub fn only_here(path: &Path) -> io::Result<()> {
    refuse_remote(path, "this is made on this machine only: give a path, and copy what is made")
}

/// Refuses a URI of something that is read on this machine only.
///
/// # Errors
/// One line that says so.
pub fn only_read_here(path: &Path) -> io::Result<()> {
    refuse_remote(path, "this is read on this machine only: copy it, and give a path")
}

/// Refuses a folder that is read on this machine and is not there.
///
/// # Errors
/// One line that says so.
pub fn only_folder_here(path: &Path) -> io::Result<()> {
    only_read_here(path)?;
    match local(path) {
        Some(here) if !here.exists() => Err(io::Error::new(io::ErrorKind::NotFound, "there is no such folder")),
        Some(here) if !here.is_dir() => Err(io::Error::new(io::ErrorKind::NotADirectory, "is no folder")),
        _ => Ok(()),
    }
}

fn refuse_remote(path: &Path, why: &str) -> io::Result<()> {
    match uri::of(path) {
        Where::Here(_) => Ok(()),
        Where::Remote(uri) => uri.and_then(|_| Err(refusal(io::ErrorKind::Unsupported, why))),
    }
}

/// A file of this machine: the one at a path, or a temporary copy of what a URI names.
#[derive(Debug)]
pub struct LocalFile {
    path: PathBuf,
    _copy: Option<TempPath>,
}

impl LocalFile {
    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// The file at `path`, copied to the folder for temporary files where it isn't on this machine.
///
/// # Errors
/// As [`open()`], and where it can't be copied.
pub fn local_file(path: &Path) -> io::Result<LocalFile> {
    if let Some(here) = local(path) {
        return Ok(LocalFile { path: here.into_owned(), _copy: None });
    }
    let mut file = open(path)?;
    let mut copy = tempfile::NamedTempFile::new()?;
    io::copy(&mut file, copy.as_file_mut())?;
    let copy = copy.into_temp_path();
    Ok(LocalFile { path: copy.to_path_buf(), _copy: Some(copy) })
}

/// One name for one location, however it was given.
///
/// # Errors
/// `NotFound` on this machine; what is elsewhere isn't asked.
pub fn canonical(path: &Path) -> io::Result<PathBuf> {
    match uri::of(path) {
        Where::Here(here) => here.canonicalize(),
        Where::Remote(uri) => Ok(PathBuf::from(uri?.to_string())),
    }
}

/// Refuses an output that can't be written, before work goes into it: something is there that is not to be replaced, its URI is
/// none of a store, or the store refuses.
///
/// # Errors
/// `AlreadyExists`, or one line on what the store said.
pub fn check_output(path: &Path, overwrite: bool) -> io::Result<()> {
    match uri::of(path) {
        Where::Here(here) if !overwrite && std::fs::symlink_metadata(&here).is_ok() => Err(already()),
        Where::Here(_) => Ok(()),
        Where::Remote(uri) => upload::check(&uri?, overwrite),
    }
}

/// The reason why something elsewhere can't be used: one line, without the URI.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Refusal(String);

fn refusal(kind: io::ErrorKind, why: impl Into<String>) -> io::Error {
    io::Error::new(kind, Refusal(why.into()))
}

/// Whether an error is of a store, and says nothing about the bytes of a file.
pub fn is_refusal(error: &io::Error) -> bool {
    error.get_ref().is_some_and(|why| why.is::<Refusal>())
}

/// That something is there, which is not to be replaced.
pub(crate) fn already() -> io::Error {
    refusal(io::ErrorKind::AlreadyExists, "is there already")
}

/// Puts a complete file of this machine at a URI. It appears there as a whole or not at all.
///
/// # Errors
/// `AlreadyExists` where something is there that is not to be replaced, or one line on what the store said.
pub fn put(file: &Path, to: &Path, overwrite: bool) -> io::Result<()> {
    match uri::of(to) {
        Where::Here(_) => Err(io::Error::other("is a path of this machine")),
        Where::Remote(uri) => upload::file(file, &uri?, overwrite),
    }
}

/// Puts the files of a folder of this machine at a URI under which nothing is, those that are named `last` behind the others:
/// without them it is no whole folder of its kind. Where one fails, those before it are removed again.
///
/// # Errors
/// As [`put`].
pub fn put_folder(folder: &Path, to: &Path, last: &[&str]) -> io::Result<()> {
    match uri::of(to) {
        Where::Here(_) => Err(io::Error::other("is a path of this machine")),
        Where::Remote(uri) => upload::folder(folder, &uri?, last),
    }
}
