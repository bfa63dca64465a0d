//! A model that tells what pose makes of the taxels, from training to the contacts of a replay, through the command line.
//! SYNTHETIC data.

use crate::common;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use common::ROOT;
use common::bags::{decoded, messages};
use common::tpf::{Run, tpf};
use tactile_pose_fusion::calibration::Calibration;
use tactile_pose_fusion::msg::{ContactArray, ContactState};

const PARAMS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../params/glove3.yaml");
const CONTACTS: &str = "/tactile_pose_fusion/contacts";

/// A folder with three sessions of two users, and a model trained on the first two. Made once for all tests of this program.
fn trained() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    FOLDER
        .get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path();
            let simulate =
                ["simulate", "--glove", "3", "--users", "3", "--sessions", "1", "--minutes", "5", "--seed", "5"];
            tpf(path, &[&simulate[..], &["-o", "bags"]].concat()).ok();
            let bags = [bag(path, 1), bag(path, 2)].map(|bag| bag.to_str().unwrap().to_owned());
            let train =
                ["train", &bags[0], &bags[1], "--params-file", PARAMS, "--kind", "adaptive", "-o", "model.onnx"];
            let settings = ["--steps", "400", "--batch", "16", "--seed", "1", "--held-touches", "0"];
            let run = tpf(path, &[&train[..], &settings].concat()).ok();
            assert!(run.stderr.contains("touch 0."), "{run:?}");
            folder
        })
        .path()
}

/// Another session of that third user, as short as can be.
fn short_session() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    FOLDER
        .get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let simulate =
                ["simulate", "--glove", "3", "--users", "3", "--sessions", "1", "--minutes=1.7", "--seed", "5"];
            tpf(folder.path(), &[&simulate[..], &["-o", "bags"]].concat()).ok();
            folder
        })
        .path()
}

fn bag(folder: &Path, user: usize) -> PathBuf {
    folder.join(format!("bags/glove3_user0{user}_session1"))
}

/// Replays the session of the third user, who no model knows, into a new folder.
fn replay(more: &[&str]) -> (tempfile::TempDir, Run) {
    replay_of(trained(), more)
}

/// The same for one of that user's sessions.
fn replay_of(bags: &Path, more: &[&str]) -> (tempfile::TempDir, Run) {
    let out = tempfile::tempdir().unwrap();
    let (bag, model) = (bag(bags, 3), trained().join("model.onnx"));
    let replay = ["replay", bag.to_str().unwrap(), "--params-file", PARAMS, "--model", model.to_str().unwrap()];
    let run = tpf(out.path(), &[&replay[..], &["-o", "out.mcap"], more].concat());
    (out, run)
}

fn states(folder: &Path) -> Vec<ContactState> {
    let arrays = decoded::<ContactArray>(&folder.join("out.mcap"), CONTACTS);
    arrays.into_iter().flat_map(|array| array.contacts).collect()
}

fn share(states: &[ContactState], adaptation: u8) -> f64 {
    states.iter().filter(|state| state.adaptation == adaptation).count() as f64 / states.len() as f64
}

#[test]
fn an_adaptive_model_finds_touch_on_a_user_it_does_not_know_and_best_when_it_follows() {
    let folder = trained();
    let balanced_accuracy = |more: &[&str]| {
        let bag = bag(folder, 3);
        let eval =
            ["eval", bag.to_str().unwrap(), "--params-file", PARAMS, "--model", "model.onnx", "--whole", "--json"];
        find(&tpf(folder, &[&eval[..], more].concat()).ok().json(), "ba").unwrap()
    };
    // By the force: the level of the probability of touch is that of two users' validation parts, and a careful one hides what
    // is left in the taxels.
    let by_force = |more: &[&str]| balanced_accuracy(&[&["--touch", "force"], more].concat());
    let (followed, left) = (by_force(&[]), by_force(&["-p", "adaptation:=none"]));
    assert!(followed > 0.95 && 1.0 - followed < 0.6 * (1.0 - left), "{followed} followed, {left} where it is left");
}

