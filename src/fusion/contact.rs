//! From force to contact: one threshold for the raw flag, hysteresis and debounce for the state.

use super::config::ContactThresholds;
use crate::units::{Newton, Stamp};

/// What changed at a frame.
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
    /// Force at or above the on threshold at this very frame: what the paper's metrics use. False without an estimate.
    pub raw: bool,
    /// State with hysteresis and debounce. Held over frames without an estimate, which their flags tell.
    pub state: bool,
    /// What changed at this frame.
    pub event: ContactEvent,
    /// First frame of the run of forces that led to the current state.
    pub since: Stamp,
}

/// The state machine of one region.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactDetector {
    thresholds: ContactThresholds,
    state: bool,
    since: Option<Stamp>,
    run_frames: u32,
    run_start: Stamp,
    lost: bool,
}

impl ContactDetector {
    /// A detector that starts without contact.
    pub fn new(thresholds: ContactThresholds) -> Self {
        ContactDetector { thresholds, state: false, since: None, run_frames: 0, run_start: Stamp(0), lost: false }
    }

    /// Takes the force of the frame at `stamp`, `None` where there is no estimate.
    pub fn handle_force(&mut self, stamp: Stamp, force: Option<Newton>) -> Contact {
        let mut event = ContactEvent::None;
        if std::mem::take(&mut self.lost) {
            event = ContactEvent::Offset;
            self.since = Some(stamp);
        }
        if let Some(force) = force {
            let (opposes, needed) = if self.state {
                (force < self.thresholds.force_off, self.thresholds.off_frames)
            } else {
                (force >= self.thresholds.force_on, self.thresholds.on_frames)
            };
            if opposes {
                if self.run_frames == 0 {
                    self.run_start = stamp;
                }
                self.run_frames += 1;
            } else {
                self.run_frames = 0;
            }
            if self.run_frames >= needed {
                self.state = !self.state;
                self.since = Some(self.run_start);
                self.run_frames = 0;
                event = if self.state { ContactEvent::Onset } else { ContactEvent::Offset };
            }
        }
        Contact {
            raw: force.is_some_and(|force| force >= self.thresholds.force_on),
            state: self.state,
            event,
            since: *self.since.get_or_insert(stamp),
        }
    }

    /// Takes other thresholds. The state is kept until a run of forces is against it; a run so far is forgotten.
    pub fn handle_thresholds(&mut self, thresholds: ContactThresholds) {
        self.thresholds = thresholds;
        self.run_frames = 0;
    }

    /// Forgets the state because frames were lost. A contact that was there ends with the next frame.
    pub fn handle_reset(&mut self) {
        self.lost |= self.state;
        self.state = false;
        self.run_frames = 0;
    }

    /// The thresholds in force.
    pub fn thresholds(&self) -> &ContactThresholds {
        &self.thresholds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn detector(on_frames: u32, off_frames: u32) -> ContactDetector {
        ContactDetector::new(ContactThresholds {
            force_on: Newton(0.02),
            force_off: Newton(0.01),
            on_frames,
            off_frames,
        })
    }

    fn run(detector: &mut ContactDetector, forces: &[f64]) -> Vec<Contact> {
        let frames = forces.iter().enumerate();
        frames.map(|(k, &force)| detector.handle_force(Stamp(k as i64), Some(Newton(force)))).collect()
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
        assert_eq!(detector.handle_force(Stamp(0), Some(Newton(1.0))).event, ContactEvent::Onset);
        let unknown = detector.handle_force(Stamp(1), None);
        assert!(unknown.state && !unknown.raw);
        detector.handle_reset();
        let ended = detector.handle_force(Stamp(9), None);
        assert_eq!(ended, Contact { raw: false, state: false, event: ContactEvent::Offset, since: Stamp(9) });
        assert_eq!(detector.handle_force(Stamp(10), None).event, ContactEvent::None);
    }
}
