//! Messages of hands as points, poses and frames, turned into joint angles.

use std::sync::OnceLock;

use serde::{Deserialize, Serialize};
use tactile_pose_fusion::hand::{JOINTS, NamedLayout, Side, poses};
use tactile_pose_fusion::msg::binding::{
    HandFields, JointBinding, JointFields, NamesFrom, StampFrom, hand_paths, hand_stamp,
};
use tactile_pose_fusion::msg::definition::TypeTree;
use tactile_pose_fusion::msg::*;
use tactile_pose_fusion::units::Stamp;

use super::driver::{Answer, Target};
use super::mutate::{self, Random};

pub const TARGET: Target = Target { name: "hand", seeds, mutate: other, run, min_understood: 0.2 };

const MANUS_TEXT: &str = "int32 glove_id\nstring side\nManusRawNode[] raw_nodes\n\
    ================================================================================\nMSG: manus_ros2_msgs/ManusRawNode\n\
    int32 node_id\nstring joint_type\nstring chain_type\ngeometry_msgs/Pose pose\n";

const NAMED_TEXT: &str = "Joint[] joints\n\
    ================================================================================\nMSG: p/Joint\n\
    string name\ngeometry_msgs/Pose pose\nbool valid\n";

const POSE_TEXT: &str = "================================================================================\n\
    MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n\
    ================================================================================\n\
    MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n\
    ================================================================================\n\
    MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";

/// Ways in which a hand comes, each by the first byte of an input.
fn bindings() -> &'static [JointBinding] {
    static BINDINGS: OnceLock<Vec<JointBinding>> = OnceLock::new();
    BINDINGS.get_or_init(|| {
        let named = |text: &str| format!("{text}{POSE_TEXT}");
        let ours = |name: &str| (name.to_owned(), definition_text(name).unwrap());
        let ways = [
            (ours("geometry_msgs/msg/PoseArray"), NamedLayout::OpenXr25, "poses[].position", None),
            (ours("geometry_msgs/msg/PoseArray"), NamedLayout::Mano21, "poses[].position", None),
            (ours("std_msgs/msg/Float32MultiArray"), NamedLayout::OpenXr, "data", None),
            (
                (Named::TYPE_NAME.to_owned(), named(NAMED_TEXT)),
                NamedLayout::OpenXr,
                "joints[].pose.position",
                Some("joints[].valid"),
            ),
            ((Manus::TYPE_NAME.to_owned(), named(MANUS_TEXT)), NamedLayout::Manus, "raw_nodes[].pose.position", None),
            (ours("tf2_msgs/msg/TFMessage"), NamedLayout::OpenXr25, "transforms[].transform.translation", None),
        ];
        ways.into_iter()
            .map(|((type_name, text), layout, positions, valid)| {
                let tree = TypeTree::from_schema(&type_name, &text).unwrap();
                let known = hand_paths(&type_name).map_or(&[][..], |known| known.names);
                let names = known.iter().copied().chain(valid.map(|_| "joints[].name")).map(str::to_owned).collect();
                let points = layout.points();
                let stamp = hand_stamp(&type_name, &points).map_or(StampFrom::Receipt, StampFrom::Field);
                let hand = HandFields {
                    layout: layout.layout(),
                    side: Side::Right,
                    points,
                    names,
                    valid: valid.map(str::to_owned),
                    first: 0,
                    joints: JOINTS.map(str::to_owned).to_vec(),
                };
                let names = NamesFrom::Hand(Box::new(hand));
                let fields = JointFields { stamp: Some(stamp), positions: positions.to_owned(), names, only: None };
                JointBinding::compile(&fields, &tree).unwrap()
            })
            .collect()
    })
}

#[derive(Serialize, Deserialize)]
struct Named {
    joints: Vec<(String, Pose, bool)>,
}

impl WireType for Named {
    const TYPE_NAME: &'static str = "p/msg/Named";
}

#[derive(Serialize, Deserialize)]
struct Manus {
    glove_id: i32,
    side: String,
    raw_nodes: Vec<(i32, String, String, Pose)>,
}

impl WireType for Manus {
    const TYPE_NAME: &'static str = "manus_ros2_msgs/msg/ManusGlove";
}

/// Points of a bent hand, by name.
fn points(layout: NamedLayout, bend: f64) -> Vec<(String, Pose)> {
    let of_point = |pose: tactile_pose_fusion::hand::HandPose| {
        let ([x, y, z], [qx, qy, qz, qw]) = (pose.position, pose.orientation);
        Pose { position: Point { x, y, z }, orientation: Quaternion { x: qx, y: qy, z: qz, w: qw } }
    };
    layout.points().into_iter().zip(poses(&[bend; 20], layout, Side::Right).into_iter().map(of_point)).collect()
}

