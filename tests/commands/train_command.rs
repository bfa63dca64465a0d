//! `tpf train`: from annotated bags to a model, a report, and one clear line where that can't be.

use crate::common;

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use common::bags::{Bag, at};
use common::tpf::{Run, tpf};
use serde_json::Value;
use tactile_pose_fusion::msg::{Header, Stage, Vector3, Wrench, WrenchStamped};

const TRAIN: [&str; 10] =
    ["train", "bags", "--params-file", "params.yaml", "-o", "model.onnx", "--batch", "16", "--stride", "20"];

/// Parameters of a hand with one fingertip, two taxels and two joints.
fn write_params(folder: &Path, region: &str, truth: &str) {
    let text = format!(
        "/**:
  ros__parameters:
    regions: [tip]
    tactile_sources: [glove]
    joint_sources: [hand]
    tactile.glove: {{topic: /taxels, n_taxels: 2}}
    joint.hand: {{topic: /joints}}
    model.tip: {{path: model.onnx}}
    region.tip: {{model: tip, frame_id: tip{region}}}
{truth}"
    );
    fs::write(folder.join("params.yaml"), text).unwrap();
}

const JOINTS: &str = ", joints: [dip, pip]";
const TRUTH: &str = "    truth_sources: [cell]\n    truth.cell: {topic: /cell, unit: gF}\n";

/// What a bag is like that is written for a test.
#[derive(Clone, Copy)]
struct Session {
    seconds: i64,
    annotated: bool,
    joints: bool,
    truth: bool,
    touched: bool,
    nan_truth: bool,
}

const SESSION: Session =
    Session { seconds: 40, annotated: true, joints: true, truth: true, touched: true, nan_truth: false };

/// A hand that bends all the time and presses every other second; bending moves the taxels too.
fn write_session(path: &Path, like: Session) {
    let mut bag = Bag::create(path);
    for frame in 0..like.seconds * 100 {
        let now = at(frame * 10);
        let pressed = like.touched && (frame / 100) % 2 == 1;
        if like.annotated && frame % 100 == 0 {
            bag.send("/stage", now, &stage(now, if frame < like.seconds * 50 { 1 } else { 2 }, !pressed));
        }
        let bend = 0.5 + 0.5 * (frame as f64 * 0.021).sin();
        let force = if pressed { 60.0 + 30.0 * (frame as f64 * 0.1).sin() } else { 0.0 };
        bag.taxels(now, &[500.0 + (force + 20.0 * bend) as f32, 300.0 + (0.5 * force - 5.0 * bend) as f32]);
        if like.joints {
            bag.joints(now, &["pip", "dip"], &[bend, 0.7 * bend]);
        }
        if like.truth {
            let reading = if like.nan_truth && frame == 150 { f64::NAN } else { force + 7.0 };
            let force = Vector3 { x: 0.0, y: 0.0, z: reading };
            let torque = Vector3 { x: 0.0, y: 0.0, z: 0.0 };
            let header = Header { stamp: now.into(), frame_id: "cell".into() };
            bag.send("/cell", now, &WrenchStamped { header, wrench: Wrench { force, torque } });
        }
    }
    bag.finish();
}

fn stage(at: tactile_pose_fusion::units::Stamp, stage: u8, zero_load: bool) -> Stage {
    let header = Header { stamp: at.into(), frame_id: String::new() };
    let substage = if zero_load { "free_movement" } else { "taps" };
    Stage { header, stage, substage: substage.into(), pose: String::new(), repetition: 0, zero_load }
}

fn folder_with(sessions: &[Session]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("bags")).unwrap();
    for (idx, session) in sessions.iter().enumerate() {
        let bag = folder.path().join(format!("bags/session{idx}"));
        write_session(&bag, *session);
    }
    write_params(folder.path(), JOINTS, TRUTH);
    folder
}

fn train(folder: &Path, more: &[&str]) -> Run {
    tpf(folder, &[&TRAIN[..], more].concat())
}

fn report(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("model.report.json")).unwrap()).unwrap()
}

