//! Overlapping windows run as one stretch give what they give one by one.

use crate::common;

use std::num::NonZero;
use std::path::{Path, PathBuf};

use common::onnx::LinearModel;
use tactile_pose_fusion::fusion::{Contract, Forces, SharedWindows};
use tactile_pose_fusion::model::{BackendChoice, Model, ModelSpec, RuntimeName, load};

/// Enough for several stretches.
const N_OVERLAPPING: usize = 300;
/// They share no frames.
const N_APART: usize = 20;

/// A model in the built-in code, on so many threads.
fn load_own(path: &Path, n_threads: usize) -> Model {
    let mut spec = ModelSpec::new(path);
    (spec.backend, spec.threads) = (BackendChoice::Builtin, NonZero::new(n_threads).unwrap());
    load(&spec).unwrap()
}

/// A model in its runtime.
fn load_in_runtime(path: &Path, backend: BackendChoice) -> Model {
    load(&ModelSpec { backend, ..ModelSpec::new(path) }).unwrap()
}

fn backends() -> Vec<BackendChoice> {
    let mut backends = vec![BackendChoice::Rten];
    backends.extend(common::onnx_runtime_is_here().then_some(BackendChoice::OnnxRuntime));
    backends
}

/// Frames, and where windows begin in them.
struct Input {
    starts: Vec<usize>,
    tactile: Vec<f32>,
    pose: Vec<f32>,
}

impl Input {
    /// Overlapping windows with some left out among them, then windows that share nothing, then overlapping ones again.
    fn new(contract: &Contract) -> Self {
        let overlapping = |from: usize| (from..from + N_OVERLAPPING).filter(|start| start % 37 != 0);
        let apart = N_OVERLAPPING + contract.window.get();
        let again = apart + (N_APART + 1) * contract.window.get();
        let between = (0..N_APART).map(|idx| apart + idx * contract.window.get());
        let starts = overlapping(0).chain(between).chain(overlapping(again)).collect();
        let n_frames = again + N_OVERLAPPING + contract.window.get();
        let frames = |width: usize, scale: &dyn Fn(usize) -> f32| -> Vec<f32> {
            let value = |at: usize| ((at / width * 7 + at % width * 13) as f32 * 0.13).sin().abs() * scale(at / width);
            (0..n_frames * width).map(value).collect()
        };
        let tactile = frames(contract.n_columns(), &|frame| if frame % 300 < 100 { 2.0 } else { 400.0 });
        let pose = if contract.n_joints > 0 { frames(contract.n_joints, &|_| 1.2) } else { Vec::new() };
        Input { starts, tactile, pose }
    }

    fn windows(&self) -> SharedWindows<'_> {
        SharedWindows { starts: &self.starts, ids: &[], tactile: &self.tactile, pose: &self.pose }
    }
}

fn forces(model: &mut Model, input: &Input) -> Forces {
    let mut forces = Forces::default();
    model.regressor.run(input.windows(), &mut forces).unwrap();
    forces
}

