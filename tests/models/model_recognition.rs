//! The built-in code runs the paper's network, node for node, and nothing that only looks like it.

use crate::common;

use std::path::{Path, PathBuf};

use common::compared::{farthest, forces, frames, is_close};
use common::graphs::{behind, floats, integers, node, read, values_of};
use tactile_pose_fusion::model::onnx::{AttributeProto, GraphProto, Message as _, ModelProto, TensorProto};
use tactile_pose_fusion::model::{self, BackendChoice, Model, ModelError, ModelInfo, ModelSpec, RuntimeName};

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn glove1() -> ModelProto {
    read(&repository("models/glove1_pose_aware.onnx"))
}

/// Every `.onnx` file of a folder of the repository.
fn models_in(folder: &str) -> Vec<PathBuf> {
    let files = std::fs::read_dir(repository(folder)).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> = files.filter(|path| path.extension().is_some_and(|end| end == "onnx")).collect();
    files.sort();
    files
}

fn load(path: &Path, backend: BackendChoice) -> Result<Model, ModelError> {
    model::load(&ModelSpec { backend, ..ModelSpec::new(path) })
}

fn runs(info: &ModelInfo) -> RuntimeName {
    info.backend.as_ref().unwrap().runtime
}

/// Puts a model into a file of its own.
fn written(folder: &Path, model: &ModelProto) -> PathBuf {
    let path = folder.join("model.onnx");
    common::write_anew(&path, &model.encode_to_vec());
    path
}

fn graph(model: &mut ModelProto) -> &mut GraphProto {
    model.graph.as_mut().unwrap()
}

#[test]
fn every_shipped_model_is_run_by_our_own_code() {
    let shipped = models_in("models");
    assert_eq!(shipped.len(), 15, "{shipped:?}");
    for path in shipped {
        let info = load(&path, BackendChoice::Auto).unwrap().info;
        assert_eq!(runs(&info), RuntimeName::Builtin, "{} {:?}", path.display(), info.not_builtin);
    }
}

#[test]
fn what_both_of_pytorchs_exporters_write_is_recognized() {
    let exported = models_in("tests/data/pytorch");
    assert_eq!(exported.len(), 7, "{exported:?}"); // six small ones and the one of `common::parity`
    for path in exported {
        let mut own = load(&path, BackendChoice::Builtin).unwrap_or_else(|refused| panic!("{refused}"));
        let mut runtime = load(&path, BackendChoice::Rten).unwrap();
        let frames = frames(&own.info.contract, 1, [-100.0, 100.0], 2.0);
        let (own, runtime) = (forces(&mut own, &frames), forces(&mut runtime, &frames));
        let largest = runtime.iter().fold(0.0f64, |largest, force| largest.max(force.abs()));
        assert!(farthest(&own, &runtime) <= 1e-5 * largest, "{}", path.display()); // sums in another order
    }
}

/// A change as people make it in `forward`, on what it tells: readings and an angle.
struct Case {
    name: &'static str,
    change: fn(&mut ModelProto),
    taxels: [f32; 2],
    angle: f32,
}

fn clip(model: &mut ModelProto, tensor: &str, least: Option<f32>, most: Option<f32>) {
    behind(graph(model), tensor, |graph, from, to| {
        let bounds = [least, most].map(|bound| bound.map_or(String::new(), |bound| floats(graph, &[], &[bound])));
        let inputs = [from, bounds[0].as_str(), bounds[1].as_str()];
        let n = if most.is_some() { 3 } else { 2 };
        node(graph, "Clip", &inputs[..n], to, vec![]);
    });
}

fn pose_in_its_range(model: &mut ModelProto) {
    let ranges: Vec<[f32; 2]> =
        serde_json::from_str(&model.metadata_props.iter().find(|entry| entry.key == "pose_range").unwrap().value)
            .unwrap();
    behind(graph(model), "pose", |graph, from, to| {
        let [least, most] = [0, 1].map(|side| {
            let bounds: Vec<f32> = ranges.iter().map(|range| range[side]).collect();
            floats(graph, &[bounds.len() as i64], &bounds)
        });
        node(graph, "Max", &[from, &least], "pose.above", vec![]);
        node(graph, "Min", &["pose.above", &most], to, vec![]);
    });
}

