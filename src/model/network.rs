//! The paper's network, computed here over frames that windows share.
//!
//! What depends on a frame alone is computed once a frame: encoding of the pose, input projections of the first LSTM
//! layer, taps of the convolutions, and the interior of the convolutions, which is the same in every window that has it.
//! What a window has of its own is computed once a window: the few frames of every convolution that see its zero padding,
//! and the recurrences, which start anew in it. Those run over many windows at once: window `i` at its frame `k` reads
//! frame `i + k`.
//!
//! A window's force comes out the same, bit by bit, whichever windows are beside it.

mod dense;
mod pose;
mod touch;

use macerator::AutoArch;

use super::paper::{self, DILATIONS, Paper};
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

/// Forces of consecutive windows, one each.
#[derive(Debug, Default)]
pub(super) struct Outputs {
    pub(super) force: Vec<f32>,
    /// Empty where the network has no base.
    pub(super) base: Vec<f32>,
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
            touch: Touch::new(&paper.convolutions),
            pose: paper.pose.as_ref().map(Pose::new),
            head,
        })
    }

    /// Runs all windows of some frames, each a frame after the one before it.
    ///
    /// # Shapes
    /// `tactile`: `[frames, taxels]`, `pose`: `[frames, joints]`, with at least as many frames as a window has.
    pub(super) fn run(&self, tactile: &[f32], pose: &[f32], out: &mut Outputs) {
        let n_frames = tactile.len() / self.n_taxels;
        let n_windows = (n_frames + 1).saturating_sub(self.window);
        debug_assert_eq!((tactile.len(), pose.len()), (n_frames * self.n_taxels, n_frames * self.n_joints));
        let touch = self.touch.run(tactile, self.window, n_windows);
        let pose = self.pose.as_ref().map(|branch| branch.run(pose, self.window, n_windows, BLOCK));
        out.force.clear();
        out.base.clear();
        match (&self.head, pose) {
            (Head::Residual { base, residual }, Some(pose)) => {
                out.base = base.run(&touch);
                let residual = residual.run(&fused(&touch, &pose, n_windows, true));
                out.force.extend(out.base.iter().zip(residual).map(|(base, residual)| base - residual));
            }
            (Head::Fused(decoder), Some(pose)) => out.force = decoder.run(&fused(&touch, &pose, n_windows, false)),
            (Head::Touch(decoder) | Head::Fused(decoder) | Head::Residual { base: decoder, .. }, _) => {
                out.force = decoder.run(&touch);
            }
        }
    }
}

/// Touch and pose of each window side by side, and their product where it is asked for.
fn fused(touch: &[f32], pose: &[f32], n_windows: usize, with_product: bool) -> Vec<f32> {
    let width = touch.len() / n_windows.max(1);
    let mut rows = Vec::with_capacity((if with_product { 3 } else { 2 }) * touch.len());
    for (touch, pose) in touch.chunks_exact(width.max(1)).zip(pose.chunks_exact(width.max(1))) {
        rows.extend_from_slice(touch);
        rows.extend_from_slice(pose);
        if with_product {
            rows.extend(touch.iter().zip(pose).map(|(touch, pose)| touch * pose));
        }
    }
    rows
}

/// Runs a loop with all vector instructions that the machine has.
#[inline(always)]
fn vectorized(run: impl FnOnce()) {
    AutoArch::new().dispatch(run);
}
