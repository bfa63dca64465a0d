//! Synthetic sessions as bags, and the whole way from one to forces.

mod common;

use std::fs;

use common::bags::messages;
use common::onnx::LinearModel;
use common::tpf::tpf;

const SIMULATE: [&str; 8] = ["simulate", "--glove", "1", "--users", "1", "--sessions", "1", "--minutes=2"];

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
    assert!(frames.as_u64().unwrap() > 10_000 && lost.as_u64().unwrap() > 0, "{summary:#}");
    let estimates = summary["regions"][0]["estimates"].as_u64().unwrap();
    assert!(estimates as f64 > 0.95 * frames.as_f64().unwrap(), "{summary:#}");
    let inspected = tpf(folder, &["inspect", bag]).ok();
    assert!(inspected.stdout.contains("/glove/taxels") && inspected.stdout.contains("/stage"));
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
    let joints = inspected.stdout.lines().find(|line| line.trim_start().starts_with("/hand/joint_states")).unwrap();
    let rate_hz: f64 = joints.split_whitespace().nth(2).unwrap().parse().unwrap();
    assert!((26.0..30.0).contains(&rate_hz), "{joints}");
    let scored = ["eval", "free/glove3_user01_session1", "--whole", "--by", "substage", "--params-file"];
    let params = concat!(env!("CARGO_MANIFEST_DIR"), "/params/glove3.yaml");
    let scored = tpf(folder, &[&scored[..], &[params]].concat()).ok();
    for episode in ["air", "still_air", "light_hold", "still_hold", "grasp", "ramp", "touches"] {
        assert!(scored.stdout.contains(episode), "{scored:?}");
    }
}
