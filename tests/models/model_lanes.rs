//! Windows that come a frame at a time, as they do live, give the bits that they give in a stretch.

use std::path::{Path, PathBuf};

use tactile_pose_fusion::fusion::{Contract, Forces, FrameSequence, SharedWindows};
use tactile_pose_fusion::model::{BackendChoice, Model, ModelSpec, load};

/// Windows of a lane.
const N: usize = 60;
const N_LANES: usize = 5;

fn own(name: &str) -> Model {
    let path: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("models").join(name);
    load(&ModelSpec { backend: BackendChoice::Builtin, ..ModelSpec::new(path) }).unwrap()
}

/// The frames of a region.
struct Lane {
    sequence: FrameSequence,
    tactile: Vec<f32>,
    pose: Vec<f32>,
}

fn lanes(contract: &Contract, n: usize) -> Vec<Lane> {
    let n_frames = N + contract.window.get() - 1;
    let values = |lane: usize, width: usize, scale: f32| -> Vec<f32> {
        let value = |at: usize| ((at / width * 7 + at % width * 13 + lane * 29) as f32 * 0.13).sin().abs() * scale;
        (0..n_frames * width).map(value).collect()
    };
    (0..n)
        .map(|lane| Lane {
            sequence: FrameSequence::default(),
            tactile: values(lane, contract.n_columns(), 300.0),
            pose: values(lane, contract.n_joints, 1.2),
        })
        .collect()
}

/// Bits of the force, of the base and of the touch; whatever is not a number is one and the same.
type Bits = (u32, Option<u32>, Option<u32>);

fn bits(forces: &Forces) -> Vec<Bits> {
    let one = |force: &f32| if force.is_nan() { f32::NAN.to_bits() } else { force.to_bits() };
    let all = |idx: usize| (one(&forces.force[idx]), forces.base.get(idx).map(one), forces.touch.get(idx).map(one));
    (0..forces.force.len()).map(all).collect()
}

/// What every window of a lane gives in a stretch.
fn stretch(model: &mut Model, lane: &Lane) -> Vec<Bits> {
    let mut forces = Forces::default();
    let starts: Vec<usize> = (0..N).collect();
    model
        .regressor
        .run(SharedWindows { starts: &starts, ids: &[], tactile: &lane.tactile, pose: &lane.pose }, &mut forces)
        .unwrap();
    bits(&forces)
}

/// One call: of some lanes, the window that begins at some frame, one below the other.
fn call(model: &mut Model, lanes: &[Lane], windows: &[(usize, usize)], forces: &mut Forces) -> Vec<Bits> {
    let contract = model.regressor.contract();
    let (window, n_columns, n_joints) = (contract.window.get(), contract.n_columns(), contract.n_joints);
    let (mut tactile, mut pose) = (Vec::new(), Vec::new());
    for &(lane, first) in windows {
        tactile.extend_from_slice(&lanes[lane].tactile[first * n_columns..(first + window) * n_columns]);
        pose.extend_from_slice(&lanes[lane].pose[first * n_joints..(first + window) * n_joints]);
    }
    let starts: Vec<usize> = (0..windows.len()).map(|idx| idx * window).collect();
    let ids: Vec<_> = windows.iter().map(|&(lane, first)| lanes[lane].sequence.window(first)).collect();
    model.regressor.run(SharedWindows { starts: &starts, ids: &ids, tactile: &tactile, pose: &pose }, forces).unwrap();
    bits(forces)
}

/// Frames that sensors don't send, but software might.
fn spoil(lanes: &mut [Lane], contract: &Contract) {
    let width = contract.n_columns();
    for (lane, frame, value) in [(0, 80, f32::NAN), (1, 20, f32::INFINITY), (2, 90, f32::NEG_INFINITY), (3, 70, -0.0)] {
        lanes[lane].tactile[frame * width] = value;
    }
    lanes[3].tactile[69 * width..70 * width].fill(0.0);
    if contract.n_joints > 0 {
        lanes[4].pose[75 * contract.n_joints] = f32::NAN;
        lanes[2].pose[30 * contract.n_joints] = f32::INFINITY;
    }
}

#[test]
fn windows_that_come_frame_by_frame_give_the_bits_of_a_stretch() {
    for name in ["glove1_pose_aware.onnx", "glove1_tactile_only.onnx", "glove3_adaptive.onnx"] {
        let mut model = own(name);
        let contract = model.info.contract.clone();
        for spoiled in [false, true] {
            let mut lanes = lanes(&contract, N_LANES);
            if spoiled {
                spoil(&mut lanes, &contract);
            }
            let expected: Vec<_> = lanes.iter().map(|lane| stretch(&mut model, lane)).collect();
            let mut forces = Forces::default();
            for first in 0..N {
                let windows: Vec<_> = (0..N_LANES).map(|lane| (lane, first)).collect();
                let of_lanes: Vec<_> = expected.iter().map(|lane| lane[first]).collect();
                assert_eq!(call(&mut model, &lanes, &windows, &mut forces), of_lanes, "{name}, window {first}");
            }
        }
    }
}

#[test]
fn whatever_was_run_before_the_bits_are_the_same() {
    for name in ["glove1_pose_aware.onnx", "glove3_adaptive.onnx"] {
        whatever_was_run_before(own(name));
    }
}

