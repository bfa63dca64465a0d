//! Compares the network, its losses and their gradients with PyTorch's, in float64.

use burn::tensor::Device;
use serde_json::Value;

use super::architecture::{Architecture, Kind};
use super::dataset::{Batch, smoothed_change};
use super::loss::{LossConfig, Measure};
use super::network::{Network, Normalize, values};
use super::trainer::{Given, TrainConfig, run_shard, track};
use crate::fusion::Windows;

const WINDOW: usize = 64;
const TAXELS: usize = 6;
const JOINTS: usize = 4;
const N: usize = 5;
const TACTILE_SCALE: f32 = 0.5;
const LAMBDA: f32 = 0.7;

/// float32 over up to 64 frames and 192 inputs, against float64: an error of a few 1e-7 in each step.
const FORWARD_TOLERANCE: f64 = 3e-6;

/// Gradients pass through twice as many steps, and are summed over windows and frames.
const GRADIENT_TOLERANCE: f64 = 3e-5;

/// The generator of `tests/python/train_reference.py`.
struct Lcg(u64);

impl Lcg {
    fn symmetric(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (2.0 * ((self.0 >> 40) as f64 / f64::from(1u32 << 24)) - 1.0) as f32
    }

    fn values(&mut self, n: usize) -> Vec<f32> {
        (0..n).map(|_| self.symmetric()).collect()
    }
}

struct Reference {
    network: Network,
    batch: Batch,
    expected: Value,
    lcg: Lcg,
}

fn reference() -> Reference {
    let text = include_str!("../../tests/data/train_reference.json");
    let expected: Value = serde_json::from_str(text).unwrap();
    let architecture = Architecture {
        kind: Kind::PoseAware,
        window: WINDOW,
        n_taxels: TAXELS,
        n_joints: JOINTS,
        tactile_scale: TACTILE_SCALE,
        force_scale: 100.0,
        touch_scale: 1.0,
        axes: None,
    };
    let mut network = Network::new(architecture, 0).unwrap();
    let mut lcg = Lcg(7);
    for parameter in network.architecture.parameters() {
        let norm = parameter.name.contains(".norm.");
        for value in &mut network.values[parameter.range()] {
            let random = lcg.symmetric();
            *value = match (norm, parameter.name.ends_with("weight")) {
                (true, true) => (0.25 * f64::from(random) + 1.0) as f32,
                (true, false) => 0.25 * random,
                (false, _) => 0.125 * random,
            };
        }
    }
    let tactile = lcg.values(N * WINDOW * TAXELS);
    let pose = lcg.values(N * WINDOW * JOINTS);
    let zero_load = vec![true, false, true, false, false];
    let mut artifact = vec![0.0; N * WINDOW * TAXELS];
    for (window, values) in tactile.chunks_exact(WINDOW * TAXELS).enumerate().filter(|(window, _)| zero_load[*window]) {
        for (frame, row) in smoothed_change(values, TAXELS, 2.0).chunks_exact(TAXELS).enumerate() {
            artifact[(frame * N + window) * TAXELS..][..TAXELS].copy_from_slice(row);
        }
    }
    let truth_gf = floats(&expected["truth"]).iter().map(|value| *value as f32).collect();
    Reference {
        network,
        batch: Batch { n: N, tactile, pose, truth_gf, tangential_gf: Vec::new(), zero_load, artifact },
        expected,
        lcg,
    }
}

fn floats(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
}

