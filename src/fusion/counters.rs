//! Input counters, by name.

use serde::Serialize;

use super::frames::TactileCounters;
use super::joints::JointCounters;
use super::region::RegionCounters;

/// Counts of everything that went into the core.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Counters<'a> {
    /// Per tactile source.
    pub tactile: Vec<TactileCount<'a>>,
    /// Per joint source.
    pub joints: Vec<Count<'a, JointCounters>>,
    /// Per region.
    pub regions: Vec<Count<'a, RegionCounters>>,
}

/// Counts with the name of what was counted.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Count<'a, C> {
    /// Name in the parameters.
    pub name: &'a str,
    /// The counts.
    #[serde(flatten)]
    pub counts: C,
}

/// Counts of a tactile source.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TactileCount<'a> {
    /// Name in the parameters.
    pub name: &'a str,
    /// The counts.
    #[serde(flatten)]
    pub counts: TactileCounters,
    /// Frames a second as they came, gaps left out.
    pub measured_rate_hz: Option<f64>,
}
