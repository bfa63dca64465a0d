//! A model whose graph asks for too much ends a command with one line, and not by a signal.

use crate::common;

use common::bags::{Bag, at};
use common::graphs::{behind, floats, integers, node};
use common::onnx::LinearModel;
use common::tpf::{tpf, write_params};
use tactile_pose_fusion::model::onnx::{AttributeProto, GraphProto, Message};

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
