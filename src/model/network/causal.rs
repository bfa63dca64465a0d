//! The causal network of adaptive models: convolutions over time without padding.
//!
//! All its values depend on frames, not on windows, so each is computed once: a new frame costs one column per layer.

use tactile_pose_fusion_kernels::elementwise::{rectify, rectify_onto, vectorized};
use tactile_pose_fusion_kernels::matrix::Matrix;
use tactile_pose_fusion_kernels::packed::{Onto, Packed};

use super::dense::Decoder;
use super::frames::Frames;
use super::sized;
use crate::fusion::Forces;
use crate::model::causal;
use crate::model::paper::TAPS;

/// The network. Its weights are laid out for matrix products over many frames.
#[derive(Debug)]
pub(super) struct Causal {
    n_columns: usize,
    scales: [f32; 2],
    /// Frames at the beginning of a window that its force doesn't depend on.
    n_unseen: usize,
    layers: Vec<Layer>,
    force: Decoder,
    touch: Decoder,
}

/// Weights of a convolution. Each tap is a matrix `[inputs, outputs]`.
#[derive(Debug)]
struct Layer {
    taps: [Packed; TAPS],
    bias: Vec<f32>,
    dilation: usize,
    adds_input: bool,
}

impl Layer {
    /// Number of earlier frames that an output depends on.
    fn reach(&self) -> usize {
        (TAPS - 1) * self.dilation
    }
}

/// Inputs of the layers, kept for the most recent frames.
#[derive(Debug, Default)]
pub(super) struct Known {
    /// Per layer, `[frames, lanes, inputs]`.
    inputs: Vec<Frames>,
    n_lanes: usize,
    /// Frames that are still to be skipped.
    n_unseen: usize,
}

/// Buffers of a call.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    rows: Vec<f32>,
    hidden: Vec<f32>,
}

impl Causal {
    pub(super) fn new(causal: &causal::Causal) -> Self {
        let layer = |layer: &causal::Layer| Layer {
            taps: std::array::from_fn(|tap| {
                let of_tap: Vec<f32> = layer.dense.weight.iter().skip(tap).step_by(TAPS).copied().collect();
                Packed::new(Matrix::new(&of_tap, layer.dense.dims[0], layer.dense.dims[1]).transposed())
            }),
            bias: layer.dense.bias.clone(),
            dilation: layer.dilation,
            adds_input: layer.adds_input,
        };
        Causal {
            n_columns: causal.n_columns,
            scales: causal.scales,
            n_unseen: causal.window - causal.n_seen(),
            layers: causal.layers.iter().map(layer).collect(),
            force: Decoder::new(&causal.force),
            touch: Decoder::new(&causal.touch),
        }
    }

    /// Forgets all frames. The next call of `run` brings `n_frames` frames of `n_lanes` lanes, later calls one frame
    /// each.
    pub(super) fn begin(&self, known: &mut Known, n_lanes: usize, n_frames: usize) {
        known.inputs.resize_with(self.layers.len(), Frames::default);
        (known.n_lanes, known.n_unseen) = (n_lanes, self.n_unseen);
        let mut room = n_frames - self.n_unseen;
        let mut width = 2 * self.n_columns;
        for (layer, frames) in self.layers.iter().zip(&mut known.inputs) {
            frames.reset(n_lanes * width, room);
            (room, width) = (room - layer.reach(), layer.bias.len());
        }
    }

    /// Adds new frames and runs the first `n` windows.
    ///
    /// # Shapes
    /// `tactile`: `[frames, lanes, columns]`.
    pub(super) fn run(&self, known: &mut Known, tactile: &[f32], n: usize, scratch: &mut Scratch, out: &mut Forces) {
        let Known { inputs, n_lanes, n_unseen } = known;
        let Scratch { rows, hidden } = scratch;
        let width = *n_lanes * self.n_columns;
        let tactile = &tactile[std::mem::take(n_unseen) * width..];
        let n_new = tactile.len() / width.max(1);
        let Some((first, rest)) = inputs.split_first_mut() else { return };
        let place = first.push(n_new);
        self.both(tactile, place);
        let mut input: &mut Frames = first;
        let mut n_new = n_new;
        let mut rest = rest.iter_mut();
        for layer in &self.layers {
            // Until the first frame is replaced, there is an output for every frame with enough frames before it; later
            // for the newest one.
            let n_out = n_new.min(input.len() - layer.reach());
            let from = input.len() - layer.reach() - n_out;
            match rest.next() {
                Some(next) => {
                    layer.run(input, from, *n_lanes, next.push(n_out));
                    input = next;
                }
                None => layer.run(input, from, *n_lanes, sized(rows, n_out * *n_lanes * layer.bias.len())),
            }
            n_new = n_out;
        }
        out.base.clear();
        let rows = &rows[..n * self.layers.last().map_or(0, |layer| layer.bias.len())];
        self.force.run(rows, n, hidden, &mut out.force);
        self.touch.run(rows, n, hidden, &mut out.touch);
        out.touch.iter_mut().for_each(|odds| *odds = sigmoid(*odds));
    }

    /// Scaled taxels, and squashed ones beside them: `[rows, taxels]` to `[rows, 2 taxels]`.
    fn both(&self, tactile: &[f32], out: &mut [f32]) {
        let ([coarse, fine], width) = (self.scales, self.n_columns);
        vectorized(|| {
            for (taxels, both) in tactile.chunks_exact(width).zip(out.chunks_exact_mut(2 * width)) {
                let (scaled, squashed) = both.split_at_mut(width);
                for ((value, scaled), squashed) in taxels.iter().zip(scaled).zip(squashed) {
                    *scaled = value / coarse;
                    let fine = value / fine;
                    *squashed = fine / (fine.abs() + 1.0);
                }
            }
        });
    }
}

impl Layer {
    /// Computes `[frames, lanes, outputs]`. `from` is the frame of the first output's oldest tap.
    fn run(&self, input: &Frames, from: usize, n_lanes: usize, out: &mut [f32]) {
        let n_out = self.bias.len();
        let n_in = input.width() / n_lanes;
        let rows = out.len() / n_out;
        let mut onto = Onto::Row(&self.bias);
        for (tap, weight) in self.taps.iter().enumerate() {
            let seen = input.from(from + tap * self.dilation, rows * n_in);
            weight.product(Matrix::new(seen, rows, n_in), std::mem::replace(&mut onto, Onto::Out), out);
        }
        let kept = input.from(from + self.reach(), rows * n_in);
        match self.adds_input {
            true => rectify_onto(out, kept),
            false => rectify(out),
        }
    }
}

fn sigmoid(odds: f32) -> f32 {
    1.0 / (1.0 + (-odds).exp())
}
