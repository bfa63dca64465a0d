//! `tpf eval --partial` and `tpf merge`: however the bags are shared out, the result is that of one process, byte for byte.

use crate::common;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use common::files;
use common::onnx::LinearModel;
use common::scored::PARAMS;
use common::tpf::{Run, tpf};

const N_BAGS: usize = 6;

/// Six short sessions of three users, two models, and gates.
fn six() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("params.yaml"), PARAMS).unwrap();
    let simulate = ["simulate", "--glove", "1", "--users", "3", "--sessions", "2", "--minutes=1.7", "--seed", "5"];
    tpf(path, &[&simulate[..], &["-o", "bags"]].concat()).ok();
    LinearModel::new(64, 6, 4).metadata("unit", "gF").write(path, "model.onnx");
    LinearModel::new(64, 6, 0).metadata("unit", "gF").write(path, "other.onnx");
    fs::write(path.join("gates.yaml"), "gates:\n- {metric: mae_gf, by: user, at_most: 1.0e+6}\n").unwrap();
    folder
}

const OPTIONS: [&str; 8] =
    ["--params-file", "params.yaml", "--model", "model.onnx", "--compare", "other.onnx", "--pose-noise-deg", "5"];

fn eval(folder: &Path, more: &[&str]) -> Run {
    tpf(folder, &[&["eval"], more, &OPTIONS].concat())
}

fn bags(folder: &Path) -> Vec<String> {
    let mut bags: Vec<String> = fs::read_dir(folder.join("bags"))
        .unwrap()
        .map(|entry| format!("bags/{}", entry.unwrap().file_name().into_string().unwrap()))
        .filter(|bag| folder.join(bag).is_dir())
        .collect();
    bags.sort();
    assert!(bags.len() >= N_BAGS, "{bags:?}");
    bags
}

/// Everything that a result is written as: JSON, text, table, page, JUnit.
fn results(folder: &Path, command: &[&str], code: i32) -> Vec<Vec<u8>> {
    let json = tpf(folder, &[command, &["--json"]].concat());
    let by = "user,session,stage,substage";
    let written = ["--report", "r.html", "--parquet", "r.parquet", "--overwrite", "--gate", "gates.yaml"];
    let text = tpf(folder, &[command, &["--by", by, "--junit", "r.xml"], &written].concat());
    assert_eq!((json.code, text.code), (code, code), "{json:?} {text:?}");
    let mut results = vec![json.stdout.into_bytes(), text.stdout.into_bytes()];
    results.extend(["r.html", "r.parquet", "r.xml"].map(|name| fs::read(folder.join(name)).unwrap()));
    results
}

fn assert_same(a: &[Vec<u8>], b: &[Vec<u8>], what: &str) {
    for ((a, b), name) in a.iter().zip(b).zip(["json", "text", "report", "parquet", "junit"]) {
        let at = a.iter().zip(b).position(|(a, b)| a != b).unwrap_or(a.len().min(b.len()));
        let near = |bytes: &[u8]| {
            String::from_utf8_lossy(&bytes[at.saturating_sub(80)..bytes.len().min(at + 80)]).into_owned()
        };
        assert!(a == b, "{what}, {name}: {:?} {:?}", near(a), near(b));
    }
}

