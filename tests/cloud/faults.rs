//! Connections that are cut, servers that are busy, slow or silent: what recovers is right, and what doesn't is one line and
//! leaves nothing.

use std::fs;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::common::onnx::LinearModel;
use crate::common::tpf::{Run, write_params};
use crate::proxy::{Fault, Request};
use crate::same::with_camera;
use crate::server::Cloud;

const LIMIT: Duration = Duration::from_secs(120);

/// A bag of 20 MiB here and in the bucket, and what a replay into one needs.
fn prepared() -> Option<Cloud> {
    let cloud = Cloud::start()?;
    with_camera(&cloud.folder().join("camera.mcap"));
    cloud.put("camera.mcap", "camera.mcap");
    LinearModel::new(64, 2, 1).gains(1.0, 20.0).metadata("unit", "gF").write(cloud.folder(), "model.onnx");
    write_params(cloud.folder(), 2, &["dip"], "");
    Some(cloud)
}

/// A copy of the bag with estimates: an output of 20 MiB.
fn merged<'a>(bag: &'a str, out: &'a str) -> Vec<&'a str> {
    vec!["replay", bag, "--merge", "--params-file", "params.yaml", "--calibrate-first", "3.13", "-o", out]
}

fn reads(request: &Request) -> bool {
    request.method == "GET"
}

fn reads_on(request: &Request) -> bool {
    request.method == "GET" && request.range.is_some_and(|(first, _)| first > 1 << 20)
}

fn sends(request: &Request) -> bool {
    request.method == "PUT"
}

fn completes(request: &Request) -> bool {
    request.method == "POST" && request.target.contains("uploadId=")
}

fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < LIMIT, "{what} doesn't come");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn what_a_cut_connection_a_busy_or_a_slow_server_interrupts_is_read_on() {
    let Some(cloud) = prepared() else { return };
    let here = cloud.tpf(&["inspect", "camera.mcap", "--json"]).ok();
    let faults = [Fault::Cut(0), Fault::Cut(5000), Fault::Busy, Fault::Lost, Fault::Late(Duration::from_secs(2))];
    for fault in faults {
        cloud.proxy.fail(reads, fault, 2);
        cloud.proxy.fail(reads_on, fault, 2);
        let there = cloud.tpf(&["inspect", "s3://bags/camera.mcap", "--json"]).ok();
        assert_eq!(there.stdout.replace("s3://bags/", ""), here.stdout, "{fault:?}");
        assert_eq!(cloud.proxy.n_left(), 0, "{fault:?}");
    }
}

#[test]
fn an_upload_goes_on_after_every_fault_and_one_whose_answer_was_lost_is_known_again() {
    let Some(cloud) = prepared() else { return };
    cloud.tpf(&merged("camera.mcap", "here.mcap")).ok();
    let here = fs::read(cloud.folder().join("here.mcap")).unwrap();
    type Case = (fn(&Request) -> bool, Fault, usize);
    let faults: [Case; 5] = [
        (sends, Fault::Busy, 3),
        (sends, Fault::Lost, 2),
        (sends, Fault::Late(Duration::from_secs(1)), 2),
        (completes, Fault::Busy, 2),
        (completes, Fault::Lost, 1),
    ];
    for (idx, (matches, fault, times)) in faults.into_iter().enumerate() {
        let out = format!("s3://bags/there{idx}.mcap");
        cloud.proxy.fail(matches, fault, times);
        cloud.tpf(&merged("camera.mcap", &out)).ok();
        assert!(fs::read(cloud.object(&format!("there{idx}.mcap"))).unwrap() == here, "{fault:?}");
        assert_eq!(cloud.proxy.n_left(), 0, "{fault:?}");
    }
    // The same of an output that is sent in one request.
    cloud.proxy.fail(sends, Fault::Lost, 1);
    let small = |out: &str| {
        cloud.tpf(&["replay", "camera.mcap", "--params-file", "params.yaml", "--calibrate-first", "3.13", "-o", out])
    };
    small("small.mcap").ok();
    small("s3://bags/small.mcap").ok();
    assert!(fs::read(cloud.folder().join("small.mcap")).unwrap() == fs::read(cloud.object("small.mcap")).unwrap());
    assert_eq!((cloud.proxy.n_left(), cloud.n_unfinished(), cloud.n_temporary()), (0, 0, 0));
}

#[test]
fn what_does_not_recover_is_one_line_within_a_minute_and_leaves_nothing() {
    let Some(cloud) = prepared() else { return };
    let before = cloud.objects();
    type Case = (fn(&Request) -> bool, Fault, &'static str, &'static str);
    let cases: [Case; 4] = [
        (reads_on, Fault::OtherRange, "s3://bags/camera.mcap", "could not be used"),
        (reads_on, Fault::Busy, "s3://bags/camera.mcap", "503 Service Unavailable (SlowDown)"),
        (sends, Fault::Busy, "camera.mcap", "503 Service Unavailable (SlowDown)"),
        (reads_on, Fault::Silent, "s3://bags/camera.mcap", "timed out"),
    ];
    for (matches, fault, bag, says) in cases {
        let began = Instant::now();
        cloud.proxy.fail(matches, fault, 1000);
        let run = cloud.tpf(&merged(bag, "s3://bags/never.mcap"));
        let line = run.failure();
        assert!(line.contains(says) && line.contains("run again"), "{fault:?}: {line}");
        assert!(began.elapsed() < Duration::from_secs(75), "{fault:?}: {:?}", began.elapsed());
        assert_eq!(cloud.objects(), before, "{fault:?}");
        assert_eq!((cloud.n_unfinished(), cloud.n_temporary()), (0, 0), "{fault:?}");
        cloud.proxy.forget();
    }
}

