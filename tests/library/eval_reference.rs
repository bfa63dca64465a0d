//! The metrics against scikit-learn, scipy and numpy on the same arrays.

use crate::common::skip;

use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};
use skip::python;
use tactile_pose_fusion::eval::*;
use tactile_pose_fusion::units::{GramForce, Stamp};

/// Sums in another order than numpy's, over 10^4 frames.
const TOLERANCE: f64 = 1e-9;

/// Numbers that repeat: Knuth's MMIX generator, its upper half as 0 to 1.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 32) as f64 / f64::from(u32::MAX)
    }

    /// About normal, mean 0, deviation 1.
    fn noise(&mut self) -> f64 {
        (0..12).map(|_| self.next()).sum::<f64>() - 6.0
    }
}

/// Truth and estimate of frames half in the air, the rest from a tap to a press, some frames without a value.
///
/// The estimate is noisy and takes no notice of the first `dead_gf` of a force.
fn frames(numbers: &mut Numbers, n: usize, noise_gf: f64, dead_gf: f64) -> (Vec<f64>, Vec<f64>) {
    let mut frame = || {
        let truth = if numbers.next() < 0.5 { 0.5 * numbers.noise() } else { 2.5 + 300.0 * numbers.next().powi(3) };
        let estimate = (truth - dead_gf).max(0.0) + noise_gf * numbers.noise();
        let missing = numbers.next();
        let or_nan = |missing: bool, force| if missing { f64::NAN } else { force };
        (or_nan(missing < 0.01, truth), or_nan(missing > 0.98, estimate))
    };
    (0..n).map(|_| frame()).unzip()
}

fn run_reference(python: &Path, cases: &Value) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cases.json");
    std::fs::write(&path, cases.to_string()).unwrap();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/python/eval_reference.py");
    let output = Command::new(python).arg(script).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[track_caller]
fn assert_close(what: &str, ours: Option<f64>, reference: &Value) {
    let reference = reference.as_f64();
    match (ours, reference) {
        (Some(ours), Some(reference)) => {
            let error = (ours - reference).abs() / reference.abs().max(1.0);
            assert!(error <= TOLERANCE, "{what}: ours {ours}, reference {reference}");
        }
        _ => assert_eq!(ours, reference, "{what}"),
    }
}

#[test]
fn metrics_and_statistics_agree_with_scikit_learn_and_scipy() {
    let Some(python) = python() else { return };
    let mut numbers = Numbers(20_240_901);
    let forces: Vec<(Vec<f64>, Vec<f64>)> =
        [(10_000, 0.3, 0.0), (10_000, 1.5, 12.0), (10_000, 1.0, 33.0), (10_000, 30.0, 0.0), (300, 1.2, 8.0)]
            .map(|(n, noise_gf, dead_gf)| frames(&mut numbers, n, noise_gf, dead_gf))
            .to_vec();
    let mut differences: Vec<Vec<f64>> = [5, 8, 12].map(|n| (0..n).map(|_| 0.4 + numbers.noise()).collect()).to_vec();
    differences.push(vec![1.0, -1.0, 2.0, 2.0, -2.0, 3.0, 0.0, 3.0, 5.0, 0.0]); // ties and zeros
    differences.push(vec![0.5, 0.5, 0.5, -0.5, 0.5]);
    let stamps: Vec<i64> = (0..3000).map(|k| 1_000_000_000 + k * 10_000_000).collect();
    let mut load_cell = |stamp: i64| {
        if numbers.next() < 0.01 {
            f64::NAN
        } else {
            stamp as f64 * 1e-10 + (stamp as f64 * 3e-10).sin() + 0.3 * numbers.noise()
        }
    };
    let force: Vec<f64> = stamps.iter().map(|&stamp| load_cell(stamp)).collect();
    let zero_load =
        [[2_000_000_000i64, 5_000_000_000], [9_000_000_000, 9_505_000_000], [20_000_000_000, 28_000_000_000]];

    let scores: Vec<Value> =
        forces.iter().map(|(truth, estimate)| json!({"truth": truth, "estimate": estimate})).collect();
    let cases = json!({
        "scores": scores,
        "paired": differences.iter().map(|differences| json!({"differences": differences})).collect::<Vec<_>>(),
        "tared": [{"stamps_ns": stamps, "force": force, "zero_load_ns": zero_load}],
    });
    let answers = run_reference(&python, &cases);

    for (idx, (truth, estimate)) in forces.iter().enumerate() {
        let tally = Tally::of(Scoring::default(), truth, estimate).unwrap();
        let (score, answer) = (tally.score(), &answers["scores"][idx]);
        assert_eq!(Some(score.coverage.n_scored), answer["n_scored"].as_u64());
        assert_close("BA", score.ba.value(), &answer["ba"]);
        assert_close("F1", score.f1.value(), &answer["f1"]);
        assert_close("MAE", score.mae_gf.value(), &answer["mae"]);
        assert_close("R2", score.r2.value(), &answer["r2"]);
        assert_close("MDF", score.mdf.value(), &answer["mdf"]);
        match idx {
            0 => assert!(matches!(score.mdf, Mdf::AlreadyAboveInFirstBin { .. })),
            3 => assert!(matches!(score.mdf, Mdf::NeverReached { .. })),
            _ => assert!(score.mdf.value().is_some(), "{:?}", score.mdf),
        }
        let curve = tally.curve();
        let on_curve: Vec<&ForceBin> = curve.bins.iter().filter(|bin| bin.ba.value().is_some()).collect();
        assert_eq!(Some(on_curve.len()), answer["centres"].as_array().map(Vec::len));
        for (k, bin) in on_curve.into_iter().enumerate() {
            assert_close("centre", Some(bin.centre_gf), &answer["centres"][k]);
            assert_close("BA of a bin", bin.ba.value(), &answer["accuracies"][k]);
            assert_close("MAE of a bin", bin.mae_gf.value(), &answer["errors"][k]);
        }
    }
    for (idx, differences) in differences.iter().enumerate() {
        let (test, answer) = (wilcoxon_greater(differences).unwrap(), &answers["paired"][idx]);
        assert_close("p", Some(test.p), &answer["p"]);
        assert_close("W+", Some(test.w_plus), &answer["w_plus"]);
        if !answer["p_exact"].is_null() {
            assert_close("exact p", Some(test.p), &answer["p_exact"]);
        }
        assert_close("d_z", cohens_dz(differences).value(), &answer["d_z"]);
        let spread = Distribution::of(differences).unwrap();
        for (k, ours) in [spread.p5, spread.p50, spread.p95].into_iter().enumerate() {
            assert_close("percentile", Some(ours), &answer["quantiles"][k]);
        }
    }

    let stretches = zero_load.map(|[from, to]| ZeroLoad { from: Stamp(from), to: Stamp(to) });
    let mut builder = TareBuilder::new(&stretches).unwrap();
    for (&stamp, &force) in stamps.iter().zip(&force) {
        builder.handle_force(Stamp(stamp), GramForce(force));
    }
    let tare = builder.finish().unwrap();
    for (k, (&stamp, &force)) in stamps.iter().zip(&force).enumerate() {
        let tared = tare.tared(Stamp(stamp), GramForce(force)).0;
        assert_close("tared force", (!tared.is_nan()).then_some(tared), &answers["tared"][0]["tared"][k]);
    }
}
