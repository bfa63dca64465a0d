//! What a hand costs: one message of its points to the angles of its joints, as the node and a replay do it.
//!
//! At 90 Hz, as headsets send them, 20 us a hand are 0.2 % of a core: `taskset -c 0 cargo bench --bench hand`.
#![allow(clippy::print_stdout)] // the table is the result

use std::time::Instant;

use tactile_pose_fusion::hand::{HandPose, JOINTS, NamedLayout, Side, poses};
use tactile_pose_fusion::msg::binding::{
    HandFields, JointBinding, JointFields, NamesFrom, StampFrom, hand_paths, hand_stamp,
};
use tactile_pose_fusion::msg::definition::TypeTree;
use tactile_pose_fusion::msg::*;
use tactile_pose_fusion::units::Stamp;

const LAYOUT: NamedLayout = NamedLayout::OpenXr25;
const N: usize = 20_000;

fn binding(type_name: &str) -> JointBinding {
    let (positions, names) = hand_paths(type_name).expect("a type that is known");
    let points = LAYOUT.points();
    let stamp = hand_stamp(type_name, &points).unwrap_or_else(|| "header.stamp".to_owned());
    let hand = HandFields {
        layout: LAYOUT.layout(),
        side: Side::Right,
        points,
        names: names.iter().map(|path| (*path).to_owned()).collect(),
        valid: None,
        first: 0,
        joints: JOINTS.map(str::to_owned).to_vec(),
    };
    let names = NamesFrom::Hand(Box::new(hand));
    let fields =
        JointFields { stamp: Some(StampFrom::Field(stamp)), positions: positions.to_owned(), names, only: None };
    let tree = TypeTree::from_schema(type_name, &definition_text(type_name).expect("known")).expect("it resolves");
    JointBinding::compile(&fields, &tree).expect("it compiles")
}

fn hand(k: usize) -> Vec<HandPose> {
    let angles = std::array::from_fn(|joint| 0.4 + 0.3 * (0.01 * k as f64 + joint as f64).sin());
    poses(&angles, LAYOUT, Side::Right)
}

fn header() -> Header {
    Header { stamp: Time { sec: 5, nanosec: 0 }, frame_id: "wrist".to_owned() }
}

fn rotation([x, y, z, w]: [f64; 4]) -> Quaternion {
    Quaternion { x, y, z, w }
}

fn pose_array(k: usize) -> Vec<u8> {
    let pose = |HandPose { position: [x, y, z], orientation }: HandPose| Pose {
        position: Point { x, y, z },
        orientation: rotation(orientation),
    };
    to_cdr(&PoseArray { header: header(), poses: hand(k).into_iter().map(pose).collect() })
}

fn transforms(k: usize) -> Vec<u8> {
    let transform =
        |(child_frame_id, HandPose { position: [x, y, z], orientation }): (String, HandPose)| TransformStamped {
            header: header(),
            child_frame_id,
            transform: Transform { translation: Vector3 { x, y, z }, rotation: rotation(orientation) },
        };
    to_cdr(&TFMessage { transforms: LAYOUT.points().into_iter().zip(hand(k)).map(transform).collect() })
}

/// Writes a hand of a number.
type Message = fn(usize) -> Vec<u8>;

fn main() {
    println!("| a hand of 25 points as | messages | p50 us | p99 us | max us |\n|---|---|---|---|---|");
    let forms = [(PoseArray::TYPE_NAME, pose_array as Message), (TFMessage::TYPE_NAME, transforms as Message)];
    for (type_name, message) in forms {
        let mut binding = binding(type_name);
        let messages: Vec<Vec<u8>> = (0..256).map(message).collect();
        let mut micros: Vec<f64> = (0..N)
            .map(|k| {
                let cdr = &messages[k % messages.len()];
                let began = Instant::now();
                let angles = binding.decode(cdr, Stamp(9)).expect("angles");
                let taken = began.elapsed().as_secs_f64() * 1e6;
                assert!(angles.positions.iter().all(|angle| angle.is_finite()));
                taken
            })
            .collect();
        micros.sort_by(f64::total_cmp);
        let at = |share: f64| micros[((N - 1) as f64 * share) as usize];
        println!("| {type_name} | {N} | {:.2} | {:.2} | {:.1} |", at(0.5), at(0.99), at(1.0));
    }
}
