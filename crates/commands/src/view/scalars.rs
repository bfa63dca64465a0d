//! Values of a region at a frame, without its taxels.

use tactile_pose_fusion::fusion::Estimate;
use tactile_pose_fusion::msg::{ContactState, adaptation_code};
use tactile_pose_fusion::units::Newton;

/// Values of a frame, in the words of `ContactState.msg`, and the true force. The first four are drawn over time.
pub(super) const VALUES: [&str; 7] =
    ["force", "force_base", "truth", "artifact", "touch", "pose_age", "artifact_change"];

/// Values of a region at a frame, without its taxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scalars {
    /// NaN where there is none; N, s, or of 1.
    pub(super) values: [f64; VALUES.len()],
    pub(super) contact: bool,
    pub(super) flags: u32,
    pub(super) adaptation: u8,
}

impl Scalars {
    /// From a message.
    pub(super) fn of_state(state: &ContactState, truth: Option<Newton>) -> Self {
        let truth = truth.map_or(f64::NAN, |force| force.0);
        let ContactState { force, force_base, artifact, touch, pose_age, artifact_change, .. } = *state;
        let values = [force, force_base, truth, artifact, touch, pose_age, artifact_change];
        Scalars { values, contact: state.contact, flags: state.flags, adaptation: state.adaptation }
    }

    /// From an estimate of the core.
    pub(super) fn of_estimate(estimate: &Estimate, truth: Option<Newton>) -> Self {
        let newtons = |force: Option<Newton>| force.map_or(f64::NAN, |force| force.0);
        let values = [
            newtons(estimate.force),
            newtons(estimate.force_base),
            newtons(truth),
            newtons(estimate.artifact()),
            estimate.touch.unwrap_or(f64::NAN),
            estimate.pose_age_ns.map_or(f64::NAN, |age_ns| age_ns as f64 * 1e-9),
            estimate.artifact_change.unwrap_or(f64::NAN),
        ];
        let (contact, flags) = (estimate.contact.state, estimate.flags.bits());
        Scalars { values, contact, flags, adaptation: adaptation_code(estimate.adaptation) }
    }
}
