//! Each wire struct and the text of its type say the same.

use std::collections::BTreeMap;
use std::fmt::Debug;

use serde_json::{Value as Json, json};
use tactile_pose_fusion::msg::definition::{MessageDefinition, TypeTree};
use tactile_pose_fusion::msg::dynamic::{Value, read_value};
use tactile_pose_fusion::msg::*;
use tactile_pose_fusion::units::Stamp;

fn header() -> Header {
    Header { stamp: Time { sec: -7, nanosec: 8 }, frame_id: "palm".to_owned() }
}

fn wrench() -> Wrench {
    let force = Vector3 { x: 1.5, y: -2.5, z: 3.25 };
    Wrench { force, torque: Vector3 { x: 4.5, y: 5.5, z: 6.5 } }
}

fn layout() -> MultiArrayLayout {
    let dim = |label: &str, size, stride| MultiArrayDimension { label: label.to_owned(), size, stride };
    MultiArrayLayout { dim: vec![dim("row", 2, 6), dim("taxel", 3, 3)], data_offset: 1 }
}

fn contact(region: &str) -> ContactState {
    ContactState {
        region: region.to_owned(),
        frame_id: "tip".to_owned(),
        contact_raw: true,
        contact: false,
        event: ContactState::OFFSET,
        since: Time { sec: 11, nanosec: 12 },
        force: 0.5,
        force_base: 0.75,
        artifact: 0.25,
        on_threshold: 0.125,
        off_threshold: 0.0625,
        mdf: 0.375,
        pose_age: 0.015625,
        age: 0.03125,
        flags: ContactState::STALE_POSE | ContactState::FAULTY_TAXEL,
        adaptation: ContactState::ADAPTATION_WAITING,
        artifact_change: 0.1875,
        touch: 0.875,
        touch_on: 0.75,
        touch_off: 0.5,
    }
}

/// Writes `message`, reads it by the definition, and compares each field by name; then reads it by the struct.
fn assert_mirrors<T: WireType + PartialEq + Debug>(message: &T, tree: &TypeTree) {
    let cdr = to_cdr(message);
    let (value, left) = read_value(tree, &cdr).expect(T::TYPE_NAME);
    assert_eq!(left, 0, "{}", T::TYPE_NAME);
    assert_eq!(as_json(&value), serde_json::to_value(message).expect("a struct"), "{}", T::TYPE_NAME);
    assert_eq!(&from_cdr::<T>(&cdr).expect(T::TYPE_NAME), message);
    let fields: Vec<String> = tree.root().fields.iter().map(|field| field.name.clone()).collect();
    let names = serde_json::to_string(message).expect("a struct");
    let mut at = 0;
    for field in fields {
        at += names[at..].find(&format!("\"{field}\":")).expect("the struct has its fields in the order of the text");
    }
}

fn assert_mirrors_text<T: WireType + PartialEq + Debug>(message: &T) {
    let text = definition_text(T::TYPE_NAME).expect(T::TYPE_NAME);
    assert_mirrors(message, &TypeTree::from_schema(T::TYPE_NAME, &text).expect(T::TYPE_NAME));
}

fn as_json(value: &Value<'_>) -> Json {
    match value {
        Value::Bool(value) => json!(value),
        Value::Int(value) => json!(value),
        Value::Unsigned(value) => json!(value),
        Value::Float(value) => json!(value),
        Value::Text(value) => json!(value),
        Value::Array(elements) => elements.iter().map(as_json).collect(),
        Value::Message(fields) => fields.iter().map(|(name, value)| (*name, as_json(value))).collect(),
    }
}

