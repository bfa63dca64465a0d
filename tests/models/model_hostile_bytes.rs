//! Damaged model files are refused without a panic, a hang, or an allocation that the file does not account for.

use crate::common;

use std::path::Path;

use common::bags::{Bag, at};
use common::graphs::{behind, floats, integers, node};
use common::onnx::LinearModel;
use common::tpf::{tpf, write_params};
use proptest::prelude::*;
use tactile_pose_fusion::model::onnx::{AttributeProto, GraphProto, Message, ModelProto, ValueInfoProto};
use tactile_pose_fusion::model::{self, BackendChoice, ModelSpec};

fn small_model() -> Vec<u8> {
    let linear = LinearModel::new(4, 3, 2).metadata("unit", "gF").metadata("joints", "mcp,pip");
    linear.metadata("pose_range", "[[0, 1], [0, 1]]").bytes()
}

/// Inspects bytes as a file. An error must be one line.
fn inspect(folder: &Path, bytes: &[u8]) -> bool {
    let path = folder.join("m.onnx");
    std::fs::write(&path, bytes).unwrap();
    match model::inspect(&path) {
        Ok(_) => true,
        Err(refused) => {
            let text = refused.to_string();
            assert_eq!(text.lines().count(), 1, "{text}");
            assert!(text.chars().all(|c| !c.is_control()), "{text}");
            false
        }
    }
}

/// Loads bytes in RTen, trial runs and all.
fn load(folder: &Path, bytes: &[u8]) {
    let path = folder.join("m.onnx");
    std::fs::write(&path, bytes).unwrap();
    let spec = ModelSpec { backend: BackendChoice::Rten, ..ModelSpec::new(&path) };
    if let Err(refused) = model::load(&spec) {
        assert_eq!(refused.to_string().lines().count(), 1, "{refused}");
    }
}

#[test]
fn every_truncation_is_inspected_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = small_model();
    assert!(inspect(folder.path(), &bytes));
    for len in 0..bytes.len() {
        inspect(folder.path(), &bytes[..len]);
    }
}

#[test]
fn every_truncation_is_loaded_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = small_model();
    for len in 0..bytes.len() {
        load(folder.path(), &bytes[..len]);
    }
}

#[test]
fn every_flipped_bit_is_inspected_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = small_model();
    for idx in 0..bytes.len() {
        for bit in 0..8 {
            let mut damaged = bytes.clone();
            damaged[idx] ^= 1 << bit;
            inspect(folder.path(), &damaged);
        }
    }
}

