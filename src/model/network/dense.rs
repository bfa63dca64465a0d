//! Linear maps of many rows.

use tactile_pose_fusion_kernels::elementwise::rectified;
use tactile_pose_fusion_kernels::matrix::Matrix;
use tactile_pose_fusion_kernels::packed::{Onto, Packed};

use super::sized;
use crate::model::paper;

/// Weights of a linear map.
#[derive(Debug)]
pub(super) struct Dense {
    /// `[inputs, outputs]`
    weight: Packed,
    bias: Vec<f32>,
}

/// Two linear maps with a ReLU between them. The second one has one output.
#[derive(Debug)]
pub(super) struct Decoder {
    hidden: Dense,
    weight: Vec<f32>,
    bias: f32,
}

impl Dense {
    /// From weights `[outputs, inputs]`.
    pub(super) fn of_rows(weight: &[f32], bias: &[f32]) -> Self {
        let n_in = weight.len() / bias.len();
        let weight = Packed::new(Matrix::new(weight, bias.len(), n_in).transposed());
        Dense { weight, bias: bias.to_vec() }
    }

    /// From weights `[inputs, outputs]`.
    pub(super) fn of_columns(weight: &[f32], bias: &[f32]) -> Self {
        let weight = Packed::new(Matrix::new(weight, weight.len() / bias.len(), bias.len()));
        Dense { weight, bias: bias.to_vec() }
    }

    /// Number of outputs.
    pub(super) fn width(&self) -> usize {
        self.bias.len()
    }

    /// Maps `[N, inputs]` to `[N, outputs]`.
    pub(super) fn run(&self, rows: &[f32], out: &mut [f32]) {
        let rows = Matrix::new(rows, out.len() / self.width(), self.weight.rows());
        self.weight.product(rows, Onto::Row(&self.bias), out);
    }
}

impl Decoder {
    pub(super) fn new(decoder: &paper::Decoder) -> Self {
        let [hidden, last] = &decoder.0;
        let bias = last.bias.first().copied().unwrap_or_default();
        Decoder { hidden: Dense::of_rows(&hidden.weight, &hidden.bias), weight: last.weight.clone(), bias }
    }

    /// Maps `[N, inputs]` to `[N]`. `hidden` is a buffer for the intermediate layer.
    pub(super) fn run(&self, rows: &[f32], n: usize, hidden: &mut Vec<f32>, out: &mut Vec<f32>) {
        let hidden = sized(hidden, n * self.weight.len());
        self.hidden.run(rows, hidden);
        out.clear();
        out.extend(hidden.chunks_exact(self.weight.len()).map(|hidden| {
            let terms = hidden.iter().zip(&self.weight).map(|(hidden, weight)| rectified(*hidden) * weight);
            self.bias + terms.sum::<f32>()
        }));
    }
}

/// Fills each row of `rows` with `row`.
pub(super) fn repeat(row: &[f32], rows: &mut [f32]) {
    rows.chunks_exact_mut(row.len()).for_each(|place| place.copy_from_slice(row));
}
