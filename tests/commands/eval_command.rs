//! `tpf eval`: models and recorded estimates against the true force, session by session.

use crate::common;

use std::fs;
use std::path::Path;

use common::ROOT;
use common::onnx::LinearModel;
use common::scored::{PARAMS, folder};
use common::tpf::tpf;
use serde_json::Value;

fn eval(folder: &Path, more: &[&str]) -> Value {
    tpf(folder, &[&["eval", "bags", "--params-file", "params.yaml", "--json"], more].concat()).ok().json()
}

fn named<'v>(found: &'v Value, name: &str) -> &'v Value {
    found["models"]
        .as_array()
        .unwrap()
        .iter()
        .find(|model| model["name"] == name)
        .unwrap_or_else(|| panic!("{found:#}"))
}

#[test]
fn every_group_is_scored_and_two_models_are_compared_by_user() {
    let folder = folder();
    let found = eval(folder.path(), &["--model", "model.onnx", "--compare", "other.onnx", "--whole"]);
    assert_eq!(found["synthetic"], true);
    assert_eq!(found["sessions"].as_array().unwrap().len(), 2);
    let model = named(&found, "model");
    let n = |group: &Value| group["coverage"]["n_scored"].as_u64().unwrap();
    let sum = |by: &str| model["by"][by].as_array().unwrap().iter().map(n).sum::<u64>();
    let all = n(&model["by"]["glove"][0]);
    assert!(all > 1000, "{all}");
    for by in ["user", "session", "stage", "substage"] {
        assert_eq!(sum(by), all, "{by}");
    }
    let free: u64 = model["free_movement"]["substage"].as_array().unwrap().iter().map(n).sum();
    let substages = model["by"]["substage"].as_array().unwrap();
    let is_free = |group: &&Value| group["substage"].as_str().unwrap().contains("free_movement");
    assert_eq!(free, substages.iter().filter(is_free).map(n).sum::<u64>());
    assert!(free > 0 && free < all);
    let pairing = &found["paired"][0];
    assert_eq!((pairing["from"].as_str(), pairing["to"].as_str()), (Some("other"), Some("model")));
    let measures: Vec<&str> =
        pairing["tests"].as_array().unwrap().iter().map(|test| test["measure"].as_str().unwrap()).collect();
    assert_eq!(measures.len(), 5, "{measures:?}");
    assert_eq!(found["improvements"][0]["from"], "other");
    assert!(model["contacts"]["1"]["detection"]["n_true"].as_u64().unwrap() > 5, "{model:#}");

    let table = tpf(
        folder.path(),
        &["eval", "bags", "--params-file", "params.yaml", "--model", "model.onnx", "--by", "user,substage"],
    );
    let text = table.ok().stdout;
    for told in ["SYNTHETIC", "held-out test part of 2 sessions", "MDF gF", "Free movement", "By user", "By substage"] {
        assert!(text.contains(told), "{told}: {text}");
    }
}

#[test]
fn estimates_in_a_bag_score_as_the_model_that_made_them() {
    let folder = folder();
    let folder = folder.path();
    let bags = ["glove1_user01_session1", "glove1_user02_session1"];
    for bag in bags {
        let (input, output) = (format!("bags/{bag}"), format!("merged/{bag}"));
        fs::create_dir_all(folder.join("merged")).unwrap();
        tpf(folder, &["replay", &input, "--params-file", "params.yaml", "-o", &output, "--merge"]).ok();
    }
    let by_model = eval(folder, &["--model", "model.onnx", "--whole"]);
    let command = ["eval", "merged", "--params-file", "params.yaml", "--json", "--whole"];
    let recorded = tpf(folder, &command).ok();
    assert!(recorded.stderr.contains("scoring the estimates in the bags"), "{recorded:?}");
    let recorded = recorded.json();
    for by in ["glove", "session", "substage"] {
        let (a, b) = (&named(&by_model, "model")["by"][by], &named(&recorded, "recorded")["by"][by]);
        for (a, b) in a.as_array().unwrap().iter().zip(b.as_array().unwrap()) {
            assert_eq!(a["confusion"], b["confusion"], "{by}");
            let close = |key: &str| (a[key].as_f64(), b[key].as_f64());
            for key in ["ba", "f1", "mae_gf"] {
                if let (Some(a), Some(b)) = close(key) {
                    // Newtons in the bag, grams-force here: a few roundings of float64.
                    assert!((a - b).abs() <= 1e-9 * a.abs(), "{by} {key}: {a} {b}");
                }
            }
        }
    }
}