fn minus_an_offset(model: &mut ModelProto) {
    behind(graph(model), "tactile", |graph, from, to| {
        let offsets = floats(graph, &[6], &[5.0; 6]);
        node(graph, "Sub", &[from, &offsets], to, vec![]);
    });
}

fn gelu_by_tanh(model: &mut ModelProto) {
    let graph = graph(model);
    let at = graph.node.iter().position(|node| node.op_type == "Erf").unwrap();
    let output = graph.node.remove(at).output.remove(0);
    let rest = graph.node.split_off(at);
    // tanh(sqrt(2 / pi) * (x + 0.044715 x^3))
    let [cubic, root] = [0.044_715, 0.797_884_6].map(|value| floats(graph, &[], &[value]));
    node(graph, "Mul", &["pose_sum", "pose_sum"], "t.square", vec![]);
    node(graph, "Mul", &["t.square", "pose_sum"], "t.cube", vec![]);
    node(graph, "Mul", &["t.cube", &cubic], "t.small", vec![]);
    node(graph, "Add", &["pose_sum", "t.small"], "t.sum", vec![]);
    node(graph, "Mul", &["t.sum", &root], "t.scaled", vec![]);
    node(graph, "Tanh", &["t.scaled"], &output, vec![]);
    graph.node.extend(rest);
}

fn leaky_relu(model: &mut ModelProto) {
    let node = graph(model).node.iter_mut().find(|node| node.op_type == "Relu").unwrap();
    node.op_type = "LeakyRelu".to_owned();
    node.attribute = vec![AttributeProto::float("alpha", 0.01)];
}

fn dead_band(model: &mut ModelProto) {
    behind(graph(model), "tactile", |graph, from, to| {
        let [limit, zero] = [3.0, 0.0].map(|value| floats(graph, &[], &[value]));
        node(graph, "Abs", &[from], "t.size", vec![]);
        node(graph, "Less", &["t.size", &limit], "t.dead", vec![]);
        node(graph, "Where", &["t.dead", &zero, from], to, vec![]);
    });
}

fn relu(model: &mut ModelProto) {
    behind(graph(model), "tactile", |graph, from, to| node(graph, "Relu", &[from], to, vec![]));
}

const CASES: [Case; 9] = [
    Case { name: "pose.clamp(training range)", change: pose_in_its_range, taxels: [0.0, 400.0], angle: 3.0 },
    Case {
        name: "tactile.clamp(+-4095)",
        change: |model| clip(model, "tactile", Some(-4095.0), Some(4095.0)),
        taxels: [-6000.0, 6000.0],
        angle: 0.5,
    },
    Case {
        name: "tactile.clamp(max=2000)",
        change: |model| clip(model, "tactile", None, Some(2000.0)),
        taxels: [0.0, 4095.0],
        angle: 0.5,
    },
    Case {
        name: "tactile.clamp(min=0)",
        change: |model| clip(model, "tactile", Some(0.0), None),
        taxels: [-20.0, 200.0],
        angle: 0.5,
    },
    Case { name: "relu(tactile)", change: relu, taxels: [-20.0, 200.0], angle: 0.5 },
    Case { name: "tactile - offset", change: minus_an_offset, taxels: [0.0, 50.0], angle: 0.5 },
    Case { name: "GELU by tanh", change: gelu_by_tanh, taxels: [0.0, 400.0], angle: 0.5 },
    Case { name: "LeakyReLU", change: leaky_relu, taxels: [0.0, 400.0], angle: 0.5 },
    Case { name: "dead band", change: dead_band, taxels: [0.0, 20.0], angle: 0.5 },
];

