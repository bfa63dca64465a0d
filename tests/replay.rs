//! A recorded bag in, newtons and contact out: the main job, through the binary.

mod common;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use common::bags::{Bag, at, decoded, messages, stamp_of, write_session};
use common::onnx::LinearModel;
use common::shared;
use common::tpf::{tpf, write_params};
use tactile_pose_fusion::msg::{ContactArray, ContactState, Header, Stage, WrenchStamped, from_cdr};
use tactile_pose_fusion::units::{GramForce, Newton, Stamp};

const CONTACTS: &str = "/tactile_pose_fusion/contacts";
const WRENCH: &str = "/tactile_pose_fusion/index/wrench";

/// A calibration file whose baseline is zero everywhere.
fn write_zero_calibration(folder: &Path, n_taxels: usize) {
    let list = |value: &str| vec![value; n_taxels].join(", ");
    let text = format!(
        "format: tactile_pose_fusion/calibration/1\nglove: ''\nuser: ''\nmodels: {{}}\nrecorded: by hand\nsources:\n  glove:\n    median: [{}]\n    noise: [{}]\n    faulty: [{}]\n",
        list("0.0"),
        list("0.0"),
        list("false")
    );
    fs::write(folder.join("zero.yaml"), text).unwrap();
}

/// A session with its model and parameters: `force = sum of taxels - 20 dip`, in gF.
fn session(seconds: i64) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), seconds);
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(folder.path(), "model.onnx");
    write_params(folder.path(), 2, &["dip"], "");
    folder
}

fn replay(folder: &Path, output: &str, more: &[&str]) -> common::tpf::Run {
    let mut args = vec!["replay", "session.mcap", "--params-file", "params.yaml", "-o", output];
    args.extend(more);
    tpf(folder, &args)
}

/// One period of the bends, so that their median is rest.
const FIRST: [&str; 2] = ["--calibrate-first", "3.13"];

#[test]
fn a_bag_of_the_fixtures_frames_gives_pytorchs_outputs() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bytes = fs::read(shared.join("fixtures/torch_opset17.safetensors")).unwrap();
    let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let tensor = |name: &str| -> Vec<f32> {
        let data = tensors.tensor(name).unwrap().data().to_vec();
        data.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
    };
    let (tactile, joints) = (tensor("tactile_frames"), tensor("joint_frames"));
    fs::copy(shared.join("fixtures/torch_opset17.onnx"), folder.join("model.onnx")).unwrap();
    let names = ["index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd"];
    write_params(folder, 16, &names, "");
    write_zero_calibration(folder, 16);
    let mut bag = Bag::create(&folder.join("session.mcap"));
    for k in 0..320 {
        let angles: Vec<f64> = joints[k * 4..(k + 1) * 4].iter().map(|&angle| f64::from(angle)).collect();
        bag.joints(at(k as i64 * 10), &names, &angles);
        bag.taxels(at(k as i64 * 10), &tactile[k * 16..(k + 1) * 16]);
    }
    bag.finish();
    let mut backends = vec!["rten"];
    if common::onnx_runtime_is_here() {
        backends.push("onnxruntime");
    }
    for backend in backends {
        for batch in ["1", "32"] {
            let output = format!("{backend}{batch}.mcap");
            replay(folder, &output, &["--calibration", "zero.yaml", "--backend", backend, "--batch", batch]).ok();
            let arrays: Vec<ContactArray> = decoded(&folder.join(&output), CONTACTS);
            assert_eq!(arrays.len(), 320);
            for (window, (force, base)) in tensor("force").iter().zip(tensor("force_base")).enumerate() {
                let state = &arrays[window + 63].contacts[0];
                assert_eq!(stamp_of(&arrays[window + 63].header), at((window as i64 + 63) * 10));
                for (got, expected) in [(state.force, *force), (state.force_base, base)] {
                    let difference = GramForce::from(Newton(got)).0 - f64::from(expected);
                    assert!(difference.abs() < 1e-6, "{backend}, batch {batch}, window {window}: {difference} gF");
                }
                assert_eq!((state.flags, state.pose_age), (0, 0.0));
            }
        }
    }
}

