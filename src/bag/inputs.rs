//! Which topics of a bag feed the core, and how their messages become events.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::error::one_line;
use super::{BagChannel, BagError, BagMessage, BagReader};
use crate::fusion::{Event, JointSourceIdx, TactileSourceIdx};
use crate::msg::binding::{
    BindingError, JointBinding, JointFields, SampleBinding, TaxelBinding, TaxelFields, Topic, TruthBinding, TruthFields,
};
use crate::msg::definition::{DefinitionError, TypeTree};
use crate::msg::{Stage, WireType, canonical_type_name, from_cdr};
use crate::units::Stamp;

/// Most joint names that are kept for the error that lists them; two hands have 50.
const MAX_JOINT_NAMES: usize = 128;

/// The topics that feed the core, in the order of the sources in its configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputTopics {
    /// One a tactile source.
    pub taxels: Vec<Topic<TaxelFields>>,
    /// One a joint source.
    pub joints: Vec<Topic<JointFields>>,
    /// One a source of true force; empty where none is asked for.
    pub truth: Vec<Topic<TruthFields>>,
    /// Name of the topic with stage annotations, which a bag may lack.
    pub stage: String,
}

/// What a message is to the core, or to who judges it.
#[derive(Debug, Clone)]
pub enum Input<'a> {
    /// A sample.
    Event(Event<'a>),
    /// What a force sensor measured.
    Truth {
        /// Index of the source in [`InputTopics::truth`].
        source: usize,
        /// When it was measured.
        stamp: Stamp,
        /// The force as it was sent, in the unit and with the sign of the source.
        force: f64,
    },
    /// What the protocol asks for from the stamp of its header on: among others, that nothing touches the glove.
    Stage(Stage),
    /// Nothing: another topic, or a message that could not be read and is counted.
    None,
}

/// What came on a topic that feeds the core.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct TopicCounters {
    /// Messages that became events.
    pub read: u64,
    /// Messages that didn't, by reason.
    pub unreadable: BTreeMap<&'static str, u64>,
    /// What was wrong with the first of those.
    pub first_error: Option<String>,
}

/// Why a bag can't feed the core. Each text is one line that names the topic.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum InputError {
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error("topic {topic} is {got}, the parameters say {expected}; set the type of this source")]
    Type { topic: String, expected: String, got: String },
    #[error(
        "topic {topic}: the schema of {type_name} is {got}, only ros2msg can be read by field path; record with ros2msg schemas"
    )]
    SchemaEncoding { topic: String, type_name: String, got: String },
    #[error("topic {topic}: {error}")]
    Definition { topic: String, error: Box<DefinitionError> },
    #[error("topic {topic}: {error}")]
    Binding { topic: String, error: Box<BindingError> },
    #[error("topic {topic}: none of its {messages} messages could be read: {first}")]
    NothingRead { topic: String, messages: u64, first: String },
    #[error("topic {topic} has no messages in this bag; its source in the parameters needs some")]
    NoMessages { topic: String },
    #[error(
        "joints {missing:?} are in no message of {topics:?}, which name {seen:?}; correct region.*.joints or the joint source"
    )]
    MissingJoints { missing: Vec<String>, topics: Vec<String>, seen: Vec<String> },
}

/// Turns the messages of bags into events: one binding a channel, because bags of one recording may differ in schema.
#[derive(Debug)]
pub struct Inputs {
    topics: InputTopics,
    roles: BTreeMap<usize, Role>,
    counters: BTreeMap<String, TopicCounters>,
    joint_names: BTreeSet<String>,
}

