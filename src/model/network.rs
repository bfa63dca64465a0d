//! The paper's network, and the causal one of adaptive models, computed here over frames that windows share, in one call or from call to call.
//!
//! What depends on a frame alone is computed once a frame: encoding of the pose, input projections of the first LSTM
//! layer, taps of the convolutions, and the interior of the convolutions, which is the same in every window that has it.
//! What a window has of its own is computed once a window: the few frames of every convolution that see its zero padding,
//! and the recurrences, which start anew in it. Those run over many windows at once.
//!
//! Windows come in two ways. In a stretch, window `i` at its frame `k` reads frame `i + k`. In lanes that share nothing,
//! it reads frame `k` of lane `i`, and when the same lanes come again a frame later, only that frame is computed. Frames of
//! lanes lie side by side, so that both ways what windows read at one of their frames is one block of rows.
//!
//! A window's force comes out the same, bit by bit, whichever way it comes and whichever windows are beside it.

mod causal;
mod dense;
mod frames;
pub(super) mod lanes;
mod pose;
mod touch;

use macerator::AutoArch;

use super::causal as found;
use super::paper::{self, DILATIONS, Paper};
use crate::fusion::Forces;
use dense::Decoder;
use pose::Pose;
use touch::Touch;

/// Frames at each end of a window whose last convolution sees the padding: the sum of all dilations.
const REACH: usize = DILATIONS[0] + DILATIONS[1] + DILATIONS[2] + DILATIONS[3];

/// Windows that are taken through the recurrences together: their states stay in a cache of 1 MiB.
const BLOCK: usize = 48;

/// The network, its weights laid out for products of many frames.
#[derive(Debug)]
pub(super) struct Network {
    window: usize,
    n_taxels: usize,
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

/// What depends on frames alone, of the frames that came last.
#[derive(Debug, Default)]
pub(super) struct Known {
    touch: touch::Known,
    pose: pose::Known,
    causal: causal::Known,
}

/// Values computed again for every window.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    touch: touch::Scratch,
    pose: pose::Scratch,
    causal: causal::Scratch,
    fused: Vec<f32>,
    hidden: Vec<f32>,
}

impl Network {
    /// The network with these weights; `None` where windows are too short to have an interior.
    pub(super) fn new(paper: &Paper, n_taxels: usize, n_joints: usize) -> Option<Self> {
        let head = match &paper.head {
            paper::Head::Touch(decoder) => Head::Touch(Decoder::new(decoder)),
            paper::Head::Fused(decoder) => Head::Fused(Decoder::new(decoder)),
            paper::Head::Residual { base, residual } => {
                Head::Residual { base: Decoder::new(base), residual: Decoder::new(residual) }
            }
        };
        (paper.window > 2 * REACH).then(|| Network {
            window: paper.window,
            n_taxels,
            n_joints: paper.pose.as_ref().map_or(0, |_| n_joints),
            body: Body::Paper(Box::new(PaperBody {
                window: paper.window,
                touch: Touch::new(&paper.convolutions),
                pose: paper.pose.as_ref().map(Pose::new),
                head,
            })),
        })
    }

    /// The causal network with these weights.
    pub(super) fn causal(found: &found::Causal) -> Self {
        let body = Body::Causal(Box::new(causal::Causal::new(found)));
        Network { window: found.window, n_taxels: found.n_taxels, n_joints: 0, body }
    }

    /// Forgets all frames; those that follow are `n_frames`, each of so many lanes, and then one at a time.
    pub(super) fn begin(&self, known: &mut Known, n_lanes: usize, n_frames: usize) {
        match &self.body {
            Body::Paper(paper) => {
                paper.touch.begin(&mut known.touch, n_lanes, n_frames);
                paper.pose.iter().for_each(|branch| branch.begin(&mut known.pose, n_lanes, n_frames));
            }
            Body::Causal(causal) => causal.begin(&mut known.causal, n_lanes, n_frames),
        }
    }

    /// Takes in new frames, and runs the first `n` windows of those that are known: one a lane, or in a single lane each a
    /// frame after the one before it.
    ///
    /// # Shapes
    /// `tactile`: `[frames, lanes, taxels]`, `pose`: `[frames, lanes, joints]`; `out.base` stays empty where the network
    /// has no base, and `out.touch` where it has none.
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

/// Touch and pose of each of `n` windows side by side, and their product where it is asked for.
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

/// A buffer at the size that is needed; what it holds is not said.
fn sized(buffer: &mut Vec<f32>, n: usize) -> &mut [f32] {
    buffer.resize(n, 0.0);
    buffer
}

/// The rectifier; what is not a number stays so, which `f32::max` would hide.
#[inline(always)]
fn rectified(value: f32) -> f32 {
    if value < 0.0 { 0.0 } else { value }
}

/// Runs a loop with all vector instructions that the machine has.
#[inline(always)]
fn vectorized(run: impl FnOnce()) {
    AutoArch::new().dispatch(run);
}
