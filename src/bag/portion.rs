//! Records that outlive their reader's buffers, so that another thread can go on with them.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use super::{BagAttachment, BagChannel, BagMessage, BagMetadata, BagRecord};
use crate::units::Stamp;

/// Consecutive records of a bag, their bytes in one buffer.
#[derive(Debug, Default)]
pub struct Portion {
    records: Vec<Kept>,
    channels: Vec<Arc<BagChannel>>,
    bytes: Vec<u8>,
}

#[derive(Debug)]
enum Kept {
    Message { channel: usize, log_time: Stamp, publish_time: Stamp, sequence: u32, data: Range<usize> },
    Attachment { log_time: u64, create_time: u64, name: String, media_type: String, data: Range<usize> },
    Metadata { name: String, metadata: BTreeMap<String, String> },
}

impl Portion {
    /// Appends a copy of a record.
    pub fn push(&mut self, record: &BagRecord<'_>) {
        let kept = match *record {
            BagRecord::Message(BagMessage { channel, log_time, publish_time, sequence, data }) => {
                let (channel, data) = (self.place(channel), self.copy(data));
                Kept::Message { channel, log_time, publish_time, sequence, data }
            }
            BagRecord::Attachment(BagAttachment { log_time, create_time, name, media_type, data }) => {
                let (name, media_type, data) = (name.to_owned(), media_type.to_owned(), self.copy(data));
                Kept::Attachment { log_time, create_time, name, media_type, data }
            }
            BagRecord::Metadata(BagMetadata { name, metadata }) => {
                Kept::Metadata { name: name.to_owned(), metadata: metadata.clone() }
            }
        };
        self.records.push(kept);
    }

    /// The records, in the order of the bag.
    pub fn records(&self) -> impl Iterator<Item = BagRecord<'_>> {
        self.records.iter().map(|kept| match kept {
            Kept::Message { channel, log_time, publish_time, sequence, data } => BagRecord::Message(BagMessage {
                channel: &self.channels[*channel],
                log_time: *log_time,
                publish_time: *publish_time,
                sequence: *sequence,
                data: &self.bytes[data.clone()],
            }),
            Kept::Attachment { log_time, create_time, name, media_type, data } => {
                let (log_time, create_time, data) = (*log_time, *create_time, &self.bytes[data.clone()]);
                BagRecord::Attachment(BagAttachment { log_time, create_time, name, media_type, data })
            }
            Kept::Metadata { name, metadata } => BagRecord::Metadata(BagMetadata { name, metadata }),
        })
    }

    /// Number of records.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// Whether it holds none.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Size of the records' data.
    pub fn n_bytes(&self) -> usize {
        self.bytes.len()
    }

    fn place(&mut self, channel: &Arc<BagChannel>) -> usize {
        let known = self.channels.iter().position(|known| Arc::ptr_eq(known, channel));
        known.unwrap_or_else(|| {
            self.channels.push(Arc::clone(channel));
            self.channels.len() - 1
        })
    }

    fn copy(&mut self, data: &[u8]) -> Range<usize> {
        let begin = self.bytes.len();
        self.bytes.extend_from_slice(data);
        begin..self.bytes.len()
    }
}
