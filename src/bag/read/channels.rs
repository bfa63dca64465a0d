//! Channels of all inputs in one table, and what the ids of one file mean in it.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::Arc;

use super::fields::Fields;
use crate::bag::error::one_line;
use crate::msg::definition::{DefinitionError, Definitions as Installed, LookupError, TypeTree, canonical_type_name};

/// The definition that a channel's messages follow.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BagSchema {
    /// Type name, as `sensor_msgs/msg/JointState`; some recorders leave `/msg/` out.
    pub name: String,
    /// How `data` is written: `ros2msg` or `ros2idl` in ROS 2 bags.
    pub encoding: String,
    /// The definition's text, with those that it depends on.
    pub data: Vec<u8>,
}

/// One topic as one recorder wrote it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BagChannel {
    /// Number of this channel, unique over all inputs of a reader, counted from 0 in the order of finding.
    pub id: usize,
    /// Which input it belongs to, counted from 0 in the order given.
    pub input: usize,
    /// Topic name.
    pub topic: String,
    /// How messages are serialized: `cdr` in ROS 2 bags.
    pub message_encoding: String,
    /// The definition of the messages, where the recorder wrote one.
    pub schema: Option<Arc<BagSchema>>,
    /// The recorder's metadata of the channel: `offered_qos_profiles`, `topic_type_hash`.
    pub metadata: BTreeMap<String, String>,
}

impl BagChannel {
    /// Type name of the messages; empty where the recorder wrote no schema.
    pub fn type_name(&self) -> &str {
        self.schema.as_ref().map_or("", |schema| &schema.name)
    }
}

impl BagSchema {
    /// Whether the recorder knew the type's name alone, as every recorder of `.db3` bags before Jazzy.
    ///
    /// In `.msg` an empty text defines a message without fields.
    pub fn is_undefined(&self) -> bool {
        self.data.is_empty() && self.encoding != "ros2msg"
    }

    /// The type with everything that it is made of; one that the recorder didn't define is looked for among `installed`.
    ///
    /// # Errors
    /// [`SchemaError`] in one line.
    pub fn tree(&self, installed: &Installed) -> Result<TypeTree, SchemaError> {
        let name = canonical_type_name(&self.name);
        if self.is_undefined() {
            return Ok(installed.tree(&one_line(&name))?);
        }
        // An empty text may also be of a recorder that knew the name alone. Then a definition that is known says more.
        if self.data.is_empty()
            && let Ok(tree) = installed.tree(&one_line(&name))
        {
            return Ok(tree);
        }
        Ok(TypeTree::from_encoded(&name, &self.encoding, &String::from_utf8_lossy(&self.data))?)
    }
}

