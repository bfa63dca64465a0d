//! The pose branch: angles encoded a frame, then two layers of a bidirectional LSTM over each window.

use std::ops::Range;

use macerator::{AutoArch, Simd, WithSimd};

use super::dense::{Dense, repeat};
use super::frames::Frames;
use super::{sized, vectorized};
use crate::kernels::matrix::{Matrix, add_product};
use crate::kernels::nonlinear::{self, gelu, next_cell};
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

/// What depends on frames alone: gates of the first layer as far as its inputs make them, forward and backward.
#[derive(Debug, Default)]
pub(super) struct Known {
    projected: [Frames; 2],
}

/// What is computed anew for every window, and what comes out.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    angles: Vec<f32>,
    encoded: Vec<f32>,
    recurrences: Recurrences,
    /// `[N, 2 H]`: what comes out.
    pub(super) last: Vec<f32>,
}

/// What the recurrences of a block of windows need.
#[derive(Debug, Default)]
struct Recurrences {
    gates: Vec<f32>,
    cells: [Vec<f32>; 2],
    /// `[window, n, H]`: the backward direction of the first layer.
    back: Vec<f32>,
    /// `[n, 3 H]`: both directions of the first layer at a frame, and the second one's state at the frame before.
    states: Vec<f32>,
    /// `[n, 2 H]`: both directions of the first layer at the last frame.
    lower: Vec<f32>,
    /// `[n, H]`: the backward direction of the second layer at the last frame.
    last_back: Vec<f32>,
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

    /// Forgets all frames; those that follow are `n_frames` at a time, each of so many lanes.
    pub(super) fn begin(&self, known: &mut Known, n_lanes: usize, n_frames: usize) {
        known.projected.iter_mut().for_each(|projected| projected.reset(n_lanes * 4 * self.hidden, n_frames));
    }

    /// Takes in new frames `[frames, lanes, joints]`, and runs the first `n` windows of those that are known, `block` of
    /// them at a time.
    pub(super) fn run(
        &self,
        known: &mut Known,
        new: &[f32],
        window: usize,
        n: usize,
        block: usize,
        scratch: &mut Scratch,
    ) {
        let Scratch { angles, encoded, recurrences, last } = scratch;
        self.encode(new, angles, encoded);
        for (projected, projection) in known.projected.iter_mut().zip(&self.projections) {
            let n_frames = encoded.len() / self.embedding.width() * projection.width() / projected.width();
            projection.run(encoded, projected.push(n_frames));
        }
        let block = block.max(1);
        for (out, first) in
            sized(last, n * 2 * self.hidden).chunks_mut(block * 2 * self.hidden).zip((0..).step_by(block))
        {
            self.block(known, window, first..n.min(first + block), recurrences, out);
        }
    }

    /// `[rows, joints]` to `[rows, F]`.
    fn encode(&self, pose: &[f32], rows: &mut Vec<f32>, encoded: &mut Vec<f32>) {
        let width = self.norm_gain.len();
        rows.clear();
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
        let encoded = sized(encoded, rows.len() / width * self.embedding.width());
        self.embedding.run(rows, encoded);
        vectorized(|| encoded.iter_mut().for_each(|value| *value = gelu(*value)));
    }