#[test]
fn a_model_is_trained_reported_and_scored_alike_by_eval() {
    let folder = folder_with(&[SESSION, SESSION]);
    let folder = folder.path();
    let run = train(folder, &["--steps", "80", "--learning-rate", "0.005", "--seed", "3"]).ok();
    assert!(run.stdout.contains("held-out test") && run.stdout.contains("model.report.json"), "{run:?}");
    assert!(run.stderr.contains("step     80"), "{run:?}");
    let report = report(folder);
    assert_eq!(report["kind"], "pose-aware");
    assert_eq!(report["split"]["by"], "stage");
    assert_eq!(report["sessions"].as_array().unwrap().len(), 2);
    assert_eq!(report["runs"][0]["settings"]["seed"], 3);
    assert_eq!(report["runs"][0]["curve"].as_array().unwrap().last().unwrap()["step"], 80);
    assert!(report["data_fingerprint"].as_str().unwrap().len() == 64 && report["command"][1] == "train");
    let inspected = tpf(folder, &["inspect", "model.onnx"]).ok().stdout;
    for told in ["dip", "pip", "64", "2 sessions, data"] {
        assert!(inspected.contains(told), "{told}: {inspected}");
    }
    assert!(!folder.join("model.checkpoint.json").exists());

    // The trainer's own test windows are those of eval: every tenth of them is enough for the same picture.
    let eval = ["eval", "bags", "--params-file", "params.yaml", "--model", "model.onnx", "--json"];
    let scored = tpf(folder, &eval).ok().json();
    let models = scored["models"].as_array().unwrap();
    assert_eq!(
        models.iter().map(|model| model["name"].as_str().unwrap()).collect::<Vec<_>>(),
        ["model, base", "model"]
    );
    let (trained, evaluated) = (&report["test"]["final"], &models[1]["by"]["glove"][0]);
    let sessions = models[1]["by"]["session"].as_array().unwrap().iter();
    let n: u64 = sessions.map(|session| session["coverage"]["n_scored"].as_u64().unwrap().div_ceil(10)).sum();
    assert_eq!(report["test"]["windows"], n, "{scored:#}");
    let mae = |score: &Value| score["mae_gf"].as_f64().unwrap();
    assert!((mae(trained) / mae(evaluated) - 1.0).abs() < 0.2, "{} {}", mae(trained), mae(evaluated));
    assert!(mae(trained) < 30.0, "of presses of 60 gF: {}", mae(trained));

    let again = train(folder, &["--steps", "5"]).failure().to_owned();
    assert!(again.contains("model.onnx: is already there"), "{again}");
}

