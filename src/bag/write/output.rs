//! Where a bag is written before it is complete, and how it comes to its name.

use std::fs::File;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use tempfile::{TempDir, TempPath};

use super::{BagError, WriteOptions};
use crate::bag::layout::{self, METADATA_FILE};
use crate::files::{temporary_folder_in, temporary_in};
use crate::location;

/// A bag that has no name yet; dropped, it is gone unless it is to be kept.
pub(super) struct Output {
    out: PathBuf,
    /// The folder of `out`.
    parent: PathBuf,
    file_name: String,
    options: Options,
    place: Place,
}

/// The [`WriteOptions`] that count when the bag is complete.
struct Options {
    overwrite: bool,
    owns_folder: bool,
    /// Whether what was written stays, whatever happens.
    is_kept: bool,
}

/// Endings of files that are no bags, which somebody might ask for.
const TABLES: [&str; 7] = ["csv", "parquet", "json", "html", "onnx", "yaml", "db3"];

enum Place {
    File(TempPath),
    Folder(TempDir),
    /// For a URI: in the folder for temporary files, and sent when it is complete.
    RemoteFile(TempPath),
    RemoteFolder(TempDir),
}

impl Output {
    /// Check that `out` may be written, and open the file to write to.
    pub(super) fn create(out: &Path, options: &WriteOptions) -> Result<(Self, File), BagError> {
        let Some(here) = location::local(out) else { return Self::create_remote(out, options) };
        let out = &*here;
        let parent = match out.parent() {
            Some(parent) if parent.as_os_str().is_empty() => PathBuf::from("."),
            Some(parent) => parent.to_path_buf(),
            None => return Err(BagError::NotReplaceable { path: out.to_path_buf() }),
        };
        if !parent.is_dir() {
            return Err(BagError::NoParent { path: out.to_path_buf(), parent });
        }
        let Some(name) = out.file_name().map(|name| name.to_string_lossy().into_owned()) else {
            return Err(BagError::NotReplaceable { path: out.to_path_buf() });
        };
        refuse_inputs(out, &parent, &name, &options.inputs)?;
        if let Some(extension) = out.extension().and_then(|extension| extension.to_str())
            && TABLES.contains(&extension.to_ascii_lowercase().as_str())
        {
            return Err(BagError::NotABagName { path: out.to_path_buf() });
        }
        let as_file = out.extension().is_some_and(|extension| extension == "mcap");
        refuse_existing(out, as_file, options.overwrite)?;
        let io_error = |error| BagError::io(out, "create", error);
        let prefix = format!(".{name}.");
        let kept = Options { overwrite: options.overwrite, owns_folder: options.owns_folder, is_kept: false };
        if as_file {
            let temp = temporary_in(&parent, &prefix).map_err(io_error)?;
            let (file, path) = temp.into_parts();
            let place = Place::File(path);
            return Ok((Output { out: out.to_path_buf(), parent, file_name: name, options: kept, place }, file));
        }
        let folder = temporary_folder_in(&parent, &prefix).map_err(io_error)?;
        let file_name = format!("{name}_0.mcap");
        let file = File::create_new(folder.path().join(&file_name)).map_err(io_error)?;
        let place = Place::Folder(folder);
        Ok((Output { out: out.to_path_buf(), parent, file_name, options: kept, place }, file))
    }