/// Why the type of a channel's messages isn't known. Each text is one line.
#[derive(Debug, thiserror::Error)]
pub enum SchemaError {
    /// The recorder wrote no definition, and there is none on this machine.
    #[error("the bag has no definition of its type: {0}")]
    Undefined(#[from] LookupError),
    /// The definition can't be read.
    #[error(transparent)]
    Definition(#[from] DefinitionError),
}

/// Types that are looked for outside of the bag; a robot has some hundred.
const MAX_LOOKED_FOR: usize = 4096;

/// The channels of all inputs. Equal channels of one input are one, so the parts of a split bag share theirs.
#[derive(Debug, Default)]
pub(super) struct ChannelTable {
    channels: Vec<Arc<BagChannel>>,
    /// Places of channels that may be equal: one topic may have been defined in half a million ways.
    alike: BTreeMap<u64, Vec<usize>>,
    /// Where types that no recorder defined are looked for.
    installed: Installed,
    /// Schemas that were found there, by type name.
    found: BTreeMap<String, Option<Arc<BagSchema>>>,
}

impl ChannelTable {
    /// No channels yet; types that no recorder defines are looked for among `installed` ones.
    pub(super) fn new(installed: Installed) -> Self {
        ChannelTable { installed, ..ChannelTable::default() }
    }

    pub(super) fn all(&self) -> &[Arc<BagChannel>] {
        &self.channels
    }

    /// Look for types that no recorder defined among these, those of channels that are known already too.
    pub(super) fn look_among(&mut self, installed: Installed) {
        self.installed = installed;
        self.found.clear();
        self.alike.clear();
        for (id, channel) in std::mem::take(&mut self.channels).into_iter().enumerate() {
            let channel = self.completed(Arc::unwrap_or_clone(channel));
            self.alike.entry(likeness(&channel)).or_default().push(id);
            self.channels.push(Arc::new(channel));
        }
    }

    /// Where types that no recorder defined are looked for.
    pub(super) fn installed(&self) -> &Installed {
        &self.installed
    }

    /// The channel with the definition of its type, where the recorder wrote none and it is installed.
    fn completed(&mut self, mut channel: BagChannel) -> BagChannel {
        let Some(schema) = channel.schema.as_ref().filter(|schema| schema.is_undefined()) else { return channel };
        if !self.found.contains_key(&schema.name) && self.found.len() < MAX_LOOKED_FOR {
            let text = self.installed.schema_text(&canonical_type_name(&schema.name)).ok();
            let (name, encoding) = (schema.name.clone(), "ros2msg".to_owned());
            let found = text.map(|text| Arc::new(BagSchema { name, encoding, data: text.into_bytes() }));
            self.found.insert(schema.name.clone(), found);
        }
        if let Some(Some(found)) = self.found.get(&schema.name) {
            channel.schema = Some(Arc::clone(found));
        }
        channel
    }

    /// The place of a channel, which is entered where it is not known yet.
    pub(super) fn intern(&mut self, channel: BagChannel) -> usize {
        let channel = self.completed(channel);
        let alike = self.alike.entry(likeness(&channel)).or_default();
        let known = alike.iter().copied().find(|&id| {
            let known = &self.channels[id];
            known.input == channel.input
                && known.topic == channel.topic
                && known.message_encoding == channel.message_encoding
                && known.schema == channel.schema
                && known.metadata == channel.metadata
        });
        known.unwrap_or_else(|| {
            let id = self.channels.len();
            alike.push(id);
            self.channels.push(Arc::new(BagChannel { id, ..channel }));
            id
        })
    }
}

/// Equal for equal channels.
fn likeness(channel: &BagChannel) -> u64 {
    let BagChannel { id: _, input, topic, message_encoding, schema, metadata } = channel;
    let mut hash = DefaultHasher::new();
    (input, topic, message_encoding, metadata).hash(&mut hash);
    // Definitions are long, and most channels that are alike but for theirs have another one by name or length.
    schema.as_ref().map(|schema| (&schema.name, schema.data.len())).hash(&mut hash);
    hash.finish()
}

/// The most bytes of schemas and channels that one file may define; real bags stay under a few MB.
pub(super) const MAX_DEFINITION_BYTES: usize = 256 << 20;

/// The schemas and channels of one file, by their ids in that file.
#[derive(Debug, Clone, Default)]
pub(super) struct Definitions {
    schemas: BTreeMap<u16, Arc<BagSchema>>,
    channels: BTreeMap<u16, usize>,
    bytes: usize,
}

impl Definitions {
    /// Place in the table of the channel that this file calls `id`.
    pub(super) fn channel(&self, id: u16) -> Option<usize> {
        self.channels.get(&id).copied()
    }

    /// Take in a schema record.
    ///
    /// # Errors
    /// The reason, for a person.
    pub(super) fn handle_schema(&mut self, body: &[u8]) -> Result<(), String> {
        let mut fields = Fields(body);
        let parsed = (|| {
            let id = fields.u16()?;
            let schema =
                BagSchema { name: fields.string()?, encoding: fields.string()?, data: fields.block()?.to_vec() };
            Some((id, schema))
        })();
        let Some((id, schema)) = parsed else { return Err("a schema record is malformed".to_owned()) };
        match self.schemas.get(&id) {
            Some(known) if **known == schema => Ok(()),
            Some(known) => {
                let (old, new) = (one_line(&known.name), one_line(&schema.name));
                self.grow(body.len())?;
                self.schemas.insert(id, Arc::new(schema));
                Err(format!("schema {id} is defined twice, as {old} and as {new}; the later one counts from here on"))
            }
            None => {
                self.grow(body.len())?;
                self.schemas.insert(id, Arc::new(schema));
                Ok(())
            }
        }
    }

    /// Take in a channel record of input `input`.
    ///
    /// # Errors
    /// The reason, for a person.
    pub(super) fn handle_channel(&mut self, body: &[u8], input: usize, table: &mut ChannelTable) -> Result<(), String> {
        let mut fields = Fields(body);
        let parsed =
            (|| Some((fields.u16()?, fields.u16()?, fields.string()?, fields.string()?, fields.string_map()?)))();
        let Some((id, schema_id, topic, message_encoding, metadata)) = parsed else {
            return Err("a channel record is malformed".to_owned());
        };
        let schema = self.schemas.get(&schema_id).cloned();
        let no_schema = schema_id != 0 && schema.is_none();
        let complaint = no_schema.then(|| {
            let topic = one_line(&topic);
            format!("channel {id} ({topic}) refers to schema {schema_id}, which the file doesn't define")
        });
        let known = self.channel(id);
        let n_before = table.all().len();
        self.grow(0)?;
        let place = table.intern(BagChannel { id: 0, input, topic, message_encoding, schema, metadata });
        self.channels.insert(id, place);
        if table.all().len() > n_before {
            self.bytes = self.bytes.saturating_add(body.len());
        }
        if let Some(old) = known.filter(|&old| old != place) {
            let [old, new] = [old, place].map(|channel| one_line(&table.all()[channel].topic));
            return Err(format!(
                "channel {id} is defined twice and differently, as {old} and as {new}; the later one counts from here on"
            ));
        }
        complaint.map_or(Ok(()), Err)
    }

    fn grow(&mut self, by: usize) -> Result<(), String> {
        self.bytes = self.bytes.saturating_add(by);
        if self.bytes > MAX_DEFINITION_BYTES {
            return Err(format!("more than {MAX_DEFINITION_BYTES} bytes of definitions; this one is not read"));
        }
        Ok(())
    }
}