#[test]
fn a_model_without_each_donning_is_scored_on_what_it_never_saw() {
    let short = Session { seconds: 20, ..SESSION };
    let folder = folder_with(&[short, short, Session { seconds: 15, ..SESSION }]);
    let folder = folder.path();
    // The paper's network takes twice the time in training and scoring, and folds are the same for all kinds.
    let held_out = ["--kind", "tactile-only", "--hold-out", "donnings"];
    let run = train(folder, &[&held_out[..], &["--steps", "6", "--learning-rate", "0.005"]].concat()).ok();
    assert!(run.stdout.contains("each donning by the model that was trained without it"), "{run:?}");
    assert!(run.stdout.contains("MAE  ") && run.stdout.contains('\u{b1}'), "{run:?}");
    for session in ["session0", "session1", "session2"] {
        let told = tpf(folder, &["inspect", &format!("model.without-{session}.onnx")]).ok().stdout;
        assert!(told.contains(&format!("held_out: [\"{session}\"]")), "{told}");
    }
    let eval = |bags: &str, more: &[&str]| {
        let eval = ["eval", bags, "--params-file", "params.yaml", "--model", "model.onnx", "--held-out", "--json"];
        tpf(folder, &[&eval[..], more].concat())
    };
    let found = eval("bags", &[]).ok().json();
    let model = found["models"].as_array().unwrap().last().unwrap().clone();
    assert_eq!(model["name"], "model, held out");
    assert_eq!((model["path"].as_str(), model.get("sha256")), (Some("model.without-*.onnx"), None));
    assert_eq!(found["scored"], "every frame");
    // One by one, each by its own fold.
    for (idx, session) in ["session0", "session1", "session2"].into_iter().enumerate() {
        let fold = format!("model.without-{session}.onnx");
        let bag = format!("bags/{session}");
        let alone = ["eval", &bag, "--params-file", "params.yaml", "--whole", "--json", "--model", &fold];
        let alone = tpf(folder, &alone).ok().json();
        let alone = alone["models"].as_array().unwrap().last().unwrap().clone();
        assert_eq!(alone["by"]["session"][0]["mae_gf"], model["by"]["session"][idx]["mae_gf"]);
    }
    let compared = eval("bags", &["--compare", "model.onnx"]).ok().json();
    assert_eq!(compared["models"][0]["name"], "model, held out");

    let again = train(folder, &["--steps", "5", "--hold-out", "donnings"]).failure().to_owned();
    assert!(again.contains("model.onnx: is already there"), "{again}");
    fs::remove_file(folder.join("model.onnx")).unwrap();
    fs::remove_file(folder.join("model.report.json")).unwrap();
    let again = train(folder, &["--steps", "5", "--hold-out", "donnings"]).failure().to_owned();
    assert!(again.contains("model.without-session0.onnx: is already there"), "{again}");
    let no_users = train(folder, &["--steps", "5", "--hold-out", "users", "--overwrite"]).failure().to_owned();
    assert!(no_users.contains("does not say who wore the glove"), "{no_users}");
    fs::rename(folder.join("bags/session2"), folder.join("bags/other")).unwrap();
    let refused = eval("bags", &[]);
    assert!(refused.failure().contains("other: no model model.without-*.onnx was trained without it"), "{refused:?}");
    for fold in ["session0", "session1", "session2"] {
        fs::remove_file(folder.join(format!("model.without-{fold}.onnx"))).unwrap();
    }
    let refused = eval("bags", &[]);
    assert!(refused.failure().contains("model.without-*.onnx: there is no such model"), "{refused:?}");
}

#[test]
fn the_same_seed_gives_the_same_model_and_kinds_and_ablations_are_told_apart() {
    let folder = folder_with(&[Session { seconds: 20, ..SESSION }]);
    let folder = folder.path();
    let trained = |more: &[&str]| {
        train(folder, &[&["--steps", "2", "--overwrite"], more].concat()).ok();
        fs::read(folder.join("model.onnx")).unwrap()
    };
    let first = trained(&[]);
    assert!(trained(&["--threads", "1"]) == first);
    let others: [&[&str]; 7] = [
        &["--seed", "1"],
        &["--kind", "tactile-only"],
        &["--kind", "early-fusion"],
        &["--no-base-loss"],
        &["--base-weight", "0.5"],
        &["--no-auxiliary-loss"],
        &["--split", "session"],
    ];
    for other in others {
        assert!(trained(other) != first, "{other:?}");
    }
    assert_ne!(trained(&["--plain-graph"]).len(), first.len());
    trained(&["--sweep-lambda", "0.1,10"]);
    let report = report(folder);
    let lambdas: Vec<f64> =
        report["runs"].as_array().unwrap().iter().map(|run| run["lambda"].as_f64().unwrap()).collect();
    assert_eq!(lambdas.len(), 2);
    let loss = |idx: usize| report["runs"][idx]["best_validation"]["loss"].as_f64().unwrap();
    let chosen = report["chosen"].as_u64().unwrap() as usize;
    assert!(loss(chosen) <= loss(1 - chosen), "{report:#}");
}

