//! `tpf characterize` finds in simulated sessions what the simulator put in, and says what a recording can't tell.

use crate::common;

use std::fs;
use std::path::Path;

use common::browser::look;
use common::scored;
use common::tpf::tpf;
use serde_json::Value;
use tactile_pose_fusion::sim::glove::{GloveDesign, WornGlove};
use tactile_pose_fusion::sim::hand::{HandPose, INDEX_BASE, MOVEMENTS};
use tactile_pose_fusion::sim::performance::{Contact, HandState};
use tactile_pose_fusion::sim::{Activity, Conditions, SessionSpec, Tracking};
use tactile_pose_fusion::units::GramForce;

const PARAMS: &str = "/**:
  ros__parameters:
    regions: [index]
    tactile_sources: [glove]
    joint_sources: [hand]
    truth_sources: [load_cell]
    tactile.glove: {topic: /glove/taxels, n_taxels: 6}
    joint.hand: {topic: /hand/joint_states}
    truth.load_cell: {topic: /load_cell/wrench}
    model.tip: {path: model.onnx}
    region.index: {model: tip, joints: [index_dip, index_pip, index_mcp_flex, index_mcp_abd], frame_id: index_tip}
";
const SEED: u64 = 7;
const MINUTES: f64 = 8.0;
const USERS: u32 = 2;

/// Sessions of two users of a synthetic glove.
fn folder(glove: u8, minutes: f64) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("params.yaml"), PARAMS).unwrap();
    let [glove, users, seed, minutes] = [glove.to_string(), USERS.to_string(), SEED.to_string(), minutes.to_string()];
    let numbers = ["--glove", &glove, "--users", &users, "--seed", &seed, "--minutes", &minutes];
    let command = [&["simulate", "--sessions", "1", "-o", "bags"], &numbers[..]].concat();
    tpf(folder.path(), &command).ok();
    folder
}

fn characterize(folder: &Path, more: &[&str]) -> Value {
    tpf(folder, &[&["characterize", "bags", "--params-file", "params.yaml", "--json"], more].concat()).ok().json()
}

/// The only region.
fn region(found: &Value) -> &Value {
    &found["regions"][0]
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))
}

/// Glove, hand and donning of a simulated session on a test bench: what `n` frames read together on average, in counts.
fn hold(glove: &mut WornGlove, pose: HandPose, contact: Option<Contact>) -> f64 {
    let readings =
        (0..40).map(|_| glove.sample(0.01, &HandState { pose, contact }).iter().map(|c| f64::from(*c)).sum::<f64>());
    readings.skip(20).sum::<f64>() / 20.0
}

/// The tap that reads as much as a full bend, of the same user and donning as in the session, gF.
fn bend_artifact_gf(design: &'static GloveDesign, user: u32) -> f64 {
    let spec = SessionSpec {
        glove: design.number,
        user,
        session: 1,
        seed: SEED,
        minutes: MINUTES,
        activity: Activity::Protocol,
        tracking: Tracking::Markers,
        conditions: Conditions::default(),
    };
    let mut glove = WornGlove::new(design, &spec);
    let bent = INDEX_BASE.with_index(MOVEMENTS[0].end);
    let artifact = hold(&mut glove, bent, None) - hold(&mut glove, INDEX_BASE, None);
    let (mut touch, mut before) = (0, (0.0, 0.0));
    for force in (1..60).map(|k| 20.0 * f64::from(k)) {
        let mut added = 0.0;
        for _ in 0..24 {
            touch += 1;
            let rest = hold(&mut glove, INDEX_BASE, None);
            added += (hold(&mut glove, INDEX_BASE, Some(Contact { touch, force: GramForce(force), tangential: None }))
                - rest)
                / 24.0;
        }
        if added > artifact {
            return before.0 + (force - before.0) * (artifact - before.1) / (added - before.1);
        }
        before = (force, added);
    }
    panic!("an artifact of {artifact} counts is more than any tap");
}