#[track_caller]
fn assert_close(what: &str, got: &[f32], expected: &[f64], tolerance: f64) {
    assert_eq!(got.len(), expected.len(), "{what}");
    let scale = expected.iter().fold(0.0, |scale: f64, value| scale.max(value.abs()));
    let worst = got.iter().zip(expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
    assert!(worst <= tolerance * scale, "{what}: {worst:e} of {scale:e}");
}

/// Compares a tensor with the first values, the norm and a random projection of the expected one.
#[track_caller]
fn assert_summary(what: &str, got: &[f32], expected: &Value, probe: &[f32], tolerance: f64) {
    let norm = expected["norm"].as_f64().unwrap();
    let first = floats(&expected["first"]);
    let got_norm = got.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>().sqrt();
    assert!((got_norm - norm).abs() <= tolerance * norm, "norm of {what}: {got_norm}, expected {norm}");
    let dot: f64 = got.iter().zip(probe).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
    let expected_dot = expected["dot"].as_f64().unwrap();
    assert!(
        (dot - expected_dot).abs() <= 3.0 * tolerance * norm,
        "projection of {what}: {dot}, expected {expected_dot}"
    );
    for (got, expected) in got.iter().zip(first) {
        assert!((f64::from(*got) - expected).abs() <= tolerance * norm, "{what}: {got}, expected {expected}");
    }
}

fn given(reference: &Reference) -> Given {
    let cfg = TrainConfig {
        loss: LossConfig { base_weight: 1.0, lambda: LAMBDA, offset_gf: 1.0, ..LossConfig::default() },
        ..TrainConfig::default()
    };
    let measure = Measure { truths: N, zero_load: 2, tactile_scale: TACTILE_SCALE };
    run_shard(&reference.network, &reference.batch, &cfg, measure, &Device::flex().autodiff())
}

#[test]
fn the_training_pass_is_pytorchs() {
    let mut reference = reference();
    let weights = reference.network.on(&Device::flex());
    let input = weights.input(N, reference.batch.tactile.clone(), reference.batch.pose.clone());
    let output = weights.forward(input, Normalize::ByBatch);
    let expected = &reference.expected;
    assert_close("force", &values(output.force), &floats(&expected["force"]), FORWARD_TOLERANCE);
    assert_close("base", &values(output.base.unwrap()), &floats(&expected["base"]), FORWARD_TOLERANCE);
    let artifact = values(output.artifact.unwrap());
    let probe = reference.lcg.values(artifact.len());
    assert_summary("artifact", &artifact, &expected["artifact"], &probe, FORWARD_TOLERANCE);
}

#[test]
fn losses_gradients_and_statistics_are_pytorchs() {
    let mut reference = reference();
    let given = given(&reference);
    let loss = &reference.expected["loss"];
    for (what, got) in [
        ("force", given.loss.force),
        ("base", given.loss.base),
        ("artifact", given.loss.artifact),
        ("total", given.loss.total),
    ] {
        assert_close(what, &[got], &[loss[what].as_f64().unwrap()], FORWARD_TOLERANCE);
    }
    reference.lcg.values(N * WINDOW * TAXELS); // the probe of the artifact comes first
    for parameter in reference.network.architecture.parameters() {
        let probe = reference.lcg.values(parameter.n_values());
        let expected = &reference.expected["gradients"][&parameter.name];
        let gradient = &given.gradient[parameter.range()];
        if parameter.name == "tactile.conv0.bias" {
            // Batch normalization subtracts the mean, so this gradient is zero except for rounding.
            assert!(gradient.iter().all(|value| value.abs() < 1e-3), "{gradient:?}");
            continue;
        }
        assert_summary(&parameter.name, gradient, expected, &probe, GRADIENT_TOLERANCE);
    }
    let mut network = reference.network.clone();
    track(&mut network.statistics, &given.statistics);
    let expected = &reference.expected;
    assert_close("mean", &network.statistics.mean, &floats(&expected["running_mean"]), FORWARD_TOLERANCE);
    assert_close("variance", &network.statistics.variance, &floats(&expected["running_var"]), FORWARD_TOLERANCE);

    let Batch { n, tactile, pose, .. } = &reference.batch;
    let forces = network.predict(Windows { n: *n, tactile, pose }).unwrap();
    assert_close("force after training", &forces.force, &floats(&expected["eval_force"]), FORWARD_TOLERANCE);
    assert_close("base after training", &forces.base, &floats(&expected["eval_base"]), FORWARD_TOLERANCE);
}

#[test]
fn the_gradient_is_the_slope_of_the_loss() {
    let reference = reference();
    let given = given(&reference);
    let mut lcg = Lcg(11);
    let probe: Vec<f32> = lcg.values(reference.network.values.len());
    for parameter in reference.network.architecture.parameters() {
        let gradient = &given.gradient[parameter.range()];
        let length = gradient.iter().map(|value| value * value).sum::<f32>().sqrt();
        if parameter.name == "tactile.conv0.bias" || length == 0.0 {
            continue;
        }
        // Half along the gradient, so that the slope is not zero, and half in a random direction.
        let width = (parameter.n_values() as f32).sqrt();
        let direction: Vec<f32> = gradient
            .iter()
            .zip(&probe[parameter.range()])
            .map(|(grad, random)| grad / length + 0.5 * random / width)
            .collect();
        let slope: f32 = gradient.iter().zip(&direction).map(|(grad, step)| grad * step).sum();
        let at = |step: f32| {
            let mut moved = Reference {
                network: reference.network.clone(),
                batch: reference.batch.clone(),
                expected: Value::Null,
                lcg: Lcg(0),
            };
            let range = parameter.range();
            moved.network.values[range].iter_mut().zip(&direction).for_each(|(value, along)| *value += step * along);
            self::given(&moved).loss.total
        };
        // About a thousandth of the loss, far above its rounding; kinks of ReLU, max and MAE blur the slope a little.
        let step = (2e-3 * given.loss.total / slope.abs()).min(2e-3);
        let measured = (at(step) - at(-step)) / (2.0 * step);
        assert!((measured - slope).abs() <= 0.03 * slope.abs(), "{}: {measured}, expected {slope}", parameter.name);
    }
}

#[test]
fn terms_that_are_left_out_have_no_gradient() {
    let reference = reference();
    let without = |loss: LossConfig| {
        let cfg = TrainConfig { loss, ..TrainConfig::default() };
        let measure = Measure { truths: N, zero_load: 2, tactile_scale: TACTILE_SCALE };
        run_shard(&reference.network, &reference.batch, &cfg, measure, &Device::flex().autodiff())
    };
    let no_artifact = without(LossConfig { base_weight: 1.0, lambda: 0.0, offset_gf: 1.0, ..LossConfig::default() });
    assert_eq!(no_artifact.loss.artifact, 0.0);
    assert!((no_artifact.loss.total - no_artifact.loss.force - no_artifact.loss.base).abs() < 1e-5);
    for parameter in reference.network.architecture.parameters() {
        let moves = no_artifact.gradient[parameter.range()].iter().any(|value| *value != 0.0);
        // The last frame is the first frame of layer 2's backward direction: its input state is zero.
        let unused = parameter.name.starts_with("auxiliary") || parameter.name == "pose.lstm1.backward.weight_hh";
        assert_eq!(moves, !unused, "{}", parameter.name);
    }
    let no_base = without(LossConfig { base_weight: 0.0, lambda: LAMBDA, offset_gf: 1.0, ..LossConfig::default() });
    assert_eq!(no_base.loss.base, 0.0);
    let half = without(LossConfig { base_weight: 0.5, lambda: 0.0, offset_gf: 1.0, ..LossConfig::default() });
    assert!((half.loss.total - half.loss.force - 0.5 * half.loss.base).abs() < 1e-5);
}
