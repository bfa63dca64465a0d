//! Estimates of two runs compared, as a regression gate does.

use crate::common;

use std::fs;
use std::path::Path;

use common::ROOT;
use common::bags::{Bag, at, decoded, write_session};
use common::onnx::LinearModel;
use common::tpf::{Run, tpf, write_params};
use tactile_pose_fusion::bag::{BEST_EFFORT_QOS, NewChannel};
use tactile_pose_fusion::msg::{
    ContactArray, ContactState, Header, Time, WireType, WrenchStamped, definition_text, to_cdr,
};
use tactile_pose_fusion::units::Stamp;

const CONTACTS: &str = "/tactile_pose_fusion/contacts";

/// A folder with a session, and `a.mcap`: its replay.
fn golden() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("session.mcap"), 6);
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(folder.path(), "model.onnx");
    write_params(folder.path(), 2, &["dip"], "");
    replay(folder.path(), "a.mcap", &[]);
    folder
}

fn replay(folder: &Path, output: &str, more: &[&str]) {
    let args = ["replay", "session.mcap", "--params-file", "params.yaml", "--calibrate-first", "3.13", "-o", output];
    tpf(folder, &[&args[..], more].concat()).ok();
}

fn diff(folder: &Path, args: &[&str]) -> Run {
    tpf(folder, &[&["diff", "a.mcap", "b.mcap"], args].concat())
}

#[test]
fn equal_runs_are_the_same_bit_by_bit() {
    let folder = golden();
    replay(folder.path(), "b.mcap", &[]);
    let run = diff(folder.path(), &[]).ok();
    assert!(run.stdout.contains("region index: 600 frames in both") && run.stdout.ends_with("same\n"), "{run:?}");
}

#[test]
fn a_changed_force_is_told_by_field_with_the_first_and_the_largest() {
    let folder = golden();
    let folder = folder.path();
    let mut bag = Bag::create(&folder.join("b.mcap"));
    for (k, mut array) in decoded::<ContactArray>(&folder.join("a.mcap"), CONTACTS).into_iter().enumerate() {
        match k {
            200 => array.contacts[0].force += 1e-4,
            300 => array.contacts[0].force -= 5e-3,
            400 => array.contacts[0].flags |= 32,
            599 => continue,
            _ => {}
        }
        bag.send(CONTACTS, at(k as i64 * 10 + 13), &array);
    }
    for (k, wrench) in
        decoded::<WrenchStamped>(&folder.join("a.mcap"), "/tactile_pose_fusion/index/wrench").iter().enumerate()
    {
        bag.send("/tactile_pose_fusion/index/wrench", at(k as i64 * 10), wrench);
    }
    bag.finish();
    let found = diff(folder, &["--json"]);
    assert_eq!(found.code, 1);
    let region = &found.json()["regions"]["index"];
    let field = |name: &str| {
        let fields = region["fields"].as_array().unwrap();
        fields.iter().find(|field| field["field"] == name).unwrap().clone()
    };
    let force = field("force");
    assert_eq!(force["n_different"], 2);
    assert_eq!(force["first"]["stamp_ns"], at(2010).0);
    assert_eq!(force["largest"]["stamp_ns"], at(3010).0);
    assert!((force["largest"]["distance"].as_f64().unwrap() - 5e-3).abs() < 1e-12);
    assert_eq!(field("flags")["n_different"], 1);
    assert_eq!(region["only_in_a"]["n"], 1);
    let lenient = diff(folder, &["--tolerance-n", "0.001", "--json"]).json();
    let fields = lenient["regions"]["index"]["fields"].as_array().unwrap();
    assert_eq!(fields.iter().find(|field| field["field"] == "force").unwrap()["n_different"], 1);
    let words = diff(folder, &[]);
    assert!(words.stdout.contains("only in a.mcap: 1 frames") && words.stdout.ends_with("different\n"), "{words:?}");
    assert!(
        words.stdout.lines().all(|line| line.chars().count() <= 80),
        "a terminal of 80 columns holds it: {words:?}"
    );
    for told in ["force: 2 of 599 differ, by up to 5.000e-3", "first at", "largest at", "flags: 1 of 599 differ"] {
        assert!(words.stdout.contains(told), "{told}: {words:?}");
    }
}

/// Contacts as they were before messages had an age.
#[derive(serde::Serialize, serde::Deserialize)]
struct OldArray {
    header: Header,
    contacts: Vec<OldState>,
}

#[derive(serde::Serialize, serde::Deserialize)]
struct OldState {
    region: String,
    frame_id: String,
    contact_raw: bool,
    contact: bool,
    event: u8,
    since: Time,
    force: f64,
    force_base: f64,
    artifact: f64,
    on_threshold: f64,
    off_threshold: f64,
    mdf: f64,
    pose_age: f64,
    flags: u32,
}

impl WireType for OldArray {
    const TYPE_NAME: &'static str = ContactArray::TYPE_NAME;
}