#[test]
fn an_artifact_is_fitted_to_all_seconds_that_are_known_to_be_in_the_air() {
    let bag = bag(short_session(), 3);
    let folder = tempfile::tempdir().unwrap();
    // How uncertain gains are: the sum of the variances of the first joint's.
    let uncertain = |model: &Path, seconds: &str, more: &[&str]| -> f64 {
        let out = format!("{}{seconds}{}.yaml", model.file_stem().unwrap().to_str().unwrap(), more.len());
        let calibrate =
            ["calibrate", bag.to_str().unwrap(), "--params-file", PARAMS, "--model", model.to_str().unwrap()];
        let times = ["--calibrate-first", seconds, "-o", &out, "-p", "calibration.max_loaded_fraction:=1.0"];
        tpf(folder.path(), &[&calibrate[..], &times, more].concat()).ok();
        let made = Calibration::load(&folder.path().join(&out), "", "", &[]).unwrap();
        made.artifacts
            .values()
            .map(|fit| fit.covariance.chunks_exact(4 * 4).map(|of_taxel| of_taxel[0]).sum::<f64>())
            .sum()
    };
    // For the model that ships, gains don't change in a calibration, and more seconds tell more of them. For one of the present training they slip
    // meanwhile, and seconds with little movement tell less than is lost.
    let (shipped, learned) = (Path::new(ROOT).join("models/glove3_adaptive.onnx"), trained().join("model.onnx"));
    let [shipped_two, learned_two] =
        [&shipped, &learned].map(|model| ["10", "20"].map(|seconds| uncertain(model, seconds, &[])));
    assert!(0.0 < shipped_two[1] && shipped_two[1] < 0.9 * shipped_two[0], "{shipped_two:?}");
    assert!(0.0 < learned_two[1] && learned_two[1] != learned_two[0], "{learned_two:?}");
    assert_eq!(uncertain(&learned, "20", &["-p", "calibration.duration_s:=20.0"]), learned_two[1]);
}

#[test]
fn a_network_that_gets_trust_is_trained_on_copies_with_held_touches_and_finds_touch() {
    let folder = trained();
    let bags = [bag(folder, 1), bag(folder, 2)].map(|bag| bag.to_str().unwrap().to_owned());
    let out = tempfile::tempdir().unwrap();
    let out = out.path();
    let train = ["train", &bags[0], &bags[1], "--params-file", PARAMS, "--kind", "adaptive", "-o", "told.onnx"];
    let run = tpf(out, &[&train[..], &["--steps", "100", "--batch", "16", "--held-touches", "2"]].concat()).ok();
    assert!(run.stderr.contains("2 sessions (synthetic), and 4 copies with held light touches: "), "{run:?}");
    let report: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("told.report.json")).unwrap()).unwrap();
    assert_eq!((report["held_touches"].as_u64(), report["sessions"].as_array().unwrap().len()), (Some(2), 2));
    let told = tpf(out, &["inspect", "told.onnx"]).ok().stdout;
    assert!(told.contains("float32 [N, 64, 8]") && told.contains("gets how far they can be trusted"), "{told}");
    let eval = ["eval", bags[0].as_str(), "--params-file", PARAMS, "--model", "told.onnx", "--whole", "--json"];
    let found = |more: &[&str]| find(&tpf(out, &[&eval[..], more].concat()).ok().json(), "ba").unwrap();
    let (followed, frozen) = (found(&[]), found(&["-p", "adaptation:=frozen"]));
    assert!(followed > 0.93 && frozen > 0.7, "{followed} followed, {frozen} frozen");
    // The model says how far offsets drift, so that they are followed.
    let metadata = tpf(out, &["inspect", "told.onnx", "--json"]).ok().json()[0]["metadata"]["artifact"].clone();
    let artifact: serde_json::Value = serde_json::from_str(metadata.as_str().unwrap()).unwrap();
    assert_eq!(artifact["drift"].as_array().map(Vec::len), Some(6));
    // The same command gives the same bytes; only an adaptive model gets touches.
    let short = [1, 2, 3].map(|user| bag(short_session(), user).to_str().unwrap().to_owned());
    let [first, again] = ["first.onnx", "again.onnx"].map(|output| {
        let train = [&["train"], &short.each_ref().map(String::as_str)[..], &["--params-file", PARAMS]].concat();
        let kind = ["--kind", "adaptive", "-o", output];
        tpf(out, &[&train[..], &kind, &["--steps", "5", "--batch", "16", "--held-touches", "1"]].concat()).ok();
        std::fs::read(out.join(output)).unwrap()
    });
    assert!(first == again, "the models differ");
    for (kind, n, expected) in [
        ("pose-aware", "1", "--light-touches and --held-touches are for --kind adaptive"),
        ("adaptive", "65", "--held-touches is 65, expected 0 to 64 copies of each session"),
    ] {
        let refused =
            ["train", &bags[0], "--params-file", PARAMS, "--kind", kind, "--held-touches", n, "-o", "no.onnx"];
        let refused = tpf(out, &refused);
        assert!(refused.failure().contains(expected), "{refused:?}");
    }
}

