//! A model that breaks the contract is refused at load, with one line that names what was expected and what came.

use crate::common;

use std::path::Path;

use common::onnx::{Flaw, LinearModel};
use tactile_pose_fusion::fusion::{
    ForceAxes, ForceUnit, Forces, PoseRange, SharedWindows, TouchLevels, TouchOutput, Windows,
};
use tactile_pose_fusion::model::{self, BackendChoice, Batch, Model, ModelError, ModelSpec, Origin};

/// A sound model of 8 frames, 4 taxels, 2 joints.
fn sound() -> LinearModel {
    LinearModel::new(8, 4, 2)
}

fn rten(path: &Path) -> ModelSpec {
    ModelSpec { backend: BackendChoice::Rten, ..ModelSpec::new(path) }
}

fn load(linear: &LinearModel) -> Result<Model, ModelError> {
    load_as(linear, |_| {})
}

fn load_as(linear: &LinearModel, change: impl Fn(&mut ModelSpec)) -> Result<Model, ModelError> {
    let folder = tempfile::tempdir().unwrap();
    let mut spec = rten(&linear.write(folder.path(), "m.onnx"));
    change(&mut spec);
    model::load(&spec)
}

/// The refusal without the file's name, which must stand at its start.
fn refusal(linear: &LinearModel) -> String {
    without_path(load(linear).unwrap_err())
}

fn without_path(refused: ModelError) -> String {
    let text = refused.to_string();
    assert_eq!(text.lines().count(), 1, "{text}");
    let (path, text) = text.split_once(": ").unwrap();
    assert!(path.ends_with("m.onnx"), "{path}");
    text.to_string()
}

fn run(model: &mut Model, n: usize, tactile: &[f32], pose: &[f32]) -> Forces {
    common::run_windows(model, Windows { n, tactile, pose }).unwrap()
}

#[test]
fn a_sound_model_gives_its_force_and_its_base() {
    let linear = sound().gains(0.5, 2.0);
    let mut model = load(&linear).unwrap();
    let contract = model.regressor.contract().clone();
    assert_eq!((contract.window.get(), contract.n_taxels, contract.n_joints), (8, 4, 2));
    assert!(contract.has_base);
    let mut tactile = vec![9.0; 2 * 8 * 4];
    let mut pose = vec![9.0; 2 * 8 * 2];
    tactile[28..32].copy_from_slice(&[1.0, 2.0, 3.0, 4.0]);
    pose[14..16].copy_from_slice(&[0.25, 0.5]);
    let forces = run(&mut model, 2, &tactile, &pose);
    let (force, base) = linear.expected(&[1.0, 2.0, 3.0, 4.0], &[0.25, 0.5]);
    assert_eq!((forces.force[0], forces.base[0]), (force, base)); // few binary fractions: exact
    assert_eq!((forces.force[1], forces.base[1]), linear.expected(&[9.0; 4], &[9.0; 2]));
}

#[test]
fn a_model_without_pose_has_no_joints() {
    let mut model = load(&LinearModel::new(8, 4, 0).force_only()).unwrap();
    assert_eq!(model.regressor.contract().n_joints, 0);
    assert!(!model.regressor.contract().has_base);
    let forces = run(&mut model, 1, &[0.5; 32], &[]);
    assert_eq!(forces, Forces { force: vec![2.0], ..Forces::default() });
}

