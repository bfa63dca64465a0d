//! The written model loads in both runtimes and computes what the trained network computes.

use crate::common;
use crate::train_common;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use common::parity::Parity;
use serde_json::json;
use tactile_pose_fusion::eval::Part;
use tactile_pose_fusion::fusion::{
    ARTIFACT_BASIS, ArtifactModel, ForceAxes, ForceUnit, Forces, PoseRange, RegionTerms, SharedWindows, TRUST_INPUTS,
    TouchLevels, TouchOutput, Windows,
};
use tactile_pose_fusion::model::{self, BackendChoice, ModelError, ModelSpec};
use tactile_pose_fusion::train::*;
use tactile_pose_fusion::units::{GramForce, Newton};
use train_common::{config, dataset};

const KINDS: [Kind; 4] = [Kind::PoseAware, Kind::TactileOnly, Kind::EarlyFusion, Kind::Adaptive];
const FORMS: [GraphForm; 2] = [GraphForm::Fast, GraphForm::Plain];

fn card(kind: Kind) -> ModelCard {
    let joints = if kind.needs_joints() { vec!["index_pip".to_string(), "index_dip".to_string()] } else { vec![] };
    ModelCard {
        rate_hz: 100.0,
        pose_range: joints.iter().map(|_| PoseRange { min: -0.5, max: 1.5 }).collect(),
        joints,
        artifact: (kind == Kind::Adaptive).then(artifact),
        regions: BTreeMap::new(),
        touch: (kind == Kind::Adaptive).then(touch),
        held_out: Vec::new(),
        glove: "bench".into(),
        trained_on: "two made-up sessions".into(),
        metrics: json!({"mdf_gf": 37.5, "ba": 0.98}),
    }
}

/// When its touch output is contact.
fn touch() -> TouchOutput {
    TouchOutput { levels: TouchLevels { on: 0.8, off: 0.5 }, false_per_min: Some(2.5) }
}

/// What bending makes of the taxels, as a model tells it.
fn artifact() -> ArtifactModel {
    ArtifactModel {
        n_taxels: 3,
        n_joints: 2,
        shapes: (0..3 * 2 * ARTIFACT_BASIS).map(|idx| 0.1 * idx as f64).collect(),
        gain_variance: vec![0.1; 6],
        slip: 0.3,
        slip_common: 0.35,
        slip_time_s: 90.0,
        touch: vec![2.0, 3.0, 4.0],
        residual: vec![1.0 / 3.0; 3],
        drift: vec![0.5, 0.0, 2.0],
        noise: Vec::new(),
        misfit: Vec::new(),
        uncertain_offsets: false,
        trust_inputs: false,
    }
}

/// A network that training has moved, so that every fold has something to fold.
fn trained(kind: Kind) -> (Network, Dataset) {
    let dataset = dataset(kind, if kind == Kind::Adaptive { 400 } else { 120 });
    let mut trainer = Trainer::new(config(kind, 12), &dataset, 2).unwrap();
    let network = trainer.run(&AtomicBool::new(false), None, &mut |_| {}).unwrap().last;
    (network, dataset)
}

fn backends() -> Vec<BackendChoice> {
    vec![BackendChoice::Rten, BackendChoice::OnnxRuntime]
}

/// Loads a model. Without ONNX Runtime's library that backend is skipped, unless `TPF_REQUIRE_ORT=1` forbids that.
fn load(path: &Path, backend: BackendChoice) -> Option<model::Model> {
    match model::load(&ModelSpec { backend, ..ModelSpec::new(path) }) {
        Ok(model) => Some(model),
        Err(missing @ ModelError::NoOnnxRuntime { .. }) => {
            common::without_onnx_runtime(&missing.to_string());
            None
        }
        Err(refused) => panic!("{refused}"),
    }
}

#[track_caller]
fn assert_close(what: &str, got: &[f32], expected: &[f32]) {
    assert_eq!(got.len(), expected.len(), "{what}");
    let scale = expected.iter().fold(1.0f32, |scale, value| scale.max(value.abs()));
    let worst = got.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    // Folded weights are rounded once more, and each runtime adds in an order of its own.
    assert!(worst <= 1e-5 * scale, "{what}: {worst} of {scale}");
}