#[test]
fn force_and_contact_follow_the_touches_and_not_the_bends() {
    let folder = session(10);
    let summary = replay(folder.path(), "out.mcap", &[FIRST[0], FIRST[1], "--json"]).ok().json();
    assert_eq!(summary["tactile"][0]["frames"], 1000);
    assert_eq!(summary["regions"][0]["estimates"], 1000 - 63);
    assert_eq!(summary["regions"][0]["onsets"], 3);
    let arrays: Vec<ContactArray> = decoded(&folder.path().join("out.mcap"), CONTACTS);
    let wrenches: Vec<WrenchStamped> = decoded(&folder.path().join("out.mcap"), WRENCH);
    assert_eq!((arrays.len(), wrenches.len()), (1000, 1000 - 63));
    let state = |k: usize| &arrays[k].contacts[0];
    let touch = GramForce::from(Newton(state(450).force)).0;
    assert!((touch - 200.0).abs() < 1.0, "{touch} gF"); // two taxels of 100, and the rest of the wiggle and of the median bend
    assert!(state(450).contact && state(450).contact_raw && !state(550).contact);
    let air = |k: usize| GramForce::from(Newton(state(k).force_base)).0;
    assert!((500..600).any(|k| air(k).abs() > 15.0), "the base alone reads the bend");
    assert!((500..600).all(|k| state(k).force < state(k).on_threshold), "the correction removes it");
    assert!((state(450).artifact - (state(450).force_base - state(450).force)).abs() < 1e-15);
    let wrench = &wrenches[450 - 63];
    assert_eq!(stamp_of(&wrench.header), stamp_of(&arrays[450].header));
    assert_eq!((wrench.header.frame_id.as_str(), wrench.wrench.force.z), ("index_tip", -state(450).force));
    assert_eq!((wrench.wrench.force.x, wrench.wrench.torque.z), (0.0, 0.0));
    assert_eq!(state(10).flags, ContactState::WARMUP);
    assert!(state(10).force.is_nan() && state(10).mdf.is_nan());
    let onsets = (0..1000).filter(|&k| state(k).event == ContactState::ONSET).count();
    assert_eq!(onsets, 3);
}

#[test]
fn two_runs_write_the_same_bytes() {
    let folder = session(6);
    for batch in ["1", "32"] {
        let (a, b) = (format!("a{batch}.mcap"), format!("b{batch}.mcap"));
        replay(folder.path(), &a, &[FIRST[0], FIRST[1], "--batch", batch]).ok();
        replay(folder.path(), &b, &[FIRST[0], FIRST[1], "--batch", batch]).ok();
        assert!(fs::read(folder.path().join(&a)).unwrap() == fs::read(folder.path().join(&b)).unwrap());
    }
}

#[test]
fn batches_agree_within_rounding() {
    let folder = session(6);
    let run = |batch: &str| {
        let output = format!("{batch}.mcap");
        replay(folder.path(), &output, &[FIRST[0], FIRST[1], "--batch", batch]).ok();
        decoded::<ContactArray>(&folder.path().join(output), CONTACTS)
    };
    let single = run("1");
    for batch in ["7", "64", "4096"] {
        for (one, many) in single.iter().zip(run(batch)) {
            let (one, many) = (&one.contacts[0], &many.contacts[0]);
            assert_eq!((one.flags, one.contact, one.event), (many.flags, many.contact, many.event));
            // A batched matrix product may sum in another order: float32 rounding of about 200 gF.
            assert!(one.force.is_nan() && many.force.is_nan() || (one.force - many.force).abs() < 1e-6);
        }
    }
}

#[test]
fn merge_copies_the_input_untouched() {
    let folder = session(5);
    let plain = replay(folder.path(), "plain.mcap", &[FIRST[0], FIRST[1], "--json"]).ok().json();
    let merged = replay(folder.path(), "merged.mcap", &[FIRST[0], FIRST[1], "--merge", "--json"]).ok().json();
    assert_eq!(plain["estimates_sha256"], merged["estimates_sha256"]);
    let input = messages(&folder.path().join("session.mcap"));
    let output = messages(&folder.path().join("merged.mcap"));
    let copied: Vec<_> = output.iter().filter(|message| !message.topic.starts_with("/tactile")).cloned().collect();
    assert_eq!(copied, input);
    let estimates: Vec<_> = output.iter().filter(|message| message.topic.starts_with("/tactile")).cloned().collect();
    assert_eq!(estimates, messages(&folder.path().join("plain.mcap")));
    let taken = tpf(
        folder.path(),
        &["replay", "merged.mcap", "--params-file", "params.yaml", "-o", "again.mcap", "--merge", FIRST[0], FIRST[1]],
    );
    assert!(taken.failure().contains("/tactile_pose_fusion/index/wrench is already in the input"), "{taken:?}");
}