#[test]
fn a_bag_that_changes_while_it_is_read_is_refused() {
    let Some(cloud) = prepared() else { return };
    let other = fs::read(cloud.folder().join("camera.mcap")).unwrap().into_iter().rev().collect::<Vec<u8>>();
    cloud.proxy.fail(reads_on, Fault::Late(Duration::from_secs(1)), 1000);
    cloud.proxy.take_seen();
    let child = begin(
        &cloud,
        &[
            "replay",
            "s3://bags/camera.mcap",
            "--merge",
            "--params-file",
            "params.yaml",
            "--calibrate-first",
            "3.13",
            "-o",
            "mixed.mcap",
        ],
    );
    let mut n = 0;
    wait_until("a request for what is behind the start", || {
        n += cloud.proxy.take_seen().iter().filter(|request| reads_on(request)).count();
        n > 1
    });
    fs::write(cloud.folder().join("other.mcap"), other).unwrap();
    cloud.put("other.mcap", "camera.mcap");
    let run = end(child);
    assert!(run.failure().contains("it was changed while it was read"), "{run:?}");
    assert!(!cloud.folder().join("mixed.mcap").exists());
}

fn begin(cloud: &Cloud, args: &[&str]) -> Child {
    cloud.command(args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn end(child: Child) -> Run {
    Run::from(child.wait_with_output().unwrap())
}

/// An upload whose first part is on its way, and is not answered for a while.
fn uploading(cloud: &Cloud, out: &str) -> Child {
    cloud.proxy.take_seen();
    cloud.proxy.fail(sends, Fault::Late(Duration::from_secs(3)), 1000);
    let child = begin(cloud, &merged("camera.mcap", out));
    wait_until("a part", || cloud.n_unfinished() > 1);
    child
}

#[test]
fn an_upload_that_is_killed_or_interrupted_leaves_no_object() {
    let Some(cloud) = prepared() else { return };
    let before = cloud.objects();
    let mut child = uploading(&cloud, "s3://bags/out.mcap");
    child.kill().unwrap();
    child.wait().unwrap();
    std::thread::sleep(Duration::from_secs(1)); // what is still on its way
    assert_eq!(cloud.objects(), before, "killed");
    let left = cloud.n_unfinished();

    cloud.proxy.forget();
    let child = uploading(&cloud, "s3://bags/out.mcap");
    wait_until("a part", || cloud.n_unfinished() > left + 1);
    let began = Instant::now();
    assert!(std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let run = end(child);
    assert!(began.elapsed() < Duration::from_secs(6), "{:?}", began.elapsed());
    assert!(run.failure().contains("interrupted"), "{run:?}");
    assert_eq!(cloud.objects(), before, "interrupted");
    cloud.proxy.forget();
    cloud.tpf(&merged("camera.mcap", "s3://bags/out.mcap")).ok();
    assert_eq!(cloud.objects().len(), before.len() + 1);
}

#[test]
fn nothing_that_is_there_is_replaced_unasked_not_even_what_comes_meanwhile() {
    let Some(cloud) = prepared() else { return };
    fs::write(cloud.object("there.mcap"), b"somebody's").unwrap();
    let run = cloud.tpf(&merged("camera.mcap", "s3://bags/there.mcap"));
    assert!(run.failure().starts_with("s3://bags/there.mcap: is there already"), "{run:?}");
    let run = cloud.tpf(&[&merged("s3://bags/camera.mcap", "s3://bags/camera.mcap")[..], &["--overwrite"]].concat());
    assert!(run.failure().contains("is also an input"), "{run:?}");
    let child = uploading(&cloud, "s3://bags/late.mcap");
    fs::write(cloud.object("late.mcap"), b"somebody's").unwrap();
    cloud.proxy.forget();
    let run = end(child);
    assert!(run.failure().starts_with("s3://bags/late.mcap: is there already"), "{run:?}");
    for name in ["there.mcap", "late.mcap"] {
        assert_eq!(fs::read(cloud.object(name)).unwrap(), b"somebody's", "{name}");
    }
    assert_eq!((cloud.n_unfinished(), cloud.n_temporary()), (0, 0));
    cloud.tpf(&[&merged("camera.mcap", "s3://bags/there.mcap")[..], &["--overwrite"]].concat()).ok();
    assert!(fs::metadata(cloud.object("there.mcap")).unwrap().len() > 20 << 20);
}
