//! Everything that an input holds, into the output as it is.

use std::collections::BTreeMap;

use super::{BagError, BagRecord, BagWriter, OutChannel};

/// Copies records from bags to a bag: messages byte for byte, with their channels, attachments and notes.
#[derive(Debug, Default)]
pub struct PassThrough {
    channels: BTreeMap<usize, OutChannel>,
}

impl PassThrough {
    /// Copies a record.
    ///
    /// # Errors
    /// [`BagError`] when the bag can't be written.
    pub fn copy(&mut self, record: &BagRecord<'_>, bag: &mut BagWriter) -> Result<(), BagError> {
        match record {
            BagRecord::Message(message) => {
                let channel = match self.channels.get(&message.channel.id) {
                    Some(&channel) => channel,
                    None => {
                        let channel = bag.copy_channel(message.channel)?;
                        self.channels.insert(message.channel.id, channel);
                        channel
                    }
                };
                bag.write(channel, message.sequence, message.log_time, message.publish_time, message.data)
            }
            BagRecord::Attachment(attachment) => bag.copy_attachment(attachment),
            BagRecord::Metadata(notes) => bag.copy_metadata(notes),
        }
    }
}
