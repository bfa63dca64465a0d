//! Frames of `/tf` and `/tf_static`: where they are in a frame that they have in common.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::hand::Point;

/// Maximum number of frames that are stored. Two hands on a robot have about a hundred.
const MAX_FRAMES: usize = 1024;

/// Longest chain of frames that is followed, so that a cycle ends.
const MAX_CHAIN: usize = 64;

/// Number of rounds after which a frame that was not sent again is forgotten.
const MAX_ROUNDS: u64 = 10;

/// The frames of one joint source, whichever of its topics tell them.
#[derive(Debug, Clone, Default)]
pub struct FrameStore(Arc<Mutex<Frames>>);

impl FrameStore {
    pub(super) fn lock(&self) -> MutexGuard<'_, Frames> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The newest transform of each frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Frames {
    links: BTreeMap<String, Link>,
    round: u64,
}

/// A frame's transform in its parent.
#[derive(Debug, Clone)]
struct Link {
    parent: String,
    translation: Point,
    rotation: [f64; 4], // x, y, z, w
    /// None where it holds until it is told anew.
    round: Option<u64>,
}

impl Frames {
    /// Takes a transform of `child` in `parent`, which holds for good where it `is_static`. Beyond [`MAX_FRAMES`] new frames
    /// are left out.
    pub(super) fn handle(
        &mut self,
        (parent, child): (&str, &str),
        translation: Point,
        rotation: [f64; 4],
        is_static: bool,
    ) {
        let round = (!is_static).then_some(self.round);
        let is_full = self.links.len() >= MAX_FRAMES;
        match self.links.get_mut(child) {
            Some(link) => {
                if link.parent != parent {
                    parent.clone_into(&mut link.parent);
                }
                (link.translation, link.rotation, link.round) = (translation, rotation, round);
            }
            None if !is_full => {
                let parent = parent.to_owned();
                self.links.insert(child.to_owned(), Link { parent, translation, rotation, round });
            }
            None => {}
        }
    }

    /// Marks that all frames of the hand were sent once more.
    pub(super) fn end_round(&mut self) {
        self.round += 1;
    }

    /// Origin of a frame in the root of its chain of parents, and the name of that root. `None` if a transform on the
    /// way is invalid or outdated.
    pub(super) fn origin<'a>(&'a self, frame: &'a str) -> Option<(Point, &'a str)> {
        let (mut point, mut at) = ([0.0; 3], frame);
        for _ in 0..MAX_CHAIN {
            let Some(link) = self.links.get(at) else { return Some((point, at)) };
            if link.round.is_some_and(|round| self.round - round > MAX_ROUNDS) {
                return None;
            }
            let turned = turned(point, link.rotation)?;
            point = std::array::from_fn(|axis| turned[axis] + link.translation[axis]);
            at = &link.parent;
        }
        None
    }
}

/// Rotates a point by a quaternion of any length other than 0.
fn turned(point: Point, [x, y, z, w]: [f64; 4]) -> Option<Point> {
    let square = x * x + y * y + z * z + w * w;
    if !(square.is_finite() && square > 1e-6) {
        return None;
    }
    let cross = |a: Point, b: Point| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let axis = [x, y, z];
    let once = cross(axis, point);
    let twice = cross(axis, once);
    Some(std::array::from_fn(|k| point[k] + 2.0 * (w * once[k] + twice[k]) / square))
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUARTER: f64 = std::f64::consts::FRAC_1_SQRT_2;

    #[test]
    fn origins_are_those_of_the_whole_chain() {
        let mut frames = Frames::default();
        frames.handle(("wrist", "index"), [1.0, 0.0, 0.0], [0.0, 0.0, 2.0 * QUARTER, 2.0 * QUARTER], false); // about z, any length
        frames.handle(("index", "tip"), [0.0, 3.0, 0.0], [0.0, 0.0, 0.0, 1.0], false);
        frames.handle(("tip", "nail"), [0.0, 0.0, 0.5], [QUARTER, 0.0, 0.0, QUARTER], false);
        let (point, root) = frames.origin("nail").unwrap();
        assert_eq!(root, "wrist");
        for (axis, expected) in [-2.0, 0.0, 0.5].into_iter().enumerate() {
            assert!((point[axis] - expected).abs() < 1e-12, "{point:?}"); // rounding of a turn
        }
        assert_eq!(frames.origin("wrist"), Some(([0.0; 3], "wrist")));
    }

    #[test]
    fn a_frame_that_is_not_heard_of_any_more_is_not_there() {
        let mut frames = Frames::default();
        let tell =
            |frames: &mut Frames, child: &str| frames.handle(("wrist", child), [1.0; 3], [0.0, 0.0, 0.0, 1.0], false);
        tell(&mut frames, "lost");
        frames.handle(("wrist", "mount"), [1.0; 3], [0.0, 0.0, 0.0, 1.0], true);
        for _ in 0..=MAX_ROUNDS {
            assert!(frames.origin("lost").is_some());
            tell(&mut frames, "kept");
            frames.end_round();
        }
        assert_eq!(frames.origin("lost"), None);
        assert!(frames.origin("kept").is_some() && frames.origin("mount").is_some());
    }

    #[test]
    fn no_rotation_and_no_end_give_no_point() {
        let mut frames = Frames::default();
        frames.handle(("a", "b"), [1.0; 3], [0.0; 4], false);
        frames.handle(("c", "d"), [1.0; 3], [0.0, 0.0, 0.0, 1.0], false);
        frames.handle(("d", "c"), [1.0; 3], [0.0, 0.0, 0.0, 1.0], false);
        frames.handle(("a", "e"), [1.0; 3], [f64::NAN; 4], false);
        assert_eq!(["b", "d", "e"].map(|frame| frames.origin(frame)), [None; 3]);
        (0..2 * MAX_FRAMES).for_each(|k| frames.handle(("a", &k.to_string()), [0.0; 3], [0.0, 0.0, 0.0, 1.0], false));
        assert_eq!(frames.links.len(), MAX_FRAMES);
    }
}