#[test]
fn what_the_simulator_put_in_is_found() {
    for number_of_glove in [1, 3] {
        let design = GloveDesign::numbered(number_of_glove).unwrap();
        let folder = folder(number_of_glove, MINUTES);
        let found = characterize(folder.path(), &[]);
        assert_eq!(found["synthetic"], true);
        let region = region(&found);
        joints_by_locality(region);
        artifact_of_a_bend(region, design);

        // Gains differ by user and donning and slip over minutes: the map of one other donning is of little use, a
        // calibration leaves less, and following it less again.
        let left = |what: &str| number(&region["following"]["all"][what]);
        let order = ["followed", "calibrated", "as_read"].map(left);
        assert!(order.is_sorted() && order[0] < 0.8 * order[1], "glove {number_of_glove}: {order:?}");
        assert!(order[0] < 0.5 * left("fixed_map").min(order[2]), "glove {number_of_glove}: {order:?}");
        assert!(left("with_gains") < left("with_offset") && left("with_offset") <= left("fixed_map"));
        assert_eq!(region["following"]["by_session"].as_array().unwrap().len(), 2);

        // White noise of each reading; the steps of whole counts tell it to about a count, and 1/12 is of rounding.
        let noise = number(&region["noise"]["sd"]["median"]);
        let made = (design.noise * design.span_counts.abs()).hypot((1.0_f64 / 12.0).sqrt());
        assert!((noise / made - 1.0).abs() < 0.06, "glove {number_of_glove}: {noise} of {made}");
        assert!(region["noise"]["by_taxel"].as_array().unwrap().iter().all(|taxel| taxel["n_dead"] == 0));

        // Two play operators of half-widths 0.08 and 0.2 of a full bend lag by 0.28 of it on average, and the design's
        // share of the artifact goes through them. Creep and filter come on top: strain creeps by 15 %, within 0.35 s
        // and 2.5 s, while sweeps take about one.
        let hysteresis = number(&region["hysteresis"]["artifact"]["median"]);
        let play = 0.28 * design.hysteresis;
        assert!((0.7 * play..play + 0.1).contains(&hysteresis), "glove {number_of_glove}: {hysteresis} of {play}");

        // Clocks are synchronized to a few ms; filter, creep and play are the rest.
        let lag_ms = number(&region["offset"]["lag_ms"]["median"]);
        assert!((0.0..25.0).contains(&lag_ms), "glove {number_of_glove}: {lag_ms}");
    }
}

/// Observation 3: DIP and PIP before MCP, and the joints of other fingers behind what they only move along with.
fn joints_by_locality(region: &Value) {
    let joints: Vec<&str> = region["joints"].as_array().unwrap().iter().map(|joint| joint.as_str().unwrap()).collect();
    assert_eq!(joints.len(), 20, "all that the bag has, not only the region's");
    let of = |figures: &Value, joint: &str| number(&figures[joints.iter().position(|name| *name == joint).unwrap()]);
    let alone = |joint: &str| of(&region["selection"]["alone"], joint);
    let correlation = |joint: &str| of(&region["correlation"]["mean_abs"], joint);
    for near in ["index_dip", "index_pip"] {
        for far in joints.iter().filter(|joint| !["index_dip", "index_pip"].contains(joint)) {
            assert!(alone(near) > alone(far) + 0.2, "{near} {far}: {region:#}");
            assert!(correlation(near) > correlation(far) + 0.1, "{near} {far}: {region:#}");
        }
    }
    let chosen: Vec<&str> =
        region["selection"]["chosen"].as_array().unwrap().iter().map(|step| step["joint"].as_str().unwrap()).collect();
    // DIP and PIP move so much together that either stands for both; MCP moves by itself, and adds its own.
    assert!(["index_dip", "index_pip"].contains(&chosen[0]), "{chosen:?}");
    assert!(chosen.contains(&"index_mcp_flex"), "{chosen:?}");
    let suggested = region["pose_range"].as_array().unwrap();
    assert_eq!(suggested.len(), chosen.len());
    let mcp = suggested.iter().find(|range| range["joint"] == "index_mcp_flex").unwrap();
    // The protocol folds MCP from straight to 1.3 rad; users, markers and yielding under load shift that by some 0.2.
    assert!(number(&mcp["min"]).abs() < 0.2 && (number(&mcp["max"]) - 1.3).abs() < 0.3, "{mcp}");
}

/// Observation 1: a full bend reads as the tap that reads as much on the same hand and donning.
fn artifact_of_a_bend(region: &Value, design: &'static GloveDesign) {
    let bend = region["artifact"]["by_pose"].as_array().unwrap().iter().find(|pose| pose["pose"] == "bend").unwrap();
    let p95 = &bend["size"]["p95_gf"];
    let mut made: Vec<f64> = (1..=USERS).map(|user| bend_artifact_gf(design, user)).collect();
    made.sort_by(f64::total_cmp);
    // A user reaches further or less far than asked (sd 7 % and 5 %), the glove slips (15 or 30 %), taps differ by place
    // and pattern (9 % of gain and 2 mm), and there are a few of each.
    for (found, made) in [("min", made[0]), ("max", made[made.len() - 1])] {
        let ratio = number(&p95[found]) / made;
        assert!((0.6..1.5).contains(&ratio), "glove {}: {p95} of {made:.0} gF", design.number);
    }
}

