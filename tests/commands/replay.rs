//! A recorded bag in, newtons and contact out: the main job, through the binary.

use crate::common;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use common::ROOT;
use common::bags::{Bag, at, decoded, messages, stamp_of, write_session};
use common::layouts;
use common::onnx::LinearModel;
use common::parity::Parity;
use common::shared;
use common::tpf::{tpf, write_params};
use tactile_pose_fusion::bag::{BEST_EFFORT_QOS, BagWriter, NewChannel, WriteOptions};
use tactile_pose_fusion::msg::{
    ContactArray, ContactState, Header, Stage, TaxelArray, WrenchStamped, definition_text, from_cdr,
};
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
    let parity = Parity::read();
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::copy(&parity.model, folder.join("model.onnx")).unwrap();
    let names = ["index_dip", "index_pip", "index_mcp_flex", "index_mcp_abd"];
    write_params(folder, 16, &names, "");
    write_zero_calibration(folder, 16);
    let mut bag = Bag::create(&folder.join("session.mcap"));
    for (k, (taxels, joints)) in
        parity.tactile_frames.chunks_exact(16).zip(parity.joint_frames.chunks_exact(4)).enumerate()
    {
        let angles: Vec<f64> = joints.iter().map(|&angle| f64::from(angle)).collect();
        bag.joints(at(k as i64 * 10), &names, &angles);
        bag.taxels(at(k as i64 * 10), taxels);
    }
    bag.finish();
    let mut backends = vec!["builtin", "rten"];
    if common::onnx_runtime_is_here() {
        backends.push("onnxruntime");
    }
    for backend in backends {
        for batch in ["1", "32"] {
            let output = format!("{backend}{batch}.mcap");
            replay(folder, &output, &["--calibration", "zero.yaml", "--backend", backend, "--batch", batch]).ok();
            let arrays: Vec<ContactArray> = decoded(&folder.join(&output), CONTACTS);
            assert_eq!(arrays.len(), parity.n_frames());
            for (window, (force, base)) in parity.force.iter().zip(&parity.base).enumerate() {
                let state = &arrays[window + 63].contacts[0];
                assert_eq!(stamp_of(&arrays[window + 63].header), at((window as i64 + 63) * 10));
                for (got, expected) in [(state.force, *force), (state.force_base, *base)] {
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
fn how_old_frames_were_is_told_where_a_live_node_recorded_them_and_nowhere_else() {
    let folder = session(5);
    let folder = folder.path();
    let ages = |bag: &str, more: &[&str]| -> Vec<(f64, u32)> {
        fs::rename(folder.join(bag), folder.join("session.mcap")).unwrap();
        replay(folder, "out.mcap", &[&FIRST[..], &["--overwrite"], more].concat()).ok();
        let arrays = decoded::<ContactArray>(&folder.join("out.mcap"), CONTACTS);
        arrays.iter().map(|array| (array.contacts[0].age, array.contacts[0].flags & ContactState::LATE)).collect()
    };
    // As a live node records them: received 30 ms after their stamps, and 150 ms from the third second on.
    let mut writer = BagWriter::create(&folder.join("live.mcap"), WriteOptions::default()).unwrap();
    for (k, message) in messages(&folder.join("session.mcap")).into_iter().enumerate() {
        let channel = NewChannel {
            topic: &message.topic,
            type_name: &message.type_name,
            schema_text: &definition_text(&message.type_name).unwrap(),
            qos_yaml: BEST_EFFORT_QOS,
            type_hash: "",
        };
        let channel = writer.add_live_input(channel).unwrap();
        let received = message.log_time.offset(if k < 400 { 30_000_000 } else { 150_000_000 });
        writer.write(channel, 0, received, received, &message.data).unwrap();
    }
    writer.finish().unwrap();
    let unknown = ages("session.mcap", &[]);
    assert!(unknown.iter().all(|(age, late)| age.is_nan() && *late == 0));
    let live = ages("live.mcap", &["--merge"]);
    // A frame is complete with the joint state 3 ms after it; the last ones when the bag ends.
    let complete = &live[..live.len() - 2];
    let (prompt, slow) = complete.split_at(198);
    assert!(prompt.iter().all(|(age, late)| (*age - 0.033).abs() < 1e-9 && *late == 0), "{prompt:?}");
    assert!(slow[4..].iter().all(|(age, late)| (*age - 0.153).abs() < 1e-9 && *late != 0), "{slow:?}");
    let lenient = ages("out.mcap", &["--node", "/again", "-p", "timing.max_age_ms:=0.0"]);
    assert!(lenient.is_empty(), "estimates of /again are elsewhere");
    let again: Vec<ContactArray> = decoded(&folder.join("out.mcap"), "/again/contacts");
    assert!(again.iter().any(|array| array.contacts[0].age > 0.15));
    assert!(again.iter().all(|array| array.contacts[0].flags & ContactState::LATE == 0), "0 is no limit");
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

/// The session with an annotation at each of these seconds: whether nothing touches the glove from there on.
fn annotate(folder: &Path, name: &str, at_rest: &[(i64, bool)]) {
    let mut bag = Bag::create(&folder.join(name));
    let mut annotations = at_rest.iter().peekable();
    for message in messages(&folder.join("session.mcap")) {
        while let Some(&(second, zero_load)) = annotations.next_if(|(second, _)| at(second * 1000) <= message.log_time)
        {
            let header = Header { stamp: at(second * 1000).into(), frame_id: String::new() };
            bag.send("/stage", message.log_time, &Stage { header, stage: 1, zero_load, ..Stage::default() });
        }
        if message.topic == "/taxels" {
            bag.send_bytes::<tactile_pose_fusion::msg::TaxelArray>("/taxels", message.log_time, &message.data);
        } else {
            bag.send_bytes::<tactile_pose_fusion::msg::JointState>("/joints", message.log_time, &message.data);
        }
    }
    bag.finish();
}

#[test]
fn a_zero_is_judged_wherever_it_comes_from() {
    let folder = session(8);
    let folder = folder.path();
    let params = ["--params-file", "params.yaml"];
    let insist = ["-p", "calibration.insist:=true"];
    tpf(folder, &[&["calibrate", "session.mcap", "-o", "zero.yaml"], &params[..], &FIRST[..]].concat()).ok();
    // Seconds 4 and 6 are touched.
    annotate(folder, "air.mcap", &[(0, true), (4, false)]);
    annotate(folder, "loaded.mcap", &[(0, true)]);
    LinearModel::new(64, 2, 1).gains(1.0, 21.0).metadata("unit", "gF").write(folder, "other.onnx");
    let (file, first) = (["--calibration", "zero.yaml"], ["--calibrate-first", "8"]);
    let other = ["--model", "other.onnx", "--calibration", "zero.yaml"];
    let none: [&str; 0] = [];
    let cases: [(&str, &[&str], &str); 4] = [
        ("session.mcap", &first, "region index: calibration looks loaded: "),
        ("loaded.mcap", &none, "region index: calibration looks loaded: "),
        ("loaded.mcap", &file, "region index: the zero of zero.yaml doesn't hold in this recording: "),
        ("air.mcap", &other, "zero.yaml: was judged with another model tip than this one; calibrate again"),
    ];
    for (bag, from, refusal) in cases {
        let replay = [&["replay", bag, "-o", "out.mcap", "--overwrite"], &params[..], from].concat();
        let refused = tpf(folder, &replay);
        assert!(refused.failure().starts_with(refusal), "{bag} {from:?}: {refused:?}");
        let insisted = tpf(folder, &[&replay[..], &insist].concat()).ok();
        let said = insisted.stderr.lines().find(|line| line.starts_with(refusal));
        assert!(said.is_some_and(|line| line.ends_with("; used all the same, because calibration.insist is set")));
    }
    for from in [&none[..], &file] {
        tpf(folder, &[&["replay", "air.mcap", "-o", "air_out.mcap", "--overwrite"], &params[..], from].concat()).ok();
    }
    let refused = tpf(folder, &[&["calibrate", "loaded.mcap", "-o", "never.yaml"], &params[..]].concat());
    assert!(refused.failure().starts_with("region index: calibration looks loaded: "), "{refused:?}");
    assert!(!folder.join("never.yaml").exists());
    let past =
        tpf(folder, &[&["replay", "session.mcap", "-o", "p.mcap", "--calibrate-first", "500"], &params[..]].concat());
    assert!(past.failure().starts_with("the first 500 s are asked for as zero load and the recording has 8.0 s"));
}

#[test]
fn stamps_of_another_clock_reach_no_log_time_and_a_message_of_wrong_length_no_clock() {
    let folder = session(6);
    let folder = folder.path();
    let session = messages(&folder.join("session.mcap"));
    let (begin, end) = (session[0].log_time, session[session.len() - 1].log_time);
    // Since boot, and before 1970.
    for (name, offset_ns) in [("boot", 1_699_999_990_000_000_000), ("negative", 1_700_000_100_000_000_000)] {
        let mut bag = Bag::create(&folder.join("session.mcap.new"));
        for message in &session {
            let move_back = |header: &mut Header| header.stamp = stamp_of(header).offset(-offset_ns).into();
            if message.topic == "/taxels" {
                let mut taxels: tactile_pose_fusion::msg::TaxelArray = from_cdr(&message.data).unwrap();
                move_back(&mut taxels.header);
                bag.send("/taxels", message.log_time, &taxels);
                if taxels.sequence == 350 {
                    let mut short = taxels.clone();
                    (short.header, short.values) = (Header::default(), vec![1.0]);
                    bag.send("/taxels", message.log_time, &short);
                }
            } else {
                let mut joints: tactile_pose_fusion::msg::JointState = from_cdr(&message.data).unwrap();
                move_back(&mut joints.header);
                bag.send("/joints", message.log_time, &joints);
            }
        }
        bag.finish();
        let out = format!("{name}.mcap");
        let input = folder.join("session.mcap.new").join("session.mcap.new_0.mcap");
        fs::rename(input, folder.join("shifted.mcap")).unwrap();
        fs::remove_dir_all(folder.join("session.mcap.new")).unwrap();
        let args = ["replay", "shifted.mcap", "--params-file", "params.yaml", "--json", "-o", &out, FIRST[0], FIRST[1]];
        let summary = tpf(folder, &args).ok().json();
        let tactile = &summary["tactile"][0];
        assert_eq!(
            (&tactile["wrong_length"], &tactile["time_jumps"], &tactile["gaps"]),
            (&1.into(), &0.into(), &0.into())
        );
        let times: Vec<Stamp> = messages(&folder.join(&out)).iter().map(|message| message.log_time).collect();
        assert_eq!(times[times.len() - 1], end, "{name}: the last frames came with the last message");
        assert!(times.iter().all(|time| (begin..=end).contains(time)), "{name}");
    }
}

#[test]
fn a_bag_written_topic_by_topic_gives_what_the_bag_in_order_gives() {
    let folder = session(6);
    let folder = folder.path();
    let mut bag = Bag::create(&folder.join("by_topic.mcap"));
    for topic in ["/taxels", "/joints"] {
        for message in messages(&folder.join("session.mcap")).iter().filter(|message| message.topic == topic) {
            if topic == "/taxels" {
                bag.send_bytes::<tactile_pose_fusion::msg::TaxelArray>(topic, message.log_time, &message.data);
            } else {
                bag.send_bytes::<tactile_pose_fusion::msg::JointState>(topic, message.log_time, &message.data);
            }
        }
        bag.writer.flush().unwrap();
    }
    bag.finish();
    let in_order = replay(folder, "a.mcap", &[FIRST[0], FIRST[1], "--json"]).ok().json();
    let args =
        ["replay", "by_topic.mcap", "--params-file", "params.yaml", "-o", "b.mcap", "--json", FIRST[0], FIRST[1]];
    let by_topic = tpf(folder, &args).ok().json();
    assert_eq!(in_order["estimates_sha256"], by_topic["estimates_sha256"]);
    assert_eq!(fs::read(folder.join("a.mcap")).unwrap(), fs::read(folder.join("b.mcap")).unwrap());
    assert!(!folder.join("metadata.yaml").exists(), "it would hide the other bags");
}

#[test]
fn a_folder_of_several_recordings_is_named_and_not_merged() {
    let folder = session(6);
    let folder = folder.path();
    fs::create_dir(folder.join("days")).unwrap();
    for day in ["monday", "tuesday"] {
        fs::copy(folder.join("session.mcap"), folder.join(format!("days/{day}.mcap"))).unwrap();
    }
    let params = ["--params-file", "params.yaml"];
    let refusal = "days: holds 2 recordings, monday.mcap, tuesday.mcap: name the one that is meant";
    for args in [&["replay", "days", "-o", "o.mcap"][..], &["calibrate", "days", "-o", "o.yaml"]] {
        let run = tpf(folder, &[args, &params].concat());
        assert!(run.failure().starts_with(refusal), "{run:?}");
    }
    let run = tpf(folder, &["diff", "days", "session.mcap"]);
    assert!(run.stderr.contains(refusal), "{run:?}");
    let run = tpf(folder, &["inspect", "days", "--json"]).ok();
    assert_eq!(run.json().as_array().unwrap().len(), 2);
    assert!(run.stderr.contains("days: 2 recordings, each by itself: monday.mcap, tuesday.mcap"), "{run:?}");
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
    assert!(words.stdout.contains("messages in bursts") && words.stdout.contains("3 gaps over"), "{}", words.stdout);
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

#[test]
fn one_topic_feeds_every_source_that_reads_from_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let mut bag = Bag::create(&path.join("hand.mcap"));
    let hand = layouts::add::<layouts::HandState>(&mut bag, "/hand");
    for (ms, zero_load) in [(0, true), (3_900, false)] {
        let header = Header { stamp: at(ms).into(), frame_id: String::new() };
        let (substage, pose) = (String::new(), String::new());
        bag.send("/stage", at(ms), &Stage { header, stage: 1, substage, pose, repetition: 0, zero_load });
    }
    (0..600).for_each(|k| layouts::send(&mut bag, hand, at(10 * k), &layouts::hand_state(k)));
    bag.finish();
    let model = LinearModel::new(8, 3, 1).metadata("unit", "N");
    model.write(path, "model.onnx");
    let params = "/**:
  ros__parameters:
    regions: [index, thumb]
    tactile_sources: [index, thumb]
    joint_sources: [hand]
    truth_sources: [load]
    tactile.index: {topic: /hand, type: acme/msg/HandState, n_taxels: 3, field: \"press_sensor_state[0].pressure\", stamp: receipt}
    tactile.thumb: {topic: /hand, type: acme/msg/HandState, n_taxels: 3, field: \"press_sensor_state[1].pressure\", stamp: receipt}
    joint.hand: {topic: /hand, type: acme/msg/HandState, field: \"motor_state[].q\", names: [mcp, pip], stamp: receipt}
    truth.load: {topic: /hand, type: acme/msg/HandState, field: load, stamp: receipt}
    model.tip: {path: model.onnx}
    region.index: {model: tip, tactile_source: index, joints: [pip], frame_id: index}
    region.thumb: {model: tip, tactile_source: thumb, joints: [mcp], frame_id: thumb}
    calibration.max_force: 1000.0
";
    fs::write(path.join("params.yaml"), params).unwrap();
    let args = ["--params-file", "params.yaml", "--calibrate-first", "2.5", "--merge", "-o", "out.mcap", "--json"];
    let run = tpf(path, &[&["replay", "hand.mcap"], &args[..]].concat()).ok();
    assert_eq!(
        run.json()["topics"]["/hand"],
        serde_json::json!({"read": 600, "unreadable": {}, "first_error": null}),
        "a message counts once"
    );
    let contacts: Vec<ContactArray> = decoded(&path.join("out.mcap"), CONTACTS);
    let readings = layouts::readings(6, 599);
    for (region, joint) in [("index", 1), ("thumb", 0)] {
        let of_region = |array: &ContactArray| array.contacts.iter().find(|state| state.region == region).cloned();
        let states: Vec<ContactState> = contacts.iter().filter_map(of_region).collect();
        assert_eq!(states.len(), 600, "{region}");
        let first = if region == "index" { 0 } else { 3 };
        let features: Vec<f32> = (first..first + 3).map(|taxel| readings[taxel] - (100 + taxel) as f32).collect();
        let expected = model.expected(&features, &[layouts::degrees(joint, 599).to_radians()]).0;
        // Sums in another order.
        assert!((states[599].force - f64::from(expected)).abs() < 1e-4, "{region}: {} {expected}", states[599].force);
    }
    // The true force is in the same messages.
    tpf(path, &["export", "out.mcap", "--params-file", "params.yaml", "--csv", "rows.csv"]).ok();
    let rows = fs::read_to_string(path.join("rows.csv")).unwrap();
    let header: Vec<&str> = rows.lines().next().unwrap().split(',').collect();
    let column = header.iter().position(|name| name.contains("truth")).unwrap_or_else(|| panic!("{header:?}"));
    let last = rows.lines().last().unwrap().split(',').nth(column).unwrap();
    assert!((last.parse::<f64>().unwrap() - 2.5).abs() < 1e-9, "through gF and back: {last} in {header:?}");

    // A part of a message that can't be read is counted and named, and the others are used.
    let args = [&args[..4], &["-o", "short.mcap", "--json", "-p", "joint.hand.names:=[mcp]", "-p"]].concat();
    let run = tpf(path, &[&["replay", "hand.mcap"], &args[..], &["region.index.joints:=[mcp]"]].concat());
    let first = "joint angles: a acme/msg/HandState names 1 joints and holds 2 positions; expected as many of both";
    assert!(run.stderr.contains(&format!("topic /hand: none of its 600 messages could be read: {first}")), "{run:?}");
    let types = ["-p", "joint.hand.type:=acme/msg/Other"];
    let run =
        tpf(path, &[&["replay", "hand.mcap", "-o", "x.mcap", "--params-file", "params.yaml"], &types[..]].concat());
    assert!(run.failure().contains("both are on the topic /hand: it has one type"), "{run:?}");
}

#[test]
fn angles_in_the_other_unit_are_doubted_by_the_name_of_the_parameter() {
    let folder = session(8);
    let path = folder.path();
    let right = replay(path, "right.mcap", &FIRST);
    assert!(!right.stderr.contains("degrees"), "{right:?}");
    let run = replay(path, "tiny.mcap", &[&FIRST[..], &["-p", "joint.hand.degrees:=true"]].concat());
    assert!(run.stderr.contains("they look like radians; set joint.hand.degrees to false"), "{run:?}");
    let mut bag = Bag::create(&path.join("degrees.mcap"));
    for k in 0..800 {
        let bend = 40.0 * (k as f64 * 0.02).sin();
        bag.joints(at(k * 10 + 3), &["pip", "dip"], &[2.0 * bend, bend]);
        bag.taxels(at(k * 10 + 10), &[10.0 + (k % 5) as f32, 5.0]);
    }
    bag.finish();
    let args = [
        "replay",
        "degrees.mcap",
        "--params-file",
        "params.yaml",
        "-o",
        "x.mcap",
        "-p",
        "calibration.max_force:=1000.0",
    ];
    let run = tpf(path, &[&args[..], &FIRST[..]].concat());
    assert!(run.stderr.contains("they look like degrees; set joint.hand.degrees to true"), "{run:?}");
}

#[test]
fn a_file_name_steers_no_terminal_and_an_output_that_is_there_names_the_option() {
    let folder = session(8);
    let path = folder.path();
    fs::rename(path.join("session.mcap"), path.join("a\u{1b}]0;x\u{7}.mcap")).unwrap();
    let args = [
        "replay",
        "a\u{1b}]0;x\u{7}.mcap",
        "--params-file",
        "params.yaml",
        "-o",
        "b\u{1b}[31m.mcap",
        FIRST[0],
        FIRST[1],
    ];
    let run = tpf(path, &args).ok();
    assert!(
        run.stdout.contains("estimates") && !run.stdout.contains('\u{1b}') && !run.stderr.contains('\u{1b}'),
        "{run:?}"
    );
    let again = tpf(path, &args);
    assert!(again.failure().contains("give --overwrite") && !again.stderr.contains('\u{1b}'), "{again:?}");
}

#[test]
fn a_model_that_is_named_takes_its_own_joints_of_those_of_the_region() {
    let folder = session(12);
    let folder = folder.path();
    LinearModel::new(64, 2, 1)
        .gains(1.0, 20.0)
        .metadata("unit", "gF")
        .metadata("joints", "dip")
        .write(folder, "own.onnx");
    let run = |joints: &str, output: &str| {
        let joints = format!("region.index.joints:=[{joints}]");
        replay(folder, output, &[&FIRST[..], &["--model", "own.onnx", "-p", &joints]].concat())
    };
    let wrenches = |output: &str| -> Vec<Vec<u8>> {
        let all = messages(&folder.join(output)).into_iter();
        all.filter(|message| message.topic == WRENCH).map(|message| message.data).collect()
    };
    run("dip", "same.mcap").ok();
    let same = wrenches("same.mcap");
    assert!(same.len() > 500);
    for (number, joints) in ["dip, pip", "pip, dip"].iter().enumerate() {
        let output = &format!("{number}.mcap");
        let taken = run(joints, output).ok();
        let note = "region index: its model takes the joints dip, in place of the 2 in region.index.joints";
        assert!(taken.stderr.contains(note), "{taken:?}");
        assert!(wrenches(output) == same, "{joints}");
    }
    let other = run("pip", "other.mcap");
    assert!(
        other.failure().contains(r#"region.index.joints is ["pip"], its model was trained on ["dip"]"#),
        "{other:?}"
    );
    // Without --model the parameters say it all.
    let args = [&FIRST[..], &["-p", "model.tip.path:=own.onnx", "-p", "region.index.joints:=[dip, pip]"]].concat();
    let strict = replay(folder, "strict.mcap", &args);
    assert!(strict.failure().contains("region.index.joints has 2 joints, its model takes 1"), "{strict:?}");
    // The same rule where a zero is taken.
    let calibrate = ["calibrate", "session.mcap", "--params-file", "params.yaml", "--model", "own.onnx"];
    let more = [FIRST[0], FIRST[1], "-p", "region.index.joints:=[dip, pip]", "-o", "zero.yaml"];
    assert!(tpf(folder, &[&calibrate[..], &more].concat()).ok().stderr.contains("takes the joints dip"));
}

#[test]
fn a_model_of_another_glove_is_refused_unless_it_is_asked_for_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut bag = Bag::create(&folder.join("session.mcap"));
    bag.joints(at(0), &["mcp"], &[0.0]);
    (0..300).for_each(|k| bag.taxels(at(k * 10), &[(k % 2) as f32; 6]));
    bag.finish();
    let model = &format!("{ROOT}/models/glove1_tactile_only.onnx");
    write_params(folder, 6, &[], "    glove: synthetic-3\n");
    let run = |more: &[&str]| {
        let args =
            ["replay", "session.mcap", "--params-file", "params.yaml", "--model", model, "--calibrate-first", "2"];
        tpf(folder, &[&args[..], &["-o", "out.mcap", "--overwrite"], more].concat())
    };
    let refused = run(&[]);
    assert_eq!(
        refused.failure().rsplit_once(".onnx: ").unwrap().1,
        "was trained on glove \"synthetic-1\", the parameters say glove: \"synthetic-3\"; take the model of this glove, correct `glove`, or set model.NAME.glove to \"synthetic-1\" to use it all the same"
    );
    let args = ["calibrate", "session.mcap", "--params-file", "params.yaml", "--model", model, "-o", "zero.yaml"];
    assert!(tpf(folder, &args).failure().contains("was trained on glove \"synthetic-1\""));
    let insisted = run(&["-p", "model.tip.glove:=synthetic-1"]).ok();
    let note = "it was trained on glove synthetic-1 and is used on glove synthetic-3, as model.NAME.glove says";
    assert!(insisted.stderr.contains(note), "{insisted:?}");
    let wrong = run(&["-p", "model.tip.glove:=synthetic-2"]);
    assert!(wrong.failure().contains("the parameters say model.NAME.glove: \"synthetic-2\""), "{wrong:?}");
    run(&["-p", "glove:=synthetic-1"]).ok();
}

#[test]
fn contacts_hold_the_regions_of_every_tactile_source_and_flag_those_of_one_that_stops() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut bag = Bag::create(&folder.join("session.mcap"));
    let is_there = |k: i64| !(500..600).contains(&k);
    for k in 0..800 {
        let bend = (k as f64 * 0.02).sin();
        let wiggle = (k * 7919 % 13) as f32 * 0.01;
        bag.joints(at(k * 10 + 3), &["dip"], &[bend]);
        bag.taxels(at(k * 10), &[10.0 + wiggle, 5.0 - wiggle]);
        if is_there(k) {
            let header = Header { stamp: at(k * 10 + 2).into(), frame_id: String::new() };
            let thumb =
                TaxelArray { header, rows: 1, values: vec![10.0 + wiggle, 5.0 - wiggle], ..TaxelArray::default() };
            bag.send("/thumb", at(k * 10 + 2), &thumb);
        }
    }
    bag.finish();
    LinearModel::new(4, 2, 1).gains(1.0, 0.0).metadata("unit", "gF").write(folder, "model.onnx");
    let params = "/**:
  ros__parameters:
    regions: [index, thumb]
    tactile_sources: [glove, thumb]
    joint_sources: [hand]
    tactile.glove: {topic: /taxels, n_taxels: 2}
    tactile.thumb: {topic: /thumb, n_taxels: 2}
    joint.hand: {topic: /joints}
    model.tip: {path: model.onnx}
    region.index: {model: tip, tactile_source: glove, joints: [dip], frame_id: index_tip}
    region.thumb: {model: tip, tactile_source: thumb, joints: [dip], frame_id: thumb_tip}
";
    fs::write(folder.join("params.yaml"), params).unwrap();
    replay(folder, "out.mcap", &["--calibrate-first", "3"]).ok();
    let arrays: Vec<ContactArray> = decoded(&folder.join("out.mcap"), CONTACTS);
    let names = |array: &ContactArray| array.contacts.iter().map(|state| state.region.clone()).collect::<Vec<_>>();
    assert!(arrays.iter().all(|array| names(array) == ["index", "thumb"]));
    assert!((795..=801).contains(&arrays.len()), "one a period of 800: {}", arrays.len());
    let of_gap = |array: &&ContactArray| (at(5100)..at(5990)).contains(&stamp_of(&array.header));
    let gap: Vec<&ContactArray> = arrays.iter().filter(of_gap).collect();
    assert!(gap.len() >= 88, "the other one goes on: {}", gap.len());
    for array in gap {
        let [index, thumb] = array.contacts.as_slice() else { panic!("{array:?}") };
        assert!(index.flags == 0 && index.force.is_finite(), "{index:?}");
        assert!(thumb.flags == ContactState::STALE_TACTILE && thumb.force.is_nan(), "{thumb:?}");
    }
    let last = arrays.last().unwrap();
    assert!(last.contacts.iter().all(|state| state.force.is_finite()), "it came back: {last:?}");
    // A wrench is told for every frame with a force, whatever message of contacts its frame is in.
    let wrenches: Vec<WrenchStamped> = decoded(&folder.join("out.mcap"), WRENCH);
    assert!(wrenches.len() > 790, "{}", wrenches.len());
}
