//! Both runtimes and the built-in code give what PyTorch gave, one by one and in batches.

use crate::common;

use std::path::{Path, PathBuf};

use common::onnx::{Flaw, LinearModel};
use common::parity::Parity;
use tactile_pose_fusion::fusion::{Forces, Windows};
use tactile_pose_fusion::model::{self, BackendChoice, Model, ModelError, ModelSpec, RuntimeName};

/// The windows of the fixture and PyTorch's own float32 outputs.
struct Fixture {
    path: PathBuf,
    n: usize,
    tactile: Vec<f32>,
    pose: Vec<f32>,
    force: Vec<f32>,
    base: Vec<f32>,
}

fn fixture() -> Fixture {
    let parity = Parity::read();
    let (n, tactile, pose) = (parity.n(), parity.tactile(), parity.pose());
    Fixture { path: parity.model, n, tactile, pose, force: parity.force, base: parity.base }
}

/// A model in one of the backends.
fn spec(path: &Path, backend: BackendChoice) -> ModelSpec {
    ModelSpec { backend, ..ModelSpec::new(path) }
}

/// A model in ONNX Runtime. Without a library the test is skipped, unless `TPF_REQUIRE_ORT=1` forbids that.
fn in_onnxruntime(path: &Path) -> Option<Model> {
    match model::load(&spec(path, BackendChoice::OnnxRuntime)) {
        Ok(model) => Some(model),
        Err(missing @ ModelError::NoOnnxRuntime { .. }) => {
            common::without_onnx_runtime(&missing.to_string());
            None
        }
        Err(refused) => panic!("{refused}"),
    }
}

/// Runs the fixture in parts of `batch` windows.
fn run_in_parts(model: &mut Model, fixture: &Fixture, batch: usize) -> Forces {
    let (tactile_len, pose_len) = (fixture.tactile.len() / fixture.n, fixture.pose.len() / fixture.n);
    let mut all = Forces::default();
    for start in (0..fixture.n).step_by(batch) {
        let end = (start + batch).min(fixture.n);
        let windows = Windows {
            n: end - start,
            tactile: &fixture.tactile[start * tactile_len..end * tactile_len],
            pose: &fixture.pose[start * pose_len..end * pose_len],
        };
        let part = common::run_windows(model, windows).unwrap();
        all.force.extend_from_slice(&part.force);
        all.base.extend_from_slice(&part.base);
    }
    all
}

fn assert_matches_pytorch(model: &mut Model, fixture: &Fixture) {
    // PyTorch's float32 lies 1.5e-7 from its float64, and a runtime that adds in another order as far again.
    let tolerance = 1e-6;
    for batch in [1, 3, 7, 17, 64] {
        let forces = run_in_parts(model, fixture, batch);
        for (name, got, expected) in [("force", &forces.force, &fixture.force), ("base", &forces.base, &fixture.base)] {
            assert_eq!(got.len(), expected.len());
            let worst = got.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst <= tolerance, "{name} in batches of {batch}: {worst}");
        }
    }
}

/// The fixture again and again, to `n` windows.
fn repeated(values: &[f32], of_one: usize, n: usize) -> Vec<f32> {
    values.iter().copied().cycle().take(n * of_one).collect()
}

fn assert_large_batches_are_cut(model: &mut Model, fixture: &Fixture) {
    let n = 300; // more than either runtime takes at once
    let tactile = repeated(&fixture.tactile, fixture.tactile.len() / fixture.n, n);
    let pose = repeated(&fixture.pose, fixture.pose.len() / fixture.n, n);
    let forces = common::run_windows(model, Windows { n, tactile: &tactile, pose: &pose }).unwrap();
    let expected = repeated(&fixture.force, 1, n);
    let worst = forces.force.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert_eq!((forces.force.len(), forces.base.len()), (n, n));
    assert!(worst <= 1e-6, "{worst}"); // as for the smaller batches
}

#[test]
fn rten_gives_what_pytorch_gave() {
    let fixture = fixture();
    let mut model = model::load(&spec(&fixture.path, BackendChoice::Rten)).unwrap();
    assert_eq!(model.info.backend.as_ref().unwrap().runtime, RuntimeName::Rten);
    assert_matches_pytorch(&mut model, &fixture);
    assert_large_batches_are_cut(&mut model, &fixture);
}

#[test]
fn onnxruntime_gives_what_pytorch_gave() {
    let fixture = fixture();
    let Some(mut model) = in_onnxruntime(&fixture.path) else { return };
    assert_matches_pytorch(&mut model, &fixture);
    assert_large_batches_are_cut(&mut model, &fixture);
}

