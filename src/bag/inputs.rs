//! Which topics of a bag feed the core, and how their messages become events.

mod counts;
mod static_frames;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

pub use counts::TopicCounters;
use counts::{MessageParts, Share, count, counted};

use super::error::one_line;
use super::write::{RECEIPTS_KEY, RECEIPTS_LIVE};
use super::{BagChannel, BagError, BagMessage, BagReader, SchemaError};
use crate::fusion::{Event, JointSource, JointSourceIdx, Receipts, TactileSourceIdx};
use crate::msg::binding::{
    BindingError, ForceReading, FrameStore, FramesBinding, JointBinding, JointFields, SampleBinding, TaxelBinding,
    TaxelFields, Topic, TruthBinding, TruthFields, static_topic,
};
use crate::msg::definition::{Definitions, TypeTree};
use crate::msg::{AngleWatch, Stage, WireType, canonical_type_name, from_cdr};
use crate::units::Stamp;

/// Most joint names that are kept for the error that lists them; two hands have 50.
const MAX_JOINT_NAMES: usize = 128;

/// The topics that feed the core, in the order of the sources in its configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct InputTopics {
    /// One a tactile source.
    pub taxels: Vec<Topic<TaxelFields>>,
    /// One a joint source.
    pub joints: Vec<Topic<JointFields>>,
    /// One a source of true force; empty where none is asked for.
    pub truth: Vec<Topic<TruthFields>>,
    /// The joint sources, for the unit of their angles.
    pub joint_sources: Vec<JointSource>,
    /// Names of the joints that some region needs.
    pub needed: BTreeSet<String>,
    /// Name of the topic with stage annotations, which a bag may lack.
    pub stage: String,
    /// Annotations that were told beside the bag, in place of those on that topic.
    pub told: Option<Arc<[Stage]>>,
    /// Folder with the definitions of types that a bag doesn't define.
    pub message_definitions: Option<PathBuf>,
}

impl InputTopics {
    /// Those of taxels and of annotations alone.
    pub fn taxels_alone(self) -> Self {
        let none = BTreeSet::new();
        InputTopics { joints: vec![], truth: vec![], joint_sources: vec![], needed: none, ..self }
    }
}

/// A part of a message, as the core or its judge takes it.
#[derive(Debug, Clone)]
pub enum Input<'a> {
    /// A sample.
    Event(Event<'a>),
    /// A reading of a force sensor.
    Truth {
        /// Index of the source in [`InputTopics::truth`].
        source: usize,
        /// When it was measured.
        stamp: Stamp,
        /// The force as it was sent, in the unit and with the signs of the source.
        force: ForceReading,
    },
    /// A stage of the protocol, from the stamp of its header on: among others, that nothing touches the glove.
    Stage(Stage),
    /// Nothing: it could not be read, and is counted.
    None,
}

/// Why a bag can't feed the core. Each text is one line that names the topic.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum InputError {
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error("topic {topic} is {got}, the parameters say {expected}; set the type of this source")]
    Type { topic: String, expected: String, got: String },
    #[error("topic {topic}: {error}")]
    Definition { topic: String, error: Box<SchemaError> },
    #[error("topic {topic}: {error}")]
    Binding { topic: String, error: Box<BindingError> },
    #[error("topic {topic}: none of its {messages} messages could be read: {first}")]
    NothingRead { topic: String, messages: u64, first: String },
    #[error(
        "topic {topic}: none of its {messages} messages is for a source of {what} on it; the first: {first}; correct what its parameters ask for"
    )]
    NothingForSource { topic: String, what: &'static str, messages: u64, first: String },
    #[error("topic {topic} has no messages in this bag; its source in the parameters needs some")]
    NoMessages { topic: String },
    #[error(
        "joints {missing:?} are in no message of {topics:?}, which name {seen:?}; correct region.*.joints or the joint source"
    )]
    MissingJoints { missing: Vec<String>, topics: Vec<String>, seen: Vec<String> },
}

