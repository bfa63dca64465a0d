//! Outputs in a store: sent from a complete file of this machine, and visible under their name as a whole or not at all.

use std::fs::File;
use std::hash::{BuildHasher as _, RandomState};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use futures::stream::{FuturesUnordered, StreamExt as _};
use object_store::path::Path as Key;
use object_store::{
    Attribute, Attributes, GetOptions, MultipartUpload, ObjectStoreExt as _, PutMode, PutMultipartOptions, PutOptions,
    PutPayload,
};

use super::store::{self, Store};
use super::trouble::Asked;
use super::uri::{Scheme, Uri};
use super::{Found, already, refusal, remote};

/// Bytes of a part; what is no longer is sent in one request.
const PART: u64 = 8 << 20;

/// Stores take 10,000 parts, and fewer of them are fewer requests.
const MAX_PARTS: u64 = 5_000;

/// Parts that are on their way at once.
const AT_ONCE: usize = 3;

/// How long an upload that failed is taken back.
const ABORT_LIMIT: Duration = Duration::from_secs(5);

/// Name of the note by which an upload whose answer was lost is known again.
const MARK: &str = "tpfupload";

pub(super) fn check(uri: &Uri, overwrite: bool) -> io::Result<()> {
    if uri.is_web() {
        let why = "a web server takes no outputs: write to a path, or to s3://, gs:// or az://";
        return Err(refusal(io::ErrorKind::Unsupported, why));
    }
    if uri.key.is_empty() {
        let why = format!("names a whole {}: put the name of the output behind it", uri.scheme.bucket());
        return Err(refusal(io::ErrorKind::InvalidInput, why));
    }
    match remote::find(Path::new(&uri.to_string()), uri.clone()) {
        Ok(Found::Folder) if overwrite => {
            Err(refusal(io::ErrorKind::IsADirectory, "is a folder, which no output replaces"))
        }
        Ok(_) if !overwrite => Err(already()),
        Ok(_) => may_write(uri),
        Err(error) if error.kind() == io::ErrorKind::NotFound => may_write(uri),
        Err(error) => Err(error),
    }
}

/// Begins an upload and takes it back, for which a store asks for the right to write.
fn may_write(uri: &Uri) -> io::Result<()> {
    if uri.scheme == Scheme::Az {
        return Ok(()); // it begins none
    }
    let (store, key) = (store::of(uri)?, store::key(uri)?);
    store.wait(uri, Asked::Write, async { store.objects.put_multipart(&key).await?.abort().await })
}

pub(super) fn file(file: &Path, uri: &Uri, overwrite: bool) -> io::Result<()> {
    let key = store::key(uri)?;
    let store = store::that_replaces(uri, overwrite)?;
    let mark =
        format!("{:016x}{:016x}", RandomState::new().hash_one(0), RandomState::new().hash_one(std::process::id()));
    let mut attributes = Attributes::new();
    attributes.insert(Attribute::Metadata(MARK.into()), mark.clone().into());
    let size = std::fs::metadata(file)?.len();
    if !overwrite && is_there(&store, uri, &key)? {
        return Err(already());
    }
    let sent = if size <= PART {
        let mode = if overwrite { PutMode::Overwrite } else { PutMode::Create };
        let options = PutOptions { mode, attributes, ..PutOptions::default() };
        let payload = PutPayload::from(std::fs::read(file)?);
        store.wait(uri, Asked::Write, store.objects.put_opts(&key, payload, options)).map(drop)
    } else {
        in_parts(&store, uri, &key, file, size, attributes, overwrite)
    };
    match sent {
        // What was asked for may have been done, and the answer lost: then asking again finds it there.
        Err(error) if has_mark(&store, &key, &mark, size) => {
            drop(error);
            Ok(())
        }
        sent => sent,
    }
}

