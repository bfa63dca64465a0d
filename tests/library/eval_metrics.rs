//! The paper's metrics, worked out by hand and by their properties.

use proptest::prelude::*;
use tactile_pose_fusion::eval::*;
use tactile_pose_fusion::units::GramForce;

fn score(truth: &[f64], estimate: &[f64]) -> Score {
    Tally::of(Scoring::default(), truth, estimate).unwrap().score()
}

/// `n` frames of a true force, `n_right` of them estimated right and the rest at 0, or 50 where there is no touch.
fn frames(force: f64, n: usize, n_right: usize) -> Vec<(f64, f64)> {
    let wrong = if force >= 2.5 { 0.0 } else { 50.0 };
    (0..n).map(|k| (force, if k < n_right { force } else { wrong })).collect()
}

fn tally(scoring: Scoring, groups: &[Vec<(f64, f64)>]) -> Tally {
    let (truth, estimate): (Vec<f64>, Vec<f64>) = groups.concat().into_iter().unzip();
    Tally::of(scoring, &truth, &estimate).unwrap()
}

#[test]
fn balanced_accuracy_and_f1_by_hand() {
    // Touch: 3 of 4 detected. No touch: 1 of 6 false. 2.5 itself is touch.
    let truth = [2.5, 30.0, 40.0, 2.6, 0.0, -1.0, 2.4, 0.3, 0.0, 1.0];
    let estimate = [2.5, 20.0, 2.49, 9.0, 0.0, 0.0, 2.5, 1.0, 2.0, 0.0];
    let score = score(&truth, &estimate);
    assert_eq!(score.confusion, Confusion { true_touch: 3, missed_touch: 1, false_touch: 1, true_no_touch: 5 });
    assert_eq!(score.ba, Metric::Value((3.0 / 4.0 + 5.0 / 6.0) / 2.0));
    assert_eq!(score.f1, Metric::Value(6.0 / 8.0));
}

#[test]
fn error_and_determination_by_hand() {
    let score = score(&[0.0, 10.0, 20.0], &[1.0, 10.0, 17.0]);
    assert_eq!(score.mae_gf, Metric::Value(4.0 / 3.0));
    assert!((score.r2.value().unwrap() - 0.95).abs() < 1e-15); // 1 - (1 + 9) / 200
}

#[test]
fn minimal_detectable_force_by_hand() {
    // TNR 9/10. BA of the bins: .575, .7, .85, .95. 90 % lies half-way between the centres 25 and 35.
    let tally = tally(
        Scoring::default(),
        &[frames(0.0, 10, 9), frames(5.0, 4, 1), frames(12.0, 4, 2), frames(20.0, 5, 4), frames(39.9, 4, 4)],
    );
    let curve = tally.curve();
    let centres: Vec<f64> = curve.bins.iter().map(|bin| bin.centre_gf).collect();
    assert_eq!(centres, [6.25, 15.0, 25.0, 35.0]);
    let points: Vec<f64> = curve.points().map(|(_, ba)| ba).collect();
    for (got, expected) in points.iter().zip([0.575, 0.7, 0.85, 0.95]) {
        assert!((got - expected).abs() < 1e-15);
    }
    let Mdf::Crossed { force_gf, below_gf, above_gf } = tally.score().mdf else { panic!("{:?}", tally.score().mdf) };
    assert!((force_gf - 30.0).abs() < 1e-12);
    assert_eq!((below_gf, above_gf), (25.0, 35.0));
    assert_eq!(curve.bins[0].mae_gf, Metric::Value(3.75)); // three of four miss 5 gF
    assert_eq!(curve.no_touch.mae_gf, Metric::Value(5.0)); // one of ten reads 50 gF
}

#[test]
fn only_the_first_crossing_counts() {
    let groups = [frames(0.0, 5, 5), frames(5.0, 10, 0), frames(15.0, 1, 1), frames(25.0, 2, 0), frames(35.0, 1, 1)];
    let Mdf::Crossed { above_gf, .. } = tally(Scoring::default(), &groups).score().mdf else { panic!() };
    assert_eq!(above_gf, 15.0);
}