#[test]
fn our_structs_mirror_their_texts() {
    assert_mirrors_text(&TaxelArray {
        header: header(),
        sequence: u32::MAX,
        rows: 2,
        row_period: Duration { sec: 0, nanosec: 5_000_000 },
        values: vec![0.5, -1.5, 2.5, 4.25, 8.0, 1e9],
    });
    assert_mirrors_text(&contact("index"));
    assert_mirrors_text(&ContactArray { header: header(), contacts: vec![contact("index"), contact("thumb_tip")] });
    assert_mirrors_text(&Stage {
        header: header(),
        stage: Stage::LOADED_POSES,
        substage: "terminal_pose_transitions".to_owned(),
        pose: "fist".to_owned(),
        repetition: 300,
        zero_load: true,
    });
}

#[test]
fn standard_structs_mirror_their_texts() {
    assert_mirrors_text(&Time { sec: -1, nanosec: 2 });
    assert_mirrors_text(&Duration { sec: 3, nanosec: 4 });
    assert_mirrors_text(&header());
    assert_mirrors_text(&wrench().force);
    assert_mirrors_text(&wrench());
    assert_mirrors_text(&WrenchStamped { header: header(), wrench: wrench() });
    let pose =
        Pose { position: Point { x: 0.5, y: 1.5, z: 2.5 }, orientation: Quaternion { x: 3.5, y: 4.5, z: 5.5, w: 6.5 } };
    assert_mirrors_text(&pose.position);
    assert_mirrors_text(&pose.orientation);
    assert_mirrors_text(&pose);
    assert_mirrors_text(&PoseArray { header: header(), poses: vec![pose; 3] });
    let transform = Transform { translation: wrench().force, rotation: pose.orientation };
    assert_mirrors_text(&transform);
    let stamped = TransformStamped { header: header(), child_frame_id: "wrist".to_owned(), transform };
    assert_mirrors_text(&stamped);
    assert_mirrors_text(&TFMessage { transforms: vec![stamped; 2] });
    assert_mirrors_text(&JointState {
        header: header(),
        name: vec!["index_mcp".to_owned(), "index_pip".to_owned(), String::new()],
        position: vec![0.25, 0.5, 0.75],
        velocity: vec![],
        effort: vec![-1.0],
    });
    assert_mirrors_text(&layout().dim[0]);
    assert_mirrors_text(&layout());
    assert_mirrors_text(&Text { data: "a glove".to_owned() });
    assert_mirrors_text(&Float32MultiArray { layout: layout(), data: vec![0.5, 1.5, 2.5] });
}

#[test]
fn action_structs_mirror_the_action() {
    let text = include_str!("../../action/Calibrate.action");
    let parts: Vec<&str> = text.split("---\n").collect();
    assert_eq!(parts.len(), 3);
    // As messages of the package the parts resolve like any other.
    let tree = |part: &str| TypeTree::from_schema("tactile_pose_fusion/msg/Part", part).expect("it resolves");
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<String>>();
    assert_mirrors(&CalibrateGoal { duration: Duration { sec: 10, nanosec: 1 } }, &tree(parts[0]));
    let result = CalibrateResult {
        success: true,
        message: "calibrated".to_owned(),
        file: "glove.json".to_owned(),
        frames: 1000,
        joints: names(&["index_mcp"]),
        joint_span: vec![1.25],
        sources: names(&["glove"]),
        source_taxels: vec![2],
        noise: vec![0.5, 0.25],
        faulty_taxels: vec![1],
    };
    assert_mirrors(&result, &tree(parts[1]));
    let feedback = CalibrateFeedback {
        instruction: "in the air".to_owned(),
        time_left: Duration { sec: 4, nanosec: 5 },
        joints: result.joints,
        joint_span: result.joint_span,
        sources: result.sources,
        source_taxels: result.source_taxels,
        noise: result.noise,
    };
    assert_mirrors(&feedback, &tree(parts[2]));
}

