//! `tpf view` of a bag: what the page is told, to whom, and what a browser shows of it.

use crate::common;

use std::fs;
use std::net::TcpListener;
use std::path::Path;

use common::ROOT;
use common::tpf::{Run, tpf};
use common::view::View;
use serde_json::Value;
use tactile_pose_fusion::config::{self, Config, DEFAULT_NODE};
use tactile_pose_fusion::observer::Unobserved;
use tactile_pose_fusion::recording::EstimateTrack;
use tactile_pose_fusion::sessions::read_estimates;
use tactile_pose_fusion::units::Stamp;

/// A session of a synthetic hand with taxels on all fingertips, at `session`, and the parameters of such a hand.
fn hand() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for shown in ["params", "models"] {
        let from = Path::new(ROOT).join(shown);
        std::os::unix::fs::symlink(from, folder.path().join(shown)).unwrap();
    }
    let simulate = ["simulate", "--glove", "hand1", "--users", "1", "--sessions", "1", "--minutes=1.7", "--seed", "5"];
    tpf(folder.path(), &[&simulate[..], &["-o", "bags"]].concat()).ok();
    let bag = fs::read_dir(folder.path().join("bags")).unwrap().next().unwrap().unwrap().path();
    fs::rename(bag, folder.path().join("session")).unwrap();
    folder
}

const PARAMS: [&str; 2] = ["--params-file", "params/hand1.yaml"];

fn replay(folder: &Path, more: &[&str]) -> Run {
    tpf(folder, &[&["replay", "session"], &PARAMS[..], more].concat())
}

/// The estimates of each region that a replay wrote, and the beginning of the session.
fn estimates(folder: &Path, bag: &str) -> (Config, Vec<EstimateTrack>, Stamp) {
    let cfg = config::load(&folder.join("params/hand1.yaml"), DEFAULT_NODE).unwrap();
    let topic = "/tactile_pose_fusion/contacts";
    let (tracks, _) = read_estimates(&folder.join(bag), &cfg, topic, &Unobserved).unwrap();
    let begin = tracks[0].stamp[0];
    (cfg, tracks, begin)
}

/// What a number of JSON is: null is NaN.
fn number(value: &Value) -> Option<f64> {
    value.as_f64()
}

/// Checks the frames of a page at some moments against what replay wrote.
fn agree(view: &View, cfg: &Config, tracks: &[EstimateTrack], begin: Stamp) {
    for idx in [0, 20, 63, 64, 1000, 2345, 7001] {
        let stamp = tracks[0].stamp[idx];
        let t = stamp.nanos_since(begin) as f64 * 1e-9;
        let frames = view.json(&format!("frame?t={t}"));
        for (region, (frame, track)) in cfg.fusion().regions().iter().zip(frames.as_array().unwrap().iter().zip(tracks))
        {
            let place = format!("{} at {t} s: {frame}", region.name);
            assert_eq!(frame["t"].as_f64(), Some(t), "{place}");
            assert_eq!(number(&frame["force"]), track.force[idx].map(|force| force.0), "{place}");
            assert_eq!(number(&frame["force_base"]), track.base[idx].map(|force| force.0), "{place}");
            assert_eq!(number(&frame["artifact"]), track.artifact(idx).map(|force| force.0), "{place}");
            assert_eq!(frame["contact"].as_bool(), Some(track.contact[idx]), "{place}");
            assert_eq!(frame["flags"].as_u64(), Some(u64::from(track.flags[idx].bits())), "{place}");
        }
    }
}