#[test]
fn the_held_out_part_is_a_fifth_of_each_stage_and_of_the_whole_where_asked() {
    let folder = folder();
    let n = |found: &Value| named(found, "model")["by"]["glove"][0]["coverage"]["n_scored"].as_u64().unwrap() as f64;
    let whole = eval(folder.path(), &["--model", "model.onnx", "--whole"]);
    let by_stage = eval(folder.path(), &["--model", "model.onnx"]);
    let by_session = eval(folder.path(), &["--model", "model.onnx", "--split", "session"]);
    // A window's length of each cut is lost to its guard.
    for (part, cuts) in [(&by_stage, 8.0), (&by_session, 2.0)] {
        let share = (n(part) + cuts * 63.0) / n(&whole);
        assert!((0.19..0.23).contains(&share), "{share}");
    }
    let stages = |found: &Value| named(found, "model")["by"]["stage"].as_array().unwrap().len();
    assert!(stages(&by_session) < stages(&by_stage));
}

#[test]
fn what_cannot_be_scored_is_said_in_one_line() {
    let folder = folder();
    let folder = folder.path();
    let refused = |more: &[&str]| {
        let command = ["eval", "bags", "--params-file", "params.yaml", "--model", "model.onnx"];
        tpf(folder, &[&command[..], more].concat()).failure().to_owned()
    };
    assert!(refused(&["--truth", "/nowhere"]).contains("/nowhere"));
    assert!(refused(&["-p", "stage_topic:=/nowhere"]).contains("no stage annotations on /nowhere"));
    assert!(refused(&["-p", "truth.load_cell.field:=wrench.force"]).contains("wrench.force"));
}

const WITHOUT_TRUTH: [&str; 2] =
    ["    truth_sources: [load_cell]\n", "    truth.load_cell: {topic: /load_cell/wrench}\n"];

#[test]
fn without_a_true_force_there_are_still_touches_in_the_air_and_timing() {
    let folder = folder();
    let folder = folder.path();
    let scored = eval(folder, &["--model", "model.onnx", "--whole"]);
    let without = WITHOUT_TRUTH.iter().fold(PARAMS.to_owned(), |text, line| text.replace(line, ""));
    fs::write(folder.join("params.yaml"), without).unwrap();
    let found = eval(folder, &["--model", "model.onnx", "--whole"]);
    let part = |found: &Value| {
        let in_air = named(found, "model")["contacts"]["1"]["in_air"].clone();
        (in_air, found["sessions"][0]["timing"]["index"].clone())
    };
    assert_eq!(part(&scored), part(&found), "neither needs a true force");
    let (in_air, timing) = part(&found);
    assert!(in_air["minutes"].as_f64().unwrap() > 0.3 && in_air["n_false_touches"].as_u64().unwrap() > 0, "{in_air:#}");
    assert!(in_air["by_pose"].as_object().unwrap().len() > 10, "{in_air:#}");
    assert!((timing["rate_hz"].as_f64().unwrap() - 100.0).abs() < 1.0, "{timing:#}");
    assert_eq!(found["table"]["gloves"].as_array().unwrap().len(), 0);
    let lack = "no region has a true force, so there are no scores; set truth_sources";
    assert!(found["sessions"][1]["missing"][0].as_str().unwrap().starts_with(lack), "{found:#}");
    let text = tpf(folder, &["eval", "bags", "--params-file", "params.yaml", "--model", "model.onnx"]).ok().stdout;
    assert!(text.contains(lack) && text.contains("(all 2 sessions)"), "{text}");
    assert!(text.contains("In the air") && text.contains("Timing") && !text.contains("MDF"), "{text}");

    // A force sensor that the parameters have and a bag lacks is no failure; one that was asked for by name is.
    fs::write(folder.join("params.yaml"), PARAMS.replace("/load_cell/wrench", "/absent")).unwrap();
    let found = eval(folder, &["--model", "model.onnx"]);
    let lack = "no true force, so no scores: the bag has no topic /absent";
    assert_eq!(found["sessions"][0]["missing"][0], lack);
    let asked = eval(folder, &["--model", "model.onnx", "--truth", "/load_cell/wrench"]);
    assert!(named(&asked, "model")["by"]["glove"][0]["ba"].as_f64().is_some());
    let no_stage = eval(folder, &["--model", "model.onnx", "-p", "stage_topic:=/nowhere"]);
    let missing = &no_stage["sessions"][0]["missing"];
    assert!(missing[1].as_str().unwrap().contains("no stage annotations on /nowhere"), "{missing}");
    assert!(no_stage["sessions"][0]["timing"]["index"]["n_frames"].as_u64().unwrap() > 5000);
}

