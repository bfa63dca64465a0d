//! Sessions are checked before they are trained on, and windows never cross a gap or a border of the split.

use crate::train_common;

use tactile_pose_fusion::eval::Part;
use tactile_pose_fusion::train::*;
use train_common::{JOINTS, TAXELS, WINDOW, all_of_it, frames, session, split_session};

type Change = fn(&mut SessionFrames);

#[test]
fn sessions_that_cannot_be_trained_on_are_refused_with_what_to_do() {
    let cases: [(Change, &str); 9] = [
        (|f| f.truth_gf.clear(), "session a: no force truth"),
        (|f| f.zero_load.fill(false), "session a: no frame is annotated as zero-load"),
        (|f| f.truth_gf[7] = f32::NAN, "session a: truth_gf at frame 7 is NaN"),
        (|f| f.tactile[10] = f32::INFINITY, "session a: tactile at frame 3 is inf"),
        (|f| f.pose[9] = f32::NAN, "session a: pose at frame 4 is NaN"),
        (|f| f.pose.truncate(239), "session a: pose holds 239 values, expected 240 for 120 frames"),
        (|f| f.tactile.truncate(359), "session a: tactile holds 359 values"),
        (|f| f.part.push(Part::Test), "session a: part holds 121 values, expected 120"),
        (|f| f.n_taxels = 0, "session a: no taxels"),
    ];
    for (change, expected) in cases {
        let mut frames = frames("a", 120);
        change(&mut frames);
        let refused = Session::new(frames).unwrap_err().to_string();
        assert!(refused.starts_with(expected), "{refused}");
        assert_eq!(refused.lines().count(), 1);
    }
}

#[test]
fn widths_that_overflow_are_refused() {
    let mut frames = frames("a", 120);
    frames.n_joints = usize::MAX;
    assert!(matches!(Session::new(frames), Err(DatasetError::Length { column: "pose", .. })));
}

#[test]
fn datasets_that_cannot_be_trained_on_are_refused() {
    let spec = all_of_it(Kind::PoseAware);
    let refused = |sessions: Vec<Session>, spec: WindowSpec| Dataset::new(sessions, spec).unwrap_err();
    assert_eq!(refused(vec![], spec), DatasetError::NoSessions);

    let mut without_pose = frames("b", 120);
    (without_pose.n_joints, without_pose.pose) = (0, vec![]);
    let without_pose = Session::new(without_pose).unwrap();
    let session_a = || session("a", 120);
    assert!(matches!(refused(vec![without_pose.clone()], spec), DatasetError::NoJoints { .. }));
    assert!(Dataset::new(vec![without_pose.clone()], all_of_it(Kind::TactileOnly)).is_ok());
    let mixed = refused(vec![session_a(), without_pose], all_of_it(Kind::TactileOnly));
    assert_eq!(mixed.to_string(), "session b: 0 joints, expected 2 as in session a");

    for (force, class) in [(0.0, "without touch"), (50.0, "touch")] {
        let mut one_class = frames("a", 120);
        one_class.truth_gf.fill(force);
        let said = refused(vec![Session::new(one_class).unwrap()], spec).to_string();
        assert!(said.starts_with(&format!("every training window is {class} at 2.5 gF")), "{said}");
    }
    assert!(matches!(refused(vec![session_a()], WindowSpec { window: 0, ..spec }), DatasetError::Setting { .. }));
    assert!(matches!(refused(vec![session_a()], WindowSpec { stride: 0, ..spec }), DatasetError::Setting { .. }));
    assert!(matches!(refused(vec![session_a()], WindowSpec { window: 121, ..spec }), DatasetError::NoWindows { .. }));
}

#[test]
fn a_window_ends_at_every_frame_with_enough_frames_behind_it() {
    let dataset = Dataset::new(vec![session("a", 120), session("b", 100)], all_of_it(Kind::PoseAware)).unwrap();
    assert_eq!(dataset.n_windows(Part::Train), 120 - WINDOW + 1 + 100 - WINDOW + 1);
    assert_eq!(dataset.window_end(Part::Train, 0), Some((0, WINDOW - 1)));
    assert_eq!(dataset.window_end(Part::Train, 120 - WINDOW + 1), Some((1, WINDOW - 1)));
    assert_eq!(dataset.window_end(Part::Train, 10_000), None);
}

#[test]
fn no_window_crosses_a_gap() {
    let mut frames = frames("a", 120);
    frames.epoch[50..].fill(1);
    let dataset = Dataset::new(vec![Session::new(frames).unwrap()], all_of_it(Kind::PoseAware)).unwrap();
    let ends: Vec<usize> = (0..dataset.n_windows(Part::Train))
        .filter_map(|window| Some(dataset.window_end(Part::Train, window)?.1))
        .collect();
    let expected: Vec<usize> = (WINDOW - 1..50).chain(50 + WINDOW - 1..120).collect();
    assert_eq!(ends, expected);
}