/// Turns the messages of bags into events: bindings of each channel, because bags of one recording may differ in schema.
///
/// A message may have several parts: taxels and joint angles, or the taxels of two sources. Each is decoded by itself.
#[derive(Debug)]
pub struct Inputs {
    topics: InputTopics,
    /// Where types that the bag doesn't define are looked for.
    definitions: Definitions,
    /// By channel id, in the order in which the parts of a message are handled; none where it means nothing here.
    roles: BTreeMap<usize, (String, Vec<Role>)>,
    counters: BTreeMap<String, TopicCounters>,
    joint_names: BTreeSet<String>,
    /// One a joint source.
    joints: Vec<JointNames>,
    /// One a joint source, of the joints that are needed.
    angles: Vec<AngleWatch>,
    /// One a joint source: what `/tf` and `/tf_static` tell.
    frames: Vec<FrameStore>,
    /// Findings in the parts of the message that is being decoded.
    message: MessageParts,
    /// By source: messages that were for it, and the others.
    shares: BTreeMap<(&'static str, usize), Share>,
}

/// The names of a source's message, which mostly are those of the one before.
#[derive(Debug, Clone, Default)]
struct JointNames {
    names: Vec<String>,
    /// Positions of those that some region needs.
    needed: Vec<usize>,
}

impl JointNames {
    /// Takes the names of a message. Returns whether they are others than before.
    fn differ(&mut self, names: &[String], needed: &BTreeSet<String>) -> bool {
        if self.names == names {
            return false;
        }
        names.clone_into(&mut self.names);
        let positions =
            names.iter().enumerate().filter(|(_, name)| needed.contains(*name)).map(|(position, _)| position);
        self.needed = positions.collect();
        true
    }
}

#[derive(Debug)]
enum Role {
    Samples(SampleBinding),
    Truth(usize, Box<TruthBinding>),
    Stage,
}

impl Inputs {
    /// Inputs from these topics of a bag.
    ///
    /// # Errors
    /// [`InputError`] when the bag lacks a topic or has it with another type.
    pub fn new(topics: InputTopics, reader: &mut BagReader) -> Result<Self, InputError> {
        let taxels = topics.taxels.iter().map(|topic| topic.name.as_str());
        let joints = topics.joints.iter().map(|topic| topic.name.as_str());
        let truth = topics.truth.iter().map(|topic| topic.name.as_str());
        let needed: Vec<&str> = taxels.chain(joints).chain(truth).collect();
        reader.watch_order(&needed);
        if let Some(folder) = &topics.message_definitions {
            reader.look_for_definitions_in(folder)?;
        }
        reader.scan(&needed)?;
        for name in &needed {
            reader.required(name)?;
        }
        let angles = topics.joint_sources.iter().map(|source| AngleWatch::new(source.scale)).collect();
        let frames = topics.joints.iter().map(|_| FrameStore::default()).collect();
        let n_joint_sources = topics.joint_sources.len();
        let mut inputs = Inputs {
            topics,
            definitions: reader.definitions().clone(),
            angles,
            joints: vec![JointNames::default(); n_joint_sources],
            roles: BTreeMap::new(),
            counters: BTreeMap::new(),
            joint_names: BTreeSet::new(),
            frames,
            message: MessageParts::default(),
            shares: BTreeMap::new(),
        };
        for channel in reader.channels() {
            inputs.bind(channel)?;
        }
        inputs.keep_static_frames(reader)?;
        Ok(inputs)
    }

    /// The parts of the messages of a channel, each to be given to [`decode`](Self::decode) in turn; none where they mean
    /// nothing here.
    ///
    /// # Errors
    /// [`InputError`] when the channel, not seen before, is of the wrong type.
    pub fn parts(&mut self, channel: &BagChannel) -> Result<Range<usize>, InputError> {
        if !self.roles.contains_key(&channel.id) {
            self.bind(channel)?;
        }
        Ok(0..self.roles.get(&channel.id).map_or(0, |(_, roles)| roles.len()))
    }