#[test]
fn estimates_without_their_inputs_are_told_as_such() {
    let folder = folder();
    let folder = folder.path();
    let bag = fs::read_dir(folder.join("bags")).unwrap().next().unwrap().unwrap().path();
    let replay = |bag: &str, output: &str| {
        tpf(folder, &["replay", bag, "-o", output, "--params-file", "params.yaml", "--model", "model.onnx"])
    };
    replay(bag.to_str().unwrap(), "estimates.mcap").ok();
    let text = tpf(folder, &["eval", "estimates.mcap", "--params-file", "params.yaml"]).ok().stdout;
    assert!(text.contains("the bag holds estimates without their inputs; score the bag that was replayed"), "{text}");
    assert!(!text.contains("/load_cell/wrench") && !text.contains("--in-air"), "{text}");
    let again = replay("estimates.mcap", "again.mcap");
    assert!(again.failure().contains("estimates without their inputs: take the bag that was replayed"), "{again:?}");
}

#[test]
fn a_bag_that_fails_is_named_and_the_others_are_scored_the_same_by_any_number_of_workers() {
    let folder = folder();
    let path = folder.path();
    let whole = eval(path, &["--model", "model.onnx", "--jobs", "1"]);
    let mut side_by_side = eval(path, &["--model", "model.onnx", "--jobs", "4"]);
    side_by_side["command"] = whole["command"].clone();
    assert_eq!(whole, side_by_side);
    fs::create_dir(path.join("bags/glove1_user00_broken")).unwrap();
    fs::write(path.join("bags/glove1_user00_broken/broken.mcap"), b"no bag at all, by far").unwrap();
    let command = ["eval", "bags", "--params-file", "params.yaml", "--json", "--model", "model.onnx"];
    let found = tpf(path, &command);
    assert_eq!(found.code, 3, "{found:?}");
    assert!(found.stderr.contains("not scored: ") && found.stderr.contains("broken.mcap"), "{found:?}");
    let found: Value = serde_json::from_str(&found.stdout).unwrap();
    assert_eq!(found["models"], whole["models"]);
    assert!(found["failed"][0]["bag"].as_str().unwrap().contains("glove1_user00_broken"));
    let none = tpf(path, &[&command[..], &["--truth", "/nowhere"]].concat());
    assert_eq!(none.code, 1);
    let one_line = none.failure();
    assert!(one_line.contains("none of 3 bags could be scored") && one_line.contains("broken"), "{one_line}");
}