#[test]
fn a_clock_that_is_off_is_found_and_the_parameters_put_it_right() {
    let folder = folder(1, 3.0);
    let by_session = |found: &Value| -> Vec<Option<f64>> {
        let sessions = region(found)["offset"]["by_session"].as_array().unwrap().iter();
        sessions.map(|session| session["lag_ms"].as_f64()).collect()
    };
    let right = characterize(folder.path(), &[]);
    let interval = &region(&right)["offset"]["interval_ms"];
    let held = number(&interval[0])..=number(&interval[1]);
    for off_ms in [-120.0, 80.0] {
        let wrong = characterize(folder.path(), &["-p", &format!("joint.hand.stamp_offset_ms:={off_ms:?}")]);
        let (right, found) = (by_session(&right), by_session(&wrong));
        let told: Vec<(f64, f64)> = right.into_iter().zip(found).filter_map(|(a, b)| Some((a?, b?))).collect();
        assert!(!told.is_empty(), "{wrong:#}");
        for (right, found) in told {
            // Joint angles are interpolated at other moments; a tenth of a frame or two remain.
            assert!((right - found - off_ms).abs() < 3.0, "{off_ms}: {right} {found}");
        }
        let parameters = wrong["parameters"].as_str().unwrap();
        let line = parameters.lines().find_map(|line| line.trim().strip_prefix("stamp_offset_ms: ")).unwrap();
        let suggested: f64 = line.split(' ').next().unwrap().parse().unwrap();
        assert!(held.contains(&suggested), "{parameters}");
    }
}

#[test]
fn text_and_page_say_synthetic_and_tell_everything_and_the_fragment_is_taken_as_parameters() {
    let folder = folder(1, 3.0);
    let folder = folder.path();
    let command = ["characterize", "bags", "--params-file", "params.yaml"];
    let text = tpf(folder, &command).ok().stdout;
    let told = ["SYNTHETIC data: glove1_user01_session1", "index_pip", "Response to force", "all movement in the air"];
    let more = ["Hysteresis", "Drift at rest", "Noise of a taxel", "Dead taxels: none", "Taxels lag", "joints: ["];
    let left = ["What is left of the artifact in the air", "and followed while the glove is worn"];
    for told in told.iter().chain(&more).chain(&left) {
        assert!(text.contains(told), "{told}: {text}");
    }
    let found = characterize(folder, &["--report", "page.html"]);
    let page = fs::read_to_string(folder.join("page.html")).unwrap();
    for told in
        ["SYNTHETIC DATA", "index-correlation", "index-response-sum", "index-loop", "index-drift", "stamp_offset_ms"]
    {
        assert!(page.contains(told), "{told}");
    }
    if let Some(seen) = look(&folder.join("page.html")) {
        let rows = |table: &str| seen["wide"]["tables"][table].as_array().unwrap();
        let chosen = region(&found)["selection"]["chosen"].as_array().unwrap();
        for (row, step) in rows("index-chosen").iter().zip(chosen) {
            assert_eq!((&row[0]["text"], &row[3]["value"]), (&step["joint"], &step["explained"]));
        }
        let artifact = &region(&found)["artifact"];
        let of_poses = artifact["by_pose"].as_array().unwrap();
        let shown = rows("index-artifact-table");
        assert_eq!(shown.len(), 1 + found["sessions"].as_array().unwrap().len() + of_poses.len());
        assert_eq!(shown[0][4]["value"], artifact["movement"]["p95_n"]["median"]);
        for (row, pose) in shown[shown.len() - of_poses.len()..].iter().zip(of_poses) {
            assert_eq!((&row[0]["text"], &row[2]["value"]), (&pose["pose"], &pose["size"]["p95"]["median"]));
        }
        let plots = seen["wide"]["plots"].as_array().unwrap();
        assert!(plots.len() >= 6, "{plots:?}");
        for plot in plots {
            let words = plot["words"].as_array().unwrap();
            assert!(words.iter().any(|word| word == "synthetic data"), "every picture says what it is of: {plot}");
        }
    }
    let again = tpf(folder, &[&command[..], &["--report", "page.html"]].concat());
    assert!(again.failure().contains("is there already"), "{again:?}");
    let lines: Vec<String> =
        found["parameters"].as_str().unwrap().lines().map(|line| format!("    {line}\n")).collect();
    fs::write(folder.join("suggested.yaml"), format!("/**:\n  ros__parameters:\n{}", lines.concat())).unwrap();
    let taken = tpf(folder, &[&command[..], &["--params-file", "suggested.yaml", "--json"]].concat()).ok().json();
    let chosen = region(&found)["selection"]["chosen"].as_array().unwrap().iter().map(|step| step["joint"].clone());
    assert_eq!(region(&taken)["configured_joints"], chosen.collect::<Value>());
}