    /// Decodes a part of a message. One that can't be read is no error: it is counted, a message once.
    pub fn decode<'a>(&'a mut self, message: &BagMessage<'a>, part: usize) -> Input<'a> {
        let (channel, received) = (message.channel, message.log_time);
        let Some((_, roles)) = self.roles.get_mut(&channel.id) else { return Input::None };
        let n_roles = roles.len();
        let Some(role) = roles.get_mut(part) else { return Input::None };
        let of = role.source();
        let (input, error) = match role {
            Role::Stage => match from_cdr::<Stage>(message.data) {
                Ok(stage) => (Input::Stage(stage), Ok(())),
                Err(error) => (Input::None, Err(Some(("unreadable", error.to_string())))),
            },
            Role::Samples(binding) => match binding.decode(message.data, received) {
                Ok(event) => {
                    if let Event::Joints(sample) = &event {
                        let joints = &mut self.joints[sample.source.position()];
                        if joints.differ(sample.names, &self.topics.needed) {
                            let left = MAX_JOINT_NAMES - self.joint_names.len();
                            let new = sample.names.iter().filter(|name| !self.joint_names.contains(*name));
                            let new: Vec<String> = new.take(left).cloned().collect();
                            self.joint_names.extend(new);
                        }
                        let angles = joints.needed.iter();
                        let angles = angles.map(|idx| (sample.names[*idx].as_str(), sample.positions[*idx]));
                        self.angles[sample.source.position()].handle(angles);
                    }
                    (Input::Event(event), Ok(()))
                }
                Err(error) if error.is_kept() => (Input::None, Ok(())),
                Err(error) => (Input::None, Err(counted(&error, self.shares.entry(of).or_default()))),
            },
            Role::Truth(source, binding) => match binding.decode(message.data, received) {
                Ok((stamp, force)) => (Input::Truth { source: *source, stamp, force }, Ok(())),
                Err(error) => (Input::None, Err(counted(&error, self.shares.entry(of).or_default()))),
            },
        };
        if part == 0 {
            self.message = MessageParts::default();
        }
        let parts = &mut self.message;
        match error {
            Ok(()) => {
                parts.is_for_a_source = true;
                self.shares.entry(of).or_default().n_for_it += 1;
            }
            Err(None) => {}
            Err(Some((reason, text))) => {
                parts.is_for_a_source = true;
                let text = if n_roles > 1 { format!("{}: {text}", of.0) } else { text };
                parts.error.get_or_insert((reason, text));
            }
        }
        if part + 1 == n_roles {
            count(&mut self.counters, &channel.topic, std::mem::take(parts));
        }
        input
    }

    /// Lets a reader pass over what means nothing here. Returns whether something is left out.
    pub fn read_only_these(&self, reader: &mut BagReader) -> bool {
        reader.read_only(&self.topics())
    }

    /// The topics that mean anything here.
    pub fn topics(&self) -> BTreeSet<String> {
        let InputTopics { taxels, joints, truth, stage, .. } = &self.topics;
        let names = taxels.iter().map(|topic| &topic.name).chain(joints.iter().map(|topic| &topic.name));
        let frames = joints.iter().filter_map(static_topic);
        names.chain(truth.iter().map(|topic| &topic.name)).chain([stage]).cloned().chain(frames).collect()
    }

    /// Annotations that were told beside the bag; no message is one then.
    pub fn told(&self) -> Option<&[Stage]> {
        self.topics.told.as_deref()
    }

    /// Whether some channel carries stage annotations, or they were told beside the bag.
    pub fn has_annotations(&self) -> bool {
        let roles = || self.roles.values().flat_map(|(_, roles)| roles);
        self.topics.told.is_some() || roles().any(|role| matches!(role, Role::Stage))
    }