#[test]
fn gates_pass_on_what_they_were_stored_for_and_fail_on_a_worse_model() {
    let folder = folder();
    let path = folder.path();
    fs::copy(Path::new(ROOT).join("params/gates.yaml"), path.join("default.yaml")).unwrap();
    let gates = "reference: stored.json
gates:
- {metric: mae_gf, by: user, worse_by_share: 0.01}
- {metric: ba, by: all, free_movement: true, worse_by: 0.001}
- {metric: onset_ms_p95, at_most: 10000.0}
- {metric: mdf_gf, by: substage, at_most: 1.0e+6, skip_undefined: true}
";
    fs::write(path.join("gates.yaml"), gates).unwrap();
    let command = ["eval", "bags", "--params-file", "params.yaml", "--gate", "gates.yaml", "--model"];
    let run = |more: &[&str]| tpf(path, &[&command[..], more].concat());

    let unknown = run(&["model.onnx"]);
    assert_eq!(unknown.code, 1);
    assert!(
        unknown.stderr.contains("stored.json") && unknown.stderr.contains("--update-refs writes it"),
        "{unknown:?}"
    );
    let stored = run(&["model.onnx", "--update-refs"]).ok();
    assert!(stored.stderr.contains("now holds 3 reference values"), "{stored:?}");
    let reference = fs::read_to_string(path.join("stored.json")).unwrap();
    let again = run(&["model.onnx", "--junit", "junit.xml", "--jsonl", "checks.jsonl"]).ok();
    assert!(again.stdout.contains("0 failed"), "{again:?}");

    LinearModel::new(64, 6, 4).gains(5.0, 50.0).metadata("unit", "gF").write(path, "worse.onnx");
    let worse = run(&["worse.onnx", "--junit", "worse.xml", "--jsonl", "worse.jsonl"]);
    assert_eq!(worse.code, 1, "{worse:?}");
    assert!(worse.stdout.contains("FAILED  mae_gf: 1 / 1: "), "{worse:?}");
    assert_eq!(fs::read_to_string(path.join("stored.json")).unwrap(), reference, "a failed gate stores nothing");
    let (passed, failed) = (checks(path, "checks.jsonl"), checks(path, "worse.jsonl"));
    let names = |checks: &[Value]| checks.iter().map(|check| check["name"].to_string()).collect::<Vec<_>>();
    assert_eq!(names(&passed), names(&failed));
    let verdicts = |checks: &[Value], verdict| checks.iter().filter(|check| check["verdict"] == verdict).count();
    assert_eq!(verdicts(&passed, "failed"), 0);
    assert!(verdicts(&passed, "skipped") > 0 && verdicts(&failed, "failed") >= 2);
    let junit = fs::read_to_string(path.join("worse.xml")).unwrap();
    assert!(junit.contains("<failure") && junit.contains("<skipped"), "{junit}");
    run(&["worse.onnx", "--update-refs"]).ok();
    run(&["worse.onnx"]).ok();
    tpf(
        path,
        &[
            "eval",
            "bags",
            "--params-file",
            "params.yaml",
            "--model",
            "model.onnx",
            "--gate",
            "default.yaml",
            "--update-refs",
        ],
    );
    assert!(path.join("gates.reference.json").exists(), "the default gates can be read");
}

#[test]
fn the_shipped_model_passes_the_default_gates_and_that_of_another_glove_fails_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let source = Path::new(ROOT);
    let simulate = ["simulate", "--glove", "1", "--users", "1", "--sessions", "1", "--minutes=2", "--seed", "9"];
    tpf(path, &[&simulate[..], &["-o", "bags"]].concat()).ok();
    fs::copy(source.join("params/gates.yaml"), path.join("gates.yaml")).unwrap();
    let in_source = |file: &str| source.join(file).display().to_string();
    let (params, shipped, wrong) = (
        in_source("params/glove1.yaml"),
        in_source("models/glove1_pose_aware.onnx"),
        in_source("models/glove2_pose_aware.onnx"),
    );
    let command = ["eval", "bags", "--params-file", &params, "--whole", "--gate", "gates.yaml", "--model"];
    tpf(path, &[&command[..], &[&shipped, "--update-refs"]].concat()).ok();
    let passed = tpf(path, &[&command[..], &[&shipped]].concat()).ok();
    assert!(passed.stdout.contains("12 passed, 0 failed, 0 skipped"), "{passed:?}");
    let refused = tpf(path, &[&command[..], &[&wrong]].concat());
    assert!(refused.failure().contains("was trained on glove \"synthetic-2\""), "{refused:?}");
    let failed = tpf(path, &[&command[..], &[&wrong, "-p", "model.fingertip.glove:=synthetic-2"]].concat());
    assert_eq!(failed.code, 1, "{failed:?}");
    assert!(failed.stdout.contains("FAILED  ba: 1: ") && failed.stdout.contains("FAILED  mdf_gf: 1: "), "{failed:?}");
}

