//! From joint angles to the points of a hand: the inverse of [`angles`](super::angles), for a hand of average size.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use super::layout::NamedLayout;
use super::{Axes, JOINTS, Point, Side};

/// A point of a hand with its orientation, in the convention of OpenXR.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandPose {
    /// Position, m.
    pub position: Point,
    /// Unit quaternion x, y, z, w: -z along the bone to the next point, +y out of the back of the hand.
    pub orientation: [f64; 4],
}

/// Knuckles of a right hand at the origin that points along z with its back along y, m: index to little finger.
const KNUCKLES: [Point; 4] = [[0.025, 0.0, 0.09], [0.0, 0.0, 0.092], [-0.02, 0.0, 0.087], [-0.038, 0.0, 0.078]];

/// Start of the thumb's metacarpal, m.
const THUMB: Point = [0.022, -0.004, 0.022];

/// Lengths of the bones after a knuckle, m: proximal, middle, distal; of index to little finger.
const BONES: [[f64; 3]; 4] =
    [[0.043, 0.025, 0.022], [0.047, 0.029, 0.023], [0.044, 0.028, 0.023], [0.034, 0.02, 0.021]];

/// Lengths of the thumb's bones, m: metacarpal, proximal, distal.
const THUMB_BONES: [f64; 3] = [0.045, 0.033, 0.027];

/// Where a metacarpal starts, as a share of the way from the wrist to its knuckle.
const METACARPAL: f64 = 0.25;

/// The points of a hand with these angles, in the order of [`NamedLayout::points`].
///
/// `angles`: rad, in the order of [`JOINTS`]. The wrist is at the origin; +z points to the middle knuckle and +y out of the
/// back of the hand. A NaN among the angles makes the points beyond its joint NaN.
pub fn poses(angles: &[f64; JOINTS.len()], layout: NamedLayout, side: Side) -> Vec<HandPose> {
    let own = |[x, y, z]: Point| [if side == Side::Left { -x } else { x }, y, z];
    let back = [0.0, 1.0, 0.0];
    let frame = |forward: Point| Axes::at(super::vector::direction(forward), Some(back), side);
    let palm = frame(KNUCKLES[1].map(|part| part));
    let mut poses = Vec::with_capacity(26);
    let wrist = pose([0.0; 3], palm, side);
    match layout {
        NamedLayout::OpenXr => poses.extend([pose(own(KNUCKLES[1]).map(|part| part / 2.0), palm, side), wrist]),
        NamedLayout::OpenXr25 | NamedLayout::Mano21 | NamedLayout::Manus => poses.push(wrist),
    }
    let [.., ip, mcp, flexion, abduction] = *angles;
    chain(&mut poses, own(THUMB), palm, THUMB_BONES, side, [(flexion, abduction), (0.0, -mcp), (0.0, -ip)]);
    for (finger, (knuckle, bones)) in KNUCKLES.into_iter().zip(BONES).enumerate() {
        let knuckle = own(knuckle);
        let metacarpal = frame(knuckle);
        if layout != NamedLayout::Mano21 {
            poses.push(pose(knuckle.map(|part| METACARPAL * part), metacarpal, side));
        }
        let [dip, pip, flexion, abduction] = [0, 1, 2, 3].map(|joint| angles[4 * finger + joint]);
        chain(&mut poses, knuckle, metacarpal, bones, side, [(flexion, abduction), (pip, 0.0), (dip, 0.0)]);
    }
    poses
}

/// Four points along three bones, each turned by flexion and abduction against the one before.
fn chain(
    poses: &mut Vec<HandPose>,
    start: Point,
    before: Option<Axes>,
    lengths: [f64; 3],
    side: Side,
    turns: [(f64, f64); 3],
) {
    let (mut position, mut frame) = (start, before);
    for ((flexion, abduction), length) in turns.into_iter().zip(lengths) {
        frame = frame.and_then(|frame| frame.turned(flexion, abduction));
        poses.push(pose(position, frame, side));
        let step = frame.map_or([f64::NAN; 3], |frame| frame.forward.map(|part| length * part));
        position = [0, 1, 2].map(|axis| position[axis] + step[axis]);
    }
    poses.push(pose(position, frame, side));
}

fn pose(position: Point, frame: Option<Axes>, side: Side) -> HandPose {
    let orientation = frame.map_or([f64::NAN; 4], |Axes { forward, radial, back }| {
        // The thumb of a right hand is on its left, seen from the back.
        let x = radial.map(|part| if side == Side::Right { -part } else { part });
        let columns = [x, back, forward.map(|part| -part)].concat();
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_column_slice(&columns));
        let quaternion = UnitQuaternion::from_rotation_matrix(&rotation);
        [quaternion.i, quaternion.j, quaternion.k, quaternion.w]
    });
    HandPose { position, orientation }
}