#[test]
fn a_camera_as_hand_tracker_costs_the_shipped_model_false_touches_and_little_else() {
    let folder = tempfile::tempdir().unwrap();
    let simulate = ["simulate", "--glove", "3", "--users", "1", "--sessions", "1", "--minutes", "5", "--seed", "11"];
    tpf(folder.path(), &[&simulate[..], &["--tracking", "camera", "-o", "bags"]].concat()).ok();
    let model = |kind: &str| format!("{ROOT}/models/glove3_{kind}.onnx");
    let (tactile, adaptive) = (model("tactile_only"), model("adaptive"));
    let eval =
        ["eval", "bags", "--params-file", PARAMS, "--whole", "--compare", &tactile, "--model", &adaptive, "--json"];
    let json = tpf(folder.path(), &eval).ok().json();
    let of = |model: usize, name: &str| find(&json["table"]["rows"][model], name).unwrap();
    for (name, is_error) in [("ba", false), ("f1", false), ("force_gf", true), ("mae_gf", true)] {
        let (tactile, adaptive) = (of(0, name), of(1, name));
        let is_met = if is_error { adaptive <= 1.05 * tactile } else { adaptive >= 0.95 * tactile };
        assert!(is_met, "{name}: {adaptive} adaptive, {tactile} tactile-only");
    }
    // Here the aim is missed (docs/validation/2026-11-24-noisy-tracking.md). Before the noise of the angles was measured, it
    // was 30 and more a minute.
    let in_air = find(&json["models"][1], "per_minute").unwrap();
    assert!(in_air < 15.0, "{in_air} false touches a minute in the air");
}

/// The first number of that name.
fn find(value: &serde_json::Value, name: &str) -> Option<f64> {
    match value {
        serde_json::Value::Object(map) => map
            .get(name)
            .and_then(serde_json::Value::as_f64)
            .or_else(|| map.values().find_map(|value| find(value, name))),
        serde_json::Value::Array(values) => values.iter().find_map(|value| find(value, name)),
        _ => None,
    }
}

