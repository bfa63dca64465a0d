//! Touches through the core with the adaptive models that ship: a synthetic user's hand moves in the air, tracked by markers or
//! by a camera, and touches of any course are added to its taxels along the pattern that the model knows. SYNTHETIC data.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock};

use tactile_pose_fusion::fusion::Adaptation;
use tactile_pose_fusion::sim::{Conditions, Tracking};

use crate::worn::{CALIBRATED_S, Felt, Worn, for_a_minute, in_span, long_grasp, shipped, slow_ramp};

/// Users that no model knows.
const USERS: std::ops::RangeInclusive<u32> = 1..=2;

/// Sessions of two minutes: glove, whether a camera tracks the hand, user. Each is made once for all tests.
type Sessions = BTreeMap<(u8, bool, u32), Arc<OnceLock<Worn>>>;

/// Two minutes in the air.
fn two_minutes<R>(glove: u8, tracking: Tracking, user: u32, of: impl FnOnce(&Worn) -> R) -> R {
    static SESSIONS: Mutex<Sessions> = Mutex::new(BTreeMap::new());
    let key = (glove, tracking == Tracking::Camera, user);
    let session = Arc::clone(SESSIONS.lock().unwrap().entry(key).or_default());
    of(session.get_or_init(|| Worn::new((glove, &Conditions::default()), &shipped(glove), tracking, user, 2.0)))
}

fn share_of(felt: &[Felt], from_s: f64, to_s: f64, states: &[Adaptation]) -> f64 {
    let within: Vec<&Felt> = felt.iter().filter(|felt| (from_s..to_s).contains(&felt.at_s)).collect();
    within.iter().filter(|felt| states.contains(&felt.adaptation)).count() as f64 / within.len() as f64
}

#[test]
fn a_touch_that_is_held_for_a_minute_in_a_moving_hand_is_kept() {
    for (glove, tracking, force_gf) in [
        (1, Tracking::Markers, 10.0),
        (1, Tracking::Markers, 40.0),
        (1, Tracking::Camera, 40.0),
        (2, Tracking::Markers, 20.0),
        (3, Tracking::Markers, 40.0),
        (3, Tracking::Camera, 60.0),
    ] {
        for user in USERS {
            let felt = two_minutes(glove, tracking, user, |worn| worn.feel(CALIBRATED_S, for_a_minute(force_gf)));
            let (early, late, over) =
                (in_span(&felt, 40.5, 44.5), in_span(&felt, 96.0, 100.0), in_span(&felt, 101.0, 106.0));
            let told = format!(
                "glove {glove}, {tracking:?}, user {user}, {force_gf} gF: {early:?} at first, {late:?} at last, {over:?} after"
            );
            assert!(early.0 > 0.95 && late.0 > 0.95 && late.1 > 0.7 * early.1, "{told}");
            assert!(over.0 < 0.1 && over.1.abs() < 3.0, "{told}");
        }
    }
}

/// A glove that slips at once can take a light touch away (docs/validation/2026-11-28-sudden-slips.md). One that slips slowly does not.
#[test]
fn without_sudden_slips_a_light_touch_is_kept_for_the_whole_minute() {
    let conditions = Conditions { slips_per_min: Some(0.0), ..Conditions::default() };
    for (glove, user) in (1..=3).flat_map(|glove| (1..=6).map(move |user| (glove, user))) {
        let worn = Worn::new((glove, &conditions), &shipped(glove), Tracking::Markers, user, 2.0);
        let force_gf = if glove == 1 { 10.0 } else { 15.0 };
        let (found, _) = in_span(&worn.feel(CALIBRATED_S, for_a_minute(force_gf)), 41.0, 100.0);
        assert!(found > 0.95, "glove {glove}, user {user}, {force_gf} gF: found in {found} of its frames");
    }
}

#[test]
fn a_light_touch_goes_on_after_frames_were_lost() {
    // Frames of this session are lost at 57 s. The network sees no onset after them, but the filter sees the touch.
    let conditions = Conditions { slips_per_min: Some(0.0), ..Conditions::default() };
    let worn = Worn::new((3, &conditions), &shipped(3), Tracking::Markers, 4, 2.0);
    let touch = for_a_minute(10.0);
    let at_fault = |at_s: f64| if (50.0..50.4).contains(&at_s) { f64::NAN } else { touch(at_s) };
    for (what, lost_at_s, felt) in
        [("lost", 57.0, worn.feel(CALIBRATED_S, &touch)), ("NaN", 50.0, worn.feel(CALIBRATED_S, at_fault))]
    {
        let n_after_gap = felt.iter().filter(|felt| (lost_at_s..lost_at_s + 0.8).contains(&felt.at_s)).count();
        assert!(n_after_gap < 40, "{what}: {n_after_gap} estimates: no frames were lost");
        let (before, after) = (in_span(&felt, 44.0, lost_at_s - 0.5), in_span(&felt, lost_at_s + 2.5, lost_at_s + 6.0));
        assert!(before.0 > 0.95 && after.0 > 0.95, "{what}: {before:?}, then {after:?}");
    }
}