#[test]
fn what_people_put_into_forward_is_run_by_the_runtime() {
    let folder = tempfile::tempdir().unwrap();
    let mut original = load(&repository("models/glove1_pose_aware.onnx"), BackendChoice::Auto).unwrap();
    for Case { name, change, taxels, angle } in CASES {
        let mut model = glove1();
        change(&mut model);
        let path = written(folder.path(), &model);
        let mut changed = load(&path, BackendChoice::Auto).unwrap_or_else(|refused| panic!("{name}: {refused}"));
        assert_ne!(runs(&changed.info), RuntimeName::Builtin, "{name}");
        assert!(changed.info.not_builtin.is_some(), "{name}");
        let mut runtime = load(&path, BackendChoice::Rten).unwrap();
        let frames = frames(&changed.info.contract, 3, taxels, angle);
        let [given, of_runtime, of_original] =
            [&mut changed, &mut runtime, &mut original].map(|model| forces(model, &frames));
        // Two runtimes add in another order.
        let largest = of_runtime.iter().fold(0.1_f64, |largest, force| largest.max(force.abs()));
        assert!(farthest(&given, &of_runtime) <= 1e-5 * largest, "{name}: {}", farthest(&given, &of_runtime));
        // Of these GELU by tanh moves forces least.
        let moved = farthest(&given, &of_original);
        assert!(moved > 5e-6, "{name} changes {moved} N of {largest} N");
        let refused = load(&path, BackendChoice::Builtin).unwrap_err().to_string();
        assert!(
            refused.contains("backend builtin can't run it: node ") && refused.contains("set backend: auto"),
            "{refused}"
        );
        assert_eq!(refused.lines().count(), 1, "{refused}");
    }
}

#[test]
fn what_changes_no_number_is_recognized_still() {
    let folder = tempfile::tempdir().unwrap();
    let dead: [fn(&mut ModelProto); 3] = [
        |model| behind(graph(model), "tactile", |graph, from, to| node(graph, "Identity", &[from], to, vec![])),
        |model| node(graph(model), "Tanh", &["force"], "nobody.reads.it", vec![]),
        |model| {
            let nothing = floats(graph(model), &[0, 64], &[]);
            node(graph(model), "MatMul", &["tactile_features", &nothing], "of_no_width", vec![]);
        },
    ];
    for change in dead {
        let mut model = glove1();
        change(&mut model);
        // Nodes that no output depends on may be such as no runtime would run.
        let own = model::inspect(&written(folder.path(), &model)).unwrap();
        assert_eq!(own.not_builtin, None);
    }
}

#[test]
fn each_backend_runs_what_it_says() {
    let path = repository("models/glove1_tactile_only.onnx");
    let rten = load(&path, BackendChoice::Rten).unwrap().info;
    assert_eq!((runs(&rten), rten.batch_hint.get(), rten.not_builtin.as_ref()), (RuntimeName::Rten, 32, None));
    let own = load(&path, BackendChoice::Builtin).unwrap().info.backend.unwrap();
    let checked = own.checked_against.clone().unwrap();
    assert!(own.to_string().starts_with("built-in code 0.1.0, checked against "), "{own}");
    assert_eq!(checked.runtime, RuntimeName::Rten, "no library is loaded for a check");
    if common::onnx_runtime_is_here() {
        assert_eq!(runs(&load(&path, BackendChoice::OnnxRuntime).unwrap().info), RuntimeName::OnnxRuntime);
    }
}

/// A decoder whose hidden layer has no unit: its force is its bias.
#[test]
fn a_layer_of_no_width_is_no_panic() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = read(&repository("models/glove1_tactile_only.onnx"));
    for tensor in &mut graph(&mut model).initializer {
        match tensor.name.as_str() {
            "base.0.weight" => *tensor = TensorProto::float32("base.0.weight", &[0, 64], &[]),
            "base.0.bias" => *tensor = TensorProto::float32("base.0.bias", &[0], &[]),
            "base.1.weight" => *tensor = TensorProto::float32("base.1.weight", &[1, 0], &[]),
            _ => {}
        }
    }
    let path = written(folder.path(), &model);
    for backend in [BackendChoice::Auto, BackendChoice::Rten] {
        match load(&path, backend) {
            Ok(model) => assert_ne!(runs(&model.info), RuntimeName::Builtin),
            Err(refused) => assert_eq!(refused.to_string().lines().count(), 1, "{refused}"),
        }
    }
}