#[test]
fn the_page_has_the_numbers_that_replay_writes_computed_or_recorded() {
    let folder = hand();
    let path = folder.path();
    replay(path, &["-o", "merged.mcap", "--merge"]).ok();
    let (cfg, tracks, begin) = estimates(path, "merged.mcap");

    let view = View::start(path, &[&["session"], &PARAMS[..]].concat());
    let setup = view.json("setup");
    assert_eq!((setup["kind"].as_str(), setup["synthetic"].as_bool()), (Some("computed"), Some(true)));
    let fingers: Vec<_> = setup["regions"].as_array().unwrap().iter().map(|region| region["finger"].as_str()).collect();
    assert_eq!(fingers, ["index", "middle", "ring", "little", "thumb"].map(Some));
    agree(&view, &cfg, &tracks, begin);
    let computed = view.json("frame?t=30.005");
    let (status, said) = view.interrupt();
    assert!(status.success() && !said.contains("panicked"), "{status}: {said}");

    // The bag holds estimates: those are shown, without a model, beside the taxels and the true force.
    fs::create_dir(path.join("elsewhere")).unwrap();
    fs::copy(path.join("params/hand1.yaml"), path.join("elsewhere/hand1.yaml")).unwrap();
    let recorded = View::start(path, &["merged.mcap", "--params-file", "elsewhere/hand1.yaml"]);
    let setup = recorded.json("setup");
    assert_eq!((setup["kind"].as_str(), setup["synthetic"].as_bool()), (Some("recorded"), Some(true)));
    assert!(setup["from"].as_str().unwrap().contains("/tactile_pose_fusion/contacts"), "{setup}");
    agree(&recorded, &cfg, &tracks, begin);
    let shown = recorded.json("frame?t=30.005");
    for (shown, computed) in shown.as_array().unwrap().iter().zip(computed.as_array().unwrap()) {
        for key in ["t", "force", "truth", "reading", "contact", "pose_age"] {
            assert_eq!(shown[key], computed[key], "{key}");
        }
        assert!(computed["feature"][0].is_number() && shown["feature"] == Value::Array(Vec::new()));
    }
    assert!(computed[0]["truth"].is_number(), "the sensor was under the index fingertip: {computed}");
    // The zero of the taxels is that of the session either way.
    let zero = |view: &Value| view["regions"][0]["zero"].clone();
    let again = View::start(path, &[&["merged.mcap", "--compute"], &PARAMS[..]].concat());
    assert_eq!(again.json("setup")["kind"], "computed");
    assert_eq!(zero(&setup), zero(&again.json("setup")));
}

#[test]
fn a_window_has_every_frame_or_the_smallest_and_largest_of_many() {
    let folder = hand();
    let path = folder.path();
    replay(path, &["-o", "forces.mcap"]).ok();
    let (_, tracks, begin) = estimates(path, "forces.mcap");
    let view = View::start(path, &[&["forces.mcap"], &PARAMS[..]].concat());
    let setup = view.json("setup");
    let notes = setup["notes"].to_string();
    assert!(notes.contains("no taxels: the bag has no topic /glove/taxels"), "{notes}");
    let length = setup["duration_s"].as_f64().unwrap();
    assert!((length - 102.0).abs() < 3.0, "{length}");

    for points in [50, 500, 5000] {
        let traces = view.json(&format!("traces?from=0&to={length}&points={points}"));
        for (trace, track) in traces.as_array().unwrap().iter().zip(&tracks) {
            let forces: Vec<f64> = trace["force"].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
            assert!(forces.len() <= 2 * points + 2, "{} of {points}", forces.len());
            let written = || track.force.iter().flatten().map(|force| force.0);
            let (least, most) = (written().fold(f64::MAX, f64::min), written().fold(f64::MIN, f64::max));
            assert_eq!(forces.iter().copied().fold(f64::MAX, f64::min), least, "{points}");
            assert_eq!(forces.iter().copied().fold(f64::MIN, f64::max), most, "{points}");
            let contact = trace["contact"].as_array().unwrap().iter().any(|contact| contact == true);
            assert_eq!(contact, track.contact.iter().any(|contact| *contact), "a contact is never left out");
        }
    }
    let traces = view.json("traces?from=20&to=22&points=500");
    let (trace, track) = (&traces[0], &tracks[0]);
    assert_eq!(trace["full_rate"], true);
    let t: Vec<f64> = serde_json::from_value(trace["t"].clone()).unwrap();
    let first = track.stamp.iter().position(|stamp| stamp.nanos_since(begin) as f64 * 1e-9 == t[0]).unwrap();
    for (k, force) in trace["force"].as_array().unwrap().iter().enumerate() {
        assert_eq!(number(force), track.force[first + k].map(|force| force.0));
    }
    for wrong in [
        "traces?from=2&to=1&points=100",
        "traces?from=0&to=1&points=1",
        "traces?from=0&to=1",
        "frame?t=x",
        "frame?t=NaN",
    ] {
        let answer = view.get(wrong);
        assert_eq!(answer.status, 400, "{wrong}: {answer:?}");
    }
    assert_eq!(view.json("frame?t=-1"), serde_json::json!([null, null, null, null, null]), "before the beginning");
    let after = view.json("frame?t=1e300");
    assert_eq!(
        after,
        serde_json::json!([null, null, null, null, null]),
        "after the end nothing is told as if it were now"
    );
}

