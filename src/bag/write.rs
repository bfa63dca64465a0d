//! Bags that `ros2 bag`, Foxglove and PlotJuggler open, put in place only when they are complete.

mod output;
mod recording;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::error::BagError;
use super::layout::{Contents, TopicEntry};
use super::qos::{self, BEST_EFFORT_QOS};
use super::read::{BagAttachment, BagChannel, BagMetadata};
use crate::msg::{WireType, definition_text, rihs01};
use crate::units::Stamp;
use output::Output;
use recording::McapOutput;

/// Name of the notes that rosbag2 keeps within an MCAP file; they speak of that file alone, so they are never copied.
const ROSBAG2_NOTES: &str = "rosbag2";

const QOS_KEY: &str = "offered_qos_profiles";
const TYPE_HASH_KEY: &str = "topic_type_hash";

/// Note of a channel whose log times are those at which a live node had the messages: [`RECEIPTS_LIVE`].
pub(super) const RECEIPTS_KEY: &str = "receipts";

/// As above.
pub(super) const RECEIPTS_LIVE: &str = "live";

/// How chunks are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// Not at all.
    None,
    /// Fast, larger.
    Lz4,
    /// Small, and still faster than most disks.
    #[default]
    Zstd,
}

/// How a bag is written.
#[derive(Debug, Clone)]
pub struct WriteOptions {
    /// How chunks are packed; zstd by default.
    pub compression: Compression,
    /// Whether an output that is there is replaced, when the new one is complete; by default it is refused.
    pub overwrite: bool,
    /// Every path that the same run reads, so that none of them is replaced.
    pub inputs: Vec<PathBuf>,
    /// Whether the folder of a single file is that of this bag alone, as that of a collection: then it gets a
    /// `metadata.yaml`. By default it gets none, which would hide the folder's other bags.
    pub owns_folder: bool,
    /// The ROS distribution that `metadata.yaml` names. The layout is that of Jazzy, whichever is named.
    pub ros_distro: String,
}

impl Default for WriteOptions {
    fn default() -> Self {
        WriteOptions {
            compression: Compression::default(),
            overwrite: false,
            inputs: Vec::new(),
            owns_folder: false,
            ros_distro: "jazzy".to_owned(),
        }
    }
}

/// A topic that is about to be written, as cdr with a `ros2msg` schema.
#[derive(Debug, Clone, Copy)]
pub struct NewChannel<'a> {
    /// Topic name, absolute.
    pub topic: &'a str,
    /// Type name with `/msg/`, as `geometry_msgs/msg/WrenchStamped`.
    pub type_name: &'a str,
    /// The definition with those that it depends on, as rosbag2 concatenates them.
    pub schema_text: &'a str,
    /// The QoS that publishers of the topic offer, as [`BEST_EFFORT_QOS`](super::BEST_EFFORT_QOS).
    pub qos_yaml: &'a str,
    /// The type's RIHS01 hash; empty where it is not known.
    pub type_hash: &'a str,
}

/// A channel of the bag that is being written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct OutChannel(usize);

/// The bag that was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finished {
    /// The file or folder, by the name that was asked for.
    pub path: PathBuf,
    /// Number of messages in it.
    pub n_messages: u64,
    /// Notes for a person, a line each: for example that a `metadata.yaml` was left as it was.
    pub notes: Vec<String>,
}

struct Written {
    mcap_id: u16,
    topic: TopicEntry,
}

/// Writes a bag under a temporary name in the folder of the output, and renames it when it is finished.
///
/// The same calls write the same bytes. Dropped without [`finish`](Self::finish), it leaves nothing behind, unless
/// [`keep_unfinished`](Self::keep_unfinished) was called.
pub struct BagWriter {
    // In front of `output`, so that the file is closed before it is removed.
    recording: McapOutput,
    output: Output,
    channels: Vec<Written>,
    ros_distro: String,
    span: Option<(i64, i64)>,
}

impl BagWriter {
    /// Begin a bag: one file where `out` ends in `.mcap`, else a folder with the file and its `metadata.yaml`.
    ///
    /// # Errors
    /// [`BagError::Exists`], [`BagError::OutputIsInput`], [`BagError::NoParent`], [`BagError::NotReplaceable`], or
    /// what the operating system says.
    pub fn create(out: &Path, options: WriteOptions) -> Result<Self, BagError> {
        let (output, file) = Output::create(out, &options)?;
        let recording = McapOutput::start(file, out, options.compression)?;
        Ok(BagWriter { recording, output, channels: Vec::new(), ros_distro: options.ros_distro, span: None })
    }

