//! The tactile branch, forward and backward, on plain slices: a convolution, batch normalization, three dilated
//! convolutions, each with a ReLU behind it, and the maximum over time.
//!
//! All matrices are row-major and time-major: `x [L, N, T]`, features `[L, N, 64]`.

use super::super::architecture::{DILATIONS, N_FEATURES};
use super::conv::{self, ConvShape};
use super::{BatchNormStatistics, NORM_EPSILON, Normalize};

/// Weights and biases of [`Architecture::parameters`](super::super::Architecture::parameters) up to the last convolution.
pub(super) const N_PARAMETERS: usize = 4 + 2 * DILATIONS.len();

/// Indices of the normalization's gain and shift among the parameters, and of the first dilated convolution.
const GAIN: usize = 2;
const SHIFT: usize = 3;
const DILATED: usize = 4;

/// Sizes of one run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TactileShape {
    pub(super) frames: usize,
    pub(super) batch: usize,
    pub(super) n_taxels: usize,
}

/// Values of the forward pass that the backward pass needs.
#[derive(Debug, Clone)]
pub(super) struct TactileTape {
    normalized: Normalized,
    /// `[L, N, 64]` each: inputs of the dilated convolutions.
    inputs: Vec<Vec<f32>>,
    /// `[N, 64]`: the frame with the largest value, the first one in a tie.
    peaks: Vec<usize>,
    /// `[N, 64]`: the output.
    pub(super) features: Vec<f32>,
}

impl TactileShape {
    fn conv(&self, n_in: usize, dilation: usize) -> ConvShape {
        ConvShape { frames: self.frames, batch: self.batch, n_in, dilation }
    }
}

/// Features of windows `x`, and the statistics of the batch if it was normalized by itself.
pub(super) fn forward(
    shape: TactileShape,
    x: &[f32],
    parameters: &[Vec<f32>; N_PARAMETERS],
    normalize: Normalize<'_>,
) -> (TactileTape, Option<BatchNormStatistics>) {
    let y = conv::forward(shape.conv(shape.n_taxels, 1), x, &parameters[0], &parameters[1]);
    let (normalized, statistics) = Normalized::new(y, shape.batch, normalize);
    let mut inputs = Vec::with_capacity(DILATIONS.len());
    let mut y = normalized.scaled(&parameters[GAIN], &parameters[SHIFT]);
    for (idx, dilation) in DILATIONS.into_iter().enumerate() {
        relu(&mut y);
        let [weight, bias] = [0, 1].map(|part| &parameters[DILATED + 2 * idx + part]);
        let x = std::mem::take(&mut y);
        y = conv::forward(shape.conv(N_FEATURES, dilation), &x, weight, bias);
        inputs.push(x);
    }
    let width = shape.batch * N_FEATURES;
    let mut features = y[..width].to_vec();
    let mut peaks = vec![0; width];
    for (frame, values) in y.chunks_exact(width).enumerate().skip(1) {
        for ((largest, peak), value) in features.iter_mut().zip(&mut peaks).zip(values) {
            (*largest, *peak) = if *value > *largest { (*value, frame) } else { (*largest, *peak) };
        }
    }
    relu(&mut features); // the ReLU of the largest value is the largest of all ReLUs
    (TactileTape { normalized, inputs, peaks, features }, statistics)
}

/// From the gradient `grad [N, 64]` of the features to that of the parameters.
pub(super) fn backward(
    shape: TactileShape,
    x: &[f32],
    parameters: &[Vec<f32>; N_PARAMETERS],
    tape: &TactileTape,
    grad: &[f32],
) -> [Vec<f32>; N_PARAMETERS] {
    let width = shape.batch * N_FEATURES;
    let mut back = [const { Vec::new() }; N_PARAMETERS];
    let mut grad_y = vec![0.0; shape.frames * width];
    for (idx, (peak, feature)) in tape.peaks.iter().zip(&tape.features).enumerate() {
        if *feature > 0.0 {
            grad_y[peak * width + idx] = grad[idx];
        }
    }
    for (idx, dilation) in DILATIONS.into_iter().enumerate().rev() {
        let (conv, x) = (shape.conv(N_FEATURES, dilation), &tape.inputs[idx]);
        let at = DILATED + 2 * idx;
        let gradients = conv::weight_gradient(conv, x, &grad_y);
        (back[at], back[at + 1]) = (gradients.weight, gradients.bias);
        grad_y = conv::input_gradient(conv, &parameters[at], &grad_y);
        grad_y.iter_mut().zip(x).for_each(|(grad, value)| *grad = if *value > 0.0 { *grad } else { 0.0 });
    }
    (back[GAIN], back[SHIFT]) = tape.normalized.back(&mut grad_y, &parameters[GAIN]);
    let gradients = conv::weight_gradient(shape.conv(shape.n_taxels, 1), x, &grad_y);
    (back[0], back[1]) = (gradients.weight, gradients.bias);
    back
}