#[test]
fn bags_shared_out_in_any_way_merge_to_the_bytes_of_one_process() {
    let folder = six();
    let path = folder.path();
    let single = [&["eval", "bags"][..], &OPTIONS].concat();
    let whole = results(path, &single, 0);

    // One process for all, three shards, and six that name their bags, merged in another order than they were made.
    eval(path, &["bags", "--partial", "all.parquet"]).ok();
    assert_same(&results(path, &["merge", "all.parquet"], 0), &whole, "one partial");
    for index in [2, 0, 1] {
        let (shard, out) = (format!("{index}/3"), format!("shard{index}.parquet"));
        let run = eval(path, &["bags", "--partial", &out, "--shard", &shard, "--jobs", "2"]).ok();
        assert!(run.stdout.contains("2 of 2 bags in shard"), "{run:?}");
    }
    let merge = ["merge", "shard1.parquet", "shard2.parquet", "shard0.parquet"];
    assert_same(&results(path, &merge, 0), &whole, "three shards");
    fs::create_dir(path.join("partials")).unwrap();
    let children = bags(path).into_iter().enumerate().map(|(idx, bag)| {
        let out = format!("partials/{}.parquet", (idx * 5) % N_BAGS);
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        command.current_dir(path).args(["eval", &bag, "--partial", &out]).args(OPTIONS);
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    });
    for mut child in children.collect::<Vec<_>>() {
        assert!(child.wait().unwrap().success());
    }
    assert_same(&results(path, &["merge", "partials", "--expect", "bags"], 0), &whole, "six processes");
    let named = bags(path);
    let named: Vec<&str> = named.iter().map(String::as_str).collect();
    let of_named = results(path, &[&["eval"][..], &named, &OPTIONS].concat(), 0);
    assert_same(&results(path, &["merge", "partials"], 0), &of_named, "six processes, by path");

    // What is missing, twice or too much is named.
    let refused = |args: &[&str]| tpf(path, &[&["merge"], args].concat()).failure().to_owned();
    fs::remove_file(path.join("partials/0.parquet")).unwrap();
    let told = refused(&["partials", "--expect", "bags"]);
    assert!(told.contains("1 of 6 bags are in no partial: bags/glove1_user01_session1"), "{told}");
    fs::write(path.join("list.txt"), bags(path)[1..3].join("\n")).unwrap();
    let told = refused(&["partials", "--expect", "list.txt"]);
    assert!(told.contains("3 bags are in partials and not expected: "), "{told}");
    let told = refused(&["shard0.parquet", "shard2.parquet"]);
    assert!(told.contains("1 of 3 shards are missing: 1/3"), "{told}");
    let told = refused(&["all.parquet", "shard0.parquet"]);
    assert!(told.contains("bags/glove1_user01_session1 is twice, in all.parquet and in shard0.parquet"), "{told}");
    fs::copy(path.join("shard0.parquet"), path.join("copy.parquet")).unwrap();
    assert!(refused(&["shard0.parquet", "copy.parquet"]).contains(" is twice, in shard0.parquet and in copy.parquet"));
    copy_folder(&path.join("bags/glove1_user01_session1"), &path.join("again"));
    eval(path, &["again", "--partial", "again.parquet"]).ok();
    let told = refused(&["all.parquet", "again.parquet"]);
    assert!(told.contains("again is twice") && told.contains("all.parquet as bags/glove1_user01_session1"), "{told}");

    // More shards than bags: the last are empty, and merge as any other.
    let two = bags(path)[..2].to_vec();
    let of_two = [&["eval", &two[0], &two[1]][..], &OPTIONS].concat();
    let whole = results(path, &of_two, 0);
    for index in 0..3 {
        let (shard, out) = (format!("{index}/3"), format!("few{index}.parquet"));
        eval(path, &[&two[0], &two[1], "--partial", &out, "--shard", &shard]).ok();
    }
    assert_same(
        &results(path, &["merge", "few2.parquet", "few1.parquet", "few0.parquet"], 0),
        &whole,
        "an empty shard",
    );
    assert!(refused(&["few2.parquet"]).contains("shards are missing"));
    assert_eq!(eval(path, &[&two[0], "--shard", "1/2"]).code, 2, "--shard without --partial");
    let there = eval(path, &["bags", "--partial", "all.parquet"]);
    assert!(there.failure().contains("all.parquet is there already"), "{there:?}");
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir(to).unwrap();
    for (name, bytes) in files(from) {
        fs::write(to.join(name), bytes).unwrap();
    }
}

