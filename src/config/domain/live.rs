//! What only the live node follows.

use std::path::PathBuf;
use std::time::Duration;

use super::super::error::ConfigError;
use super::reader::Reader;
use crate::units::from_millis;

/// What only the live node follows.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveConfig {
    /// Whether the node configures and activates itself.
    pub autostart: bool,
    /// Silence of a tactile source after which it is said to be stale.
    pub tactile_timeout: Duration,
    /// Folder with message definitions.
    pub message_definitions: Option<PathBuf>,
    /// Budget of the time from the stamp of the data to its published estimate.
    pub max_latency: Duration,
    /// Budget of the deviation of the time between tactile messages.
    pub max_jitter: Duration,
    /// Least part of frames that must have a full estimate, 0 to 1.
    pub min_estimates: f64,
    /// How long a budget is passed before that is an error.
    pub sustained: Duration,
}

/// Reads it.
pub(super) fn live(reader: &Reader<'_>) -> Result<LiveConfig, ConfigError> {
    Ok(LiveConfig {
        autostart: reader.bool("autostart")?,
        tactile_timeout: from_millis(reader.double("tactile_timeout_ms")?),
        message_definitions: reader.path("message_definitions")?,
        max_latency: from_millis(reader.double("diagnostics.max_latency_ms")?),
        max_jitter: from_millis(reader.double("diagnostics.max_jitter_ms")?),
        min_estimates: reader.double("diagnostics.min_estimates")?,
        sustained: Duration::from_secs_f64(reader.double("diagnostics.sustained_s")?),
    })
}
