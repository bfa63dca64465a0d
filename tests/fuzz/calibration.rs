//! Calibration files.

use std::collections::BTreeMap;

use tactile_pose_fusion::calibration::Calibration;
use tactile_pose_fusion::fusion::{Baseline, FrameClock, TactileSource, TactileSourceIdx};

use super::common::fake;
use super::driver::{Answer, Target, file_of};
use super::mutate::{self, Random};

pub const TARGET: Target = Target { name: "calibration", seeds, mutate: other, run, min_understood: 0.08 };

const WORDS: [&str; 36] = [
    "format", "glove", "user", "models", "recorded", "sources", "median", "noise", "faulty", "true", "false", ".nan",
    ".inf", "-.inf", "1e39", "1e-50", "-0.0", "null", "~", "[", "]", "{", "}", "-", ":", "&a", "*a", "<<", "!!binary",
    "|", ">", "\"", "'", "---", "0x7f", "\u{0}",
];

fn seeds() -> Vec<Vec<u8>> {
    let path = file_of("calibration_seed.yaml", b"");
    let baseline = |median: Vec<f32>| Baseline { noise: vec![0.5; median.len()], ..Baseline::from_median(median) };
    let sources = [
        BTreeMap::from([("glove".to_owned(), baseline(vec![0.1, -3.0]))]),
        BTreeMap::from([("glove".to_owned(), baseline(vec![1e30, 0.0])), ("palm".to_owned(), baseline(vec![7.0]))]),
    ];
    let text_of = |sources: &BTreeMap<String, Baseline>| {
        let mut calibration = Calibration::new("SN: 1", "anna", "bag, 10.00 s".into(), sources.clone());
        calibration.models.insert("tip".into(), "00ff".into());
        calibration.replace(&path).unwrap();
        std::fs::read(&path).unwrap()
    };
    let mut seeds: Vec<Vec<u8>> = sources.iter().map(text_of).collect();
    // Aliases of aliases: a text that would be billions of values.
    let mut laughs = "a: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n".to_owned();
    for n in 0..12 {
        laughs += &format!("b{n}: &a{} [{}]\n", n + 1, vec![format!("*a{n}"); 9].join(", "));
    }
    seeds.push(laughs.into_bytes());
    seeds
}

fn other(random: &mut Random, seed: &[u8], other: &[u8]) -> Vec<u8> {
    mutate::text(random, seed, other, &WORDS)
}

fn run(input: &[u8]) -> Answer {
    let path = file_of("calibration.yaml", input);
    let source = |name: &str, n_taxels| TactileSource {
        name: name.into(),
        n_taxels,
        stamp_offset_ns: 0,
        inverted: false,
        frame_clock: FrameClock::Tactile,
    };
    let found = match Calibration::load(&path, "SN: 1", "", &[source("glove", 2)]) {
        Ok(found) => found,
        Err(error) => return super::one_line(&error),
    };
    let mut core =
        fake::fusion(fake::config(2, vec![fake::region("index", &[0, 1], &[])]), vec![fake::Sum::boxed(2, 2, 0)]);
    core.handle_baseline(TactileSourceIdx::at(0), found.sources["glove"].clone()).expect("it was checked by load");
    let samples: Vec<_> = (0..4).map(|k| fake::Sample::tactile(10.0 * f64::from(k), &[1.0, 2.0])).collect();
    for (_, estimate) in fake::run(&mut core, &samples) {
        assert!(estimate.force.is_none_or(|force| force.0.is_finite()));
    }
    // What was read is written and read again as it was.
    let again = file_of("calibration_again.yaml", b"");
    found.replace(&again).unwrap();
    let read_again = Calibration::load(&again, "SN: 1", "", &[source("glove", 2)]).expect("we wrote it");
    assert_eq!(format!("{read_again:?}"), format!("{found:?}"));
    Answer::understood(&(found.sources.len(), found.models.len(), found.glove.is_empty(), found.user.is_empty()))
}
