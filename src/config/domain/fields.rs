//! Parameters of all kinds of sources: stamps, field paths, times.

use super::super::error::ConfigError;
use super::reader::Reader;
use crate::msg::binding::{Since, StampFrom, StampUnit};
use crate::msg::dynamic::check_condition;

/// Value of a stamp parameter for the time of receipt.
pub(super) const RECEIPT: &str = "receipt";

/// Reads the source of a stamp. The default is the header's stamp.
pub(super) fn stamp(reader: &Reader<'_>, key: &impl Fn(&str) -> String) -> Result<StampFrom, ConfigError> {
    stamp_or(reader, key, "header.stamp")
}

/// Reads the source of a stamp with another default path.
pub(super) fn stamp_or(
    reader: &Reader<'_>,
    key: &impl Fn(&str) -> String,
    default: &str,
) -> Result<StampFrom, ConfigError> {
    let stamp_key = key("stamp");
    let unit = match reader.text(&key("stamp_unit"))?.as_str() {
        "s" => Some(StampUnit::Seconds),
        "ms" => Some(StampUnit::Millis),
        "us" => Some(StampUnit::Micros),
        "ns" => Some(StampUnit::Nanos),
        _ => None,
    };
    let since = match reader.text(&key("stamp_since"))?.as_str() {
        "boot" => Since::Boot,
        _ => Since::Epoch,
    };
    if reader.is_set(&stamp_key) && reader.text(&stamp_key)? == RECEIPT {
        let wrong = [("stamp_unit", unit.is_some()), ("stamp_since", since == Since::Boot)];
        return match wrong.into_iter().find(|(_, is_set)| *is_set) {
            Some((tail, _)) => {
                Err(reader.refused(&key(tail), format!("is for stamps in the messages, and {stamp_key} is receipt")))
            }
            None => Ok(StampFrom::Receipt),
        };
    }
    let path = match reader.is_set(&stamp_key) {
        false => default.to_owned(),
        true => reader.field(&stamp_key)?,
    };
    Ok(match (unit, since) {
        (None, Since::Epoch) => StampFrom::Field(path),
        (None, Since::Boot) => StampFrom::SinceBoot(path),
        (Some(unit), since) => StampFrom::Number { path, unit, since },
    })
}

/// Condition that selects the messages of a source, such as `side=Left`.
pub(super) fn only(reader: &Reader<'_>, key: &impl Fn(&str) -> String) -> Result<Option<String>, ConfigError> {
    let key = key("only");
    let Some(text) = reader.non_empty(&key)? else { return Ok(None) };
    match check_condition(&text) {
        Ok(()) => Ok(Some(text)),
        Err(_) => Err(reader.refused(&key, "is not a field and its value, such as side=Left or hand=1")),
    }
}

/// A field path. `None` if it is not set, `Some(None)` if it is set to an empty string.
pub(super) fn optional_field(reader: &Reader<'_>, key: &str) -> Result<Option<Option<String>>, ConfigError> {
    match reader.is_set(key) {
        false => Ok(None),
        true if reader.text(key)?.is_empty() => Ok(Some(None)),
        true => Ok(Some(Some(reader.field(key)?))),
    }
}

pub(super) fn field_or(reader: &Reader<'_>, key: &str, known: Option<&str>) -> Result<String, ConfigError> {
    match known {
        Some(known) if !reader.is_set(key) => Ok(known.to_owned()),
        _ => reader.field(key),
    }
}

/// Milliseconds to nanoseconds. The ranges in the table exclude an overflow.
pub(super) fn millis_to_ns(ms: f64) -> i64 {
    (ms * 1e6).round() as i64
}