#[test]
fn recordings_that_cannot_be_trained_on_are_refused_before_training() {
    let cases: [(Session, &str, &str, &[&str], &str); 9] = [
        (SESSION, JOINTS, "", &[], "region tip: no force sensor tells its true force"),
        (Session { truth: false, ..SESSION }, JOINTS, TRUTH, &[], "topic /cell"),
        (SESSION, JOINTS, TRUTH, &["--truth", "/elsewhere"], "topic /elsewhere"),
        (Session { annotated: false, ..SESSION }, JOINTS, TRUTH, &[], "no stage annotations on /stage"),
        (Session { joints: false, ..SESSION }, JOINTS, TRUTH, &[], "topic /joints"),
        (SESSION, "", TRUTH, &[], "region.tip.joints is empty and --kind pose-aware needs joint angles"),
        (SESSION, ", joints: [dip, wrist]", TRUTH, &[], "wrist"),
        (Session { touched: false, ..SESSION }, JOINTS, TRUTH, &[], "every training window is without touch at 2.5 gF"),
        (Session { nan_truth: true, ..SESSION }, JOINTS, TRUTH, &[], "truth_gf at frame 150 is NaN"),
    ];
    for (session, region, truth, more, expected) in cases {
        let folder = folder_with(&[session]);
        write_params(folder.path(), region, truth);
        let run = train(folder.path(), &[&["--steps", "2"], more].concat());
        let said = run.failure();
        assert!(said.contains(expected), "{expected:?}: {said}");
        assert!(!folder.path().join("model.onnx").exists());
    }
    let folder = folder_with(&[]);
    assert!(
        train(folder.path(), &[]).failure().contains("the folder holds no .mcap or .db3 file and no metadata.yaml")
    );
}

#[test]
fn without_joints_the_tactile_only_model_is_trained() {
    let folder = folder_with(&[Session { joints: false, ..SESSION }]);
    write_params(folder.path(), "", TRUTH);
    train(folder.path(), &["--kind", "tactile-only", "--steps", "2"]).ok();
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_goes_on_to_the_model_of_an_uninterrupted_one() {
    let folder = folder_with(&[SESSION]);
    let folder = folder.path();
    let steps = ["--steps", "50"];
    train(folder, &steps).ok();
    let whole = fs::read(folder.join("model.onnx")).unwrap();
    fs::remove_file(folder.join("model.onnx")).unwrap();
    fs::remove_file(folder.join("model.report.json")).unwrap();

    let mut running = Command::new(env!("CARGO_BIN_EXE_tpf"))
        .current_dir(folder)
        .args([&TRAIN[..], &steps].concat())
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(running.stderr.take().unwrap()).lines();
    // The data are read and training begins right behind this line.
    assert!(said.by_ref().any(|line| line.unwrap().contains("windows to train on")));
    Command::new("kill").args(["-INT", &running.id().to_string()]).status().unwrap();
    let rest: Vec<String> = said.map(Result::unwrap).collect();
    assert_eq!(running.wait().unwrap().code(), Some(1), "{rest:?}");
    assert!(rest.last().unwrap().contains("--resume"), "{rest:?}");
    assert!(folder.join("model.checkpoint.json").exists() && !folder.join("model.onnx").exists());

    let other = train(folder, &["--steps", "51", "--resume"]).failure().to_owned();
    assert!(other.contains("made with other settings"), "{other}");
    let resumed = train(folder, &["--steps", "50", "--resume"]).ok();
    assert!(resumed.stderr.contains("going on from step"), "{resumed:?}");
    assert!(fs::read(folder.join("model.onnx")).unwrap() == whole);
    assert!(!folder.join("model.checkpoint.json").exists());
}

#[test]
fn a_checkpoint_of_an_interrupted_run_is_kept_until_its_fate_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_params(path, JOINTS, TRUTH);
    fs::create_dir(path.join("bags")).unwrap();
    write_session(&path.join("bags/a.mcap"), SESSION);
    let checkpoint = path.join("model.checkpoint.json");
    fs::write(&checkpoint, "hours of work").unwrap();
    let refused = tpf(path, &TRAIN);
    let line = refused.failure();
    assert!(
        line.contains("model.checkpoint.json") && line.contains("give --resume to go on from there, or --overwrite"),
        "{line}"
    );
    assert_eq!(fs::read_to_string(&checkpoint).unwrap(), "hours of work");
    fs::remove_file(&checkpoint).unwrap();
    let train = &TRAIN[..6];
    let huge = tpf(path, &[train, &["--batch", "99999999"]].concat());
    assert!(huge.code == 1 && huge.stderr.contains("at most 4096 windows"), "{huge:?}");
    let negative = tpf(path, &[train, &["--lambda", "-1"]].concat());
    assert!(
        negative.code == 1 && negative.stderr.contains("lambda") && !negative.stderr.contains("-- -1"),
        "{negative:?}"
    );
}