#[test]
fn contacts_say_what_became_of_the_artifact_and_replay_is_the_same_twice() {
    let (followed, run) = replay(&[]);
    run.ok();
    let on = states(followed.path());
    assert!(share(&on, ContactState::ADAPTATION_LEARNING) > 0.2, "{}", share(&on, ContactState::ADAPTATION_LEARNING));
    assert!(share(&on, ContactState::ADAPTATION_WAITING) > 0.05);
    assert!(on.last().unwrap().artifact_change > 0.01);
    let (again, run) = replay(&[]);
    run.ok();
    assert_eq!(messages(&followed.path().join("out.mcap")), messages(&again.path().join("out.mcap")));

    let (frozen, run) = replay(&["-p", "adaptation:=frozen"]);
    run.ok();
    let frozen = states(frozen.path());
    assert_eq!(share(&frozen, ContactState::ADAPTATION_FROZEN), 1.0);
    assert!(frozen.iter().all(|state| state.artifact_change == 0.0));
    let (off, run) = replay(&["-p", "adaptation:=none"]);
    run.ok();
    let off = states(off.path());
    assert_eq!(share(&off, ContactState::ADAPTATION_OFF), 1.0);
    assert!(off.iter().all(|state| state.artifact_change.is_nan()));
}

#[test]
fn a_calibration_file_keeps_the_artifact_and_is_refused_where_it_does_not_fit() {
    let folder = trained();
    let (bag, model, out) = (bag(folder, 3), folder.join("model.onnx"), tempfile::tempdir().unwrap());
    let calibrate = ["calibrate", bag.to_str().unwrap(), "--params-file", PARAMS, "--model", model.to_str().unwrap()];
    tpf(out.path(), &[&calibrate[..], &["-o", "calibration.yaml"]].concat()).ok();
    let file = out.path().join("calibration.yaml");
    let text = fs::read_to_string(&file).unwrap();
    assert!(text.contains("artifacts:") && text.contains("gains:"), "{text}");

    let with = |text: &str| {
        let path = out.path().join("other.yaml");
        fs::write(&path, text).unwrap();
        replay(&["--calibration", path.to_str().unwrap()])
    };
    let (kept, run) = with(&text);
    run.ok();
    assert!(share(&states(kept.path()), ContactState::ADAPTATION_LEARNING) > 0.2);
    let (without, run) = with(text.split("artifacts:").next().unwrap());
    let run = run.ok();
    assert!(run.stderr.contains("does not tell the artifact of region index"), "{run:?}");
    assert_eq!(share(&states(without.path()), ContactState::ADAPTATION_FROZEN), 1.0);
    let (_, run) = with(&text.replace("    offset:", "    offset:\n    - 1.0"));
    assert!(run.failure().contains("7 numbers in offset, expected 6; calibrate again"), "{run:?}");
}

