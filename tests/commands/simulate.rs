//! Synthetic sessions as bags, and the whole way from one to forces.

use crate::common;

use std::fs;
use std::path::Path;

use common::ROOT;
use common::bags::{Bag, Recorded, messages};
use common::onnx::LinearModel;
use common::tpf::tpf;
use tactile_pose_fusion::bag::{BagReader, Input, InputTopics, Inputs};
use tactile_pose_fusion::config::{self, DEFAULT_NODE};
use tactile_pose_fusion::fusion::Event;
use tactile_pose_fusion::hand::JOINTS;
use tactile_pose_fusion::msg::{TFMessage, TaxelArray, WireType, WrenchStamped, from_cdr};
use tactile_pose_fusion::units::Stamp;

const SIMULATE: [&str; 8] = ["simulate", "--glove", "1", "--users", "1", "--sessions", "1", "--minutes=1.7"];

#[test]
fn a_simulated_session_replays_with_its_annotated_zero() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let run = tpf(folder, &[&SIMULATE[..], &["--seed", "7", "-o", "sessions"]].concat()).ok();
    assert!(run.stderr.contains("synthetic") && run.stdout.contains("synthetic"), "{run:?}");
    LinearModel::new(64, 6, 4).metadata("unit", "gF").write(folder, "model.onnx");
    let params = "/**:
  ros__parameters:
    regions: [index]
    tactile_sources: [glove]
    joint_sources: [hand]
    tactile.glove: {topic: /glove/taxels, n_taxels: 6}
    joint.hand: {topic: /hand/joint_states}
    model.tip: {path: model.onnx}
    calibration.max_force: 1000.0 # the model only adds up taxels: a hand that moves in the air reads as force
    region.index: {model: tip, joints: [index_dip, index_pip, index_mcp_flex, index_mcp_abd], frame_id: index_tip}
";
    fs::write(folder.join("params.yaml"), params).unwrap();
    let bag = "sessions/glove1_user01_session1";
    let replayed = tpf(folder, &["replay", bag, "--params-file", "params.yaml", "-o", "out.mcap", "--json"]).ok();
    let summary = replayed.json();
    assert_eq!(summary["baseline"]["from"], "annotations");
    let (frames, lost) = (&summary["tactile"][0]["frames"], &summary["tactile"][0]["lost_messages"]);
    assert!(frames.as_u64().unwrap() > 9_000 && lost.as_u64().unwrap() > 0, "{summary:#}");
    let estimates = summary["regions"][0]["estimates"].as_u64().unwrap();
    assert!(estimates as f64 > 0.95 * frames.as_f64().unwrap(), "{summary:#}");
    let inspected = tpf(folder, &["inspect", bag]).ok();
    assert!(inspected.stdout.contains("/glove/taxels") && inspected.stdout.contains("/stage"));
}

/// Forces of a session whose hand is written in this form, N.
fn forces(folder: &Path, form: &str, hand: &str) -> Vec<f64> {
    tpf(folder, &[&SIMULATE[..], &["--seed", "7", "--hand", form, "-o", form]].concat()).ok();
    let (params_file, output) = (format!("{form}.yaml"), format!("{form}.mcap"));
    write_params(&folder.join(&params_file), hand);
    let bag = format!("{form}/glove1_user01_session1");
    tpf(folder, &["replay", &bag, "--params-file", &params_file, "-o", &output]).ok();
    let wrenches = messages(&folder.join(output)).into_iter().filter(|message| message.topic.ends_with("/wrench"));
    wrenches.map(|message| from_cdr::<WrenchStamped>(&message.data).unwrap().wrench.force.z).collect()
}

