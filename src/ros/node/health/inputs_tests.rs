use super::*;
use crate::fusion::{JointSourceIdx, TactileSourceIdx};

const MS: i64 = 1_000_000;
const NOW: i64 = 1_700_000_000_000_000_000;

fn limits() -> TactileChange<'static> {
    TactileChange { n_taxels: 3, faults: &[], zero: None, n_lost: 0, max_jitter_ms: 5.0, max_behind_ns: 50 * MS }
}

/// The problems reported after a second of taxels at 100 Hz.
fn taxels(stamp: impl Fn(i64) -> i64, values: &[f32], limits: &TactileChange<'_>) -> Vec<Problem> {
    let mut health = InputHealth::new("tactile.glove", "/taxels");
    for k in 0..100 {
        let received = Stamp(NOW + k * 10 * MS);
        health.handle_arrival(Duration::from_millis(k as u64 * 10), Some([1; 16]));
        let block = TactileBlock {
            source: TactileSourceIdx::at(0),
            stamp: Stamp(stamp(k)),
            rows: 1,
            row_period_ns: 0,
            sequence: None,
            values,
            received,
        };
        health.handle_taxels(&block, 0, 3);
    }
    health.judge_taxels(Duration::from_secs(1), limits)
}

fn kinds(problems: &[Problem]) -> Vec<&'static str> {
    problems.iter().map(|problem| problem.kind).collect()
}

const GOOD: [f32; 3] = [1.0, 2.0, 3.0];

#[test]
fn stamps_that_are_no_times_are_told_with_the_parameter() {
    let good = |k: i64| NOW + k * 10 * MS - MS;
    assert_eq!(taxels(good, &GOOD, &limits()), []);
    let (zero, frozen, back) = (|_: i64| 0_i64, |_: i64| NOW, |k: i64| NOW - k * 10 * MS);
    for (stamp, kind) in [(&zero as &dyn Fn(i64) -> i64, "zero"), (&frozen, "frozen"), (&back, "back")] {
        let problems = taxels(stamp, &GOOD, &limits());
        assert_eq!(kinds(&problems), [kind]);
        assert!(problems[0].text.contains("tactile.glove.stamp to receipt"), "{problems:?}");
    }
    for (offset_ns, words) in
        [(-2000 * MS, "2.0 s behind"), (1978 * MS, "2.0 s ahead of"), (-NOW + 1, "19676 days behind")]
    {
        let problems = taxels(|k| good(k) + offset_ns, &GOOD, &limits());
        assert_eq!(kinds(&problems), ["clock"]);
        assert!(problems[0].text.contains(words), "{problems:?}");
    }
}

#[test]
fn taxels_that_are_not_those_of_the_parameters_are_told() {
    let good = |k: i64| NOW + k * 10 * MS - MS;
    let problems = taxels(good, &[1.0, 2.0], &limits());
    assert!(
        problems[0].text.starts_with("100 of 100 messages on /taxels hold 2 taxels, and tactile.glove.n_taxels is 3")
    );
    assert_eq!(kinds(&taxels(good, &[1.0, f32::NAN, 3.0], &limits())), ["non_finite"]);
    let faults = [("rate", "of the core".to_owned())];
    assert_eq!(kinds(&taxels(good, &GOOD, &TactileChange { faults: &faults, ..limits() })), ["rate"]);
    assert_eq!(kinds(&taxels(good, &GOOD, &TactileChange { n_lost: 2, ..limits() })), ["lost"]);
    let zero = TactileChange { zero: Some(&[0.001, 0.002, 0.003]), ..limits() };
    assert_eq!(kinds(&taxels(good, &GOOD, &zero)), ["scale"]);
    let touched = TactileChange { zero: Some(&[0.001, 1.9, 3.0]), ..limits() };
    assert_eq!(taxels(good, &GOOD, &touched), [], "one taxel alone is a touch");
}

#[test]
fn two_publishers_are_told_and_a_straggler_is_none() {
    let mut health = InputHealth::new("tactile.glove", "/taxels");
    (0..10).for_each(|k| health.handle_arrival(Duration::from_millis(k), Some([(k % 2) as u8; 16])));
    assert_eq!(kinds(&health.judge_taxels(Duration::from_secs(1), &limits())), ["publishers"]);
    (0..10).for_each(|k| health.handle_arrival(Duration::from_millis(1000 + k), Some([u8::from(k == 0); 16])));
    let problems = kinds(&health.judge_taxels(Duration::from_secs(2), &limits()));
    assert!(!problems.contains(&"publishers"), "{problems:?}");
    let many = (0..100_u8).map(|k| [k; 16]);
    many.for_each(|gid| health.handle_arrival(Duration::from_secs(3), Some(gid)));
    assert!(health.second.publishers.len() <= MOST_PUBLISHERS);
}

#[test]
fn joints_that_are_not_those_of_the_parameters_are_told() {
    let judged = |names: &[&str], positions: &[f64], missing: &[&str]| {
        let mut health = InputHealth::new("joint.hand", "/joints");
        let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        for k in 0..10 {
            let stamp = Stamp(NOW + k * MS);
            health.handle_arrival(Duration::from_millis(k as u64), None);
            let sample =
                JointSample { source: JointSourceIdx::at(0), stamp, names: &names, positions, received: stamp };
            let needed = names.iter().map(String::as_str).zip(positions.iter().copied());
            health.handle_joints(&sample, 0, needed);
        }
        let limits = JointChange { missing, unit: None, max_behind_ns: 50 * MS };
        health.judge_joints(Duration::from_secs(1), &limits)
    };
    assert_eq!(judged(&["dip", "pip"], &[0.1, 0.2], &[]), []);
    let problems = judged(&["a", "pip"], &[0.1, 0.2], &["dip"]);
    assert!(
        problems[0].text.starts_with("no message has the joints dip; on /joints are a, pip: write your names"),
        "{problems:?}"
    );
    assert_eq!(kinds(&judged(&["dip", "pip"], &[f64::NAN, 0.2], &[])), ["non_finite"]);
    assert_eq!(kinds(&judged(&["dip", "pip"], &[0.1], &[])), ["malformed"]);
}