#[test]
fn touches_of_a_known_force_fit_the_gain_of_a_donning_and_are_kept_with_its_calibration() {
    let folder = trained();
    let (bag, model, out) = (bag(folder, 3), folder.join("model.onnx"), tempfile::tempdir().unwrap());
    let calibrate_of = |bag: &Path, more: &[&str]| {
        let of = ["calibrate", bag.to_str().unwrap(), "--params-file", PARAMS, "--model", model.to_str().unwrap()];
        tpf(out.path(), &[&of[..], more].concat())
    };
    let calibrate = |more: &[&str]| calibrate_of(&bag, more);
    calibrate(&["-o", "plain.yaml"]).ok();
    let told = calibrate(&["-o", "known.yaml", "--touches"]).ok().stdout;
    assert!(told.contains("region index: forces times ") && told.contains(" known touches"), "{told}");
    let text = fs::read_to_string(out.path().join("known.yaml")).unwrap();
    let gain = text.split("gain: ").nth(1).and_then(|rest| rest.lines().next()).unwrap().parse::<f64>().unwrap();
    assert!(gain != 1.0 && (0.5..2.0).contains(&gain), "{gain}");
    let forces = |file: &str| {
        let (folder, run) = replay(&["--calibration", out.path().join(file).to_str().unwrap()]);
        run.ok();
        states(folder.path()).into_iter().map(|state| (state.force, state.touch)).collect::<Vec<_>>()
    };
    let (plain, known) = (forces("plain.yaml"), forces("known.yaml"));
    assert!(plain.iter().filter(|(force, _)| force.is_finite()).count() > 1000);
    for (before, after) in plain.iter().zip(&known) {
        assert!(before.0.is_nan() == after.0.is_nan() && (before.0.is_nan() || after.0 == gain * before.0));
        assert!(before.1.to_bits() == after.1.to_bits(), "the probability of touch is of no unit");
    }

    // The same force for a touch and for the air, twice: no gain fits both.
    let air = ["--touch", "2N@1-2", "--touch", "2N@3-4", "--touch", "0.01N@5-6"];
    let refused = calibrate(&[&["-o", "bad.yaml"], &air[..]].concat());
    let line = refused.failure();
    assert!(line.contains("region index: ") && !out.path().join("bad.yaml").exists(), "{refused:?}");
    let short = self::bag(short_session(), 3);
    let few = calibrate_of(&short, &["-o", "bad.yaml", "--touch", "2N@1-2"]);
    assert!(few.failure().contains("1 touches of a known force, at least 3 needed"), "{few:?}");
    let other = calibrate_of(&short, &["-o", "bad.yaml", "--touch", "thumb:2N@1-2"]);
    assert!(other.failure().contains("--touch names region thumb, the parameters have index"), "{other:?}");
    let late = calibrate_of(&short, &["-o", "bad.yaml", "--touch", "200gF@9000-9001"]);
    assert!(late.failure().contains("has fewer than ten estimates from 9000 to 9001 s"), "{late:?}");
    let text = text.replace("low: ", "low: 9");
    fs::write(out.path().join("edited.yaml"), text).unwrap();
    let edited = out.path().join("edited.yaml");
    let (_, run) = replay(&["--calibration", edited.to_str().unwrap()]);
    assert!(run.failure().contains("not a calibration file: force gain of region index: gain "), "{run:?}");
}

#[test]
fn contact_is_decided_on_the_probability_of_touch_as_model_and_parameters_say() {
    let folder = trained();
    let told = tpf(folder, &["inspect", "model.onnx"]).ok().stdout;
    assert!(told.contains("touch") && told.contains("given: contact from a probability of "), "{told}");
    let (by_model, run) = replay(&[]);
    run.ok();
    let by_model = states(by_model.path());
    let on = by_model[0].touch_on;
    assert!((0.01..=0.99).contains(&on) && by_model[0].touch_off < on);
    let estimates = by_model.iter().filter(|state| state.touch.is_finite());
    assert!(estimates.clone().count() > 1000);
    assert!(estimates.clone().all(|state| state.contact_raw == (state.touch >= on)));
    let (by_force, run) = replay(&["-p", "contact.by:=force"]);
    run.ok();
    let by_force = states(by_force.path());
    assert!(by_force.iter().all(|state| state.touch_on.is_nan()));
    assert!(
        by_force
            .iter()
            .filter(|state| state.force.is_finite())
            .all(|state| { state.contact_raw == (state.force >= state.on_threshold) })
    );
    assert!(by_force.iter().zip(&by_model).any(|(a, b)| a.contact_raw != b.contact_raw));

    let eval = |more: &[&str]| {
        let bag = bag(folder, 3);
        let eval =
            ["eval", bag.to_str().unwrap(), "--params-file", PARAMS, "--model", "model.onnx", "--whole", "--json"];
        tpf(folder, &[&eval[..], more].concat())
    };
    let found = |more: &[&str]| {
        let json = eval(more).ok().json();
        (json["models"][0]["touch_by"].as_str().unwrap().to_owned(), find(&json, "ba").unwrap())
    };
    let (as_the_node, force, low) = (found(&[]), found(&["--touch", "force"]), found(&["--touch", "0.02"]));
    assert_eq!((as_the_node.0.as_str(), force.0.as_str(), low.0.as_str()), ("touch output", "force", "touch output"));
    assert!(as_the_node.1 > 0.9 && force.1 > 0.9 && low.1 < as_the_node.1, "{as_the_node:?} {force:?} {low:?}");
    assert!(eval(&["--touch", "1.5"]).stderr.contains("a probability between 0 and 1"));
}