#[test]
fn no_window_is_in_two_parts() {
    let parts = [(Part::Train, 48), (Part::Validation, 16), (Part::Test, 16)];
    let dataset = Dataset::new(vec![split_session("a", &[parts, parts].concat())], all_of_it(Kind::PoseAware)).unwrap();
    let ends = |part| -> Vec<usize> {
        (0..dataset.n_windows(part)).filter_map(|window| Some(dataset.window_end(part, window)?.1)).collect()
    };
    let of = |first: usize, last: usize| first + WINDOW - 1..last;
    assert_eq!(ends(Part::Train), of(0, 48).chain(of(80, 128)).collect::<Vec<_>>());
    assert_eq!(ends(Part::Validation), of(48, 64).chain(of(128, 144)).collect::<Vec<_>>());
    assert_eq!(ends(Part::Test), of(64, 80).chain(of(144, 160)).collect::<Vec<_>>());
}

#[test]
fn strides_thin_out_the_windows_of_each_part() {
    let session = split_session("a", &[(Part::Train, 80), (Part::Test, 80)]);
    let spec = WindowSpec { stride: 3, eval_stride: 5, ..all_of_it(Kind::PoseAware) };
    let dataset = Dataset::new(vec![session], spec).unwrap();
    assert_eq!(dataset.n_windows(Part::Train), (80 - WINDOW + 1usize).div_ceil(3));
    assert_eq!(dataset.n_windows(Part::Test), (80 - WINDOW + 1usize).div_ceil(5));
}

#[test]
fn a_batch_holds_the_frames_of_its_windows() {
    let dataset = Dataset::new(vec![session("a", 120)], all_of_it(Kind::PoseAware)).unwrap();
    let frames = frames("a", 120);
    let windows = [3, 60, 12];
    let batch = dataset.batch(Part::Train, &windows, Some(1.0));
    assert_eq!(batch.n, 3);
    for (idx, start) in windows.into_iter().enumerate() {
        let tactile = &frames.tactile[start * TAXELS..(start + WINDOW) * TAXELS];
        assert_eq!(&batch.tactile[idx * WINDOW * TAXELS..(idx + 1) * WINDOW * TAXELS], tactile);
        let pose = &frames.pose[start * JOINTS..(start + WINDOW) * JOINTS];
        assert_eq!(&batch.pose[idx * WINDOW * JOINTS..(idx + 1) * WINDOW * JOINTS], pose);
        assert_eq!(batch.truth_gf[idx], frames.truth_gf[start + WINDOW - 1]);
        let zero_load = frames.zero_load[start..start + WINDOW].iter().all(|zero_load| *zero_load);
        assert_eq!(batch.zero_load[idx], zero_load);
        // The target lies time first, and only where the whole window is free of load.
        let target = smoothed_change(tactile, TAXELS, 1.0);
        for frame in 0..WINDOW {
            let got = &batch.artifact[(frame * 3 + idx) * TAXELS..][..TAXELS];
            let expected = &target[frame * TAXELS..][..TAXELS];
            assert_eq!(got, if zero_load { expected } else { &[0.0; TAXELS][..] });
        }
    }
    assert_eq!(batch.zero_load, [true, false, true]);
}

#[test]
fn the_auxiliary_target_is_the_net_change_over_the_window() {
    // A ramp on an offset: the offset goes, the ramp stays, the middle is not moved by the smoothing.
    let ramp: Vec<f32> = (0..40).map(|frame| 100.0 + frame as f32).collect();
    let change = smoothed_change(&ramp, 1, 2.0);
    assert_eq!(change[0], 0.0);
    assert!((change[25] - change[15] - 10.0).abs() < 1e-4); // float32 at 100
    // An impulse spreads as a Gaussian: e^(-1/2) of its height one sigma away.
    let mut impulse = vec![0.0; 41];
    impulse[20] = 1.0;
    let change = smoothed_change(&impulse, 1, 2.0);
    assert!((change[22] / change[20] - (-0.5f32).exp()).abs() < 1e-4);
    assert_eq!(smoothed_change(&impulse, 1, 0.0), impulse);
    // A window shorter than the kernel is mirrored as often as it takes.
    assert!(smoothed_change(&[5.0, 5.0], 1, 10.0).iter().all(|value| value.abs() < 1e-5));
}

#[test]
fn scale_and_pose_range_come_from_the_training_part_alone() {
    let mut frames = frames("a", 160);
    frames.part = [vec![Part::Train; 112], vec![Part::Validation; 16], vec![Part::Test; 32]].concat();
    frames.tactile.fill(2.0);
    frames.tactile[130 * TAXELS..].fill(1000.0);
    frames.pose.fill(0.5);
    frames.pose[130 * JOINTS..].fill(9.0);
    let dataset = Dataset::new(vec![Session::new(frames).unwrap()], all_of_it(Kind::PoseAware)).unwrap();
    assert_eq!(dataset.tactile_scale(), 2.0);
    assert_eq!(dataset.pose_range(), [0.5, 0.5].map(|at| tactile_pose_fusion::fusion::PoseRange { min: at, max: at }));
}

#[test]
fn the_fingerprint_tells_data_and_splits_apart() {
    let of = |n, spec| Dataset::new(vec![session("a", n)], spec).unwrap().fingerprint();
    let spec = all_of_it(Kind::PoseAware);
    assert_eq!(of(120, spec), of(120, spec));
    assert_ne!(of(120, spec), of(121, spec));
    assert_ne!(of(120, spec), of(120, WindowSpec { stride: 2, ..spec }));
}
