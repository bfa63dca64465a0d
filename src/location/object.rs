//! Objects of a store, read in ranges.

use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use object_store::{GetOptions, GetRange};

use super::refusal;
use super::store::{self, Store};
use super::trouble::{Asked, CHANGED};
use super::uri::Uri;

/// Bytes of a first request: a look at the start of a file.
const FIRST: u64 = 64 << 10;

/// The most bytes of one request. As long as a file is read on, each request is twice the one before it.
const MOST: u64 = 8 << 20;

/// Bytes of the end of a file that are read at once: most summaries are shorter.
const TAIL: u64 = 256 << 10;

/// Planned stretches that are this close are read as one: a request costs about as much as so many bytes.
const GAP: u64 = 512 << 10;

/// An object as it was when it was found.
#[derive(Debug)]
pub struct Object {
    uri: Uri,
    store: Arc<Store>,
    size: u64,
    /// Its version when its first bytes came.
    version: OnceLock<Version>,
    /// Its start and its end, for who opens it again.
    ends: Mutex<Vec<Block>>,
}

/// The mark that tells two versions of an object apart.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Version {
    Tag(String),
    Modified(i64),
}

#[derive(Debug, Clone)]
struct Block {
    start: u64,
    bytes: bytes::Bytes,
}

/// An object that is being read.
#[derive(Debug)]
pub struct RemoteFile {
    object: Arc<Object>,
    pos: u64,
    /// The block that was read last.
    block: Option<Block>,
    /// The start and the end, as far as they were read.
    ends: Vec<Block>,
    /// Size of the next request if reading goes on where the block ends.
    reach: u64,
    plan: Vec<Range<u64>>,
}

impl Object {
    /// An object that was found.
    pub(super) fn new(uri: Uri, store: Arc<Store>, size: u64) -> Self {
        Object { uri, store, size, version: OnceLock::new(), ends: Mutex::default() }
    }

    pub(super) fn forget_ends(&self) {
        self.ends.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// Bytes of this very version.
    fn get(&self, range: Range<u64>) -> io::Result<Block> {
        let changed = || refusal(io::ErrorKind::InvalidData, CHANGED);
        let known = self.version.get();
        // A weak tag is no name for bytes, which a condition asks for; it is compared below.
        let if_match = match known {
            Some(Version::Tag(tag)) if !tag.starts_with("W/") => Some(tag.clone()),
            _ => None,
        };
        let options = GetOptions { range: Some(GetRange::Bounded(range.clone())), if_match, ..GetOptions::default() };
        let key = store::key(&self.uri)?;
        let answer = async {
            let answer = self.store.objects.get_opts(&key, options).await?;
            let meta = answer.meta.clone();
            Ok((meta, answer.bytes().await?))
        };
        let (meta, bytes) = self.store.wait(&self.uri, Asked::Read, answer)?;
        let version = meta.e_tag.map_or(Version::Modified(meta.last_modified.timestamp()), Version::Tag);
        if meta.size != self.size || *self.version.get_or_init(|| version.clone()) != version {
            return Err(changed());
        }
        if bytes.len() as u64 != range.end - range.start {
            return Err(refusal(io::ErrorKind::UnexpectedEof, "the store sent fewer bytes than were asked for"));
        }
        Ok(Block { start: range.start, bytes })
    }
}

impl Block {
    fn end(&self) -> u64 {
        self.start + self.bytes.len() as u64
    }

    fn holds(&self, pos: u64) -> bool {
        (self.start..self.end()).contains(&pos)
    }
}

impl RemoteFile {
    pub(super) fn of(object: Arc<Object>) -> Box<Self> {
        let ends = object.ends.lock().unwrap_or_else(PoisonError::into_inner).clone();
        Box::new(RemoteFile { object, pos: 0, block: None, ends, reach: FIRST, plan: Vec::new() })
    }

    pub(super) fn size(&self) -> u64 {
        self.object.size
    }

    pub(super) fn plan(&mut self, mut stretches: Vec<Range<u64>>) {
        stretches.sort_by_key(|stretch| stretch.start);
        self.plan.clear();
        for stretch in stretches {
            match self.plan.last_mut() {
                Some(last) if stretch.start <= last.end.saturating_add(GAP) => last.end = last.end.max(stretch.end),
                _ => self.plan.push(stretch),
            }
        }
    }

    /// Asks for bytes from the position on.
    fn fetch(&mut self) -> io::Result<()> {
        let (pos, size) = (self.pos, self.object.size);
        let goes_on = self.block.as_ref().or(self.ends.first()).is_some_and(|block| block.end() == pos);
        let tail = size.saturating_sub(TAIL);
        let mut is_end = pos == 0;
        let range = if let Some(stretch) = self.plan.iter().find(|stretch| stretch.contains(&pos)) {
            pos..stretch.end.min(pos + MOST)
        } else if goes_on {
            self.reach = (self.reach * 2).min(MOST);
            pos..pos + self.reach
        } else if pos >= tail && tail > 0 {
            is_end = true;
            tail..size
        } else {
            self.reach = FIRST;
            pos..pos + FIRST
        };
        // Not what is known already.
        let known = self.ends.iter().map(|block| block.start).filter(|start| *start > pos).min();
        let end = range.end.min(known.unwrap_or(size)).min(size);
        let block = self.object.get(range.start..end)?;
        if is_end {
            self.ends.push(block.clone());
            self.object.ends.lock().unwrap_or_else(PoisonError::into_inner).push(block);
        } else {
            self.block = Some(block);
        }
        Ok(())
    }
}

impl Read for RemoteFile {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        if self.pos >= self.object.size || into.is_empty() {
            return Ok(0);
        }
        let here = |file: &RemoteFile| file.block.iter().chain(&file.ends).find(|block| block.holds(file.pos)).cloned();
        let block = match here(self) {
            Some(block) => block,
            None => {
                self.fetch()?;
                here(self)
                    .ok_or_else(|| refusal(io::ErrorKind::Other, "the store sent other bytes than were asked for"))?
            }
        };
        let from = (self.pos - block.start) as usize;
        let n = into.len().min(block.bytes.len() - from);
        into[..n].copy_from_slice(&block.bytes[from..from + n]);
        self.pos += n as u64;
        Ok(n)
    }
}

impl Seek for RemoteFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let to = match to {
            SeekFrom::Start(pos) => Some(pos),
            SeekFrom::Current(by) => self.pos.checked_add_signed(by),
            SeekFrom::End(by) => self.object.size.checked_add_signed(by),
        };
        self.pos = to.ok_or_else(|| refusal(io::ErrorKind::InvalidInput, "before the start of the file"))?;
        Ok(self.pos)
    }
}
