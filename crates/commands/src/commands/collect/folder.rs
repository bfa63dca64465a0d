//! The folder of a collection: what is to be done, what has been recorded, and the bag that comes of it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tactile_pose_fusion::bag::{BagMetadata, BagReader, BagRecord, BagWriter, Finished, PassThrough, WriteOptions};
use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::files;
use tactile_pose_fusion::location;
use tactile_pose_fusion::msg::{Stage, WireType, canonical_type_name, from_cdr, to_cdr};
use tactile_pose_fusion::protocol::{Annotation, Annotations, Plan, Protocol};
use tactile_pose_fusion::recording::SESSION_NOTES;

use super::super::{Failure, say};

const FORMAT: &str = "tactile_pose_fusion/collection/1";
const NOTES: &str = "collection.yaml";
const PROTOCOL: &str = "protocol.yaml";
const PARTS: &str = "parts";

/// Head of a collection: protocol, order, glove, user and donning. YAML on disk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct About {
    format: String,
    pub(super) protocol: String,
    /// How long it was to take; the whole protocol where it isn't said.
    pub(super) minutes: Option<f64>,
    pub(super) seed: u64,
    pub(super) glove: String,
    pub(super) user: String,
    pub(super) donning: u32,
}

/// A collection on the disk.
pub(super) struct Folder {
    path: PathBuf,
    pub(super) about: About,
    pub(super) protocol: Protocol,
}

impl About {
    pub(super) fn new(protocol: &Protocol, minutes: Option<f64>, seed: u64, cfg: &Config, donning: u32) -> Self {
        About {
            format: FORMAT.to_owned(),
            protocol: protocol.name.clone(),
            minutes,
            seed,
            glove: cfg.glove.clone().unwrap_or_default(),
            user: cfg.user.clone().unwrap_or_default(),
            donning,
        }
    }

    /// The items in the order of this seed, user and donning.
    pub(super) fn plan(&self, protocol: &Protocol) -> Plan {
        let order = format!("collection, seed {}, user {}, donning {}", self.seed, self.user, self.donning);
        Plan::new(protocol, self.minutes, &order)
    }

    /// One line for people.
    pub(super) fn line(&self) -> String {
        let named = |what: &str, name: &str| if name.is_empty() { String::new() } else { format!("{what} {name}, ") };
        let (glove, user) = (named("glove", &self.glove), named("user", &self.user));
        format!("{glove}{user}donning {}, seed {}", self.donning, self.seed)
    }
}

impl Folder {
    /// Refuses a path at which there is something.
    pub(super) fn check_new(path: &Path) -> Result<(), Failure> {
        location::only_here(path).map_err(|error| Failure(format!("{}: {error}", path.display())))?;
        if !path.exists() {
            return Ok(());
        }
        let hint = if path.join(NOTES).exists() { "go on with it by --resume, or choose" } else { "choose" };
        Err(Failure(format!("{}: already exists; {hint} another name", path.display())))
    }

    /// A new collection.
    pub(super) fn create(path: &Path, about: About, protocol: Protocol) -> Result<Self, Failure> {
        Self::check_new(path)?;
        let failed = |error: std::io::Error| Failure(format!("{}: cannot make the folder: {error}", path.display()));
        std::fs::create_dir_all(path.join(PARTS)).map_err(failed)?;
        let folder = Folder { path: path.to_path_buf(), about, protocol };
        folder.put(PROTOCOL, folder.protocol.source())?;
        let notes = serde_saphyr::to_string(&folder.about).map_err(|error| Failure(error.to_string()))?;
        folder.put(NOTES, &notes)?;
        Ok(folder)
    }

    /// A collection that was begun.
    pub(super) fn open(path: &Path) -> Result<Self, Failure> {
        location::only_here(path).map_err(|error| Failure(format!("{}: {error}", path.display())))?;
        let notes = path.join(NOTES);
        let no_collection = |why: String| {
            Failure(format!("{}: {why}; --resume goes on with a folder that tpf collect made", notes.display()))
        };
        let text = std::fs::read_to_string(&notes).map_err(|error| no_collection(error.to_string()))?;
        let about: About = serde_saphyr::from_str(&text).map_err(|error| {
            no_collection(error.to_string().lines().next().unwrap_or("it is no collection").to_owned())
        })?;
        if about.format != FORMAT {
            return Err(no_collection(format!("expected format {FORMAT}, got {:?}", about.format)));
        }
        let done = bag(path);
        if done.exists() {
            return Err(Failure(format!("{}: this collection is complete; choose another folder", done.display())));
        }
        let protocol = Protocol::load(&path.join(PROTOCOL))?;
        Ok(Folder { path: path.to_path_buf(), about, protocol })
    }

    /// Refuses to go on for another glove or user. Parameters that name no user mean the one who began.
    pub(super) fn check_same(&self, cfg: &Config) -> Result<(), Failure> {
        let pairs = [("glove", &self.about.glove, &cfg.glove), ("user", &self.about.user, &cfg.user)];
        for (what, was, is) in pairs {
            if what == "user" && is.as_deref().is_none_or(str::is_empty) {
                continue;
            }
            let is = is.clone().unwrap_or_default();
            if *was != is {
                let path = self.path.join(NOTES);
                return Err(Failure(format!(
                    "{}: begun with {what} {was:?}, the parameters say {is:?}; correct `{what}`, or begin another folder",
                    path.display()
                )));
            }
        }
        Ok(())
    }