    /// From now on what was written stays on the disk whatever happens, because what is recorded live can't be had again.
    ///
    /// Returns the file, under its temporary name: without [`finish`](Self::finish) it is a bag that was cut off.
    pub fn keep_unfinished(&mut self) -> PathBuf {
        self.output.keep_unfinished()
    }

    /// Add a topic of a type that has a wire struct, best effort as all that this package publishes.
    ///
    /// # Errors
    /// As [`add_channel`](Self::add_channel).
    pub fn add_topic<T: WireType>(&mut self, topic: &str) -> Result<OutChannel, BagError> {
        let schema_text = definition_text(T::TYPE_NAME).expect("the definition of a wire struct is compiled in");
        let type_hash = rihs01(T::TYPE_NAME).expect("the definition of a wire struct is compiled in");
        let (schema_text, type_hash) = (schema_text.as_str(), type_hash.as_str());
        self.add_channel(NewChannel {
            topic,
            type_name: T::TYPE_NAME,
            schema_text,
            qos_yaml: BEST_EFFORT_QOS,
            type_hash,
        })
    }

    /// Add a topic of ours. The same one again gives the same channel.
    ///
    /// # Errors
    /// [`BagError::Format`] beyond 65535 channels or schemas, [`BagError::DiskFull`], [`BagError::Io`].
    pub fn add_channel(&mut self, channel: NewChannel<'_>) -> Result<OutChannel, BagError> {
        self.add_noted(channel, BTreeMap::new())
    }

    /// As [`add_channel`](Self::add_channel), for the inputs of a live node: its log times are those at which the node had
    /// the messages, so that a replay knows how old they were.
    ///
    /// # Errors
    /// As [`add_channel`](Self::add_channel).
    pub fn add_live_input(&mut self, channel: NewChannel<'_>) -> Result<OutChannel, BagError> {
        self.add_noted(channel, BTreeMap::from([(RECEIPTS_KEY.to_owned(), RECEIPTS_LIVE.to_owned())]))
    }

    fn add_noted(
        &mut self,
        channel: NewChannel<'_>,
        mut metadata: BTreeMap<String, String>,
    ) -> Result<OutChannel, BagError> {
        metadata.insert(QOS_KEY.to_owned(), channel.qos_yaml.to_owned());
        if !channel.type_hash.is_empty() {
            metadata.insert(TYPE_HASH_KEY.to_owned(), channel.type_hash.to_owned());
        }
        let schema = Some((channel.type_name, "ros2msg", channel.schema_text.as_bytes()));
        self.add(channel.topic, "cdr", schema, metadata)
    }

    /// Add a channel as another bag has it: schema, encoding and notes, or no schema.
    ///
    /// QoS policies that older recorders noted by number are noted by name, as readers of this layout expect.
    ///
    /// # Errors
    /// As [`add_channel`](Self::add_channel).
    pub fn copy_channel(&mut self, channel: &BagChannel) -> Result<OutChannel, BagError> {
        let mut metadata = channel.metadata.clone();
        if let Some(noted) = metadata.get_mut(QOS_KEY)
            && let Some(profiles) = qos::from_yaml(noted)
        {
            *noted = qos::to_yaml(&profiles);
        }
        let schema = channel.schema.as_ref().map(|schema| (&*schema.name, &*schema.encoding, &*schema.data));
        self.add(&channel.topic, &channel.message_encoding, schema, metadata)
    }

    fn add(
        &mut self,
        topic: &str,
        encoding: &str,
        schema: Option<(&str, &str, &[u8])>,
        metadata: BTreeMap<String, String>,
    ) -> Result<OutChannel, BagError> {
        let mcap_id = self.recording.add_channel(topic, encoding, schema, &metadata)?;
        if let Some(known) = self.channels.iter().position(|written| written.mcap_id == mcap_id) {
            return Ok(OutChannel(known));
        }
        let noted = |key| metadata.get(key).cloned().unwrap_or_default();
        let topic = TopicEntry {
            name: topic.to_owned(),
            type_name: schema.map(|(name, ..)| name.to_owned()).unwrap_or_default(),
            serialization_format: encoding.to_owned(),
            offered_qos_profiles: qos::from_yaml(&noted(QOS_KEY)).unwrap_or_default(),
            type_hash: noted(TYPE_HASH_KEY),
            n_messages: 0,
        };
        self.channels.push(Written { mcap_id, topic });
        Ok(OutChannel(self.channels.len() - 1))
    }