#[test]
fn both_runtimes_give_what_the_network_gives_in_either_form() {
    let folder = tempfile::tempdir().unwrap();
    for kind in KINDS {
        let (network, dataset) = trained(kind);
        let batch = dataset.batch(Part::Train, &(0..40).collect::<Vec<_>>(), None);
        let windows = Windows { n: batch.n, tactile: &batch.tactile, pose: &batch.pose };
        let expected = network.predict(windows).unwrap();
        for form in FORMS {
            let path = folder.path().join("model.onnx");
            std::fs::write(&path, onnx_model(&network, &card(kind), form).unwrap()).unwrap();
            for backend in backends() {
                let Some(mut model) = load(&path, backend) else { continue };
                assert_eq!(model.info.contract.has_base, kind == Kind::PoseAware);
                let forces = common::run_windows(&mut model, windows).unwrap();
                assert_close(&format!("{kind:?} {form:?} {backend:?}"), &forces.force, &expected.force);
                assert_close(&format!("base of {kind:?} {form:?} {backend:?}"), &forces.base, &expected.base);
                assert_close(&format!("touch of {kind:?} {form:?} {backend:?}"), &forces.touch, &expected.touch);
                assert_eq!(model.info.contract.touch, (kind == Kind::Adaptive).then(touch));
            }
        }
    }
}

#[test]
fn both_runtimes_give_the_three_axes_that_a_network_of_three_has_learned() {
    let folder = tempfile::tempdir().unwrap();
    let axes = ContactAxes::of(&nalgebra::Unit::new_normalize(nalgebra::Vector3::new(0.3, -0.2, 0.9)));
    for kind in [Kind::PoseAware, Kind::TactileOnly, Kind::EarlyFusion] {
        let mut frames = train_common::frames("a", 120);
        frames.tangential_gf = frames.truth_gf.iter().flat_map(|force| [0.3 * force, -0.2 * force]).collect();
        let dataset = Dataset::new(vec![Session::new(frames).unwrap()], train_common::all_of_it(kind)).unwrap();
        let mut trainer = Trainer::new(TrainConfig { axes: Some(axes), ..config(kind, 12) }, &dataset, 2).unwrap();
        let network = trainer.run(&AtomicBool::new(false), None, &mut |_| {}).unwrap().last;
        let batch = dataset.batch(Part::Train, &(0..40).collect::<Vec<_>>(), None);
        let windows = Windows { n: batch.n, tactile: &batch.tactile, pose: &batch.pose };
        let expected = network.predict(windows).unwrap();
        let in_contact = network.predict_in_contact(windows).unwrap();
        for (force, [normal, first, second]) in expected.force.chunks(3).zip(in_contact.force.as_chunks::<3>().0) {
            let along: f64 = force.iter().zip(axes.in_patch[0]).map(|(force, axis)| f64::from(*force) * axis).sum();
            assert!((along - f64::from(*normal)).abs() < 1e-3, "{along} {normal}"); // float32 of some 100 gF
            let length = |values: &[f32]| values.iter().map(|value| value * value).sum::<f32>().sqrt();
            assert!((length(force) - length(&[*normal, *first, *second])).abs() < 1e-3);
        }
        for form in FORMS {
            let path = folder.path().join("model.onnx");
            std::fs::write(&path, onnx_model(&network, &card(kind), form).unwrap()).unwrap();
            for backend in backends() {
                let Some(mut model) = load(&path, backend) else { continue };
                let contract = &model.info.contract;
                assert_eq!((contract.axes, contract.has_base), (ForceAxes::Patch, kind == Kind::PoseAware));
                let forces = common::run_windows(&mut model, windows).unwrap();
                assert_close(&format!("{kind:?} {form:?} {backend:?}"), &forces.force, &expected.force);
                assert_close(&format!("base of {kind:?} {form:?} {backend:?}"), &forces.base, &expected.base);
            }
        }
    }
    // What can't be is refused, and a truth of one axis trains no three.
    let one = train_common::dataset(Kind::TactileOnly, 120);
    let refused = Trainer::new(TrainConfig { axes: Some(axes), ..config(Kind::TactileOnly, 2) }, &one, 1);
    assert!(refused.unwrap_err().to_string().contains("needs a true force of three axes"));
}

