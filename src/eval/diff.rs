//! How two series of estimates differ: a run against a golden one, a live recording against its replay.

mod matching;
mod report;

use std::time::Duration;

pub use report::{Diff, Difference, Field, FieldDiff, FieldValue, Moment, OnlyIn, RegionDiff};

use crate::fusion::{Adaptation, ContactEvent, Flags};
use crate::units::{Newton, Stamp};
use matching::{Matcher, Side};

/// One estimate of one region, as `ContactState` carries it. A force that is absent or NaN is the same: no value.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimateRecord {
    /// Stamp of the frame.
    pub stamp: Stamp,
    /// Name of the region.
    pub region: String,
    /// Normal force, N.
    pub force: Option<f64>,
    /// Force of the tactile branch alone, N.
    pub force_base: Option<f64>,
    /// The artifact: the force that the pose correction removed, N.
    pub artifact: Option<f64>,
    /// Force (N) and torque (N m), x y z each, as `WrenchStamped` tells them; absent where there is no estimate.
    pub wrench: Option<[f64; 6]>,
    /// Force at or above the on threshold.
    pub contact_raw: bool,
    /// Contact with hysteresis and debounce.
    pub contact: bool,
    /// The change of contact at this frame.
    pub event: ContactEvent,
    /// Begin of the contact state.
    pub since: Stamp,
    /// Reasons to trust it less.
    pub flags: Flags,
    /// Age of the pose, ns.
    pub pose_age_ns: Option<i64>,
    /// Age of the frame when the node had all of it, ns.
    pub age_ns: Option<i64>,
    /// Threshold that contact began at, N.
    pub on_threshold: Option<f64>,
    /// Threshold that contact ends at, N.
    pub off_threshold: Option<f64>,
    /// Minimal detectable force, N.
    pub mdf: Option<f64>,
    /// State of the artifact filter.
    pub adaptation: Adaptation,
    /// How far the artifact is from its calibration, as a share.
    pub artifact_change: Option<f64>,
    /// Probability of touch.
    pub touch: Option<f64>,
    /// Probability that contact began at; absent where contact is decided on force.
    pub touch_on: Option<f64>,
    /// Probability that contact ends at; absent where contact is decided on force.
    pub touch_off: Option<f64>,
}

/// A comparison that can't be made.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum DiffError {
    #[error("tolerance of the comparison is {0}, expected a finite force of 0 N or more; 0 compares bit by bit")]
    Tolerance(Newton),
    #[error("number of estimates that may wait for their partner is 0, expected 1 or more")]
    MaxPending,
}

/// How two series are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DiffConfig {
    tolerance: Newton,
    time_jump: Duration,
    max_pending: usize,
}

impl Default for DiffConfig {
    /// Bit by bit.
    fn default() -> Self {
        DiffConfig { tolerance: Newton(0.0), time_jump: Duration::from_millis(500), max_pending: 4096 }
    }
}

impl DiffConfig {
    /// The same, with another tolerance for forces.
    ///
    /// # Errors
    /// [`DiffError::Tolerance`].
    pub fn with_tolerance(self, tolerance: Newton) -> Result<Self, DiffError> {
        DiffConfig::new(tolerance, self.time_jump, self.max_pending)
    }

    /// Forces may differ by `tolerance`; with 0 they are compared bit by bit.
    ///
    /// A stamp more than `time_jump` behind the newest one of its region begins a new epoch (a looped bag, a restarted
    /// driver); one less far behind is merely late. `max_pending` estimates a region and side wait for their partner.
    ///
    /// # Errors
    /// [`DiffError`] names the value that can't be.
    pub fn new(tolerance: Newton, time_jump: Duration, max_pending: usize) -> Result<Self, DiffError> {
        if !(tolerance.0.is_finite() && tolerance.0 >= 0.0) {
            return Err(DiffError::Tolerance(tolerance));
        }
        if max_pending == 0 {
            return Err(DiffError::MaxPending);
        }
        Ok(DiffConfig { tolerance, time_jump, max_pending })
    }
}

/// Compares two series of estimates, region by region and field by field.
///
/// Records belong together when they share region, epoch and stamp; several of the same stamp are matched in the order
/// in which they come. An epoch is counted by region and side: the first is 0, and each jump back by more than the
/// config's `time_jump` begins the next. So the second round of a looped bag is compared with the second round. A side
/// that has one jump more than the other is compared in sequence, and the rest shows as records of one side alone.
///
/// Both series are read once, side by side in the order of their stamps; what waits for its partner is bounded, and a
/// record whose partner can no longer come is in one side alone. A record that had to stop waiting because too many did
/// is counted in `n_gave_up` as well.
///
/// # Errors
/// The first error of either series.
pub fn diff<E>(
    a: impl IntoIterator<Item = Result<EstimateRecord, E>>,
    b: impl IntoIterator<Item = Result<EstimateRecord, E>>,
    cfg: DiffConfig,
) -> Result<Diff, E> {
    let (mut a, mut b) = (a.into_iter(), b.into_iter());
    let (mut a_ended, mut b_ended) = (false, false);
    let mut matcher = Matcher::new(cfg);
    while !(a_ended && b_ended) {
        if b_ended || (!a_ended && matcher.reached(Side::A) <= matcher.reached(Side::B)) {
            match a.next().transpose()? {
                Some(record) => matcher.handle_record(Side::A, record),
                None => a_ended = true,
            }
        } else {
            match b.next().transpose()? {
                Some(record) => matcher.handle_record(Side::B, record),
                None => b_ended = true,
            }
        }
    }
    Ok(matcher.finish())
}