#[test]
fn constants_equal_those_of_the_texts() {
    let constants = |type_name: &str| -> BTreeMap<String, u32> {
        let text = standard_text(type_name).expect(type_name);
        let definition = MessageDefinition::parse(type_name, text).expect(type_name);
        definition.constants.into_iter().map(|constant| (constant.name, constant.value.parse().expect("u32"))).collect()
    };
    let ours = |constants: &[(&str, u32)]| -> BTreeMap<String, u32> {
        constants.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
    };
    let contact = ours(&[
        ("NONE", ContactState::NONE.into()),
        ("ONSET", ContactState::ONSET.into()),
        ("OFFSET", ContactState::OFFSET.into()),
        ("WARMUP", ContactState::WARMUP),
        ("UNCALIBRATED", ContactState::UNCALIBRATED),
        ("STALE_POSE", ContactState::STALE_POSE),
        ("STALE_TACTILE", ContactState::STALE_TACTILE),
        ("POSE_OUT_OF_RANGE", ContactState::POSE_OUT_OF_RANGE),
        ("FAULTY_TAXEL", ContactState::FAULTY_TAXEL),
        ("NON_FINITE", ContactState::NON_FINITE),
        ("LATE", ContactState::LATE),
        ("HELD_POSE", ContactState::HELD_POSE),
        ("FROZEN", ContactState::FROZEN),
        ("INTERLEAVED", ContactState::INTERLEAVED),
        ("WRONG_RATE", ContactState::WRONG_RATE),
        ("ADAPTATION_OFF", ContactState::ADAPTATION_OFF.into()),
        ("ADAPTATION_FROZEN", ContactState::ADAPTATION_FROZEN.into()),
        ("ADAPTATION_LEARNING", ContactState::ADAPTATION_LEARNING.into()),
        ("ADAPTATION_WAITING", ContactState::ADAPTATION_WAITING.into()),
        ("ADAPTATION_CAPPED", ContactState::ADAPTATION_CAPPED.into()),
        ("ADAPTATION_NOISY", ContactState::ADAPTATION_NOISY.into()),
    ]);
    assert_eq!(constants("tactile_pose_fusion/msg/ContactState"), contact);
    let stage = ours(&[
        ("OUTSIDE", Stage::OUTSIDE.into()),
        ("ZERO_LOAD_POSES", Stage::ZERO_LOAD_POSES.into()),
        ("LOAD_UNLOAD_POSES", Stage::LOAD_UNLOAD_POSES.into()),
        ("LOADED_POSES", Stage::LOADED_POSES.into()),
    ]);
    assert_eq!(constants("tactile_pose_fusion/msg/Stage"), stage);
}

#[test]
fn bytes_are_those_of_the_ros_wire() {
    let message = Header { stamp: Time { sec: 1, nanosec: 2 }, frame_id: "ab".to_owned() };
    let expected = [0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, b'a', b'b', 0];
    assert_eq!(to_cdr(&message), expected);
    let mut reused = vec![9; 100];
    to_cdr_into(&message, &mut reused);
    assert_eq!(reused, expected);
    let big_endian = [0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, b'a', b'b', 0, 0xee];
    assert_eq!(from_cdr::<Header>(&big_endian).expect("big-endian, padded"), message);
}

#[test]
fn bytes_of_another_encoding_or_length_are_refused() {
    let xcdr2 = [0, 7, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0];
    let error = from_cdr::<Time>(&xcdr2).expect_err("XCDR2");
    assert_eq!(
        error.to_string(),
        "12 bytes are not a builtin_interfaces/msg/Time: expected plain CDR (encapsulation 0x0000 or 0x0001), got 0x0007"
    );
    let cdr = to_cdr(&TaxelArray { values: vec![1.0; 10], ..Default::default() });
    for len in 0..cdr.len() {
        assert!(from_cdr::<TaxelArray>(&cdr[..len]).is_err(), "{len} of {} bytes", cdr.len());
    }
}

#[test]
fn durations_and_stamps_keep_their_sign() {
    assert_eq!(Duration::from_nanos(-1), Duration { sec: -1, nanosec: 999_999_999 });
    assert_eq!(Duration::from_nanos(-1).nanos(), -1);
    assert_eq!(Stamp::from(Time::from(Stamp(-1_500_000_000))), Stamp(-1_500_000_000));
}