#[test]
fn only_who_has_the_address_is_answered_and_only_from_this_computer() {
    let folder = hand();
    let view = View::start(folder.path(), &[&["session"], &PARAMS[..]].concat());
    let page = view.get("");
    assert_eq!(page.status, 200);
    for (header, value) in [
        (
            "content-security-policy",
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self'",
        ),
        ("x-content-type-options", "nosniff"),
        ("referrer-policy", "no-referrer"),
        ("cache-control", "no-store"),
        ("content-type", "text/html; charset=utf-8"),
    ] {
        assert!(page.head.contains(&format!("{header}: {value}")), "{header}: {}", page.head);
    }
    let secret = view.url.split('/').nth(3).unwrap();
    assert!(secret.len() == 32 && secret.chars().all(|c| c.is_ascii_hexdigit()), "{secret}");
    let ours = format!("127.0.0.1:{}", view.port());
    for path in
        ["/", "/setup", "/00000000000000000000000000000000/setup", &format!("/{secret}/../setup"), "/favicon.ico"]
    {
        let answer = view.ask("127.0.0.1", path, &ours);
        assert!(answer.status == 404 && answer.body.is_empty(), "{path}: {answer:?}");
    }
    // A name of elsewhere that was made to lead here.
    for host in ["evil.example", "evil.example:80", "127.0.0.1", "127.0.0.1.evil.example", "0.0.0.0:80"] {
        let answer = view.ask("127.0.0.1", &format!("/{secret}/setup"), host);
        assert!(answer.status == 421 && !answer.body.contains("regions"), "{host}: {answer:?}");
    }
    assert_eq!(view.ask("127.0.0.1", &format!("/{secret}/setup"), &format!("localhost:{}", view.port())).status, 200);
    // All of 127.0.0.0/8 is the loopback: a server on any address would answer there too.
    assert!(std::net::TcpStream::connect(("127.0.0.2", view.port())).is_err());
    let (status, said) = view.interrupt();
    assert!(status.success(), "{status}: {said}");
}

#[test]
fn what_can_not_be_shown_is_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    common::bags::write_session(&path.join("session.mcap"), 4);
    common::onnx::LinearModel::new(4, 2, 2).metadata("unit", "N").write(path, "model.onnx");
    common::tpf::write_params(path, 2, &["pip", "dip"], "    calibration.insist: true\n");
    fs::write(path.join("text.mcap"), "no bag").unwrap();
    fs::write(path.join("wrong.yaml"), "/**:\n  ros__parameters:\n    regions: []\n").unwrap();
    let params = ["--params-file", "params.yaml", "--calibrate-first", "2"];
    let view = |args: &[&str]| tpf(path, &[&["view", "--no-open"], args].concat());
    let refused = |args: &[&str]| view(&[args, &params].concat()).failure().to_owned();

    assert!(refused(&["none.mcap"]).starts_with("none.mcap: "), "{}", refused(&["none.mcap"]));
    assert!(refused(&["text.mcap"]).contains("text.mcap"), "{}", refused(&["text.mcap"]));
    let run = view(&["session.mcap", "--params-file", "wrong.yaml"]);
    assert!(run.failure().starts_with("wrong.yaml: tactile_sources is required"), "{run:?}");
    let run = view(&["session.mcap", "--params-file", "none.yaml"]);
    assert!(run.failure().contains("none.yaml"), "{run:?}");
    let line = refused(&["session.mcap", "--model", "none.onnx"]);
    assert!(line.contains("none.onnx"), "{line}");

    let taken = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let line = refused(&["session.mcap", "--port", &port]);
    assert!(line.contains(&format!("port {port} of 127.0.0.1 can't be used")) && line.contains("--port"), "{line}");
    drop(taken);
    let there = View::start(path, &[&["session.mcap", "--port", &port], &params[..]].concat());
    assert_eq!(there.port().to_string(), port);

    for usage in [&["session.mcap", "--port", "0"][..], &["session.mcap", "--port", "70000"], &[]] {
        let run = view(&[usage, &params].concat());
        assert!(run.code == 2 && run.stdout.is_empty(), "{run:?}");
    }
    let no_space = std::process::Command::new(env!("CARGO_BIN_EXE_tpf"))
        .current_dir(path)
        .args(["view", "--no-open", "session.mcap"])
        .args(params)
        .env("TMPDIR", path.join("nowhere"))
        .output()
        .unwrap();
    let run = Run::from(no_space);
    assert!(run.failure().contains("nowhere") && run.failure().contains("TMPDIR"), "{run:?}");
}

