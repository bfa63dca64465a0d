//! The page of `tpf eval --report`, looked at in a browser.

use crate::common;

use std::fs;
use std::path::Path;

use common::browser::look;
use common::scored::{PARAMS, folder};
use common::tpf::tpf;
use serde_json::Value;

fn report(folder: &Path, more: &[&str]) -> Value {
    let command = ["eval", "bags", "--params-file", "params.yaml", "--whole", "--json", "--report", "r.html"];
    tpf(folder, &[&command[..], more].concat()).ok().json()
}

fn rows<'v>(seen: &'v Value, table: &str) -> &'v [Value] {
    seen["tables"][table].as_array().unwrap_or_else(|| panic!("no {table}: {}", seen["tables"]))
}

#[test]
fn every_plot_is_drawn_and_every_value_is_that_of_the_json() {
    let folder = folder();
    let path = folder.path();
    fs::write(path.join("gates.yaml"), "gates: [{metric: mae_gf, by: all, at_most: 1.0e+6}]").unwrap();
    let more = ["--model", "model.onnx", "--compare", "other.onnx", "--pose-noise-deg", "5,40", "--gate", "gates.yaml"];
    let found = report(path, &more);
    let html = fs::read_to_string(path.join("r.html")).unwrap();
    assert!(html.contains("SYNTHETIC DATA") && html.contains("Evaluation of model (synthetic)"));
    let Some(seen) = look(&path.join("r.html")) else { return };
    let seen = &seen["wide"];
    let ids: Vec<&str> = seen["plots"].as_array().unwrap().iter().map(|plot| plot["id"].as_str().unwrap()).collect();
    for id in ["ba-1", "mae-1", "pairs-0-ba", "pairs-0-mae", "onset-1", "offset-1", "air-1", "air-force-1", "pose-1"] {
        assert!(ids.contains(&id), "{id}: {ids:?}");
    }
    for kind in ["best", "median", "worst"] {
        assert!(ids.contains(&format!("stretch-{kind}").as_str()), "{kind}: {ids:?}");
    }
    for plot in seen["plots"].as_array().unwrap() {
        let words = plot["words"].as_array().unwrap();
        assert!(words.iter().any(|word| word == "synthetic data"), "every picture says what it is of: {plot}");
    }

    for (table, of) in [("table-scores", "table"), ("table-free", "free_movement_table")] {
        let models = found[of]["rows"].as_array().unwrap();
        assert_eq!(rows(seen, table).len(), models.len());
        for (row, model) in rows(seen, table).iter().zip(models) {
            let cell = &model["cells"][0];
            assert_eq!(row[0]["text"], format!("1, {}", model["model"].as_str().unwrap()));
            for (column, key) in [(1, "ba"), (2, "f1"), (4, "mae_gf"), (5, "r2")] {
                assert_eq!(row[column]["value"].as_f64(), cell[key].as_f64(), "{table} {key}");
            }
            assert_eq!(row[3]["value"].as_f64(), cell["mdf"]["force_gf"].as_f64());
            assert_eq!(row[6]["value"].as_f64(), cell["coverage"]["n_scored"].as_f64());
        }
    }
    let models = found["models"].as_array().unwrap();
    for (row, model) in rows(seen, "table-contact").iter().zip(models) {
        let detection = &model["contacts"]["1"]["detection"];
        assert_eq!(row[1]["value"].as_f64(), detection["n_true"].as_f64());
        assert_eq!(row[2]["value"].as_f64(), detection["n_missed"].as_f64());
        assert_eq!(row[3]["value"].as_f64(), detection["air"]["per_minute"].as_f64());
        assert_eq!(row[5]["value"].as_f64(), detection["onset_ms"]["p95"].as_f64());
    }
    for (row, model) in rows(seen, "table-in-air").iter().zip(models) {
        let in_air = &model["contacts"]["1"]["in_air"];
        assert_eq!(row[2]["value"].as_f64(), in_air["n_false_touches"].as_f64());
        assert_eq!(row[5]["value"].as_f64(), in_air["abs_force_gf"]["p95"].as_f64());
    }
    for (row, session) in rows(seen, "table-timing").iter().zip(found["sessions"].as_array().unwrap()) {
        let timing = &session["timing"]["index"];
        assert_eq!(row[3]["value"].as_f64(), timing["rate_hz"].as_f64());
        assert_eq!(row[9]["value"].as_f64(), timing["pose_age_ms"]["max"].as_f64());
    }
    for (row, test) in rows(seen, "table-paired-0").iter().zip(found["paired"][0]["tests"].as_array().unwrap()) {
        assert_eq!(row[1]["value"].as_f64(), test["n_improved"].as_f64());
        assert_eq!(row[2]["value"].as_f64(), test["wilcoxon"]["p"].as_f64());
    }
    assert_eq!(rows(seen, "table-gates")[0][3]["text"], "passed");
    let text = seen["text"].as_str().unwrap();
    for told in ["eval bags --params-file params.yaml", found["sessions"][0]["sha256"].as_str().unwrap()] {
        assert!(text.contains(told), "{told}");
    }
}

#[test]
fn a_page_without_true_force_says_what_is_missing() {
    let folder = folder();
    let path = folder.path();
    fs::write(path.join("params.yaml"), PARAMS.replace("/load_cell/wrench", "/absent")).unwrap();
    report(path, &["--model", "model.onnx"]);
    let Some(seen) = look(&path.join("r.html")) else { return };
    let text = seen["wide"]["text"].as_str().unwrap();
    assert!(text.contains("Missing: no true force, so no scores: the bag has no topic /absent (all 2 sessions)"));
    assert!(text.contains("In the air") && text.contains("Timing"));
    let tables = seen["wide"]["tables"].as_object().unwrap();
    assert!(tables.contains_key("table-in-air") && !tables.contains_key("table-scores"), "{tables:?}");
}

#[test]
fn a_report_that_is_there_is_not_replaced_unasked() {
    let folder = folder();
    let path = folder.path();
    fs::write(path.join("r.html"), "mine").unwrap();
    let command = ["eval", "bags", "--params-file", "params.yaml", "--model", "model.onnx", "--report", "r.html"];
    let refused = tpf(path, &command);
    assert_eq!(refused.code, 1);
    assert!(refused.failure().contains("r.html is there already; give another name, or --overwrite"), "{refused:?}");
    assert_eq!(fs::read_to_string(path.join("r.html")).unwrap(), "mine");
    tpf(path, &[&command[..], &["--overwrite"]].concat()).ok();
    assert!(fs::read_to_string(path.join("r.html")).unwrap().starts_with("<!DOCTYPE html>"));
}