#[test]
fn metadata_fill_the_contract() {
    let linear = sound()
        .metadata("tpf.contract", "1")
        .metadata("unit", "N")
        .metadata("rate_hz", "200")
        .metadata("joints", r#"["mcp", "pip"]"#)
        .metadata("pose_range", "[[0, 1.5], [-0.5, 1.75]]")
        .metadata("metrics", r#"{"mdf_gf": 10}"#)
        .metadata("glove", "left A");
    let info = load(&linear).unwrap().info;
    assert_eq!((info.contract.unit, info.unit_from), (ForceUnit::Newton, Origin::Metadata));
    assert_eq!((info.contract.rate_hz, info.rate_from), (200.0, Origin::Metadata));
    assert_eq!(info.contract.joints.unwrap(), ["mcp", "pip"]);
    assert_eq!(info.contract.pose_range.unwrap()[1], PoseRange { min: -0.5, max: 1.75 });
    assert!((info.contract.mdf.unwrap().0 - 0.0980665).abs() < 1e-12); // 10 gF, exact to f64
    assert_eq!(info.metadata["glove"], "left A");
    assert!(info.notes.is_empty(), "{:?}", info.notes);
}

#[test]
fn what_nobody_tells_is_assumed_and_noted() {
    let info = load(&sound()).unwrap().info;
    assert_eq!((info.contract.unit, info.unit_from), (ForceUnit::GramForce, Origin::Default));
    assert_eq!((info.contract.rate_hz, info.rate_from), (100.0, Origin::Default));
    assert_eq!(info.notes.len(), 2);
    assert_eq!(info.notes[0], "neither the model nor the parameters tell the unit of its forces: gF is assumed");
}

#[test]
fn parameters_fill_what_the_model_leaves_out_and_may_not_contradict_it() {
    let newton = |spec: &mut ModelSpec| (spec.unit, spec.rate_hz) = (Some(ForceUnit::Newton), Some(50.0));
    let info = load_as(&sound(), newton).unwrap().info;
    assert_eq!((info.contract.unit, info.unit_from), (ForceUnit::Newton, Origin::Parameters));
    assert_eq!((info.contract.rate_hz, info.rate_from), (50.0, Origin::Parameters));
    let refused = without_path(load_as(&sound().metadata("unit", "gF"), newton).unwrap_err());
    assert_eq!(
        refused,
        "metadata unit is gF, but the parameters say N; remove model.NAME.unit from the parameters, or load the model that it was written for"
    );
    let refused = without_path(load_as(&sound().metadata("rate_hz", "100"), newton).unwrap_err());
    assert!(refused.starts_with("metadata rate_hz is 100, but the parameters say 50; "), "{refused}");
}

#[test]
fn a_missing_tensor_lists_what_is_there_and_the_parameter_that_maps_it() {
    let other = sound().names(["taxels", "angles", "y", "force_base", "force_residual"]);
    assert_eq!(
        refusal(&other),
        "no input named tactile; the model has taxels float32 [N, 8, 4], angles float32 [N, 8, 2]; \
         if one of them is meant, name it in the parameter model.NAME.inputs.tactile"
    );
    let refused = without_path(load_as(&other, |spec| spec.names.tactile = "taxels".into()).unwrap_err());
    assert!(
        refused.starts_with("no output named force; the model has y float32 [N, 1], force_base float32"),
        "{refused}"
    );
    assert!(refused.ends_with("name it in the parameter model.NAME.outputs.force"), "{refused}");
    let named = |spec: &mut ModelSpec| {
        spec.names.tactile = "taxels".into();
        spec.names.force = "y".into();
    };
    let refused = without_path(load_as(&other, named).unwrap_err());
    assert_eq!(
        refused,
        "input angles float32 [N, 8, 2] is neither the tactile nor the pose input; if it is the pose, name it in the parameter model.NAME.inputs.pose"
    );
    let model = load_as(&other, |spec| {
        named(spec);
        spec.names.pose = "angles".into();
    });
    assert_eq!(model.unwrap().info.contract.n_joints, 2);
}

#[test]
fn a_lone_float_output_is_not_taken_for_the_force() {
    let refused = refusal(&sound().names(["tactile", "pose", "y", "b", "r"]).force_only());
    assert!(refused.starts_with("no output named force; the model has y float32 [N, 1]; "), "{refused}");
}

#[test]
fn tactile_and_pose_can_not_be_the_same_input() {
    let refused = without_path(load_as(&sound(), |spec| spec.names.pose = "tactile".into()).unwrap_err());
    assert!(
        refused.starts_with("parameter model.NAME.inputs.tactile is tactile, but model.NAME.inputs.pose is"),
        "{refused}"
    );
}

#[test]
fn each_flaw_has_its_own_line() {
    for (flaw, line) in [
        (Flaw::TactileOfRankTwo, "input tactile has shape [N, 4], expected [N, window, taxels]"),
        (Flaw::TactileOfHalfFloats, "input tactile is float16, expected float32; export the model in float32"),
        (
            Flaw::DynamicFrames,
            "input tactile has shape [N, window, taxels], expected a fixed number of frames; export it fixed, or say it in metadata window",
        ),
        (
            Flaw::LongerPose,
            "input pose is [N, 9, 2], but the window of input tactile has 8 frames; both inputs take the same frames",
        ),
        (
            Flaw::TwoForces,
            "output force has shape [N, 2], expected [N] or [N, 1], one force a window, or [N, 3], its x, y and z in the frame of the patch",
        ),
        (
            Flaw::TwoForcesUntold,
            "a trial run of 3 windows failed: output force gave 6 values for 3 windows, expected one each",
        ),
        (
            Flaw::FixedBatch(16),
            "input tactile has shape [16, 8, 4], a batch fixed at 16 windows; export it with a dynamic batch (or a batch of 1)",
        ),
        (
            Flaw::ExtraInput,
            "input temperature float32 [N, 1] is neither the tactile nor the pose input; if it is the pose, name it in the parameter model.NAME.inputs.pose",
        ),
        (
            Flaw::Weight(f32::NAN),
            "tensor tactile_weight holds NaN at element 3, expected finite weights; train or export the model again",
        ),
        (
            Flaw::Weight(f32::INFINITY),
            "tensor tactile_weight holds inf at element 3, expected finite weights; train or export the model again",
        ),
        (
            Flaw::ExternalWeight,
            "tensor tactile_weight keeps its values in another file; export the model into one file",
        ),
        (Flaw::CutWeight, "not a whole ONNX model: tensor tactile_weight of 4 elements holds 2; export it again"),
        (
            Flaw::NanAtZero,
            "output force is NaN for a window of zeros, expected a finite force; train or export the model again",
        ),
    ] {
        assert_eq!(refusal(&sound().flaw(flaw)), line, "{flaw:?}");
    }
}

#[test]
fn metadata_that_disagree_with_the_shapes_are_refused() {
    for (key, value, line) in [
        ("window", "64", "metadata window is 64, but input tactile is [N, 8, 4]; export it with metadata of its own"),
        ("taxels", "16", "metadata taxels is 16, but input tactile is [N, 8, 4]; export it with metadata of its own"),
        (
            "joints",
            "mcp,pip,dip",
            "metadata joints names 3 joints, but input pose is [N, 8, 2]; export it with metadata of its own",
        ),
        (
            "pose_range",
            "[[0, 1]]",
            "metadata pose_range holds 1 joints, but input pose takes 2; export it with metadata of its own",
        ),
        ("unit", "lbf", "metadata unit is \"lbf\", expected gF or N; correct metadata_props or remove the key"),
        (
            "tpf.contract",
            "7",
            "metadata tpf.contract is \"7\", expected \"1\", the only contract that this version reads; correct metadata_props or remove the key",
        ),
    ] {
        assert_eq!(refusal(&sound().metadata(key, value)), line);
    }
    let refused = refusal(&LinearModel::new(8, 4, 0).metadata("joints", "mcp"));
    assert!(refused.starts_with("metadata joints names 1 joints, but the model has no pose input; "), "{refused}");
}

#[test]
fn metadata_settle_what_the_shapes_leave_open() {
    let open = sound().flaw(Flaw::DynamicFrames);
    let told = open.metadata("window", "8").metadata("taxels", "4").metadata("joints", "mcp,pip");
    let contract = load(&told).unwrap().info.contract;
    assert_eq!((contract.window.get(), contract.n_taxels, contract.n_joints), (8, 4, 2));
}

#[test]
fn a_batch_of_one_is_run_window_by_window() {
    let linear = sound().flaw(Flaw::FixedBatch(1));
    let mut model = load(&linear).unwrap();
    assert_eq!(model.info.batch, Batch::One);
    assert!(model.info.notes.iter().any(|note| note.starts_with("its batch is fixed at 1")));
    let tactile: Vec<f32> = (0..5 * 32).map(|idx| idx as f32).collect();
    let forces = run(&mut model, 5, &tactile, &[0.0; 5 * 16]);
    let expected: Vec<f32> = tactile.chunks(32).map(|window| window[28..].iter().sum()).collect();
    assert_eq!(forces.force, expected);
}

#[test]
fn a_model_that_mixes_the_windows_of_a_batch_is_refused() {
    let refused = refusal(&sound().flaw(Flaw::MixesBatch));
    assert!(
        refused.starts_with("output force mixes the windows of a batch: with small readings a window gives "),
        "{refused}"
    );
    assert!(refused.ends_with("with the batch as its first dimension"), "{refused}");
}

/// `tpf train` made it: at readings of 16 bits its terms cancel, so that rounding, which differs between batches of one and of
/// three, is a large part of what is left. It was refused as a model that mixes windows.
#[test]
fn a_model_whose_terms_cancel_mixes_nothing() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/cancelling_terms.onnx");
    for backend in [BackendChoice::Auto, BackendChoice::Builtin, BackendChoice::Rten] {
        let spec = ModelSpec { backend, ..ModelSpec::new(&path) };
        model::load(&spec).unwrap_or_else(|refused| panic!("{backend:?}: {refused}"));
    }
}

#[test]
fn a_residual_with_the_other_sign_is_refused() {
    let refused = refusal(&sound().flaw(Flaw::ResidualAdded));
    assert!(
        refused.contains("the convention is force = force_base - force_residual; this one adds its residual"),
        "{refused}"
    );
    let refused = refusal(&sound().flaw(Flaw::BaseDoubled));
    assert!(refused.ends_with("the convention is force = force_base - force_residual"), "{refused}");
}

#[test]
fn a_base_that_moves_with_the_pose_is_no_fallback() {
    // Without the residual the sum can't be checked, and only the trial with other poses tells.
    let mut linear = sound().flaw(Flaw::BaseMovesWithPose);
    linear.names[4] = "artifact".into();
    // force = base - residual = touch - 2 residual here; sound as far as outputs go.
    let mut model = load(&linear).unwrap();
    assert!(!model.regressor.contract().has_base);
    assert!(!model.info.contract.has_base);
    let note = model.info.notes.last().unwrap();
    assert!(note.starts_with("output force_base moves when only the pose moves"), "{note}");
    assert!(run(&mut model, 1, &[1.0; 32], &[0.0; 16]).base.is_empty());
}

#[test]
fn a_touch_output_is_a_probability_of_its_own() {
    let told = sound().touch("touch").metadata("touch", r#"{"on": 0.8, "off": 0.6, "false_per_min": 2}"#);
    let mut model = load(&told).unwrap();
    let touch = model.regressor.contract().touch.unwrap();
    assert_eq!((touch.levels, touch.false_per_min), (TouchLevels { on: 0.8, off: 0.6 }, Some(2.0)));
    assert!(!model.info.notes.iter().any(|note| note.contains("touch")), "{:?}", model.info.notes);
    let forces = run(&mut model, 2, &[0.125; 64], &[0.0; 32]);
    assert_eq!((&forces.force, &forces.base), (&vec![0.5; 2], &vec![0.5; 2]));
    assert!(forces.touch.iter().all(|touch| (touch - 0.622_459_3).abs() < 1e-6), "{:?}", forces.touch);
    // Without branches, and under another name.
    let other = sound().force_only().touch("is_touched");
    assert_eq!(load(&other).unwrap().info.contract.touch, None);
    let mut model = load_as(&other, |spec| spec.names.touch = "is_touched".into()).unwrap();
    assert_eq!(model.info.contract.touch, Some(TouchOutput::default()));
    let note = "it doesn't tell from which probability of its touch output there is contact: 0.5 is assumed, and 0.35 for its end";
    assert!(model.info.notes.iter().any(|said| said == note), "{:?}", model.info.notes);
    let forces = run(&mut model, 1, &[0.0; 32], &[0.0; 16]);
    assert_eq!(forces, Forces { force: vec![0.0], base: vec![], touch: vec![0.5] });
}

#[test]
fn a_touch_output_that_is_no_probability_is_refused() {
    let refused = refusal(&sound().touch("touch").flaw(Flaw::TouchOfOdds));
    assert!(refused.starts_with("output touch gave ") && refused.contains("from 0 to 1; export it after its sigmoid"));
    let same = |spec: &mut ModelSpec| spec.names.touch = "force_base".into();
    let refused = without_path(load_as(&sound(), same).unwrap_err());
    assert_eq!(
        refused,
        "parameter model.NAME.outputs.touch is force_base, but model.NAME.outputs.force_base is the same output; \
         name two outputs, or leave out the touch of a model that has none"
    );
}

#[test]
fn a_force_that_is_not_finite_is_given_on_and_not_hidden() {
    let mut model = load(&sound().flaw(Flaw::NanAbove(1000.0))).unwrap();
    assert!(model.info.notes.iter().any(|note| note.ends_with("flagged NON_FINITE")), "{:?}", model.info.notes);
    let mut tactile = vec![0.0; 2 * 32];
    tactile[28] = 5000.0;
    let forces = run(&mut model, 2, &tactile, &[0.0; 32]);
    assert!(forces.force[0].is_nan());
    assert_eq!(forces.force[1], 0.0);
    assert_eq!(forces.base[0], 5000.0);
}

#[test]
fn a_force_of_three_axes_comes_as_three_numbers_a_window_in_each_runtime() {
    let linear = sound().gains(0.5, 2.0).axes([0.25, -0.5, 1.0]);
    for backend in [BackendChoice::Rten, BackendChoice::OnnxRuntime, BackendChoice::Auto] {
        let mut model = match load_as(&linear, |spec| spec.backend = backend) {
            Ok(model) => model,
            Err(missing @ ModelError::NoOnnxRuntime { .. }) => {
                common::without_onnx_runtime(&missing.to_string());
                continue;
            }
            Err(refused) => panic!("{refused}"),
        };
        let contract = model.regressor.contract();
        assert!(contract.axes == ForceAxes::Patch && contract.has_base, "{backend:?}");
        let mut tactile = vec![9.0; 2 * 8 * 4];
        tactile[28..32].copy_from_slice(&[1.0, 2.0, 3.0, 4.0]);
        let mut pose = vec![9.0; 2 * 8 * 2];
        pose[14..16].copy_from_slice(&[0.25, 0.5]);
        let forces = run(&mut model, 2, &tactile, &pose);
        let expected = [linear.expected(&[1.0, 2.0, 3.0, 4.0], &[0.25, 0.5]), linear.expected(&[9.0; 4], &[9.0; 2])];
        let along = |force: f32| [0.25 * force, -0.5 * force, force];
        assert_eq!(forces.force, expected.map(|(force, _)| along(force)).concat()); // few binary fractions: exact
        assert_eq!(forces.base, expected.map(|(_, base)| along(base)).concat());
    }
    let info = load(&linear).unwrap().info;
    assert_eq!(info.not_builtin.as_deref(), Some("its force has three axes"));
    // With a touch output, and alone.
    let mut model = load(&linear.clone().touch("touch_of_three").force_only()).unwrap();
    assert_eq!(run(&mut model, 1, &[1.0; 32], &[0.0; 16]).force, [0.5, -1.0, 2.0]);
}

#[test]
fn branches_have_the_axes_of_the_force_and_three_axes_are_told_by_the_file() {
    let three = || sound().axes([1.0, 1.0, 1.0]);
    let text = refusal(&three().flaw(Flaw::BaseOfOneAxis));
    assert_eq!(text, "output force_base has shape [N, 1], expected [N, 3], as the force of the model");
    let text = refusal(&three().flaw(Flaw::ForceUntold).force_only());
    assert!(text.ends_with("a force of three axes needs the shape [N, 3] in the file"), "{text}");
    let text = refusal(&sound().flaw(Flaw::TwoForces));
    assert!(text.ends_with("one force a window, or [N, 3], its x, y and z in the frame of the patch"), "{text}");
    let text = refusal(&three().flaw(Flaw::ResidualAdded));
    assert!(text.contains("this one adds its residual"), "{text}");
}

#[test]
fn an_operator_that_the_runtime_does_not_know_is_named() {
    let refused = refusal(&sound().flaw(Flaw::UnknownOperator));
    assert!(refused.starts_with("RTen 0.27.0: ") && refused.contains("TurnIntoForce"), "{refused}");
}

#[test]
fn windows_of_another_size_are_refused() {
    let mut model = load(&sound()).unwrap();
    let mut refused = |starts: &[usize], n_tactile: usize, n_pose: usize| {
        let (tactile, pose) = (vec![0.0; n_tactile], vec![0.0; n_pose]);
        let windows = SharedWindows { starts, ids: &[], tactile: &tactile, pose: &pose };
        model.regressor.run(windows, &mut Forces::default()).unwrap_err().to_string()
    };
    let text = refused(&[0], 32, 32);
    assert!(text.ends_with("expected frames of 4 tactile and 2 pose numbers, got 32 and 32"), "{text}");
    let text = refused(&[0], 31, 14);
    assert!(text.ends_with("expected frames of 4 tactile and 2 pose numbers, got 31 and 14"), "{text}");
    for starts in [&[0, 2][..], &[usize::MAX], &[0, 0], &[1, 0]] {
        let text = refused(starts, 9 * 4, 9 * 2);
        assert!(text.ends_with("expected windows of 8 frames that rise, within 9 frames"), "{text}");
    }
    assert_eq!(run(&mut model, 0, &[], &[]), Forces::default());
}

#[test]
fn buffers_hold_only_the_last_batch() {
    let mut model = load(&sound()).unwrap();
    let mut forces = Forces { force: vec![7.0; 9], base: vec![7.0; 9], touch: vec![7.0; 9] };
    let windows = SharedWindows { starts: &[0], ids: &[], tactile: &[1.0; 32], pose: &[0.0; 16] };
    model.regressor.run(windows, &mut forces).unwrap();
    assert_eq!(forces, Forces { force: vec![4.0], base: vec![4.0], touch: vec![] });
}

#[test]
fn a_file_that_is_not_there_or_not_a_model_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.onnx");
    let refused = without_path(model::inspect(&path).unwrap_err());
    assert!(refused.starts_with("can't read the model: "), "{refused}");
    std::fs::write(&path, "").unwrap();
    assert_eq!(
        without_path(model::inspect(&path).unwrap_err()),
        "not a whole ONNX model: it holds no graph; export it again"
    );
    std::fs::write(&path, "tactile,pose\n1,2\n").unwrap();
    let refused = without_path(model::inspect(&path).unwrap_err());
    assert!(refused.starts_with("not a whole ONNX model: "), "{refused}");
    std::fs::File::create(&path).unwrap().set_len(65 << 20).unwrap();
    let refused = without_path(model::inspect(&path).unwrap_err());
    assert!(refused.starts_with("the file has more than 64 MiB"), "{refused}");
}

#[test]
fn inspection_tells_the_contract_without_a_runtime() {
    let folder = tempfile::tempdir().unwrap();
    let path = sound().metadata("unit", "gF").write(folder.path(), "m.onnx");
    let info = model::inspect(&path).unwrap();
    assert_eq!(info.backend, None);
    assert_eq!((info.ir_version, info.opset), (8, 17));
    let json = serde_json::to_value(&info).unwrap();
    assert_eq!(json["contract"]["taxels"], 4);
    assert_eq!(json["contract"]["unit"], "gF");
    assert_eq!(json["unit_from"], "metadata");
    assert_eq!(json["inputs"][0]["shape"], serde_json::json!(["N", 8, 4]));
    assert_eq!(json["sha256"].as_str().unwrap().len(), 64);
}