#[test]
fn the_browser_of_the_desktop_is_opened_at_the_address_and_where_there_is_none_that_is_said() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    common::bags::write_session(&path.join("session.mcap"), 4);
    common::onnx::LinearModel::new(4, 2, 2).metadata("unit", "N").write(path, "model.onnx");
    common::tpf::write_params(path, 2, &["pip", "dip"], "    calibration.insist: true\n");
    let args = ["session.mcap", "--params-file", "params.yaml", "--calibrate-first", "2"];
    let programs = path.join("programs");
    fs::create_dir(&programs).unwrap();
    let (opener, opened) = (programs.join("xdg-open"), path.join("opened"));
    let script = format!("#!/bin/sh\necho \"$1\" > {0}.part && /bin/mv {0}.part {0}\n", opened.display());
    fs::write(&opener, script).unwrap();
    fs::set_permissions(&opener, fs::Permissions::from_mode(0o755)).unwrap();

    let view = View::start_with(path, &args, programs.to_str().unwrap());
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(20);
    while !opened.exists() {
        assert!(std::time::Instant::now() < deadline, "nothing was opened");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert_eq!(fs::read_to_string(&opened).unwrap().trim_end(), view.url);
    drop(view);

    let nowhere = path.join("nowhere");
    let view = View::start_with(path, &args, nowhere.to_str().unwrap());
    assert_eq!(view.get("").status, 200, "the page is there all the same");
    let (status, said) = view.interrupt();
    assert!(status.success() && said.contains("no browser could be opened"), "{status}: {said}");
}

