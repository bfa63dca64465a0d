//! Light touches that are held: the model sees a fraction of a second, in which such a touch looks like an artifact. A contact that it saw goes on for as
//! long as the artifact filter sees the touch, unless the model denies it.

use crate::units::{NANOS_PER_SEC, Stamp};

/// A touch that is held was seen by the model for so long, ns, and below this probability, log odds of -3, the model denies it.
/// Chosen on validation data (docs/validation).
const SEEN_NS: f64 = 0.3e9;
const DENIED_TOUCH: f64 = 0.047_425_873_177_566_78;

/// A contact that ended with a gap of at most this time may be held again for so long after the gap, ns.
const RESUMED_GAP_NS: i64 = NANOS_PER_SEC;
const RESUMES_NS: i64 = 3 * NANOS_PER_SEC;

/// Whether the touch that goes on is held.
#[derive(Debug, Clone)]
pub(super) struct Hold {
    /// Frames in which the model saw the touch that goes on, and how many it must have seen.
    seen_frames: u32,
    enough_frames: u32,
    /// Until when a contact from before a gap may be held again.
    resumes_until: Option<Stamp>,
}

impl Hold {
    /// For frames of this length, ns.
    pub(super) fn new(frame_ns: f64) -> Self {
        Hold { seen_frames: 0, enough_frames: (SEEN_NS / frame_ns).ceil() as u32, resumes_until: None }
    }

    /// Takes note that so much time was lost before the frame at `stamp`, ns, and whether there was contact before it. A contact from before
    /// a short gap may be held again for some time, though the model did not see its onset. A gap that follows within that time
    /// doesn't end it.
    pub(super) fn handle_gap(&mut self, stamp: Stamp, lost_ns: i64, was_contact: bool) {
        self.seen_frames = 0;
        if !(0..=RESUMED_GAP_NS).contains(&lost_ns) {
            self.resumes_until = None;
        } else if was_contact {
            self.resumes_until = Some(stamp.offset(RESUMES_NS));
        }
    }

    /// Takes note of a frame that says nothing of touch: contact is not decided on it, or there is no estimate.
    pub(super) fn handle_unknown(&mut self) {
        self.seen_frames = 0;
    }

    /// Takes the probability of touch of the frame at `stamp`, that of contact, and the touch that the artifact filter sees beyond doubt, gF. The
    /// last, if the touch is held in this frame.
    pub(super) fn handle_touch(&mut self, stamp: Stamp, touch: f64, on: f64, filter_gf: Option<f64>) -> Option<f64> {
        if touch >= on {
            self.seen_frames = self.seen_frames.saturating_add(1);
            return None;
        }
        let resumes = self.resumes_until.is_some_and(|until| stamp <= until);
        let was_seen = resumes || self.seen_frames >= self.enough_frames;
        let held = filter_gf.filter(|_| was_seen && touch >= DENIED_TOUCH);
        if held.is_none() {
            self.seen_frames = 0;
        } else if resumes {
            self.seen_frames = self.seen_frames.max(self.enough_frames);
        }
        held
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME_NS: i64 = NANOS_PER_SEC / 100;

    /// At 100 frames a second: what is held in each of these frames, from `from` on, with this probability of touch, of which 0.5 is contact,
    /// where the filter sees 8 gF.
    fn held(hold: &mut Hold, from: i64, n: i64, touch: f64) -> Vec<Option<f64>> {
        let stamp = |frame: i64| Stamp((from + frame) * FRAME_NS);
        (0..n).map(|frame| hold.handle_touch(stamp(frame), touch, 0.5, Some(8.0))).collect()
    }

    fn hold() -> Hold {
        Hold::new(FRAME_NS as f64)
    }

    #[test]
    fn a_touch_that_was_seen_for_a_while_goes_on_until_filter_or_model_lose_it() {
        let mut hold = hold();
        assert_eq!(held(&mut hold, 0, 29, 0.9), [None; 29]);
        assert_eq!(held(&mut hold, 29, 2, 0.3), [None; 2], "seen for 0.29 s");
        held(&mut hold, 31, 30, 0.9);
        assert_eq!(held(&mut hold, 61, 500, 0.05), [Some(8.0); 500]);
        assert_eq!(held(&mut hold, 561, 1, 0.04), [None], "the model denies it");
        assert_eq!(held(&mut hold, 562, 3, 0.3), [None; 3], "what has ended does not go on");
        held(&mut hold, 565, 30, 0.9);
        assert_eq!(hold.handle_touch(Stamp(595 * FRAME_NS), 0.3, 0.5, None), None, "the filter does not see it");
        assert_eq!(held(&mut hold, 596, 3, 0.3), [None; 3]);
        held(&mut hold, 599, 30, 0.9);
        hold.handle_unknown();
        assert_eq!(held(&mut hold, 630, 3, 0.3), [None; 3], "a frame without an estimate");
    }

    #[test]
    fn a_contact_from_before_a_short_gap_is_held_again_for_three_seconds() {
        let after_gap = |lost_ns, was_contact| {
            let mut hold = hold();
            held(&mut hold, 0, 50, 0.9);
            hold.handle_gap(Stamp(100 * FRAME_NS), lost_ns, was_contact);
            hold
        };
        let mut at_once = after_gap(NANOS_PER_SEC, true);
        assert_eq!(held(&mut at_once, 101, 900, 0.3), [Some(8.0); 900], "and goes on, once it is held");
        let mut in_time = after_gap(NANOS_PER_SEC, true);
        assert_eq!(held(&mut in_time, 400, 2, 0.3), [Some(8.0); 2]);
        for (what, mut hold, from) in [
            ("too late", after_gap(NANOS_PER_SEC, true), 401),
            ("after a longer gap", after_gap(NANOS_PER_SEC + 1, true), 101),
            ("after a jump back", after_gap(-1, true), 101),
            ("without contact before", after_gap(NANOS_PER_SEC, false), 101),
        ] {
            assert_eq!(held(&mut hold, from, 3, 0.3), [None; 3], "{what}");
        }
        let mut again = after_gap(NANOS_PER_SEC, true);
        again.handle_gap(Stamp(150 * FRAME_NS), NANOS_PER_SEC, false);
        assert_eq!(held(&mut again, 151, 3, 0.3), [Some(8.0); 3], "a second gap within that time");
        again.handle_gap(Stamp(200 * FRAME_NS), i64::MAX, true);
        assert_eq!(held(&mut again, 201, 3, 0.3), [None; 3], "a new zero");
    }
}