fn checks(folder: &Path, file: &str) -> Vec<Value> {
    let text = fs::read_to_string(folder.join(file)).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn gates_that_can_not_be_meant_are_refused_before_anything_is_scored() {
    let folder = folder();
    let path = folder.path();
    for (gates, reason) in [
        ("gates: [{metric: speed, at_most: 1.0}]", "speed"),
        ("gates: [{metric: ba}]", "gate 1 (ba): expected at_least, at_most, worse_by or worse_by_share"),
        ("gates: [{metric: ba, at_lest: 1.0}]", "at_lest"),
    ] {
        fs::write(path.join("gates.yaml"), gates).unwrap();
        let refused = tpf(path, &["eval", "nowhere", "--params-file", "params.yaml", "--gate", "gates.yaml"]);
        assert_eq!(refused.code, 1);
        assert!(refused.stderr.starts_with("tpf: gates.yaml: ") && refused.stderr.contains(reason), "{refused:?}");
        assert_eq!(refused.stderr.trim().lines().count(), 1, "{refused:?}");
    }
    let alone = tpf(path, &["eval", "bags", "--params-file", "params.yaml", "--junit", "a.xml"]);
    assert!(alone.stderr.contains("give --gate"), "{alone:?}");
}

#[test]
fn worse_joint_angles_are_scored_beside_those_recorded() {
    let folder = folder();
    let worse = ["--pose-noise-deg", "0,40", "--pose-dropout", "1.0", "--pose-delay-ms", "300", "--pose-rate-hz", "20"];
    let found = eval(folder.path(), &[&["--model", "model.onnx", "--compare", "other.onnx"], &worse[..]].concat());
    let names: Vec<&str> = found["models"].as_array().unwrap().iter().map(|m| m["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["other", "model, base", "model"], "the table holds what was recorded alone");
    let mae = |scores: &Value| scores["mae_gf"].as_f64().unwrap();
    let judged = mae(&named(&found, "model")["by"]["glove"][0]);
    let levels = found["pose_quality"].as_array().unwrap();
    assert_eq!(levels.len(), 5);
    assert_eq!(mae(&levels[0]["scores"][0]), judged, "no noise changes nothing");
    assert!((mae(&levels[1]["scores"][0]) - judged).abs() > 0.01, "{levels:?}");
    assert_ne!(mae(&levels[2]["scores"][0]), judged);
    assert_eq!(levels[3]["dropout"], 1.0);
    assert!(levels[4]["rate_hz"] == 20.0 && mae(&levels[4]["scores"][0]) != judged, "{levels:?}");
    let base = mae(&named(&found, "model, base")["by"]["glove"][0]);
    assert_eq!(mae(&levels[3]["scores"][0]), base, "without any pose the base is left");
    let command = ["eval", "bags", "--params-file", "params.yaml", "--pose-noise-deg", "5", "--model"];
    let text = tpf(folder.path(), &[&command[..], &["model.onnx"]].concat()).ok().stdout;
    assert!(text.contains("Pose made worse, model") && text.contains("noise 5 deg"), "{text}");
    let refused = tpf(folder.path(), &[&command[..], &["other.onnx"]].concat());
    assert!(refused.code == 1 && refused.stderr.contains("a model that takes pose"), "{refused:?}");
}