/// Layers whose widths don't follow one another, made to fit by a reshape between them.
#[test]
fn a_reshape_within_a_decoder_is_no_panic() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = read(&repository("models/glove1_tactile_only.onnx"));
    let graph = graph(&mut model);
    graph.node.retain(|node| node.op_type != "Gemm" && !node.output.contains(&"base.relu".to_owned()));
    let weights = |name: &str| values_of(graph.initializer.iter().find(|tensor| tensor.name == name).unwrap());
    let (first, last) = (weights("base.0.weight")[..8 * 64].to_vec(), weights("base.1.weight")[..16].to_vec());
    let (first, last) = (floats(graph, &[8, 64], &first), floats(graph, &[1, 16], &last));
    let biases = [floats(graph, &[8], &[0.1; 8]), floats(graph, &[1], &[0.1])];
    let [halves, back] = [[-1, 64], [-1, 16]].map(|shape| integers(graph, &shape));
    let plain = || vec![AttributeProto::int("transB", 1)];
    node(graph, "Concat", &["tactile_features", "tactile_features"], "twice", vec![AttributeProto::int("axis", 1)]);
    node(graph, "Reshape", &["twice", &halves], "halves", vec![]);
    node(graph, "Gemm", &["halves", &first, &biases[0]], "hidden", plain());
    node(graph, "Relu", &["hidden"], "hidden.relu", vec![]);
    node(graph, "Reshape", &["hidden.relu", &back], "back", vec![]);
    node(graph, "Gemm", &["back", &last, &biases[1]], "force", plain());
    let path = written(folder.path(), &model);
    let mut loaded = load(&path, BackendChoice::Auto).unwrap();
    assert_ne!(runs(&loaded.info), RuntimeName::Builtin);
    let frames = frames(&loaded.info.contract, 1, [0.0, 100.0], 0.0);
    assert!(forces(&mut loaded, &frames).iter().all(|force| force.is_finite()));
}

/// A mean over the batch that takes part only where a reading is above 10.
#[test]
fn a_model_that_mixes_windows_under_load_alone_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = glove1();
    behind(graph(&mut model), "tactile", |graph, from, to| {
        let ten = floats(graph, &[], &[10.0]);
        node(graph, "Sub", &[from, &ten], "t.above", vec![]);
        node(graph, "Relu", &["t.above"], "t.over", vec![]);
        node(graph, "ReduceMean", &["t.over"], "t.mean", vec![AttributeProto::ints("axes", &[0])]);
        node(graph, "Add", &[from, "t.mean"], to, vec![]);
    });
    let path = written(folder.path(), &model);
    let refused = load(&path, BackendChoice::Rten).unwrap_err();
    assert!(matches!(refused, ModelError::MixesWindows { .. }), "{refused}");
    assert_eq!(refused.to_string().lines().count(), 1);
}

/// Changes of the shipped models and of what both of PyTorch's exporters write; `TPF_MUTATIONS` asks for another number.
#[test]
fn what_our_own_code_runs_is_what_the_runtime_computes() {
    let n = std::env::var("TPF_MUTATIONS").map_or(15, |n| n.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let (mut n_own, mut n_other) = (0, 0);
    for (file, path) in models_in("tests/data/pytorch")
        .into_iter()
        .chain(["models/glove1_pose_aware.onnx", "models/glove1_adaptive.onnx"].map(repository))
        .enumerate()
    {
        let original = read(&path);
        let mut state = 0x9E37_79B9_7F4A_7C15_u64 ^ file as u64;
        let mut below = |n: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) % n.max(1) as u64) as usize
        };
        for _ in 0..n {
            let mut model = original.clone();
            let what = common::graphs::change(&mut below, graph(&mut model));
            let changed = written(folder.path(), &model);
            let what = format!("{}: {what}", path.file_name().unwrap().to_string_lossy());
            let Ok(mut own) = load(&changed, BackendChoice::Auto) else { continue };
            // Were the graph not told from another one, this is what would be left between a user and a wrong force.
            let reason = own.info.not_builtin.clone().unwrap_or_default();
            assert!(!reason.contains("the built-in code gives"), "{what}: {reason}");
            if runs(&own.info) != RuntimeName::Builtin {
                n_other += 1;
                continue;
            }
            n_own += 1;
            let Ok(mut runtime) = load(&changed, BackendChoice::Rten) else { continue };
            if let Err(far) = is_close(&mut own, &mut runtime) {
                panic!("{what}: {far}");
            }
        }
    }
    assert!(n_own > 7 && n_other > 7 * n / 4, "{n_own} in the built-in code, {n_other} in a runtime");
}
