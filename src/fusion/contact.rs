//! From force, or from the probability of touch, to contact: one threshold for the raw flag; hysteresis, debounce, and for
//! the probability of touch the sum of its log odds, for the state.
//!
//! The sum is a cumulative sum test (Page, 1954): with the same delay it takes fewer doubtful frames for a touch than a longer
//! debounce does, because frames without doubt count more.

use super::config::ContactThresholds;
use super::regressor::TouchOutput;
use crate::units::{Newton, Stamp};

/// Change of contact at a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContactEvent {
    /// Nothing.
    #[default]
    None,
    /// Contact began.
    Onset,
    /// Contact ended.
    Offset,
}

/// Contact at a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Contact {
    /// Force, or probability of touch, at or above its on threshold at this very frame: what the paper's metrics use. False
    /// without an estimate.
    pub raw: bool,
    /// True if it was decided on the probability of touch.
    pub by_touch: bool,
    /// State with hysteresis and debounce. Held over frames without an estimate, which their flags tell.
    pub state: bool,
    /// The change of contact at this frame.
    pub event: ContactEvent,
    /// First frame of the run of forces that led to the current state.
    pub since: Stamp,
}

/// The state machine of one region.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactDetector {
    thresholds: ContactThresholds,
    output: Option<TouchOutput>,
    state: bool,
    since: Option<Stamp>,
    run_frames: u32,
    run_start: Stamp,
    /// Log odds of touch above those of the lower level, added up while there is no contact, never below 0.
    evidence: f64,
    lost: bool,
}

impl ContactDetector {
    /// A detector that starts without contact, for a model with this touch output or with none.
    pub fn new(thresholds: ContactThresholds, output: Option<TouchOutput>) -> Self {
        let (since, run_start) = (None, Stamp(0));
        let (run_frames, evidence) = (0, 0.0);
        ContactDetector { thresholds, output, state: false, since, run_frames, run_start, evidence, lost: false }
    }

    /// Takes the force and the probability of touch of the frame at `stamp`, `None` where there is no estimate. A frame
    /// with a force alone is judged by its force. `evidence_margin`: log odds by which this frame is less evidence of a contact, 0 or more.
    pub fn handle_estimate(
        &mut self,
        stamp: Stamp,
        force: Option<Newton>,
        touch: Option<f64>,
        evidence_margin: f64,
    ) -> Contact {
        let levels = self.thresholds.touch_levels(self.output.as_ref());
        let by_touch = touch.zip(levels);
        let judged = match (by_touch, force) {
            (Some((touch, levels)), _) => Some((touch >= levels.on, touch < levels.off)),
            (None, Some(force)) => Some((force >= self.thresholds.force_on, force < self.thresholds.force_off)),
            (None, None) => None,
        };
        let mut event = ContactEvent::None;
        if std::mem::take(&mut self.lost) {
            event = ContactEvent::Offset;
            self.since = Some(stamp);
        }
        if let Some((is_on, is_off)) = judged {
            let (opposes, needed) =
                if self.state { (is_off, self.thresholds.off_frames) } else { (is_on, self.thresholds.on_frames) };
            if opposes {
                if self.run_frames == 0 {
                    self.run_start = stamp;
                }
                self.run_frames += 1;
            } else {
                self.run_frames = 0;
            }
            if let Some((touch, levels)) = by_touch.filter(|_| !self.state) {
                // Of a number that is none, nothing is left: `max` takes the other one.
                self.evidence = (self.evidence + log_odds(touch) - log_odds(levels.off) - evidence_margin).max(0.0);
            }
            let is_beyond_doubt = self.state || by_touch.is_none() || self.evidence >= self.thresholds.touch_evidence;
            if self.run_frames >= needed.get() && is_beyond_doubt {
                self.state = !self.state;
                self.evidence = 0.0;
                self.since = Some(self.run_start);
                self.run_frames = 0;
                event = if self.state { ContactEvent::Onset } else { ContactEvent::Offset };
            }
        }
        Contact {
            raw: judged.is_some_and(|(is_on, _)| is_on),
            by_touch: by_touch.is_some(),
            state: self.state,
            event,
            since: *self.since.get_or_insert(stamp),
        }
    }

