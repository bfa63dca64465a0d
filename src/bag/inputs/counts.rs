//! Counts of the messages of a bag, read and unreadable.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::msg::binding::SampleError;

/// Counts of the messages of a topic that feeds the core.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct TopicCounters {
    /// Messages that were read, as everything that the parameters say is in them.
    pub read: u64,
    /// Messages that weren't, by reason.
    pub unreadable: BTreeMap<&'static str, u64>,
    /// The error of the first of those.
    pub first_error: Option<String>,
    /// Messages that are not for any source: `only` asks for others.
    #[serde(skip_serializing_if = "is_zero")]
    pub not_for_source: u64,
    /// How often the device's clock was set or started anew, where stamps count from its start.
    #[serde(skip_serializing_if = "is_zero")]
    pub clock_restarts: u64,
}

fn is_zero(n: &u64) -> bool {
    *n == 0
}

/// Findings in the parts of a message.
#[derive(Debug, Default)]
pub(super) struct MessageParts {
    pub(super) is_for_a_source: bool,
    pub(super) error: Option<(&'static str, String)>,
}

/// A source's share of the messages of its topic.
#[derive(Debug, Default)]
pub(super) struct Share {
    pub(super) n_for_it: u64,
    pub(super) n_others: u64,
    /// The reason why the first of the others is not for this source.
    pub(super) first_other: String,
}

/// The reason and the text of an error that is to be counted; none where the message is for another source.
pub(super) fn counted(error: &SampleError, share: &mut Share) -> Option<(&'static str, String)> {
    if !error.is_for_another() {
        share.n_for_it += 1;
        return Some((error.reason(), error.to_string()));
    }
    share.n_others += 1;
    if share.n_others == 1 {
        share.first_other = error.to_string();
    }
    None
}

/// Counts a message by what was found in its parts.
pub(super) fn count(counters: &mut BTreeMap<String, TopicCounters>, topic: &str, message: MessageParts) {
    if !counters.contains_key(topic) {
        counters.insert(topic.to_owned(), TopicCounters::default());
    }
    let Some(counters) = counters.get_mut(topic) else { return };
    match message.error {
        Some((reason, text)) => {
            *counters.unreadable.entry(reason).or_default() += 1;
            counters.first_error.get_or_insert(text);
        }
        None if message.is_for_a_source => counters.read += 1,
        None => counters.not_for_source += 1,
    }
}
