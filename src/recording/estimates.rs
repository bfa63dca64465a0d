//! Estimates of one region over time, from a model or from a bag.

use crate::fusion::{ContactDetector, ContactThresholds, Estimate, Flags, ForceGain};
use crate::msg::ContactState;
use crate::units::{Newton, Stamp};

/// Estimates of one region, frame by frame.
///
/// # Shapes
/// `[frames]` each.
#[derive(Debug, Default, Clone)]
pub struct EstimateTrack {
    /// Stamp of the frame.
    pub stamp: Vec<Stamp>,
    /// Normal force. `None` if there is no estimate; the flags give the reason.
    pub force: Vec<Option<Newton>>,
    /// Force of the tactile branch alone.
    pub base: Vec<Option<Newton>>,
    /// Probability that something touches the region, if the model gives it.
    pub touch: Vec<Option<f64>>,
    /// True if the force, or the probability of touch, was at or above its threshold in this frame alone.
    pub contact_raw: Vec<bool>,
    /// True if there is contact.
    pub contact: Vec<bool>,
    /// Age of the oldest joint angle of the frame, ns.
    pub pose_age_ns: Vec<Option<i64>>,
    /// Flags that limit the trust in the estimate.
    pub flags: Vec<Flags>,
    /// True if contact was decided on the probability of touch.
    pub by_touch: bool,
}

impl EstimateTrack {
    /// Adds an estimate of the core.
    pub fn handle_estimate(&mut self, stamp: Stamp, estimate: &Estimate) {
        self.stamp.push(stamp);
        self.force.push(estimate.force);
        self.base.push(estimate.force_base);
        self.touch.push(estimate.touch);
        self.contact_raw.push(estimate.contact.raw);
        self.contact.push(estimate.contact.state);
        self.by_touch |= estimate.contact.by_touch;
        self.pose_age_ns.push(estimate.pose_age_ns);
        self.flags.push(estimate.flags);
    }

    /// Adds a published estimate.
    pub fn handle_state(&mut self, stamp: Stamp, state: &ContactState) {
        let force = |value: f64| Some(Newton(value)).filter(|force| force.0.is_finite());
        self.stamp.push(stamp);
        self.force.push(force(state.force));
        self.base.push(force(state.force_base));
        self.touch.push(Some(state.touch).filter(|touch| touch.is_finite()));
        self.contact_raw.push(state.contact_raw);
        self.contact.push(state.contact);
        self.by_touch |= state.touch_on.is_finite();
        self.pose_age_ns.push(state.pose_age.is_finite().then(|| (state.pose_age * 1e9).round() as i64));
        self.flags.push(Flags::from_bits(state.flags));
    }

    /// Force that the pose correction removed at a frame. `None` if there was no correction.
    pub fn artifact(&self, idx: usize) -> Option<Newton> {
        Estimate { force: self.force[idx], force_base: self.base[idx], flags: self.flags[idx], ..Estimate::default() }
            .artifact()
    }

    /// The track with forces times a gain, and the contact that follows from them. Contact that was decided on the
    /// probability of touch is unchanged.
    pub fn with_gain(&self, gain: &ForceGain, thresholds: ContactThresholds) -> EstimateTrack {
        let times = |forces: &[Option<Newton>]| -> Vec<Option<Newton>> {
            forces.iter().map(|force| force.map(|force| Newton(gain.gain * force.0))).collect()
        };
        let (force, base) = (times(&self.force), times(&self.base));
        let scaled = EstimateTrack { force, base, ..self.clone() };
        if self.by_touch {
            return scaled;
        }
        let (contact_raw, contact) = contacts(&scaled.stamp, &scaled.force, thresholds);
        EstimateTrack { contact_raw, contact, ..scaled }
    }

    /// The track with the base force as its force, and the contact that follows from it.
    pub fn base_alone(&self, thresholds: ContactThresholds) -> EstimateTrack {
        let (contact_raw, contact) = contacts(&self.stamp, &self.base, thresholds);
        EstimateTrack {
            stamp: self.stamp.clone(),
            touch: vec![None; self.base.len()],
            contact_raw,
            contact,
            by_touch: false,
            force: self.base.clone(),
            base: vec![None; self.base.len()],
            pose_age_ns: self.pose_age_ns.clone(),
            flags: self.flags.clone(),
        }
    }
}

/// Contact by forces: of each frame alone, and with hysteresis and debounce.
fn contacts(stamps: &[Stamp], forces: &[Option<Newton>], thresholds: ContactThresholds) -> (Vec<bool>, Vec<bool>) {
    let mut detector = ContactDetector::new(thresholds, None);
    let contacts = stamps.iter().zip(forces).map(|(stamp, force)| detector.handle_estimate(*stamp, *force, None));
    contacts.map(|contact| (contact.raw, contact.state)).unzip()
}
