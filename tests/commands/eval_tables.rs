//! Scores and frames as Parquet, read back by pyarrow.

use crate::common;

use std::path::Path;
use std::process::Command;

use common::ROOT;
use common::scored::folder;
use common::skip::python;
use common::tpf::tpf;
use serde_json::Value;

fn read(table: &Path) -> Option<Value> {
    let script = &format!("{ROOT}/tests/python/read_parquet.py");
    let output = Command::new(python()?).arg(script).arg(table).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

fn column<'v>(table: &'v Value, name: &str) -> &'v [Value] {
    table["columns"][name].as_array().unwrap_or_else(|| panic!("no {name}: {}", table["types"]))
}

#[test]
fn pyarrow_reads_the_scores_of_the_json_and_the_frames_that_give_them() {
    let folder = folder();
    let path = folder.path();
    let command = ["eval", "bags", "--params-file", "params.yaml", "--whole", "--json", "--model", "model.onnx"];
    let tables = ["--compare", "other.onnx", "--parquet", "scores.parquet", "--frames", "frames.parquet"];
    let found = tpf(path, &[&command[..], &tables].concat()).ok().json();
    let again = tpf(path, &[&command[..], &tables].concat());
    assert!(again.code == 1 && again.stderr.contains("scores.parquet is there already"), "{again:?}");

    let Some(scores) = read(&path.join("scores.parquet")) else { return };
    assert_eq!(scores["notes"]["synthetic"], "true");
    let mut n_rows = 0;
    for model in found["models"].as_array().unwrap() {
        for (part, is_free) in [("by", false), ("free_movement", true)] {
            for (by, groups) in model[part].as_object().unwrap() {
                for group in groups.as_array().unwrap() {
                    n_rows += 1;
                    let is_it = |row: &usize| {
                        column(&scores, "model")[*row] == model["name"]
                            && column(&scores, "by")[*row] == by.as_str()
                            && column(&scores, "free_movement")[*row] == is_free
                            && ["glove", "user", "session", "stage", "substage"]
                                .iter()
                                .all(|key| column(&scores, key)[*row] == group[*key])
                    };
                    let rows: Vec<usize> = (0..column(&scores, "model").len()).filter(is_it).collect();
                    let [row] = rows[..] else { panic!("{rows:?} of {group}") };
                    for key in ["ba", "f1", "mae_gf", "r2"] {
                        assert_eq!(column(&scores, key)[row].as_f64(), group[key].as_f64(), "{key}");
                    }
                    assert_eq!(column(&scores, "mdf_gf")[row].as_f64(), group["mdf"]["force_gf"].as_f64());
                    assert_eq!(column(&scores, "n_scored")[row], group["coverage"]["n_scored"]);
                }
            }
        }
    }
    assert_eq!(column(&scores, "model").len(), n_rows);

    let frames = read(&path.join("frames.parquet")).unwrap();
    assert_eq!(frames["types"]["stamp"], "timestamp[ns, tz=UTC]");
    for model in found["models"].as_array().unwrap() {
        let of_model =
            (0..column(&frames, "model").len()).filter(|row| column(&frames, "model")[*row] == model["name"]);
        let number = |name: &str, row: usize| column(&frames, name)[row].as_f64();
        let errors = of_model.filter_map(|row| Some((number("estimate_gf", row)? - number("truth_gf", row)?).abs()));
        let (n, sum) = errors.fold((0u64, 0.0), |(n, sum), error| (n + 1, sum + error));
        let all = &model["by"]["all"][0];
        assert_eq!(Some(n), all["coverage"]["n_scored"].as_u64());
        // Summed in another order.
        assert!((sum / n as f64 / all["mae_gf"].as_f64().unwrap() - 1.0).abs() < 1e-12);
    }
    let stamps: Vec<i64> = column(&frames, "stamp").iter().map(|stamp| stamp.as_i64().unwrap()).collect();
    assert!(stamps.iter().all(|stamp| *stamp > 0) && column(&frames, "zero_load").contains(&Value::Bool(true)));
    assert!(column(&frames, "pose").iter().any(|pose| pose == "bend"));
}