#[test]
fn a_tangential_force_is_learned_beside_the_normal_force() {
    let kind = Kind::TactileOnly;
    let mut frames = train_common::frames("a", 400);
    let part = |frame: usize| if frame < 300 { Part::Train } else { Part::Validation };
    frames.part = (0..400).map(part).collect();
    // Half of the touches drag one way, half the other, and one taxel tells which.
    for frame in 0..400 {
        let side = if (frame / 40) % 2 == 0 { 1.0 } else { -1.0 };
        let force = frames.truth_gf[frame];
        frames.tactile[frame * train_common::TAXELS] = 2.0 * force * side;
        frames.tangential_gf.extend([0.5 * side * force, 0.0]);
    }
    let dataset = Dataset::new(vec![Session::new(frames).unwrap()], train_common::all_of_it(kind)).unwrap();
    let axes = Some(ContactAxes::of(&nalgebra::Vector3::z_axis()));
    let tangential = |loss: LossConfig| {
        let cfg = TrainConfig { axes, loss, ..config(kind, 300) };
        let outcome = Trainer::new(cfg, &dataset, 2).unwrap().run(&AtomicBool::new(false), None, &mut |_| {}).unwrap();
        validate(&outcome.last, &dataset, Part::Validation, &LossConfig::default(), 1)
            .unwrap()
            .tangential_mae_gf
            .unwrap()
    };
    let learned = tangential(LossConfig::default());
    let ignored = tangential(LossConfig { tangential_weight: 0.0, ..LossConfig::default() });
    assert!(learned < 6.0 && learned < 0.5 * ignored, "{learned} gF with its loss, {ignored} gF without");
}

#[test]
fn the_model_tells_its_contract() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.onnx");
    let (network, _) = trained(Kind::PoseAware);
    std::fs::write(&path, onnx_model(&network, &card(Kind::PoseAware), GraphForm::Fast).unwrap()).unwrap();
    let info = model::inspect(&path).unwrap();
    let contract = &info.contract;
    assert_eq!((contract.window.get(), contract.n_taxels, contract.n_joints), (8, 3, 2));
    assert_eq!((contract.unit, contract.rate_hz), (ForceUnit::GramForce, 100.0));
    assert_eq!(contract.joints.as_deref(), Some(&["index_pip".to_string(), "index_dip".to_string()][..]));
    assert_eq!(contract.pose_range.as_ref().unwrap()[1], PoseRange { min: -0.5, max: 1.5 });
    assert_eq!(contract.mdf, Some(Newton::from(GramForce(37.5))));
    assert_eq!((info.opset, info.ir_version, info.batch), (17, 8, model::Batch::Dynamic));
    assert_eq!(info.notes, Vec::<String>::new());
    let keys: Vec<&str> = info.metadata.keys().map(String::as_str).collect();
    let expected = [
        "glove",
        "joints",
        "metrics",
        "pose_range",
        "rate_hz",
        "taxels",
        "tool_version",
        "tpf.contract",
        "trained_on",
        "unit",
        "window",
    ];
    assert_eq!(keys, expected);
    assert_eq!(info.metadata["trained_on"], "two made-up sessions");
}

#[test]
fn an_adaptive_model_tells_its_artifact_and_needs_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.onnx");
    let (network, _) = trained(Kind::Adaptive);
    std::fs::write(&path, onnx_model(&network, &card(Kind::Adaptive), GraphForm::Fast).unwrap()).unwrap();
    let contract = model::inspect(&path).unwrap().contract;
    assert_eq!(contract.artifact.as_deref(), Some(&artifact()), "to the last bit");
    assert_eq!((contract.n_joints, contract.n_region_joints()), (0, 2));
    assert_eq!(contract.pose_range.unwrap().len(), 2);
    let without = ModelCard { artifact: None, ..card(Kind::Adaptive) };
    let refused = onnx_model(&network, &without, GraphForm::Fast).unwrap_err().to_string();
    assert!(refused.contains("needs its artifact model"), "{refused}");
}