    /// Write one message. Messages stand in the file in the order of these calls.
    ///
    /// # Errors
    /// [`BagError::NegativeTime`], [`BagError::DiskFull`], [`BagError::Io`].
    pub fn write(
        &mut self,
        channel: OutChannel,
        sequence: u32,
        log_time: Stamp,
        publish_time: Stamp,
        data: &[u8],
    ) -> Result<(), BagError> {
        let Some(written) = self.channels.get_mut(channel.0) else {
            return Err(self.recording.refuse("the channel is of another bag"));
        };
        let unsigned = |stamp: Stamp| {
            let topic = || written.topic.name.clone();
            u64::try_from(stamp.0).map_err(|_| BagError::NegativeTime { topic: topic(), stamp })
        };
        let header = mcap::records::MessageHeader {
            channel_id: written.mcap_id,
            sequence,
            log_time: unsigned(log_time)?,
            publish_time: unsigned(publish_time)?,
        };
        self.recording.write(&header, data)?;
        written.topic.n_messages += 1;
        let (first, last) = self.span.unwrap_or((log_time.0, log_time.0));
        self.span = Some((first.min(log_time.0), last.max(log_time.0)));
        Ok(())
    }

    /// Copy an attached file.
    ///
    /// # Errors
    /// [`BagError::DiskFull`], [`BagError::Io`].
    pub fn copy_attachment(&mut self, attachment: &BagAttachment<'_>) -> Result<(), BagError> {
        self.recording.attach(attachment)
    }

    /// Copy named notes. Those that rosbag2 keeps of a file are left out: the new file gets its own.
    ///
    /// # Errors
    /// [`BagError::DiskFull`], [`BagError::Io`].
    pub fn copy_metadata(&mut self, notes: &BagMetadata<'_>) -> Result<(), BagError> {
        if notes.name == ROSBAG2_NOTES {
            return Ok(());
        }
        self.recording.write_metadata(notes.name, notes.metadata.clone())
    }

    /// Hand what has been written so far to the operating system, so that a process that is killed loses none of it.
    ///
    /// It ends a chunk, so what is written depends on when this is called.
    ///
    /// # Errors
    /// [`BagError::DiskFull`], [`BagError::Io`].
    pub fn flush(&mut self) -> Result<(), BagError> {
        self.recording.flush()
    }

    /// Complete the bag, see it onto the disk, and give it the name that was asked for.
    ///
    /// A bag folder gets a `metadata.yaml`. Beside a single file there is none, unless
    /// [`owns_folder`](WriteOptions::owns_folder): one that lists this very file is kept true, any other is left as it is,
    /// which a note says.
    ///
    /// # Errors
    /// [`BagError::DiskFull`], [`BagError::Io`], [`BagError::Exists`] when something took the name meanwhile. Nothing is
    /// left behind then.
    pub fn finish(mut self) -> Result<Finished, BagError> {
        let topics = self.topics();
        let contents = Contents {
            file_name: self.output.file_name(),
            span: self.span,
            topics: &topics,
            ros_distro: &self.ros_distro,
        };
        // rosbag2 also keeps the whole `metadata.yaml` here, file name included: two runs would differ by their names.
        let mut notes = BTreeMap::new();
        notes.insert("ROS_DISTRO".to_owned(), self.ros_distro.clone());
        self.recording.write_metadata(ROSBAG2_NOTES, notes)?;
        self.recording.finish()?;
        let document = contents.document();
        let n_messages = topics.iter().map(|topic| topic.n_messages).sum();
        let (path, notes) = self.output.put_in_place(&document)?;
        Ok(Finished { path, n_messages, notes })
    }

    /// One entry a topic in order of adding, as rosbag2 lists them, though several channels may carry it.
    fn topics(&self) -> Vec<TopicEntry> {
        let mut topics: Vec<TopicEntry> = Vec::new();
        for Written { topic, .. } in &self.channels {
            let Some(entry) = topics.iter_mut().find(|entry| entry.name == topic.name) else {
                topics.push(topic.clone());
                continue;
            };
            entry.n_messages += topic.n_messages;
            for profile in &topic.offered_qos_profiles {
                if !entry.offered_qos_profiles.contains(profile) {
                    entry.offered_qos_profiles.push(profile.clone());
                }
            }
        }
        topics
    }
}
