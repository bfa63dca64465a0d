//! `tpf export`: what a learning tool reads is what the bag says, at its times, and what is missing is said to be.

use crate::common;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use common::ROOT;
use common::bags::{Bag, at, decoded, stamp_of};
use common::files;
use common::onnx::LinearModel;
use common::scored;
use common::skip::python;
use common::tpf::{Run, tpf, write_params};
use serde_json::Value;
use tactile_pose_fusion::msg::{ContactArray, TaxelArray};

const CONTACTS: &str = "/tactile_pose_fusion/contacts";

fn export(folder: &Path, bags: &[&str], more: &[&str]) -> Run {
    tpf(folder, &[&["export"], bags, &["--params-file", "params.yaml"], more].concat())
}

/// What `script` tells about a file or folder.
fn read(script: &str, of: &Path) -> Option<Value> {
    let script = format!("{ROOT}/tests/python/{script}");
    let output = Command::new(python()?).arg(script).arg(of).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

fn column<'v>(table: &'v Value, name: &str) -> &'v [Value] {
    table["columns"][name].as_array().unwrap_or_else(|| panic!("no {name} in {}", table["columns"]))
}

fn stamps(table: &Value, name: &str) -> Vec<i64> {
    column(table, name).iter().map(|stamp| stamp.as_i64().unwrap()).collect()
}

/// What is in a folder, hidden files too.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// 100 Hz taxels and joints of `index` for 8 s, but for taxels from 5 s to 5.5 s and joints from 6.5 s to 7 s.
fn with_holes(folder: &Path) {
    let mut bag = Bag::create(&folder.join("holes.mcap"));
    for k in 0..800 {
        if !(650..700).contains(&k) {
            bag.joints(at(k * 10 + 3), &["pip", "dip"], &[0.5 + 0.0001 * k as f64, -0.5]);
        }
        if !(500..550).contains(&k) {
            let touch = if k < 300 { 0.0 } else { k as f32 };
            bag.taxels(at(k * 10 + 10), &[touch + (k % 5) as f32 * 0.01, 5.0 + (k % 3) as f32 * 0.01]);
        }
    }
    bag.finish();
    write_params(folder, 2, &["pip", "dip"], "");
    LinearModel::new(8, 2, 2).write(folder, "model.onnx");
}

#[test]
fn a_bag_without_estimates_gives_the_dataset_that_its_merged_replay_gives() {
    let folder = scored::folder();
    let path = folder.path();
    let bag = "bags/glove1_user01_session1";
    tpf(path, &["replay", bag, "--params-file", "params.yaml", "--merge", "-o", "merged"]).ok();
    let computed = export(path, &[bag], &["--lerobot", "computed", "--json"]).ok();
    let recorded = export(path, &["merged"], &["--lerobot", "recorded", "--json"]).ok();
    assert_eq!(computed.json()["bags"][0]["estimates"], "computed");
    assert_eq!(recorded.json()["bags"][0]["estimates"], "recorded");
    assert!(computed.stderr.contains("no estimates on /tactile_pose_fusion/contacts"), "{computed:?}");
    let (computed, recorded) = (files(&path.join("computed")), files(&path.join("recorded")));
    let names: Vec<&PathBuf> = computed.keys().collect();
    let expected = [
        "README.md",
        "data/chunk-000/file-000.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
        "meta/info.json",
        "meta/stats.json",
        "meta/tasks.parquet",
    ];
    assert_eq!(names, expected.map(Path::new));
    assert!(computed == recorded, "a file differs");
    let readme = String::from_utf8(computed[Path::new("README.md")].clone()).unwrap();
    assert!(readme.contains("**The data is synthetic**"), "{readme}");
    let info: Value = serde_json::from_slice(&computed[Path::new("meta/info.json")]).unwrap();
    assert_eq!(info["robot_type"], "synthetic");
}

