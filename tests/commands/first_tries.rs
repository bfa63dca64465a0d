//! What people try first, and get wrong.

use std::fs;
use std::path::Path;

use crate::common::ROOT;
use crate::common::tpf::{Run, tpf};

const BAG: &str = "sessions/glove3_user01_session1";

/// A folder with a session of glove 3, and parameters that don't name the glove.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let simulate = ["simulate", "--glove", "3", "--users", "1", "--sessions", "1", "--minutes=1.7", "--seed", "5"];
    tpf(folder.path(), &[&simulate[..], &["-o", "sessions"]].concat()).ok();
    let params = fs::read_to_string(Path::new(ROOT).join("params/glove3.yaml")).unwrap();
    let params = params.replace("../models", &format!("{ROOT}/models"));
    let params: Vec<&str> = params.lines().filter(|line| !line.trim_start().starts_with("glove: synthetic")).collect();
    fs::write(folder.path().join("glove.yaml"), params.join("\n")).unwrap();
    folder
}

fn model(name: &str) -> String {
    format!("{ROOT}/models/{name}.onnx")
}

fn replay(folder: &Path, args: &[&str]) -> Run {
    tpf(folder, &[&["replay", BAG, "--params-file", "glove.yaml", "--overwrite"], args].concat())
}

#[test]
fn the_folder_above_names_the_bags_in_it_and_a_table_is_no_name_of_a_bag() {
    let folder = folder();
    let above = tpf(folder.path(), &["replay", "sessions", "--params-file", "glove.yaml", "-o", "out.mcap"]);
    assert!(above.failure().ends_with(&format!("folders in it are bags, name one: {BAG}")), "{above:?}");
    let table = replay(folder.path(), &["-o", "forces.csv"]);
    assert!(table.failure().starts_with("forces.csv: a bag is written, to a file NAME.mcap or a folder"), "{table:?}");
    assert!(!folder.path().join("forces.csv").exists());
    let absent = replay(folder.path(), &["-o", "out.mcap", "--model", "fingertip.onnx"]);
    assert!(absent.failure().contains("train one of this glove with tpf train"), "{absent:?}");
}

#[test]
fn a_model_of_another_glove_and_a_zero_of_everything_are_told() {
    let folder = folder();
    let other = replay(folder.path(), &["-o", "out.mcap", "--model", &model("glove1_adaptive")]).ok();
    let told = format!("{}{}", other.stdout, other.stderr);
    assert!(told.contains("was trained on glove synthetic-1, and the recording is of glove synthetic-3"), "{told}");
    let own = replay(folder.path(), &["-o", "out.mcap", "--model", &model("glove3_adaptive")]).ok();
    assert!(!format!("{}{}", own.stdout, own.stderr).contains("was trained on"), "{own:?}");
    let all =
        ["-o", "out.mcap", "-p", "stage_topic:=/none", "-p", "calibration.insist:=true", "--calibrate-first", "150"];
    let all = replay(folder.path(), &all).ok();
    assert!(all.stderr.contains(" s of the taxels are taken as zero load"), "{all:?}");
}

#[test]
fn joints_that_never_come_are_named_for_adaptive_models_too() {
    let folder = folder();
    let joints = ["-o", "out.mcap", "--model", &model("glove3_adaptive"), "-p", "region.index.joints:=[a, b, c, d]"];
    let wrong = replay(folder.path(), &joints);
    assert!(wrong.failure().contains("its joints a, b, c, d are in no message; other joints that are: "), "{wrong:?}");
    assert!(wrong.failure().contains("index_pip"), "{wrong:?}");
}

#[test]
fn a_table_is_exported_by_the_end_of_its_name() {
    let folder = folder();
    replay(folder.path(), &["-o", "out.mcap", "--merge", "--model", &model("glove3_adaptive")]).ok();
    let export = |name: &str| tpf(folder.path(), &["export", "out.mcap", "--params-file", "glove.yaml", "-o", name]);
    export("forces.csv").ok();
    let table = fs::read_to_string(folder.path().join("forces.csv")).unwrap();
    assert!(table.lines().next().unwrap().contains("force_n") && table.lines().count() > 1000, "{table:.300}");
    let other = export("forces.txt");
    assert!(other.stderr.contains("expected a name that ends in .csv or .parquet"), "{other:?}");
    assert!(!folder.path().join("forces.txt").exists());
}

#[test]
#[cfg(feature = "train")]
fn taxels_are_not_their_own_truth() {
    let folder = folder();
    let eval = ["eval", BAG, "--params-file", "glove.yaml", "-p", "truth.load_cell.topic:=/glove/taxels"];
    let set = tpf(folder.path(), &eval);
    assert!(set.failure().contains("taxels can't be their own true force"), "{set:?}");
    let train = ["train", BAG, "--params-file", "glove.yaml", "--truth", "/glove/taxels", "-o", "m.onnx"];
    let circular = tpf(folder.path(), &train);
    assert!(circular.failure().contains("taxels can't be their own true force"), "{circular:?}");
}

#[test]
fn recorded_estimates_without_a_base_are_compared_with_none() {
    let folder = folder();
    replay(folder.path(), &["-o", "out.mcap", "--merge", "--model", &model("glove3_adaptive")]).ok();
    let scored = tpf(folder.path(), &["eval", "out.mcap", "--params-file", "glove.yaml", "--whole", "--json"]).json();
    let names: Vec<&str> =
        scored["models"].as_array().unwrap().iter().map(|one| one["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["recorded"]);
}