    /// Takes other thresholds. The state is kept until a run of forces is against it; a run so far is forgotten.
    pub fn handle_thresholds(&mut self, thresholds: ContactThresholds) {
        self.thresholds = thresholds;
        (self.run_frames, self.evidence) = (0, 0.0);
    }

    /// Forgets the state because frames were lost. A contact that was there ends with the next frame.
    pub fn handle_reset(&mut self) {
        self.lost |= self.state;
        self.state = false;
        (self.run_frames, self.evidence) = (0, 0.0);
    }

    /// True if there is contact, as the last estimate had it.
    pub fn state(&self) -> bool {
        self.state
    }

    /// Probability of touch from which there is contact, if contact is decided on it.
    pub fn touch_on(&self) -> Option<f64> {
        self.thresholds.touch_levels(self.output.as_ref()).map(|levels| levels.on)
    }

    /// The thresholds in force.
    pub fn thresholds(&self) -> &ContactThresholds {
        &self.thresholds
    }
}

/// Log odds of a probability, as if none were nearer than 1e-7 to 0 or 1.
pub(crate) fn log_odds(probability: f64) -> f64 {
    let probability = probability.clamp(1e-7, 1.0 - 1e-7);
    (probability / (1.0 - probability)).ln()
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroU32;

    use super::super::config::ContactBy;
    use super::super::regressor::TouchLevels;
    use super::*;

    fn detector(on_frames: u32, off_frames: u32) -> ContactDetector {
        let thresholds = ContactThresholds {
            by: ContactBy::Model,
            touch: None,
            touch_evidence: 0.0,
            force_on: Newton(0.02),
            force_off: Newton(0.01),
            on_frames: NonZeroU32::new(on_frames).unwrap(),
            off_frames: NonZeroU32::new(off_frames).unwrap(),
        };
        ContactDetector::new(thresholds, None)
    }

    fn run(detector: &mut ContactDetector, forces: &[f64]) -> Vec<Contact> {
        let frames = forces.iter().enumerate();
        frames.map(|(k, &force)| detector.handle_estimate(Stamp(k as i64), Some(Newton(force)), None, 0.0)).collect()
    }

    #[test]
    fn contact_begins_after_the_debounce_and_is_dated_to_the_first_frame() {
        let contacts = run(&mut detector(3, 1), &[0.0, 0.03, 0.0, 0.03, 0.03, 0.02, 0.05]);
        assert_eq!(
            contacts.iter().map(|c| c.state).collect::<Vec<_>>(),
            [false, false, false, false, false, true, true]
        );
        assert!(contacts[1].raw, "the raw flag has no debounce");
        assert_eq!((contacts[5].event, contacts[5].since), (ContactEvent::Onset, Stamp(3)));
        assert_eq!((contacts[6].event, contacts[6].since), (ContactEvent::None, Stamp(3)));
    }

    #[test]
    fn contact_survives_a_dip_between_the_thresholds() {
        let contacts = run(&mut detector(1, 2), &[0.03, 0.015, 0.015, 0.009, 0.015, 0.009, 0.009]);
        let states: Vec<bool> = contacts.iter().map(|c| c.state).collect();
        assert_eq!(states, [true, true, true, true, true, true, false]);
        assert_eq!((contacts[6].event, contacts[6].since), (ContactEvent::Offset, Stamp(5)));
    }

    #[test]
    fn a_frame_without_estimate_holds_the_state_and_a_reset_ends_it() {
        let mut detector = detector(1, 1);
        assert_eq!(detector.handle_estimate(Stamp(0), Some(Newton(1.0)), None, 0.0).event, ContactEvent::Onset);
        let unknown = detector.handle_estimate(Stamp(1), None, None, 0.0);
        assert!(unknown.state && !unknown.raw);
        detector.handle_reset();
        let ended = detector.handle_estimate(Stamp(9), None, None, 0.0);
        assert_eq!(ended, Contact { event: ContactEvent::Offset, since: Stamp(9), ..Contact::default() });
        assert_eq!(detector.handle_estimate(Stamp(10), None, None, 0.0).event, ContactEvent::None);
    }
    #[test]
    fn the_probability_of_touch_decides_where_there_is_one() {
        let (on, off) = (0.8, 0.5);
        let output = TouchOutput { levels: TouchLevels { on, off }, false_per_min: None };
        let mut detector = ContactDetector { output: Some(output), ..detector(1, 1) };
        let mut at = 0;
        let mut contact = |detector: &mut ContactDetector, force: f64, touch: Option<f64>| {
            at += 1;
            let contact = detector.handle_estimate(Stamp(at), Some(Newton(force)), touch, 0.0);
            (contact.raw, contact.state, contact.by_touch)
        };
        assert_eq!(contact(&mut detector, 1.0, Some(0.79)), (false, false, true), "a large force that is no touch");
        assert_eq!(contact(&mut detector, 0.0, Some(0.8)), (true, true, true));
        assert_eq!(contact(&mut detector, 0.0, Some(0.5)), (false, true, true), "hysteresis");
        assert_eq!(contact(&mut detector, 1.0, Some(0.49)), (false, false, true));
        assert_eq!(contact(&mut detector, 1.0, None), (true, true, false), "a frame with a force alone");
        let by_force = ContactThresholds { by: ContactBy::Force, ..*detector.thresholds() };
        detector.handle_thresholds(by_force);
        assert_eq!(contact(&mut detector, 0.0, Some(1.0)), (false, false, false));
        let own =
            ContactThresholds { touch: Some(TouchLevels { on: 0.3, off: 0.2 }), by: ContactBy::Model, ..by_force };
        detector.handle_thresholds(own);
        assert_eq!(contact(&mut detector, 0.0, Some(0.3)), (true, true, true), "the parameters before the model");
    }

    #[test]
    fn a_doubtful_touch_takes_longer_than_one_without_doubt() {
        let output = TouchOutput { levels: TouchLevels { on: 0.5, off: 0.25 }, false_per_min: None };
        let begins_after = |evidence: f64, margin: f64, touch: &[f64]| {
            let thresholds = ContactThresholds { touch_evidence: evidence, ..*detector(2, 1).thresholds() };
            let mut detector = ContactDetector::new(thresholds, Some(output));
            let mut frames = (0..).zip(touch.iter().cycle().take(1000));
            frames.find_map(|(at, touch)| {
                let contact = detector.handle_estimate(Stamp(at), None, Some(*touch), margin);
                (contact.event == ContactEvent::Onset).then_some((at, contact.since))
            })
        };
        // The lower level has log odds of -1.10, so 0.5 adds 1.10 a frame, 0.999 adds 8.0.
        assert_eq!(begins_after(6.0, 0.0, &[0.999]), Some((1, Stamp(0))), "no later than its two frames");
        assert_eq!(begins_after(6.0, 0.0, &[0.5]), Some((5, Stamp(0))));
        assert_eq!(begins_after(0.0, 0.0, &[0.5]), Some((1, Stamp(0))));
        assert_eq!(begins_after(6.0, 0.5, &[0.5]), Some((10, Stamp(0))), "each frame is 0.60");
        assert_eq!(begins_after(0.0, 0.5, &[0.5]), Some((1, Stamp(0))), "none is asked for");
        assert_eq!(begins_after(6.0, 1.2, &[0.5]), None, "no frame is evidence");
        assert_eq!(begins_after(6.0, 1.2, &[0.999]), Some((1, Stamp(0))));
        // One frame of three is at the lower level: it takes nothing away, and the two others must follow on each other.
        assert_eq!(begins_after(6.0, 0.0, &[0.25, 0.6, 0.6]), Some((5, Stamp(4))));
        assert_eq!(begins_after(6.0, 0.0, &[0.6, 0.6, 0.6, 0.001]), None, "doubt takes away what was there");
        assert_eq!(begins_after(6.0, 0.0, &[0.6, 0.6, 0.6, f64::NAN]), None);
        assert_eq!(begins_after(6.0, 0.0, &[1.0]), Some((1, Stamp(0))), "a certain one is finite");
    }
}
