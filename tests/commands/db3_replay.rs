//! A `.db3` bag replays to the same bytes as the same data in MCAP, whoever wrote it, and wherever its types are defined.

use crate::common;

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Command;

use common::ROOT;
use common::bags::{Recorded, messages, write_session};
use common::onnx::LinearModel;
use common::sqlite::{as_sqlite, write_rows};
use common::tpf::{Run, tpf, write_params};
use sha2::{Digest as _, Sha256};
use tactile_pose_fusion::bag::{BagReader, recordings_at};

/// Topic, type, time and digest of messages.
fn told(recorded: &[Recorded]) -> Vec<(String, String, i64, String)> {
    let digest = |data: &[u8]| {
        Sha256::digest(data).iter().fold(String::new(), |mut text, byte| {
            write!(text, "{byte:02x}").unwrap();
            text
        })
    };
    recorded
        .iter()
        .map(|message| (message.topic.clone(), message.type_name.clone(), message.log_time.0, digest(&message.data)))
        .collect()
}

#[test]
fn a_db3_bag_replays_to_the_same_bytes_as_the_same_data_in_mcap() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_session(&folder.join("session.mcap"), 8);
    as_sqlite(&folder.join("session.mcap"), &folder.join("same.db3"));
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(folder, "model.onnx");
    write_params(folder, 2, &["dip"], "");
    let replay = |bag: &str, out: &str, more: &[&str]| {
        let args = ["replay", bag, "--params-file", "params.yaml", "--calibrate-first", "3.13", "-o", out];
        tpf(folder, &[&args[..], more].concat()).ok();
    };
    replay("session.mcap", "a.mcap", &[]);
    replay("same.db3", "b.mcap", &[]);
    assert!(messages(&folder.join("a.mcap")).len() > 400);
    assert_eq!(fs::read(folder.join("a.mcap")).unwrap(), fs::read(folder.join("b.mcap")).unwrap());
    replay("session.mcap", "merged_a.mcap", &["--merge"]);
    replay("same.db3", "merged_b.mcap", &["--merge"]);
    let [a, b] = ["merged_a.mcap", "merged_b.mcap"].map(|name| messages(&folder.join(name)));
    assert_eq!(a, b);
    let inspected = tpf(folder, &["inspect", "same.db3"]).ok();
    assert!(inspected.stdout.contains("/taxels"), "{}", inspected.stdout);
    // Split: parts plain or packed, listed or not.
    let session = messages(&folder.join("session.mcap"));
    let parts: Vec<_> = session.chunks(session.len() / 3 + 1).collect();
    for (name, is_packed, is_listed) in [("split", false, false), ("listed", false, true), ("packed", true, true)] {
        fs::create_dir(folder.join(name)).unwrap();
        let mut listed = String::new();
        for (n, part) in parts.iter().enumerate() {
            let path = folder.join(format!("{name}/{name}_{n}.db3"));
            write_rows(part, &path);
            listed += &format!("    - {name}_{n}.db3{}\n", if is_packed { ".zstd" } else { "" });
            if is_packed {
                fs::write(path.with_extension("db3.zstd"), zstd::encode_all(&fs::read(&path).unwrap()[..], 1).unwrap())
                    .unwrap();
                fs::remove_file(path).unwrap();
            }
        }
        if is_listed {
            let mode = if is_packed { "  compression_mode: FILE\n  compression_format: zstd\n" } else { "" };
            let listing = format!(
                "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n{mode}  relative_file_paths:\n{listed}"
            );
            fs::write(folder.join(name).join("metadata.yaml"), listing).unwrap();
        }
        replay(name, &format!("{name}.mcap"), &[]);
        let [a, b] = ["a.mcap", &format!("{name}.mcap")].map(|name| fs::read(folder.join(name)).unwrap());
        assert!(a == b, "{name}");
    }
    // A part that is missing is never passed over.
    fs::remove_file(folder.join("listed/listed_1.db3")).unwrap();
    fs::remove_file(folder.join("split/split_1.db3")).unwrap();
    let failed = |bag: &str| {
        let run =
            tpf(folder, &["replay", bag, "--params-file", "params.yaml", "--calibrate-first", "3.13", "-o", "x.mcap"]);
        run.failure().to_owned()
    };
    assert!(failed("listed").contains("lists listed_1.db3, which is not there"));
    assert!(failed("split").contains("holds 2 recordings"));
    let left: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(!left.iter().any(|name| name.to_string_lossy().contains("-journal")), "{left:?}");
}

#[test]
fn every_form_that_rosbags_writes_reads_as_rosbags_reads_it() {
    let Some(python) = common::python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_session(&folder.join("session.mcap"), 6);
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(folder, "model.onnx");
    write_params(folder, 2, &["dip"], "");
    let replayed = |bag: &Path| {
        let args = ["replay", bag.to_str().unwrap(), "--params-file", "params.yaml", "--calibrate-first", "3.13"];
        tpf(folder, &[&args[..], &["--overwrite", "-o", "out.mcap"]].concat()).ok();
        fs::read(folder.join("out.mcap")).unwrap()
    };
    let expected = replayed(&folder.join("session.mcap"));
    assert!(messages(&folder.join("out.mcap")).len() > 300);
    let script = &format!("{ROOT}/tests/python/sqlite_bags.py");
    let bags = folder.join("bags");
    fs::create_dir(&bags).unwrap();
    let output = Command::new(python).arg(script).arg(folder.join("session.mcap")).arg(&bags).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let session = messages(&folder.join("session.mcap"));
    let mut n_bags = 0;
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        type Line = (String, Vec<(String, String, i64, String)>);
        let (name, theirs): Line = serde_json::from_str(line).unwrap();
        let ours = messages(&bags.join(&name));
        assert_eq!(told(&ours), theirs, "{name}");
        assert_eq!(ours, session, "{name}");
        assert!(replayed(&bags.join(&name)) == expected, "{name}");
        // Without metadata.yaml, and the file alone.
        fs::remove_file(bags.join(&name).join("metadata.yaml")).unwrap();
        assert_eq!(messages(&bags.join(&name)), session, "{name}");
        let file = fs::read_dir(bags.join(&name)).unwrap().next().unwrap().unwrap().path();
        assert_eq!(messages(&file), session, "{}", file.display());
        assert_eq!(recordings_at(&bags.join(&name)).unwrap().paths, [bags.join(&name)]);
        n_bags += 1;
    }
    assert_eq!(n_bags, 8);
}