#[test]
fn a_hand_in_poses_gives_the_forces_of_its_angles() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    LinearModel::new(64, 6, 4).gains(0.01, 3.0).metadata("unit", "gF").write(folder, "model.onnx");
    let of_angles = forces(folder, "angles", "{topic: /hand/joint_states}");
    assert!(of_angles.len() > 9_000);
    // Messages without a stamp are as late as they were received: they give other forces, from the same angles.
    for (form, source) in FORMS.into_iter().filter(|(_, source)| !source.contains("stamp: receipt")) {
        let of_poses = forces(folder, form, source);
        assert_eq!(of_poses.len(), of_angles.len(), "{form}");
        let off = of_poses.iter().zip(&of_angles).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-5, "{form}: {off} N");
    }
}

const TRANSFORMS: &str = "{topic: /tf, type: tf2_msgs/msg/TFMessage, hand: {layout: openxr25, side: right}}";

/// The forms of a hand that is not told as angles, and the source that reads each.
const FORMS: [(&str, &str); 8] = [
    ("openxr", "{topic: /hand/poses, type: geometry_msgs/msg/PoseArray, hand: {layout: openxr, side: right}}"),
    ("openxr25", "{topic: /hand/poses, type: geometry_msgs/msg/PoseArray, hand: {layout: openxr25, side: right}}"),
    ("mano21", "{topic: /hand/poses, type: geometry_msgs/msg/PoseArray, hand: {layout: mano21, side: right}}"),
    (
        "keypoints26",
        "{topic: /hand/keypoints, type: std_msgs/msg/Float64MultiArray, field: data, stamp: receipt, hand: {layout: openxr, \
         side: right}}",
    ),
    (
        "keypoints21",
        "{topic: /hand/keypoints, type: std_msgs/msg/Float64MultiArray, field: data, stamp: receipt, hand: {layout: mano21, \
         side: right}}",
    ),
    (
        "named",
        "{topic: /hand/named_poses, type: teleop_ros2_interfaces/msg/HandJointPoses, hand: {layout: openxr, side: right}}",
    ),
    (
        "manus",
        "{topic: /manus_glove_0, type: manus_ros2_msgs/msg/ManusGlove, only: side=Right, stamp: receipt, hand: {layout: manus, \
         side: right}}",
    ),
    ("transforms", TRANSFORMS),
];

/// Parameters of a glove beside this source of joint angles.
fn write_params(path: &Path, hand: &str) {
    let params = format!(
        "/**:
  ros__parameters:
    regions: [index]
    tactile_sources: [glove]
    joint_sources: [hand]
    tactile.glove: {{topic: /glove/taxels, n_taxels: 6}}
    joint.hand: {hand}
    model.tip: {{path: model.onnx}}
    calibration.max_force: 1000.0
    region.index: {{model: tip, joints: [index_dip, index_pip, index_mcp_flex, index_mcp_abd], frame_id: index_tip}}
"
    );
    fs::write(path, params).unwrap();
}

/// The joint angles that a bag holds, as its parameters read them: stamp, and the angles of the hand in their order, rad.
fn angles_of(params: &Path, bag: &Path) -> Vec<(Stamp, [f64; 20])> {
    let cfg = config::load(params, DEFAULT_NODE).unwrap();
    let topics = InputTopics {
        taxels: cfg.tactile().to_vec(),
        joints: cfg.joints().to_vec(),
        truth: vec![],
        joint_sources: cfg.fusion().joint_sources().to_vec(),
        needed: cfg.needed_joints(),
        stage: cfg.stage_topic.clone(),
        told: None,
        message_definitions: None,
    };
    let mut reader = BagReader::open(&[bag.to_path_buf()]).unwrap();
    let mut inputs = Inputs::new(topics, &mut reader).unwrap();
    let mut angles = Vec::new();
    while let Some(message) = reader.next_message().unwrap() {
        for part in inputs.parts(message.channel).unwrap() {
            if let Input::Event(Event::Joints(sample)) = inputs.decode(&message, part) {
                let angle =
                    |joint: &str| sample.names.iter().position(|name| name == joint).map(|at| sample.positions[at]);
                angles.push((sample.stamp, JOINTS.map(|joint| angle(joint).unwrap_or(f64::NAN))));
            }
        }
    }
    angles
}