#[test]
fn a_recording_that_is_too_short_at_rest_is_refused_with_what_is_needed() {
    let (_, run) = replay(&["-p", "calibration.min_s:=500.0", "-p", "calibration.duration_s:=600.0"]);
    assert!(run.failure().contains("at least 500 s needed"), "{run:?}");
}

#[test]
fn the_model_is_inspected_as_what_it_is_and_runs_alike_in_both_runtimes() {
    let folder = trained();
    let told = tpf(folder, &["inspect", "model.onnx"]).ok().stdout;
    assert!(told.contains("4: index_dip") && told.contains("told: what these joints make of the taxels"), "{told}");
    let with = |backend: &str| replay_of(short_session(), &["-p", &format!("model.fingertip.backend:={backend}")]);
    let (rten, run) = with("rten");
    run.ok();
    let (ort, run) = with("onnxruntime");
    if run.code != 0 && run.failure().contains("backend onnxruntime can't be used: ") {
        return common::without_onnx_runtime(&run.stderr);
    }
    run.ok();
    let (ort, rten) = (states(ort.path()), states(rten.path()));
    let alike =
        ort.iter().zip(&rten).all(|(a, b)| (a.force - b.force).abs() <= 1e-4 || (a.force.is_nan() && b.force.is_nan()));
    assert!(ort.len() == rten.len() && alike);
}

/// Parameters of the synthetic hand whose fingers of these names have one model.
fn write_hand(folder: &Path, fingers: &str) {
    let hand = fs::read_to_string(format!("{ROOT}/params/hand1.yaml")).unwrap();
    let mut text = hand.replace("regions: [index, middle, ring, little, thumb]", &format!("regions: [{fingers}]"));
    for finger in ["index", "middle", "ring", "little", "thumb"] {
        text = text.replace(&format!("        model: {finger}\n"), "        model: hand\n");
        text = text.replace(
            &format!("      {finger}: {{path: ../models/hand1_{finger}_adaptive.onnx, glove: synthetic-hand1}}\n"),
            if finger == "index" { "      hand: {path: hand.onnx}\n" } else { "" },
        );
        if !fingers.contains(finger) {
            let begin = text.find(&format!("      {finger}:\n        model: hand\n")).unwrap();
            let end = begin + text[begin..].find(&format!("truth: {finger}_cell\n")).unwrap();
            text.replace_range(begin..end + format!("truth: {finger}_cell\n").len(), "");
        }
    }
    fs::write(folder.join("hand.yaml"), text).unwrap();
}

