//! A convolution over time with three taps, forward and backward, on plain slices.
//!
//! Time-major, `[L, N, C]`, each tap is one matrix product of a frame and a weight matrix: no copies are made. Frames
//! beyond the ends count as zero, so the number of frames stays the same.

use std::array::from_fn;

use tactile_pose_fusion_kernels::matrix::Matrix;
use tactile_pose_fusion_kernels::product::{add_column_sums, add_product};

use super::super::architecture::{N_FEATURES, TAPS};

/// Sizes of one run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ConvShape {
    pub(super) frames: usize,
    pub(super) batch: usize,
    /// Input channels; the output has [`N_FEATURES`].
    pub(super) n_in: usize,
    /// Frames between the taps.
    pub(super) dilation: usize,
}

/// Gradients of a scalar with respect to the inputs of a forward pass.
#[derive(Debug, Clone)]
pub(super) struct ConvGradients {
    /// `[64, C, 3]`
    pub(super) weight: Vec<f32>,
    /// `[64]`
    pub(super) bias: Vec<f32>,
}

impl ConvShape {
    /// The input frame of a tap for an output frame, if there is one.
    fn source(&self, frame: usize, tap: usize) -> Option<usize> {
        (frame + tap * self.dilation).checked_sub(self.dilation).filter(|source| *source < self.frames)
    }

    fn input<'a>(&self, x: &'a [f32], frame: usize) -> Matrix<'a> {
        let len = self.batch * self.n_in;
        Matrix::new(&x[frame * len..(frame + 1) * len], self.batch, self.n_in)
    }

    fn output<'a>(&self, y: &'a [f32], frame: usize) -> Matrix<'a> {
        let len = self.batch * N_FEATURES;
        Matrix::new(&y[frame * len..(frame + 1) * len], self.batch, N_FEATURES)
    }
}

/// `[L, N, C]` to `[L, N, 64]`; `weight` is PyTorch's `[64, C, 3]`.
pub(super) fn forward(shape: ConvShape, x: &[f32], weight: &[f32], bias: &[f32]) -> Vec<f32> {
    let n_in = shape.n_in;
    let taps: [Vec<f32>; TAPS] =
        from_fn(|tap| Matrix::new(&of_tap(weight, tap), N_FEATURES, n_in).transposed().to_rows());
    let mut y = bias.repeat(shape.frames * shape.batch);
    for (frame, y) in y.chunks_exact_mut(shape.batch * N_FEATURES).enumerate() {
        for (tap, weight) in taps.iter().enumerate() {
            if let Some(source) = shape.source(frame, tap) {
                add_product(y, shape.input(x, source), Matrix::new(weight, n_in, N_FEATURES));
            }
        }
    }
    y
}

/// From the gradient `grad [L, N, 64]` of the output to that of the input, `[L, N, C]`.
pub(super) fn input_gradient(shape: ConvShape, weight: &[f32], grad: &[f32]) -> Vec<f32> {
    let n_in = shape.n_in;
    let taps: [Vec<f32>; TAPS] = from_fn(|tap| of_tap(weight, tap));
    let mut grad_x = vec![0.0; shape.frames * shape.batch * n_in];
    for (frame, grad_x) in grad_x.chunks_exact_mut(shape.batch * n_in).enumerate() {
        for (tap, weight) in taps.iter().enumerate() {
            // The output frame that used this input frame through a tap is found with the opposite tap.
            if let Some(seen_from) = shape.source(frame, TAPS - 1 - tap) {
                add_product(grad_x, shape.output(grad, seen_from), Matrix::new(weight, N_FEATURES, n_in));
            }
        }
    }
    grad_x
}

/// From the gradient `grad [L, N, 64]` of the output to that of weight and bias.
pub(super) fn weight_gradient(shape: ConvShape, x: &[f32], grad: &[f32]) -> ConvGradients {
    let mut taps: [Vec<f32>; TAPS] = from_fn(|_| vec![0.0; N_FEATURES * shape.n_in]);
    for frame in 0..shape.frames {
        for (tap, weight) in taps.iter_mut().enumerate() {
            if let Some(source) = shape.source(frame, tap) {
                add_product(weight, shape.output(grad, frame).transposed(), shape.input(x, source));
            }
        }
    }
    let mut bias = vec![0.0; N_FEATURES];
    add_column_sums(&mut bias, grad);
    let weight = (0..N_FEATURES * shape.n_in).flat_map(|idx| taps.each_ref().map(|tap| tap[idx])).collect();
    ConvGradients { weight, bias }
}

/// One tap of `[64, C, 3]`: `[64, C]`.
pub(super) fn of_tap(weight: &[f32], tap: usize) -> Vec<f32> {
    weight.iter().skip(tap).step_by(TAPS).copied().collect()
}
