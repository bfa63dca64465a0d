//! The pose branch: angles encoded a frame, then two layers of a bidirectional LSTM over each window.

use macerator::{AutoArch, Simd, WithSimd};

use super::dense::Dense;
use super::vectorized;
use crate::kernels::matrix::{Matrix, add_product};
use crate::kernels::nonlinear::{gelu, sigmoid, tanh_of};
use crate::model::paper::{self, Cells};

/// The branch, gates in ONNX's order: input, output, forget, cell.
#[derive(Debug)]
pub(super) struct Pose {
    norm_gain: Vec<f32>,
    norm_shift: Vec<f32>,
    norm_epsilon: f32,
    embedding: Dense,
    hidden: usize,
    /// Of the first layer, forward and backward: from an encoded frame to gates.
    projections: [Dense; 2],
    /// `[H, 4 H]` each: from the state before to gates.
    recurrent: [Vec<f32>; 2],
    /// `[3 H, 4 H]`, forward: from both states of the layer below and the state before to gates.
    forward: Vec<f32>,
    forward_bias: Vec<f32>,
    /// From both states of the layer below to gates; the last frame is the first one, so there is no state before.
    backward: Dense,
}

/// What the recurrences of a block of windows need.
struct Scratch {
    gates: Vec<f32>,
    cells: [Vec<f32>; 2],
    /// `[window, n, H]`: the backward direction of the first layer.
    back: Vec<f32>,
    /// `[n, 3 H]`: both directions of the first layer at a frame, and the second one's state at the frame before.
    states: Vec<f32>,
}

impl Pose {
    pub(super) fn new(pose: &paper::Pose) -> Self {
        let [[ahead, back], [forward, backward]] = &pose.lstm;
        let hidden = ahead.hidden;
        let turned = |rows: &[f32]| Matrix::new(rows, 4 * hidden, rows.len() / (4 * hidden)).transposed().to_rows();
        let projection = |cells: &Cells| Dense::of_rows(&cells.input, &cells.bias);
        Pose {
            norm_gain: pose.norm_gain.clone(),
            norm_shift: pose.norm_shift.clone(),
            norm_epsilon: pose.norm_epsilon,
            embedding: Dense::of_columns(&pose.embedding.weight, &pose.embedding.bias),
            hidden,
            projections: [projection(ahead), projection(back)],
            recurrent: [turned(&ahead.recurrent), turned(&back.recurrent)],
            forward: [turned(&forward.input), turned(&forward.recurrent)].concat(),
            forward_bias: forward.bias.clone(),
            backward: projection(backward),
        }
    }

    /// `[frames, joints]` to `[N, 2 H]`: the last state of every window, `block` windows at a time.
    pub(super) fn run(&self, pose: &[f32], window: usize, n_windows: usize, block: usize) -> Vec<f32> {
        let encoded = self.encoded(pose);
        let projected = [self.projections[0].run(&encoded), self.projections[1].run(&encoded)];
        let mut out = Vec::with_capacity(n_windows * 2 * self.hidden);
        for first in (0..n_windows).step_by(block) {
            self.block(&projected, window, first, block.min(n_windows - first), &mut out);
        }
        out
    }

    /// `[frames, joints]` to `[frames, F]`.
    fn encoded(&self, pose: &[f32]) -> Vec<f32> {
        let width = self.norm_gain.len();
        let mut rows = Vec::with_capacity(2 * pose.len());
        for angles in pose.chunks_exact(width / 2) {
            let from = rows.len();
            rows.extend(angles.iter().map(|angle| angle.sin()));
            rows.extend(angles.iter().map(|angle| angle.cos()));
            let row = &mut rows[from..];
            let mean = row.iter().sum::<f32>() / width as f32;
            let variance = row.iter().map(|value| (value - mean) * (value - mean)).sum::<f32>() / width as f32;
            let scale = 1.0 / (variance + self.norm_epsilon).sqrt();
            for ((value, gain), shift) in row.iter_mut().zip(&self.norm_gain).zip(&self.norm_shift) {
                *value = (*value - mean) * scale * gain + shift;
            }
        }
        let mut encoded = self.embedding.run(&rows);
        vectorized(|| encoded.iter_mut().for_each(|value| *value = gelu(*value)));
        encoded
    }

