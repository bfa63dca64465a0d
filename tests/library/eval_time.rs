//! Touches in time, the tare of the truth, and which frames train and test.

use std::time::Duration;

use proptest::prelude::*;
use tactile_pose_fusion::eval::*;
use tactile_pose_fusion::units::{GramForce, Stamp};

const MS: i64 = 1_000_000;

/// Frames every 10 ms; touch in the given half-open ranges of frames.
fn touches(n_frames: i64, ranges: &[(i64, i64)]) -> Touches {
    touches_by(n_frames, ranges, Touching::default())
}

fn touches_by(n_frames: i64, ranges: &[(i64, i64)], rule: Touching) -> Touches {
    let stamps: Vec<Stamp> = (0..n_frames).map(|k| Stamp(k * 10 * MS)).collect();
    let states: Vec<bool> = (0..n_frames).map(|k| ranges.iter().any(|&(from, to)| (from..to).contains(&k))).collect();
    Touches::of(&stamps, &states, rule).unwrap()
}

fn detection(truth: &Touches, detected: &Touches, slack_ms: u64) -> Detection {
    let mut tally = DetectionTally::new(Duration::from_millis(slack_ms));
    tally.handle_session(truth, detected);
    tally.detection()
}

#[test]
fn latencies_are_signed_and_matched_touch_by_touch() {
    let truth = touches(1000, &[(100, 200), (300, 400), (500, 600)]);
    let detected = touches(1000, &[(103, 210), (298, 390), (505, 595)]);
    let found = detection(&truth, &detected, 0);
    assert_eq!((found.n_true, found.n_detected, found.n_missed, found.n_merged, found.n_split), (3, 3, 0, 0, 0));
    let onset = found.onset_ms.unwrap();
    assert_eq!((onset.n, onset.min, onset.p50, onset.max), (3, -20.0, 30.0, 50.0));
    let offset = found.offset_ms.unwrap();
    assert_eq!((offset.n, offset.min, offset.p50, offset.max), (3, -100.0, -50.0, 100.0));
    assert_eq!(found.air.n, 0);
}

#[test]
fn missed_and_false_touches_are_counted_over_the_time_in_the_air() {
    // 10,000 frames of 10 ms are 100 s but for the last frame; 20 s of them in touch.
    let truth = touches(10_000, &[(1000, 2000), (5000, 6000)]);
    let detected = touches(10_000, &[(1000, 2000), (3000, 3010), (8000, 8001), (9000, 9500)]);
    let found = detection(&truth, &detected, 50);
    assert_eq!((found.n_missed, found.air.n), (1, 3));
    assert!((found.air.minutes - 79.99 / 60.0).abs() < 1e-12);
    assert!((found.air.per_minute.value().unwrap() - 3.0 / (79.99 / 60.0)).abs() < 1e-9);
    let pressed = touches(100, &[(0, 100)]);
    assert_eq!(detection(&pressed, &pressed, 0).air.per_minute, Metric::undefined(Undefined::NoAirTime));
}

#[test]
fn one_detection_over_two_touches_gives_one_onset_and_one_offset() {
    let found = detection(&touches(1000, &[(100, 200), (250, 300)]), &touches(1000, &[(101, 305)]), 0);
    assert_eq!((found.n_missed, found.n_merged, found.n_split, found.air.n), (0, 1, 0, 0));
    let (onset, offset) = (found.onset_ms.unwrap(), found.offset_ms.unwrap());
    assert_eq!((onset.n, onset.mean, offset.n, offset.mean), (1, 10.0, 1, 50.0));
}

#[test]
fn one_touch_seen_as_two_has_the_onset_of_the_first_and_the_offset_of_the_last() {
    let found = detection(&touches(1000, &[(100, 200)]), &touches(1000, &[(102, 140), (150, 198)]), 0);
    assert_eq!((found.n_missed, found.n_merged, found.n_split, found.air.n), (0, 0, 1, 0));
    assert_eq!((found.onset_ms.unwrap().mean, found.offset_ms.unwrap().mean), (20.0, -20.0));
}