#[test]
fn a_network_that_gets_trust_is_run_by_the_built_in_code_and_a_width_without_it_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.onnx");
    let told = ModelCard { artifact: Some(ArtifactModel { trust_inputs: true, ..artifact() }), ..card(Kind::Adaptive) };
    let narrow = trained(Kind::Adaptive).0;
    let architecture = Architecture { n_taxels: 3 + TRUST_INPUTS, ..narrow.architecture.clone() };
    let network = Network::new(architecture, 5).unwrap();
    std::fs::write(&path, onnx_model(&network, &told, GraphForm::Fast).unwrap()).unwrap();
    let window = network.architecture.window;
    let tactile: Vec<f32> = (0..5 * window * (3 + TRUST_INPUTS)).map(|idx| ((idx * 37) % 101) as f32 - 50.0).collect();
    let expected = network.predict(Windows { n: 5, tactile: &tactile, pose: &[] }).unwrap();
    for backend in [BackendChoice::Builtin, BackendChoice::Rten] {
        let mut model = load(&path, backend).unwrap();
        let contract = &model.info.contract;
        assert_eq!((contract.n_taxels, contract.n_columns()), (3, 3 + TRUST_INPUTS));
        let starts: Vec<usize> = (0..5).map(|idx| idx * window).collect();
        let mut out = Forces::default();
        let windows = SharedWindows { starts: &starts, ids: &[], tactile: &tactile, pose: &[] };
        model.regressor.run(windows, &mut out).unwrap();
        assert_close(&format!("{backend:?}"), &out.force, &expected.force);
        assert_close(&format!("{backend:?}"), &out.touch, &expected.touch);
    }
    let refused = onnx_model(&narrow, &told, GraphForm::Fast).unwrap_err().to_string();
    assert!(refused.contains("of 3 taxels and 2 columns of trust, the network of 3 in all"), "{refused}");
    // A file that says so, and has no room for the taxels.
    let artifact = serde_json::to_string(&told.artifact).unwrap();
    common::onnx::LinearModel::new(8, 2, 2).metadata("artifact", &artifact).write(folder.path(), "narrow.onnx");
    let refused = model::inspect(&folder.path().join("narrow.onnx")).unwrap_err().to_string();
    let expected =
        "metadata artifact has trust_inputs, which are 2 columns after the taxels, but input tactile is [N, 8, 2]";
    assert!(refused.contains(expected), "{refused}");
}

#[test]
fn a_model_of_several_regions_has_the_terms_of_each_and_of_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.onnx");
    let (network, _) = trained(Kind::Adaptive);
    let of_one = card(Kind::Adaptive);
    let terms = |slip: f64, joints: [&str; 2]| RegionTerms {
        joints: joints.map(str::to_owned).to_vec(),
        pose_range: of_one.pose_range.clone(),
        artifact: Arc::new(ArtifactModel { slip, ..artifact() }),
    };
    let regions: BTreeMap<String, RegionTerms> =
        [("index", terms(0.1, ["a", "b"])), ("thumb", terms(0.2, ["c", "d"]))].map(|(n, t)| (n.to_owned(), t)).into();
    let card = ModelCard {
        regions: regions.clone(),
        artifact: None,
        joints: Vec::new(),
        pose_range: Vec::new(),
        ..of_one.clone()
    };
    std::fs::write(&path, onnx_model(&network, &card, GraphForm::Fast).unwrap()).unwrap();
    let contract = model::inspect(&path).unwrap().contract;
    assert_eq!(contract.regions, regions, "to the last bit");
    assert!(contract.artifact.is_none() && contract.joints.is_none() && contract.pose_range.is_none());
    assert!(contract.has_artifact());
    assert_eq!(contract.n_region_joints(), 2);
    let of_thumb = contract.of_region("thumb").unwrap();
    assert_eq!(of_thumb.artifact.as_ref().unwrap().slip, 0.2);
    assert_eq!(of_thumb.joints.as_deref(), Some(&["c".to_owned(), "d".to_owned()][..]));
    assert_eq!(of_thumb.pose_range.as_ref().unwrap().len(), 2);
    assert!(contract.of_region("ring").is_none());
    // In place of those of one region, and only where pose is taken out of taxels.
    for (card, kind) in
        [(ModelCard { artifact: of_one.artifact, ..card.clone() }, Kind::Adaptive), (card, Kind::PoseAware)]
    {
        let refused = onnx_model(&trained(kind).0, &card, GraphForm::Fast).unwrap_err().to_string();
        assert!(refused.contains("regions are for an adaptive network"), "{refused}");
    }
}

