//! Views of topics, in which candidates are found.

use super::stamps::StampStats;
use super::topic::{Look, Topic};
use crate::bag::TopicStats;

/// All that is known of a topic that could be looked into.
#[derive(Debug, Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) topic: &'a Topic,
    pub(super) look: &'a Look,
    /// By log time; absent where there is no message.
    pub(super) stats: Option<&'a TopicStats>,
    pub(super) stamps: Option<&'a StampStats>,
}