#[test]
fn a_detection_that_comes_just_after_a_tap_belongs_to_it_within_the_slack() {
    let (truth, late) = (touches(1000, &[(100, 103)]), touches(1000, &[(106, 110)]));
    assert_eq!(detection(&truth, &late, 0).n_missed, 1);
    let found = detection(&truth, &late, 50);
    assert_eq!((found.n_missed, found.air.n, found.onset_ms.unwrap().mean), (0, 0, 60.0));
}

#[test]
fn what_lies_beyond_the_data_has_no_latency() {
    let truth = touches(300, &[(0, 50), (250, 300)]);
    let found = detection(&truth, &truth, 0);
    assert_eq!((found.n_missed, found.n_onset_unseen, found.n_offset_unseen), (0, 1, 1));
    assert_eq!((found.onset_ms.unwrap().n, found.offset_ms.unwrap().n), (1, 1));
}

#[test]
fn a_gap_ends_a_touch_unseen_and_is_no_time_in_the_air() {
    let stamps: Vec<Stamp> = [0, 10, 20, 1000, 1010, 1020].map(|ms| Stamp(ms * MS)).to_vec();
    let found = Touches::of(&stamps, &[false, true, true, true, false, false], Touching::default()).unwrap();
    assert_eq!((found.all.len(), found.n_gaps, found.touch_ns, found.air_ns), (2, 1, 20 * MS, 20 * MS));
    assert_eq!((found.all[0].offset, found.all[0].offset_seen), (Stamp(20 * MS), false));
    assert_eq!((found.all[1].onset, found.all[1].onset_seen), (Stamp(1000 * MS), false));
}

#[test]
fn chatter_of_the_truth_is_joined_and_blips_are_dropped_and_counted() {
    let rule =
        Touching { join_within: Duration::from_millis(50), at_least: Duration::from_millis(30), ..Touching::default() };
    let found = touches_by(1000, &[(100, 101), (103, 120), (124, 150), (500, 501)], rule);
    assert_eq!((found.all.len(), found.n_too_short), (1, 1));
    assert_eq!((found.all[0].onset, found.all[0].offset), (Stamp(1000 * MS), Stamp(1500 * MS)));
    let mut tally = DetectionTally::new(Duration::ZERO);
    tally.handle_session(&found, &found);
    assert_eq!(tally.detection().n_true_too_short, 1);
}

#[test]
fn sessions_add_up() {
    let mut tally = DetectionTally::new(Duration::ZERO);
    for late in [1, 3] {
        tally.handle_session(&touches(500, &[(100, 200)]), &touches(500, &[(100 + late, 200), (300, 301)]));
    }
    let found = tally.detection();
    assert_eq!((found.n_true, found.air.n, found.onset_ms.unwrap().mean), (2, 2, 20.0));
    assert!((found.air.minutes - 2.0 * 3.99 / 60.0).abs() < 1e-12);
}

#[test]
fn stamps_that_jump_back_are_refused() {
    let stamps = [Stamp(0), Stamp(5), Stamp(5)];
    let error = Touches::of(&stamps, &[false; 3], Touching::default()).unwrap_err();
    assert!(matches!(error, ContactError::Order { idx: 2, .. }), "{error}");
    assert!(matches!(Touches::of(&stamps, &[], Touching::default()), Err(ContactError::Lengths { .. })));
}

#[test]
fn touches_that_the_correction_removes_or_delays_are_counted() {
    let truth = touches(2000, &[(100, 200), (300, 400), (500, 600), (700, 800), (900, 1000)]);
    let base = touches(2000, &[(100, 200), (300, 400), (500, 600), (900, 1000)]);
    let corrected = touches(2000, &[(100, 200), (305, 390), (710, 800), (901, 1000)]);
    let mut tally = PreservationTally::new(Duration::ZERO, Duration::from_millis(10));
    let fates = tally.handle_session(&truth, &base, &corrected);
    let kept = |delay| Fate::Kept { delay_ms: Some(delay) };
    let expected = [kept(0.0), kept(50.0), Fate::Removed, Fate::Gained, kept(10.0)];
    assert_eq!(fates.iter().map(|fate| fate.fate).collect::<Vec<_>>(), expected);
    let found = tally.preservation();
    assert_eq!((found.n_true, found.n_kept, found.n_delayed, found.n_removed, found.n_gained), (5, 3, 1, 1, 1));
    assert_eq!(found.kept, Metric::Value(0.75));
    // Of 4 s that the base was rightly in contact: 50 + 100 ms of the second, 1 s of the third, 10 ms of the last.
    assert!((found.lost_time.value().unwrap() - 1.16 / 4.0).abs() < 1e-12);
    assert_eq!(found.delay_ms.unwrap().max, 50.0);
}

