//! Overlapping windows run as one stretch give what they give one by one.

mod common;

use std::path::{Path, PathBuf};

use common::onnx::LinearModel;
use tactile_pose_fusion::fusion::{Contract, Forces, Windows};
use tactile_pose_fusion::model::{BackendChoice, Model, ModelSpec, load};

/// Enough for two runs of a stretch.
const N_OVERLAPPING: usize = 700;
/// Not enough for one.
const N_APART: usize = 20;

fn load_as(path: &Path, backend: BackendChoice, stretches: bool) -> Model {
    let mut spec = ModelSpec::new(path);
    (spec.backend, spec.stretches) = (backend, stretches);
    load(&spec).unwrap()
}

fn backends() -> Vec<BackendChoice> {
    let mut backends = vec![BackendChoice::Rten];
    backends.extend(common::onnx_runtime_is_here().then_some(BackendChoice::OnnxRuntime));
    backends
}

/// Windows over a stretch of frames, with some among them that belong to nothing, taxels and joints in turn.
fn windows(contract: &Contract) -> (usize, Vec<f32>, Vec<f32>) {
    let frame = |at: usize, width: usize, scale: f32| -> Vec<f32> {
        (0..width).map(|idx| scale * ((at * 7 + idx * 13) as f32 * 0.13).sin().abs()).collect()
    };
    let (mut tactile, mut pose) = (Vec::new(), Vec::new());
    let mut push = |first: usize| {
        for at in first..first + contract.window {
            tactile.extend(frame(at, contract.n_taxels, if at % 300 < 100 { 2.0 } else { 400.0 }));
            pose.extend(frame(at, contract.n_joints, 1.2));
        }
    };
    for idx in 0..N_OVERLAPPING {
        push(idx);
        if idx % (N_OVERLAPPING / N_APART) == 0 {
            push(100_000 + 1000 * idx);
        }
    }
    (tactile.len() / contract.window / contract.n_taxels, tactile, pose)
}

fn forces(model: &mut Model, n: usize, tactile: &[f32], pose: &[f32]) -> Forces {
    let mut forces = Forces::default();
    model.regressor.run(Windows { n, tactile, pose }, &mut forces).unwrap();
    forces
}

fn holds(path: &Path) {
    for backend in backends() {
        let (mut alone, mut together) = (load_as(path, backend, false), load_as(path, backend, true));
        let name = path.display();
        assert_eq!((alone.info.batch_hint, together.info.batch_hint), (32, 512), "{name} {:?}", together.info.notes);
        let (n, tactile, pose) = windows(&alone.info.contract);
        let (alone, together) = (forces(&mut alone, n, &tactile, &pose), forces(&mut together, n, &tactile, &pose));
        let largest = alone.force.iter().fold(0.0_f32, |largest, force| largest.max(force.abs()));
        assert!(largest > 5.0, "{name}: forces that tell something, {largest}");
        for (alone, together) in [(&alone.force, &together.force), (&alone.base, &together.base)] {
            assert_eq!(alone.len(), together.len(), "{name}");
            let far = alone.iter().zip(together).map(|(alone, together)| (alone - together).abs()).fold(0.0, f32::max);
            // Sums in another order, through 64 steps of an LSTM.
            assert!(far <= 1e-5 * largest, "{name} {backend:?}: {far} of {largest}");
        }
    }
}

fn model(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("models").join(name)
}

#[test]
fn a_stretch_gives_the_forces_of_its_windows() {
    holds(&model("glove1_pose_aware.onnx"));
    holds(&model("glove1_tactile_only.onnx"));
}

#[test]
fn a_stretch_of_pytorchs_export_does_too() {
    let Some(shared) = common::shared() else { return };
    holds(&shared.join("fixtures/torch_opset17.onnx"));
}

#[cfg(feature = "train")]
#[test]
fn every_kind_and_form_that_is_trained_here_is_recognized() {
    use tactile_pose_fusion::train::{Architecture, GraphForm, Kind, ModelCard, Network, onnx_model};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.onnx");
    for kind in [Kind::PoseAware, Kind::EarlyFusion, Kind::TactileOnly] {
        for form in [GraphForm::Fast, GraphForm::Plain] {
            let architecture =
                Architecture { kind, window: 40, n_taxels: 5, n_joints: 3, tactile_scale: 100.0, force_scale: 1000.0 };
            let network = Network::new(architecture, 7).unwrap();
            let card = ModelCard {
                rate_hz: 100.0,
                joints: ["a", "b", "c"].map(str::to_owned).to_vec(),
                pose_range: Vec::new(),
                glove: "test".to_owned(),
                trained_on: "nothing".to_owned(),
                metrics: serde_json::json!({}),
            };
            std::fs::write(&path, onnx_model(&network, &card, form).unwrap()).unwrap();
            holds(&path);
        }
    }
}

#[test]
fn any_other_model_runs_as_it_is_and_says_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = LinearModel::new(64, 6, 4).metadata("unit", "gF").write(folder.path(), "linear.onnx");
    let model = load_as(&path, BackendChoice::Rten, true);
    assert_eq!(model.info.batch_hint, 32);
    assert!(!model.info.notes.iter().any(|note| note.contains("window by window")), "{:?}", model.info.notes);
}
