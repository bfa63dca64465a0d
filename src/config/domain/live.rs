//! Parameters of the live node only.

use std::path::PathBuf;
use std::time::Duration;

use super::super::error::ConfigError;
use super::reader::Reader;
use super::visuals::{self, VisualsConfig};
use crate::units::from_millis;

/// Parameters of the live node only.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveConfig {
    /// True if the node configures and activates itself.
    pub autostart: bool,
    /// Time without messages after which a tactile source counts as stale.
    pub tactile_timeout: Duration,
    /// Folder with message definitions.
    pub message_definitions: Option<PathBuf>,
    /// Limit on the time from the stamp of the data to the published estimate.
    pub max_latency: Duration,
    /// Limit on the deviation of the time between tactile messages.
    pub max_jitter: Duration,
    /// Minimum share of frames with a full estimate, 0 to 1.
    pub min_estimates: f64,
    /// Time for which a limit must be violated before it is an error.
    pub sustained: Duration,
    /// Markers, images and frames of the node.
    pub visuals: VisualsConfig,
}

/// Reads these parameters.
pub(super) fn live(reader: &Reader<'_>) -> Result<LiveConfig, ConfigError> {
    Ok(LiveConfig {
        autostart: reader.bool("autostart")?,
        tactile_timeout: from_millis(reader.double("tactile_timeout_ms")?),
        message_definitions: reader.path_here("message_definitions")?,
        max_latency: from_millis(reader.double("diagnostics.max_latency_ms")?),
        max_jitter: from_millis(reader.double("diagnostics.max_jitter_ms")?),
        min_estimates: reader.double("diagnostics.min_estimates")?,
        sustained: Duration::from_secs_f64(reader.double("diagnostics.sustained_s")?),
        visuals: visuals::visuals(reader)?,
    })
}
