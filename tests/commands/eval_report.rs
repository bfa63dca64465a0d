//! The page of `tpf eval --report`, looked at in a browser.

use crate::common;

use std::fs;
use std::path::Path;

use common::ROOT;
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
    let of_truth = ["density-1-judged", "density-1-first", "bias-1", "gain"];
    for id in of_truth.iter().chain(&["ba-1", "mae-1", "pairs-0-ba", "pairs-0-mae"]) {
        assert!(ids.contains(id), "{id}: {ids:?}");
    }
    for id in ["onset-1", "offset-1", "air-1", "air-force-1", "pose-1"] {
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
    let tests = found["paired"][0]["tests"].as_array().unwrap();
    let of_several = tests.iter().filter(|test| test["pairs"].as_array().unwrap().len() > 1);
    for (row, test) in rows(seen, "table-paired-0").iter().zip(of_several) {
        assert_eq!(row[1]["value"].as_f64(), test["n_improved"].as_f64());
        assert_eq!(row[2]["value"].as_f64(), test["wilcoxon"]["p"].as_f64());
    }
    assert_eq!(rows(seen, "table-gates")[0][3]["text"], "passed");
    let text = seen["text"].as_str().unwrap();
    for told in ["eval bags --params-file params.yaml", found["sessions"][0]["sha256"].as_str().unwrap()] {
        assert!(text.contains(told), "{told}");
    }
}

/// Points of a series of a plot.
fn series<'v>(seen: &'v Value, plot: &str, name: &str) -> &'v Value {
    let plots = seen["plots"].as_array().unwrap();
    let plot = plots.iter().find(|one| one["id"] == plot).unwrap_or_else(|| panic!("no plot {plot}"));
    plot["data"]
        .as_array()
        .unwrap()
        .iter()
        .find(|one| one["name"] == name)
        .unwrap_or_else(|| panic!("no {name}: {plot}"))
}

#[test]
fn what_is_plotted_against_the_truth_is_in_the_json() {
    let folder = folder();
    let found = report(folder.path(), &["--model", "model.onnx", "--compare", "other.onnx"]);
    let Some(seen) = look(&folder.path().join("r.html")) else { return };
    let seen = &seen["wide"];
    for model in found["models"].as_array().unwrap() {
        let name = model["name"].as_str().unwrap();
        let curve = &model["curves"]["1"];
        let bias = series(seen, "bias-1", name);
        assert_eq!(bias["y"][0], curve["no_touch"]["bias_gf"], "the first point is the air");
        assert_eq!(bias["y"][1], curve["bins"][0]["bias_gf"]);
        let gains = series(seen, "gain", name);
        for (idx, session) in model["by"]["session"].as_array().unwrap().iter().enumerate() {
            assert_eq!((&gains["x"][idx], &gains["y"][idx]), (&session["force_gain"], &session["session"]));
        }
        let frames = model["densities"]["1"]["frames"].as_array().unwrap();
        let of = |frames: &Value| frames.as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect::<Vec<u64>>();
        let n_frames: u64 = frames.iter().flat_map(of).sum();
        assert_eq!(n_frames, model["by"]["all"][0]["coverage"]["n_scored"].as_u64().unwrap());
    }
    let judged = found["models"].as_array().unwrap().last().unwrap();
    let plot = seen["plots"].as_array().unwrap().iter().find(|plot| plot["id"] == "density-1-judged").unwrap();
    for (truth, frames) in judged["densities"]["1"]["frames"].as_array().unwrap().iter().enumerate() {
        let frames: Vec<f64> = frames.as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect();
        let all: f64 = frames.iter().sum();
        for (estimate, n) in frames.iter().enumerate().filter(|(_, n)| **n > 0.0) {
            let shown = plot["data"][0]["z"][estimate][truth].as_f64().unwrap();
            assert!((shown - 100.0 * n / all).abs() < 1e-9, "{truth} {estimate}: {shown}");
        }
    }
    let air = judged["contacts"]["1"]["in_air"]["by_pose"].as_object().unwrap();
    let bars = series(seen, "air-1", "model");
    for (pose, rate) in bars["y"].as_array().unwrap().iter().zip(bars["x"].as_array().unwrap()) {
        assert_eq!(air[pose.as_str().unwrap()]["per_minute"].as_f64(), rate.as_f64(), "{pose}");
    }
}

#[test]
fn the_verdict_comes_first_with_its_numbers_and_ends_the_text() {
    let folder = folder();
    let path = folder.path();
    let gate = |limit: &str| {
        fs::write(path.join("gates.yaml"), format!("gates: [{{metric: mae_gf, by: all, at_most: {limit}}}]")).unwrap();
    };
    gate("1.0e+6");
    let compare = ["--model", "model.onnx", "--compare", "other.onnx", "--gate", "gates.yaml", "--overwrite"];
    let found = report(path, &compare);
    let headline = &found["headline"];
    assert_eq!((headline["from"].as_str(), headline["to"].as_str()), (Some("other"), Some("model")), "{headline}");
    let text = [&["eval", "bags", "--params-file", "params.yaml", "--whole"][..], &compare].concat();
    let said = tpf(path, &text).ok().stdout;
    let verdict = said.lines().last().unwrap();
    let judged = found["models"].as_array().unwrap().last().unwrap();
    let mae = format!("{:.2} gF", judged["by"]["all"][0]["mae_gf"].as_f64().unwrap());
    for told in
        ["model against other (SYNTHETIC data, glove 1)", &mae, "mean absolute error (MAE)", "All gates passed (1)"]
    {
        assert!(verdict.contains(told), "{told}: {verdict}");
    }
    let html = fs::read_to_string(path.join("r.html")).unwrap();
    assert!(html.len() < 3_000_000, "{} bytes", html.len());
    let at = |text: &str| html.find(text).unwrap_or_else(|| panic!("no {text}"));
    let order = ["id=\"verdict\"", "id=\"truth\"", "id=\"in-air\"", "id=\"scores\"", "id=\"origin\""];
    assert!(order.map(at).is_sorted());
    gate("0.0");
    let failed = tpf(path, &text);
    assert_eq!(failed.code, 1, "{failed:?}");
    assert!(failed.stdout.lines().last().unwrap().contains("1 of 1 gates FAILED"), "{failed:?}");
    // A single model without a base has nothing to be better than.
    let tactile_only = &format!("{ROOT}/models/glove1_tactile_only.onnx");
    let alone = tpf(path, &["eval", "bags", "--params-file", "params.yaml", "--whole", "--model", tactile_only]).ok();
    assert!(alone.stdout.lines().last().unwrap().contains("nothing to compare it with"), "{alone:?}");
}

#[test]
fn of_one_user_there_are_no_statistics() {
    let folder = folder();
    let path = folder.path();
    let bag = fs::read_dir(path.join("bags")).unwrap().next().unwrap().unwrap().path();
    let command = ["eval", bag.to_str().unwrap(), "--params-file", "params.yaml", "--whole", "--report", "r.html"];
    let run = tpf(path, &[&command[..], &["--model", "model.onnx", "--compare", "other.onnx"]].concat()).ok();
    let html = fs::read_to_string(path.join("r.html")).unwrap();
    for told in ["id=\"users\"", "Wilcoxon", "id=\"gain\""] {
        assert!(!html.contains(told) && !run.stdout.contains(told), "{told}");
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
    assert!(text.contains("False touches in the air, by pose") && text.contains("Timing"));
    assert!(
        text.contains(
            "No scores, because the true force is missing. model against model, base (SYNTHETIC data, glove 1)"
        ),
        "{text}"
    );
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