#[test]
fn a_damaged_bag_is_named_and_mixtures_and_damaged_partials_are_refused_in_one_line() {
    let folder = common::scored::folder();
    let path = folder.path();
    let two = ["bags/glove1_user01_session1", "bags/glove1_user02_session1"];
    fs::create_dir(path.join("bags/broken")).unwrap();
    fs::write(path.join("bags/broken/broken.mcap"), b"no bag at all, by far").unwrap();
    fs::write(path.join("gates.yaml"), "gates:\n- {metric: mae_gf, by: user, at_most: 1.0e+6}\n").unwrap();
    let params = ["--params-file", "params.yaml"];
    let whole = results(path, &[&["eval", "bags"][..], &params, &["--model", "model.onnx"]].concat(), 3);
    let partial = |bag: &str, out: &str, more: &[&str]| {
        tpf(path, &[&["eval", bag, "--partial", out, "--overwrite"], &params[..], more].concat())
    };
    partial(two[0], "a.parquet", &["--model", "model.onnx"]).ok();
    partial(two[1], "b.parquet", &["--model", "model.onnx"]).ok();
    let broken = partial("bags/broken", "broken.parquet", &["--model", "model.onnx", "--json"]);
    assert_eq!(broken.code, 3, "{broken:?}");
    assert!(broken.stderr.contains("not scored: ") && broken.stderr.contains("broken.mcap"), "{broken:?}");
    assert!(broken.json()["bags"][0]["error"].as_str().unwrap().contains("broken.mcap"));
    let merge = ["merge", "b.parquet", "broken.parquet", "a.parquet", "--expect", "bags"];
    assert_same(&results(path, &merge, 3), &whole, "a damaged bag");
    let merged = tpf(path, &merge);
    assert!(merged.stderr.contains("not scored: ") && merged.stderr.contains("broken.mcap"), "{merged:?}");
    let refused = |args: &[&str]| tpf(path, &[&["merge"], args].concat()).failure().to_owned();
    assert!(refused(&["broken.parquet"]).contains("broken.mcap"), "no bag could be scored");

    for (more, told) in [
        (&["--model", "other.onnx"][..], "models"),
        (&["--model", "model.onnx", "--whole"], "options (split)"),
        (&["--model", "model.onnx", "--touch", "force"], "options (touch)"),
        (&["--model", "model.onnx", "-p", "calibration.max_force:=900.0"], "parameters"),
    ] {
        partial(two[1], "other.parquet", more).ok();
        let line = refused(&["a.parquet", "other.parquet"]);
        assert!(
            line.starts_with("a.parquet and other.parquet were scored with different ") && line.contains(told),
            "{line}"
        );
    }
    LinearModel::new(64, 6, 4).gains(5.0, 50.0).metadata("unit", "gF").write(path, "model.onnx");
    partial(two[1], "other.parquet", &["--model", "model.onnx"]).ok();
    let line = refused(&["a.parquet", "other.parquet"]);
    assert!(line.contains("different models, SHA-256 "), "{line}");

    // Bytes that are no partial of this version.
    let bytes = fs::read(path.join("a.parquet")).unwrap();
    let with = |bytes: &[u8]| {
        fs::write(path.join("x.parquet"), bytes).unwrap();
        refused(&["b.parquet", "x.parquet"])
    };
    assert!(with(b"").contains("x.parquet: is no whole Parquet file"));
    for cut in [1, 4, bytes.len() / 2, bytes.len() - 1] {
        assert!(with(&bytes[..cut]).contains("x.parquet: is no whole Parquet file"), "{cut}");
    }
    let version = format!("tactile_pose_fusion {}", env!("CARGO_PKG_VERSION"));
    let older = replaced(&bytes, version.as_bytes(), version.replace(env!("CARGO_PKG_VERSION"), "9.9.9").as_bytes());
    let line = with(&older);
    assert!(line.contains("was written by tactile_pose_fusion 9.9.9") && line.contains(&version), "{line}");
    let renamed = replaced(&bytes, b"tpf_partial", b"tpf_partiaX");
    assert!(with(&renamed).contains("x.parquet: is no partial; expected a file that `tpf eval --partial` wrote"));
    let user = replaced(&bytes, b"\\\"n_compared\\\":0", b"\\\"n_compared\\\":1");
    let user = if user == bytes { replaced(&bytes, b"\"n_compared\":0", b"\"n_compared\":1") } else { user };
    assert!(with(&user).contains("its notes were changed after it was written"));
    tpf(
        path,
        &["eval", "bags", "--parquet", "scores.parquet", "--params-file", "params.yaml", "--model", "other.onnx"],
    );
    assert!(refused(&["scores.parquet"]).contains("scores.parquet: is no partial"));
    assert!(refused(&["absent.parquet"]).contains("absent.parquet: "));
    fs::create_dir(path.join("empty")).unwrap();
    assert!(refused(&["empty"]).contains("no partial in this folder"));
    let mut seed = 1_u32;
    for _ in 0..60 {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let mut changed = bytes.clone();
        changed[seed as usize % bytes.len()] ^= 1 << (seed >> 29);
        fs::write(path.join("x.parquet"), &changed).unwrap();
        let run = tpf(path, &["merge", "b.parquet", "x.parquet"]);
        assert!(run.code == 1 || changed == bytes || run.code == 0, "{run:?}");
        assert!(!run.stderr.contains("panicked"), "{run:?}");
    }
}

fn replaced(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let mut changed = bytes.to_vec();
    let places: Vec<usize> = (0..bytes.len() - from.len()).filter(|at| bytes[*at..].starts_with(from)).collect();
    for at in places {
        changed[at..at + to.len()].copy_from_slice(to);
    }
    changed
}

#[cfg(unix)]
#[test]
fn a_killed_process_leaves_no_partial() {
    let folder = common::scored::folder();
    let path = folder.path();
    let before: Vec<PathBuf> = files(path).into_keys().collect();
    for after_ms in [0, 50, 150, 400, 800] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        let args =
            ["eval", "bags", "--partial", "out.parquet", "--params-file", "params.yaml", "--model", "model.onnx"];
        let mut child =
            command.current_dir(path).args(args).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(after_ms));
        let _ = child.kill();
        let _ = child.wait();
        if path.join("out.parquet").exists() {
            tpf(path, &["merge", "out.parquet"]).ok(); // it was faster than we were
            fs::remove_file(path.join("out.parquet")).unwrap();
        }
        let is_hidden = |file: &PathBuf| file.to_string_lossy().starts_with(".tpf-");
        let after: Vec<PathBuf> = files(path).into_keys().filter(|file| !is_hidden(file)).collect();
        assert_eq!(before, after);
    }
}