#[test]
fn the_angles_that_come_back_from_a_hand_in_any_form_are_those_that_were_simulated() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let simulated = |form: &str| {
        tpf(folder, &[&SIMULATE[..], &["--seed", "7", "--hand", form, "-o", form]].concat()).ok();
        folder.join(format!("{form}/glove1_user01_session1"))
    };
    let params = folder.join("hand.yaml");
    write_params(&params, "{topic: /hand/joint_states}");
    let told = angles_of(&params, &simulated("angles"));
    assert!(told.len() > 9_000, "{}", told.len());
    for (form, source) in FORMS {
        let bag = simulated(form);
        write_params(&params, source);
        let is_stamped = !source.contains("stamp: receipt");
        let found = angles_of(&params, &bag);
        assert_eq!(found.len(), told.len(), "{form}");
        let mut worst = 0.0_f64;
        for ((stamp, found), (of, told)) in found.iter().zip(&told) {
            assert!(stamp == of || !is_stamped, "{form}");
            for (joint, (found, told)) in found.iter().zip(told).enumerate() {
                // Points don't tell to which side a thumb's bone turns: measured angles near 0 may be a little below.
                let told = if matches!(JOINTS[joint], "thumb_ip" | "thumb_mcp") { told.abs() } else { *told };
                let off = (found - told).abs();
                assert!(off < 1e-6, "{form}: {} is {found} and not {told}", JOINTS[joint]); // NaN is no angle
                worst = worst.max(off);
            }
        }
        assert!(worst < 1e-6, "{form}: {worst}");
    }
}

#[test]
fn frames_that_do_not_change_hold_from_the_first_message_on_wherever_the_bag_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    tpf(folder, &[&SIMULATE[..], &["--seed", "7", "--hand", "transforms", "-o", "sessions"]].concat()).ok();
    let all = messages(&folder.join("sessions/glove1_user01_session1"));
    let (frames, rest): (Vec<_>, Vec<_>) = all.into_iter().partition(|message| message.topic == "/tf_static");
    assert_eq!(frames.len(), 1);
    let params = folder.join("hand.yaml");
    write_params(&params, TRANSFORMS);
    let write = |name: &str, frames: &[Recorded], after: bool| {
        let mut bag = Bag::create(&folder.join(name));
        let last = rest.last().unwrap().log_time;
        let mut send = |message: &Recorded, at| match message.type_name.as_str() {
            TFMessage::TYPE_NAME => bag.send_bytes::<TFMessage>(&message.topic, at, &message.data),
            TaxelArray::TYPE_NAME => bag.send_bytes::<TaxelArray>(&message.topic, at, &message.data),
            _ => {}
        };
        if !after {
            frames.iter().for_each(|message| send(message, message.log_time));
        }
        rest.iter().for_each(|message| send(message, message.log_time));
        if after {
            frames.iter().for_each(|message| send(message, last));
        }
        bag.finish();
        angles_of(&params, &folder.join(name))
    };
    let (before, after, without) =
        (write("a.mcap", &frames, false), write("b.mcap", &frames, true), write("c.mcap", &[], false));
    let bits = |angles: &[(Stamp, [f64; 20])]| -> Vec<_> {
        angles.iter().map(|(stamp, angles)| (*stamp, angles.map(f64::to_bits))).collect()
    };
    assert!(before.len() > 9_000 && bits(&before) == bits(&after));
    assert!(before[0].1.iter().all(|angle| angle.is_finite()), "{:?}", before[0]);
    // Without them nothing says where the fingers begin.
    let is_unknown = |(_, angles): &(Stamp, [f64; 20])| angles[..16].iter().all(|angle| angle.is_nan());
    assert!(without.iter().all(is_unknown), "{:?}", without[0]);
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_one_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (seed, output) in [("7", "a"), ("7", "b"), ("8", "c")] {
        tpf(folder, &[&SIMULATE[..], &["--seed", seed, "-o", output]].concat()).ok();
    }
    let file = |output: &str| folder.join(output).join("glove1_user01_session1/glove1_user01_session1_0.mcap");
    assert!(fs::read(file("a")).unwrap() == fs::read(file("b")).unwrap());
    assert!(messages(&file("a")) != messages(&file("c")));
    let again = tpf(folder, &[&SIMULATE[..], &["--seed", "7", "-o", "a"]].concat());
    assert!(again.failure().contains("glove1_user01_session1"), "{again:?}");
}

