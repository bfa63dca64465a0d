//! Forces of three axes, through the command line: in the wrench, in scores, in tables, and in merged partials.

use crate::common;

use std::fs;
use std::path::Path;

use common::bags::{decoded, stamp_of};
use common::onnx::LinearModel;
use common::scored::PARAMS;
use common::tpf::{Run, tpf};
use serde_json::Value;
use tactile_pose_fusion::msg::{ContactArray, WrenchStamped};

const WRENCH: &str = "/tactile_pose_fusion/index/wrench";
const CONTACTS: &str = "/tactile_pose_fusion/contacts";

/// Where the model's forces point, in the frame of the patch; they are pressed along z.
const DIRECTION: [f32; 3] = [0.25, -0.5, 1.0];

/// Short sessions of a synthetic glove, a force sensor of three axes, and a model that sums taxels along a direction.
fn folder(n_users: &str, more: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let axes = "truth.load_cell: {topic: /load_cell/wrench, fields: [wrench.force.x, wrench.force.y, wrench.force.z], signs: [-1, 1, 1]}";
    let params = PARAMS.replace("truth.load_cell: {topic: /load_cell/wrench}", axes);
    assert!(params.contains(axes));
    fs::write(path.join("params.yaml"), params + more).unwrap();
    fs::write(path.join("one_axis.yaml"), PARAMS).unwrap();
    let simulate = ["simulate", "--glove", "1", "--users", n_users, "--sessions", "1", "--minutes=1.7", "--seed", "5"];
    tpf(path, &[&simulate[..], &["-o", "bags"]].concat()).ok();
    LinearModel::new(64, 6, 4).metadata("unit", "gF").axes(DIRECTION).write(path, "model.onnx");
    LinearModel::new(64, 6, 0).metadata("unit", "gF").write(path, "other.onnx");
    folder
}

const BAG: &str = "bags/glove1_user01_session1";

fn scores(run: &Run) -> Vec<Value> {
    let result = run.json();
    let models = result["models"].as_array().unwrap();
    models.iter().map(|model| model["by"]["all"][0].clone()).collect()
}

#[test]
fn a_wrench_has_the_force_of_all_axes_in_its_frame_and_contacts_the_normal_force() {
    // The patch is turned by 90 degrees about z: its x is the frame's y, its y the frame's -x.
    let folder = folder("1", "    region.index.mount.rotation: [0.0, 0.0, 0.7071067811865476, 0.7071067811865476]\n");
    let path = folder.path();
    tpf(path, &["replay", BAG, "--params-file", "params.yaml", "--merge", "-o", "merged"]).ok();
    let bag = path.join("merged");
    let wrenches = decoded::<WrenchStamped>(&bag, WRENCH);
    let contacts = decoded::<ContactArray>(&bag, CONTACTS);
    let mut contacts = contacts.iter().filter(|array| !array.contacts[0].force.is_nan());
    assert!(wrenches.len() > 5000, "{}", wrenches.len());
    for wrench in &wrenches {
        let array = contacts.next().unwrap();
        assert_eq!(stamp_of(&array.header), stamp_of(&wrench.header));
        let (force, normal) = (&wrench.wrench.force, array.contacts[0].force);
        let [x, y, z] = DIRECTION.map(|axis| f64::from(axis) * normal);
        let off = [force.x + y, force.y - x, force.z - z].map(f64::abs);
        // Taxels are summed in float32, and there is one rotation.
        assert!(off.iter().all(|off| *off <= 1e-6 * normal.abs().max(1.0)), "{force:?} {normal}");
    }
    // Recorded estimates score as computed ones do.
    let eval = |bag: &str, more: &[&str]| {
        tpf(path, &[&["eval", bag, "--params-file", "params.yaml", "--whole", "--json"], more].concat()).ok()
    };
    let computed = scores(&eval(BAG, &["--model", "model.onnx"])).pop().unwrap();
    let recorded = scores(&eval("merged", &[])).pop().unwrap();
    let number =
        |score: &Value, name: &str| score["tangential"][name].as_f64().unwrap_or_else(|| panic!("{name}: {score}"));
    for name in ["mae_gf", "angle_deg"] {
        let (a, b) = (number(&computed, name), number(&recorded, name));
        assert!(a > 0.0 && (a - b).abs() < 0.01 * a, "{name}: {a} computed, {b} recorded"); // a window less is scored
    }
    assert!(number(&computed, "n_angles") < number(&computed, "n_frames"));
}