#[test]
fn a_curve_that_does_not_cross_gives_no_number() {
    let air = frames(0.0, 5, 5);
    let above = tally(Scoring::default(), &[air.clone(), frames(5.0, 3, 3), frames(15.0, 3, 0)]).score().mdf;
    assert_eq!(above, Mdf::AlreadyAboveInFirstBin { centre_gf: 6.25, ba: 1.0 });
    let never = tally(Scoring::default(), &[air.clone(), frames(5.0, 4, 0), frames(15.0, 4, 2), frames(25.0, 4, 1)]);
    assert_eq!(never.score().mdf, Mdf::NeverReached { highest_ba: 0.75, at_gf: 15.0 });
    for mdf in [above, never.score().mdf] {
        assert_eq!(mdf.value(), None);
    }
    assert_eq!(above.to_string(), "<= 6.25");
    assert_eq!(never.score().mdf.to_string(), "not reached");
    assert_eq!(tally(Scoring::default(), &[air]).score().mdf, Mdf::Undefined { undefined: Undefined::NoTouch });
    let loaded = tally(Scoring::default(), &[frames(5.0, 3, 3)]).score().mdf;
    assert_eq!(loaded, Mdf::Undefined { undefined: Undefined::NoNoTouch });
}

#[test]
fn empty_and_thin_bins_are_shown_and_stepped_over() {
    let groups = [frames(0.0, 4, 4), frames(5.0, 10, 0), frames(15.0, 1, 1), frames(45.0, 10, 10)];
    let strict = Scoring::new(GramForce(2.5), GramForce(10.0), 2, MissingEstimate::Excluded).unwrap();
    let curve = tally(strict, &groups).curve();
    assert_eq!(curve.bins.iter().map(|bin| bin.n).collect::<Vec<_>>(), [10, 1, 0, 0, 10]);
    for thin in &curve.bins[1..4] {
        assert_eq!(thin.ba, Metric::undefined(Undefined::TooFewFrames));
    }
    // From (6.25, 0.5) straight to (45, 1).
    let Mdf::Crossed { force_gf, .. } = curve.mdf() else { panic!() };
    assert!((force_gf - (6.25 + 0.8 * 38.75)).abs() < 1e-12);
    let lenient = tally(Scoring::default(), &groups).curve();
    assert_eq!(lenient.bins[2].tpr, Metric::undefined(Undefined::TooFewFrames), "an empty bin is never on the curve");
    let Mdf::Crossed { above_gf, .. } = lenient.mdf() else { panic!() };
    assert_eq!(above_gf, 15.0);
}

#[test]
fn what_is_not_there_is_said() {
    let air = score(&[0.0, 1.0], &[0.0, 1.0]);
    assert_eq!(air.ba, Metric::undefined(Undefined::NoTouch));
    assert_eq!(air.f1, Metric::undefined(Undefined::NoTouch));
    let loaded = score(&[50.0, 50.0], &[50.0, 40.0]);
    assert_eq!(loaded.ba, Metric::undefined(Undefined::NoNoTouch));
    assert_eq!(loaded.r2, Metric::undefined(Undefined::NoVariance));
    assert_eq!(loaded.mae_gf, Metric::Value(5.0));
    let nothing = score(&[], &[]);
    assert_eq!(nothing.mae_gf, Metric::undefined(Undefined::NoFrames));
    assert_eq!(nothing.r2, Metric::undefined(Undefined::NoFrames));
    let huge = score(&[1e300, 0.0, -1e308], &[-1e300, 0.0, 1e308]);
    assert_eq!(huge.r2, Metric::undefined(Undefined::Overflow));
    let error = Tally::of(Scoring::default(), &[1.0], &[]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "estimate has 0 frames and truth has 1; align them frame by frame, NaN where there is none"
    );
}

#[test]
fn frames_without_an_estimate_are_counted_and_enter_touch_only_when_asked() {
    let truth = [50.0, 50.0, 0.0, 0.0, f64::NAN];
    let estimate = [50.0, f64::NAN, 0.0, f64::INFINITY, 1.0];
    let excluded = Tally::of(Scoring::default(), &truth, &estimate).unwrap().score();
    let expected =
        Coverage { n_frames: 5, n_scored: 2, n_without_truth: 1, n_without_estimate: 2, n_touch_without_estimate: 1 };
    assert_eq!(excluded.coverage, expected);
    assert_eq!(excluded.ba, Metric::Value(1.0));
    let strict = Scoring::new(TOUCH, BIN_WIDTH, 1, MissingEstimate::NoTouch).unwrap();
    let counted = Tally::of(strict, &truth, &estimate).unwrap();
    assert_eq!(counted.score().coverage, expected);
    assert_eq!(counted.confusion(), Confusion { true_touch: 1, missed_touch: 1, false_touch: 0, true_no_touch: 2 });
    assert_eq!(counted.score().mae_gf, Metric::Value(0.0), "a force that isn't there has no error");
    let in_bin = counted.curve().bins[5];
    assert_eq!((in_bin.n, in_bin.n_without_estimate, in_bin.tpr), (1, 1, Metric::Value(0.5)));
}

