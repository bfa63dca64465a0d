//! Two series of estimates against each other.

use std::convert::Infallible;
use std::time::Duration;

use proptest::prelude::*;
use tactile_pose_fusion::eval::*;
use tactile_pose_fusion::fusion::{ContactEvent, Flags};
use tactile_pose_fusion::units::{Newton, Stamp};

const MS: i64 = 1_000_000;

fn record(region: &str, ms: i64, force: f64) -> EstimateRecord {
    EstimateRecord {
        stamp: Stamp(ms * MS),
        region: region.to_owned(),
        force: Some(force),
        force_base: Some(force + 0.5),
        artifact: Some(0.5),
        wrench: Some([0.0, 0.0, force, 0.0, 0.0, 0.0]),
        contact_raw: force > 0.02,
        contact: force > 0.02,
        event: ContactEvent::None,
        since: Stamp(0),
        flags: Flags::default(),
        pose_age_ns: Some(0),
        age_ns: Some(0),
        on_threshold: Some(0.0245),
        off_threshold: Some(0.02),
        mdf: None,
        adaptation: tactile_pose_fusion::fusion::Adaptation::Off,
        artifact_change: None,
        touch: None,
        touch_on: None,
        touch_off: None,
    }
}

fn series(n: i64) -> Vec<EstimateRecord> {
    (0..n).flat_map(|k| ["index", "thumb"].map(|region| record(region, 10 * k, 1e-3 * k as f64))).collect()
}

fn compare(a: &[EstimateRecord], b: &[EstimateRecord], cfg: DiffConfig) -> Diff {
    let [a, b] = [a, b].map(|records| records.iter().cloned().map(Ok::<_, Infallible>));
    let Ok(diff) = diff(a, b, cfg);
    diff
}

fn bitwise(a: &[EstimateRecord], b: &[EstimateRecord]) -> Diff {
    compare(a, b, DiffConfig::default())
}

fn within(tolerance: f64) -> DiffConfig {
    DiffConfig::new(Newton(tolerance), Duration::from_millis(500), 4096).unwrap()
}

fn field(region: &RegionDiff, field: Field) -> &FieldDiff {
    region.fields.iter().find(|diff| diff.field == field).unwrap()
}

#[test]
fn a_series_is_the_same_as_itself() {
    let diff = bitwise(&series(100), &series(100));
    assert!(diff.is_same());
    assert_eq!((diff.n_matched(), diff.regions.len()), (200, 2));
    assert!(diff.regions["index"].fields.iter().all(|field| field.n_compared == 100 && field.largest.is_none()));
}

#[test]
fn the_first_and_the_largest_difference_are_named() {
    let mut b = series(100);
    b[2 * 30].force = Some(0.030 + 1e-6);
    b[2 * 40].force = Some(0.040 - 1e-3);
    b[2 * 50].force = Some(0.050 + 1e-7);
    let exact = bitwise(&series(100), &b);
    let force = field(&exact.regions["index"], Field::Force);
    assert_eq!((force.n_compared, force.n_different, force.n_one_missing), (100, 3, 0));
    let first = force.first.as_ref().unwrap();
    assert_eq!(first.at, Moment { epoch: 0, stamp_ns: 300 * MS });
    assert_eq!((&first.a, &first.b), (&FieldValue::Force(0.030), &FieldValue::Force(0.030 + 1e-6)));
    let largest = force.largest.as_ref().unwrap();
    assert_eq!(largest.at.stamp_ns, 400 * MS);
    assert!((largest.distance.unwrap() - 1e-3).abs() < 1e-12);
    assert!(exact.regions["thumb"].is_same());

    let tolerant = compare(&series(100), &b, within(1e-5));
    let force = field(&tolerant.regions["index"], Field::Force);
    assert_eq!((force.n_different, force.first.as_ref().unwrap().at.stamp_ns), (1, 400 * MS));
    let all = compare(&series(100), &b, within(1e-2));
    assert!(all.is_same());
    assert!(field(&all.regions["index"], Field::Force).largest.is_some(), "the largest is told within tolerance too");
}