fn holds(path: &Path) {
    for backend in backends() {
        let (mut alone, mut together) = (load_in_runtime(path, backend), load_own(path, 1));
        let name = path.display();
        assert_eq!(
            (alone.info.batch_hint.get(), together.info.batch_hint.get()),
            (32, 16 * 256),
            "{name} {:?}",
            together.info.notes
        );
        let input = Input::new(&alone.info.contract);
        let (alone, together) = (forces(&mut alone, &input), forces(&mut together, &input));
        let largest = alone.force.iter().fold(0.0_f32, |largest, force| largest.max(force.abs()));
        assert!(largest > 5.0, "{name}: forces that tell something, {largest}");
        let touch = (&alone.touch, &together.touch, 1.0);
        let forces = [(&alone.force, &together.force, largest), (&alone.base, &together.base, largest), touch];
        for (alone, together, largest) in forces {
            assert_eq!(alone.len(), together.len(), "{name}");
            assert!(together.iter().all(|force| force.is_finite()), "{name} {backend:?}");
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
    holds(&model("glove2_adaptive.onnx"));
}

#[test]
fn any_company_and_any_number_of_threads_give_the_same_bits() {
    for name in ["glove1_pose_aware.onnx", "glove3_adaptive.onnx"] {
        any_company_and_any_number_of_threads(&model(name));
    }
}

fn any_company_and_any_number_of_threads(path: &Path) {
    let mut one = load_own(path, 1);
    let input = Input::new(&one.info.contract);
    let expected = forces(&mut one, &input);
    assert!(expected.force.iter().chain(&expected.base).all(|force| force.is_finite()));
    for n_threads in [2, 3] {
        let mut several = load_own(path, n_threads);
        let again = [forces(&mut several, &input), forces(&mut several, &input)];
        assert!(again.iter().all(|again| *again == expected), "{n_threads} threads");
    }
    for (idx, start) in input.starts.iter().enumerate().step_by(41) {
        let mut alone = Forces::default();
        one.regressor.run(SharedWindows { starts: &[*start], ..input.windows() }, &mut alone).unwrap();
        let of = |forces: &[f32]| forces.get(idx).copied().into_iter().collect::<Vec<f32>>();
        let Forces { force, base, touch } = &expected;
        assert_eq!((alone.force, alone.base, alone.touch), (of(force), of(base), of(touch)));
    }
}

#[test]
fn a_stretch_of_pytorchs_export_does_too() {
    holds(&common::parity::Parity::read().model);
}

/// Of five taxels and three joints.
#[cfg(feature = "train")]
fn artifact() -> tactile_pose_fusion::fusion::ArtifactModel {
    tactile_pose_fusion::fusion::ArtifactModel {
        n_taxels: 5,
        n_joints: 3,
        shapes: vec![0.5; 5 * 3 * 4],
        gain_variance: vec![0.1; 5 * 3],
        slip: 0.1,
        slip_common: 0.5,
        slip_time_s: 30.0,
        touch: vec![0.2; 5],
        residual: vec![1.0; 5],
        drift: Vec::new(),
        noise: Vec::new(),
        misfit: Vec::new(),
        uncertain_offsets: false,
        trust_inputs: false,
    }
}

#[cfg(feature = "train")]
#[test]
fn every_kind_and_form_that_is_trained_here_is_recognized() {
    use tactile_pose_fusion::train::{Architecture, GraphForm, Kind, ModelCard, Network, onnx_model};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.onnx");
    for (kind, window) in [
        (Kind::PoseAware, 24),
        (Kind::EarlyFusion, 24),
        (Kind::TactileOnly, 24),
        (Kind::Adaptive, 64),
        (Kind::Adaptive, 63),
    ] {
        for form in [GraphForm::Fast, GraphForm::Plain] {
            let scales = (100.0, 1000.0, 1.0);
            let (tactile_scale, force_scale, touch_scale) = scales;
            let architecture = Architecture {
                kind,
                window,
                n_taxels: 5,
                n_joints: 3,
                tactile_scale,
                force_scale,
                touch_scale,
                axes: None,
            };
            let network = Network::new(architecture, 7).unwrap();
            let card = ModelCard {
                rate_hz: 100.0,
                joints: ["a", "b", "c"].map(str::to_owned).to_vec(),
                pose_range: Vec::new(),
                artifact: (kind == Kind::Adaptive).then(artifact),
                regions: Default::default(),
                touch: None,
                held_out: Vec::new(),
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
    let model = load(&ModelSpec::new(path)).unwrap();
    assert_eq!(model.info.batch_hint.get(), 32);
    assert_ne!(model.info.backend.unwrap().runtime, RuntimeName::Builtin);
    assert!(!model.info.notes.iter().any(|note| note.contains("runs it")), "{:?}", model.info.notes);
}
