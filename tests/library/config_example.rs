//! `params/example.yaml` explains every parameter and shows exactly the defaults.

use std::path::Path;

use tactile_pose_fusion::config::keys::{KEYS, ParamDefault, find};
use tactile_pose_fusion::config::{self, Config, DEFAULT_NODE, parse_param_file};

const EXAMPLE: &str = include_str!("../../params/example.yaml");

/// Optional keys that say what the example's glove is like, so that they can't show their defaults.
const OF_THE_EXAMPLE: [&str; 3] = ["joint_sources", "truth_sources", "region.<name>.joints"];

/// Optional keys that exclude another one or would override it, so that the example has them as comments.
fn is_commented(pattern: &str) -> bool {
    matches!(pattern, "tactile.<source>.row_period_ms" | "joint.<source>.names" | "timing.max_pose_age_ms")
        || matches!(pattern, "tactile.<source>.fields" | "tactile.<source>.no_reading" | "joint.<source>.hand.points")
        || matches!(pattern, "truth.<source>.fields" | "truth.<source>.signs")
        || matches!(pattern, "contact.touch_on" | "contact.touch_off" | "region.<name>.layout.shape")
        || pattern.starts_with("region.<name>.contact.")
}

#[test]
fn the_example_shows_every_key() {
    let tree = parse_param_file(EXAMPLE, "params/example.yaml", DEFAULT_NODE).unwrap();
    for key in KEYS {
        let shown = tree.iter().any(|(shown, _)| key.name_in(shown).is_some());
        assert_eq!(shown, !is_commented(key.pattern), "{}", key.pattern);
        if !shown {
            let last = key.pattern.rsplit('.').next().unwrap();
            let comment = |line: &str| line.trim_start().starts_with('#') && line.contains(&format!(" {last}: "));
            assert!(EXAMPLE.lines().any(comment), "{} is not even a comment", key.pattern);
        }
    }
}

#[test]
fn what_the_example_sets_is_the_default() {
    let tree = parse_param_file(EXAMPLE, "params/example.yaml", DEFAULT_NODE).unwrap();
    for (key, param) in tree.iter() {
        let known = find(key).unwrap();
        match known.default.value() {
            Some(_) if OF_THE_EXAMPLE.contains(&known.pattern) => {}
            Some(default) => assert_eq!(param.value, default, "{key}"),
            None => {}
        }
    }
}

/// Defaults that depend on other keys are compared by what becomes of them.
#[test]
fn leaving_out_every_optional_key_changes_nothing() {
    let tree = parse_param_file(EXAMPLE, "params/example.yaml", DEFAULT_NODE).unwrap();
    let mut bare = tactile_pose_fusion::config::ParamTree::empty(DEFAULT_NODE);
    for (key, param) in tree.iter() {
        let known = find(key).unwrap();
        if known.default == ParamDefault::Required || OF_THE_EXAMPLE.contains(&known.pattern) {
            bare.set(key, param.value.clone(), param.origin.clone());
        }
    }
    assert_eq!(Config::from_tree(&bare).unwrap(), Config::from_tree(&tree).unwrap());
}

#[test]
fn every_key_of_the_example_has_a_comment_above_it() {
    let mut commented = false;
    let mut group_indent = None; // keys below a commented mapping share its comment
    for line in EXAMPLE.lines() {
        let text = line.trim_start();
        let indent = line.len() - text.len();
        if text.is_empty() {
            commented = false;
            continue;
        }
        if text.starts_with('#') {
            commented = true;
            continue;
        }
        if group_indent.is_some_and(|group| indent <= group) {
            group_indent = None;
        }
        let is_mapping = text.ends_with(':');
        if is_mapping && commented && matches!(text, "inputs:" | "outputs:") {
            group_indent = Some(indent);
        }
        assert!(is_mapping || commented || group_indent.is_some(), "no comment above: {line}");
        commented = false;
    }
}

#[test]
fn every_range_of_the_table_is_in_the_example() {
    for key in KEYS.iter().filter(|key| !is_commented(key.pattern)) {
        let range = key.range.to_string();
        let Some(range) = range.strip_prefix("in ") else { continue };
        if matches!(key.pattern, "tactile.<source>.cols" | "region.<name>.taxels") {
            continue; // bounded by n_taxels, which has its own range
        }
        let in_words = range.trim_matches(['[', ']']).replace(", ", " to ");
        let explained = EXAMPLE.lines().any(|line| line.contains(range) || line.contains(&in_words));
        assert!(explained, "{}: {range}", key.pattern);
    }
}

#[test]
fn the_example_loads_with_paths_from_its_own_folder() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("params/example.yaml");
    let config = config::load(&path, DEFAULT_NODE).unwrap();
    assert_eq!(config.models()[0].spec.path, path.parent().unwrap().join("../models/fingertip.onnx"));
    assert_eq!(config.node.to_string(), "/tactile_pose_fusion");
    assert_eq!(config.fusion().regions()[0].taxels, [0, 1, 2, 3, 4, 5]);
    assert_eq!(config.fusion().regions()[0].joints.len(), 4);
    assert_eq!(config.fusion().batch().get(), 1);
    assert_eq!(config.tactile()[0].name, "/glove/taxels");
    assert!(config.keys().contains_key("region.index.contact.force_on"));
}