fn is_there(store: &Store, uri: &Uri, key: &Key) -> io::Result<bool> {
    match store.wait(uri, Asked::Read, store.objects.head(key)) {
        Ok(_) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

/// Whether what is there now is this upload.
fn has_mark(store: &Store, key: &Key, mark: &str, size: u64) -> bool {
    let look = async {
        let options = GetOptions { head: true, ..GetOptions::default() };
        tokio::time::timeout(ABORT_LIMIT, store.objects.get_opts(key, options)).await
    };
    let Ok(Ok(found)) = store.run(look) else { return false };
    let noted = found.attributes.get(&Attribute::Metadata(MARK.into()));
    found.meta.size == size && noted.is_some_and(|noted| AsRef::<str>::as_ref(noted) == mark)
}

fn in_parts(
    store: &Store,
    uri: &Uri,
    key: &Key,
    file: &Path,
    size: u64,
    attributes: Attributes,
    overwrite: bool,
) -> io::Result<()> {
    let options = PutMultipartOptions { attributes, ..PutMultipartOptions::default() };
    let mut upload = store.wait(uri, Asked::Write, store.objects.put_multipart_opts(key, options))?;
    let sent = send(store, uri, file, size, &mut *upload)
        // Other stores than S3 don't take a condition here; then what came meanwhile is seen only now.
        .and_then(|()| if !overwrite && is_there(store, uri, key)? { Err(already()) } else { Ok(()) })
        .and_then(|()| store.wait(uri, Asked::Write, upload.complete()).map(drop));
    if sent.is_err() {
        // One that can't be taken back is seen by nobody, and goes by the store's own rules.
        let _ = store.run(async { tokio::time::timeout(ABORT_LIMIT, upload.abort()).await });
    }
    sent
}

fn send(store: &Store, uri: &Uri, file: &Path, size: u64, upload: &mut dyn MultipartUpload) -> io::Result<()> {
    let part = PART.max(size.div_ceil(MAX_PARTS));
    let mut file = File::open(file)?;
    let mut left = size;
    let mut on_their_way = FuturesUnordered::new();
    while left > 0 || !on_their_way.is_empty() {
        if left > 0 && on_their_way.len() < AT_ONCE {
            let mut bytes = vec![0; part.min(left) as usize];
            file.read_exact(&mut bytes)?;
            left -= bytes.len() as u64;
            on_their_way.push(upload.put_part(PutPayload::from(bytes)));
            continue;
        }
        store.wait(uri, Asked::Write, async { on_their_way.next().await.transpose() })?;
    }
    Ok(())
}

pub(super) fn folder(folder: &Path, uri: &Uri, last: &[&str]) -> io::Result<()> {
    let mut files = Vec::new();
    below(folder, Path::new(""), &mut files)?;
    let is_last = |file: &PathBuf| file.file_name().is_some_and(|name| last.iter().any(|last| name == *last));
    files.sort_by_key(|file| (is_last(file), file.clone()));
    let mut sent: Vec<Uri> = Vec::new();
    for name in files {
        let of_file = Uri { key: format!("{}/{}", uri.key, name.to_string_lossy()), ..uri.clone() };
        match file(&folder.join(&name), &of_file, false) {
            Ok(()) => sent.push(of_file),
            Err(error) => {
                return Err(match take_back(uri, &sent) {
                    0 => error,
                    n => refusal(
                        error.kind(),
                        format!("{error}; {n} files of it could not be removed again: remove them"),
                    ),
                });
            }
        }
    }
    Ok(())
}

fn below(folder: &Path, within: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in std::fs::read_dir(folder.join(within))? {
        let entry = entry?;
        let name = within.join(entry.file_name());
        if entry.file_type()?.is_dir() { below(folder, &name, files)? } else { files.push(name) }
    }
    Ok(())
}

/// Removes what was sent; returns how many are left. After one that takes too long, no other is tried.
fn take_back(uri: &Uri, sent: &[Uri]) -> usize {
    let Ok(store) = store::of(uri) else { return sent.len() };
    let keys: Vec<Key> = sent.iter().filter_map(|uri| store::key(uri).ok()).collect();
    let removed = store.run(async {
        let mut removed = 0;
        for key in &keys {
            match tokio::time::timeout(ABORT_LIMIT, store.objects.delete(key)).await {
                Ok(deleted) => removed += usize::from(deleted.is_ok()),
                Err(_) => break,
            }
        }
        removed
    });
    sent.len() - removed
}