    /// The last states of some windows.
    fn block(
        &self,
        known: &Known,
        window: usize,
        windows: Range<usize>,
        recurrences: &mut Recurrences,
        out: &mut [f32],
    ) {
        let (hidden, n) = (self.hidden, windows.len());
        self.first_layer_back(&known.projected[1], window, &windows, recurrences);
        let Recurrences { gates, cells: [below, own], back, states, lower, last_back } = recurrences;
        below.fill(0.0);
        let own = sized(own, n * hidden);
        own.fill(0.0);
        let states = sized(states, n * 3 * hidden);
        states.fill(0.0);
        let recurrent = Matrix::new(&self.recurrent[0], hidden, 4 * hidden);
        let forward = Matrix::new(&self.forward, 3 * hidden, 4 * hidden);
        for frame in 0..window {
            gates.copy_from_slice(of_windows(&known.projected[0], frame, &windows, 4 * hidden));
            if frame > 0 {
                add_product(gates, Matrix::strided(states, n, hidden, 3 * hidden), recurrent);
            }
            advance(hidden, gates, below, states, 3 * hidden);
            let back = back[frame * n * hidden..].chunks_exact(hidden);
            for (state, back) in states.chunks_exact_mut(3 * hidden).zip(back) {
                state[hidden..2 * hidden].copy_from_slice(back);
            }
            repeat(&self.forward_bias, gates);
            add_product(gates, Matrix::new(states, n, 3 * hidden), forward);
            advance(hidden, gates, own, &mut states[2 * hidden..], 3 * hidden);
        }
        lower.clear();
        lower.extend(states.chunks_exact(3 * hidden).flat_map(|state| &state[..2 * hidden]));
        self.backward.run(lower, gates);
        own.fill(0.0);
        let last_back = sized(last_back, n * hidden);
        advance(hidden, gates, own, last_back, hidden);
        let ends = states.chunks_exact(3 * hidden).zip(last_back.chunks_exact(hidden));
        for (out, (state, back)) in out.chunks_exact_mut(2 * hidden).zip(ends) {
            out[..hidden].copy_from_slice(&state[2 * hidden..]);
            out[hidden..].copy_from_slice(back);
        }
    }

    fn first_layer_back(
        &self,
        projected: &Frames,
        window: usize,
        windows: &Range<usize>,
        recurrences: &mut Recurrences,
    ) {
        let (hidden, n) = (self.hidden, windows.len());
        let recurrent = Matrix::new(&self.recurrent[1], hidden, 4 * hidden);
        let Recurrences { gates, cells: [cells, _], back, .. } = recurrences;
        let (gates, cells) = (sized(gates, n * 4 * hidden), sized(cells, n * hidden));
        let back = sized(back, window * n * hidden);
        cells.fill(0.0);
        for frame in (0..window).rev() {
            let (before, after) = back.split_at_mut((frame + 1) * n * hidden);
            gates.copy_from_slice(of_windows(projected, frame, windows, 4 * hidden));
            if frame + 1 < window {
                add_product(gates, Matrix::new(&after[..n * hidden], n, hidden), recurrent);
            }
            let state = &mut before[frame * n * hidden..];
            advance(hidden, gates, cells, state, hidden);
        }
    }
}

/// What some windows have at one of their frames, a row each.
fn of_windows<'f>(frames: &'f Frames, frame: usize, windows: &Range<usize>, width: usize) -> &'f [f32] {
    &frames.from(frame, windows.end * width)[windows.start * width..]
}

/// One step of an LSTM: cells one step on, and the new states to the begin of each `stride` of `states`.
fn advance(hidden: usize, gates: &[f32], cells: &mut [f32], states: &mut [f32], stride: usize) {
    AutoArch::new().dispatch(Step { hidden, gates, cells, states, stride });
}

/// A closure would not be compiled with the machine's vector instructions: it is too large to be inlined by itself.
struct Step<'a> {
    hidden: usize,
    gates: &'a [f32],
    cells: &'a mut [f32],
    states: &'a mut [f32],
    stride: usize,
}

impl WithSimd for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self) {
        let Step { hidden, gates, cells, states, stride } = self;
        let of_windows = gates.chunks_exact(4 * hidden).zip(cells.chunks_exact_mut(hidden));
        for ((gates, cells), states) in of_windows.zip(states.chunks_mut(stride)) {
            let (input_gates, rest) = gates.split_at(hidden);
            let (output_gates, rest) = rest.split_at(hidden);
            let (forget_gates, candidates) = rest.split_at(hidden);
            for (((cell, i), f), g) in cells.iter_mut().zip(input_gates).zip(forget_gates).zip(candidates) {
                *cell = next_cell(*cell, *f, *i, *g);
            }
            for ((state, o), cell) in states.iter_mut().zip(output_gates).zip(cells) {
                *state = nonlinear::state(*o, *cell);
            }
        }
    }
}