/// NaN stays NaN, so that a diverged run is detected.
fn relu(values: &mut [f32]) {
    values.iter_mut().for_each(|value| *value = if *value < 0.0 { 0.0 } else { *value });
}

/// Rows of channels minus their mean, divided by their deviation.
#[derive(Debug, Clone)]
struct Normalized {
    values: Vec<f32>,
    batch: usize,
    inverse_deviation: Vec<f32>,
    /// True if mean and deviation come from these rows, so that gradients flow through them.
    by_batch: bool,
}

impl Normalized {
    fn new(mut y: Vec<f32>, batch: usize, normalize: Normalize<'_>) -> (Self, Option<BatchNormStatistics>) {
        let rows = (y.len() / N_FEATURES) as f64;
        let (mean, variance, statistics) = match normalize {
            Normalize::ByBatch => {
                let mean = channel_means(&y, batch, |value, _| value);
                let variance = channel_means(&y, batch, |value, channel| (value - mean[channel]).powi(2));
                let unbiased = (rows / (rows - 1.0).max(1.0)) as f32;
                let statistics = BatchNormStatistics {
                    mean: mean.clone(),
                    variance: variance.iter().map(|value| value * unbiased).collect(),
                };
                (mean, variance, Some(statistics))
            }
            Normalize::ByStatistics(given) => (given.mean.clone(), given.variance.clone(), None),
        };
        let inverse_deviation: Vec<f32> = variance.iter().map(|value| 1.0 / (value + NORM_EPSILON).sqrt()).collect();
        for row in y.chunks_exact_mut(N_FEATURES) {
            for ((value, mean), inverse) in row.iter_mut().zip(&mean).zip(&inverse_deviation) {
                *value = (*value - mean) * inverse;
            }
        }
        (Normalized { values: y, batch, inverse_deviation, by_batch: statistics.is_some() }, statistics)
    }

    fn scaled(&self, gain: &[f32], shift: &[f32]) -> Vec<f32> {
        let mut out = self.values.clone();
        for row in out.chunks_exact_mut(N_FEATURES) {
            row.iter_mut().zip(gain).zip(shift).for_each(|((value, gain), shift)| *value = *value * gain + shift);
        }
        out
    }

    /// Converts the gradient of the scaled rows to that of the input rows; returns those of gain and shift.
    fn back(&self, grad: &mut [f32], gain: &[f32]) -> (Vec<f32>, Vec<f32>) {
        let rows = (grad.len() / N_FEATURES) as f32;
        let mean_grad = channel_means(grad, self.batch, |value, _| value);
        let products: Vec<f32> = grad.iter().zip(&self.values).map(|(grad, value)| grad * value).collect();
        let mean_product = channel_means(&products, self.batch, |value, _| value);
        let sums = |means: &[f32]| means.iter().map(|mean| mean * rows).collect();
        let moving = if self.by_batch { 1.0 } else { 0.0 };
        for (row, values) in grad.chunks_exact_mut(N_FEATURES).zip(self.values.chunks_exact(N_FEATURES)) {
            for (channel, (grad, value)) in row.iter_mut().zip(values).enumerate() {
                let moved = moving * (mean_grad[channel] + value * mean_product[channel]);
                *grad = gain[channel] * self.inverse_deviation[channel] * (*grad - moved);
            }
        }
        (sums(&mean_product), sums(&mean_grad))
    }
}

/// Mean over all rows of a function of each value and its channel; frames are summed in f64.
fn channel_means(rows: &[f32], batch: usize, of: impl Fn(f32, usize) -> f32) -> Vec<f32> {
    let mut sums = [0.0f64; N_FEATURES];
    for frame in rows.chunks_exact(batch * N_FEATURES) {
        let mut in_frame = [0.0f32; N_FEATURES];
        for row in frame.chunks_exact(N_FEATURES) {
            in_frame.iter_mut().zip(row).enumerate().for_each(|(idx, (sum, value))| *sum += of(*value, idx));
        }
        sums.iter_mut().zip(in_frame).for_each(|(sum, value)| *sum += f64::from(value));
    }
    let n = (rows.len() / N_FEATURES) as f64;
    sums.iter().map(|sum| (sum / n) as f32).collect()
}
