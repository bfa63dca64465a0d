//! Bags without stage annotations: when nothing touches the glove is told on the command line, or by the true force.

use crate::common;

use std::fs;
use std::path::Path;

use common::bags::{Bag, at};
use common::onnx::LinearModel;
use common::tpf::{Run, tpf};
use tactile_pose_fusion::bag::BagReader;
use tactile_pose_fusion::msg::{
    Float32MultiArray, Header, JointState, MultiArrayLayout, Stage, TaxelArray, Vector3, Wrench, WrenchStamped,
    from_cdr,
};

const PARAMS: &str = "/**:
  ros__parameters:
    regions: [tip]
    tactile_sources: [glove]
    joint_sources: [hand]
    truth_sources: [cell]
    tactile.glove: {topic: /taxels, n_taxels: 2}
    joint.hand: {topic: /joints}
    truth.cell: {topic: /cell, unit: mN}
    model.tip: {path: model.onnx, backend: rten}
    region.tip: {model: tip, frame_id: tip, joints: [dip, pip]}
    calibration.max_force: 1.0
";

/// A press of every other second from 10 s on, in mN; before that, the hand bends in the air.
fn press(frame: i64) -> f64 {
    let is_pressed = frame >= 1000 && (frame / 100) % 2 == 1;
    if is_pressed { 600.0 + 300.0 * (frame as f64 * 0.1).sin() } else { 0.0 }
}

/// A session of 40 s at 100 Hz, whose force sensor reads 3 N at rest and drifts.
fn write_session(path: &Path, annotated: bool) {
    let mut bag = Bag::create(path);
    let annotate = |bag: &mut Bag, ms: i64, stage: u8, substage: &str| {
        let header = Header { stamp: at(ms).into(), frame_id: String::new() };
        let zero_load = stage == 1;
        bag.send("/stage", at(ms), &Stage { header, stage, substage: substage.into(), zero_load, ..Stage::default() });
    };
    for frame in 0..4000 {
        let now = at(frame * 10);
        if annotated && frame == 0 {
            annotate(&mut bag, 0, 1, "in_air");
        }
        if annotated && frame == 1000 {
            annotate(&mut bag, 10_000, 2, "other");
        }
        let (force, bend) = (press(frame), 0.5 + 0.5 * (frame as f64 * 0.021).sin());
        bag.taxels(now, &[500.0 + (0.1 * force + 2.0 * bend) as f32, 300.0 + (0.05 * force - bend) as f32]);
        bag.joints(now, &["pip", "dip"], &[bend, 0.7 * bend]);
        let drift = 0.1 * frame as f64 / 100.0;
        let force = Vector3 { x: 0.0, y: 0.0, z: 3000.0 + drift + force };
        let header = Header { stamp: now.into(), frame_id: "cell".into() };
        bag.send("/cell", now, &WrenchStamped { header, wrench: Wrench { force, ..Wrench::default() } });
    }
    bag.finish();
}

/// A folder with the session, annotated and not, parameters and a model.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, annotated) in [("told", false), ("annotated", true)] {
        fs::create_dir(folder.path().join(name)).unwrap();
        write_session(&folder.path().join(name).join("session.mcap"), annotated);
    }
    LinearModel::new(4, 2, 2).gains(0.004, 0.02).metadata("unit", "N").write(folder.path(), "model.onnx");
    fs::write(folder.path().join("params.yaml"), PARAMS).unwrap();
    folder
}

fn run(folder: &Path, command: &str, bags: &str, more: &[&str]) -> Run {
    tpf(folder, &[&[command, bags, "--params-file", "params.yaml"], more].concat())
}

/// The options of each command that asks for annotations, with its output in a folder.
const COMMANDS: [(&str, &[&str]); 4] = [
    ("eval", &["--json", "--model", "model.onnx"]),
    ("characterize", &["--json"]),
    ("export", &["--csv", "frames.csv", "--overwrite"]),
    ("calibrate", &["--touches", "-o", "zero.yaml"]),
];

const AIR: [&str; 2] = ["--in-air", "0..10"];
const BELOW: [&str; 2] = ["--zero-load-below", "20mN"];

