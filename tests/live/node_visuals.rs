//! Markers, images and frames of the node, as RViz would subscribe to them.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::common;
use crate::node_common;

use std::path::Path;
use std::process::{Child, Command, Stdio};

use common::ROOT;
use node_common::scene::Scene;
use node_common::{Live, peer};
use serde_json::Value;

fn seen(python: &Path, folder: &Path, n_messages: usize) -> Value {
    serde_json::from_str(&peer(python, "pictures.py", &[&n_messages.to_string()], folder)).unwrap()
}

/// A synthetic glove that publishes until it is dropped.
struct Glove(Child);

impl Drop for Glove {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn who_subscribes_to_pictures_gets_arrows_taxels_and_images_at_their_rate() {
    let Some(scene) =
        Scene::set("    region.index.layout.shape: [1, 2]\n    visualization: {tf: true, rate_hz: 10.0}\n")
    else {
        return;
    };
    let _feeder = scene.feed(&["both", "60"]);
    let estimate = scene.wait_for_estimates();
    let seen = seen(&scene.python, scene.path(), 20);
    let markers = seen["markers"].as_array().unwrap();
    let kinds: Vec<(i64, i64)> =
        markers.iter().map(|marker| (marker["id"].as_i64().unwrap(), marker["type"].as_i64().unwrap())).collect();
    assert_eq!(kinds, [(0, 6), (1, 0), (2, 9)], "taxels, arrow, text: {seen}");
    for marker in markers {
        assert_eq!((marker["ns"].as_str(), marker["frame"].as_str()), (Some("index"), Some("index_tip")), "{marker}");
        assert!(marker["stamp"].as_i64().unwrap() > estimate.stamp, "{marker}");
    }
    assert_eq!((markers[0]["points"].as_array().unwrap().len(), markers[0]["colors"].as_u64()), (2, Some(2)), "{seen}");
    assert!(markers[2]["text"].as_str().unwrap().starts_with("index "), "{seen}");
    // The wide limits are for a machine with other work to do.
    assert!((5.0..12.0).contains(&seen["rate_hz"].as_f64().unwrap()), "{seen}");
    // The model removes no artifact from the taxels, so there is one panel: two taxels of 24 pixels.
    assert_eq!(seen["images"][0], serde_json::json!({"size": [48, 24], "encoding": "rgb8", "bytes": 48 * 24 * 3}));
    assert_eq!(seen["frames"], serde_json::json!([["index_tip", "index_patch"]]), "who comes late gets them, too");
    // The next who subscribes gets pictures just as well.
    assert_eq!(self::seen(&scene.python, scene.path(), 3)["markers"].as_array().unwrap().len(), 3);
    scene.live.stop();
}

#[test]
fn a_node_that_is_told_so_has_no_topics_of_pictures_and_no_frames() {
    let Some(scene) = Scene::set("    visualization.publish: never\n") else { return };
    let _feeder = scene.feed(&["both", "60"]);
    scene.wait_for_estimates();
    assert_eq!(peer(&scene.python, "interfaces.py", &["no_pictures"], scene.path()), "ok");
    scene.live.stop();
}

#[test]
fn the_hand_without_a_urdf_has_its_fingertips_in_frames_that_listeners_of_tf_get() {
    let Some(python) = common::skip::ros_python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let root = Path::new(ROOT);
    let glove = Command::new(env!("CARGO_BIN_EXE_tpf"))
        .args(["simulate", "--live", "--glove", "hand1", "--hand", "transforms", "--seed", "7", "--ignore-prompts"])
        .current_dir(folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    let _glove = Glove(glove.unwrap());
    let [hand, frames] = ["params/hand1.yaml", "launch_configs/hand_frames.yaml"].map(|file| root.join(file));
    let args = ["--ros-args", "--params-file", hand.to_str().unwrap(), "--params-file", frames.to_str().unwrap()];
    let live = Live::start(folder.path(), &args);
    let seen = seen(&python, folder.path(), 5);
    let of_markers: std::collections::BTreeSet<&str> =
        seen["markers"].as_array().unwrap().iter().map(|marker| marker["frame"].as_str().unwrap()).collect();
    let tips = ["index_tip", "little_tip", "middle_tip", "ring_tip", "thumb_tip"];
    assert!(of_markers.iter().eq(&tips), "{seen}");
    let moving: Vec<&str> = seen["moving"].as_array().unwrap().iter().map(|frame| frame.as_str().unwrap()).collect();
    assert!(moving.len() == 20 && tips.iter().all(|tip| moving.contains(tip)), "{seen}");
    // Three rows of two taxels, as sent, and beside them without the artifact, which the models of the hand take out.
    assert_eq!(seen["images"][0]["size"], serde_json::json!([108, 72]), "{seen}");
    live.stop();
}