#[test]
fn a_slow_ramp_is_found() {
    for (tracking, found_at) in [(Tracking::Markers, 12.0), (Tracking::Camera, 25.0)] {
        for user in USERS {
            let felt = two_minutes(1, tracking, user, |worn| worn.feel(CALIBRATED_S, slow_ramp));
            let loaded: Vec<&Felt> = felt.iter().filter(|felt| felt.at_s > 40.0).collect();
            let is_found = |second: &&[&Felt]| second.iter().filter(|felt| felt.contact).count() > 80;
            let found = loaded.windows(100).find(is_found).map(|second| slow_ramp(second[0].at_s));
            assert!(found.is_some_and(|force| force < found_at), "{tracking:?}, user {user}: found at {found:?} gF");
        }
    }
}

#[test]
fn ten_minutes_of_grasp_without_air_leave_no_false_touches() {
    for (glove, tracking, user) in [
        (1, Tracking::Markers, 1),
        (1, Tracking::Camera, 1),
        (2, Tracking::Markers, 4),
        (2, Tracking::Camera, 5),
        (3, Tracking::Markers, 1),
        (3, Tracking::Camera, 1),
    ] {
        let felt = Worn::new((glove, &Conditions::default()), &shipped(glove), tracking, user, 12.0)
            .feel(CALIBRATED_S, long_grasp);
        let (before, within) = (in_span(&felt, 14.0, 40.0), in_span(&felt, 41.0, 640.0));
        let (after, later) = (in_span(&felt, 640.3, 645.0), in_span(&felt, 645.0, 700.0));
        let told = format!(
            "glove {glove}, {tracking:?}, user {user}: {before:?}, {within:?} in the grasp, then {after:?}, {later:?}"
        );
        assert!(within.0 > 0.99 && within.1 > 80.0, "{told}");
        assert!(after.0 < 0.05 && later.0 < before.0 + 0.02 && after.1 < 3.0, "{told}");
        let learned = share_of(&felt, 41.0, 640.0, &[Adaptation::Learning, Adaptation::Noisy, Adaptation::Capped]);
        assert!(learned < 0.01, "{told}: {learned} of its frames teach gains");
    }
}

#[test]
fn a_grasp_that_is_let_go_in_part_leaves_its_rest_and_then_nothing() {
    let let_go_in_part = |at_s: f64| match at_s {
        ..40.0 => 0.0,
        ..340.0 => 120.0 + 60.0 * (at_s / 2.0).sin(),
        ..400.0 => 30.0,
        _ => 0.0,
    };
    for (glove, tracking, user) in
        [(1, Tracking::Markers, 1), (2, Tracking::Markers, 3), (2, Tracking::Camera, 4), (3, Tracking::Camera, 1)]
    {
        let felt = Worn::new((glove, &Conditions::default()), &shipped(glove), tracking, user, 7.5)
            .feel(CALIBRATED_S, let_go_in_part);
        let (left, later, after) =
            (in_span(&felt, 341.0, 345.0), in_span(&felt, 345.0, 400.0), in_span(&felt, 400.3, 405.0));
        let told = format!(
            "glove {glove}, {tracking:?}, user {user}: {left:?}, then {later:?} of 30 gF, and {after:?} after it"
        );
        assert!(left.0 > 0.95 && later.0 > 0.95 && later.1 > 15.0, "{told}");
        assert!(after.0 < 0.1 && after.1 < 3.0, "{told}");
    }
}

#[test]
fn a_start_in_contact_is_said_and_not_learned() {
    for (tracking, force_gf) in [(Tracking::Markers, 15.0), (Tracking::Camera, 60.0)] {
        for user in USERS {
            // The calibration is older than the recording, as from a file.
            let felt =
                two_minutes(1, tracking, user, |worn| worn.feel(15.0, |at_s| if at_s < 42.0 { force_gf } else { 0.0 }));
            let (first, over) = (in_span(&felt, 15.0, 20.0), in_span(&felt, 43.0, 60.0));
            let told = format!("{tracking:?}, user {user}: {first:?} at first, {over:?} when it is over");
            assert!(first.0 > 0.95 && over.0 < 0.15, "{told}");
            let waiting = share_of(&felt, 17.0, 20.0, &[Adaptation::Waiting]);
            assert!(waiting > 0.95, "{told}: waits in {waiting} of the frames");
        }
    }
}

#[test]
fn a_noisy_tracker_is_said_and_a_good_one_is_not() {
    for glove in 1..=3 {
        for user in USERS {
            let noisy = |tracking| {
                let felt = two_minutes(glove, tracking, user, |worn| worn.feel(CALIBRATED_S, |_| 0.0));
                share_of(&felt, 25.0, 120.0, &[Adaptation::Noisy])
            };
            let (markers, camera) = (noisy(Tracking::Markers), noisy(Tracking::Camera));
            assert!(markers < 0.01 && camera > 0.3, "glove {glove}, user {user}: {markers} and {camera}");
        }
    }
}
