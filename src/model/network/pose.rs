//! Pose branch: encodes the joint angles once per frame, then runs two layers of a bidirectional LSTM over each window.

use std::ops::Range;

use tactile_pose_fusion_kernels::elementwise::gelu;
use tactile_pose_fusion_kernels::lstm::advance;
use tactile_pose_fusion_kernels::matrix::Matrix;
use tactile_pose_fusion_kernels::packed::{Onto, Packed};

use super::dense::Dense;
use super::frames::Frames;
use super::sized;
use crate::model::paper::{self, Cells};

/// Weights of the pose branch. Gates are in ONNX's order: input, output, forget, cell.
#[derive(Debug)]
pub(super) struct Pose {
    norm_gain: Vec<f32>,
    norm_shift: Vec<f32>,
    norm_epsilon: f32,
    embedding: Dense,
    hidden: usize,
    /// First layer, forward and backward: encoded frame to gates.
    projections: [Dense; 2],
    /// First layer, `[H, 4 H]` each: previous state to gates.
    recurrent: [Packed; 2],
    /// Second layer, forward, `[3 H, 4 H]`: both states of the first layer and the previous state to gates.
    forward: Packed,
    forward_bias: Vec<f32>,
    /// Second layer, backward: both states of the first layer to gates. Only its first step is needed, at the last
    /// frame, so there is no previous state.
    backward: Dense,
}

/// Values per frame: the contribution of the input to the gates of the first layer, forward and backward.
#[derive(Debug, Default)]
pub(super) struct Known {
    projected: [Frames; 2],
}

/// Buffers for values per window, and the output.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    angles: Vec<f32>,
    encoded: Vec<f32>,
    recurrences: Recurrences,
    /// Output, `[N, 2 H]`.
    pub(super) last: Vec<f32>,
}

/// Buffers for the recurrences of a block of windows.
#[derive(Debug, Default)]
struct Recurrences {
    gates: Vec<f32>,
    cells: [Vec<f32>; 2],
    /// `[window, n, H]`: states of the first layer, backward.
    back: Vec<f32>,
    /// `[n, 3 H]`: both states of the first layer at a frame, and the state of the second layer at the previous frame.
    states: Vec<f32>,
    /// `[n, 2 H]`: both states of the first layer at the last frame.
    lower: Vec<f32>,
    /// `[n, H]`: state of the second layer, backward, at the last frame.
    last_back: Vec<f32>,
}

impl Pose {
    pub(super) fn new(pose: &paper::Pose) -> Self {
        let [[ahead, back], [forward, backward]] = &pose.lstm;
        let hidden = ahead.hidden;
        fn of_rows(hidden: usize, rows: &[f32]) -> Matrix<'_> {
            Matrix::new(rows, 4 * hidden, rows.len() / (4 * hidden)).transposed()
        }
        let both = [&forward.input, &forward.recurrent].map(|rows| of_rows(hidden, rows).to_rows()).concat();
        let projection = |cells: &Cells| Dense::of_rows(&cells.input, &cells.bias);
        Pose {
            norm_gain: pose.norm_gain.clone(),
            norm_shift: pose.norm_shift.clone(),
            norm_epsilon: pose.norm_epsilon,
            embedding: Dense::of_columns(&pose.embedding.weight, &pose.embedding.bias),
            hidden,
            projections: [projection(ahead), projection(back)],
            recurrent: [ahead, back].map(|cells| Packed::new(of_rows(hidden, &cells.recurrent))),
            forward: Packed::new(Matrix::new(&both, both.len() / (4 * hidden), 4 * hidden)),
            forward_bias: forward.bias.clone(),
            backward: projection(backward),
        }
    }

    /// Forgets all frames. The next call of `run` brings `n_frames` frames of `n_lanes` lanes.
    pub(super) fn begin(&self, known: &mut Known, n_lanes: usize, n_frames: usize) {
        known.projected.iter_mut().for_each(|projected| projected.reset(n_lanes * 4 * self.hidden, n_frames));
    }

    /// Adds new frames `[frames, lanes, joints]` and runs the first `n` windows, `block` of them at a time.
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

    /// Encodes angles `[rows, joints]` to `[rows, F]`.
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
        gelu(encoded);
    }

    /// Computes the last states of some windows.
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
        for frame in 0..window {
            let projected = of_windows(&known.projected[0], frame, &windows, 4 * hidden);
            let before = (frame > 0).then(|| Matrix::strided(states, n, hidden, 3 * hidden));
            let lower_gates = self.gates(0, projected, before, gates);
            advance(hidden, lower_gates, below, states, 3 * hidden);
            let back = back[frame * n * hidden..].chunks_exact(hidden);
            for (state, back) in states.chunks_exact_mut(3 * hidden).zip(back) {
                state[hidden..2 * hidden].copy_from_slice(back);
            }
            self.forward.product(Matrix::new(states, n, 3 * hidden), Onto::Row(&self.forward_bias), gates);
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
        let Recurrences { gates, cells: [cells, _], back, .. } = recurrences;
        let (gates, cells) = (sized(gates, n * 4 * hidden), sized(cells, n * hidden));
        let back = sized(back, window * n * hidden);
        cells.fill(0.0);
        for frame in (0..window).rev() {
            let (before, after) = back.split_at_mut((frame + 1) * n * hidden);
            let projected = of_windows(projected, frame, windows, 4 * hidden);
            let state_after = (frame + 1 < window).then(|| Matrix::new(&after[..n * hidden], n, hidden));
            let gates = self.gates(1, projected, state_after, gates);
            let state = &mut before[frame * n * hidden..];
            advance(hidden, gates, cells, state, hidden);
        }
    }
}

impl Pose {
    /// Gates of the first layer in one direction: those of the projected input, plus those of the previous state.
    fn gates<'g>(
        &self,
        direction: usize,
        projected: &'g [f32],
        state: Option<Matrix<'_>>,
        gates: &'g mut [f32],
    ) -> &'g [f32] {
        let Some(state) = state else { return projected };
        self.recurrent[direction].product(state, Onto::Rows(projected), gates);
        gates
    }
}

/// One row per window, at frame `frame` of each.
fn of_windows<'f>(frames: &'f Frames, frame: usize, windows: &Range<usize>, width: usize) -> &'f [f32] {
    &frames.from(frame, windows.end * width)[windows.start * width..]
}
