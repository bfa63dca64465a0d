//! URIs without a server: those of this machine, and those that are refused. With a server they are tried in `tests/cloud`.

use crate::common;

use std::fs;

use common::bags::write_session;
use common::onnx::LinearModel;
use common::tpf::{tpf, write_params};
#[cfg(not(feature = "cloud"))]
use common::{doors, scored};

#[test]
fn a_file_uri_is_the_path_that_it_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::create_dir(path.join("a folder")).unwrap();
    write_session(&path.join("a folder/session.mcap"), 8);
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(path, "model.onnx");
    write_params(path, 2, &["dip"], "");
    let uri = format!("file://{}", path.display());
    let replay = |bag: &str, params: &str, out: &str| {
        tpf(path, &["replay", bag, "--params-file", params, "--calibrate-first", "3.13", out]).ok()
    };
    replay("a folder/session.mcap", "params.yaml", "-oplain.mcap");
    replay(
        &format!("{uri}/a%20folder/session.mcap"),
        &format!("{uri}/params.yaml"),
        &format!("--output={uri}/by_uri.mcap"),
    );
    assert!(fs::read(path.join("plain.mcap")).unwrap() == fs::read(path.join("by_uri.mcap")).unwrap());
    let run = tpf(path, &["inspect", "file://nowhere/bag.mcap"]);
    assert!(
        run.failure().contains("a file:// URI names a file of this machine, as file:///folder/bag.mcap"),
        "{run:?}"
    );
}

#[test]
#[cfg(not(feature = "cloud"))]
fn without_the_feature_a_uri_is_refused_in_a_line_wherever_a_path_is_given() {
    let folder = scored::folder();
    doors::write_gates(folder.path());
    let before = doors::names(folder.path());
    for door in doors::DOORS {
        let words = doors::words(door);
        let run = tpf(folder.path(), &words.iter().map(String::as_str).collect::<Vec<_>>());
        doors::check_refused(
            door,
            &run,
            &["build it with `--features cloud`, or copy the file", "on this machine only"],
        );
        for entry in doors::names(folder.path()).difference(&before) {
            assert_eq!(entry, "new", "{door}"); // the folder of --each, as for any bag that can't be read
        }
    }
}

#[test]
fn what_no_build_takes_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    for (uri, why) in [
        ("ftp://host/bag.mcap", "ftp:// is not known: expected a path, or a URI that begins with file://, s3://"),
        ("https://me:secret@host/bag.mcap", "a user, a password or a query is not taken"),
        ("https://host/bag.mcap?X-Amz-Signature=secret", "a user, a password or a query is not taken"),
    ] {
        let run = tpf(folder.path(), &["inspect", uri]);
        assert!(run.failure().contains(why) && !run.stderr.contains("secret"), "{run:?}");
    }
    let run = tpf(folder.path(), &["demo", "-o", "s3://bucket/demo"]);
    assert!(run.failure().contains("this is made on this machine only: give a path"), "{run:?}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}
