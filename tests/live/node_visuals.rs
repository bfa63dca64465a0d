//! Markers, images and frames of the node, as RViz would subscribe to them.
//!
//! Every test here starts DDS participants, so it runs inside of `tests/ros/isolated` only.

use crate::node_common;

use node_common::peer;
use node_common::scene::Scene;
use serde_json::Value;

fn seen(scene: &Scene, n_messages: usize) -> Value {
    serde_json::from_str(&peer(&scene.python, "pictures.py", &[&n_messages.to_string()], scene.path())).unwrap()
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
    let seen = seen(&scene, 20);
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
    assert_eq!(self::seen(&scene, 3)["markers"].as_array().unwrap().len(), 3);
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