#[test]
fn what_is_not_a_force_is_compared_exactly() {
    let mut b = series(10);
    b[2].flags = Flags::STALE_POSE;
    b[2].event = ContactEvent::Onset;
    b[4].since = Stamp(5);
    b[4].pose_age_ns = None;
    b[6].contact = true;
    let diff = compare(&series(10), &b, within(1e9));
    let region = &diff.regions["index"];
    let differing: Vec<Field> = region.fields.iter().filter(|f| f.n_different > 0).map(|f| f.field).collect();
    assert_eq!(differing, [Field::Contact, Field::Event, Field::Since, Field::Flags, Field::PoseAge]);
    assert_eq!(field(region, Field::PoseAge).n_one_missing, 1);
    assert_eq!(field(region, Field::Since).largest.as_ref().unwrap().distance, Some(5.0));
    let event = serde_json::to_value(field(region, Field::Event).first.as_ref().unwrap()).unwrap();
    let expected = serde_json::json!({"epoch": 0, "stamp_ns": 10 * MS, "a": "none", "b": "onset", "distance": null});
    assert_eq!(event, expected);
}

#[test]
fn no_value_equals_no_value_and_nothing_else() {
    let (mut a, mut b) = (series(4), series(4));
    (a[0].force, b[0].force) = (Some(f64::NAN), Some(-f64::NAN));
    (a[2].force, b[2].force) = (None, Some(f64::NAN));
    (a[4].force, b[4].force) = (Some(f64::INFINITY), Some(f64::INFINITY));
    for cfg in [DiffConfig::default(), within(1e-3)] {
        assert!(compare(&a, &b, cfg).is_same());
    }
    b[6].force = None;
    let diff = compare(&a, &b, within(1e9));
    let force = field(&diff.regions["index"], Field::Force);
    assert_eq!((force.n_different, force.n_one_missing), (1, 1));
    assert_eq!(force.first.as_ref().unwrap().b, FieldValue::Missing);
}

#[test]
fn wrenches_are_compared_by_component_and_their_farthest_one_is_told() {
    let (mut a, mut b) = (series(2), series(2));
    a[0].wrench = Some([0.0, 1.0, 2.0, 0.0, f64::NAN, 0.0]);
    b[0].wrench = Some([0.1, 1.0, 1.5, 0.0, f64::NAN, 0.0]);
    let diff = compare(&a, &b, within(0.2));
    let wrench = field(&diff.regions["index"], Field::Wrench);
    assert_eq!((wrench.n_different, wrench.largest.as_ref().unwrap().distance), (1, Some(0.5)));
    assert!(compare(&a, &b, within(0.5)).is_same(), "NaN equals NaN here too");
    assert!(bitwise(&a, &a).is_same());
    b[0].wrench = None;
    assert_eq!(field(&compare(&a, &b, within(1e9)).regions["index"], Field::Wrench).n_one_missing, 1);
}

#[test]
fn bit_by_bit_tells_the_zeros_apart_and_a_tolerance_does_not() {
    let (mut a, mut b) = (series(1), series(1));
    (a[0].artifact, b[0].artifact) = (Some(0.0), Some(-0.0));
    assert!(!bitwise(&a, &b).is_same());
    assert!(compare(&a, &b, within(1e-300)).is_same());
}

#[test]
fn records_of_one_side_alone_are_told() {
    let a = series(100);
    let mut b = series(100);
    b.retain(|record| !(300..320).contains(&(record.stamp.0 / MS)));
    b.retain(|record| record.region != "thumb");
    b.push(record("palm", 2000, 0.0));
    let diff = bitwise(&a, &b);
    let index = diff.regions["index"].only_in_a;
    assert_eq!((index.n, index.first.unwrap().stamp_ns, index.last.unwrap().stamp_ns), (2, 300 * MS, 310 * MS));
    assert_eq!((diff.regions["index"].n_matched, diff.regions["index"].only_in_b.n), (98, 0));
    assert_eq!((diff.regions["thumb"].only_in_a.n, diff.regions["thumb"].n_matched), (100, 0));
    assert_eq!(diff.regions["palm"].only_in_b.n, 1);
    assert!(!diff.is_same());
}

