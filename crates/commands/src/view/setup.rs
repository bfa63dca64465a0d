//! Setup of a page, which it needs before it shows frames.

use serde::Serialize;
use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::fusion::{Baseline, Flags};
use tactile_pose_fusion::init::finger;
use tactile_pose_fusion::msg::ContactState;

use super::frames::{Frames, Range};
use super::scalars::VALUES;

/// Words for the states of the artifact filter, by the values of `ContactState.msg`.
const ADAPTATIONS: [(u8, &str); 6] = [
    (ContactState::ADAPTATION_OFF, "not taken out of the taxels"),
    (ContactState::ADAPTATION_FROZEN, "taken out of the taxels, as calibrated"),
    (ContactState::ADAPTATION_LEARNING, "taken out of the taxels, followed"),
    (ContactState::ADAPTATION_WAITING, "taken out of the taxels, following waits"),
    (ContactState::ADAPTATION_CAPPED, "far from its calibration: calibrate again"),
    (ContactState::ADAPTATION_NOISY, "taken out of the taxels, joint angles are noisy"),
];

/// Flags with which there is never an estimate, by their names.
const WITHOUT_ESTIMATE: [Flags; 5] =
    [Flags::WARMUP, Flags::UNCALIBRATED, Flags::STALE_TACTILE, Flags::NON_FINITE, Flags::FROZEN];

/// Where the estimates of a page are from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Kind {
    /// The bag holds them.
    Recorded,
    /// They were computed for the page.
    Computed,
    /// A node publishes them.
    #[cfg(feature = "ros")]
    Live,
}

/// Setup of a page, which it needs before it shows frames.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Setup {
    /// Name of the bag or the node.
    pub(super) title: String,
    pub(super) kind: Kind,
    /// Where the estimates are from, in a sentence.
    pub(super) from: String,
    /// True if a simulator made the data.
    pub(super) synthetic: bool,
    /// Length, s; 0 for a live node.
    pub(super) duration_s: f64,
    /// Stamp of the beginning, s since the Unix epoch, with all of its digits; empty for a live node.
    pub(super) begin: String,
    pub(super) regions: Vec<RegionSetup>,
    pub(super) flags: Vec<FlagSetup>,
    /// By value.
    pub(super) adaptations: Vec<&'static str>,
    /// The protocol's items over time.
    pub(super) stages: Vec<StageSetup>,
    /// Notes for a person on the data.
    pub(super) notes: Vec<String>,
}

/// A region.
#[derive(Debug, Clone, Serialize)]
pub(super) struct RegionSetup {
    pub(super) name: String,
    /// The finger, or palm, that its name speaks of.
    finger: Option<&'static str>,
    frame_id: String,
    n_taxels: usize,
    /// Columns of the grid of taxels.
    columns: usize,
    /// True if the parameters give the grid.
    is_layout_told: bool,
    n_frames: u64,
    /// Usual time between frames, s.
    period_s: Option<f64>,
    /// N: contact may begin at or above it.
    force_on: f64,
    /// Which values some frame has, or may have.
    has: Vec<&'static str>,
    /// 1, or -1 where a lower reading means more pressure.
    sign: i8,
    /// `[taxels]`: readings at rest, if they are known.
    zero: Option<Vec<f32>>,
    /// `[taxels]`: readings over the whole session.
    readings: Vec<Range>,
    /// Range of the model's input over the whole session, if that is known.
    features: Option<Range>,
}

/// A flag.
#[derive(Debug, Clone, Serialize)]
pub(super) struct FlagSetup {
    bit: u32,
    name: &'static str,
    /// True if there is no estimate with it.
    without_estimate: bool,
}

/// An item of the protocol.
#[derive(Debug, Clone, Serialize)]
pub(super) struct StageSetup {
    /// s, from the beginning.
    pub(super) t: f64,
    /// Empty outside of items.
    pub(super) name: String,
    pub(super) zero_load: bool,
}

impl Setup {
    /// A page of these regions, without anything else yet.
    pub(super) fn new(title: String, kind: Kind, from: String, regions: Vec<RegionSetup>) -> Self {
        let flags = Flags::names().map(|(flag, name)| {
            let without_estimate = WITHOUT_ESTIMATE.contains(&flag);
            FlagSetup { bit: flag.bits(), name, without_estimate }
        });
        let mut adaptations = vec![""; ADAPTATIONS.len()];
        ADAPTATIONS.iter().for_each(|(value, words)| adaptations[usize::from(*value)] = *words);
        Setup {
            title,
            kind,
            from,
            synthetic: false,
            duration_s: 0.0,
            begin: String::new(),
            regions,
            flags: flags.collect(),
            adaptations,
            stages: Vec::new(),
            notes: Vec::new(),
        }
    }
}

impl RegionSetup {
    /// A region of a configuration, with as many taxels as are shown of it.
    pub(super) fn new(cfg: &Config, region_idx: usize, n_taxels: usize, baseline: Option<&Baseline>) -> Self {
        let (region, layout) = (&cfg.fusion().regions()[region_idx], &cfg.layouts()[region_idx]);
        let zero = baseline.map(|baseline| region.taxels.iter().map(|&taxel_idx| baseline.median[taxel_idx]).collect());
        RegionSetup {
            name: region.name.clone(),
            finger: finger(&region.name),
            frame_id: region.patch.frame_id.clone(),
            n_taxels,
            columns: layout.columns,
            is_layout_told: layout.is_told,
            n_frames: 0,
            period_s: None,
            force_on: region.contact.force_on.0,
            has: VALUES.into_iter().filter(|name| *name != "truth").collect(),
            sign: if cfg.fusion().tactile_sources()[region.source.position()].inverted { -1 } else { 1 },
            zero: zero.filter(|_| n_taxels > 0),
            readings: Vec::new(),
            features: None,
        }
    }

    /// The same, with what its frames hold.
    pub(super) fn with_frames(self, frames: &Frames) -> Self {
        let has = VALUES.into_iter().zip(frames.has).filter(|(_, has)| *has).map(|(name, _)| name).collect();
        let features = Some(frames.features).filter(|range| range.low.is_finite());
        let (n_frames, period_s, readings) = (frames.len(), frames.period_s(), frames.readings.clone());
        RegionSetup { n_frames, period_s, has, readings, features, ..self }
    }
}
