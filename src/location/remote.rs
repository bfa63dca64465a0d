//! Objects of a store, found.

use std::io;
use std::path::Path;
use std::sync::Arc;

use futures::StreamExt as _;
use object_store::{ObjectMeta, ObjectStoreExt as _};

use super::object::Object;
use super::store::{self, Store};
use super::trouble::Asked;
use super::uri::{Scheme, Uri};
use super::{Entry, Found, Place, refusal};

pub(super) fn find(path: &Path, uri: Uri) -> io::Result<Found> {
    let (store, key) = (store::of(&uri)?, store::key(&uri)?);
    if uri.key.is_empty() {
        return Ok(Found::Folder);
    }
    let is_folder = || {
        let first = async { store.objects.list(Some(&key)).next().await.transpose() };
        store.wait(&uri, Asked::List, first).map(|first| first.is_some())
    };
    // A name without an ending is most likely that of a folder.
    let asks_first = !uri.is_web() && Path::new(&uri.key).extension().is_none();
    if asks_first && is_folder()? {
        return Ok(Found::Folder);
    }
    match store.wait(&uri, Asked::Read, store.objects.head(&key)) {
        Ok(meta) => Ok(Found::File(place(path, uri, Arc::clone(&store), &meta))),
        Err(error) if error.kind() == io::ErrorKind::NotFound && !uri.is_web() && !asks_first => {
            if is_folder()? {
                Ok(Found::Folder)
            } else {
                Err(error)
            }
        }
        Err(error) => Err(error),
    }
}

pub(super) fn list(folder: &Path, uri: Uri) -> io::Result<Vec<Entry>> {
    if uri.is_web() {
        return Err(refusal(io::ErrorKind::Unsupported, "a web server's folder can't be listed: name the files in it"));
    }
    let (store, key) = (store::of(&uri)?, store::key(&uri)?);
    let listed = store.wait(&uri, Asked::List, store.objects.list_with_delimiter(Some(&key)))?;
    let mut entries = Vec::new();
    for prefix in &listed.common_prefixes {
        if let Some(name) = prefix.filename() {
            entries.push(Entry { path: folder.join(name), found: Found::Folder });
        }
    }
    for meta in &listed.objects {
        if let Some(name) = meta.location.filename() {
            let path = folder.join(name);
            let uri = Uri { key: meta.location.to_string(), ..uri.clone() };
            let found = Found::File(place(&path, uri, Arc::clone(&store), meta));
            entries.push(Entry { path, found });
        }
    }
    Ok(entries)
}

fn place(path: &Path, uri: Uri, store: Arc<Store>, meta: &ObjectMeta) -> Place {
    let object = Object::new(uri, store, meta.size);
    Place::new(path.to_path_buf(), Some(Arc::new(object)))
}

impl Uri {
    pub(super) fn is_web(&self) -> bool {
        matches!(self.scheme, Scheme::Http | Scheme::Https)
    }
}
