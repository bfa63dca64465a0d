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

#[test]
fn the_demo_of_a_hand_draws_and_scores_each_finger() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let run = tpf(folder, &["demo", "--glove", "hand1", "--minutes=2", "-o", "shown"]).ok();
    assert!(run.stderr.contains("SYNTHETIC DEMO: a simulated glove hand1"), "{run:?}");
    // In two minutes the load cell was under some of the fingers.
    let names = [
        "SYNTHETIC data",
        "hand1/middle",
        "hand1/ring",
        "hand1_taxels_times_gain",
        "hand1_adaptive",
        "regions of glove hand1",
    ];
    for told in names {
        assert!(run.stdout.contains(told), "{told}: {run:?}");
    }
    assert!(!run.stdout.contains("tactile-only") && !run.stdout.contains("pose-aware"), "no such models: {run:?}");
    for made in [
        "session",
        "taxels_times_gain",
        "adaptive",
        "force.svg",
        "params/hand1_shared.yaml",
        "models/hand1_adaptive.onnx",
        "models/hand1_taxels_times_gain.onnx",
    ] {
        assert!(folder.join("shown").join(made).exists(), "{made}");
    }
    let svg = fs::read_to_string(folder.join("shown/force.svg")).unwrap();
    for drawn in ["Synthetic glove hand1", "true force", "index", "middle", "ring", "little", "thumb", "time, s"] {
        assert!(svg.contains(&format!("\n{drawn}")), "{drawn}");
    }
    for row in ["contact, true", "contact, taxels-times-gain", "contact, adaptive"] {
        assert_eq!(svg.matches(row).count(), 5, "{row}");
    }

    let proposed = run.stdout.lines().find(|line| line.trim_start().starts_with("tpf eval shown/session")).unwrap();
    let words: Vec<&str> = proposed.split_whitespace().skip(1).collect();
    let scored = tpf(folder, &words).ok();
    assert!(scored.stdout.contains("hand1/ring / 0 / touches"), "{scored:?}");
    assert!(folder.join("report.html").exists());
}

#[test]
fn a_glove_that_the_demo_does_not_have_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    for unknown in ["0", "4", "03", "hand", "hand2", ""] {
        let refused = tpf(folder.path(), &["demo", "--glove", unknown, "-o", "out"]);
        assert_eq!(refused.code, 2, "{refused:?}");
        let told = format!("expected 1, 2, 3 or hand1, got {unknown:?}");
        assert!(refused.stderr.lines().next().is_some_and(|line| line.ends_with(&told)), "{refused:?}");
    }
    assert!(!folder.path().join("out").exists());
}
