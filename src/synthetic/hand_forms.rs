//! The synthetic hand as trackers send hands: poses of its points, or a tree of frames.

use nalgebra::{Quaternion as Components, UnitQuaternion, Vector3 as Vector};

use crate::hand::{self, HandPose, NamedLayout, Side};
use crate::msg::{Header, Point, Pose, Quaternion, TFMessage, Transform, TransformStamped, Vector3};
use crate::sim::hand::JOINTS;
use crate::units::Stamp;

/// Form in which the hand is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum HandForm {
    /// Joint angles on [`JOINTS`](super::JOINTS).
    #[default]
    Angles,
    /// The poses of a right hand's points on [`POSES`](super::POSES), in the order of a layout.
    Poses(NamedLayout),
    /// The positions of a right hand's points on [`KEYPOINTS`](super::KEYPOINTS), in the order of a layout: x, y and z of
    /// each in turn.
    Keypoints(NamedLayout),
    /// The named poses of a right hand's points on [`NAMED_POSES`](super::NAMED_POSES), each valid or not.
    Named,
    /// The points of a right hand as a Manus glove sends them on [`MANUS_GLOVE`](super::MANUS_GLOVE), without a stamp.
    Manus,
    /// The points of a right hand as frames on [`FRAMES`](super::FRAMES): each in the one before it on its finger, by the
    /// names of `openxr25`. Those that never move are on [`STATIC_FRAMES`](super::STATIC_FRAMES).
    Transforms,
}

/// The layout whose points are the frames.
const FRAMES_OF: NamedLayout = NamedLayout::OpenXr25;

/// The frame that the wrist is in.
const ROOT: &str = "hand_tracker";

/// The poses of a right hand; NaN where an angle is missing.
pub(super) fn poses(names: &[String], positions: &[f64], layout: NamedLayout) -> Vec<Pose> {
    let pose = |HandPose { position: [x, y, z], orientation: [qx, qy, qz, qw] }: HandPose| Pose {
        position: Point { x, y, z },
        orientation: Quaternion { x: qx, y: qy, z: qz, w: qw },
    };
    hand_of(names, positions, layout).into_iter().map(pose).collect()
}

/// The frames of a right hand that move; NaN where an angle is missing.
pub(super) fn frames(names: &[String], positions: &[f64], stamp: Stamp) -> TFMessage {
    frames_of(&hand_of(names, positions, FRAMES_OF), stamp, |point| !never_moves(point))
}

/// Those that don't: the wrist, and where the fingers' metacarpals begin.
pub fn static_frames(stamp: Stamp) -> TFMessage {
    frames_of(&hand::poses(&[0.0; JOINTS.len()], FRAMES_OF, Side::Right), stamp, never_moves)
}

fn never_moves(point: usize) -> bool {
    let layout = FRAMES_OF.layout();
    point == layout.wrist || layout.fingers.iter().any(|chain| chain[0] == point)
}

fn frames_of(poses: &[HandPose], stamp: Stamp, is_wanted: impl Fn(usize) -> bool) -> TFMessage {
    let points = FRAMES_OF.points();
    let layout = FRAMES_OF.layout();
    let mut parents = vec![None; poses.len()];
    for chain in layout.fingers.iter().map(|chain| &chain[..]).chain([&layout.thumb[..]]) {
        let mut before = layout.wrist;
        for &point in chain {
            parents[point] = Some(before);
            before = point;
        }
    }
    let frame = |(child, parent): (usize, Option<usize>)| {
        let (frame_id, transform) = match parent {
            Some(parent) => (points[parent].clone(), between(&poses[parent], &poses[child])),
            None => (ROOT.to_owned(), between(&origin(), &poses[child])),
        };
        let header = Header { stamp: stamp.into(), frame_id };
        TransformStamped { header, child_frame_id: points[child].clone(), transform }
    };
    TFMessage {
        transforms: parents.into_iter().enumerate().filter(|(point, _)| is_wanted(*point)).map(frame).collect(),
    }
}

fn hand_of(names: &[String], positions: &[f64], layout: NamedLayout) -> Vec<HandPose> {
    let angle = |joint: &str| names.iter().zip(positions).find(|(name, _)| *name == joint).map(|(_, angle)| *angle);
    let angles = JOINTS.map(|joint| angle(joint).unwrap_or(f64::NAN));
    hand::poses(&angles, layout, Side::Right)
}

fn origin() -> HandPose {
    HandPose { position: [0.0; 3], orientation: [0.0, 0.0, 0.0, 1.0] }
}

/// Where a pose is, seen from another one.
fn between(parent: &HandPose, child: &HandPose) -> Transform {
    let turn = |[x, y, z, w]: [f64; 4]| UnitQuaternion::new_unchecked(Components::new(w, x, y, z));
    let place = |[x, y, z]: [f64; 3]| Vector::new(x, y, z);
    let back = turn(parent.orientation).inverse();
    let offset = back * (place(child.position) - place(parent.position));
    let turned = back * turn(child.orientation);
    Transform {
        translation: Vector3 { x: offset.x, y: offset.y, z: offset.z },
        rotation: Quaternion { x: turned.i, y: turned.j, z: turned.k, w: turned.w },
    }
}
