//! A bag in one pass, in memory that grows with the number of topics alone.

use std::collections::BTreeMap;

use super::taxel_means::Skin;
use super::topic::Topic;
use crate::bag::{BagChannel, BagMessage, BagStats};
use crate::msg::canonical_type_name;
use crate::msg::definition::Definitions;

/// Name, type and encoding of a topic.
pub(super) type Key = (String, String, String);

pub(super) fn key_of(topic: &str, type_name: &str, encoding: &str) -> Key {
    let type_name = if type_name.is_empty() { String::new() } else { canonical_type_name(type_name) };
    (topic.to_owned(), type_name, encoding.to_owned())
}

/// Topics that are told of. A robot has some hundred; a hostile bag may have millions.
const MAX_TOPICS: usize = 4096;

/// Limits of all topics together: bytes of definitions that are read, and fields with numbers that are looked at.
const MAX_DEFINITION_BYTES: usize = 64 << 20;
const MAX_FIELDS: usize = 300_000;

/// Statistics and topics that are gathered while messages come.
#[derive(Default)]
pub(super) struct Gather {
    pub(super) stats: BagStats,
    /// Where types that the bag doesn't define are looked for.
    definitions: Definitions,
    /// The same of the stamps, as if they were log times.
    pub(super) stamps: BagStats,
    pub(super) topics: Vec<Topic>,
    pub(super) by_key: BTreeMap<Key, usize>,
    /// Place in `topics` of each channel, by its id; `None` of those that are not told of.
    by_channel: BTreeMap<usize, Option<usize>>,
    pub(super) n_more_topics: usize,
    /// Messages of those.
    pub(super) n_more_messages: u64,
    definition_bytes: usize,
    n_fields: usize,
    /// The newest of arrays that are named as taxels are.
    pub(super) skins: Vec<Skin>,
}

impl Gather {
    /// Nothing yet; types that the bag doesn't define will be looked for among `definitions`.
    pub(super) fn new(definitions: Definitions) -> Self {
        Gather { definitions, ..Gather::default() }
    }

    /// Place of the topic of a channel; `None` where it is not told of.
    pub(super) fn topic(&mut self, channel: &BagChannel) -> Option<usize> {
        if let Some(&idx) = self.by_channel.get(&channel.id) {
            return idx;
        }
        let key = key_of(&channel.topic, channel.type_name(), &channel.message_encoding);
        let known = self.by_key.get(&key).copied();
        let idx = known.or_else(|| {
            if self.topics.len() == MAX_TOPICS {
                self.n_more_topics += 1; // as often as it is defined anew
                return None;
            }
            let topic = self.look_into(channel);
            self.topics.push(topic);
            self.by_key.insert(key, self.topics.len() - 1);
            Some(self.topics.len() - 1)
        });
        self.by_channel.insert(channel.id, idx);
        idx
    }

    /// The topic of a channel, looked into as long as the topics before it have left anything to spend on that.
    fn look_into(&mut self, channel: &BagChannel) -> Topic {
        let len = channel.schema.as_ref().map_or(0, |schema| schema.data.len());
        self.definition_bytes = self.definition_bytes.saturating_add(len);
        if self.definition_bytes > MAX_DEFINITION_BYTES || self.n_fields > MAX_FIELDS {
            return Topic::unseen(channel, "the definitions of the other topics are too long to look into this one");
        }
        let topic = Topic::new(channel, &self.definitions);
        self.n_fields += topic.look.as_ref().map_or(0, |look| look.numeric.len());
        topic
    }

    /// Takes in a message.
    pub(super) fn handle(&mut self, message: &BagMessage<'_>) {
        let Some(idx) = self.topic(message.channel) else {
            self.n_more_messages += 1;
            return;
        };
        self.stats.handle_message(message);
        if let Some(stamp) = self.topics[idx].handle(message) {
            self.stamps.handle_message(&BagMessage { log_time: stamp, ..*message });
        }
        self.topics[idx].follow(idx, message.data, &mut self.skins);
    }
}