#[test]
fn every_frame_has_the_newest_of_everything_at_its_time_and_nothing_from_after_it() {
    let folder = scored::folder();
    let path = folder.path();
    for user in ["01", "02"] {
        let (bag, merged) = (format!("bags/glove1_user{user}_session1"), format!("merged{user}"));
        tpf(path, &["replay", &bag, "--params-file", "params.yaml", "--merge", "-o", &merged]).ok();
    }
    let task = ["--lerobot", "dataset", "--fps", "50", "--tactile-window-ms", "40", "--task", "touch and \"move\""];
    export(path, &["merged01", "merged02"], &task).ok();
    let Some(dataset) = read("read_lerobot.py", &path.join("dataset")) else { return };
    assert_eq!(dataset["tasks"]["0"], "touch and \"move\"");
    assert_eq!((&dataset["info"]["fps"], &dataset["info"]["total_episodes"]), (&50.into(), &2.into()));
    let features = &dataset["info"]["features"];
    assert_eq!(features["observation.tactile.index"]["shape"], serde_json::json!([4, 6]));
    let joints = features["observation.state"]["names"].as_array().unwrap();
    assert!(joints.contains(&"index_pip".into()), "{joints:?}");

    let frame_stamps = stamps(&dataset, "stamp_ns");
    let (of_estimate, of_sample) = (stamps(&dataset, "stamp_ns.index"), stamps(&dataset, "tactile_stamp_ns.index"));
    let episode = stamps(&dataset, "episode_index");
    let mut n_touching = 0;
    for (idx, merged) in [(0, "merged01"), (1, "merged02")] {
        let bag = path.join(merged);
        let states: Vec<(i64, ContactArray)> = decoded::<ContactArray>(&bag, CONTACTS)
            .into_iter()
            .map(|array| (stamp_of(&array.header).0, array))
            .collect();
        let taxels: Vec<(i64, Vec<f32>)> = decoded::<TaxelArray>(&bag, "/glove/taxels")
            .into_iter()
            .flat_map(|array| {
                let newest = stamp_of(&array.header).0;
                let period = i64::from(array.row_period.sec) * 1_000_000_000 + i64::from(array.row_period.nanosec);
                let rows: Vec<_> = array.values.chunks(6).map(<[f32]>::to_vec).collect();
                let n = rows.len() as i64;
                rows.into_iter().enumerate().map(move |(row, values)| (newest - period * (n - 1 - row as i64), values))
            })
            .collect();
        for frame in (0..frame_stamps.len()).filter(|frame| episode[*frame] == idx) {
            let newest = states.iter().rev().find(|(stamp, _)| *stamp <= frame_stamps[frame]).unwrap();
            let state = &newest.1.contacts[0];
            if frame_stamps[frame] - newest.0 > 50_000_000 {
                assert_eq!(of_estimate[frame], -1);
                continue;
            }
            assert_eq!(of_estimate[frame], newest.0);
            let told = |name: &str| column(&dataset, name)[frame].as_f64().map(|value| value as f32);
            let force = Some(state.force as f32).filter(|force| force.is_finite());
            assert_eq!(told("observation.force.index"), force);
            assert_eq!(column(&dataset, "valid.index")[frame], force.is_some());
            assert_eq!(column(&dataset, "flags.index")[frame], state.flags);
            if force.is_some() {
                assert_eq!(told("observation.contact.index"), Some(f32::from(u8::from(state.contact))));
                n_touching += usize::from(state.contact);
            }
            let newest = taxels.iter().rposition(|(stamp, _)| *stamp <= frame_stamps[frame]).unwrap();
            assert_eq!(of_sample[frame], taxels[newest].0);
            let window: Vec<Option<Vec<f32>>> = column(&dataset, "observation.tactile.index")[frame]
                .as_array()
                .unwrap()
                .iter()
                .map(|row| row.as_array()?.iter().map(|value| value.as_f64().map(|value| value as f32)).collect())
                .collect();
            for (back, row) in window.iter().rev().enumerate() {
                // A window doesn't reach across a gap, and the synthetic glove loses samples now and then.
                assert!(row.as_ref().is_none_or(|row| *row == taxels[newest - back].1), "{back} back of {frame}");
            }
            assert!(window.last().unwrap().is_some());
        }
    }
    assert!(n_touching > 100, "{n_touching}");
}

#[test]
fn what_is_missing_is_nan_and_said_and_never_zero_or_the_last_value() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    with_holes(path);
    let run = export(path, &["holes.mcap"], &["--lerobot", "dataset", "--calibrate-first", "2", "--json"]).ok();
    let known = run.json()["bags"][0]["episode"]["known"]["index"].as_f64().unwrap();
    assert!((0.85..0.95).contains(&known), "{known}");
    let Some(dataset) = read("read_lerobot.py", &path.join("dataset")) else { return };
    // Samples at 5.00 s and 5.51 s; a value stands for 50 ms, and a window of 8 frames must fill again.
    let frames = stamps(&dataset, "stamp_ns");
    let within = |from: f64, to: f64| {
        let start = at(0).0 as f64;
        let inside = move |stamp: i64| (from..to).contains(&((stamp as f64 - start) * 1e-9));
        (0..frames.len()).filter(|idx| inside(frames[*idx])).collect::<Vec<_>>()
    };
    let (before, hole, after) = (within(3.0, 5.0), within(5.06, 5.5), within(5.7, 6.5));
    assert!(before.len() > 50 && hole.len() > 10 && after.len() > 20);
    for name in ["observation.force.index", "observation.contact.index", "observation.artifact.index"] {
        assert!(before.iter().chain(&after).all(|idx| column(&dataset, name)[*idx].is_number()), "{name}");
        assert!(hole.iter().all(|idx| column(&dataset, name)[*idx].is_null()), "{name}");
    }
    for idx in &hole {
        assert_eq!(column(&dataset, "valid.index")[*idx], false);
        assert_eq!(stamps(&dataset, "stamp_ns.index")[*idx], -1);
        assert_eq!(stamps(&dataset, "tactile_stamp_ns.index")[*idx], -1);
        assert!(
            column(&dataset, "observation.tactile.index")[*idx]
                .to_string()
                .replace(['[', ']', ','], "")
                .replace("null", "")
                .is_empty()
        );
    }
    // Joints: an angle stands for max_pose_age_ms, 50.
    let state = column(&dataset, "observation.state");
    assert!(within(6.56, 7.0).iter().all(|idx| state[*idx] == serde_json::json!([null, null])));
    assert!(within(5.0, 6.5).iter().all(|idx| state[*idx][1].as_f64() == Some(-0.5)));
    let first = frames[0] - at(0).0;
    assert!((80_000_000..120_000_000).contains(&first), "from when a window of 10 samples is full: {first}");
}