    /// Counts of the messages of each topic that feeds the core.
    pub fn counters(&self) -> BTreeMap<String, TopicCounters> {
        let mut counters = self.counters.clone();
        for (topic, roles) in self.roles.values() {
            let restarts = roles.iter().map(Role::clock_restarts).max().unwrap_or_default();
            if let Some(counters) = counters.get_mut(topic).filter(|_| restarts > 0) {
                counters.clock_restarts += restarts;
            }
        }
        counters
    }

    /// Meaning of the log times of the bags: the age of data only where a live node recorded all that feeds the core.
    pub fn receipts(&self, reader: &BagReader) -> Receipts {
        let InputTopics { taxels, joints, .. } = &self.topics;
        let names = || taxels.iter().map(|topic| &topic.name).chain(joints.iter().map(|topic| &topic.name));
        let mut feeding = reader.channels().iter().filter(|channel| names().any(|name| *name == channel.topic));
        if feeding.all(is_live) { Receipts::Live } else { Receipts::Unknown }
    }

    /// Whether some message of some topic could not be read.
    pub fn has_unreadable(&self) -> bool {
        self.counters.values().any(|counters| counters.first_error.is_some())
    }

    /// Doubts about the unit of joint angles, once a bag has been read: degrees where the parameters say radians, or
    /// the other way round. Each text is one line that names the parameter.
    pub fn angle_doubts(&self) -> Vec<String> {
        let sources = self.topics.joint_sources.iter().zip(&self.angles);
        sources.filter_map(|(source, angles)| angles.doubt(&format!("joint.{}", source.name))).collect()
    }

    /// Checks, once a bag has been read, that each tactile topic gave something and that no joint was absent.
    ///
    /// # Errors
    /// [`InputError::NoMessages`], [`InputError::NothingRead`], [`InputError::NothingForSource`],
    /// [`InputError::MissingJoints`].
    pub fn check_end<'n>(&self, missing_joints: impl Iterator<Item = &'n str>) -> Result<(), InputError> {
        let InputTopics { taxels, joints, truth, .. } = &self.topics;
        let names = taxels.iter().map(|topic| &topic.name).chain(joints.iter().map(|topic| &topic.name));
        let mut shares = self.shares.iter();
        if let Some(((what, source), share)) = shares.find(|(_, share)| share.n_for_it == 0 && share.n_others > 0) {
            let topic = match *what {
                TAXELS => taxels.get(*source).map(|topic| &topic.name),
                ANGLES => joints.get(*source).map(|topic| &topic.name),
                _ => truth.get(*source).map(|topic| &topic.name),
            };
            let (messages, first) = (share.n_others, share.first_other.clone());
            return Err(InputError::NothingForSource {
                topic: topic.cloned().unwrap_or_default(),
                what,
                messages,
                first,
            });
        }
        for topic in names.chain(truth.iter().map(|topic| &topic.name)) {
            let counters = self.counters.get(topic).cloned().unwrap_or_default();
            if counters.read == 0 {
                let messages = counters.unreadable.values().sum();
                let topic = topic.clone();
                return Err(match counters.first_error {
                    Some(first) => InputError::NothingRead { topic, messages, first },
                    None => InputError::NoMessages { topic },
                });
            }
        }
        let missing: Vec<String> = missing_joints.map(str::to_owned).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let topics = self.topics.joints.iter().map(|topic| topic.name.clone()).collect();
        Err(InputError::MissingJoints {
            missing,
            topics,
            seen: self.joint_names.iter().map(|name| one_line(name)).collect(),
        })
    }