#[test]
fn the_same_network_gives_the_same_file() {
    let (network, _) = trained(Kind::PoseAware);
    let card = card(Kind::PoseAware);
    let file = onnx_model(&network, &card, GraphForm::Fast).unwrap();
    assert_eq!(onnx_model(&network, &card, GraphForm::Fast).unwrap(), file);
    // The auxiliary decoder stays behind.
    assert!(!file.windows(9).any(|bytes| bytes == b"auxiliary"));
}

#[test]
fn a_card_that_does_not_fit_is_refused() {
    let (network, _) = trained(Kind::PoseAware);
    type Change = fn(&mut ModelCard);
    let cases: [(Change, &str); 5] = [
        (|c| c.joints.truncate(1), "expected 2 distinct names"),
        (|c| c.joints[1] = c.joints[0].clone(), "expected 2 distinct names"),
        (|c| c.pose_range.truncate(1), "pose_range holds 1 joints, expected 2"),
        (|c| c.rate_hz = f64::NAN, "rate_hz is NaN"),
        (|c| c.metrics = json!([1]), "metrics must be a JSON object"),
    ];
    for (change, expected) in cases {
        let mut card = card(Kind::PoseAware);
        change(&mut card);
        let refused = onnx_model(&network, &card, GraphForm::Fast).unwrap_err().to_string();
        assert!(refused.contains(expected), "{refused}");
    }
    let mut spoiled = network;
    spoiled.values[5] = f32::NAN;
    assert!(onnx_model(&spoiled, &card(Kind::PoseAware), GraphForm::Fast).is_err());
}

#[test]
fn windows_of_another_shape_are_refused() {
    let (network, _) = trained(Kind::PoseAware);
    assert!(network.predict(Windows { n: 2, tactile: &[0.0; 48], pose: &[0.0; 16] }).is_err());
    assert!(network.predict(Windows { n: usize::MAX, tactile: &[0.0; 48], pose: &[0.0; 32] }).is_err());
    let none = network.predict(Windows { n: 0, tactile: &[], pose: &[] }).unwrap();
    assert_eq!(none, Forces::default());
}

#[test]
fn onnx_finds_no_fault_with_the_files() {
    let Some(python) = common::python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for kind in KINDS {
        let (network, _) = trained(kind);
        for form in FORMS {
            let path = folder.path().join(format!("{kind:?}_{form:?}.onnx"));
            std::fs::write(&path, onnx_model(&network, &card(kind), form).unwrap()).unwrap();
            files.push(path);
        }
    }
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/python/train_onnx_check.py");
    let ran = Command::new(python).arg(script).args(&files).output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    assert_eq!(String::from_utf8_lossy(&ran.stdout).lines().count(), files.len());
}

#[test]
fn the_weights_of_a_pytorch_export_give_pytorchs_forces() {
    let parity = Parity::read();
    let network = from_pytorch_export(&parity.model);
    let (tactile, pose, Parity { force, base, .. }) = (parity.tactile(), parity.pose(), &parity);
    let forces = network.predict(Windows { n: force.len(), tactile: &tactile, pose: &pose }).unwrap();
    // Forces of the fixture are about 1; PyTorch's own float32 is 1.5e-7 from its float64.
    for (got, expected) in [(&forces.force, force), (&forces.base, base)] {
        let worst = got.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-6, "{worst}");
    }
}