#[test]
fn one_model_serves_several_regions_each_with_what_pose_makes_of_its_own_taxels() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // The load cell is under the index finger in the first session, under the middle finger in the second.
    let simulate = ["simulate", "--glove", "hand1", "--users", "1", "--sessions", "2", "--minutes", "5", "--seed", "7"];
    tpf(folder, &[&simulate[..], &["-o", "bags"]].concat()).ok();
    write_hand(folder, "index, middle, ring");
    let train = |region: &str, output: &str, more: &[&str]| {
        let train = ["train", "bags", "--params-file", "hand.yaml", "--kind", "adaptive", "--region", region];
        tpf(
            folder,
            &[&train[..], &["-o", output, "--steps", "40", "--batch", "16", "--held-touches", "0"], more].concat(),
        )
    };
    for (region, more, expected) in [
        ("index,middle,ring", &[][..], "region ring: no bag has a true force of it"),
        ("index,index", &[], "--region names index twice"),
        ("index,nose", &[], "--region nose: the parameters have index, middle, ring"),
        ("index,middle", &["--kind", "pose-aware"], "--kind pose-aware is trained for one region"),
    ] {
        let more: Vec<&str> = more.to_vec();
        let asked = ["train", "bags", "--params-file", "hand.yaml", "--region", region, "-o", "no.onnx"];
        let kind: &[&str] = if more.is_empty() { &["--kind", "adaptive"] } else { &more };
        let refused = tpf(folder, &[&asked[..], kind].concat());
        assert!(refused.failure().starts_with(expected), "{refused:?}");
    }
    let own = format!("{ROOT}/params/hand1.yaml");
    let asked =
        ["train", "bags", "--params-file", &own, "--region", "index,middle", "--kind", "adaptive", "-o", "no.onnx"];
    let refused = tpf(folder, &[&asked[..], &["--hold-out", "donnings"]].concat());
    assert!(refused.failure().starts_with("--hold-out needs one model for all regions"), "{refused:?}");

    let run = train("index,middle", "hand.onnx", &[]).ok();
    assert!(run.stderr.contains("2 sessions (synthetic) of 2 regions"), "{run:?}");
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("hand.report.json")).unwrap()).unwrap();
    let trained: Vec<_> = report["sessions"].as_array().unwrap().iter().map(|session| &session["region"]).collect();
    assert_eq!(trained, ["index", "middle"]);
    // Each region has what it would have alone.
    let metadata = |model: &str| tpf(folder, &["inspect", model, "--json"]).ok().json()[0]["metadata"].clone();
    let json =
        |text: &serde_json::Value| -> serde_json::Value { serde_json::from_str(text.as_str().unwrap()).unwrap() };
    let regions = json(&metadata("hand.onnx")["regions"]);
    tpf(
        folder,
        &[
            "train",
            "bags/hand1_user01_session2",
            "--params-file",
            "hand.yaml",
            "--kind",
            "adaptive",
            "--region",
            "middle",
            "-o",
            "middle.onnx",
            "--steps",
            "2",
            "--batch",
            "16",
            "--held-touches",
            "0",
        ],
    )
    .ok();
    assert_eq!(regions["middle"]["artifact"], json(&metadata("middle.onnx")["artifact"]));
    assert_eq!(regions["middle"]["joints"], json(&metadata("middle.onnx")["joints"]));
    assert_ne!(regions["middle"]["artifact"], regions["index"]["artifact"]);
    let told = tpf(folder, &["inspect", "hand.onnx"]).ok().stdout;
    assert!(told.contains("region middle its joints: middle_dip, middle_pip"), "{told}");

    // A region that it was not trained on is refused; the others have forces, and scores.
    let replay = ["replay", "bags/hand1_user01_session2", "--params-file", "hand.yaml", "-o", "out.mcap", "--json"];
    let refused = tpf(folder, &replay);
    assert!(refused.failure().contains("region.ring: its model is of the regions index, middle"), "{refused:?}");
    write_hand(folder, "index, middle");
    let summary = tpf(folder, &[&replay[..], &["-p", "calibration.insist:=true"]].concat()).ok().json();
    for region in 0..2 {
        assert!(summary["regions"][region]["estimates"].as_u64().unwrap() > 16_000, "{summary:#}");
    }
    let states: Vec<ContactState> = states(folder);
    let learned =
        |name: &str| states.iter().any(|s| s.region == name && s.adaptation == ContactState::ADAPTATION_LEARNING);
    assert!(learned("index") && learned("middle"));
    let scored = ["eval", "bags", "--params-file", "hand.yaml", "--json", "-p", "calibration.insist:=true"];
    let scored = tpf(folder, &scored).ok().json();
    assert_eq!(scored["table"]["gloves"], serde_json::json!(["hand1/index", "hand1/middle"]));
    // A parameter file for it leaves out the fingers that it doesn't know.
    let init = ["init", "bags/hand1_user01_session2", "--model", "hand.onnx", "--yes", "-o", "made.yaml"];
    let made = tpf(folder, &init).ok();
    let expected = "left out: ring, little, thumb, because hand.onnx was trained on index, middle";
    assert!(made.stderr.contains(expected), "{made:?}");
    let text = std::fs::read_to_string(folder.join("made.yaml")).unwrap();
    assert!(text.contains("regions: [index, middle]") && !text.contains("ring:"), "{text}");
    tpf(folder, &["replay", "bags/hand1_user01_session2", "--params-file", "made.yaml", "-o", "by_made.mcap"]).ok();
}