#[test]
fn tables_of_computed_and_of_recorded_estimates_have_the_same_tangential_forces() {
    let folder = folder("1", "");
    let path = folder.path();
    tpf(path, &["replay", BAG, "--params-file", "params.yaml", "--merge", "-o", "merged"]).ok();
    let export = |bag: &str, name: &str| {
        let (csv, dataset) = (format!("{name}.csv"), name.to_owned());
        let args = ["export", bag, "--params-file", "params.yaml", "--csv", &csv, "--lerobot", &dataset];
        tpf(path, &args).ok();
        // The name of a session is that of its bag.
        fs::read_to_string(path.join(csv)).unwrap().replace("glove1_user01_session1", "merged")
    };
    let (computed, recorded) = (export(BAG, "computed"), export("merged", "recorded"));
    assert!(computed == recorded, "the tables differ");
    assert!(common::files(&path.join("computed")) == common::files(&path.join("recorded")), "the datasets differ");
    let mut lines = computed.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column =
        |name: &str| header.iter().position(|known| *known == name).unwrap_or_else(|| panic!("{name}: {header:?}"));
    let named = ["force_n", "tangential_x_n", "tangential_y_n", "tangential_z_n", "truth_tangential_x_n"].map(column);
    let mut n_truth = 0;
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        let [force, x, y, z, truth] = named.map(|idx| cells[idx].parse::<f64>().ok());
        n_truth += usize::from(truth.is_some_and(|truth| truth != 0.0));
        match force {
            None => assert_eq!((x, y, z), (None, None, None), "{line}"),
            Some(force) => {
                let off = [x.unwrap() - 0.25 * force, y.unwrap() + 0.5 * force, z.unwrap()].map(f64::abs);
                assert!(off.iter().all(|off| *off <= 1e-6 * force.abs().max(1.0)), "{line}");
            }
        }
    }
    assert!(n_truth > 1000, "{n_truth}");
    let info = fs::read_to_string(path.join("computed/meta/info.json")).unwrap();
    let info: Value = serde_json::from_str(&info).unwrap();
    assert_eq!(info["features"]["observation.force_tangential.index"]["shape"], serde_json::json!([3]));

    // A model of one axis has no such columns, and can't follow one of three into the same table.
    let one = |more: &[&str]| tpf(path, &[&["export", BAG, "--params-file", "one_axis.yaml"], more].concat());
    one(&["--model", "other.onnx", "--csv", "one.csv"]).ok();
    assert!(!fs::read_to_string(path.join("one.csv")).unwrap().lines().next().unwrap().contains("tangential"));
    let replay = ["replay", BAG, "--params-file", "params.yaml", "--model", "other.onnx", "--merge", "-o", "first"];
    tpf(path, &replay).ok();
    let mixed = ["export", "first", "merged", "--params-file", "params.yaml", "--csv", "mixed.csv", "--json"];
    let mixed = tpf(path, &mixed);
    assert!(
        mixed.code == 3 && mixed.stderr.contains("region index has tangential forces, in the first bag it has none"),
        "{mixed:?}"
    );
}

