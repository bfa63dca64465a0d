//! Computes the paper's network, and the causal network of adaptive models, in the built-in code. Windows share the work on
//! common frames.
//!
//! Values that don't depend on the window are computed once per frame: the encoding of the pose, the input projections
//! of the first LSTM layer, the taps of the convolutions, and the interior of the convolutions, which is the same in
//! every window that contains it. The rest is computed once per window: the few frames of each convolution that see its
//! zero padding, and the recurrences, which start anew in each window. These run over many windows at once.
//!
//! Windows come in two layouts. In a stretch, windows overlap: frame `k` of window `i` is frame `i + k`. In lanes,
//! windows share nothing: frame `k` of window `i` is frame `k` of lane `i`. If the same lanes come again one frame
//! later, only the new frame is computed. The frames of all lanes are interleaved, so in both layouts the rows that the
//! windows read at frame `k` are contiguous.
//!
//! The force of a window has the same bits in both layouts, and for any other windows in the same call.

mod causal;
mod dense;
mod frames;
pub(super) mod lanes;
mod pose;
mod touch;

use super::causal as found;
use super::paper::{self, DILATIONS, Paper};
use crate::fusion::Forces;
use dense::Decoder;
use pose::Pose;
use touch::Touch;

/// Frames at each end of a window where the output of the last convolution depends on padding: the sum of all
/// dilations.
const REACH: usize = DILATIONS[0] + DILATIONS[1] + DILATIONS[2] + DILATIONS[3];

/// Windows that go through the recurrences together. Their states fit into a cache of 1 MiB.
const BLOCK: usize = 48;

/// The network. Its weights are laid out for matrix products over many frames.
#[derive(Debug)]
pub(super) struct Network {
    window: usize,
    n_columns: usize,
    n_joints: usize,
    body: Body,
}

#[derive(Debug)]
enum Body {
    Paper(Box<PaperBody>),
    Causal(Box<causal::Causal>),
}

#[derive(Debug)]
struct PaperBody {
    window: usize,
    touch: Touch,
    pose: Option<Pose>,
    head: Head,
}

#[derive(Debug)]
enum Head {
    Touch(Decoder),
    Fused(Decoder),
    Residual { base: Decoder, residual: Decoder },
}

/// Values per frame, kept for the most recent frames.
#[derive(Debug, Default)]
pub(super) struct Known {
    touch: touch::Known,
    pose: pose::Known,
    causal: causal::Known,
}

/// Buffers for values per window.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    touch: touch::Scratch,
    pose: pose::Scratch,
    causal: causal::Scratch,
    fused: Vec<f32>,
    hidden: Vec<f32>,
}

impl Network {
    /// Builds the network with these weights. `None` if the windows are too short to have an interior.
    pub(super) fn new(paper: &Paper, n_columns: usize, n_joints: usize) -> Option<Self> {
        let head = match &paper.head {
            paper::Head::Touch(decoder) => Head::Touch(Decoder::new(decoder)),
            paper::Head::Fused(decoder) => Head::Fused(Decoder::new(decoder)),
            paper::Head::Residual { base, residual } => {
                Head::Residual { base: Decoder::new(base), residual: Decoder::new(residual) }
            }
        };
        (paper.window > 2 * REACH).then(|| Network {
            window: paper.window,
            n_columns,
            n_joints: paper.pose.as_ref().map_or(0, |_| n_joints),
            body: Body::Paper(Box::new(PaperBody {
                window: paper.window,
                touch: Touch::new(&paper.convolutions),
                pose: paper.pose.as_ref().map(Pose::new),
                head,
            })),
        })
    }

    /// Builds the causal network with these weights.
    pub(super) fn causal(found: &found::Causal) -> Self {
        let body = Body::Causal(Box::new(causal::Causal::new(found)));
        Network { window: found.window, n_columns: found.n_columns, n_joints: 0, body }
    }

    /// Forgets all frames. The next call of `run` brings `n_frames` frames of `n_lanes` lanes, later calls one frame
    /// each.
    pub(super) fn begin(&self, known: &mut Known, n_lanes: usize, n_frames: usize) {
        match &self.body {
            Body::Paper(paper) => {
                paper.touch.begin(&mut known.touch, n_lanes, n_frames);
                paper.pose.iter().for_each(|branch| branch.begin(&mut known.pose, n_lanes, n_frames));
            }
            Body::Causal(causal) => causal.begin(&mut known.causal, n_lanes, n_frames),
        }
    }

    /// Adds new frames and runs the first `n` windows: one window per lane, or, with a single lane, windows that each
    /// start one frame after the one before.
    ///
    /// # Shapes
    /// `tactile`: `[frames, lanes, taxels]`, `pose`: `[frames, lanes, joints]`. `out.base` stays empty if the network
    /// has no base, `out.touch` if it has no touch output.
    pub(super) fn run(
        &self,
        known: &mut Known,
        (tactile, pose): (&[f32], &[f32]),
        n: usize,
        scratch: &mut Scratch,
        out: &mut Forces,
    ) {
        match &self.body {
            Body::Paper(paper) => paper.run(known, (tactile, pose), n, scratch, out),
            Body::Causal(causal) => causal.run(&mut known.causal, tactile, n, &mut scratch.causal, out),
        }
    }
}

impl PaperBody {
    fn run(
        &self,
        known: &mut Known,
        (tactile, pose): (&[f32], &[f32]),
        n: usize,
        scratch: &mut Scratch,
        out: &mut Forces,
    ) {
        let Scratch { touch, pose: posed, fused: rows, hidden, .. } = scratch;
        out.touch.clear();
        self.touch.run(&mut known.touch, tactile, self.window, n, touch);
        let touch = touch.highest.as_slice();
        let posed = match &self.pose {
            Some(branch) => {
                branch.run(&mut known.pose, pose, self.window, n, BLOCK, posed);
                Some(posed.last.as_slice())
            }
            None => None,
        };
        out.base.clear();
        match (&self.head, posed) {
            (Head::Residual { base, residual }, Some(pose)) => {
                base.run(touch, n, hidden, &mut out.base);
                fuse(touch, pose, n, true, rows);
                residual.run(rows, n, hidden, &mut out.force);
                out.force.iter_mut().zip(&out.base).for_each(|(force, base)| *force = base - *force);
            }
            (Head::Fused(decoder), Some(pose)) => {
                fuse(touch, pose, n, false, rows);
                decoder.run(rows, n, hidden, &mut out.force);
            }
            (Head::Touch(decoder) | Head::Fused(decoder) | Head::Residual { base: decoder, .. }, _) => {
                decoder.run(touch, n, hidden, &mut out.force);
            }
        }
    }
}

/// Concatenates touch and pose of each of `n` windows, and their product if `with_product`.
fn fuse(touch: &[f32], pose: &[f32], n: usize, with_product: bool, rows: &mut Vec<f32>) {
    let width = (touch.len() / n.max(1)).max(1);
    rows.clear();
    for (touch, pose) in touch.chunks_exact(width).zip(pose.chunks_exact(width)) {
        rows.extend_from_slice(touch);
        rows.extend_from_slice(pose);
        if with_product {
            rows.extend(touch.iter().zip(pose).map(|(touch, pose)| touch * pose));
        }
    }
}

/// Resizes a buffer. Its contents are unspecified.
fn sized(buffer: &mut Vec<f32>, n: usize) -> &mut [f32] {
    buffer.resize(n, 0.0);
    buffer
}