#[test]
fn tables_hold_every_frame_of_the_bag_and_the_truth() {
    let folder = scored::folder();
    let path = folder.path();
    let bag = "bags/glove1_user01_session1";
    tpf(path, &["replay", bag, "--params-file", "params.yaml", "--merge", "-o", "merged"]).ok();
    let tables = ["--parquet", "frames.parquet", "--csv", "frames.csv"];
    export(path, &["merged"], &tables).ok();
    let states = decoded::<ContactArray>(&path.join("merged"), CONTACTS);
    let text = fs::read_to_string(path.join("frames.csv")).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = lines.next().unwrap();
    let rows: Vec<Vec<&str>> = lines.collect();
    assert_eq!(rows.len(), states.len());
    let cell = |row: &[&str], name: &str| row[header.iter().position(|known| *known == name).unwrap()].to_owned();
    let mut n_true = 0;
    for (row, array) in rows.iter().zip(&states) {
        let state = &array.contacts[0];
        assert_eq!(cell(row, "stamp"), stamp_of(&array.header).0.to_string());
        assert_eq!(cell(row, "force_n").parse().ok(), Some(state.force).filter(|force| force.is_finite()));
        assert_eq!(cell(row, "artifact_n").parse().ok(), Some(state.artifact).filter(|force| force.is_finite()));
        assert_eq!((cell(row, "region").as_str(), cell(row, "synthetic").as_str()), ("index", "true"));
        n_true += usize::from(cell(row, "truth_n").parse::<f64>().is_ok_and(|force| force > 0.5));
    }
    assert!(n_true > 100, "{n_true} frames of touches");
    assert!(rows.iter().any(|row| cell(row, "joint.index_pip").parse::<f64>().is_ok()));

    let again = export(path, &["merged"], &tables);
    assert!(again.failure().contains("frames.parquet is there already"), "{again:?}");
    let first = fs::read(path.join("frames.parquet")).unwrap();
    export(path, &["merged"], &[&tables[..], &["--overwrite"]].concat()).ok();
    assert!(fs::read(path.join("frames.parquet")).unwrap() == first, "two runs write the same bytes");
    let Some(parquet) = read("read_parquet.py", &path.join("frames.parquet")) else { return };
    assert_eq!(parquet["notes"]["synthetic"], "true");
    for (idx, name) in header.iter().enumerate() {
        for (row, told) in rows.iter().zip(column(&parquet, name)) {
            let same = match told {
                Value::Null => row[idx].is_empty(),
                Value::String(text) => row[idx] == text,
                Value::Number(number) => row[idx].parse::<f64>().ok() == number.as_f64(),
                Value::Bool(flag) => row[idx].parse() == Ok(*flag),
                other => panic!("{other}"),
            };
            assert!(same, "{name}: {told} and {}", row[idx]);
        }
    }
}