#[test]
fn what_cannot_be_simulated_is_refused_before_a_folder_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let glove = tpf(folder, &["simulate", "--glove", "4", "--seed", "1", "-o", "out"]);
    assert_eq!(glove.failure(), "glove 4: there is no such synthetic glove; choose one of 1 to 3");
    let short = tpf(folder, &["simulate", "--glove", "1", "--seed", "1", "--minutes", "0.1", "-o", "out"]);
    assert!(short.failure().starts_with("minutes 0.1: a session of the protocol takes"), "{short:?}");
    assert!(!folder.join("out").exists());
}

#[test]
fn free_manipulation_is_a_session_too() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let asked = ["simulate", "--glove", "3", "--users", "1", "--sessions", "1", "--seed", "7", "-o", "free"];
    let free = ["--activity", "manipulation", "--tracking", "camera"];
    let short = tpf(folder, &[&asked[..], &free, &["--minutes", "5"]].concat());
    assert!(short.failure().contains("a session of free manipulation takes 10 to 120 minutes"), "{short:?}");
    let other = tpf(folder, &[&asked[..], &["--activity", "work"]].concat());
    assert!(other.code == 2 && other.stderr.contains("expected protocol or manipulation, got \"work\""), "{other:?}");
    tpf(folder, &[&asked[..], &free, &["--minutes", "10"]].concat()).ok();
    let inspected = tpf(folder, &["inspect", "free/glove3_user01_session1"]).ok();
    let mut lines = inspected.stdout.lines();
    assert!(lines.any(|line| line.trim_start().starts_with("/hand/joint_states")), "{inspected:?}");
    let joints = lines.next().unwrap();
    let rate_hz: f64 = joints.split_whitespace().nth(1).unwrap().parse().unwrap();
    assert!((26.0..30.0).contains(&rate_hz), "{joints}");
    let params = &format!("{ROOT}/params/glove3.yaml");
    let eval = ["eval", "free/glove3_user01_session1", "--by", "substage", "--params-file", params];
    let of_test_part = tpf(folder, &eval).ok(); // by the paper's network, which takes longest
    assert!(of_test_part.stdout.contains("held-out test part"), "{of_test_part:?}");
    let quick = &format!("{ROOT}/models/glove3_adaptive.onnx");
    let scored = tpf(folder, &[&eval[..], &["--whole", "--model", quick]].concat()).ok();
    for episode in ["air", "still_air", "light_hold", "still_hold", "grasp", "ramp", "touches"] {
        assert!(scored.stdout.contains(episode), "{scored:?}");
    }
}