    fn create_remote(out: &Path, options: &WriteOptions) -> Result<(Self, File), BagError> {
        let path = || out.to_path_buf();
        let own = location::canonical(out).map_err(|error| BagError::io(out, "create", error))?;
        let is_input = |input: &PathBuf| {
            location::canonical(input).is_ok_and(|input| input.starts_with(&own) || own.starts_with(&input))
        };
        if options.inputs.iter().any(is_input) {
            return Err(BagError::OutputIsInput { path: path() });
        }
        let as_file = out.extension().is_some_and(|extension| extension == "mcap");
        // The files of a folder can't be replaced all at once.
        location::check_output(out, options.overwrite && as_file).map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists if options.overwrite => BagError::NotReplaceable { path: path() },
            io::ErrorKind::AlreadyExists => BagError::Exists { path: path() },
            _ => BagError::io(out, "create", error),
        })?;
        let failed =
            |source| BagError::Io { path: path(), action: "write to the folder for temporary files (TMPDIR)", source };
        let name = out.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let kept = Options { overwrite: options.overwrite, owns_folder: options.owns_folder, is_kept: false };
        let (place, file, file_name) = if as_file {
            let (file, temp) = temporary_in(&std::env::temp_dir(), "tpf-").map_err(failed)?.into_parts();
            (Place::RemoteFile(temp), file, name)
        } else {
            let folder = temporary_folder_in(&std::env::temp_dir(), "tpf-").map_err(failed)?;
            let file_name = format!("{name}_0.mcap");
            let file = File::create_new(folder.path().join(&file_name)).map_err(failed)?;
            (Place::RemoteFolder(folder), file, file_name)
        };
        Ok((Output { out: path(), parent: PathBuf::new(), file_name, options: kept, place }, file))
    }

    /// Name of the MCAP file itself.
    pub(super) fn file_name(&self) -> &str {
        &self.file_name
    }

    /// From now on what is dropped without a name stays where it is: at the path that is returned.
    pub(super) fn keep_unfinished(&mut self) -> PathBuf {
        self.options.is_kept = true;
        match &mut self.place {
            Place::File(temp) | Place::RemoteFile(temp) => {
                temp.disable_cleanup(true);
                temp.to_path_buf()
            }
            Place::Folder(temp) | Place::RemoteFolder(temp) => {
                temp.disable_cleanup(true);
                temp.path().join(&self.file_name)
            }
        }
    }

    /// Give the complete bag its name. Returns that, and what a person should know.
    pub(super) fn put_in_place(self, metadata: &str) -> Result<(PathBuf, Vec<String>), BagError> {
        let Output { out, parent, file_name, options, place } = self;
        let notes = match place {
            Place::File(temp) => put_file(temp, &out, &parent, &file_name, &options, metadata)?,
            Place::Folder(temp) => put_folder(temp, &out, &parent, options.overwrite, metadata)?,
            Place::RemoteFile(mut temp) => {
                let sent = location::put(&temp, &out, options.overwrite);
                sent.map_err(|error| put_error(&out, options.is_kept.then_some(&*temp), error))?;
                temp.disable_cleanup(false);
                return Ok((out, Vec::new()));
            }
            Place::RemoteFolder(mut temp) => {
                let written = std::fs::write(temp.path().join(METADATA_FILE), metadata);
                let sent = written.and_then(|()| location::put_folder(temp.path(), &out, &[METADATA_FILE]));
                sent.map_err(|error| put_error(&out, options.is_kept.then_some(temp.path()), error))?;
                temp.disable_cleanup(false);
                return Ok((out, Vec::new()));
            }
        };
        // The name is on the disk only when its folder is; not every file system lets a folder be synced.
        let _ = File::open(&parent).and_then(|folder| folder.sync_all());
        Ok((out, notes))
    }
}

fn put_file(
    temp: TempPath,
    out: &Path,
    parent: &Path,
    file_name: &str,
    options: &Options,
    metadata: &str,
) -> Result<Vec<String>, BagError> {
    let metadata_path = parent.join(METADATA_FILE);
    let mut notes = Vec::new();
    let is_there = std::fs::symlink_metadata(&metadata_path).is_ok();
    let is_of_this = is_there && layout::read(&metadata_path).is_ok_and(|listing| listing.lists_only(file_name));
    if is_there && !is_of_this {
        notes.push(format!(
            "{} describes another bag and is left as it is; open {} by its own name",
            metadata_path.display(),
            out.display()
        ));
    }
    // Everything that may fail for want of space comes before the first rename.
    let new_metadata = if is_of_this || (options.owns_folder && !is_there) {
        let written = temporary_in(parent, ".metadata.").and_then(|mut file| {
            file.write_all(metadata.as_bytes())?;
            file.as_file().sync_all()?;
            Ok(file)
        });
        Some(written.map_err(|error| BagError::io(&metadata_path, "write", error))?)
    } else {
        None
    };
    let renamed = if options.overwrite { temp.persist(out) } else { temp.persist_noclobber(out) };
    renamed.map_err(|error| rename_error(out, error.error))?;
    if let Some(file) = new_metadata {
        file.persist(&metadata_path).map_err(|error| BagError::io(&metadata_path, "write", error.error))?;
    }
    Ok(notes)
}

