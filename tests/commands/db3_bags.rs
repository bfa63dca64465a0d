//! Whatever takes a bag takes rosbag2's `.db3`, and gives the same of it as of the same data in MCAP.

use crate::common;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use common::ROOT;
use common::bags::{Bag, Recorded, messages};
use common::sqlite::as_sqlite;
use common::tpf::{Run, tpf};

/// Two folders, each with the same recording as a bag folder `session`: in MCAP, and as `.db3`.
fn workplaces(folder: &Path) -> [PathBuf; 2] {
    let args =
        ["simulate", "--glove", "1", "--users", "1", "--sessions", "1", "--minutes=1.7", "--seed", "7", "-o", "made"];
    tpf(folder, &args).ok();
    let made = folder.join("made/glove1_user01_session1");
    let recorded = fs::read_dir(made).unwrap().map(|entry| entry.unwrap().path());
    let recorded = recorded.into_iter().find(|path| path.extension().is_some_and(|it| it == "mcap")).unwrap();
    let places = ["mcap", "db3"].map(|kind| folder.join(kind));
    places.iter().for_each(|place| fs::create_dir_all(place.join("session")).unwrap());
    // Without the records of the simulator, which a .db3 file has no place for.
    let plain = places[0].join("session/session.mcap");
    let mut bag = Bag::create(&plain);
    messages(&recorded).iter().for_each(|message| bag.send_recorded(message));
    bag.finish();
    as_sqlite(&plain, &places[1].join("session/session.db3"));
    places
}

/// Runs a command in both, and returns what it wrote.
fn both(places: &[PathBuf; 2], args: &[&str]) -> [Run; 2] {
    let [a, b] = places.each_ref().map(|place| tpf(place, args).ok());
    [a, b]
}

/// The files below a folder, by their paths.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(&next).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => folders.push(path),
                false => {
                    found.insert(path.strip_prefix(folder).unwrap().to_path_buf(), fs::read(&path).unwrap());
                }
            }
        }
    }
    found
}

/// JSON without what says of which bytes a bag is: its hash, its size and its format.
fn without_bytes(mut value: serde_json::Value) -> serde_json::Value {
    match &mut value {
        serde_json::Value::Object(map) => {
            for key in ["sha256", "bytes", "size", "bag_sha256", "format", "compression", "chunks"] {
                map.remove(key);
            }
            map.values_mut().for_each(|inner| *inner = without_bytes(inner.take()));
        }
        serde_json::Value::Array(list) => list.iter_mut().for_each(|inner| *inner = without_bytes(inner.take())),
        _ => {}
    }
    value
}

#[test]
fn every_command_gives_the_same_of_a_db3_bag_as_of_the_same_data_in_mcap() {
    let folder = tempfile::tempdir().unwrap();
    let places = workplaces(folder.path());
    let at = |name: &str| places.each_ref().map(|place| fs::read(place.join(name)).unwrap());
    let params = &format!("{ROOT}/params/glove1.yaml");
    let model = &format!("{ROOT}/models/glove1_pose_aware.onnx");
    // The bag is read before the network, and the paper's takes most of the time.
    let quick = &format!("model.fingertip.path:={ROOT}/models/glove1_adaptive.onnx");
    let usual = ["--params-file", params, "-p", "model.fingertip.backend:=builtin", "-p", quick];
    let run = |args: &[&str]| both(&places, &[args, &usual].concat());
    let assert_same = |name: &str| {
        let [a, b] = at(name);
        assert!(a == b, "{name} differs");
    };

    let [a, b] = both(&places, &["inspect", "session", "--json"]);
    let told = |run: &Run| without_bytes(run.json())[0]["topics"].clone();
    assert_eq!(told(&a), told(&b));
    assert!(told(&a).as_array().is_some_and(|topics| topics.len() == 4), "{a:?}");

    both(&places, &["init", "session", "--model", model, "-o", "made.yaml"]);
    assert_same("made.yaml");

    run(&["calibrate", "session", "-o", "zero.yaml"]);
    run(&["replay", "session", "-o", "out.mcap"]);
    assert_same("out.mcap");
    run(&["replay", "session", "--merge", "-o", "merged.mcap"]);
    let by_topic = |place: &PathBuf| {
        let mut of = BTreeMap::<String, Vec<Recorded>>::new();
        messages(&place.join("merged.mcap"))
            .into_iter()
            .for_each(|it| of.entry(it.topic.clone()).or_default().push(it));
        of
    };
    let [a, b] = places.each_ref().map(by_topic);
    assert!(a == b && a.len() == 6, "{:?}", a.keys());

    let [a, b] = run(&["eval", "session", "--json"]);
    assert_eq!(without_bytes(a.json()), without_bytes(b.json()));
    let [a, b] = run(&["characterize", "session", "--json"]);
    assert_eq!(without_bytes(a.json()), without_bytes(b.json()));

    run(&["export", "session", "--csv", "frames.csv"]);
    assert_same("frames.csv");
    run(&["export", "session", "--lerobot", "dataset", "--fps", "30", "--task", "press"]);
    let [a, b] = places.each_ref().map(|place| files(&place.join("dataset")));
    let data = |of: &BTreeMap<PathBuf, Vec<u8>>| -> Vec<_> {
        of.iter()
            .filter(|(path, _)| path.starts_with("data"))
            .map(|(path, bytes)| (path.clone(), bytes.clone()))
            .collect()
    };
    assert!(!data(&a).is_empty() && data(&a) == data(&b), "{:?}", a.keys());

    // Estimates that another recorder kept.
    let place = &places[1];
    as_sqlite(&place.join("out.mcap"), &place.join("out.db3"));
    tpf(place, &["diff", "out.mcap", "out.db3"]).ok();
}

#[cfg(feature = "train")]
#[test]
fn a_model_that_is_trained_on_a_db3_bag_is_that_of_the_same_data_in_mcap() {
    let folder = tempfile::tempdir().unwrap();
    let places = workplaces(folder.path());
    let params = &format!("{ROOT}/params/glove1.yaml");
    let args = [
        "train",
        "session",
        "--params-file",
        params,
        "-o",
        "model.onnx",
        "--steps",
        "4",
        "--batch",
        "16",
        "--seed",
        "3",
    ];
    both(&places, &args);
    let [a, b] = places.each_ref().map(|place| fs::read(place.join("model.onnx")).unwrap());
    assert!(a == b, "the models differ");
}