#[test]
fn a_looped_bag_resets_and_is_counted() {
    let folder = session(5);
    let folder = folder.path();
    let input = messages(&folder.join("session.mcap"));
    let mut bag = Bag::create(&folder.join("looped.mcap"));
    for (lap, message) in (0..2).flat_map(|lap| input.iter().map(move |message| (lap, message))) {
        let log_time = Stamp(message.log_time.0 + lap * 6_000_000_000);
        if message.topic == "/taxels" {
            bag.send_bytes::<tactile_pose_fusion::msg::TaxelArray>("/taxels", log_time, &message.data);
        } else {
            bag.send_bytes::<tactile_pose_fusion::msg::JointState>("/joints", log_time, &message.data);
        }
    }
    bag.finish();
    let args =
        ["replay", "looped.mcap", "--params-file", "params.yaml", "-o", "out.mcap", "--json", FIRST[0], FIRST[1]];
    let run = tpf(folder, &args).ok();
    let summary = run.json();
    assert_eq!(summary["tactile"][0]["time_jumps"], 1);
    assert_eq!(summary["joints"][0]["time_jumps"], 1);
    assert_eq!(summary["regions"][0]["frames"], 1000);
    assert_eq!(summary["regions"][0]["warmup"], 2 * 63);
    let arrays: Vec<ContactArray> = decoded(&folder.join("out.mcap"), CONTACTS);
    let forces = |lap: usize| arrays[lap * 500 + 64..lap * 500 + 499].iter().map(|a| a.contacts[0].force);
    assert!(forces(0).eq(forces(1)), "the second lap is the first again");
}

#[test]
fn a_clock_set_back_by_an_hour_is_counted_and_estimates_go_on() {
    let folder = session(10);
    let folder = folder.path();
    let back =
        |stamp: Stamp| if stamp.nanos_since(at(0)) > 5_000_000_000 { stamp.offset(-3_600_000_000_000) } else { stamp };
    let mut bag = Bag::create(&folder.join("set_back.mcap"));
    for message in messages(&folder.join("session.mcap")) {
        let log_time = back(message.log_time);
        if message.topic == "/taxels" {
            let mut taxels: tactile_pose_fusion::msg::TaxelArray = from_cdr(&message.data).unwrap();
            taxels.header.stamp = back(stamp_of(&taxels.header)).into();
            bag.send("/taxels", log_time, &taxels);
        } else {
            let mut joints: tactile_pose_fusion::msg::JointState = from_cdr(&message.data).unwrap();
            joints.header.stamp = back(stamp_of(&joints.header)).into();
            bag.send("/joints", log_time, &joints);
        }
    }
    bag.finish();
    let args =
        ["replay", "set_back.mcap", "--params-file", "params.yaml", "-o", "out.mcap", "--json", FIRST[0], FIRST[1]];
    let run = tpf(folder, &args).ok();
    let summary = run.json();
    assert_eq!((&summary["tactile"][0]["time_jumps"], &summary["joints"][0]["time_jumps"]), (&1.into(), &1.into()));
    let (frames, warmup) = (&summary["regions"][0]["frames"], &summary["regions"][0]["warmup"]);
    assert_eq!((frames, warmup), (&1000.into(), &(2 * 63).into()), "the window starts again, and no frame is lost");
    assert_eq!(summary["losses"].as_array().unwrap().len(), 0);
}

