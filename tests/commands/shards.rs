//! `tpf export --shard` with `tpf merge --lerobot`, and `tpf replay --each`: many processes do what one does.

use crate::common;

use std::fs;
use std::path::Path;

use common::files;
use common::onnx::LinearModel;
use common::scored::PARAMS;
use common::tpf::{Run, tpf};

/// Four short sessions, and in the second place of the list one that is damaged.
fn five() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("params.yaml"), PARAMS).unwrap();
    let simulate = ["simulate", "--glove", "1", "--users", "4", "--sessions", "1", "--minutes=1.7", "--seed", "5"];
    tpf(path, &[&simulate[..], &["-o", "bags"]].concat()).ok();
    fs::create_dir(path.join("bags/glove1_user01_t")).unwrap();
    fs::write(path.join("bags/glove1_user01_t/broken.mcap"), b"no bag at all, by far").unwrap();
    LinearModel::new(64, 6, 4).metadata("unit", "gF").write(path, "model.onnx");
    folder
}

fn export(folder: &Path, bags: &str, out: &str, more: &[&str]) -> Run {
    tpf(folder, &[&["export", bags, "--params-file", "params.yaml", "--lerobot", out], more].concat())
}

#[test]
fn joined_shards_are_the_dataset_of_one_export() {
    let folder = five();
    let path = folder.path();
    let whole = export(path, "bags", "whole", &[]);
    assert_eq!(whole.code, 3, "{whole:?}");
    for index in [3, 1, 0, 2] {
        let (out, shard) = (format!("shard{index}"), format!("{index}/4"));
        let run = export(path, "bags", &out, &["--shard", &shard]);
        assert_eq!(run.code, if index == 1 { 3 } else { 0 }, "{run:?}"); // its only bag is the damaged one
    }
    let joined = tpf(path, &["merge", "shard2", "shard0", "shard3", "shard1", "--lerobot", "joined"]);
    assert_eq!(joined.code, 3, "{joined:?}");
    assert!(joined.stdout.contains("4 of 5 bags in joined"), "{joined:?}");
    assert!(joined.stderr.contains("not exported: ") && joined.stderr.contains("broken.mcap"), "{joined:?}");
    let (whole, joined) = (files(&path.join("whole")), files(&path.join("joined")));
    assert_eq!(whole.keys().collect::<Vec<_>>(), joined.keys().collect::<Vec<_>>());
    let differ: Vec<_> = whole.iter().filter(|(name, bytes)| joined[*name] != **bytes).map(|(name, _)| name).collect();
    assert!(differ.is_empty(), "{differ:?}");

    let refused = |shards: &[&str]| {
        let told = tpf(path, &[&["merge", "--lerobot", "x"], shards].concat()).failure().to_owned();
        assert!(!path.join("x").exists());
        told
    };
    assert!(refused(&["shard0", "shard1", "shard3"]).contains("1 of 4 shards are missing: 2/4"));
    assert!(refused(&["shard0", "shard0"]).contains("shard 0/4 is twice, in shard0 and in shard0"));
    assert!(
        refused(&["whole"]).contains("whole: is no shard; expected what `tpf export --lerobot DIR --shard I/N` wrote")
    );
    export(path, "bags/glove1_user02_session1", "fps", &["--shard", "0/4", "--fps", "20"]).ok();
    let told = refused(&["shard1", "fps"]);
    assert!(told.contains("shard1 and fps were exported with different "), "{told}");
    // Any byte that was changed on the way is noticed, in any file, and so is a file that is missing or cut off.
    let shards = ["shard0", "shard1", "shard2", "shard3"];
    let names: Vec<_> = files(&path.join("shard2")).into_keys().collect();
    assert!(names.len() >= 7, "{names:?}");
    for (nth, name) in names.iter().enumerate() {
        let file = path.join("shard2").join(name);
        let bytes = fs::read(&file).unwrap();
        let mut changed = bytes.clone();
        let at = bytes.iter().rposition(u8::is_ascii_alphanumeric).unwrap() - nth.min(bytes.len() / 2);
        changed[at] ^= 1;
        for (now, why) in [(Some(&changed[..]), "changed"), (Some(&bytes[..bytes.len() / 2]), "cut"), (None, "gone")] {
            now.map_or_else(|| fs::remove_file(&file), |now| fs::write(&file, now)).unwrap();
            let told = refused(&shards);
            let is_notes = name.ends_with("tpf_shard.json");
            let expected = if is_notes { "shard2: " } else { "shard2: is damaged: " };
            assert!(told.contains(expected), "{name:?} {why}: {told}");
        }
        fs::write(&file, &bytes).unwrap();
    }
    tpf(path, &[&["merge", "--lerobot", "mended"], &shards[..]].concat());
    assert!(files(&path.join("mended")) == files(&path.join("joined")));
    fs::write(path.join("shard3/meta/tpf_shard.json"), b"{").unwrap();
    assert!(refused(&["shard0", "shard3"]).contains("shard3: meta/tpf_shard.json: "));
}