#[test]
fn what_is_told_does_what_annotations_do() {
    let folder = workplace();
    let folder = folder.path();
    for (command, options) in COMMANDS {
        let mut made = Vec::new();
        for (bags, told) in [("annotated", &[][..]), ("told", &AIR[..])] {
            let run = run(folder, command, bags, &[options, told].concat()).ok();
            let _ = fs::remove_file(folder.join("zero.yaml")); // of calibrate alone, which replaces none
            let csv = fs::read_to_string(folder.join("frames.csv")).unwrap_or_default().replace("told", "annotated");
            let said = run.stdout.replace("told", "annotated").replace("0 to 10 s", "annotations");
            // The command lines differ, and the bags are not the same file.
            let whole: Vec<&str> = said.split("\"command\": [").collect();
            let rest = whole[1..].iter().map(|part| part.split_once(']').unwrap().1);
            let said = whole[0].to_owned() + &rest.collect::<String>();
            let said: Vec<&str> = said.lines().filter(|line| !line.contains("sha256")).collect();
            made.push((said.join("\n"), csv));
        }
        let differs = made[0].1.lines().zip(made[1].1.lines()).find(|(annotated, told)| annotated != told);
        assert_eq!(differs, None, "{command}");
        assert_eq!(made[0].0, made[1].0, "{command}");
    }
}

#[test]
fn a_table_without_the_true_force_says_so() {
    let folder = workplace();
    let folder = folder.path();
    let export = |more: &[&str]| {
        let out = [&["--csv", "frames.csv", "--overwrite", "--calibrate-first", "5"], more].concat();
        run(folder, "export", "told", &out).ok().stderr
    };
    let said = export(&[]);
    assert!(said.contains("no true force is written, because no stage annotations on /stage tell where"), "{said}");
    let said = export(&BELOW);
    assert!(!said.contains("no true force"), "{said}");
}

#[test]
fn a_low_true_force_tells_it_bag_by_bag() {
    let folder = workplace();
    let folder = folder.path();
    for (command, options) in COMMANDS {
        let run = run(folder, command, "told", &[options, &BELOW].concat()).ok();
        assert!(run.stderr.contains("told: the true force is below 0.02 N for "), "{run:?}");
        match command {
            "eval" => {
                let scored = run.json();
                assert_eq!(scored["sessions"][0]["zero_load"]["n_touch"], 0, "{scored:#}");
                let minutes =
                    scored["models"].as_array().unwrap().last().unwrap()["contacts"]["?"]["in_air"]["minutes"]
                        .as_f64()
                        .unwrap_or_else(|| panic!("{scored:#}"));
                assert!(minutes > 0.02, "{minutes}");
            }
            "characterize" => assert_eq!(run.json()["sessions"][0]["in_air"], "true force below 0.02 N"),
            "export" => {
                let csv = fs::read_to_string(folder.join("frames.csv")).unwrap();
                let header: Vec<&str> = csv.lines().next().unwrap().split(',').collect();
                let column = header.iter().position(|name| name.contains("true") || name.contains("truth")).unwrap();
                let truth = |line: &str| line.split(',').nth(column).and_then(|cell| cell.parse::<f64>().ok());
                let largest = csv.lines().skip(1).filter_map(truth).fold(0.0, f64::max);
                assert!(
                    (0.85..0.95).contains(&largest) || (85.0..95.0).contains(&largest),
                    "tared: {largest} {header:?}"
                );
            }
            _ => assert!(run.stdout.contains("region tip: forces times"), "{run:?}"),
        }
    }
}

