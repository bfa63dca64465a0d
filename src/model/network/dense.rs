//! Linear maps of many rows.

use crate::kernels::matrix::{Matrix, add_product};
use crate::model::paper;

/// A linear map.
#[derive(Debug)]
pub(super) struct Dense {
    /// `[inputs, outputs]`
    weight: Vec<f32>,
    bias: Vec<f32>,
}

/// Two linear maps with a ReLU between, the second to one number.
#[derive(Debug)]
pub(super) struct Decoder {
    hidden: Dense,
    weight: Vec<f32>,
    bias: f32,
}

impl Dense {
    /// From a weight `[outputs, inputs]`.
    pub(super) fn of_rows(weight: &[f32], bias: &[f32]) -> Self {
        let n_in = weight.len() / bias.len();
        let weight = Matrix::new(weight, bias.len(), n_in).transposed().to_rows();
        Dense { weight, bias: bias.to_vec() }
    }

    /// From a weight `[inputs, outputs]`.
    pub(super) fn of_columns(weight: &[f32], bias: &[f32]) -> Self {
        Dense { weight: weight.to_vec(), bias: bias.to_vec() }
    }

    /// `[N, inputs]` to `[N, outputs]`.
    pub(super) fn run(&self, rows: &[f32]) -> Vec<f32> {
        let n_in = self.weight.len() / self.bias.len();
        let n = rows.len() / n_in;
        let mut out = self.bias.repeat(n);
        add_product(&mut out, Matrix::new(rows, n, n_in), Matrix::new(&self.weight, n_in, self.bias.len()));
        out
    }
}

impl Decoder {
    pub(super) fn new(decoder: &paper::Decoder) -> Self {
        let [hidden, last] = &decoder.0;
        let bias = last.bias.first().copied().unwrap_or_default();
        Decoder { hidden: Dense::of_rows(&hidden.weight, &hidden.bias), weight: last.weight.clone(), bias }
    }

    /// `[N, inputs]` to `[N]`.
    pub(super) fn run(&self, rows: &[f32]) -> Vec<f32> {
        let hidden = self.hidden.run(rows);
        let decoded = hidden.chunks_exact(self.weight.len()).map(|hidden| {
            let terms = hidden.iter().zip(&self.weight).map(|(hidden, weight)| hidden.max(0.0) * weight);
            self.bias + terms.sum::<f32>()
        });
        decoded.collect()
    }
}
