//! Outputs of earlier replays, which need not be written again.

use std::path::{Path, PathBuf};

use super::ReplayError;
use crate::bag::{BagError, BagReader};
use crate::config::Config;
use crate::location;
use crate::msg::EstimateTopics;

/// Whether `output` is there already: a whole bag with the topics that a replay with these parameters writes.
///
/// A replay gives its output its name when it is whole, so only the end of the bag is looked at. Which bag and model it
/// was made of is not known.
///
/// # Errors
/// [`ReplayError`] when something else is there: no bag, a bag that is cut off, or one without these topics.
pub fn is_there(cfg: &Config, output: &Path) -> Result<bool, ReplayError> {
    let path = || PathBuf::from(output);
    if !location::exists(output).map_err(|source| BagError::Io { path: path(), action: "open", source })? {
        return Ok(false);
    }
    let reader = BagReader::open(&[path()])?;
    let summary = reader.summary();
    if !summary.lists_channels || summary.n_messages.is_none() {
        return Err(ReplayError::NotWhole { path: path() });
    }
    let topics = EstimateTopics::of_node(&cfg.node.to_string(), cfg.fusion());
    let channels = reader.channels();
    match topics.names().find(|name| !channels.iter().any(|channel| channel.topic == *name)) {
        Some(topic) => Err(ReplayError::OtherTopics { path: path(), topic: topic.to_owned() }),
        None => Ok(true),
    }
}