#[test]
fn without_a_force_sensor_what_needs_none_is_told_and_the_rest_is_named() {
    let folder = folder(1, 2.0);
    let folder = folder.path();
    let elsewhere = ["-p", "truth.load_cell.topic:=/elsewhere"];
    let found = characterize(folder, &elsewhere);
    let index = region(&found);
    let untold = index["following"]["missing"].as_str().unwrap();
    assert!(index["following"]["all"].is_null() && untold.contains("how a light touch spreads"), "{untold}");
    assert!(index["response"].is_null() && index["artifact"]["movement"]["p95_n"].is_null());
    let with_truth = characterize(folder, &[]);
    for figure in ["correlation", "selection", "pose_range", "noise", "offset"] {
        assert_eq!(index[figure], region(&with_truth)[figure], "{figure}");
    }
    assert_eq!(index["artifact"]["movement"]["p95"], region(&with_truth)["artifact"]["movement"]["p95"]);
    assert!(found["missing"][0].as_str().unwrap().ends_with("no topic /elsewhere, so no forces are told"), "{found:#}");
    let of_truth = |line: &&str| !line.contains("load_cell");
    let without: String = PARAMS.lines().filter(of_truth).map(|line| format!("{line}\n")).collect();
    fs::write(folder.join("params.yaml"), without).unwrap();
    let none = characterize(folder, &["-p", "region.index.joints:=[index_dip, nowhere]"]);
    assert!(none["missing"][0].as_str().unwrap().contains("no force sensor in the parameters"), "{}", none["missing"]);
    assert!(none["joints_left_out"][0].as_str().unwrap().starts_with("nowhere: "), "{}", none["joints_left_out"]);
    let asked = tpf(folder, &["characterize", "bags", "--params-file", "params.yaml", "--truth", "/elsewhere"]);
    assert!(asked.failure().contains("/elsewhere"), "a topic that is asked for must be there");
}

#[test]
fn without_annotations_the_time_in_the_air_must_be_named() {
    let folder = folder(1, 2.0);
    let folder = folder.path();
    let command = ["characterize", "bags", "--params-file", "params.yaml", "-p", "stage_topic:=/nowhere"];
    let refused = tpf(folder, &command);
    let line = refused.failure();
    assert!(line.contains("no stage annotations on /nowhere") && line.contains("--in-air FROM..TO"), "{line}");
    for (span, said) in [
        ("500..600", "--in-air 500..600 lies behind the end of the recording, which is 1"),
        ("35..5", "35 s must be before 5 s"),
        ("-5..5", "expected FROM..TO in seconds, such as 5..35, or all; got \"-5..5\""),
    ] {
        let run = tpf(folder, &[&command[..], &["--in-air", span]].concat());
        assert!(run.code != 0 && run.stderr.contains(said), "{span}: {run:?}");
    }
    let partly = tpf(folder, &[&command[..], &["--in-air", "0..500", "--json"]].concat()).ok();
    assert!(partly.stderr.contains("so --in-air 0..500 counts up to its end"), "{partly:?}");
    // Stage 1 of the protocol, in which nothing touches the glove, comes first.
    let named = tpf(folder, &[&command[..], &["--in-air", "0..14", "--json"]].concat()).ok().json();
    assert_eq!(named["sessions"][0]["in_air"], "0 to 14 s");
    let index = region(&named);
    let in_air = number(&index["sessions"][0]["in_air_s"]);
    assert!((13.0..=14.1).contains(&in_air), "{in_air}");
    assert!(index["artifact"]["by_pose"].as_array().unwrap().is_empty(), "nobody wrote down what was asked for");
    assert!(number(&index["artifact"]["movement"]["p95_gf"]["median"]) > 20.0);
}

#[test]
fn a_force_of_another_sign_or_unit_is_doubted_by_the_name_of_the_parameter() {
    let folder = scored::folder();
    let path = folder.path();
    let commands = [
        &["characterize", "bags", "--params-file", "params.yaml"][..],
        &["eval", "bags", "--params-file", "params.yaml"],
    ];
    for command in commands {
        let said = |more: &[&str]| tpf(path, &[command, more].concat()).ok().stderr;
        let right = said(&[]);
        assert!(!right.contains("truth.load_cell"), "{right}");
        let negative = said(&["-p", "truth.load_cell.sign:=-1"]);
        assert!(negative.contains("a press seems to be negative; set truth.load_cell.sign to 1"), "{negative}");
        let small = said(&["-p", "truth.load_cell.unit:=gF"]);
        assert!(small.contains("that looks like N; set truth.load_cell.unit to N"), "{small}");
    }
}