#[test]
fn a_type_that_the_bag_does_not_define_is_one_that_is_installed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_session(&folder.join("session.mcap"), 5);
    let mut recorded = messages(&folder.join("session.mcap"));
    for message in recorded.iter_mut().filter(|message| message.topic == "/taxels") {
        message.type_name = "glove_msgs/msg/Raw".to_owned();
    }
    write_rows(&recorded, &folder.join("humble.db3"));
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(folder, "model.onnx");
    let source = "    tactile.glove.type: glove_msgs/msg/Raw\n    tactile.glove.field: values\n    tactile.glove.stamp: header.stamp\n";
    let run = |ament: &str, out: &str| {
        let args = ["replay", "humble.db3", "--params-file", "params.yaml", "--calibrate-first", "3.13", "-o", out];
        let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
        Run::from(command.current_dir(folder).env("AMENT_PREFIX_PATH", ament).args(args).output().unwrap())
    };
    write_params(folder, 2, &["dip"], source);
    let refused = run("/nowhere", "x.mcap");
    let line = refused.failure();
    for part in ["topic /taxels", "glove_msgs/msg/Raw", "in /nowhere/share", "message_definitions", "AMENT_PREFIX_PATH"]
    {
        assert!(line.contains(part), "{part}: {line}");
    }
    let package = folder.join("prefix/share/glove_msgs/msg");
    fs::create_dir_all(&package).unwrap();
    let text = "std_msgs/Header header\nuint32 sequence\nuint32 rows\nbuiltin_interfaces/Duration row_period\nfloat32[] values\n";
    fs::write(package.join("Raw.msg"), text).unwrap();
    run(folder.join("prefix").to_str().unwrap(), "installed.mcap").ok();
    write_params(folder, 2, &["dip"], &format!("{source}    message_definitions: prefix/share\n"));
    run("", "folder.mcap").ok();
    assert!(messages(&folder.join("folder.mcap")).len() > 150);
    let [a, b] = ["installed.mcap", "folder.mcap"].map(|name| fs::read(folder.join(name)).unwrap());
    assert!(a == b);
    // What a definition is made of is needed too.
    fs::write(package.join("Raw.msg"), text.replace("float32[] values", "Patch[] patches\nfloat32[] values")).unwrap();
    let refused = run("", "x.mcap");
    assert!(
        refused.failure().contains("glove_msgs/msg/Raw uses glove_msgs/msg/Patch, which is not defined"),
        "{refused:?}"
    );
    fs::write(package.join("Raw.msg"), text).unwrap();
    // A recorder of MCAP that found no definition leaves an empty one; a message without fields is defined by an empty text.
    let file = fs::File::create(folder.join("humble.mcap")).unwrap();
    let mut writer = mcap::WriteOptions::new().profile("ros2").create(file).unwrap();
    for (name, encoding) in
        [("glove_msgs/msg/Raw", ""), ("glove_msgs/msg/Raw", "unknown"), ("a_msgs/msg/None", "ros2msg")]
    {
        let schema = writer.add_schema(name, encoding, b"").unwrap();
        writer.add_channel(schema, &format!("/{}", schema), "cdr", &Default::default()).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let mut reader = BagReader::open(&[folder.join("humble.mcap")]).unwrap();
    let lengths = |reader: &BagReader| -> Vec<usize> {
        reader.channels().iter().map(|channel| channel.schema.as_ref().unwrap().data.len()).collect()
    };
    assert_eq!(lengths(&reader), [0, 0, 0]);
    reader.look_for_definitions_in(&folder.join("prefix/share")).unwrap();
    let found = lengths(&reader);
    assert!(found[0] > 100 && found[1] == found[0] && found[2] == 0, "{found:?}");
    for channel in reader.channels() {
        channel.schema.as_ref().unwrap().tree(reader.definitions()).unwrap();
    }
    let inspect = |more: &[&str]| tpf(folder, &[&["inspect", "humble.db3"], more].concat()).ok().stdout;
    assert!(inspect(&[]).contains("the bag has no definition of its type: glove_msgs/msg/Raw"), "{}", inspect(&[]));
    assert!(!inspect(&["--message-definitions", "prefix/share"]).contains("no definition"));
    // Whoever names a folder on the command line wants it to be used; one in the parameters may be of another machine.
    let gone = ["--message-definitions", "gone/share"];
    let expected = "gone/share: there is no such folder; give the folder that holds PACKAGE/msg/TYPE.msg";
    assert!(tpf(folder, &[&["inspect", "humble.db3"], &gone[..]].concat()).failure().contains(expected));
    let init = tpf(folder, &[&["init", "humble.db3", "-o", "made.yaml", "--yes"], &gone[..]].concat());
    assert!(init.failure().contains("gone/share: there is no such folder"), "{init:?}");
    reader.look_for_definitions_in(&folder.join("gone/share")).unwrap();
}