#[test]
fn dropping_a_false_contact_before_a_touch_is_no_delay() {
    let truth = touches(1000, &[(500, 600)]);
    let base = touches(1000, &[(100, 650)]);
    let corrected = touches(1000, &[(502, 600)]);
    let mut tally = PreservationTally::new(Duration::ZERO, Duration::from_millis(10));
    assert_eq!(tally.handle_session(&truth, &base, &corrected)[0].fate, Fate::Kept { delay_ms: Some(20.0) });
    assert_eq!(PreservationTally::default().preservation().kept, Metric::undefined(Undefined::NoTouch));
}

#[test]
fn error_is_told_by_pose_age() {
    let mut tally = PoseAgeTally::default();
    let ages = [Some(0), Some(1), Some(10 * MS), Some(10 * MS + 1), Some(90 * MS), None, Some(0)];
    let estimate = [11.0, 8.0, 14.0, 9.0, 10.0, 20.0, f64::NAN];
    tally.add(&[10.0; 7], &estimate, &ages).unwrap();
    let bins = tally.bins();
    assert_eq!(bins.iter().map(|bin| bin.n).collect::<Vec<_>>(), [1, 2, 1, 0, 0, 1, 1]);
    assert_eq!((bins[1].mae_gf, bins[1].bias_gf), (Metric::Value(3.0), Metric::Value(1.0)));
    assert_eq!(bins[1].age, PoseAge::Held { over_ms: 0.0, to_ms: Some(10.0) });
    assert_eq!(bins[3].mae_gf, Metric::undefined(Undefined::NoFrames));
    assert_eq!(bins[5].age, PoseAge::Held { over_ms: 50.0, to_ms: None });
    assert_eq!((bins[6].age, bins[6].mae_gf), (PoseAge::Unknown, Metric::Value(10.0)));
    assert!(tally.add(&[1.0], &[1.0], &[]).is_err());
    assert!(PoseAgeTally::new(&[Duration::from_millis(5), Duration::from_millis(5)]).is_err());
    assert!(PoseAgeTally::new(&[Duration::ZERO]).is_err());
}

fn zero_load(from_ms: i64, to_ms: i64) -> ZeroLoad {
    ZeroLoad { from: Stamp(from_ms * MS), to: Stamp(to_ms * MS) }
}

#[test]
fn linear_drift_is_removed_exactly_between_the_stretches() {
    let drift = |ms: i64| 3.0 + 0.001 * ms as f64;
    let load = |ms: i64| if (2000..4000).contains(&ms) { 50.0 } else { 0.0 };
    let mut builder = TareBuilder::new(&[zero_load(5000, 6010), zero_load(0, 1010)]).unwrap();
    for ms in (0..7000).step_by(10) {
        // A brief touch in a zero-load stretch doesn't move its median by more than a sample.
        builder.handle_force(Stamp(ms * MS), GramForce(drift(ms) + load(ms)));
    }
    builder.handle_force(Stamp(500 * MS), GramForce(f64::NAN));
    let tare = builder.finish().unwrap();
    assert_eq!(tare.knots().len(), 2);
    assert_eq!((tare.knots()[0].at, tare.knots()[0].n_samples), (Stamp(500 * MS), 101));
    let tared = |ms: i64| tare.tared(Stamp(ms * MS), GramForce(drift(ms) + load(ms))).0;
    for ms in (500..5500).step_by(10) {
        assert!((tared(ms) - load(ms)).abs() < 1e-12, "{ms} ms");
    }
    assert!((tared(0) + 0.5).abs() < 1e-12, "the first tare is held before it");
    assert!((tared(6500) - 1.0).abs() < 1e-12, "the last tare is held after it");
    let mut check = ZeroLoadCheck::default();
    for ms in (5000..6010).step_by(10) {
        check.handle_force(&Scoring::default(), GramForce(tared(ms)));
    }
    assert_eq!((check.n_samples, check.n_touch), (101, 0));
    assert!((check.largest_gf - 0.5).abs() < 1e-12);
}

