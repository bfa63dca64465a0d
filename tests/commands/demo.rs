//! `tpf demo` runs from nothing and shows what it says.

use crate::common;

use std::fs;

use common::tpf::tpf;

#[test]
fn the_demo_leaves_bags_and_a_picture_and_says_that_it_is_synthetic() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let run = tpf(folder, &["demo", "--minutes=2", "-o", "shown"]).ok();
    assert!(run.stderr.contains("SYNTHETIC DEMO") && !run.stderr.contains("interrupts"), "{run:?}");
    let models = ["glove3_taxels_times_gain", "glove3_tactile_only", "glove3_pose_aware", "glove3_adaptive"];
    for told in ["SYNTHETIC data", "MDF gF", "With your own glove"].into_iter().chain(models) {
        assert!(run.stdout.contains(told), "{told}: {run:?}");
    }
    let replayed = ["taxels_times_gain", "tactile_only", "pose_aware", "adaptive"];
    for made in ["session", "force.svg", "params/glove3.yaml"].into_iter().chain(replayed) {
        assert!(folder.join("shown").join(made).exists(), "{made}");
    }
    let svg = fs::read_to_string(folder.join("shown/force.svg")).unwrap();
    for drawn in [
        "Synthetic glove 3",
        "true force",
        "taxels-times-gain",
        "tactile-only",
        "pose-aware",
        "adaptive",
        "contact, true",
    ] {
        assert!(svg.contains(drawn), "{drawn}");
    }

    // The command that it proposes works, and a second demo takes its place.
    let params = "shown/params/glove3.yaml";
    let scored = tpf(folder, &["eval", "shown/session", "--params-file", params, "--whole", "--by", "substage"]).ok();
    assert!(scored.stdout.contains("/ touches"), "{scored:?}");
    fs::create_dir(folder.join("mine")).unwrap();
    let refused = tpf(folder, &["demo", "-o", "mine"]);
    assert!(refused.failure().contains("mine: is there and was not made by a demo"), "{refused:?}");
}