#[test]
fn tangential_scores_are_told_where_truth_and_model_have_three_axes_and_nowhere_else() {
    let folder = folder("2", "");
    let path = folder.path();
    let options = ["--params-file", "params.yaml", "--model", "model.onnx", "--compare", "other.onnx"];
    let eval = |more: &[&str]| tpf(path, &[&["eval", "bags"][..], &options, more].concat());
    let written = ["--report", "r.html", "--parquet", "r.parquet", "--overwrite"];
    let results = |command: &[&str]| -> Vec<Vec<u8>> {
        let json = tpf(path, &[command, &["--json"]].concat()).ok().stdout;
        let text = tpf(path, &[command, &written].concat()).ok().stdout;
        let files = ["r.html", "r.parquet"].map(|name| fs::read(path.join(name)).unwrap());
        [json.into_bytes(), text.into_bytes()].into_iter().chain(files).collect()
    };
    let whole = results(&[&["eval", "bags"][..], &options].concat());
    let json: Value = serde_json::from_slice(&whole[0]).unwrap();
    let all = |model: usize| &json["models"][model]["by"]["all"][0];
    assert!(all(0)["tangential"].is_null(), "the compared model has one axis: {}", all(0));
    let judged = json["models"].as_array().unwrap().len() - 1;
    assert!(all(judged)["tangential"]["mae_gf"].as_f64().unwrap() > 0.0);
    let angle = all(judged)["tangential"]["angle_deg"].as_f64().unwrap();
    // The model's forces point 29.2 degrees off the normal, or away from the hand; the synthetic friction is a few degrees.
    assert!((20.0..160.0).contains(&angle), "{angle}");
    let text = String::from_utf8(whole[1].clone()).unwrap();
    assert!(text.contains("Tangential MAE N (gF)") && text.contains("Angle deg"), "{text}");
    let page = String::from_utf8(whole[2].clone()).unwrap();
    assert!(page.contains("table-tangential"));
    // Two shards, merged, are the bytes of one run.
    for (index, out) in [("0/2", "a.parquet"), ("1/2", "b.parquet")] {
        eval(&["--partial", out, "--shard", index]).ok();
    }
    let merged = results(&["merge", "b.parquet", "a.parquet"]);
    for ((merged, whole), name) in merged.iter().zip(&whole).zip(["json", "text", "page", "parquet"]) {
        assert!(merged == whole, "{name} differs");
    }
    // With a truth of one axis nothing is told.
    let one = tpf(path, &["eval", "bags", "--params-file", "one_axis.yaml", "--model", "model.onnx"]).ok();
    assert!(!one.stdout.contains("angential"), "{}", one.stdout);
}

#[test]
fn a_model_of_three_axes_is_inspected_as_such() {
    let folder = tempfile::tempdir().unwrap();
    let path: &Path = folder.path();
    LinearModel::new(64, 6, 4).axes(DIRECTION).write(path, "model.onnx");
    let text = tpf(path, &["inspect", "model.onnx"]).ok().stdout;
    assert!(
        text.contains("output    force float32 [N, 3]") && text.contains("three axes: x, y, z in the frame"),
        "{text}"
    );
    assert_eq!(tpf(path, &["inspect", "model.onnx", "--json"]).ok().json()[0]["contract"]["force_axes"], 3);
}