#[test]
fn the_median_withstands_a_touch_that_was_annotated_as_zero_load() {
    let mut builder = TareBuilder::new(&[zero_load(0, 100)]).unwrap();
    for (ms, force) in [(0, 1.0), (10, 1.0), (20, 900.0), (30, 2.0), (40, 2.0)] {
        builder.handle_force(Stamp(ms * MS), GramForce(force));
    }
    assert_eq!(builder.finish().unwrap().at(Stamp(0)), GramForce(2.0));
}

#[test]
fn annotations_that_cannot_be_are_refused() {
    assert!(matches!(TareBuilder::new(&[zero_load(5, 5)]), Err(TruthError::Backwards { .. })));
    assert!(matches!(TareBuilder::new(&[zero_load(5, 9), zero_load(0, 6)]), Err(TruthError::Overlap { .. })));
    let mut builder = TareBuilder::new(&[zero_load(0, 10), zero_load(10, 20)]).unwrap();
    assert_eq!(builder.clone().finish(), Err(TruthError::NoZeroLoad { n_stretches: 2 }));
    builder.handle_force(Stamp(10 * MS), GramForce(1.0));
    let tare = builder.finish().unwrap();
    assert_eq!((tare.knots().len(), tare.unused()), (1, &[zero_load(0, 10)][..]));
}

fn span(from: i64, to: i64, stage: &str) -> StageSpan<'_> {
    StageSpan { from: Stamp(from), to: Stamp(to), stage }
}

/// The moments at which the part changes, from 0 to `end`.
fn changes(cuts: &Cuts, end: i64) -> Vec<(i64, Option<Part>)> {
    let parts = (0..end).map(|at| (at, cuts.part_at(Stamp(at))));
    let mut last = None;
    parts.filter(|(_, part)| last.replace(*part) != Some(*part)).collect()
}

#[test]
fn each_stage_is_cut_by_itself_and_the_session_as_a_whole_only_when_asked() {
    use Part::{Test, Train, Validation};
    let spans = [span(10, 60, "air"), span(60, 90, "load"), span(100, 120, "load"), span(120, 130, "press")];
    let by_stage = Split::new(SplitBy::Stage, 0.1, 0.2).unwrap().cuts(&spans);
    let air = [(0, None), (10, Some(Train)), (45, Some(Validation)), (50, Some(Test))];
    // 50 of the stage's time, of which 30 lie before the interruption: it is cut 35 and 40 in.
    let load = [(60, Some(Train)), (90, None), (100, Some(Train)), (105, Some(Validation)), (110, Some(Test))];
    let press = [(120, Some(Train)), (127, Some(Validation)), (128, Some(Test)), (130, None)];
    assert_eq!(changes(&by_stage, 140), [&air[..], &load[..], &press[..]].concat());

    let whole = Split::new(SplitBy::Session, 0.0, 0.2).unwrap().cuts(&spans);
    let expected = [(0, None), (10, Some(Train)), (90, None), (100, Some(Train)), (108, Some(Test)), (130, None)];
    assert_eq!(changes(&whole, 140), expected);
}

#[test]
fn shares_that_leave_nothing_are_refused() {
    for share in [1.0, -0.1, f64::NAN] {
        assert!(matches!(Split::new(SplitBy::Stage, 0.0, share), Err(SplitError::Share { part: Part::Test, .. })));
        assert!(matches!(Split::new(SplitBy::Stage, share, 0.2), Err(SplitError::Share { .. })));
    }
    let text = Split::new(SplitBy::Stage, 0.5, 0.5).unwrap_err().to_string();
    assert_eq!(text, "0.5 for the validation and 0.5 for the test leave nothing to train on; expected a sum below 1");
    assert_eq!(Split::default(), Split::new(SplitBy::Stage, 0.0, 0.2).unwrap());
}