#[test]
fn our_own_code_gives_what_pytorch_gave() {
    let fixture = fixture();
    let mut model = model::load(&spec(&fixture.path, BackendChoice::Builtin)).unwrap();
    let backend = model.info.backend.clone().unwrap();
    assert_eq!((backend.runtime, backend.checked_against.is_some()), (RuntimeName::Builtin, true));
    assert_matches_pytorch(&mut model, &fixture);
    assert_large_batches_are_cut(&mut model, &fixture);
}

#[test]
fn a_model_of_a_foreign_exporter_keeps_the_contract() {
    let fixture = fixture();
    let info = model::inspect(&fixture.path).unwrap();
    assert_eq!((info.contract.window.get(), info.contract.n_taxels, info.contract.n_joints), (64, 16, 4));
    assert_eq!(info.opset, 17);
    assert!(info.producer.starts_with("pytorch 2."), "{}", info.producer);
    assert!(info.contract.has_base);
}

#[test]
fn a_batch_of_one_gives_the_same_bytes_every_time() {
    let fixture = fixture();
    let rten = || model::load(&spec(&fixture.path, BackendChoice::Rten)).unwrap();
    assert_eq!(run_in_parts(&mut rten(), &fixture, 1), run_in_parts(&mut rten(), &fixture, 1));
    let Some(mut first) = in_onnxruntime(&fixture.path) else { return };
    let Some(mut second) = in_onnxruntime(&fixture.path) else { return };
    assert_eq!(run_in_parts(&mut first, &fixture, 1), run_in_parts(&mut second, &fixture, 1));
}

#[test]
fn auto_takes_onnxruntime_where_it_is_and_says_what_it_took() {
    let folder = tempfile::tempdir().unwrap();
    let path = LinearModel::new(8, 4, 2).write(folder.path(), "m.onnx");
    let info = model::load(&spec(&path, BackendChoice::Auto)).unwrap().info;
    let backend = info.backend.unwrap();
    if in_onnxruntime(&path).is_some() {
        assert_eq!(backend.runtime, RuntimeName::OnnxRuntime);
        assert!(backend.library.unwrap().to_string_lossy().contains("onnxruntime"));
        assert!(backend.version.starts_with("1."), "{}", backend.version);
    } else {
        assert_eq!(backend.runtime, RuntimeName::Rten);
        // A library that somebody named and that can't be used is told of.
        let is_named = std::env::var_os("ORT_DYLIB_PATH").is_some();
        let is_told = info.notes.iter().any(|note| note.ends_with("RTen takes its place"));
        assert_eq!(is_told, is_named, "{:?}", info.notes);
    }
}

#[test]
fn onnxruntime_refuses_broken_models_in_one_line_too() {
    let folder = tempfile::tempdir().unwrap();
    let sound = LinearModel::new(8, 4, 2);
    if in_onnxruntime(&sound.write(folder.path(), "m.onnx")).is_none() {
        return;
    }
    for (flaw, line) in [
        (Flaw::UnknownOperator, "TurnIntoForce"),
        (Flaw::NanAtZero, "output force is NaN for a window of zeros"),
        (Flaw::MixesBatch, "output force mixes the windows of a batch"),
        (Flaw::ResidualAdded, "this one adds its residual"),
    ] {
        let path = sound.clone().flaw(flaw).write(folder.path(), "m.onnx");
        let refused = model::load(&spec(&path, BackendChoice::OnnxRuntime)).unwrap_err().to_string();
        assert!(refused.contains(line), "{refused}");
        assert_eq!(refused.lines().count(), 1, "{refused}");
    }
    let path = sound.flaw(Flaw::FixedBatch(1)).write(folder.path(), "m.onnx");
    let mut model = in_onnxruntime(&path).unwrap();
    let windows = Windows { n: 3, tactile: &[0.5; 96], pose: &[0.0; 48] };
    let forces = common::run_windows(&mut model, windows).unwrap();
    assert_eq!(forces.force, [2.0; 3]);
}

#[test]
fn auto_names_both_runtimes_when_neither_takes_a_model() {
    let folder = tempfile::tempdir().unwrap();
    let path = LinearModel::new(8, 4, 2).flaw(Flaw::UnknownOperator).write(folder.path(), "m.onnx");
    let refused = model::load(&spec(&path, BackendChoice::Auto)).unwrap_err().to_string();
    assert!(refused.contains("RTen 0.27.0: ") && refused.contains("ONNX Runtime"), "{refused}");
}