fn seeds() -> Vec<Vec<u8>> {
    let array = |layout| PoseArray {
        header: Header::default(),
        poses: points(layout, 0.4).into_iter().map(|(_, pose)| pose).collect(),
    };
    let flat = |bend| {
        let coordinates =
            |(_, pose): (String, Pose)| [pose.position.x, pose.position.y, pose.position.z].map(|part| part as f32);
        let data = points(NamedLayout::OpenXr, bend).into_iter().flat_map(coordinates).collect();
        Float32MultiArray { layout: MultiArrayLayout::default(), data }
    };
    let named = |valid| Named {
        joints: points(NamedLayout::OpenXr, 0.4).into_iter().map(|(name, pose)| (name, pose, valid)).collect(),
    };
    let node = |(name, pose): (String, Pose)| {
        let (chain, joint) = name.split_once('_').unwrap();
        (3, joint.to_owned(), chain.to_owned(), pose)
    };
    let manus = Manus {
        glove_id: 1,
        side: "Left".to_owned(),
        raw_nodes: points(NamedLayout::Manus, 0.4).into_iter().map(node).collect(),
    };
    // Each frame in the one before it, in a message or in two.
    let mut parent = "world".to_owned();
    let mut transforms: Vec<TransformStamped> = Vec::new();
    for (name, Pose { position: Point { x, y, z }, orientation: rotation }) in points(NamedLayout::OpenXr25, 0.4) {
        let header = Header { stamp: Time { sec: 3, nanosec: 4 }, frame_id: parent };
        let transform = Transform { translation: Vector3 { x, y, z }, rotation };
        transforms.push(TransformStamped { header, child_frame_id: name.clone(), transform });
        parent = name;
    }
    let rest = transforms.split_off(9);
    let (first, rest) = (TFMessage { transforms }, TFMessage { transforms: rest });
    vec![
        input(0, &[to_cdr(&array(NamedLayout::OpenXr25))]),
        input(1, &[to_cdr(&array(NamedLayout::Mano21))]),
        input(2, &[to_cdr(&flat(0.0)), to_cdr(&flat(0.4))]),
        input(3, &[to_cdr(&named(true)), to_cdr(&named(false))]),
        input(4, &[to_cdr(&manus)]),
        input(5, &[to_cdr(&first), to_cdr(&rest), to_cdr(&rest)]),
    ]
}

/// Messages one after another, each behind its length.
fn input(kind: u8, messages: &[Vec<u8>]) -> Vec<u8> {
    let framed = messages.iter().flat_map(|message| [&(message.len() as u16).to_le_bytes()[..], message].concat());
    [kind].into_iter().chain(framed).collect()
}

fn other(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    let mut input = seed.to_vec();
    let first = input.first().copied().unwrap_or_default();
    mutate::bytes(random, &mut input, other);
    // Most often of the same kind: one that its bytes fit.
    if let (true, Some(kind)) = (random.percent(90), input.first_mut()) {
        *kind = first;
    }
    input
}

fn run(input: &[u8]) -> Answer {
    let Some((kind, mut rest)) = input.split_first() else { return Answer::refused("empty") };
    let bindings = bindings();
    let mut binding = bindings[usize::from(*kind) % bindings.len()].clone();
    let (mut known, mut refused) = (Vec::new(), None);
    while let [low, high, behind @ ..] = rest {
        let len = usize::from(u16::from_le_bytes([*low, *high])).min(behind.len());
        let (message, after) = behind.split_at(len);
        rest = after;
        match binding.decode(message, Stamp(9)) {
            Ok(angles) => {
                assert_eq!((angles.names.len(), angles.positions.len()), (JOINTS.len(), JOINTS.len()));
                // Missing or an angle: never infinite, never beyond half a turn.
                let is_angle = |angle: &f64| angle.is_nan() || angle.abs() <= std::f64::consts::PI;
                assert!(angles.positions.iter().all(is_angle), "{:?}", angles.positions);
                known.push(angles.positions.iter().map(|angle| angle.is_finite()).collect::<Vec<_>>());
            }
            Err(error) => refused = Some(super::one_line(&error)),
        }
    }
    match (known.is_empty(), refused) {
        (false, _) | (true, None) => Answer::understood(&(kind, known)),
        (true, Some(refused)) => refused,
    }
}