#[test]
fn a_force_past_every_bin_is_scored_and_said_to_be_off_the_curve() {
    let tally = tally(Scoring::default(), &[frames(0.0, 1, 1), frames(1e9, 1, 1)]);
    assert_eq!((tally.curve().bins.len(), tally.curve().n_beyond_bins), (0, 1));
    assert_eq!(tally.score().ba, Metric::Value(1.0));
}

#[test]
fn tallies_of_other_rules_do_not_merge() {
    let other = Scoring::new(GramForce(5.0), BIN_WIDTH, 1, MissingEstimate::Excluded).unwrap();
    assert!(Tally::new(other).merge(&Tally::default()).is_err());
    for refused in [
        Scoring::new(GramForce(f64::NAN), BIN_WIDTH, 1, MissingEstimate::Excluded),
        Scoring::new(TOUCH, GramForce(0.0), 1, MissingEstimate::Excluded),
        Scoring::new(TOUCH, BIN_WIDTH, 0, MissingEstimate::Excluded),
    ] {
        assert!(refused.is_err());
    }
}

#[test]
fn a_score_reads_back_from_json_with_its_reasons() {
    let score = score(&[0.0, 1.0, 0.0], &[0.0, 5.0, 0.0]);
    let json = serde_json::to_value(&score).unwrap();
    assert_eq!(json["ba"], serde_json::json!({"undefined": "no_touch"}));
    assert_eq!(serde_json::from_value::<Score>(json).unwrap(), score);
}

/// Forces as the protocol has them: air, light touch, press, and frames without a value.
fn force() -> impl Strategy<Value = f64> {
    prop_oneof![-2.0..2.5, 2.5..60.0, 60.0..1000.0, Just(2.5), Just(10.0), Just(f64::NAN)]
}

proptest! {
    #[test]
    fn order_and_partition_do_not_matter(
        frames in prop::collection::vec((force(), force()), 0..200),
        rotation in 0usize..200,
        cut in 0usize..200,
    ) {
        let (truth, estimate): (Vec<f64>, Vec<f64>) = frames.iter().copied().unzip();
        let whole = Tally::of(Scoring::default(), &truth, &estimate).unwrap().score();
        let mut moved = frames.clone();
        moved.rotate_left(rotation.min(frames.len()));
        moved.reverse();
        let (truth, estimate): (Vec<f64>, Vec<f64>) = moved.into_iter().unzip();
        let cut = cut.min(truth.len());
        let mut parts = Tally::of(Scoring::default(), &truth[..cut], &estimate[..cut]).unwrap();
        parts.merge(&Tally::of(Scoring::default(), &truth[cut..], &estimate[cut..]).unwrap()).unwrap();
        let parts = parts.score();
        // What is counted is equal; sums differ by the rounding of another order.
        prop_assert_eq!(&parts.coverage, &whole.coverage);
        prop_assert_eq!(&parts.confusion, &whole.confusion);
        prop_assert_eq!(parts.mdf, whole.mdf);
        for (a, b) in [(parts.mae_gf, whole.mae_gf), (parts.r2, whole.r2)] {
            match (a.value(), b.value()) {
                (Some(a), Some(b)) => prop_assert!((a - b).abs() <= 1e-9 * a.abs().max(1.0)),
                (a, b) => prop_assert_eq!(a, b),
            }
        }
    }

    #[test]
    fn a_perfect_estimate_is_perfect(truth in prop::collection::vec(force(), 1..200)) {
        let score = score(&truth, &truth);
        for metric in [score.ba, score.f1, score.r2] {
            prop_assert!(metric.value().is_none_or(|value| value == 1.0));
        }
        prop_assert!(score.mae_gf.value().is_none_or(|value| value == 0.0));
        let as_good_as_can_be = matches!(score.mdf, Mdf::AlreadyAboveInFirstBin { .. } | Mdf::Undefined { .. });
        prop_assert!(as_good_as_can_be, "{:?}", score.mdf);
    }

    #[test]
    fn whatever_comes_every_number_is_finite(frames in prop::collection::vec((any::<f64>(), any::<f64>()), 0..50)) {
        let (truth, estimate): (Vec<f64>, Vec<f64>) = frames.into_iter().unzip();
        let tally = Tally::of(Scoring::default(), &truth, &estimate).unwrap();
        let score = tally.score();
        for metric in [score.ba, score.f1, score.mae_gf, score.r2] {
            prop_assert!(metric.value().is_none_or(f64::is_finite));
        }
        prop_assert!(score.mdf.value().is_none_or(f64::is_finite));
        prop_assert_eq!(score.coverage.n_frames as usize, truth.len());
    }
}