#[derive(Debug)]
enum Role {
    Other,
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
        reader.scan(&needed)?;
        for name in &needed {
            reader.required(name)?;
        }
        let mut inputs =
            Inputs { topics, roles: BTreeMap::new(), counters: BTreeMap::new(), joint_names: BTreeSet::new() };
        for channel in reader.channels() {
            inputs.bind(channel)?;
        }
        Ok(inputs)
    }

    /// What a message is to the core.
    ///
    /// # Errors
    /// [`InputError`] when its channel, not seen before, is of the wrong type. A single message that can't be read is
    /// no error: it is counted.
    pub fn decode<'a>(&'a mut self, message: &BagMessage<'a>) -> Result<Input<'a>, InputError> {
        let channel = message.channel;
        if !self.roles.contains_key(&channel.id) {
            self.bind(channel)?;
        }
        let received = message.log_time;
        let role = self.roles.get_mut(&channel.id);
        let (input, error) = match role {
            None | Some(Role::Other) => return Ok(Input::None),
            Some(Role::Stage) => match from_cdr::<Stage>(message.data) {
                Ok(stage) => (Input::Stage(stage), None),
                Err(error) => (Input::None, Some(("unreadable", error.to_string()))),
            },
            Some(Role::Samples(binding)) => match binding.decode(message.data, received) {
                Ok(event) => {
                    let names = if let Event::Joints(sample) = &event { sample.names } else { &[] };
                    for name in names {
                        if self.joint_names.len() < MAX_JOINT_NAMES && !self.joint_names.contains(name) {
                            self.joint_names.insert(name.clone());
                        }
                    }
                    (Input::Event(event), None)
                }
                Err(error) => (Input::None, Some((error.reason(), error.to_string()))),
            },
            Some(Role::Truth(source, binding)) => match binding.decode(message.data, received) {
                Ok((stamp, force)) => (Input::Truth { source: *source, stamp, force }, None),
                Err(error) => (Input::None, Some((error.reason(), error.to_string()))),
            },
        };
        count(&mut self.counters, &channel.topic, error);
        Ok(input)
    }

    /// The topics that mean anything here.
    pub fn topics(&self) -> BTreeSet<String> {
        let InputTopics { taxels, joints, truth, stage } = &self.topics;
        let names = taxels.iter().map(|topic| &topic.name).chain(joints.iter().map(|topic| &topic.name));
        names.chain(truth.iter().map(|topic| &topic.name)).chain([stage]).cloned().collect()
    }

    /// Whether some channel carries stage annotations.
    pub fn has_annotations(&self) -> bool {
        self.roles.values().any(|role| matches!(role, Role::Stage))
    }

    /// What came on each topic that feeds the core.
    pub fn counters(&self) -> &BTreeMap<String, TopicCounters> {
        &self.counters
    }

    /// Whether some message of some topic could not be read.
    pub fn has_unreadable(&self) -> bool {
        self.counters.values().any(|counters| counters.first_error.is_some())
    }

    /// Checks, once a bag has been read, that each tactile topic gave something and that no joint was absent.
    ///
    /// # Errors
    /// [`InputError::NoMessages`], [`InputError::NothingRead`], [`InputError::MissingJoints`].
    pub fn check_end<'n>(&self, missing_joints: impl Iterator<Item = &'n str>) -> Result<(), InputError> {
        let InputTopics { taxels, joints, truth, .. } = &self.topics;
        let names = taxels.iter().map(|topic| &topic.name).chain(joints.iter().map(|topic| &topic.name));
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
        let taxels = self.topics.taxels.iter().position(|topic| topic.name == channel.topic);
        let joints = self.topics.joints.iter().position(|topic| topic.name == channel.topic);
        let truth = self.topics.truth.iter().position(|topic| topic.name == channel.topic);
        let type_name = channel.schema.as_ref().map(|schema| canonical_type_name(&schema.name)).unwrap_or_default();
        let role = match (taxels, joints, truth) {
            (Some(source), ..) => {
                let topic = &self.topics.taxels[source];
                let tree = tree_of(channel, &topic.type_name)?;
                let binding = TaxelBinding::compile(&topic.fields, &tree);
                let binding = binding.map_err(|error| binding_error(channel, error))?;
                Role::Samples(SampleBinding::Taxels(TactileSourceIdx(source), Box::new(binding)))
            }
            (None, Some(source), _) => {
                let topic = &self.topics.joints[source];
                let tree = tree_of(channel, &topic.type_name)?;
                let binding = JointBinding::compile(&topic.fields, &tree);
                let binding = binding.map_err(|error| binding_error(channel, error))?;
                Role::Samples(SampleBinding::Joints(JointSourceIdx(source), Box::new(binding)))
            }
            (None, None, Some(source)) => {
                let topic = &self.topics.truth[source];
                let tree = tree_of(channel, &topic.type_name)?;
                let binding = TruthBinding::compile(&topic.fields, &tree);
                let binding = binding.map_err(|error| binding_error(channel, error))?;
                Role::Truth(source, Box::new(binding))
            }
            _ if channel.topic == self.topics.stage && type_name == Stage::TYPE_NAME => Role::Stage,
            _ => Role::Other,
        };
        self.roles.insert(channel.id, role);
        Ok(())
    }
}

/// Counts a message that was read, or the reason and the text of why it wasn't.
fn count(counters: &mut BTreeMap<String, TopicCounters>, topic: &str, error: Option<(&'static str, String)>) {
    if !counters.contains_key(topic) {
        counters.insert(topic.to_owned(), TopicCounters::default());
    }
    let Some(counters) = counters.get_mut(topic) else { return };
    match error {
        None => counters.read += 1,
        Some((reason, text)) => {
            *counters.unreadable.entry(reason).or_default() += 1;
            counters.first_error.get_or_insert(text);
        }
    }
}

fn tree_of(channel: &BagChannel, expected: &str) -> Result<TypeTree, InputError> {
    let topic = || channel.topic.clone();
    let Some(schema) = &channel.schema else {
        return Err(InputError::Type { topic: topic(), expected: expected.to_owned(), got: "without a schema".into() });
    };
    let type_name = canonical_type_name(&schema.name);
    if type_name != expected {
        return Err(InputError::Type { topic: topic(), expected: expected.to_owned(), got: one_line(&type_name) });
    }
    if schema.encoding != "ros2msg" {
        return Err(InputError::SchemaEncoding { topic: topic(), type_name, got: one_line(&schema.encoding) });
    }
    let text = String::from_utf8_lossy(&schema.data);
    TypeTree::from_schema(&type_name, &text)
        .map_err(|error| InputError::Definition { topic: topic(), error: Box::new(error) })
}

fn binding_error(channel: &BagChannel, error: BindingError) -> InputError {
    InputError::Binding { topic: channel.topic.clone(), error: Box::new(error) }
}