/// The fixture's weights as a network of ours, its batch normalization already folded.
fn from_pytorch_export(path: &Path) -> Network {
    use model::onnx::{Message, ModelProto};
    let model = ModelProto::decode(std::fs::read(path).unwrap().as_slice()).unwrap();
    let graph = model.graph.unwrap();
    let values = |name: &str| -> Vec<f32> {
        let raw = graph.initializer.iter().find(|tensor| tensor.name == name).unwrap().raw_data.clone().unwrap();
        raw.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
    };
    // The exporter numbers what it folds: the inputs of the nodes tell which weights are whose.
    let inputs = |op: &str| -> Vec<Vec<String>> {
        graph.node.iter().filter(|node| node.op_type == op).map(|node| node.input.clone()).collect()
    };
    let (first, embedding, recurrent) = (&inputs("Conv")[0], &inputs("MatMul")[0], inputs("LSTM"));
    let architecture = Architecture {
        kind: Kind::PoseAware,
        window: 64,
        n_taxels: 16,
        n_joints: 4,
        tactile_scale: 1.0,
        force_scale: 1.0,
        touch_scale: 1.0,
        axes: None,
    };
    let mut network = Network::new(architecture, 0).unwrap();
    network.statistics.variance.fill(1.0 - 1e-5); // with the epsilon of the normalization: exactly no change
    let mut set = |name: &str, values: &[f32]| network.set_parameter(name, values).unwrap();
    for (ours, theirs) in [
        ("tactile.conv0.weight", first[1].as_str()),
        ("tactile.conv0.bias", first[2].as_str()),
        ("base.0.weight", "base.0.weight"),
        ("base.0.bias", "base.0.bias"),
        ("base.1.weight", "base.2.weight"),
        ("base.1.bias", "base.2.bias"),
        ("pose.norm.weight", "ln.weight"),
        ("pose.norm.bias", "ln.bias"),
        ("pose.embed.bias", "embed.bias"),
        ("residual.0.weight", "residual.0.weight"),
        ("residual.0.bias", "residual.0.bias"),
        ("residual.1.weight", "residual.2.weight"),
        ("residual.1.bias", "residual.2.bias"),
    ] {
        set(ours, &values(theirs));
    }
    for idx in 1..=3 {
        for part in ["weight", "bias"] {
            set(&format!("tactile.conv{idx}.{part}"), &values(&format!("dilated.{}.{part}", idx - 1)));
        }
    }
    let embed = values(&embedding[1]); // [8, 64], ours is [64, 8]
    set("pose.embed.weight", &(0..512).map(|idx| embed[idx % 8 * 64 + idx / 8]).collect::<Vec<_>>());
    // ONNX orders gates input, output, forget, cell; PyTorch input, forget, cell, output.
    let by_torch_gates = |values: &[f32]| -> Vec<f32> {
        let gate = values.len() / 4;
        [0, 2, 3, 1].iter().flat_map(|idx| &values[idx * gate..(idx + 1) * gate]).copied().collect()
    };
    for (layer, inputs) in recurrent.iter().enumerate() {
        let [_, input, hidden, bias, ..] = inputs.as_slice() else { panic!("{inputs:?}") };
        for (direction, name) in ["forward", "backward"].into_iter().enumerate() {
            let part = |name: &str| -> Vec<f32> {
                let both = values(name);
                both[direction * both.len() / 2..(direction + 1) * both.len() / 2].to_vec()
            };
            let name = format!("pose.lstm{layer}.{name}");
            set(&format!("{name}.weight_ih"), &by_torch_gates(&part(input)));
            set(&format!("{name}.weight_hh"), &by_torch_gates(&part(hidden)));
            let biases = part(bias);
            set(&format!("{name}.bias_ih"), &by_torch_gates(&biases[..128]));
            set(&format!("{name}.bias_hh"), &by_torch_gates(&biases[128..]));
        }
    }
    network
}