#[test]
fn annotated_stretches_are_the_zero() {
    let folder = session(8);
    let folder = folder.path();
    let mut bag = Bag::create(&folder.join("annotated.mcap"));
    for (k, message) in messages(&folder.join("session.mcap")).into_iter().enumerate() {
        if k % 200 == 0 {
            let header = Header { stamp: message.log_time.into(), frame_id: String::new() };
            // Seconds 0 to 3 and 5 are at rest: twice 100 messages make a second.
            let stage = Stage { header, stage: 1, zero_load: [0, 1, 2, 3, 5].contains(&(k / 200)), ..Stage::default() };
            bag.send("/stage", message.log_time, &stage);
        }
        if message.topic == "/taxels" {
            bag.send_bytes::<tactile_pose_fusion::msg::TaxelArray>("/taxels", message.log_time, &message.data);
        } else {
            bag.send_bytes::<tactile_pose_fusion::msg::JointState>("/joints", message.log_time, &message.data);
        }
    }
    bag.finish();
    let run =
        tpf(folder, &["replay", "annotated.mcap", "--params-file", "params.yaml", "-o", "out.mcap", "--json"]).ok();
    let baseline = &run.json()["baseline"];
    assert_eq!(baseline["from"], "annotations");
    let seconds = baseline["seconds"][0].as_f64().unwrap();
    assert!((seconds - 4.97).abs() < 0.05, "{seconds}"); // 5 s less the steps at the edges
}

#[test]
fn an_annotation_that_cannot_be_read_is_counted_and_said() {
    let folder = session(6);
    let folder = folder.path();
    let mut bag = Bag::create(&folder.join("annotated.mcap"));
    bag.send_bytes::<Stage>("/stage", at(0), &[0, 1, 0, 0, 9]);
    for message in messages(&folder.join("session.mcap")) {
        if message.topic == "/taxels" {
            bag.send_bytes::<tactile_pose_fusion::msg::TaxelArray>("/taxels", message.log_time, &message.data);
        } else {
            bag.send_bytes::<tactile_pose_fusion::msg::JointState>("/joints", message.log_time, &message.data);
        }
    }
    bag.finish();
    let args = ["replay", "annotated.mcap", "--params-file", "params.yaml", "-o", "out.mcap", "--json"];
    let run = tpf(folder, &[&args[..], &FIRST[..]].concat());
    assert_eq!(run.code, 3, "{run:?}");
    assert_eq!(run.json()["topics"]["/stage"]["unreadable"]["unreadable"], 1);
    assert!(run.stderr.contains("/stage: 1 messages could not be read"), "{run:?}");
}

#[test]
fn a_calibration_file_does_what_its_seconds_did() {
    let folder = session(6);
    let folder = folder.path();
    let args = ["calibrate", "session.mcap", "--params-file", "params.yaml", "-o", "glove.yaml", FIRST[0], FIRST[1]];
    let made = tpf(folder, &args).ok();
    assert!(made.stdout.contains("2 taxels, never moved: none"), "{made:?}");
    let direct = replay(folder, "a.mcap", &[FIRST[0], FIRST[1], "--json"]).ok().json();
    let by_file = replay(folder, "b.mcap", &["--calibration", "glove.yaml", "--json"]).ok().json();
    assert_eq!(direct["estimates_sha256"], by_file["estimates_sha256"]);
    let again = tpf(folder, &args);
    assert_eq!(again.failure(), "glove.yaml: already exists; choose another name, or remove it first");
}

#[test]
fn a_loaded_or_short_calibration_is_refused() {
    let folder = session(6);
    let loaded = replay(folder.path(), "out.mcap", &["--calibrate-first", "6"]);
    assert!(loaded.failure().starts_with("region index: calibration looks loaded: "), "{loaded:?}");
    let short = replay(folder.path(), "out.mcap", &["--calibrate-first", "1"]);
    assert!(
        short.failure().starts_with("tactile source glove: calibration is too short: 1.00 s at zero load"),
        "{short:?}"
    );
    assert!(!folder.path().join("out.mcap").exists());
}