#[test]
fn a_looped_bag_is_compared_round_by_round() {
    let mut a = series(100);
    a.extend(series(100));
    let mut b = a.clone();
    b[200 + 2 * 7].force = Some(9.0);
    let diff = bitwise(&a, &b);
    let region = &diff.regions["index"];
    assert_eq!((region.n_matched, region.jumps_a, region.jumps_b), (200, 1, 1));
    let first = field(region, Field::Force).first.as_ref().unwrap();
    assert_eq!(first.at, Moment { epoch: 1, stamp_ns: 70 * MS });
    let once = bitwise(&a, &series(100));
    assert_eq!((once.regions["index"].only_in_a.n, once.regions["index"].only_in_a.first.unwrap().epoch), (100, 1));
}

#[test]
fn a_late_record_is_no_new_epoch_and_repeated_stamps_match_in_order() {
    let a = series(100);
    let mut b = series(100);
    b.swap(20, 30); // index at 100 and 150 ms
    let diff = bitwise(&a, &b);
    assert!(diff.is_same());
    assert_eq!(diff.regions["index"].jumps_b, 0);
    let twice = [record("index", 0, 1.0), record("index", 0, 2.0)];
    assert!(bitwise(&twice, &twice).is_same());
    let once = bitwise(&twice, &twice[..1]);
    assert_eq!((once.regions["index"].n_matched, once.regions["index"].only_in_a.n), (1, 1));
}

#[test]
fn what_waits_is_bounded_and_giving_up_is_told() {
    let a: Vec<_> = (0..1000).map(|k| record("index", 10 * k, 0.0)).collect();
    let b: Vec<_> = (0..1000).map(|k| record("thumb", 10 * k, 0.0)).collect();
    let cfg = DiffConfig::new(Newton(0.0), Duration::from_millis(500), 16).unwrap();
    let diff = compare(&a, &b, cfg);
    assert_eq!((diff.regions["index"].only_in_a.n, diff.regions["index"].n_gave_up), (1000, 984));
}

#[test]
fn an_error_of_either_side_ends_the_comparison() {
    let broken = vec![Ok(record("index", 0, 0.0)), Err("cut off")];
    let whole: Vec<Result<_, &str>> = series(3).into_iter().map(Ok).collect();
    assert_eq!(diff(whole.clone(), broken.clone(), DiffConfig::default()), Err("cut off"));
    assert_eq!(diff(broken, whole, DiffConfig::default()), Err("cut off"));
    assert!(DiffConfig::new(Newton(-1.0), Duration::ZERO, 1).is_err());
    assert!(DiffConfig::new(Newton(0.0), Duration::ZERO, 0).is_err());
}

proptest! {
    #[test]
    fn every_record_is_matched_or_alone_and_sides_are_alike(
        a in prop::collection::vec((0i64..60, 0usize..2, 0u8..3), 0..80),
        b in prop::collection::vec((0i64..60, 0usize..2, 0u8..3), 0..80),
    ) {
        let records = |specs: &[(i64, usize, u8)]| -> Vec<EstimateRecord> {
            let regions = ["index", "thumb"];
            specs.iter().map(|&(k, region, force)| record(regions[region], 50 * k, f64::from(force))).collect()
        };
        let (a, b) = (records(&a), records(&b));
        let (forth, back) = (bitwise(&a, &b), bitwise(&b, &a));
        let mut n = 0;
        for (name, region) in &forth.regions {
            prop_assert_eq!(region.n_a, region.n_matched + region.only_in_a.n);
            prop_assert_eq!(region.n_b, region.n_matched + region.only_in_b.n);
            n += region.n_a + region.n_b;
            prop_assert_eq!(region.n_a, back.regions[name].n_b);
        }
        prop_assert_eq!(n as usize, a.len() + b.len());
        prop_assert!(bitwise(&a, &a).is_same());
    }

    #[test]
    fn extreme_stamps_do_not_overflow(stamps in prop::collection::vec(any::<i64>(), 0..30)) {
        let records: Vec<_> =
            stamps.iter().map(|&stamp| EstimateRecord { stamp: Stamp(stamp), ..record("index", 0, 0.0) }).collect();
        prop_assert!(bitwise(&records, &records).is_same());
    }
}
