//! What a hand costs: one message of its points to the angles of its joints, as the node and a replay do it.
//!
//! At 90 Hz, as headsets send them, 20 us a hand are 0.2 % of a core: `taskset -c 0 cargo bench --bench hand`. The hands
//! are those of `tpf simulate --hand` (synthetic), in every form.
#![allow(clippy::print_stdout)] // the table is the result

use std::time::Instant;

use tactile_pose_fusion::hand::{JOINTS, NamedLayout, Side};
use tactile_pose_fusion::msg::binding::{
    HandFields, HandPaths, JointBinding, JointFields, NamesFrom, StampFrom, hand_paths, hand_stamp,
};
use tactile_pose_fusion::sim::Record;
use tactile_pose_fusion::sim::hand::JOINTS as SIMULATED;
use tactile_pose_fusion::synthetic::{HandForm, HandMessage, Message, message, static_frames};
use tactile_pose_fusion::units::Stamp;

const N: usize = 20_000;
const STAMP: Stamp = Stamp(5_000_000_000);

/// The forms, each with the layout that reads it.
const FORMS: [(HandForm, NamedLayout, &str); 6] = [
    (HandForm::Poses(NamedLayout::OpenXr), NamedLayout::OpenXr, "26 poses by index"),
    (HandForm::Keypoints(NamedLayout::OpenXr), NamedLayout::OpenXr, "26 keypoints"),
    (HandForm::Keypoints(NamedLayout::Mano21), NamedLayout::Mano21, "21 keypoints"),
    (HandForm::Named, NamedLayout::OpenXr, "26 named poses"),
    (HandForm::Manus, NamedLayout::Manus, "25 nodes of a Manus glove"),
    (HandForm::Transforms, NamedLayout::OpenXr25, "25 transforms"),
];

fn binding(form: HandForm, layout: NamedLayout) -> JointBinding {
    let points = layout.points();
    let known = hand_paths(form.type_name());
    let HandPaths { positions, names, valid } =
        known.unwrap_or(HandPaths { positions: "data", names: &[], valid: None });
    let stamp = match hand_stamp(form.type_name(), &points) {
        Some(path) => StampFrom::Field(path),
        None => StampFrom::Receipt,
    };
    let hand = HandFields {
        layout: layout.layout(),
        side: Side::Right,
        points,
        names: names.iter().map(|path| (*path).to_owned()).collect(),
        valid: valid.map(str::to_owned),
        first: 0,
        joints: JOINTS.map(str::to_owned).to_vec(),
    };
    let names = NamesFrom::Hand(Box::new(hand));
    let fields = JointFields { stamp: Some(stamp), positions: positions.to_owned(), names, only: None };
    JointBinding::compile(&fields, &form.type_tree()).expect("it compiles")
}

fn encoded(form: HandForm, k: usize) -> Vec<u8> {
    let angle = |joint: usize| 0.4 + 0.3 * (0.01 * k as f64 + joint as f64).sin();
    let names: Vec<String> = SIMULATED.iter().map(|joint| (*joint).to_owned()).collect();
    let positions = (0..names.len()).map(angle).collect();
    let record = Record::Joints { stamp: STAMP, received: STAMP, names: names.into(), positions };
    let Message::Hand(mut hand) = message(&record, form) else { unreachable!("angles become a hand") };
    if let HandMessage::Transforms(moving) = &mut hand {
        moving.transforms.splice(0..0, static_frames(STAMP).transforms);
    }
    let mut cdr = Vec::new();
    hand.to_cdr_into(&mut cdr);
    cdr
}

fn main() {
    println!("| a synthetic hand as | messages | bytes | p50 us | p99 us | max us |\n|---|---|---|---|---|---|");
    for (form, layout, told) in FORMS {
        let mut binding = binding(form, layout);
        let messages: Vec<Vec<u8>> = (0..256).map(|k| encoded(form, k)).collect();
        let mut micros: Vec<f64> = (0..N)
            .map(|k| {
                let cdr = &messages[k % messages.len()];
                let began = Instant::now();
                let angles = binding.decode(cdr, STAMP).expect("angles");
                let taken = began.elapsed().as_secs_f64() * 1e6;
                assert!(angles.positions.iter().all(|angle| angle.is_finite()), "{told}");
                taken
            })
            .collect();
        micros.sort_by(f64::total_cmp);
        let at = |share: f64| micros[((N - 1) as f64 * share) as usize];
        println!("| {told} | {N} | {} | {:.2} | {:.2} | {:.1} |", messages[0].len(), at(0.5), at(0.99), at(1.0));
    }
}
