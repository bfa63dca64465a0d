//! Adam with decoupled weight decay (Loshchilov and Hutter, 2019), as PyTorch's AdamW does it.

use serde::{Deserialize, Serialize};

use super::super::exact_floats;
use super::super::network::Network;

const BETAS: [f32; 2] = [0.9, 0.999];
const EPSILON: f32 = 1e-8;

/// The moments of the gradient so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(in crate::train) struct Adam {
    n_steps: i32,
    #[serde(with = "exact_floats")]
    pub(super) first: Vec<f32>,
    #[serde(with = "exact_floats")]
    pub(super) second: Vec<f32>,
}

impl Adam {
    pub(super) fn new(network: &Network) -> Self {
        let n = network.values.len();
        Adam { n_steps: 0, first: vec![0.0; n], second: vec![0.0; n] }
    }

    pub(super) fn step(&mut self, network: &mut Network, gradient: &[f32], learning_rate: f64, weight_decay: f64) {
        self.n_steps = self.n_steps.saturating_add(1);
        let [first_correction, second_correction] = BETAS.map(|beta| 1.0 - f64::from(beta).powi(self.n_steps));
        let rate = (learning_rate / first_correction) as f32;
        let second_correction = second_correction.sqrt() as f32;
        for parameter in network.architecture.parameters() {
            // Biases and normalizations are not decayed: pulling them to zero gains nothing.
            let decay = if parameter.dims.len() > 1 { (learning_rate * weight_decay) as f32 } else { 0.0 };
            for idx in parameter.range() {
                let g = gradient[idx];
                let first = BETAS[0] * self.first[idx] + (1.0 - BETAS[0]) * g;
                let second = BETAS[1] * self.second[idx] + (1.0 - BETAS[1]) * g * g;
                let value = network.values[idx];
                let step = rate * first / (second.sqrt() / second_correction + EPSILON);
                network.values[idx] = value - value * decay - step;
                (self.first[idx], self.second[idx]) = (first, second);
            }
        }
    }
}