    fn bind(&mut self, channel: &BagChannel) -> Result<(), InputError> {
        let mut roles = Vec::new();
        for (source, topic) in self.topics.taxels.iter().enumerate().filter(|(_, topic)| topic.name == channel.topic) {
            let binding = TaxelBinding::compile(&topic.fields, &self.tree_of(channel, &topic.type_name)?);
            let binding = Box::new(binding.map_err(|error| binding_error(channel, error))?);
            roles.push(Role::Samples(SampleBinding::Taxels(TactileSourceIdx::at(source), binding)));
        }
        for (source, topic) in self.topics.joints.iter().enumerate().filter(|(_, topic)| topic.name == channel.topic) {
            let tree = self.tree_of(channel, &topic.type_name)?;
            let binding = JointBinding::compile_with(&topic.fields, &tree, &self.frames[source]);
            let binding = Box::new(binding.map_err(|error| binding_error(channel, error))?);
            roles.push(Role::Samples(SampleBinding::Joints(JointSourceIdx::at(source), binding)));
        }
        let tells_frames = |topic: &Topic<JointFields>| static_topic(topic).as_ref() == Some(&channel.topic);
        for (source, topic) in self.topics.joints.iter().enumerate().filter(|(_, topic)| tells_frames(topic)) {
            let tree = self.tree_of(channel, &topic.type_name)?;
            let binding = FramesBinding::compile(&topic.fields, &tree, &self.frames[source]);
            let binding = binding.map_err(|error| binding_error(channel, error))?;
            roles.push(Role::Samples(SampleBinding::Frames(JointSourceIdx::at(source), binding)));
        }
        for (source, topic) in self.topics.truth.iter().enumerate().filter(|(_, topic)| topic.name == channel.topic) {
            let binding = TruthBinding::compile(&topic.fields, &self.tree_of(channel, &topic.type_name)?);
            let binding = Box::new(binding.map_err(|error| binding_error(channel, error))?);
            roles.push(Role::Truth(source, binding));
        }
        let is_told = self.topics.told.is_some();
        if roles.is_empty() && !is_told && channel.topic == self.topics.stage && is_stage(channel) {
            roles.push(Role::Stage);
        }
        self.roles.insert(channel.id, (channel.topic.clone(), roles));
        Ok(())
    }

    /// The type of a channel's messages, by its own definition.
    fn tree_of(&self, channel: &BagChannel, expected: &str) -> Result<TypeTree, InputError> {
        let topic = || channel.topic.clone();
        let differs = |got: String| InputError::Type { topic: topic(), expected: expected.to_owned(), got };
        let schema = channel.schema.as_ref().ok_or_else(|| differs("without a schema".to_owned()))?;
        let type_name = canonical_type_name(&schema.name);
        if type_name != expected {
            return Err(differs(one_line(&type_name)));
        }
        let tree = schema.tree(&self.definitions);
        tree.map_err(|error| InputError::Definition { topic: topic(), error: Box::new(error) })
    }
}

const TAXELS: &str = "taxels";
const ANGLES: &str = "joint angles";

impl Role {
    /// The kind of its source, and the index of that source among those of the kind.
    fn source(&self) -> (&'static str, usize) {
        match self {
            Role::Samples(SampleBinding::Taxels(source, _)) => (TAXELS, source.position()),
            Role::Samples(SampleBinding::Joints(source, _)) => (ANGLES, source.position()),
            Role::Samples(SampleBinding::Frames(source, _)) => ("frames", source.position()),
            Role::Truth(source, _) => ("true force", *source),
            Role::Stage => ("stage", 0),
        }
    }

    fn clock_restarts(&self) -> u64 {
        match self {
            Role::Samples(binding) => binding.clock_restarts(),
            Role::Truth(_, binding) => binding.clock_restarts(),
            Role::Stage => 0,
        }
    }
}

/// Whether a live node recorded it.
fn is_live(channel: &Arc<BagChannel>) -> bool {
    channel.metadata.get(RECEIPTS_KEY).is_some_and(|note| note == RECEIPTS_LIVE)
}

fn binding_error(channel: &BagChannel, error: BindingError) -> InputError {
    InputError::Binding { topic: channel.topic.clone(), error: Box::new(error) }
}

fn is_stage(channel: &BagChannel) -> bool {
    channel.schema.as_ref().is_some_and(|schema| canonical_type_name(&schema.name) == Stage::TYPE_NAME)
}
