//! Parameter files and overrides on the command line.

use tactile_pose_fusion::config::{Config, DEFAULT_NODE, parse_param_file};
use tactile_pose_fusion::fusion::Fusion;

use super::common::fake::Sum;
use super::common::scored;
use super::driver::{Answer, Target};
use super::mutate::{self, Random};

pub const TARGET: Target = Target { name: "params", seeds, mutate: other, run, min_understood: 0.1 };

const WORDS: [&str; 64] = [
    "regions",
    "tactile_sources",
    "joint_sources",
    "truth_sources",
    "index",
    "glove",
    "hand",
    "tip",
    "tactile.glove",
    "topic",
    "type",
    "n_taxels",
    "field",
    "stamp",
    "header.stamp",
    "rows",
    "row_period",
    "stamp_offset_ms",
    "sign",
    "frame_clock",
    "grid",
    "joint.hand",
    "degrees",
    "scale",
    "model.tip",
    "path",
    "unit",
    "gF",
    "rate_hz",
    "region.index",
    "taxels",
    "joints",
    "frame_id",
    "normal",
    "contact.force_on",
    "contact.force_off",
    "timing.max_gap_ms",
    "timing.joint_slack_ms",
    "calibration.file",
    "/**",
    "ros__parameters",
    "{",
    "}",
    "[",
    "]",
    "[]",
    ",",
    ":",
    "-",
    "&a",
    "*a",
    "!!str",
    "|",
    ">",
    "\"",
    "'",
    "~",
    "true",
    ".nan",
    ".inf",
    "1e308",
    "-0.0",
    "0x10",
    "\u{0}",
];

fn seeds() -> Vec<Vec<u8>> {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut seeds: Vec<Vec<u8>> = ["glove1", "glove3", "example"]
        .map(|name| std::fs::read(root.join(format!("params/{name}.yaml"))).unwrap())
        .to_vec();
    seeds.push(scored::PARAMS.as_bytes().to_vec());
    seeds.push(
        b"tactile_pose_fusion:\n  ros__parameters:\n    regions: [a, b]\n    tactile_sources: [t]\n    joint_sources: [j]\n    \
          tactile:\n      t: {topic: taxels, type: std_msgs/msg/Float32MultiArray, n_taxels: 4, frame_clock: grid, stamp_offset_ms: -3.5}\n    \
          joint.j: {topic: ~/joints, degrees: true}\n    model.m: {path: m.onnx, unit: gF, rate_hz: 100.0}\n    \
          region.a: {model: m, taxels: [0, 1], joints: [x], frame_id: a}\n    region.b: {model: m, taxels: [2, 3], joints: [y], frame_id: b}\n\
          -p timing.max_gap_ms:=20.0\n"
            .to_vec(),
    );
    seeds
}

fn other(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    // Comments are most of the example, and changing them tells nothing.
    let text = String::from_utf8_lossy(seed);
    let told: Vec<&str> = text.lines().filter(|line| !line.trim_start().starts_with('#')).collect();
    mutate::text(random, told.join("\n").as_bytes(), other, &WORDS)
}

/// Lines that begin with `-p ` are overrides, all others the file.
fn run(input: &[u8]) -> Answer {
    let text = String::from_utf8_lossy(input);
    let (rules, lines): (Vec<&str>, Vec<&str>) = text.split('\n').partition(|line| line.starts_with("-p "));
    let mut tree = match parse_param_file(&lines.join("\n"), "params.yaml", DEFAULT_NODE) {
        Ok(tree) => tree,
        Err(error) => return super::one_line(&error),
    };
    for rule in rules {
        if let Err(error) = tree.set_override(&rule[3..]) {
            return super::one_line(&error);
        }
    }
    let cfg = match Config::from_tree(&tree) {
        Ok(cfg) => cfg,
        Err(error) => return super::one_line(&error),
    };
    // What is accepted can be run, by models that fit it.
    let n_taxels = cfg.fusion().regions().first().map_or(0, |region| region.taxels.len());
    let n_joints = cfg.fusion().regions().first().map_or(0, |region| region.joints.len());
    let models = cfg.models().iter().map(|_| Sum::boxed(2, n_taxels, n_joints) as _).collect();
    if let Err(error) = Fusion::new(cfg.fusion().clone(), models) {
        super::one_line(&error);
    }
    assert_eq!(cfg.fusion().batch().get(), 1);
    let values: Vec<(String, String)> =
        tree.iter().map(|(key, param)| (key.to_owned(), param.value.to_string())).collect();
    let keys: Vec<&str> = values.iter().map(|(key, _)| key.as_str()).collect();
    Answer::understood(&(keys.len(), keys.first().copied(), keys.last().copied()))
}