#[test]
fn a_bag_of_the_time_when_contacts_had_no_age_is_read_by_its_own_schema() {
    let folder = golden();
    let folder = folder.path();
    let mut bag = Bag::create(&folder.join("b.mcap"));
    let text = definition_text(ContactArray::TYPE_NAME).unwrap().replace("float64 age\n", "");
    let text = text.replace("uint8 adaptation\n", "").replace("float64 artifact_change\n", "");
    let text = text.replace("float64 touch\n", "").replace("float64 touch_on\n", "").replace("float64 touch_off\n", "");
    let channel = bag.writer.add_channel(NewChannel {
        topic: CONTACTS,
        type_name: ContactArray::TYPE_NAME,
        schema_text: &text,
        qos_yaml: BEST_EFFORT_QOS,
        type_hash: "",
    });
    let channel = channel.unwrap();
    for array in decoded::<ContactArray>(&folder.join("a.mcap"), CONTACTS) {
        // The wrench of a frame comes before its contacts.
        let received = Stamp::from(array.header.stamp).offset(1);
        let old = |state: ContactState| OldState {
            region: state.region,
            frame_id: state.frame_id,
            contact_raw: state.contact_raw,
            contact: state.contact,
            event: state.event,
            since: state.since,
            force: state.force,
            force_base: state.force_base,
            artifact: state.artifact,
            on_threshold: state.on_threshold,
            off_threshold: state.off_threshold,
            mdf: state.mdf,
            pose_age: state.pose_age,
            flags: state.flags,
        };
        let old = OldArray { header: array.header, contacts: array.contacts.into_iter().map(old).collect() };
        bag.writer.write(channel, 0, received, received, &to_cdr(&old)).unwrap();
    }
    for wrench in decoded::<WrenchStamped>(&folder.join("a.mcap"), "/tactile_pose_fusion/index/wrench") {
        bag.send("/tactile_pose_fusion/index/wrench", Stamp::from(wrench.header.stamp), &wrench);
    }
    bag.finish();
    let run = diff(folder, &[]).ok();
    assert!(run.stdout.contains("600 frames in both") && run.stdout.ends_with("same\n"), "{run:?}");
}

#[test]
fn a_turned_normal_is_seen_in_the_wrench() {
    let folder = golden();
    replay(folder.path(), "b.mcap", &["-p", "region.index.normal:=[0.0, 1.0, 0.0]"]);
    let found = diff(folder.path(), &["--json"]);
    assert_eq!(found.code, 1);
    let fields = found.json()["regions"]["index"]["fields"].clone();
    let different = fields.as_array().unwrap().iter().filter(|field| field["n_different"] != 0);
    assert_eq!(different.map(|field| field["field"].clone()).collect::<Vec<_>>(), ["wrench"]);
}

#[test]
fn a_bag_without_estimates_and_a_cut_one_are_told() {
    let folder = golden();
    let folder = folder.path();
    fs::copy(folder.join("session.mcap"), folder.join("b.mcap")).unwrap();
    let none = diff(folder, &[]);
    let line = none.failure();
    assert!(line.starts_with("b.mcap: holds no tactile_pose_fusion/msg/ContactArray"), "{line}");
    let bytes = fs::read(folder.join("a.mcap")).unwrap();
    fs::write(folder.join("b.mcap"), &bytes[..bytes.len() / 2]).unwrap();
    let cut = diff(folder, &[]);
    assert_eq!(cut.code, 1, "{cut:?}");
    assert!(cut.stderr.contains("input lost: b.mcap"), "{cut:?}");
}

#[test]
fn a_comparison_is_written_as_checks_that_a_junit_parser_reads() {
    let folder = golden();
    let folder = folder.path();
    replay(folder, "b.mcap", &[]);
    diff(folder, &["--junit", "same.xml", "--jsonl", "same.jsonl"]).ok();
    LinearModel::new(64, 2, 1).gains(1.0, 21.0).metadata("unit", "gF").write(folder, "model.onnx");
    fs::remove_file(folder.join("b.mcap")).unwrap();
    replay(folder, "b.mcap", &[]);
    let run = diff(folder, &["--junit", "other.xml", "--jsonl", "other.jsonl"]);
    assert_eq!(run.code, 1, "{run:?}");
    let verdicts = |file: &str| {
        let text = fs::read_to_string(folder.join(file)).unwrap();
        let checks = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
        checks.map(|check| (check["name"].to_string(), check["verdict"].to_string())).collect::<Vec<_>>()
    };
    let (same, other) = (verdicts("same.jsonl"), verdicts("other.jsonl"));
    assert!(same.len() == other.len() && same.iter().all(|(_, verdict)| verdict == "\"passed\""), "{same:?}");
    assert!(other.contains(&("\"index: force\"".into(), "\"failed\"".into())), "{other:?}");
    assert!(other.contains(&("\"index: force_base\"".into(), "\"passed\"".into())), "{other:?}");

    let Some(python) = common::skip::python() else { return };
    let script = Path::new(ROOT).join("tests/python/read_junit.py");
    let output = std::process::Command::new(python).arg(script).arg(folder.join("other.xml")).output().unwrap();
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found["tests"], other.len());
    let n_failed = other.iter().filter(|(_, verdict)| verdict == "\"failed\"").count();
    assert_eq!(found["failures"], n_failed);
    let force = found["cases"].as_array().unwrap().iter().find(|case| case["name"] == "index: force").unwrap();
    assert!(force["failed"][0].as_str().unwrap().contains("differ, first at"), "{force}");
}
