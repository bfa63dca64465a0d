//! Windows assembled for one step.

use super::{Dataset, WindowIdx};

/// Windows with their truth, each tensor contiguous.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Batch {
    /// Number of windows.
    pub n: usize,
    /// `[N, L, T]`
    pub tactile: Vec<f32>,
    /// `[N, L, P]`, rad; empty for a network without pose.
    pub pose: Vec<f32>,
    /// `[outputs, N]`, gF, at the last frames; `[N]` for a single output.
    pub truth_gf: Vec<f32>,
    /// `[outputs, N, 2]`, gF: the tangential force at the same frames; empty for a truth of one axis.
    pub tangential_gf: Vec<f32>,
    /// `[N]`: true if no frame of the window is loaded.
    pub zero_load: Vec<bool>,
    /// `[L, N, T]`: target of the auxiliary decoder, zero if a window is loaded. Empty if it was not requested.
    pub artifact: Vec<f32>,
}

/// Smooths a window over time and subtracts its first frame: the net change without noise, drift and mounting.
///
/// The Gaussian is cut off at four sigmas, and the window is mirrored at its ends (each edge frame twice).
///
/// # Shapes
/// `window` and the result: `[L, T]` row-major.
pub fn smoothed_change(window: &[f32], n_taxels: usize, sigma_frames: f32) -> Vec<f32> {
    let frames = window.len() / n_taxels.max(1);
    let kernel = gaussian(sigma_frames);
    let mut out = vec![0.0; window.len()];
    for (frame, row) in out.chunks_exact_mut(n_taxels.max(1)).enumerate() {
        for (offset, weight) in kernel.iter().enumerate() {
            let source = mirrored(frame as isize + offset as isize - (kernel.len() / 2) as isize, frames as isize);
            let source = &window[source * n_taxels..(source + 1) * n_taxels];
            row.iter_mut().zip(source).for_each(|(sum, value)| *sum += weight * value);
        }
    }
    let first = out.get(..n_taxels).unwrap_or_default().to_vec();
    for row in out.chunks_exact_mut(n_taxels.max(1)) {
        row.iter_mut().zip(&first).for_each(|(value, first)| *value -= first);
    }
    out
}

/// Weights of an odd number of frames, with sum 1.
fn gaussian(sigma: f32) -> Vec<f32> {
    let radius = (4.0 * sigma + 0.5) as i32;
    let weight = |offset: i32| if sigma > 0.0 { (-0.5 * (offset as f32 / sigma).powi(2)).exp() } else { 1.0 };
    let weights: Vec<f32> = (-radius..=radius).map(weight).collect();
    let sum: f32 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}

/// An index beyond the ends, mirrored: d c b a | a b c d | d c b a.
fn mirrored(idx: isize, len: isize) -> usize {
    let folded = idx.rem_euclid(2 * len);
    (if folded < len { folded } else { 2 * len - 1 - folded }) as usize
}

pub(super) fn assemble(dataset: &Dataset, windows: &[WindowIdx], smoothing_frames: Option<f32>) -> Batch {
    let (length, n_taxels) = (dataset.spec.window, dataset.n_taxels());
    let n_joints = if dataset.spec.needs_pose { dataset.n_joints() } else { 0 };
    let n = windows.len();
    let mut batch = Batch {
        n,
        tactile: Vec::with_capacity(n * length * n_taxels),
        pose: Vec::with_capacity(n * length * n_joints),
        truth_gf: Vec::with_capacity(n),
        tangential_gf: Vec::new(),
        zero_load: Vec::with_capacity(n),
        artifact: vec![0.0; if smoothing_frames.is_some() { n * length * n_taxels } else { 0 }],
    };
    for (window_idx, idx) in windows.iter().enumerate() {
        let frames = dataset.session(idx).frames();
        let range = dataset.frames_of(idx);
        let tactile = &frames.tactile[range.start * n_taxels..range.end * n_taxels];
        batch.tactile.extend_from_slice(tactile);
        batch.pose.extend_from_slice(&frames.pose[range.start * n_joints..range.end * n_joints]);
        let zero_load = frames.zero_load[range].iter().all(|zero_load| *zero_load);
        batch.zero_load.push(zero_load);
        if let (true, Some(sigma)) = (zero_load, smoothing_frames) {
            let target = smoothed_change(tactile, n_taxels, sigma);
            for (frame, row) in target.chunks_exact(n_taxels).enumerate() {
                let start = (frame * n + window_idx) * n_taxels;
                batch.artifact[start..start + n_taxels].copy_from_slice(row);
            }
        }
    }
    for back in (0..dataset.spec.outputs).rev() {
        let truth = |idx: &WindowIdx| dataset.session(idx).frames().truth_gf[idx.end as usize - back];
        batch.truth_gf.extend(windows.iter().map(truth));
        for idx in windows.iter().filter(|_| dataset.n_axes() == 3) {
            let start = 2 * (idx.end as usize - back);
            batch.tangential_gf.extend_from_slice(&dataset.session(idx).frames().tangential_gf[start..start + 2]);
        }
    }
    batch
}