    /// The recorded parts, in their order. A part that a killed run left is given a name first.
    pub(super) fn parts(&self) -> Result<Vec<PathBuf>, Failure> {
        let folder = self.path.join(PARTS);
        let failed = |error: std::io::Error| Failure(format!("{}: {error}", folder.display()));
        let mut parts = Vec::new();
        for entry in std::fs::read_dir(&folder).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            if name.ends_with(".mcap") {
                parts.push(path);
            } else if let Some(number) = name.strip_prefix('.').and_then(|name| name.split_once(".mcap.")) {
                if path.metadata().is_ok_and(|metadata| metadata.len() == 0) {
                    continue;
                }
                let whole = folder.join(format!("{}.mcap", number.0));
                if whole.exists() {
                    continue; // it came to its name after all
                }
                std::fs::rename(&path, &whole).map_err(failed)?;
                say(&format!("{}: a run that was cut off left it; what is in it counts", whole.display()));
                parts.push(whole);
            }
        }
        parts.sort();
        Ok(parts)
    }

    /// The annotations that have been recorded.
    pub(super) fn annotations(&self, parts: &[PathBuf], stage_topic: &str) -> Result<Annotations, Failure> {
        let mut annotations = Annotations::default();
        if parts.is_empty() {
            return Ok(annotations);
        }
        let mut reader = BagReader::open(parts)?;
        while let Some(message) = reader.next_message()? {
            if message.channel.topic == stage_topic
                && let Ok(stage) = from_cdr::<Stage>(message.data)
            {
                annotations.handle(stage.into());
            }
        }
        Ok(annotations)
    }

    /// Begins the next part.
    pub(super) fn begin_part(&self, parts: &[PathBuf]) -> Result<BagWriter, Failure> {
        let last = parts.last().and_then(|path| path.file_stem()?.to_str()?.parse::<u32>().ok());
        let name = format!("{:03}.mcap", last.map_or(0, |last| last + 1));
        Ok(BagWriter::create(&self.path.join(PARTS).join(name), WriteOptions::default())?)
    }

    /// Makes one bag of all parts, with the annotations that hold; then the parts are no longer needed.
    pub(super) fn complete(&self, parts: &[PathBuf], stage_topic: &str) -> Result<Finished, Failure> {
        let annotations = self.annotations(parts, stage_topic)?;
        let mut annotations = annotations.all().iter().peekable();
        let mut reader = BagReader::open(parts)?;
        let options = WriteOptions { owns_folder: true, ..WriteOptions::default() };
        let mut bag = BagWriter::create(&bag(&self.path), options)?;
        let stage_channel = bag.add_topic::<Stage>(stage_topic)?;
        let annotate = |bag: &mut BagWriter, annotation: &Annotation| {
            let from = annotation.from;
            bag.write(stage_channel, 0, from, from, &to_cdr(&Stage::from(annotation.clone())))
        };
        let mut pass_through = PassThrough::default();
        let mut notes: BTreeMap<String, String> = BTreeMap::new();
        while let Some(record) = reader.next_record()? {
            match &record {
                BagRecord::Metadata(BagMetadata { name, metadata }) if *name == SESSION_NOTES => {
                    notes.extend(metadata.iter().map(|(key, value)| (key.clone(), value.clone())));
                }
                BagRecord::Message(message) => {
                    let is_stage = message.channel.topic == stage_topic
                        && canonical_type_name(message.channel.type_name()) == Stage::TYPE_NAME;
                    if is_stage {
                        continue;
                    }
                    while let Some(annotation) = annotations.next_if(|next| next.from <= message.log_time) {
                        annotate(&mut bag, annotation)?;
                    }
                    pass_through.copy(&record, &mut bag)?;
                }
                _ => pass_through.copy(&record, &mut bag)?,
            }
        }
        for annotation in annotations {
            annotate(&mut bag, annotation)?;
        }
        bag.copy_metadata(&BagMetadata { name: SESSION_NOTES, metadata: &notes })?;
        reader.losses().iter().for_each(|loss| say(&loss.to_string()));
        let finished = bag.finish()?;
        let parts = self.path.join(PARTS);
        if let Err(error) = std::fs::remove_dir_all(&parts) {
            say(&format!("{}: is no longer needed, and can't be removed: {error}", parts.display()));
        }
        Ok(finished)
    }

    fn put(&self, name: &str, text: &str) -> Result<(), Failure> {
        let path = self.path.join(name);
        files::replace(&path, text.as_bytes()).map_err(|error| Failure(format!("{}: {error}", path.display())))
    }
}

/// The bag that comes of a collection, by the name of its folder.
fn bag(folder: &Path) -> PathBuf {
    let name = folder.file_name().map_or_else(|| "session".into(), |name| name.to_string_lossy().into_owned());
    folder.join(format!("{name}.mcap"))
}
