//! The estimates of one region over time: made by a model, or read out of a bag.

use crate::fusion::{ContactDetector, ContactThresholds, Estimate, Flags};
use crate::msg::ContactState;
use crate::units::{Newton, Stamp};

/// The estimates of one region, frame by frame.
///
/// # Shapes
/// `[frames]` each.
#[derive(Debug, Default, Clone)]
pub struct EstimateTrack {
    /// Of the frame.
    pub stamp: Vec<Stamp>,
    /// Normal force; `None` where there is no estimate, and the flags say why.
    pub force: Vec<Option<Newton>>,
    /// Force of the tactile branch alone.
    pub base: Vec<Option<Newton>>,
    /// Whether there is contact.
    pub contact: Vec<bool>,
    /// Age of the oldest joint angle of the frame, ns.
    pub pose_age_ns: Vec<Option<i64>>,
    /// What to know before trusting it.
    pub flags: Vec<Flags>,
}

impl EstimateTrack {
    /// Takes an estimate of the core.
    pub fn handle_estimate(&mut self, stamp: Stamp, estimate: &Estimate) {
        self.stamp.push(stamp);
        self.force.push(estimate.force);
        self.base.push(estimate.force_base);
        self.contact.push(estimate.contact.state);
        self.pose_age_ns.push(estimate.pose_age_ns);
        self.flags.push(estimate.flags);
    }

    /// Takes an estimate as it was published.
    pub fn handle_state(&mut self, stamp: Stamp, state: &ContactState) {
        let force = |value: f64| Some(Newton(value)).filter(|force| force.0.is_finite());
        self.stamp.push(stamp);
        self.force.push(force(state.force));
        self.base.push(force(state.force_base));
        self.contact.push(state.contact);
        self.pose_age_ns.push(state.pose_age.is_finite().then(|| (state.pose_age * 1e9).round() as i64));
        self.flags.push(Flags::from_bits(state.flags));
    }

    /// What the pose correction removed at a frame; `None` where there was no correction.
    pub fn artifact(&self, idx: usize) -> Option<Newton> {
        Estimate { force: self.force[idx], force_base: self.base[idx], flags: self.flags[idx], ..Estimate::default() }
            .artifact()
    }

    /// The base force as if it were all there is, with the contact that it alone would tell.
    pub fn base_alone(&self, thresholds: ContactThresholds) -> EstimateTrack {
        let mut detector = ContactDetector::new(thresholds);
        let contacts =
            self.stamp.iter().zip(&self.base).map(|(stamp, base)| detector.handle_force(*stamp, *base).state);
        EstimateTrack {
            stamp: self.stamp.clone(),
            contact: contacts.collect(),
            force: self.base.clone(),
            base: vec![None; self.base.len()],
            pose_age_ns: self.pose_age_ns.clone(),
            flags: self.flags.clone(),
        }
    }
}