#[test]
fn a_hand_replays_and_is_scored_finger_by_finger() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let params = &format!("{ROOT}/params/hand1.yaml");
    let asked = ["simulate", "--glove", "hand1", "--users", "1", "--minutes", "2", "--seed", "7", "-o", "hand"];
    tpf(folder, &[&asked[..], &["--sessions", "2"]].concat()).ok();
    // The protocol goes through the fingers in turn, and a finger that the load cell was never under has no topic.
    for (session, under, never) in [(1, "index", "middle"), (2, "middle", "index")] {
        let inspected = tpf(folder, &["inspect", &format!("hand/hand1_user01_session{session}")]).ok();
        assert!(inspected.stdout.contains(&format!("/load_cell/{under}/wrench")), "{inspected:?}");
        assert!(!inspected.stdout.contains(&format!("/load_cell/{never}/wrench")), "{inspected:?}");
    }
    let bag = "hand/hand1_user01_session2";
    let replay = ["replay", bag, "--params-file", params, "-o", "out.mcap", "--json"];
    let summary = tpf(folder, &replay).ok().json();
    let shared = format!("{ROOT}/params/hand1_shared.yaml"); // one model for all fingers
    let replay = ["replay", bag, "--params-file", &shared, "-o", "shared.mcap", "--json"];
    for summary in [summary, tpf(folder, &replay).ok().json()] {
        for (region, name) in ["index", "middle", "ring", "little", "thumb"].into_iter().enumerate() {
            let of_region = &summary["regions"][region];
            assert_eq!(of_region["name"], name);
            assert!(of_region["estimates"].as_u64().unwrap() > 9_000, "{of_region:#}");
        }
    }
    let scored = ["eval", "hand", "--whole", "--json", "--params-file", params];
    let scored = tpf(folder, &scored).ok().json();
    // Of the others no force was measured; their contacts in the air are told all the same.
    assert_eq!(scored["table"]["gloves"], serde_json::json!(["hand1/index", "hand1/middle"]));
    let contacts = scored["models"].as_array().unwrap().last().unwrap()["contacts"].as_object().unwrap();
    assert_eq!(contacts.len(), 5);
    assert!(contacts["hand1/thumb"]["in_air"].is_object());
    let missing = scored["sessions"][0]["missing"][0].as_str().unwrap();
    assert!(
        missing.starts_with("no true force of some regions: the bag has no topic /load_cell/middle/wrench, "),
        "{missing}"
    );
}

#[test]
fn free_manipulation_of_a_hand_is_scored_on_each_finger_that_touches() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let params = &format!("{ROOT}/params/hand1.yaml");
    let asked = ["simulate", "--glove", "hand1", "--users", "1", "--sessions", "1", "--seed", "7", "-o", "free"];
    let free = ["--activity", "manipulation", "--minutes", "10", "--episodes", "touches,light_hold"];
    tpf(folder, &[&asked[..], &free].concat()).ok();
    let scored = ["eval", "free", "--whole", "--json", "--params-file", params];
    let scored = tpf(folder, &scored).ok().json();
    let fingers = scored["table"]["gloves"].as_array().unwrap();
    assert!(fingers.len() >= 2, "several fingers touch within a few minutes: {fingers:?}");
    for finger in fingers {
        assert!(finger.as_str().unwrap().starts_with("hand1/"), "{finger}");
    }
}

#[test]
fn options_that_make_no_sense_are_refused_in_one_line_before_a_folder_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let asked = ["simulate", "--seed", "7", "-o", "out", "--glove"];
    for (options, told) in [
        (&["hand4"][..], "glove 4: there is no such synthetic glove; choose one of 1 to 3"),
        (&["1", "--tracking-rate", "0"], "tracking rate: expected 1 to 1000 Hz, got 0"),
        (&["1", "--tracking-bias", "-1"], "tracking bias: expected 0 to 90 degrees, got -1"),
        (&["1", "--slips", "nan"], "slips: expected 0 to 60 per minute, got NaN"),
        (&["1", "--finger", "ring"], "ring finger: this glove has taxels on the index fingertip alone"),
        (&["1", "--episodes", "grasp"], "episodes: the protocol says what is done"),
        (&["1", "--start", "in-contact"], "start: the protocol says what is done"),
    ] {
        let refused = tpf(folder, &[&asked[..], options].concat());
        assert!(refused.failure().starts_with(told), "{refused:?}");
    }
    for (options, told) in [
        (&["hand"][..], "expected 1, 2, 3, hand1, hand2 or hand3, got \"hand\""),
        (&["1", "--physics", "real"], "expected one of separable, coupled, none, got \"real\""),
        (&["1", "--episodes", "grasp,nap"], "got \"nap\""),
    ] {
        let refused = tpf(folder, &[&asked[..], options].concat());
        assert!(refused.code == 2 && refused.stderr.contains(told), "{refused:?}");
    }
    assert!(!folder.join("out").exists());
}