/// From a synthetic glove with shear axes to a model of three axes, its scores, and its wrenches: every step a command.
#[cfg(feature = "train")]
#[test]
fn a_glove_with_shear_is_simulated_trained_scored_and_replayed_with_three_axes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let simulate = ["simulate", "--glove", "1", "--users", "1", "--sessions", "2", "--minutes=1.7", "--seed", "5"];
    tpf(path, &[&simulate[..], &["--axes", "3", "-o", "bags"]].concat()).ok();
    // The parameters that the page of the book shows; a model of a few steps reads force in the air.
    let page = include_str!("../../docs/src/how-to/three-axes.md");
    let shown = page.split("```yaml\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
    let params = format!("{shown}    calibration.max_force: 1000.0\n");
    fs::write(path.join("shear.yaml"), &params).unwrap();
    let train = |more: &[&str]| {
        let usual =
            ["train", "bags", "--params-file", "shear.yaml", "--stride", "20", "--batch", "16", "--threads", "2"];
        tpf(path, &[&usual[..], more].concat())
    };
    for (kind, name, steps) in [("tactile-only", "model.onnx", "20"), ("pose-aware", "pose.onnx", "4")] {
        let report = train(&["--kind", kind, "--axes", "3", "--steps", steps, "-o", name, "--json"]).ok().json();
        let tangential = &report["test"]["final"]["tangential"];
        assert!(
            tangential["mae_gf"].as_f64().unwrap() > 0.0 && tangential["angle_deg"].as_f64().unwrap() > 0.0,
            "{tangential}"
        );
        assert!(report["runs"][0]["curve"][0]["loss"]["tangential"].as_f64().unwrap() > 0.0);
        let text = tpf(path, &["inspect", name]).ok().stdout;
        assert!(text.contains("force float32 [N, 3]") && text.contains("\"angle_deg\":"), "{text}");
    }
    let refused = train(&["--kind", "adaptive", "--axes", "3", "-o", "no.onnx"]);
    assert!(
        refused.failure().starts_with("--kind adaptive gives the normal force only; for --axes 3 train"),
        "{refused:?}"
    );
    // Without --axes the normal force is learned, and it is said that there is more.
    let one = train(&["--kind", "tactile-only", "--steps", "2", "-o", "one.onnx"]).ok();
    assert!(one.stderr.contains("--axes 3 trains all three"), "{one:?}");
    assert!(!tpf(path, &["inspect", "one.onnx"]).ok().stdout.contains("three axes"));
    let one_axis = params.lines().filter(|line| !line.contains("fields:") && !line.contains("signs:"));
    fs::write(path.join("one_axis.yaml"), one_axis.collect::<Vec<_>>().join("\n")).unwrap();
    let refused = ["train", "bags", "--params-file", "one_axis.yaml", "--axes", "3", "-o", "no.onnx"];
    let refused = tpf(path, &refused);
    let expected = "--axes 3 needs a true force of three axes, and truth.load_cell has one; set truth.load_cell.fields";
    assert!(refused.failure().starts_with(expected), "{refused:?}");

    let bag = "bags/glove1_user01_session2";
    let judged =
        ["eval", bag, "--params-file", "shear.yaml", "--model", "pose.onnx", "--compare", "model.onnx", "--json"];
    for score in scores(&tpf(path, &judged).ok()).iter().take(1) {
        assert!(score["tangential"]["n_frames"].as_u64().unwrap() > 100, "{score}");
    }
    // eval ran the pose-aware network; the other one is faster.
    tpf(path, &["replay", bag, "--params-file", "shear.yaml", "--model", "model.onnx", "-o", "forces.mcap"]).ok();
    let wrenches = decoded::<WrenchStamped>(&path.join("forces.mcap"), WRENCH);
    let tangential = wrenches.iter().map(|wrench| wrench.wrench.force.x.hypot(wrench.wrench.force.y));
    assert!(wrenches.len() > 5000 && tangential.filter(|force| *force > 0.01).count() > 100);
}

#[test]
fn init_takes_the_three_axes_of_a_force_sensor_for_a_model_of_three_and_one_for_a_model_of_one() {
    let folder = folder("1", "");
    let path = folder.path();
    let init = |model: &str| {
        tpf(path, &["init", BAG, "--model", model, "-o", "made.yaml", "--overwrite", "--yes"]).ok();
        fs::read_to_string(path.join("made.yaml")).unwrap()
    };
    let made = init("model.onnx");
    assert!(made.contains("fields: [wrench.force.x, wrench.force.y, wrench.force.z]"), "{made}");
    let scored = tpf(path, &["eval", BAG, "--whole", "--json", "--params-file", "made.yaml"]).ok();
    let judged = scores(&scored).pop().unwrap();
    assert!(judged["tangential"]["mae_gf"].as_f64().unwrap() > 0.0, "{judged}");
    let made = init("other.onnx");
    assert!(made.contains("field: wrench.force.z  #") && !made.contains("fields:"), "{made}");
}