#[test]
fn the_real_load_cell_bag_replays_by_field_path() {
    let Some(shared) = shared() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    LinearModel::new(16, 6, 2).gains(0.5, 0.25).metadata("unit", "N").write(folder, "model.onnx");
    let params = "/**:
  ros__parameters:
    regions: [cell]
    tactile_sources: [cell]
    joint_sources: [servo]
    tactile.cell:
      topic: /load_cell_data
      type: crab_interfaces/msg/LoadCell
      field: data
      rows: rows
      cols: cols
      row_period_ms: 0.1
      n_taxels: 6
      frame_clock: grid
    joint.servo:
      topic: /servo/encoder_data
      type: crab_interfaces/msg/ServoData
      field: data
      names: [left, right]
      scale: 0.0015339807878856412  # rad a tick, 4096 ticks a turn
    timing.joint_slack_ms: 300.0
    timing.max_pose_age_ms: 300.0
    calibration.max_force: 1000.0
    model.cell: {path: model.onnx}
    region.cell: {model: cell, joints: [left, right], frame_id: load_cell}
";
    fs::write(folder.join("params.yaml"), params).unwrap();
    let bag = shared.join("data/mcap_crab_loadcell/adya_gait.bag");
    let bag = bag.to_str().unwrap();
    let args = ["replay", bag, "--params-file", "params.yaml", "-o", "out.mcap", "--calibrate-first", "3", "--json"];
    let run = tpf(folder, &args).ok();
    let summary = run.json();
    let cell = &summary["tactile"][0];
    assert_eq!((cell["messages"].as_u64(), cell["rows"].as_u64()), (Some(4285), Some(85_700)));
    assert_eq!(cell["used"], 85_700, "a burst costs no row");
    assert_eq!(cell["gaps"], 3, "the three gaps over 50 ms");
    assert_eq!(cell["bursts"], 1617, "blocks within 1.9 ms of the one before, counted with numpy");
    assert_eq!(summary["joints"][0]["used"], 52);
    let region = &summary["regions"][0];
    let frames = region["frames"].as_u64().unwrap();
    assert_eq!(frames, 813 + 9 + 1 + 1, "whole 10 ms steps in each stretch between the gaps, counted with numpy");
    assert!(region["estimates"].as_u64().unwrap() > 700);
    assert_eq!(region["window_resets"], 3);
    let arrays: Vec<ContactArray> = decoded(&folder.join("out.mcap"), CONTACTS);
    assert_eq!(arrays.len() as u64, frames);
    let words = tpf(folder, &[&args[..args.len() - 3], &["--calibrate-first", "3", "--overwrite"]].concat()).ok();
    assert!(words.stdout.contains("bursts spread") && words.stdout.contains("3 gaps"), "{}", words.stdout);
}

#[test]
fn what_was_lost_is_said_and_leaves_with_3() {
    let folder = session(6);
    let folder = folder.path();
    let bytes = fs::read(folder.join("session.mcap")).unwrap();
    fs::write(folder.join("cut.mcap"), &bytes[..bytes.len() * 3 / 5]).unwrap();
    let args = ["replay", "cut.mcap", "--params-file", "params.yaml", "-o", "out.mcap", "--calibrate-first", "2.5"];
    let cut = tpf(folder, &args);
    assert_eq!(cut.code, 3, "{cut:?}");
    assert!(cut.stderr.contains("input lost: cut.mcap"), "{cut:?}");
    assert!(!decoded::<ContactArray>(&folder.join("out.mcap"), CONTACTS).is_empty());
}

#[test]
fn several_bags_are_parts_of_one_recording() {
    let folder = session(6);
    let folder = folder.path();
    let mut taxels = Bag::create(&folder.join("taxels.mcap"));
    let mut joints = Bag::create(&folder.join("joints.mcap"));
    for message in messages(&folder.join("session.mcap")) {
        if message.topic == "/taxels" {
            taxels.send_bytes::<tactile_pose_fusion::msg::TaxelArray>("/taxels", message.log_time, &message.data);
        } else {
            joints.send_bytes::<tactile_pose_fusion::msg::JointState>("/joints", message.log_time, &message.data);
        }
    }
    taxels.finish();
    joints.finish();
    let whole = replay(folder, "a.mcap", &[FIRST[0], FIRST[1], "--json"]).ok().json();
    let args = ["replay", "joints.mcap", "taxels.mcap", "--params-file", "params.yaml", "-o", "b.mcap", "--json"];
    let parts = tpf(folder, &[&args[..], &FIRST[..]].concat()).ok().json();
    assert_eq!(whole["estimates_sha256"], parts["estimates_sha256"]);
}

