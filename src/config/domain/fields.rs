//! Parameters that sources of every kind have: stamps, paths of fields, times.

use super::super::error::ConfigError;
use super::reader::Reader;
use crate::msg::binding::StampFrom;

/// The value of a stamp that is the time of receipt.
pub(super) const RECEIPT: &str = "receipt";

/// A stamp whose default is the header's.
pub(super) fn stamp(reader: &Reader<'_>, key: &str) -> Result<StampFrom, ConfigError> {
    match reader.is_set(key) {
        false => Ok(StampFrom::Field("header.stamp".to_owned())),
        true if reader.text(key)? == RECEIPT => Ok(StampFrom::Receipt),
        true => Ok(StampFrom::Field(reader.field(key)?)),
    }
}

/// The path of a field: none where it is unset, none inside where it is set to be empty.
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

/// Milliseconds as nanoseconds; the table keeps them far below what an `i64` holds.
pub(super) fn millis_to_ns(ms: f64) -> i64 {
    (ms * 1e6).round() as i64
}