#[test]
fn the_validation_of_a_long_stage_is_spread_over_what_is_not_for_the_test() {
    const S: i64 = 1_000_000_000;
    let span = |from: i64, to: i64| StageSpan { from: Stamp(from * S), to: Stamp(to * S), stage: "only" };
    // Interrupted for a minute after 250 s.
    let cuts = Split::new(SplitBy::Stage, 0.1, 0.2).unwrap().cuts(&[span(0, 250), span(310, 560)]);
    let parts = |range: std::ops::Range<i64>| {
        let mut stretches: Vec<(Part, i64)> = Vec::new();
        for part in range.filter_map(|at| cuts.part_at(Stamp(at * S))) {
            match stretches.last_mut() {
                Some((last, n)) if *last == part => *n += 1,
                _ => stretches.push((part, 1)),
            }
        }
        stretches
    };
    let (train, validation) = ((Part::Train, 70), (Part::Validation, 10));
    let all = [train, validation].repeat(5).into_iter().chain([(Part::Test, 100)]).collect::<Vec<_>>();
    assert_eq!(parts(0..560), all);
    assert_eq!(cuts.part_at(Stamp(280 * S)), None, "between the stretches of the stage");
    // What would be shorter than 5 s each is one stretch, right before the test.
    let cuts = Split::new(SplitBy::Stage, 0.1, 0.2).unwrap().cuts(&[span(0, 90)]);
    let at = |at: f64| cuts.part_at(Stamp((at * S as f64) as i64)).unwrap();
    assert_eq!([62.9, 63.1, 71.9, 72.1].map(at), [Part::Train, Part::Validation, Part::Validation, Part::Test]);
}

proptest! {
    #[test]
    fn within_a_stage_nothing_that_trains_comes_after_what_tests(
        lengths in prop::collection::vec((1i64..50, 0usize..3), 1..20),
        validation in 0.0..0.4,
        test in 0.0..0.5,
    ) {
        let mut at = 0;
        let spans: Vec<_> = lengths.iter().map(|&(length, stage)| {
            at += length;
            span(at - length, at, ["air", "load", "press"][stage])
        }).collect();
        let cuts = Split::new(SplitBy::Stage, validation, test).unwrap().cuts(&spans);
        for stage in ["air", "load", "press"] {
            let in_stage = spans.iter().filter(|span| span.stage == stage).flat_map(|span| span.from.0..span.to.0);
            let parts: Vec<Part> = in_stage.map(|at| cuts.part_at(Stamp(at)).unwrap()).collect();
            prop_assert!(parts.is_sorted());
            let n_test = parts.iter().filter(|part| **part == Part::Test).count() as f64;
            prop_assert!((n_test - test * parts.len() as f64).abs() <= 1.0);
        }
    }

    #[test]
    fn every_touch_is_accounted_for(
        truth in prop::collection::vec(any::<bool>(), 80),
        detected in prop::collection::vec(any::<bool>(), 80),
        steps in prop::collection::vec(1i64..80, 80),
        slack_ms in 0u64..60,
    ) {
        let mut now = 0;
        let stamps: Vec<Stamp> = steps.iter().map(|step| { now += step * MS; Stamp(now) }).collect();
        let truth = Touches::of(&stamps, &truth, Touching::default()).unwrap();
        let detected = Touches::of(&stamps, &detected, Touching::default()).unwrap();
        let found = detection(&truth, &detected, slack_ms);
        let n_onsets = found.onset_ms.map_or(0, |onset| onset.n);
        prop_assert_eq!(found.n_true, found.n_missed + found.n_merged + found.n_onset_unseen + n_onsets);
        let n_offsets = found.offset_ms.map_or(0, |offset| offset.n);
        prop_assert!(n_offsets + found.n_offset_unseen <= found.n_true - found.n_missed);
        prop_assert!(found.n_split + found.air.n <= found.n_detected);
        let perfect = detection(&truth, &truth, 0);
        prop_assert_eq!((perfect.n_missed, perfect.air.n), (0, 0));
        prop_assert!(perfect.onset_ms.is_none_or(|onset| onset.min == 0.0 && onset.max == 0.0));
    }
}