#[test]
fn a_bag_that_says_nothing_is_refused_with_what_to_give() {
    let folder = workplace();
    let folder = folder.path();
    for (command, options) in [COMMANDS[0], COMMANDS[1], ("train", &["-o", "new.onnx"][..])] {
        let refused = run(folder, command, "told", options);
        let line = refused.failure();
        assert!(line.contains("give --in-air FROM..TO or --zero-load-below FORCE"), "{line}");
    }
    // Without annotations there are forces to export, but none that are tared.
    let export = run(folder, "export", "told", COMMANDS[2].1).ok();
    assert!(!export.stdout.is_empty());
    let cases: [(&[&str], &str); 6] = [
        (&["--in-air", "50..60"], "--in-air 50..60 lies behind the end of the recording, which is 40.0 s long"),
        (&["--zero-load-below", "1e-9N"], "truth cell never stays below 0.000000001 N of its rest"),
        (&["--zero-load-below", "0.1N", "--truth", "/nowhere"], "the recording has no topic /nowhere"),
        (&["--in-air", "0..10", "--zero-load-below", "0.1N"], ""),
        (&["--in-air", "10..0"], ""),
        (&["--zero-load-below", "0.1"], ""),
    ];
    for (told, expected) in cases {
        let refused = run(folder, "eval", "told", &[COMMANDS[0].1, told].concat());
        match expected {
            "" => assert_eq!(refused.code, 2, "{refused:?}"),
            _ => assert!(refused.failure().contains(expected), "{refused:?}"),
        }
    }
}

/// A simulated session as a stranger records it: other topics, taxels in a type without a stamp, no annotations, a force
/// sensor that was never tared.
fn write_strangers_bag(folder: &Path, seed: &str, path: &str) {
    let sessions = format!("simulated{seed}");
    let simulate = ["simulate", "--glove", "1", "--users", "1", "--sessions", "1", "--minutes", "1.7", "--seed", seed];
    tpf(folder, &[&simulate[..], &["-o", &sessions]].concat()).ok();
    let mut bag = Bag::create(&folder.join(path));
    let mut reader = BagReader::open(&[folder.join(sessions).join("glove1_user01_session1")]).unwrap();
    while let Some(message) = reader.next_message().unwrap() {
        let received = message.log_time;
        match message.channel.topic.as_str() {
            "/glove/taxels" => {
                let TaxelArray { values: data, .. } = from_cdr(message.data).unwrap();
                let layout = MultiArrayLayout { dim: Vec::new(), data_offset: 0 };
                bag.send("/fingertip/pressure", received, &Float32MultiArray { layout, data });
            }
            "/hand/joint_states" => {
                bag.send("/mocap/joint_states", received, &from_cdr::<JointState>(message.data).unwrap());
            }
            "/load_cell/wrench" => {
                let mut wrench: WrenchStamped = from_cdr(message.data).unwrap();
                wrench.wrench.force.z += 4.2;
                bag.send("/ft_sensor/wrench", received, &wrench);
            }
            _ => {}
        }
    }
    bag.finish();
}

#[test]
fn the_page_on_bags_with_a_load_cell_runs_as_it_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_strangers_bag(folder, "7", "recording.mcap");
    write_strangers_bag(folder, "8", "another.mcap");
    let page = include_str!("../../docs/src/how-to/load-cell.md");
    let block = page.split("```sh load-cell\n").nth(1).unwrap().split("```").next().unwrap();
    let lines: Vec<&str> = block.lines().map(|line| line.split("  #").next().unwrap().trim()).collect();
    assert!((4..=5).contains(&lines.len()), "{lines:?}");
    // So that it takes seconds.
    let few = ["--steps", "70", "--batch", "16", "--stride", "10", "--learning-rate", "0.004"];
    let mut said = Vec::new();
    for line in lines {
        let words: Vec<&str> = line.strip_prefix("tpf ").unwrap().split_whitespace().collect();
        let more = if words[0] == "train" { &few[..] } else { &[] };
        said.push(tpf(folder, &[&words[..], more].concat()).ok());
    }
    let made = fs::read_to_string(folder.join("glove.yaml")).unwrap();
    for topic in ["/fingertip/pressure", "/mocap/joint_states", "/ft_sensor/wrench"] {
        assert!(said[0].stdout.contains(topic) && made.contains(topic), "{made}");
    }
    let eval = said.last().unwrap();
    assert!(eval.stdout.contains("In the air: nothing touches"), "{eval:?}");
    let scored = tpf(
        folder,
        &["eval", "another.mcap", "--params-file", "glove.yaml", "--zero-load-below", "0.1N", "--whole", "--json"],
    );
    let scored = scored.ok().json();
    let score = &scored["models"].as_array().unwrap().last().unwrap()["by"]["all"][0];
    assert!(score["ba"].as_f64().is_some_and(|ba| ba > 0.6), "{score:#}");
}