fn whatever_was_run_before(mut model: Model) {
    let contract = model.info.contract.clone();
    let mut lanes = lanes(&contract, 2 * N_LANES);
    spoil(&mut lanes, &contract);
    let expected: Vec<_> = lanes.iter().map(|lane| stretch(&mut model, lane)).collect();
    let hand: Vec<usize> = (0..N_LANES).collect();
    let other: Vec<usize> = (N_LANES..2 * N_LANES).collect();
    let swapped = [1, 0, 2, 3, 4];
    let many: Vec<usize> = (0..40).map(|idx| idx % lanes.len()).collect(); // more than are kept
    let mut calls: Vec<(&[usize], usize)> = Vec::new();
    // In turn with another hand, and one lane by itself.
    calls.extend((0..6).flat_map(|first| [(&hand[..], first), (&other[..], first + 7), (&hand[2..3], first)]));
    // The same window again, a frame left out, back in time, places swapped and swapped back.
    calls.extend([5, 6, 8, 9, 2, 3].map(|first| (&hand[..], first)));
    calls.extend([(&swapped[..], 4), (&swapped[..], 5), (&hand[..], 6), (&hand[..], 7)]);
    // A lane less, a lane more, many, and on from there.
    calls.extend([(&hand[..4], 8), (&hand[..4], 9), (&hand[..], 8), (&many[..], 10), (&hand[..], 9), (&hand[..], 10)]);
    // Where frames are no numbers, and after them.
    calls.extend((14..34).map(|first| (&hand[..], first)));
    let mut forces = Forces::default();
    for (idx, (of, first)) in calls.into_iter().enumerate() {
        let windows: Vec<_> = of.iter().map(|&lane| (lane, first)).collect();
        let of_lanes: Vec<_> = of.iter().map(|&lane| expected[lane][first]).collect();
        assert_eq!(call(&mut model, &lanes, &windows, &mut forces), of_lanes, "call {idx}: {windows:?}");
    }
    // One lane goes on and the others begin anew.
    for windows in [[(0, 3), (1, 3), (2, 3)], [(0, 4), (1, 30), (2, 2)], [(0, 5), (1, 31), (2, 3)]] {
        let of_lanes: Vec<_> = windows.iter().map(|&(lane, first)| expected[lane][first]).collect();
        assert_eq!(call(&mut model, &lanes, &windows, &mut forces), of_lanes, "{windows:?}");
    }
}

#[test]
fn windows_that_go_on_in_their_taxels_or_in_their_pose_alone_are_others() {
    let mut model = own("glove1_pose_aware.onnx");
    let contract = model.info.contract.clone();
    let mut lanes = lanes(&contract, 3);
    lanes[1].tactile = lanes[0].tactile.clone();
    lanes[2].pose = lanes[0].pose.clone();
    let expected: Vec<_> = lanes.iter().map(|lane| stretch(&mut model, lane)).collect();
    let mut forces = Forces::default();
    for (first, lane) in [0, 1, 0, 2, 0, 0].into_iter().enumerate() {
        assert_eq!(call(&mut model, &lanes, &[(lane, first)], &mut forces), [expected[lane][first]], "call {first}");
    }
}

#[test]
fn a_frame_that_is_no_number_reaches_every_window_that_holds_it_and_no_other() {
    let mut model = own("glove1_pose_aware.onnx");
    let contract = model.info.contract.clone();
    for frame in [contract.window.get() - 1, contract.window.get() + 20] {
        let holds = |first: usize| (first..first + contract.window.get()).contains(&frame);
        let mut spoiled = lanes(&contract, 2);
        spoiled[0].tactile[frame * contract.n_columns() + 1] = f32::NAN;
        spoiled[1].pose[frame * contract.n_joints + 1] = f32::NAN;
        let nan = f32::NAN.to_bits();
        for (first, (force, base, _)) in stretch(&mut model, &spoiled[0]).into_iter().enumerate() {
            assert_eq!((force == nan, base == Some(nan)), (holds(first), holds(first)), "window {first}");
        }
        for (first, (force, base, _)) in stretch(&mut model, &spoiled[1]).into_iter().enumerate() {
            assert_eq!((force == nan, base == Some(nan)), (holds(first), false), "window {first}");
        }
    }
}

#[test]
fn windows_whose_place_is_not_known_give_the_same_bits() {
    let mut model = own("glove1_pose_aware.onnx");
    let contract = model.info.contract.clone();
    let lane = lanes(&contract, 1).remove(0);
    let expected = stretch(&mut model, &lane);
    let ids: Vec<_> = (0..N).map(|first| lane.sequence.window(first)).collect();
    let mut forces = Forces::default();
    for first in 0..N {
        let ids = if first % 3 == 1 { &[] } else { &ids[first..=first] };
        let windows = SharedWindows { starts: &[first], ids, tactile: &lane.tactile, pose: &lane.pose };
        model.regressor.run(windows, &mut forces).unwrap();
        assert_eq!(bits(&forces), [expected[first]], "window {first}");
    }
}

#[cfg(debug_assertions)]
#[test]
#[should_panic(expected = "frames of a sequence changed")]
fn frames_that_change_within_a_sequence_are_found_in_debug_builds() {
    let mut model = own("glove1_pose_aware.onnx");
    let contract = model.info.contract.clone();
    let mut lanes = lanes(&contract, 1);
    let mut forces = Forces::default();
    call(&mut model, &lanes, &[(0, 0)], &mut forces);
    lanes[0].tactile[contract.n_columns()] += 1.0;
    call(&mut model, &lanes, &[(0, 1)], &mut forces);
}