#[test]
fn each_bag_is_replayed_to_a_bag_of_its_own_and_a_damaged_one_is_named() {
    let folder = five();
    let path = folder.path();
    let replay = |more: &[&str]| tpf(path, &[&["replay", "--params-file", "params.yaml"], more].concat());
    for index in 0..2 {
        let run = replay(&["bags", "--each", "-o", "forces", "--shard", &format!("{index}/2")]);
        assert_eq!(run.code, if index == 1 { 3 } else { 0 }, "{run:?}");
        let told = if index == 1 { "1 of 2 bags in forces" } else { "3 of 3 bags in forces" };
        assert!(run.stdout.contains(told), "{run:?}");
        assert_eq!(run.stderr.contains("not replayed: bags/glove1_user01_t"), index == 1, "{run:?}");
    }
    let names: Vec<_> = files(&path.join("forces")).into_keys().collect();
    assert_eq!(names.len(), 4, "{names:?}");
    replay(&["bags/glove1_user03_session1", "-o", "one.mcap"]).ok();
    assert!(
        fs::read(path.join("one.mcap")).unwrap() == fs::read(path.join("forces/glove1_user03_session1.mcap")).unwrap()
    );
    let there = replay(&["bags/glove1_user03_session1", "--each", "-o", "forces", "--json"]);
    assert_eq!(there.code, 3);
    assert!(there.json()[0]["error"].as_str().unwrap().contains("is there already"), "{there:?}");

    // An array job that is begun again goes on: what is there and whole stays as it is, and the rest is replayed.
    let before = files(&path.join("forces"));
    let changed_at = |name: &str| fs::metadata(path.join("forces").join(name)).unwrap().modified().unwrap();
    let kept_at = changed_at("glove1_user03_session1.mcap");
    fs::remove_file(path.join("forces/glove1_user02_session1.mcap")).unwrap();
    let again = replay(&["bags", "--each", "-o", "forces", "--resume"]);
    assert_eq!(again.code, 3, "{again:?}"); // the damaged bag has no output, so it is tried again
    assert!(again.stdout.contains("4 of 5 bags in forces, 3 of them from before"), "{again:?}");
    assert!(again.stderr.contains("not replayed: bags/glove1_user01_t"), "{again:?}");
    assert!(files(&path.join("forces")) == before && changed_at("glove1_user03_session1.mcap") == kept_at);
    let json = replay(&["bags/glove1_user03_session1", "--each", "-o", "forces", "--resume", "--json"]).ok().json();
    assert_eq!((&json[0]["kept"], &json[0]["output"]), (&true.into(), &"forces/glove1_user03_session1.mcap".into()));
    let one = path.join("forces/glove1_user03_session1.mcap");
    let bytes = fs::read(&one).unwrap();
    for (there, told) in [
        (&bytes[..bytes.len() - 20], "is there already, but not whole; remove it, or give --overwrite"),
        (b"no bag", "not a bag"),
        (b"", "not a bag"),
    ] {
        fs::write(&one, there).unwrap();
        let run = replay(&["bags/glove1_user03_session1", "--each", "-o", "forces", "--resume"]);
        assert!(run.code == 3 && run.stderr.contains(told) && fs::read(&one).unwrap() == there, "{run:?}");
    }
    fs::write(&one, &bytes).unwrap();
    let other = replay(&["bags/glove1_user03_session1", "--each", "-o", "forces", "--resume", "--node", "/other"]);
    assert!(other.code == 3 && other.stderr.contains("is there already without topic /other/"), "{other:?}");
    assert_eq!(replay(&["bags", "--each", "-o", "x", "--resume", "--overwrite"]).code, 2);
    assert_eq!(replay(&["bags", "-o", "x", "--resume"]).code, 2, "--resume without --each");
    let twice = replay(&["bags/glove1_user03_session1", "./bags/glove1_user03_session1", "--each", "-o", "forces"]);
    assert!(twice.failure().contains("would both become glove1_user03_session1.mcap"), "{twice:?}");
    assert_eq!(replay(&["bags", "-o", "x", "--shard", "0/2"]).code, 2, "--shard without --each");
    for wrong in ["2/2", "x", "1"] {
        let run = replay(&["bags", "--each", "-o", "x", "--shard", wrong]);
        assert!(run.code == 2 && run.stderr.contains("expected I/N with 0 <= I < N"), "{run:?}");
    }
}
