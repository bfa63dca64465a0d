//! Estimates of one region over time, from a model or from a bag.

use std::collections::BTreeMap;

use crate::fusion::{ContactDetector, ContactThresholds, Estimate, Flags, ForceGain, Patch};
use crate::msg::ContactState;
use crate::units::{Newton, Stamp};

/// Largest error of turning a force into the frame of a wrench and back, as a share of the force.
const ROUNDING: f64 = 1e-9;

/// The estimates of one region, frame by frame.
///
/// # Shapes
/// `[frames]` each.
#[derive(Debug, Default, Clone)]
pub struct EstimateTrack {
    /// Stamp of the frame.
    pub stamp: Vec<Stamp>,
    /// Normal force. `None` if there is no estimate; the flags give the reason.
    pub force: Vec<Option<Newton>>,
    /// Tangential force, x y z in the frame of the patch; `None` where the model gives the normal force alone.
    pub tangential: Vec<Option<[Newton; 3]>>,
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
        self.tangential.push(estimate.tangential);
        self.base.push(estimate.force_base);
        self.touch.push(estimate.touch);
        self.contact_raw.push(estimate.contact.raw);
        self.contact.push(estimate.contact.state);
        self.by_touch |= estimate.contact.by_touch;
        self.pose_age_ns.push(estimate.pose_age_ns);
        self.flags.push(estimate.flags);
    }

    /// Takes an estimate as it was published, but for its tangential force, which is in its wrench: that is told by
    /// [`EstimateTrack::handle_wrenches`].
    pub fn handle_state(&mut self, stamp: Stamp, state: &ContactState) {
        let force = |value: f64| Some(Newton(value)).filter(|force| force.0.is_finite());
        self.stamp.push(stamp);
        self.force.push(force(state.force));
        self.tangential.push(None);
        self.base.push(force(state.force_base));
        self.touch.push(Some(state.touch).filter(|touch| touch.is_finite()));
        self.contact_raw.push(state.contact_raw);
        self.contact.push(state.contact);
        self.by_touch |= state.touch_on.is_finite();
        self.pose_age_ns.push(state.pose_age.is_finite().then(|| (state.pose_age * 1e9).round() as i64));
        self.flags.push(Flags::from_bits(state.flags));
    }

    /// Takes the wrenches that were published of it, by their stamps: force x y z in the frame of the patch.
    ///
    /// A wrench belongs to the estimate of its stamp, or to the next one where the contacts of several sources are told
    /// together; the normal force of both is the same. A recording whose wrenches have no tangential force at all is of a
    /// model that gives the normal force alone.
    pub fn handle_wrenches(&mut self, patch: &Patch, wrenches: &BTreeMap<Stamp, [Newton; 3]>) {
        let found = self.stamp.iter().zip(&self.force).map(|(stamp, force)| {
            let (_, wrench) = wrenches.range(..=*stamp).next_back()?;
            let (along, across) = patch.split(*wrench);
            let force = (*force)?;
            ((along.0 - force.0).abs() <= ROUNDING * force.0.abs().max(1.0)).then_some((along, across))
        });
        let found: Vec<_> = found.collect();
        let is_tangential = |(along, across): &(Newton, [Newton; 3])| {
            across.iter().any(|force| force.0.abs() > ROUNDING * along.0.abs().max(1.0))
        };
        if found.iter().flatten().any(is_tangential) {
            self.tangential = found.into_iter().map(|found| found.map(|(_, across)| across)).collect();
        }
    }

    /// Whether some frame has a tangential force.
    pub fn has_tangential(&self) -> bool {
        self.tangential.iter().any(Option::is_some)
    }

    /// The force that the pose correction removed at a frame; `None` where there was no correction.
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
        // Known touches tell how much the glove feels, and change no direction.
        let tangential = self.tangential.iter();
        let tangential =
            tangential.map(|of| of.map(|forces| forces.map(|force| Newton(gain.gain * force.0)))).collect();
        let scaled = EstimateTrack { force, tangential, base, ..self.clone() };
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
            tangential: vec![None; self.base.len()],
            base: vec![None; self.base.len()],
            pose_age_ns: self.pose_age_ns.clone(),
            flags: self.flags.clone(),
        }
    }
}

/// Contact by forces: of each frame alone, and with hysteresis and debounce.
fn contacts(stamps: &[Stamp], forces: &[Option<Newton>], thresholds: ContactThresholds) -> (Vec<bool>, Vec<bool>) {
    let mut detector = ContactDetector::new(thresholds, None);
    let contacts = stamps.iter().zip(forces).map(|(stamp, force)| detector.handle_estimate(*stamp, *force, None, 0.0));
    contacts.map(|contact| (contact.raw, contact.state)).unzip()
}
