//! Heads of records: all of a record but the bytes that it carries.

use std::collections::BTreeMap;
use std::ops::Range;

use super::fields::Fields;
use crate::units::Stamp;

/// Channel, sequence and the two times stand in front of a message's bytes.
pub(super) const MESSAGE_HEAD_LEN: usize = 2 + 4 + 8 + 8;

/// The head of a message.
#[derive(Debug, Clone, Copy)]
pub(super) struct MessageHead {
    pub(super) sequence: u32,
    pub(super) log_time: Stamp,
    pub(super) publish_time: Stamp,
}

/// A record that the caller sees; what it carries stands in the body that was read with it.
#[derive(Debug)]
pub(super) enum Head {
    Message { channel: usize, message: MessageHead },
    Attachment { log_time: u64, create_time: u64, name: String, media_type: String, data: Range<usize> },
    Metadata { name: String, metadata: BTreeMap<String, String> },
}

/// The file's id of the message's channel, and its head.
pub(super) fn message(body: &[u8]) -> Result<(u16, MessageHead), String> {
    let mut fields = Fields(body);
    let parsed = (|| Some((fields.u16()?, fields.u32()?, fields.u64()?, fields.u64()?)))();
    let Some((channel, sequence, log_time, publish_time)) = parsed else {
        return Err("a message is malformed and not read".to_owned());
    };
    let Ok(log_time_ns) = i64::try_from(log_time) else {
        return Err(format!("a message of log time {log_time} ns, which no clock reaches, is not read"));
    };
    // Some recorders don't set the publish time and leave what was there.
    let publish_time = Stamp(i64::try_from(publish_time).unwrap_or(i64::MAX));
    Ok((channel, MessageHead { sequence, log_time: Stamp(log_time_ns), publish_time }))
}

pub(super) fn attachment(body: &[u8]) -> Option<Head> {
    let mut fields = Fields(body);
    let (log_time, create_time) = (fields.u64()?, fields.u64()?);
    let (name, media_type) = (fields.string()?, fields.string()?);
    let len = usize::try_from(fields.u64()?).ok()?;
    let start = body.len() - fields.0.len();
    fields.bytes(len)?;
    let _crc = fields.u32()?;
    Some(Head::Attachment { log_time, create_time, name, media_type, data: start..start + len })
}

pub(super) fn metadata(body: &[u8]) -> Option<Head> {
    let mut fields = Fields(body);
    Some(Head::Metadata { name: fields.string()?, metadata: fields.string_map()? })
}
