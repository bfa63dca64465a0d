//! Stand-ins for object stores in a build without the feature `cloud`: every URI is refused in one line.

use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;

use super::uri::Uri;
use super::{Entry, Found, refusal};

/// There is none.
#[derive(Debug)]
pub(super) enum Object {}

/// There is none.
#[derive(Debug)]
pub enum RemoteFile {}

fn refused() -> io::Error {
    let why = "this build takes no URIs of other machines: build it with `--features cloud`, or copy the file";
    refusal(io::ErrorKind::Unsupported, why)
}

pub(super) fn find(_path: &Path, _uri: Uri) -> io::Result<Found> {
    Err(refused())
}

pub(super) fn list(_folder: &Path, _uri: Uri) -> io::Result<Vec<Entry>> {
    Err(refused())
}

pub(super) fn check(_uri: &Uri, _overwrite: bool) -> io::Result<()> {
    Err(refused())
}

pub(super) fn file(_file: &Path, _uri: &Uri, _overwrite: bool) -> io::Result<()> {
    Err(refused())
}

pub(super) fn folder(_folder: &Path, _uri: &Uri, _last: &[&str]) -> io::Result<()> {
    Err(refused())
}

impl Object {
    pub(super) fn forget_ends(&self) {
        match *self {}
    }
}

impl RemoteFile {
    pub(super) fn of(object: std::sync::Arc<Object>) -> Box<Self> {
        match *object {}
    }

    pub(super) fn size(&self) -> u64 {
        match *self {}
    }

    pub(super) fn plan(&mut self, _stretches: Vec<Range<u64>>) {
        match *self {}
    }
}

impl Read for RemoteFile {
    fn read(&mut self, _into: &mut [u8]) -> io::Result<usize> {
        match *self {}
    }
}

impl Seek for RemoteFile {
    fn seek(&mut self, _to: SeekFrom) -> io::Result<u64> {
        match *self {}
    }
}