#[test]
fn samples_that_cannot_be_used_are_counted_by_reason() {
    let folder = session(4);
    let folder = folder.path();
    let mut bag = Bag::create(&folder.join("rough.mcap"));
    for k in 0..600i64 {
        if k % 50 == 7 {
            bag.joints(at(k * 10 + 3), &["pip"], &[0.0]); // no dip in it
        } else {
            bag.joints(at(k * 10 + 3), &["pip", "dip"], &[0.0, 0.1]);
        }
        let mut values = vec![10.0, 5.0 + (k % 3) as f32 * 0.1];
        match k {
            300 => values[0] = f32::NAN,
            310 => values[1] = f32::INFINITY,
            320 => values.clear(),
            330 => values.push(1.0),
            _ => {}
        }
        bag.taxels(at(k * 10 + 10), &values);
    }
    bag.send_bytes::<tactile_pose_fusion::msg::TaxelArray>("/taxels", at(6010), &[0, 1, 0, 0, 1, 2, 3]);
    bag.finish();
    let args = ["replay", "rough.mcap", "--params-file", "params.yaml", "-o", "out.mcap", "--json", FIRST[0], "2.5"];
    let run = tpf(folder, &args);
    assert_eq!(run.code, 3, "{run:?}");
    let summary = run.json();
    let reasons: BTreeMap<String, u64> =
        serde_json::from_value(summary["topics"]["/taxels"]["unreadable"].clone()).unwrap();
    assert_eq!(reasons, BTreeMap::from([("empty".to_owned(), 1), ("unreadable".to_owned(), 1)]));
    assert_eq!(summary["tactile"][0]["wrong_length"], 1);
    assert_eq!(summary["regions"][0]["non_finite"], 2);
    assert_eq!(summary["regions"][0]["filled_frames"], 4, "each hole is interpolated");
    assert_eq!(summary["joints"][0]["unknown"], 12);
    for array in decoded::<ContactArray>(&folder.join("out.mcap"), CONTACTS) {
        let state = &array.contacts[0];
        assert!(!state.force.is_nan() || state.flags != 0);
        assert!(!state.force.is_infinite());
    }
}

#[test]
fn each_setup_that_cannot_work_is_one_clear_line_and_leaves_no_output() {
    let folder = session(4);
    let folder = folder.path();
    let model = || LinearModel::new(64, 2, 1);
    let mut cases = String::new();
    let mut refused = |what: &str, expected: &str, more: &[&str]| {
        let run = replay(folder, "out.mcap", &[&FIRST[..], more].concat());
        let line = run.failure();
        assert!(line.contains(expected), "{what}: {line}");
        assert!(!folder.join("out.mcap").exists(), "{what}: left an output");
        let _ = writeln!(cases, "{what}: {line}");
    };
    model().metadata("unit", "lbf").write(folder, "lbf.onnx");
    refused("unit", "unit", &["--model", "lbf.onnx"]);
    LinearModel::new(64, 3, 1).write(folder, "three.onnx");
    refused("taxels", "region.index.taxels has 2 taxels, its model takes 3", &["--model", "three.onnx"]);
    model().flaw(common::onnx::Flaw::Weight(f32::NAN)).write(folder, "nan.onnx");
    refused("NaN weight", "NaN", &["--model", "nan.onnx"]);
    refused("no model", "nowhere.onnx", &["--model", "nowhere.onnx"]);
    refused("names", "model.NAME.inputs", &["-p", "model.tip.inputs.tactile:=taxels"]);
    refused("topic", "/elsewhere", &["-p", "tactile.glove.topic:=/elsewhere"]);
    refused(
        "type",
        "topic /taxels is tactile_pose_fusion/msg/TaxelArray",
        &["-p", "tactile.glove.type:=a_pkg/msg/B", "-p", "tactile.glove.field:=x"],
    );
    refused("joints", "joints [\"thumb\"] are in no message of [\"/joints\"]", &["-p", "region.index.joints:=[thumb]"]);
    refused(
        "length",
        "hold 2 values a row, tactile.glove.n_taxels is 3",
        &["-p", "tactile.glove.n_taxels:=3", "-p", "region.index.taxels:=[0, 1]"],
    );
    refused("unknown key", "did you mean contact.force_on?", &["-p", "contact.force:=1.0"]);
    refused("range", "contact.on_frames", &["-p", "contact.on_frames:=0"]);
    let no_folder = replay(folder, "no/folder/out.mcap", &FIRST);
    assert!(no_folder.failure().contains("no/folder"), "{no_folder:?}");
    let over_input = replay(folder, "session.mcap", &[&FIRST[..], &["--overwrite"]].concat());
    assert!(over_input.failure().contains("session.mcap"), "{over_input:?}");
    fs::write(folder.join("out.mcap"), "mine").unwrap();
    let taken = replay(folder, "out.mcap", &FIRST);
    assert!(taken.failure().contains("out.mcap"), "{taken:?}");
    assert_eq!(fs::read(folder.join("out.mcap")).unwrap(), b"mine");
}
