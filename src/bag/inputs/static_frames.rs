//! Frames that don't change, which are read before the first message.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::{BagChannel, BagReader, InputError, Inputs, binding_error, is_live};
use crate::msg::binding::{FramesBinding, static_topic};

impl Inputs {
    /// Keeps the frames that don't change, wherever the bag has them: they hold from its first message on. Where a live node
    /// recorded them, they hold from when it received them, as they did there.
    pub(super) fn keep_static_frames(&mut self, reader: &BagReader) -> Result<(), InputError> {
        let topics: BTreeSet<String> = self.topics.joints.iter().filter_map(static_topic).collect();
        let is_it = |channel: &&Arc<BagChannel>| topics.contains(&channel.topic) && !is_live(channel);
        let channels: Vec<&Arc<BagChannel>> = reader.channels().iter().filter(is_it).collect();
        if channels.is_empty() {
            return Ok(());
        }
        let stated = |channel: &&Arc<BagChannel>| reader.summary().by_channel.get(&channel.id).copied();
        let mut n_left: Option<u64> = channels.iter().map(stated).sum();
        for path in reader.files() {
            let mut file = BagReader::open(&[path.to_path_buf()])?;
            while n_left != Some(0)
                && let Some(message) = file.next_message()?
            {
                if !topics.contains(&message.channel.topic) || is_live(message.channel) {
                    continue;
                }
                n_left = n_left.map(|n| n.saturating_sub(1));
                for (source, topic) in self.topics.joints.iter().enumerate() {
                    if static_topic(topic).as_ref() != Some(&message.channel.topic) {
                        continue;
                    }
                    let tree = self.tree_of(message.channel, &topic.type_name)?;
                    let binding = FramesBinding::compile(&topic.fields, &tree, &self.frames[source]);
                    let mut binding = binding.map_err(|error| binding_error(message.channel, error))?;
                    let _ = binding.keep(message.data); // what can't be read is counted when its turn comes
                }
            }
        }
        Ok(())
    }
}