#[test]
fn every_flipped_bit_is_loaded_without_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = small_model();
    for idx in 0..bytes.len() {
        for bit in 0..8 {
            let mut damaged = bytes.clone();
            damaged[idx] ^= 1 << bit;
            load(folder.path(), &damaged);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn noise_is_inspected_without_a_panic(noise in proptest::collection::vec(any::<u8>(), 0..512)) {
        let folder = tempfile::tempdir().unwrap();
        inspect(folder.path(), &noise);
    }

    #[test]
    fn spliced_bytes_are_inspected_without_a_panic(at in 0usize..600, cut in 0usize..64, noise in proptest::collection::vec(any::<u8>(), 0..32)) {
        let folder = tempfile::tempdir().unwrap();
        let mut bytes = small_model();
        let at = at.min(bytes.len());
        let end = (at + cut).min(bytes.len());
        bytes.splice(at..end, noise);
        inspect(folder.path(), &bytes);
    }
}

#[test]
fn a_length_prefix_of_gigabytes_allocates_nothing() {
    let folder = tempfile::tempdir().unwrap();
    // Field 7 (graph), length 2^60.
    let bytes = [0x3A, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x10];
    assert!(!inspect(folder.path(), &bytes));
}

#[test]
fn graphs_nested_without_end_are_refused() {
    let mut graph = GraphProto::default();
    for _ in 0..200 {
        let mut node = tactile_pose_fusion::model::onnx::NodeProto::standard("If", &["x"], &["y"], vec![]);
        node.attribute.push(tactile_pose_fusion::model::onnx::AttributeProto { g: Some(graph), ..Default::default() });
        graph = GraphProto { node: vec![node], ..Default::default() };
    }
    let folder = tempfile::tempdir().unwrap();
    assert!(!inspect(folder.path(), &ModelProto::with_graph(graph, 17).encode_to_vec()));
}

#[test]
fn shapes_of_absurd_size_are_refused_before_anything_is_run() {
    let folder = tempfile::tempdir().unwrap();
    for (window, taxels) in
        [(i64::MAX, 3), (4, i64::MAX), (1 << 40, 1 << 40), (0, 3), (i64::MIN, 3), (1 << 20, 1 << 10)]
    {
        let mut model = LinearModel::new(4, 3, 0).proto();
        let graph = model.graph.as_mut().unwrap();
        let dim = tactile_pose_fusion::model::onnx::DimensionProto::fixed;
        graph.input[0] = ValueInfoProto::float32("tactile", vec![dim(1), dim(window), dim(taxels)]);
        assert!(!inspect(folder.path(), &model.encode_to_vec()), "{window} x {taxels}");
    }
}

/// A graph that asks for far more than any machine has, where it is run or already where it is opened.
type Asks = fn(&mut GraphProto, &str, &str);

fn chain(graph: &mut GraphProto, from: &str, to: &str) {
    let names: Vec<String> = (0..100_000).map(|idx| format!("c{idx}")).collect();
    let mut last = from;
    for name in &names {
        node(graph, "Neg", &[last], name, vec![]);
        last = name;
    }
    node(graph, "Identity", &[last], to, vec![]);
}

/// Adds the largest of something huge.
fn largest_of(graph: &mut GraphProto, huge: &str, from: &str, to: &str) {
    node(graph, "ReduceMax", &[huge], "t.largest", vec![AttributeProto::int("keepdims", 0)]);
    node(graph, "Add", &[from, "t.largest"], to, vec![]);
}

fn tile(graph: &mut GraphProto, from: &str, to: &str) {
    let (one, times) = (floats(graph, &[1, 1], &[1.0]), integers(graph, &[320_000, 300_000]));
    node(graph, "Tile", &[&one, &times], "t.huge", vec![]);
    largest_of(graph, "t.huge", from, to);
}

fn constant_of_shape(graph: &mut GraphProto, from: &str, to: &str) {
    let shape = integers(graph, &[96_000_000_000]);
    node(graph, "ConstantOfShape", &[&shape], "t.huge", vec![]);
    largest_of(graph, "t.huge", from, to);
}

fn expand(graph: &mut GraphProto, from: &str, to: &str) {
    let (one, shape) = (floats(graph, &[1], &[1.0]), integers(graph, &[3_000, 32_000_000]));
    node(graph, "Expand", &[&one, &shape], "t.huge", vec![]);
    largest_of(graph, "t.huge", from, to);
}

fn range(graph: &mut GraphProto, from: &str, to: &str) {
    let bounds = [0.0, 9e10, 1.0].map(|bound| floats(graph, &[], &[bound]));
    node(graph, "Range", &bounds.each_ref().map(String::as_str), "t.huge", vec![]);
    largest_of(graph, "t.huge", from, to);
}

/// As large as the readings are.
fn tile_by_readings(graph: &mut GraphProto, from: &str, to: &str) {
    let (one, times) = (floats(graph, &[1], &[1.0]), floats(graph, &[1], &[1e6]));
    node(graph, "Abs", &[from], "t.size", vec![]);
    node(graph, "ReduceMax", &["t.size"], "t.most", vec![AttributeProto::int("keepdims", 0)]);
    node(graph, "Mul", &["t.most", &times], "t.count", vec![]);
    node(graph, "Cast", &["t.count"], "t.times", vec![AttributeProto::int("to", 7)]);
    node(graph, "Tile", &[&one, "t.times"], "t.huge", vec![]);
    largest_of(graph, "t.huge", from, to);
}

const HOSTILE: [(&str, Asks); 6] = [
    ("a chain of 100,000 nodes", chain),
    ("Tile", tile),
    ("ConstantOfShape", constant_of_shape),
    ("Expand", expand),
    ("Range", range),
    ("Tile by readings", tile_by_readings),
];

#[test]
fn a_graph_that_asks_for_too_much_is_one_line_and_no_signal() {
    let folder = tempfile::tempdir().unwrap();
    let mut bag = Bag::create(&folder.path().join("session.mcap"));
    bag.joints(at(0), &["mcp"], &[0.0]);
    (0..100).for_each(|k| bag.taxels(at(k * 10), &[0.0, 0.0]));
    bag.finish();
    write_params(folder.path(), 2, &[], "");
    let mut backends = vec!["rten"];
    if common::onnx_runtime_is_here() {
        backends.push("onnxruntime");
    }
    for (name, asks) in HOSTILE {
        let mut model = LinearModel::new(64, 2, 0).force_only().metadata("unit", "N").proto();
        behind(model.graph.as_mut().unwrap(), "tactile", asks);
        std::fs::write(folder.path().join("model.onnx"), model.encode_to_vec()).unwrap();
        for backend in &backends {
            let begin = std::time::Instant::now();
            let run = tpf(
                folder.path(),
                &["replay", "session.mcap", "--params-file", "params.yaml", "--backend", backend, "-o", "out.mcap"],
            );
            let line = run.failure();
            assert!(line.contains("model.onnx"), "{name} in {backend}: {line}");
            assert!(!run.stderr.contains("calibrat"), "{name} in {backend} was loaded: {line}");
            assert!(begin.elapsed().as_secs() < 60, "{name} in {backend}");
        }
    }
}
