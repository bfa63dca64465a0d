//! Files and folders that appear whole under their name or not at all, on this machine or in a store.
//!
//! An output to a URI is written to the folder for temporary files first, and sent when it is complete.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use tempfile::{NamedTempFile, TempDir};

use crate::location;

/// A file that has no name yet; dropped, it is gone.
#[derive(Debug)]
pub struct NewFile {
    out: PathBuf,
    temp: NamedTempFile,
    /// Whether it may replace what has its name.
    overwrite: bool,
}

impl NewFile {
    /// A hidden file beside `out`, or a temporary one where `out` is a URI, whose store is asked whether it takes the file. Without
    /// `overwrite`, it replaces nothing, not even what comes while it is written.
    ///
    /// # Errors
    /// `AlreadyExists`, the system's error if it can't be made, or one line on what the store said.
    pub fn create(out: &Path, overwrite: bool) -> io::Result<Self> {
        location::check_output(out, overwrite)?;
        Self::begin(out, overwrite)
    }

    fn begin(out: &Path, overwrite: bool) -> io::Result<Self> {
        let temp = match location::local(out) {
            Some(here) => temporary_in(parent_of(&here), ".tpf-")?,
            None => temporary_in(&std::env::temp_dir(), "tpf-")?,
        };
        Ok(NewFile { out: out.to_path_buf(), temp, overwrite })
    }

    /// Where its bytes are until it has its name.
    pub fn path(&self) -> &Path {
        self.temp.path()
    }

    /// The file that is written to.
    pub fn as_file(&self) -> &File {
        self.temp.as_file()
    }

    /// Gives it its name, in place of what is there if it may.
    ///
    /// # Errors
    /// `AlreadyExists`, the system's error, or the store's; what was there is then as it was.
    pub fn put_in_place(self) -> io::Result<()> {
        self.temp.as_file().sync_all()?;
        match location::local(&self.out) {
            Some(here) if self.overwrite => self.temp.persist(here).map(|_| ()).map_err(|failed| failed.error),
            Some(here) => self.temp.persist_noclobber(here).map(|_| ()).map_err(|failed| match failed.error.kind() {
                io::ErrorKind::AlreadyExists => location::already(),
                _ => failed.error,
            }),
            None => location::put(self.temp.path(), &self.out, self.overwrite),
        }
    }
}

impl Write for NewFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.temp.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.temp.flush()
    }
}

/// Writes a file in place of what is there, if anything is.
///
/// # Errors
/// The system's error; the existing file is then unchanged.
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write(path, bytes, true)
}

/// Writes a file. Without `overwrite` it replaces nothing.
///
/// # Errors
/// `AlreadyExists`, the system's error, or the store's.
pub fn write(path: &Path, bytes: &[u8], overwrite: bool) -> io::Result<()> {
    let mut file = NewFile::begin(path, overwrite)?;
    file.write_all(bytes)?;
    file.put_in_place()
}

/// Makes a folder for outputs, if it is not there. In a store there is nothing to make.
///
/// # Errors
/// The system's error.
pub fn make_folder(folder: &Path) -> io::Result<()> {
    location::local(folder).map_or(Ok(()), std::fs::create_dir_all)
}

/// A temporary file, with the permissions that any new file gets.
///
/// # Errors
/// The system's error if it can't be made.
pub fn temporary_in(folder: &Path, prefix: &str) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix).suffix(".tmp");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => {
            io::Error::new(error.kind(), format!("there is no folder {}; make it first", folder.display()))
        }
        _ => error,
    })
}

/// A temporary folder, with the permissions that any new folder gets.
///
/// # Errors
/// The system's error if it can't be made.
pub fn temporary_folder_in(parent: &Path, prefix: &str) -> io::Result<TempDir> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix).suffix(".tmp");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
    builder.tempdir_in(parent)
}

/// A folder that has no name yet; dropped, it is gone with all that is in it.
#[derive(Debug)]
pub struct NewFolder {
    out: PathBuf,
    temp: TempDir,
    last: &'static [&'static str],
}

impl NewFolder {
    /// A hidden folder beside `out`, which is not there. To a store, the files that are named `last` are sent behind the
    /// others: without them it is no whole folder of its kind.
    ///
    /// # Errors
    /// `AlreadyExists` if it is, or the system's error.
    pub fn create(out: &Path, last: &'static [&'static str]) -> io::Result<Self> {
        location::check_output(out, false)?;
        let Some(here) = location::local(out) else {
            let temp = temporary_folder_in(&std::env::temp_dir(), "tpf-")?;
            return Ok(NewFolder { out: out.to_path_buf(), temp, last });
        };
        let name = here.file_name().ok_or_else(|| io::Error::other("is no name for a folder"))?;
        let temp = temporary_folder_in(parent_of(&here), &format!(".{}.", name.to_string_lossy()))?;
        Ok(NewFolder { out: here.to_path_buf(), temp, last })
    }

    /// Where to write to.
    pub fn path(&self) -> &Path {
        self.temp.path()
    }

    /// Gives the folder its name.
    ///
    /// # Errors
    /// `AlreadyExists` when something has that name by now, or the system's error.
    pub fn put_in_place(self) -> io::Result<()> {
        let NewFolder { out, temp, last } = self;
        location::check_output(&out, false)?;
        if location::is_remote(&out) {
            return location::put_folder(temp.path(), &out, last);
        }
        std::fs::rename(temp.path(), &out)?;
        let _ = temp.keep(); // it has another name now, and nothing is to be removed
        // The name is on the disk only when its folder is; not every file system lets a folder be synced.
        let _ = File::open(parent_of(&out)).and_then(|parent| parent.sync_all());
        Ok(())
    }
}

fn parent_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_its_name_when_it_is_whole_and_takes_that_of_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("dataset");
        let new = NewFolder::create(&out, &[]).unwrap();
        std::fs::write(new.path().join("file"), b"").unwrap();
        assert!(!out.exists());
        new.put_in_place().unwrap();
        assert!(out.join("file").exists());
        assert_eq!(NewFolder::create(&out, &[]).unwrap_err().kind(), io::ErrorKind::AlreadyExists);

        let other = folder.path().join("other");
        let late = NewFolder::create(&other, &[]).unwrap();
        std::fs::create_dir(&other).unwrap();
        assert_eq!(late.put_in_place().unwrap_err().kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing hidden is left");
    }

    #[test]
    fn a_file_is_replaced_whole_and_nothing_else_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.onnx");
        for bytes in [&b"first"[..], b"second"] {
            replace(&path, bytes).unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), bytes);
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        assert!(replace(&folder.path().join("no/such/folder"), b"").is_err());
        assert_eq!(write(&path, b"third", false).unwrap_err().kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(std::fs::read(&path).unwrap(), b"second");
        let late = NewFile::create(&folder.path().join("late"), false).unwrap();
        std::fs::write(folder.path().join("late"), b"somebody's").unwrap();
        assert_eq!(late.put_in_place().unwrap_err().kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(std::fs::read(folder.path().join("late")).unwrap(), b"somebody's");
        std::fs::remove_file(folder.path().join("late")).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn others_may_read_what_was_written() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.onnx");
        replace(&path, b"").unwrap();
        std::fs::write(folder.path().join("plain"), b"").unwrap();
        let mode = |name: &Path| std::fs::metadata(name).unwrap().permissions().mode();
        assert_eq!(mode(&path), mode(&folder.path().join("plain")));
    }
}