    /// The last states of `n` windows from `first` on.
    fn block(&self, projected: &[Vec<f32>; 2], window: usize, first: usize, n: usize, out: &mut Vec<f32>) {
        let hidden = self.hidden;
        let mut scratch = Scratch {
            gates: vec![0.0; n * 4 * hidden],
            cells: [vec![0.0; n * hidden], vec![0.0; n * hidden]],
            back: vec![0.0; window * n * hidden],
            states: vec![0.0; n * 3 * hidden],
        };
        self.first_layer_back(&projected[1], window, first, n, &mut scratch);
        let Scratch { gates, cells: [below, own], back, states } = &mut scratch;
        below.fill(0.0);
        let recurrent = Matrix::new(&self.recurrent[0], hidden, 4 * hidden);
        let forward = Matrix::new(&self.forward, 3 * hidden, 4 * hidden);
        for frame in 0..window {
            gates.copy_from_slice(rows(&projected[0], first + frame, n, 4 * hidden));
            if frame > 0 {
                add_product(gates, Matrix::strided(states, n, hidden, 3 * hidden), recurrent);
            }
            advance(hidden, gates, below, states, 3 * hidden);
            for (state, back) in
                states.chunks_exact_mut(3 * hidden).zip(rows(back, frame * n, n, hidden).chunks_exact(hidden))
            {
                state[hidden..2 * hidden].copy_from_slice(back);
            }
            gates.chunks_exact_mut(4 * hidden).for_each(|gates| gates.copy_from_slice(&self.forward_bias));
            add_product(gates, Matrix::new(states, n, 3 * hidden), forward);
            advance(hidden, gates, own, &mut states[2 * hidden..], 3 * hidden);
        }
        let lower: Vec<f32> = states.chunks_exact(3 * hidden).flat_map(|state| &state[..2 * hidden]).copied().collect();
        let mut gates = self.backward.run(&lower);
        own.fill(0.0);
        let mut last = vec![0.0; n * hidden];
        advance(hidden, &mut gates, own, &mut last, hidden);
        for (state, back) in states.chunks_exact(3 * hidden).zip(last.chunks_exact(hidden)) {
            out.extend_from_slice(&state[2 * hidden..]);
            out.extend_from_slice(back);
        }
    }

    fn first_layer_back(&self, projected: &[f32], window: usize, first: usize, n: usize, scratch: &mut Scratch) {
        let hidden = self.hidden;
        let recurrent = Matrix::new(&self.recurrent[1], hidden, 4 * hidden);
        let Scratch { gates, cells: [cells, _], back, .. } = scratch;
        for frame in (0..window).rev() {
            let (before, after) = back.split_at_mut((frame + 1) * n * hidden);
            gates.copy_from_slice(rows(projected, first + frame, n, 4 * hidden));
            if frame + 1 < window {
                add_product(gates, Matrix::new(&after[..n * hidden], n, hidden), recurrent);
            }
            let state = &mut before[frame * n * hidden..];
            advance(hidden, gates, cells, state, hidden);
        }
    }
}

/// `n` rows from `first` on.
fn rows(values: &[f32], first: usize, n: usize, width: usize) -> &[f32] {
    &values[first * width..(first + n) * width]
}

/// One step of an LSTM: gates through their nonlinearities, cells one step on, and the new states to the begin of each
/// `stride` of `states`.
fn advance(hidden: usize, gates: &mut [f32], cells: &mut [f32], states: &mut [f32], stride: usize) {
    AutoArch::new().dispatch(Step { hidden, gates, cells, states, stride });
}

/// A closure would not be compiled with the machine's vector instructions: it is too large to be inlined by itself.
struct Step<'a> {
    hidden: usize,
    gates: &'a mut [f32],
    cells: &'a mut [f32],
    states: &'a mut [f32],
    stride: usize,
}

impl WithSimd for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self) {
        let Step { hidden, gates, cells, states, stride } = self;
        let of_windows = gates.chunks_exact_mut(4 * hidden).zip(cells.chunks_exact_mut(hidden));
        for ((gates, cells), states) in of_windows.zip(states.chunks_mut(stride)) {
            for gate in &mut gates[..3 * hidden] {
                *gate = sigmoid(*gate);
            }
            for gate in &mut gates[3 * hidden..] {
                *gate = tanh_of(*gate);
            }
            let (input_gates, rest) = gates.split_at(hidden);
            let (output_gates, rest) = rest.split_at(hidden);
            let (forget_gates, candidates) = rest.split_at(hidden);
            for (((cell, i), f), g) in cells.iter_mut().zip(input_gates).zip(forget_gates).zip(candidates) {
                *cell = f * *cell + i * g;
            }
            for ((state, o), cell) in states.iter_mut().zip(output_gates).zip(cells) {
                *state = o * tanh_of(*cell);
            }
        }
    }
}