#[test]
fn training_without_joints_says_what_is_missing() {
    let folder = trained();
    let out = tempfile::tempdir().unwrap();
    let bag = bag(folder, 1);
    let train = ["train", bag.to_str().unwrap(), "--params-file", PARAMS, "--kind", "adaptive", "-o", "m.onnx"];
    let run = tpf(out.path(), &[&train[..], &["-p", "region.index.joints:=[]"]].concat());
    assert!(run.failure().contains("--kind adaptive needs joint angles"), "{run:?}");
}

#[cfg(feature = "ros")]
#[test]
fn a_live_calibration_finds_the_artifact_and_a_tare_keeps_its_gains() {
    use std::time::Duration;

    use tactile_pose_fusion::bag::{BagReader, Input, Inputs};
    use tactile_pose_fusion::config::{self, DEFAULT_NODE};
    use tactile_pose_fusion::fusion::{ForceGain, Fusion};
    use tactile_pose_fusion::glove::{Models, replace_model};
    use tactile_pose_fusion::recording::input_topics;
    use tactile_pose_fusion::ros::{Calibrator, Purpose, Sample};
    use tactile_pose_fusion::zero::Donning;

    let folder = trained();
    let mut cfg = config::load(Path::new(PARAMS), DEFAULT_NODE).unwrap();
    replace_model(&mut cfg, folder.join("model.onnx")).unwrap();
    let core = || Fusion::new(cfg.fusion().clone(), Models::load(&cfg).unwrap().regressors).unwrap();
    // Of a session that begins with movement in the air.
    let calibrate = |purpose, from_s: f64, seconds: f64, before: &Donning| {
        let mut reader = BagReader::open(&[bag(folder, 3)]).unwrap();
        let mut inputs = Inputs::new(input_topics(&cfg), &mut reader).unwrap();
        let mut calibrator = Calibrator::new(&cfg, purpose, Duration::from_secs_f64(seconds));
        let mut first = None;
        while let Some(message) = reader.next_message().unwrap() {
            let at_s = message.log_time.nanos_since(*first.get_or_insert(message.log_time)) as f64 * 1e-9;
            for part in inputs.parts(message.channel).unwrap() {
                let Input::Event(event) = inputs.decode(&message, part) else { continue };
                if (from_s..from_s + seconds).contains(&at_s) {
                    calibrator.handle(Sample::from(&event));
                }
            }
        }
        let (donning, result) = calibrator.finish(core(), before);
        assert!(result.success, "{result:?}");
        donning.unwrap()
    };
    let gain = ForceGain { gain: 1.5, low: 1.4, high: 1.6, touches: 5 };
    let mut found = calibrate(Purpose::Calibrate, 0.0, 12.0, &Donning::default());
    assert_eq!(found.force_gains, [], "known touches are of the donning before");
    found.force_gains = vec![Some(gain)];
    let distance = |other: &Donning| {
        let (a, b) = (found.artifacts[0].as_ref().unwrap(), other.artifacts[0].as_ref().unwrap());
        let squares: f64 = a.gains.iter().zip(&b.gains).map(|(a, b)| (a - b).powi(2)).sum();
        (squares / a.gains.len() as f64).sqrt()
    };
    let kept = calibrate(Purpose::Tare, 14.0, 1.0, &found);
    let anew = calibrate(Purpose::Tare, 14.0, 1.0, &Donning::default());
    assert_eq!(kept.force_gains, [Some(gain)]);
    assert!(
        distance(&kept) < 0.1 && distance(&kept) < 0.5 * distance(&anew),
        "{} {}",
        distance(&kept),
        distance(&anew)
    );
}
