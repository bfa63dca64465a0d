//! `tpf view --live`: a node on a page, as it comes, and never as if it came when it doesn't.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use common::bags::{decoded, write_session};
use common::tpf::tpf;
use common::view::View;
use node_common::{Live, PARAMS, write_setup};
use serde_json::Value;
use tactile_pose_fusion::msg::ContactArray;
use tactile_pose_fusion::units::Stamp;

const CALIBRATED: [&str; 2] = ["--calibration", "calibration.yaml"];
const LIVE: [&str; 5] = ["--live", "--params-file", "live.yaml", "--calibration", "calibration.yaml"];

fn play(folder: &Path, args: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tpf"));
    command.current_dir(folder).args(["play", "session.mcap"]).args(args);
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// A session, its replay, and a running node.
fn place() -> (tempfile::TempDir, Live, Vec<ContactArray>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_session(&path.join("session.mcap"), 8);
    write_setup(path, "tactile_pose_fusion/msg/TaxelArray", "");
    let args = ["--params-file", PARAMS, "--batch", "1", "-o", "replayed.mcap"];
    tpf(path, &[&["replay", "session.mcap"], &args[..], &CALIBRATED].concat()).ok();
    let expected = decoded(&path.join("replayed.mcap"), "/tactile_pose_fusion/contacts");
    let live = Live::start(path, &[&["--params-file", "live.yaml"], &CALIBRATED[..]].concat());
    (folder, live, expected)
}

#[test]
fn a_page_has_the_numbers_of_the_node_and_says_when_they_no_longer_come() {
    if !common::skip::isolated() {
        return;
    }
    let (folder, live, expected) = place();
    let path = folder.path();
    let view = View::start(path, &LIVE);
    let setup = view.json("setup");
    assert_eq!((setup["kind"].as_str(), setup["regions"][0]["n_taxels"].as_u64()), (Some("live"), Some(2)));
    assert!(setup["regions"][0]["zero"].is_array(), "that of the calibration: {setup}");
    assert_eq!(view.get("traces?from=0&to=1&points=100").status, 404, "there is no bag");

    let mut events = view.events();
    assert_ne!(events.next_update()["state"], "gone");
    let mut playing = play(path, &["--delay", "2"]);
    let (mut heard, mut states, mut readings) = (Vec::new(), Vec::new(), 0);
    let mut ended_at = None;
    let update = loop {
        let update = events.next_update();
        let state = update["state"].as_str().unwrap().to_owned();
        let region = &update["regions"][0];
        let numbers = |key: &str| region[key].as_array().unwrap().clone();
        let t = numbers("t");
        for (k, t) in t.iter().enumerate() {
            let of = |key: &str| numbers(key)[k].clone();
            heard.push((t.as_f64().unwrap(), of("force"), of("flags").as_u64().unwrap()));
        }
        readings += u64::from(region["reading"].is_array());
        if states.last() != Some(&state) {
            states.push(state.clone());
        }
        if playing.try_wait().unwrap().is_some() && ended_at.is_none() {
            ended_at = Some(heard.len());
        }
        // Long after the bag, the node still says that no taxels come.
        if ended_at.is_some_and(|at| heard.len() > at + 3) && heard.last().unwrap().2 == 8 {
            break update;
        }
    };
    assert!(states.contains(&"present".to_owned()) && !states.contains(&"gone".to_owned()), "{states:?}");
    assert!(update["regions"][0]["reading"].is_null() && readings > 100, "old taxels are not shown: {readings}");
    let of_bag: Vec<_> = heard.iter().filter(|(_, _, flags)| *flags != 8).collect();
    let mut n_found = 0;
    for (t, force, flags) in of_bag {
        let is_it = |array: &&ContactArray| (Stamp::from(array.header.stamp).0 as f64 * 1e-9 - t).abs() < 1e-6;
        let Some(found) = expected.iter().find(is_it) else { continue };
        n_found += 1;
        let state = &found.contacts[0];
        assert_eq!(u64::from(state.flags), *flags);
        assert!(force.as_f64().map_or(state.force.is_nan(), |force| force == state.force), "{force} {}", state.force);
    }
    // Contacts are fast data, of which a subscription may miss some.
    assert!(10 * n_found >= 9 * expected.len(), "{n_found} of {}", expected.len());
    assert!(heard.iter().filter(|(_, _, flags)| *flags == 8).all(|(_, force, _)| force.is_null()));

    live.stop();
    let states = events.states_until("gone");
    assert!(states.iter().all(|state| ["present", "silent", "gone"].contains(&state.as_str())), "{states:?}");
    let (status, said) = view.interrupt();
    assert!(status.success() && !said.contains("panicked"), "{status}: {said}");
}

#[test]
fn a_browser_shows_a_node_that_comes_and_goes() {
    if !common::skip::isolated() {
        return;
    }
    let (folder, live, _) = place();
    let path = folder.path();
    let view = View::start(path, &LIVE);
    let (ready, folder_of_play) = (path.join("ready"), path.to_path_buf());
    let is_ready = ready.clone();
    let acts = std::thread::spawn(move || {
        let deadline = Instant::now() + Duration::from_secs(60);
        while !is_ready.exists() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(50));
        }
        play(&folder_of_play, &["--delay", "2"]).wait().unwrap();
        std::thread::sleep(Duration::from_secs(3)); // the watchdog's flag is to be seen
        live.stop();
    });
    let seen = view.look(&["--live", "60", "--ready", ready.to_str().unwrap()]);
    fs::write(&ready, "").unwrap(); // also where there is no browser
    acts.join().unwrap();
    let Some(seen) = seen else { return };
    let states: Vec<&Value> = seen["desktop"]["states"].as_array().unwrap().iter().collect();
    let names: Vec<&str> = states.iter().map(|state| state["state"].as_str().unwrap()).collect();
    assert_eq!(names.last(), Some(&"gone"), "{names:?}");
    let present = states.iter().rev().find(|state| state["state"] == "present").unwrap();
    assert!(present["text"].as_str().unwrap().starts_with("LIVE"), "{present}");
    assert!(present["cards"]["index"]["text"].as_str().unwrap().contains("STALE_TACTILE"), "{present}");
    let gone = states.last().unwrap();
    assert_eq!((&gone["cards"]["index"]["force"], &gone["cards"]["index"]["shown"]), (&"".into(), &"\u{2013}".into()));
    assert!(gone["text"].as_str().unwrap().contains("no longer in the graph"), "{gone}");
}

#[test]
fn what_can_not_be_followed_is_said_in_one_line() {
    if !common::skip::isolated() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_session(&path.join("session.mcap"), 4);
    write_setup(path, "tactile_pose_fusion/msg/TaxelArray", "");
    let run = tpf(path, &["view", "--live", "--no-open", "--params-file", "none.yaml"]);
    assert!(run.failure().contains("none.yaml"), "{run:?}");
    let live = fs::read_to_string(path.join("live.yaml")).unwrap();
    let strange = live.replace("tactile_pose_fusion/msg/TaxelArray", "nobody_msgs/msg/Skin, field: values");
    fs::write(path.join("strange.yaml"), strange).unwrap();
    let run = tpf(path, &["view", "--live", "--no-open", "--params-file", "strange.yaml"]);
    assert!(run.failure().contains("nobody_msgs/msg/Skin"), "{run:?}");
    for wrong in [&["session.mcap", "--live"][..], &["--live", "--model", "model.onnx"], &["--live", "--compute"]] {
        let run = tpf(path, &[&["view", "--no-open", "--params-file", PARAMS], wrong].concat());
        assert_eq!(run.code, 2, "{run:?}");
    }
}
