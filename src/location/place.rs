//! Files that are read, wherever they are.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use tempfile::TempPath;

use super::object::{Object, RemoteFile};
use super::uri::{self, Where};
use super::{Found, find};

/// A file that can be opened again and again, and is the same file each time: one that was replaced meanwhile in an object
/// store is refused.
#[derive(Debug, Clone)]
pub struct Place {
    path: PathBuf,
    object: Option<Arc<Object>>,
    /// A copy on this machine of what lies elsewhere or is packed; removed with the last who knows this place.
    copy: Arc<Mutex<Option<Arc<TempPath>>>>,
}

/// A file that is being read, from anywhere.
#[derive(Debug)]
pub enum Reader {
    /// On this machine.
    Local(File),
    /// In an object store or on a web server: read in ranges.
    Remote(Box<RemoteFile>),
}

impl Place {
    /// A file that was found.
    pub(super) fn new(path: PathBuf, object: Option<Arc<Object>>) -> Self {
        Place { path, object, copy: Arc::default() }
    }

    /// A file whose path is known to be one.
    ///
    /// # Errors
    /// As [`find`].
    pub fn at(path: &Path) -> io::Result<Self> {
        match uri::of(path) {
            Where::Here(here) => Ok(Place::new(here.into_owned(), None)),
            Where::Remote(_) => match find(path)? {
                Found::File(place) => Ok(place),
                Found::Folder | Found::Other => Err(io::Error::new(io::ErrorKind::IsADirectory, "is a folder")),
            },
        }
    }

    /// The path or URI.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it is not on this machine.
    pub fn is_remote(&self) -> bool {
        self.object.is_some()
    }

    /// Opens it.
    ///
    /// # Errors
    /// Why it can't be read.
    pub fn open(&self) -> io::Result<Reader> {
        match &self.object {
            None => File::open(&self.path).map(Reader::Local),
            Some(object) => Ok(Reader::Remote(RemoteFile::of(Arc::clone(object)))),
        }
    }

    /// The copy on this machine that was [kept](Self::keep).
    pub fn copy(&self) -> Option<Arc<TempPath>> {
        self.copy.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Keeps a copy on this machine for who opens this place next.
    pub fn keep(&self, copy: TempPath) -> Arc<TempPath> {
        let copy = Arc::new(copy);
        *self.copy.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&copy));
        copy
    }

    /// Gives back the memory that holds the ends of the file.
    pub fn forget_ends(&self) {
        if let Some(object) = &self.object {
            object.forget_ends();
        }
    }
}

impl Reader {
    /// Size of the file at this moment, in bytes.
    ///
    /// # Errors
    /// The system's error.
    pub fn size(&self) -> io::Result<u64> {
        match self {
            Reader::Local(file) => Ok(file.metadata()?.len()),
            Reader::Remote(file) => Ok(file.size()),
        }
    }

    /// Says which stretches of the file will be read, in order: what lies between them is not asked for. Does nothing about
    /// files of this machine.
    pub fn plan(&mut self, stretches: Vec<Range<u64>>) {
        if let Reader::Remote(file) = self {
            file.plan(stretches);
        }
    }

    /// Whether the file is not on this machine.
    pub fn is_remote(&self) -> bool {
        matches!(self, Reader::Remote(_))
    }
}

impl Read for Reader {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Reader::Local(file) => file.read(into),
            Reader::Remote(file) => file.read(into),
        }
    }
}

impl Seek for Reader {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Reader::Local(file) => file.seek(to),
            Reader::Remote(file) => file.seek(to),
        }
    }
}