fn put_folder(
    temp: TempDir,
    out: &Path,
    parent: &Path,
    overwrite: bool,
    metadata: &str,
) -> Result<Vec<String>, BagError> {
    let io_error = |error| BagError::io(out, "write", error);
    let written = File::create_new(temp.path().join(METADATA_FILE)).and_then(|mut file| {
        file.write_all(metadata.as_bytes())?;
        file.sync_all()
    });
    written.map_err(io_error)?;
    let _ = File::open(temp.path()).and_then(|folder| folder.sync_all());
    if std::fs::symlink_metadata(out).is_ok() {
        // What is there now may not be what was there at the start.
        refuse_existing(out, false, overwrite)?;
        let aside = temporary_folder_in(parent, ".replaced.").map_err(io_error)?;
        let old = aside.path().join("old");
        std::fs::rename(out, &old).map_err(io_error)?;
        if let Err(error) = std::fs::rename(temp.path(), out) {
            let _ = std::fs::rename(&old, out);
            return Err(io_error(error));
        }
    } else {
        std::fs::rename(temp.path(), out).map_err(|error| rename_error(out, error))?;
    }
    // It has another name now, and nothing is to be removed.
    let _ = temp.keep();
    Ok(Vec::new())
}

/// Why a complete bag could not be sent, and where it is if it was to be kept.
fn put_error(out: &Path, kept: Option<&Path>, error: io::Error) -> BagError {
    if let Some(kept) = kept {
        let source = io::Error::other(format!("{error}; the complete bag is {}", kept.display()));
        return BagError::io(out, "write", source);
    }
    match error.kind() {
        io::ErrorKind::AlreadyExists => BagError::Exists { path: out.to_path_buf() },
        _ => BagError::io(out, "write", error),
    }
}

fn rename_error(out: &Path, error: io::Error) -> BagError {
    match error.kind() {
        io::ErrorKind::AlreadyExists | io::ErrorKind::DirectoryNotEmpty => BagError::Exists { path: out.to_path_buf() },
        _ => BagError::io(out, "create", error),
    }
}

/// Refuse an output that is an input, lies within the folder of one, or would replace the folder of one.
fn refuse_inputs(out: &Path, parent: &Path, name: &str, inputs: &[PathBuf]) -> Result<(), BagError> {
    // The output may not be there yet, its folder is.
    let by_parent = parent.canonicalize().map_err(|error| BagError::io(parent, "open", error))?.join(name);
    let by_itself = out.canonicalize().ok();
    for input in inputs {
        let Ok(input) = input.canonicalize() else { continue };
        if input.starts_with(&by_parent)
            || by_parent.starts_with(&input)
            || by_itself.as_ref().is_some_and(|out| input.starts_with(out))
        {
            return Err(BagError::OutputIsInput { path: out.to_path_buf() });
        }
    }
    Ok(())
}

/// Refuse what is there, unless it may be overwritten and is a bag of the same kind.
fn refuse_existing(out: &Path, as_file: bool, overwrite: bool) -> Result<(), BagError> {
    let path = out.to_path_buf();
    let Ok(metadata) = std::fs::symlink_metadata(out) else { return Ok(()) };
    if !overwrite {
        return Err(BagError::Exists { path });
    }
    let replaceable = if as_file { !metadata.is_dir() } else { metadata.is_dir() && holds_only_a_bag(out) };
    if replaceable { Ok(()) } else { Err(BagError::NotReplaceable { path }) }
}

/// A folder goes as a whole when it is replaced, so nothing but a bag may be in it.
fn holds_only_a_bag(folder: &Path) -> bool {
    let Ok(entries) = std::fs::read_dir(folder) else { return false };
    let mut names = entries.map(|entry| entry.map(|entry| entry.file_name().to_string_lossy().into_owned()));
    names.all(|name| name.is_ok_and(|name| name == METADATA_FILE || name.ends_with(".mcap")))
}