#[test]
fn a_browser_shows_it_and_scrubs_through_it_and_asks_nobody_else() {
    let folder = hand();
    let path = folder.path();
    replay(path, &["-o", "merged.mcap", "--merge"]).ok();
    let (cfg, tracks, begin) = estimates(path, "merged.mcap");
    let view = View::start(path, &[&["session"], &PARAMS[..]].concat());
    let Some(seen) = view.look(&["--times", "30.5,71.25,98.125"]) else { return };
    let desktop = &seen["desktop"];
    let text = desktop["text"].as_str().unwrap();
    assert!(text.contains("SYNTHETIC DATA") && text.contains("Forces computed for this page by"), "{text}");
    for at in desktop["at"].as_array().unwrap() {
        let t = at["t"].as_f64().unwrap();
        let idx = tracks[0].stamp.partition_point(|stamp| stamp.nanos_since(begin) as f64 * 1e-9 <= t) - 1;
        for (region, track) in cfg.fusion().regions().iter().zip(&tracks) {
            let card = &at["cards"][&region.name];
            let force = track.force[idx].unwrap().0;
            assert_eq!(card["force"].as_str().unwrap().parse::<f64>().unwrap(), force, "{} at {t}", region.name);
            let shown: f64 = card["shown"].as_str().unwrap().parse().unwrap();
            assert!((shown - force).abs() <= 0.005 + 1e-9, "{} at {t}: {shown}", region.name);
            assert_eq!(card["contact"].as_str().unwrap(), track.contact[idx].to_string());
            assert_eq!(card["taxels"].as_array().unwrap().len(), 6);
            let plot = &at["plots"][&region.name];
            assert!(plot["colours"].as_u64().unwrap() > 3, "a plot with lines: {plot}");
        }
    }
    let playhead = |idx: usize| desktop["at"][idx]["plots"]["index"]["playhead"].as_f64().unwrap();
    assert!(playhead(0) < playhead(1) && playhead(1) < playhead(2), "the mark moves with the slider");
    let kinds: Vec<&String> = desktop["kinds"].as_object().unwrap().keys().collect();
    assert_eq!(kinds, ["above", "corrected", "sent"], "these models take the artifact out of the taxels");
    let of_kind = |kind: &str| desktop["kinds"][kind]["index"]["taxels"][0].as_f64().unwrap();
    let frames = view.json("frame?t=98.125");
    assert_eq!(of_kind("sent"), frames[0]["reading"][0].as_f64().unwrap());
    assert!((of_kind("corrected") - frames[0]["feature"][0].as_f64().unwrap()).abs() < 1e-4);
    let zero = view.json("setup")["regions"][0]["zero"][0].as_f64().unwrap();
    assert!((of_kind("above") - (frames[0]["reading"][0].as_f64().unwrap() - zero)).abs() < 1e-4);
    assert_eq!(desktop["stands_still"], true, "space pauses");
    let window = |name: &str| -> [f64; 2] { serde_json::from_value(desktop[name].clone()).unwrap() };
    let (whole, zoomed, dragged) = (window("whole"), window("zoomed"), window("dragged"));
    assert!(zoomed[1] - zoomed[0] < 0.6 * (whole[1] - whole[0]), "{zoomed:?}");
    assert!((dragged[0] - 0.25 * whole[1]).abs() < 1.0 && (dragged[1] - 0.5 * whole[1]).abs() < 1.0, "{dragged:?}");
    for (name, seen) in seen.as_object().unwrap() {
        assert_eq!(seen["paper"]["background"], "rgb(255, 255, 255)", "{name}: paper is light");
        assert!(seen["paper"]["width"].as_f64().unwrap() <= 680.0, "{name}: {}", seen["paper"]);
    }
}

#[test]
fn taxels_without_their_artifact_are_shown_where_the_model_takes_it_out() {
    let folder = hand();
    let path = folder.path();
    let simulate = ["simulate", "--glove", "1", "--users", "1", "--sessions", "1", "--minutes=1.7", "--seed", "5"];
    tpf(path, &[&simulate[..], &["-o", "one"]].concat()).ok();
    let bag = fs::read_dir(path.join("one")).unwrap().next().unwrap().unwrap().path();
    let args = ["--params-file", "params/glove1.yaml", "--model", "models/glove1_adaptive.onnx"];
    let view = View::start(path, &[&[bag.to_str().unwrap()], &args[..]].concat());
    let setup = view.json("setup");
    let region = &setup["regions"][0];
    assert!(region["has"].as_array().unwrap().iter().any(|name| name == "artifact_change"), "{region}");
    let zero: Vec<f64> = serde_json::from_value(region["zero"].clone()).unwrap();
    let n_differ = (10..90).filter(|t| {
        let frame = &view.json(&format!("frame?t={t}"))[0];
        let number = |key: &str, idx: usize| frame[key][idx].as_f64().unwrap();
        (0..6).any(|idx| (number("reading", idx) - zero[idx] - number("feature", idx)).abs() > 1.0)
    });
    assert!(n_differ.count() > 40, "bending is taken out of the taxels");
    let Some(seen) = view.look(&["--times", "50.5"]) else { return };
    let kinds: Vec<&String> = seen["desktop"]["kinds"].as_object().unwrap().keys().collect();
    assert_eq!(kinds, ["above", "corrected", "sent"]);
    // A model that takes nothing out is given what is above the zero.
    let other = ["--params-file", "params/glove1.yaml", "--model", "models/glove1_pose_aware.onnx"];
    let view = View::start(path, &[&[bag.to_str().unwrap()], &other[..]].concat());
    let Some(seen) = view.look(&["--times", "50.5"]) else { return };
    let kinds = &seen["desktop"]["kinds"];
    assert!(kinds["corrected"].is_null() && !kinds["sent"].is_null(), "{kinds}");
    let above = kinds["above"]["index"]["taxels"][0].as_f64().unwrap();
    assert!((above - view.json("frame?t=50.5")[0]["feature"][0].as_f64().unwrap()).abs() < 1e-4);
}
