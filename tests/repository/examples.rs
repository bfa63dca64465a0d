//! The programs of `examples/` do what they say.

use crate::common;

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use common::ROOT;
use common::tpf::tpf;

/// Runs an example, which `cargo test` has built beside this test; what it printed.
fn example(name: &str, args: &[&Path], stdin: &str) -> String {
    let program = std::env::current_exe().unwrap();
    let program = program.ancestors().nth(2).unwrap().join("examples").join(name);
    let mut example = Command::new(&program);
    example.args(args).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut example = example.spawn().unwrap_or_else(|error| panic!("{}: {error}", program.display()));
    example.stdin.take().unwrap().write_all(stdin.as_bytes()).unwrap();
    let output = example.wait_with_output().unwrap();
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn shipped(file: &str) -> std::path::PathBuf {
    Path::new(ROOT).join(file)
}

#[test]
fn samples_of_your_own_become_forces() {
    // Seconds at rest, then taxels rise and nothing bends.
    let sample = |number: usize| {
        let pressed = if number < 330 { 0.0 } else { 600.0 };
        let taxels =
            (0..6).map(|taxel| format!("{}", 300.0 + pressed + f64::from((number * 7 + taxel * 3) as u32 % 5)));
        let taxels = taxels.collect::<Vec<_>>().join(",");
        format!("{:.2},{taxels},0.2,0.4,0.3,0.0\n", number as f64 / 100.0)
    };
    let samples: String = (0..500).map(sample).collect();
    let text = example("own_samples", &[&shipped("params/glove3.yaml")], &samples);
    let forces: Vec<(f64, f64)> = text
        .lines()
        .filter_map(|line| {
            let mut cells = line.split(',').map(str::parse::<f64>);
            Some((cells.next()?.ok()?, cells.next()?.ok()?))
        })
        .collect();
    let mean = |from: f64, to: f64| {
        let within: Vec<f64> =
            forces.iter().filter(|(t, f)| (from..to).contains(t) && f.is_finite()).map(|p| p.1).collect();
        assert!(within.len() > 10, "{text}");
        within.iter().sum::<f64>() / within.len() as f64
    };
    let (at_rest, pressed) = (mean(2.8, 3.2), mean(4.0, 5.0));
    assert!(at_rest.abs() < 0.05 && pressed > at_rest + 0.1, "{at_rest} N, then {pressed} N");
}

#[test]
fn the_touches_of_a_bag_and_the_scores_of_two_models_are_told() {
    let folder = tempfile::tempdir().unwrap();
    tpf(
        folder.path(),
        &[
            "simulate",
            "--glove",
            "3",
            "--users",
            "1",
            "--sessions",
            "1",
            "--seed",
            "1",
            "--minutes",
            "1.7",
            "-o",
            "bags",
        ],
    )
    .ok();
    let bag = folder.path().join("bags/glove3_user01_session1");
    let params = shipped("params/glove3.yaml");

    let touches = example("touches_of_a_bag", &[&params, &bag], "");
    let peaks: Vec<f64> = touches.lines().map(|line| line.rsplit(',').next().unwrap().parse().unwrap()).collect();
    assert!(peaks.len() > 5 && peaks.iter().all(|peak| *peak > 0.01 && *peak < 100.0), "{touches}");
    assert!(touches.lines().all(|line| line.starts_with("index,")), "{touches}");

    let models = ["models/glove3_tactile_only.onnx", "models/glove3_pose_aware.onnx"].map(shipped);
    let scores = example("compare_models", &[&params, &models[0], &models[1], &bag], "");
    assert!(scores.starts_with("every frame, 1 sessions, SYNTHETIC\n"), "{scores}");
    for model in ["glove3_tactile_only on glove 3: BA 0.", "glove3_pose_aware on glove 3: BA 0."] {
        assert!(scores.contains(model), "{scores}");
    }
}
