//! Estimates: the output of the fusion core.

use std::fmt;

use super::artifact::Adaptation;
use super::contact::Contact;
use super::idx::{RegionIdx, TactileSourceIdx};
use crate::units::{Newton, Stamp};

/// Reasons to trust an estimate less, or not to have one. The bits are those of `ContactState.msg`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Flags(u32);

impl Flags {
    /// The window is not full yet: no estimate.
    pub const WARMUP: Flags = Flags(1);
    /// There is no baseline to subtract: no estimate.
    pub const UNCALIBRATED: Flags = Flags(2);
    /// The pose of some frame of the window is unknown or too old to be held: the base branch alone, the artifact of the
    /// last pose, or no estimate.
    pub const STALE_POSE: Flags = Flags(4);
    /// The tactile stream has stopped: no estimate.
    pub const STALE_TACTILE: Flags = Flags(8);
    /// A joint is outside of what the model was trained on.
    pub const POSE_OUT_OF_RANGE: Flags = Flags(16);
    /// A taxel of the region was found dead when the baseline was taken, or stands still now.
    pub const FAULTY_TAXEL: Flags = Flags(32);
    /// A taxel or the model's output was NaN or infinite: no estimate.
    pub const NON_FINITE: Flags = Flags(64);
    /// The pose of some frame of the window is held for longer than its source's rate explains.
    pub const HELD_POSE: Flags = Flags(256);
    /// All taxels of the source stand still for longer than their noise allows: no estimate.
    pub const FROZEN: Flags = Flags(512);
    /// Rows of two senders come in turn: the force may be of either.
    pub const INTERLEAVED: Flags = Flags(1024);
    /// Frames come faster than the model's rate.
    pub const WRONG_RATE: Flags = Flags(2048);
    /// The frame's stamp is further from its receipt than [`Timing::max_age`](super::Timing::max_age).
    pub const LATE: Flags = Flags(128);

    const NAMES: [(Flags, &'static str); 12] = [
        (Flags::WARMUP, "WARMUP"),
        (Flags::UNCALIBRATED, "UNCALIBRATED"),
        (Flags::STALE_POSE, "STALE_POSE"),
        (Flags::STALE_TACTILE, "STALE_TACTILE"),
        (Flags::POSE_OUT_OF_RANGE, "POSE_OUT_OF_RANGE"),
        (Flags::FAULTY_TAXEL, "FAULTY_TAXEL"),
        (Flags::NON_FINITE, "NON_FINITE"),
        (Flags::LATE, "LATE"),
        (Flags::HELD_POSE, "HELD_POSE"),
        (Flags::FROZEN, "FROZEN"),
        (Flags::INTERLEAVED, "INTERLEAVED"),
        (Flags::WRONG_RATE, "WRONG_RATE"),
    ];

    /// The bits as they go on the wire.
    pub fn bits(self) -> u32 {
        self.0
    }

    /// Flags from the wire. Unknown bits are kept.
    pub fn from_bits(bits: u32) -> Self {
        Flags(bits)
    }

    /// True if every flag of `other` is set.
    pub fn contains(self, other: Flags) -> bool {
        self.0 & other.0 == other.0
    }

    /// True if none is set.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Sets the flags of `other`.
    pub fn insert(&mut self, other: Flags) {
        self.0 |= other.0;
    }

    /// The names of the known flags, each with its bit.
    pub fn names() -> impl Iterator<Item = (Flags, &'static str)> {
        Self::NAMES.into_iter()
    }
}

impl std::ops::BitOr for Flags {
    type Output = Flags;

    fn bitor(self, other: Flags) -> Flags {
        Flags(self.0 | other.0)
    }
}

impl fmt::Display for Flags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for (_, name) in Self::NAMES.iter().filter(|(flag, _)| self.contains(*flag)) {
            write!(f, "{separator}{name}")?;
            separator = "|";
        }
        if separator.is_empty() { f.write_str("none") } else { Ok(()) }
    }
}

/// The force on one region at one frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// The region, of the configuration of the core.
    pub region: RegionIdx,
    /// Normal force; `None` where there is no estimate, and the flags say why.
    pub force: Option<Newton>,
    /// Tangential force on the hand by the object: x, y, z in the patch's own frame, perpendicular to its normal. `None`
    /// where the model gives the normal force alone, and where there is no estimate.
    pub tangential: Option<[Newton; 3]>,
    /// Normal force of the tactile branch alone, where the model gives it.
    pub force_base: Option<Newton>,
    /// Probability that something touches the region, where the model gives it.
    pub touch: Option<f64>,
    /// Contact.
    pub contact: Contact,
    /// Age of the oldest joint angle of the frame, ns: zero when all were measured or interpolated, `None` when one is
    /// unknown or the model takes no pose.
    pub pose_age_ns: Option<i64>,
    /// Reasons to trust it less.
    pub flags: Flags,
    /// State of the artifact filter of the region.
    pub adaptation: Adaptation,
    /// How far the artifact is from its calibration: root mean square of the changes of its gains, as a share of that of the
    /// gains; `None` where it is not taken out.
    pub artifact_change: Option<f64>,
}

impl Estimate {
    /// The force that the pose correction removed from the tactile branch; `None` where there was no correction.
    pub fn artifact(&self) -> Option<Newton> {
        if self.flags.contains(Flags::STALE_POSE) {
            return None;
        }
        Some(Newton(self.force_base?.0 - self.force?.0))
    }
}

/// The estimates of one frame: every region of one tactile source.
#[derive(Debug, Clone, PartialEq)]
pub struct Tick {
    /// The source that the frame came from.
    pub source: TactileSourceIdx,
    /// Stamp of the frame.
    pub stamp: Stamp,
    /// Changes wherever the stream of frames broke off or started again.
    pub epoch: u64,
    /// Number of the frame within its epoch; numbers that are left out are frames that are missing.
    pub number: i64,
    /// Receipt of the event that completed the frame.
    pub received: Stamp,
    /// From the stamp to that receipt, ns; `None` where receipts say nothing ([`Receipts::Unknown`](super::Receipts::Unknown)).
    pub age_ns: Option<i64>,
    /// One a region of the source, in the order of the configuration.
    pub estimates: Vec<Estimate>,
    /// The taxels of the regions, where [`FusionConfig::keeps_taxels`](super::FusionConfig::keeps_taxels) asks for them.
    pub taxels: TickTaxels,
}

/// The taxels of a frame, one region after the other in the order of [`Tick::estimates`]; empty where they are not kept.
///
/// # Shapes
/// `[taxels of all regions of the source]` each.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TickTaxels {
    /// As sent, at the stamp of the frame.
    pub reading: Vec<f32>,
    /// Inputs of the model: above the zero, without the artifact where it is taken out. NaN where the frame is no
    /// input.
    pub feature: Vec<f32>,
}

impl TickTaxels {
    pub(super) fn clear(&mut self) {
        self.reading.clear();
        self.feature.clear();
    }
}