#[test]
fn a_bag_that_cannot_be_exported_is_named_and_the_others_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    with_holes(path);
    let mut other = Bag::create(&path.join("other_joints.mcap"));
    let mut slow = Bag::create(&path.join("slow.mcap"));
    let mut looped = Bag::create(&path.join("looped.mcap"));
    for k in 0..300 {
        other.joints(at(k * 10), &["pip", "dip", "wrist"], &[0.1, 0.2, 0.3]);
        other.taxels(at(k * 10), &[1.0 + (k % 5) as f32, (k % 3) as f32]);
        slow.joints(at(k * 10), &["pip", "dip"], &[0.1, 0.2]);
        if k % 2 == 0 {
            slow.taxels(at(k * 10), &[1.0 + (k % 5) as f32, (k % 3) as f32]);
        }
        looped.joints(at(k % 200 * 10), &["pip", "dip"], &[0.1, 0.2]);
        looped.taxels(at(k % 200 * 10), &[1.0 + (k % 5) as f32, (k % 3) as f32]);
    }
    [other, slow, looped].into_iter().for_each(Bag::finish);
    let bags = ["holes.mcap", "other_joints.mcap", "slow.mcap", "looped.mcap"];
    let run = export(path, &bags, &["--lerobot", "dataset", "--calibrate-first", "2", "--json"]);
    assert_eq!(run.code, 3, "{run:?}");
    let failed = run.json()["failed"].as_array().unwrap().clone();
    let expected = ["it has the joints dip, pip, wrist", "sends 50 samples a second", "jump back by 1.99 s"];
    assert_eq!(failed.len(), expected.len(), "{failed:?}");
    for ((failed, bag), words) in failed.iter().zip(&bags[1..]).zip(expected) {
        assert_eq!(failed["bag"], *bag);
        let error = failed["error"].as_str().unwrap();
        assert!(error.contains(words) && error.starts_with(bag) && !error.contains('\n'), "{error}");
        assert!(run.stderr.contains(&format!("not exported: {error}")), "{run:?}");
    }
    assert_eq!(run.json()["bags"].as_array().unwrap().len(), 1);
    let Some(dataset) = read("read_lerobot.py", &path.join("dataset")) else { return };
    assert_eq!(dataset["info"]["total_episodes"], 1);
}

#[test]
fn what_cannot_work_is_one_line_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    with_holes(path);
    fs::create_dir(path.join("there")).unwrap();
    let before = names(path);
    let refused = |more: &[&str], words: &str| {
        let run = export(path, &["holes.mcap"], more);
        assert!(run.failure().contains(words), "{words}: {run:?}");
        assert_eq!(names(path), before, "{more:?}");
    };
    refused(&["--lerobot", "there"], "a dataset is never replaced");
    refused(&["--lerobot", "no/such/folder"], "no/such/folder");
    refused(
        &["--lerobot", "dataset", "--fps", "200", "--calibrate-first", "2"],
        "--fps 200 is faster than tactile source glove, which comes 100 times",
    );
    refused(
        &["--lerobot", "dataset", "--tactile-window-ms", "4", "--calibrate-first", "2"],
        "is 0 samples of tactile source glove",
    );
    refused(&["--parquet", "no/such/frames.parquet"], "frames.parquet");
    let usage = export(path, &["holes.mcap"], &[]);
    assert!(usage.code == 2 && usage.stderr.contains("--lerobot"), "{usage:?}");

    fs::remove_file(path.join("model.onnx")).unwrap();
    let run = export(path, &["holes.mcap"], &["--lerobot", "dataset"]);
    assert!(run.failure().contains("model.onnx"), "{run:?}");
    assert!(!path.join("dataset").exists());
}

#[test]
fn a_zero_that_looks_loaded_is_refused_unless_the_parameters_insist() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    with_holes(path);
    let at_rest = export(path, &["holes.mcap"], &["--csv", "rest.csv", "--calibrate-first", "2"]).ok();
    assert!(!at_rest.stderr.contains("loaded"), "{at_rest:?}");
    let loaded = export(path, &["holes.mcap"], &["--csv", "loaded.csv", "--calibrate-first", "4"]);
    assert!(loaded.failure().starts_with("holes.mcap: region index: calibration looks loaded"), "{loaded:?}");
    let insisted = ["--csv", "loaded.csv", "--calibrate-first", "4", "-p", "calibration.insist:=true"];
    let insisted = export(path, &["holes.mcap"], &insisted).ok();
    assert!(insisted.stderr.contains("used all the same, because calibration.insist is set"), "{insisted:?}");
}

#[test]
fn a_bag_with_estimates_needs_no_model() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    with_holes(path);
    let replay = ["replay", "holes.mcap", "--params-file", "params.yaml", "--merge", "--calibrate-first", "2"];
    tpf(path, &[&replay[..], &["-o", "merged.mcap"]].concat()).ok();
    fs::remove_file(path.join("model.onnx")).unwrap();
    export(path, &["merged.mcap"], &["--lerobot", "dataset"]).ok();
}

#[test]
fn a_bag_that_was_cut_off_is_exported_as_far_as_it_goes_and_leaves_with_3() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    with_holes(path);
    let bytes = fs::read(path.join("holes.mcap")).unwrap();
    fs::write(path.join("cut.mcap"), &bytes[..bytes.len() - 3000]).unwrap();
    let run = export(path, &["cut.mcap"], &["--lerobot", "dataset", "--calibrate-first", "2", "--json"]);
    assert_eq!(run.code, 3, "{run:?}");
    assert!(!run.json()["bags"][0]["losses"].as_array().unwrap().is_empty());
    assert!(path.join("dataset/meta/info.json").exists());
}
