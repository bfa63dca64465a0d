//! Files and folders that appear whole under their name or not at all.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use tempfile::{NamedTempFile, TempDir};

/// A hidden file beside `path` that holds `bytes` and is on the disk: whoever asked for it gives it its name.
///
/// # Errors
/// The system's error if it can't be made or written.
pub fn written_beside(path: &Path, bytes: &[u8]) -> io::Result<NamedTempFile> {
    let mut file = temporary_in(parent_of(path), ".tpf-")?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    Ok(file)
}

/// Writes a file in place of what is there, if anything is.
///
/// # Errors
/// The system's error; the existing file is then unchanged.
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    written_beside(path, bytes)?.persist(path).map(|_| ()).map_err(|failed| failed.error)
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
    builder.tempfile_in(folder)
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
}

impl NewFolder {
    /// A hidden folder beside `out`, which is not there.
    ///
    /// # Errors
    /// `AlreadyExists` if it is, or the system's error.
    pub fn create(out: &Path) -> io::Result<Self> {
        refuse_existing(out)?;
        let name = out.file_name().ok_or_else(|| io::Error::other("is no name for a folder"))?;
        let temp = temporary_folder_in(parent_of(out), &format!(".{}.", name.to_string_lossy()))?;
        Ok(NewFolder { out: out.to_path_buf(), temp })
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
        let NewFolder { out, temp } = self;
        refuse_existing(&out)?;
        std::fs::rename(temp.path(), &out)?;
        let _ = temp.keep(); // it has another name now, and nothing is to be removed
        // The name is on the disk only when its folder is; not every file system lets a folder be synced.
        let _ = File::open(parent_of(&out)).and_then(|parent| parent.sync_all());
        Ok(())
    }
}

fn refuse_existing(out: &Path) -> io::Result<()> {
    match std::fs::symlink_metadata(out) {
        Ok(_) => Err(io::Error::new(io::ErrorKind::AlreadyExists, "is there already")),
        Err(_) => Ok(()),
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
        let new = NewFolder::create(&out).unwrap();
        std::fs::write(new.path().join("file"), b"").unwrap();
        assert!(!out.exists());
        new.put_in_place().unwrap();
        assert!(out.join("file").exists());
        assert_eq!(NewFolder::create(&out).unwrap_err().kind(), io::ErrorKind::AlreadyExists);

        let other = folder.path().join("other");
        let late = NewFolder::create(&other).unwrap();
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
