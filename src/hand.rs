//! Joint angles of a hand from its keypoints, and back: hand trackers send the latter, models need the former.
//!
//! A finger is a chain of bones: metacarpal, proximal, middle, distal. Each joint is the turn from one bone to the next,
//! told about an axis that points to the thumb's side and is carried along the chain. At its start that axis comes from the
//! palm: wrist, index knuckle and little knuckle. A straight finger on a flat hand therefore has angles of 0, and a
//! joint that bends backwards has a negative one.
//!
//! | joint | positive | zero |
//! |---|---|---|
//! | DIP, PIP, MCP flexion | towards the palm | the bone goes on from the one before it |
//! | MCP abduction | towards the thumb's side | likewise: the bone goes on from its metacarpal |
//! | thumb's CMC flexion | out of the plane of the palm, towards the palm's side | in that plane |
//! | thumb's CMC abduction | away from the fingers, in that plane | parallel to the line from wrist to middle knuckle |
//! | thumb's MCP, IP | the angle between the bones, never negative: points don't tell its axis | straight |
//!
//! Missing data stay missing: a point that isn't finite, two that coincide, or bones along the axis make the angles
//! that depend on them NaN, which the core takes for a joint without an angle.

mod forward;
mod layout;
mod vector;

pub use forward::{HandPose, poses};
pub use layout::{Layout, LayoutError, NamedLayout};

use vector::{cross, direction, dot, sub};

/// A point in any unit and any right-handed frame; NaN where it is missing.
pub type Point = [f64; 3];

/// Which hand it is. Its points alone don't tell: a left hand is a mirrored right one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The left hand.
    Left,
    /// The right hand.
    Right,
}

/// Joints of a hand, in the order of [`angles`]: four of each finger, then the thumb's.
pub const JOINTS: [&str; 20] = [
    "index_dip",
    "index_pip",
    "index_mcp_flex",
    "index_mcp_abd",
    "middle_dip",
    "middle_pip",
    "middle_mcp_flex",
    "middle_mcp_abd",
    "ring_dip",
    "ring_pip",
    "ring_mcp_flex",
    "ring_mcp_abd",
    "little_dip",
    "little_pip",
    "little_mcp_flex",
    "little_mcp_abd",
    "thumb_ip",
    "thumb_mcp",
    "thumb_cmc_flex",
    "thumb_cmc_abd",
];

/// Below this sine two directions are taken for parallel: they span no plane that noise wouldn't turn.
const LEAST_SINE: f64 = 1e-6;

/// The angles of a hand, rad, in the order of [`JOINTS`]; NaN where they can't be told. It asks for no memory.
///
/// `points` are those of a message, in the order of `layout`; those beyond its end are missing.
pub fn angles(points: &[Point], layout: &Layout, side: Side) -> [f64; 20] {
    let point = |idx: usize| points.get(idx).copied().unwrap_or([f64::NAN; 3]);
    let bone = |from: usize, to: usize| direction(sub(point(to), point(from)));
    let mut angles = [f64::NAN; 20];
    let knuckle = |finger: usize| layout.fingers[finger][1];
    let back = back_of_hand(bone(layout.wrist, knuckle(0)), bone(layout.wrist, knuckle(3)), side);
    for (finger, chain) in layout.fingers.iter().enumerate() {
        let bones = [0, 1, 2, 3].map(|k| bone(chain[k], chain[k + 1]));
        let Some(metacarpal) = Axes::at(bones[0], back, side) else { continue };
        let Some((proximal, flexion, abduction)) = metacarpal.turn(bones[1]) else { continue };
        angles[4 * finger + 2] = flexion;
        angles[4 * finger + 3] = abduction;
        let Some((middle, flexion, _)) = proximal.turn(bones[2]) else { continue };
        angles[4 * finger + 1] = flexion;
        if let Some((_, flexion, _)) = middle.turn(bones[3]) {
            angles[4 * finger] = flexion;
        }
    }
    let thumb = [0, 1, 2].map(|k| bone(layout.thumb[k], layout.thumb[k + 1]));
    angles[16] = between(thumb[1], thumb[2]);
    angles[17] = between(thumb[0], thumb[1]);
    let palm = Axes::at(bone(layout.wrist, knuckle(1)), back, side);
    if let Some((_, flexion, abduction)) = palm.and_then(|palm| palm.turn(thumb[0])) {
        (angles[18], angles[19]) = (flexion, abduction);
    }
    angles
}

/// A bone and the axis about which the next one flexes: unit vectors, at right angles.
#[derive(Debug, Clone, Copy)]
struct Axes {
    forward: Point,
    /// Towards the thumb's side.
    radial: Point,
    /// Towards the back of the hand.
    back: Point,
}

impl Axes {
    /// A bone that lies in a hand whose back points to `back`.
    fn at(forward: Option<Point>, back: Option<Point>, side: Side) -> Option<Self> {
        let (forward, back) = (forward?, back?);
        let radial = match side {
            Side::Right => cross(back, forward),
            Side::Left => cross(forward, back),
        };
        Self::upright(forward, steep(radial)?, back)
    }

    /// Keeps `forward` and turns the other two to right angles with it.
    fn upright(forward: Point, radial: Point, back: Point) -> Option<Self> {
        let without = |of: Point, along: Point| {
            let part = dot(of, along);
            sub(of, along.map(|component| component * part))
        };
        let radial = steep(without(radial, forward))?;
        let back = steep(without(without(back, forward), radial))?;
        Some(Axes { forward, radial, back })
    }

    /// The frame of a bone that is turned so.
    fn turned(&self, flexion: f64, abduction: f64) -> Option<Self> {
        let ((sin_f, cos_f), (sin_a, cos_a)) = (flexion.sin_cos(), abduction.sin_cos());
        let bone = [0, 1, 2].map(|k| cos_a * (cos_f * self.forward[k] - sin_f * self.back[k]) + sin_a * self.radial[k]);
        self.turn(direction(bone)).map(|(next, ..)| next)
    }

    /// The next bone, and by how much it turns: flexion in the plane of `forward` and `back`, then abduction out of it.
    fn turn(&self, bone: Option<Point>) -> Option<(Self, f64, f64)> {
        let bone = bone?;
        let (ahead, up, aside) = (dot(bone, self.forward), dot(bone, self.back), dot(bone, self.radial));
        let in_plane = ahead.hypot(up);
        if in_plane < LEAST_SINE {
            return None; // along the axis: it may have flexed by anything
        }
        let flexion = (-up).atan2(ahead);
        let (sin, cos) = flexion.sin_cos();
        let mut back = [0.0; 3];
        for (k, component) in back.iter_mut().enumerate() {
            *component = sin * self.forward[k] + cos * self.back[k];
        }
        Some((Self::upright(bone, self.radial, back)?, flexion, aside.atan2(in_plane)))
    }
}

/// The direction out of the back of the hand, from those of two bones within the palm.
fn back_of_hand(index: Option<Point>, little: Option<Point>, side: Side) -> Option<Point> {
    steep(match side {
        Side::Right => cross(little?, index?),
        Side::Left => cross(index?, little?),
    })
}

/// Its direction, where it is not all but 0: of what was made from unit vectors.
fn steep(vector: Point) -> Option<Point> {
    (dot(vector, vector) > LEAST_SINE * LEAST_SINE).then(|| direction(vector)).flatten()
}

/// The angle between two bones, accurate for small ones too.
fn between(one: Option<Point>, other: Option<Point>) -> f64 {
    let (Some(one), Some(other)) = (one, other) else { return f64::NAN };
    let across = cross(one, other);
    dot(across, across).sqrt().atan2(dot(one, other))
}
