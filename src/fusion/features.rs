//! The only builder of a model's input: live node, replay and training all go through here.

use std::num::NonZeroUsize;

use super::config::{RegionConfig, TactileSource};
use super::joints::PoseTrust;

/// Which taxels of a sample a region uses, and how a raw reading becomes a feature.
///
/// A feature is the reading's distance from its zero-load baseline, so positive means more pressure whichever way the
/// sensor counts.
#[derive(Debug, Clone, PartialEq)]
pub struct TaxelFeatures {
    taxels: Vec<usize>,
    sign: f32,
}

impl TaxelFeatures {
    /// The features of a region of a source.
    pub fn new(region: &RegionConfig, source: &TactileSource) -> Self {
        TaxelFeatures { taxels: region.taxels.clone(), sign: if source.inverted { -1.0 } else { 1.0 } }
    }

    /// Writes one frame of features.
    ///
    /// # Shapes
    /// `raw`, `baseline`: `[taxels of the source]`; `out`: `[taxels of the region]`.
    ///
    /// Returns whether all of them are finite; `out` is worthless when they aren't.
    pub fn write(&self, raw: &[f32], baseline: &[f32], out: &mut [f32]) -> bool {
        let mut finite = true;
        for (feature, &taxel_idx) in out.iter_mut().zip(&self.taxels) {
            *feature = self.sign * (raw[taxel_idx] - baseline[taxel_idx]);
            finite &= feature.is_finite();
        }
        finite
    }
}

/// The last `len` frames of a region, contiguous in memory so that a window is one slice.
///
/// Frames slide through a buffer of twice the length and move back to its front when they reach the end.
#[derive(Debug, Clone)]
pub struct FeatureWindow {
    len: usize,
    n_taxels: usize,
    n_joints: usize,
    end: usize,
    filled: usize,
    tactile: Vec<f32>,
    pose: Vec<f32>,
    pose_trust: Vec<PoseTrust>,
    n_held: usize,
    n_stale: usize,
    n_new: usize,
}

/// A full window, oldest frame first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewestWindow<'a> {
    /// `[window, taxels]`
    pub tactile: &'a [f32],
    /// `[window, joints]`, rad.
    pub pose: &'a [f32],
    /// Frames since the last window that was taken, which that one doesn't hold; may be more than the window has.
    pub n_new: usize,
}

impl FeatureWindow {
    /// An empty window of `len` frames.
    pub fn new(len: NonZeroUsize, n_taxels: usize, n_joints: usize) -> Self {
        let len = len.get();
        FeatureWindow {
            len,
            n_taxels,
            n_joints,
            end: 0,
            filled: 0,
            tactile: vec![0.0; 2 * len * n_taxels],
            pose: vec![0.0; 2 * len * n_joints],
            pose_trust: vec![PoseTrust::Stale; 2 * len],
            n_held: 0,
            n_stale: 0,
            n_new: 0,
        }
    }

    /// Forgets all frames.
    pub fn clear(&mut self) {
        (self.end, self.filled, self.n_held, self.n_stale) = (0, 0, 0, 0);
    }

    /// Appends a frame; the oldest one leaves a full window.
    ///
    /// # Shapes
    /// `tactile`: `[taxels]`; `pose`: `[joints]`, rad, finite even where it is stale.
    pub fn push(&mut self, tactile: &[f32], pose: &[f32], trust: PoseTrust) {
        if self.filled == self.len {
            let leaving = self.pose_trust[self.end - self.filled];
            self.n_held -= usize::from(leaving == PoseTrust::Held);
            self.n_stale -= usize::from(leaving == PoseTrust::Stale);
            self.filled -= 1;
        }
        if self.end == 2 * self.len {
            let from = self.end - self.filled;
            self.tactile.copy_within(from * self.n_taxels..self.end * self.n_taxels, 0);
            self.pose.copy_within(from * self.n_joints..self.end * self.n_joints, 0);
            self.pose_trust.copy_within(from..self.end, 0);
            self.end = self.filled;
        }
        self.tactile[self.end * self.n_taxels..(self.end + 1) * self.n_taxels].copy_from_slice(tactile);
        self.pose[self.end * self.n_joints..(self.end + 1) * self.n_joints].copy_from_slice(pose);
        self.pose_trust[self.end] = trust;
        self.n_held += usize::from(trust == PoseTrust::Held);
        self.n_stale += usize::from(trust == PoseTrust::Stale);
        self.end += 1;
        self.filled += 1;
        self.n_new += 1;
    }

    /// True if there are enough frames for an estimate.
    pub fn is_full(&self) -> bool {
        self.filled == self.len
    }

    /// How far the pose of all frames may be trusted: as that of the worst.
    pub fn pose_trust(&self) -> PoseTrust {
        match (self.n_stale, self.n_held) {
            (0, 0) => PoseTrust::Fresh,
            (0, _) => PoseTrust::Held,
            _ => PoseTrust::Stale,
        }
    }

    /// Takes the window, when it is full: the next one tells which of its frames are new.
    pub fn take(&mut self) -> NewestWindow<'_> {
        let (begin, n_new) = (self.end - self.filled, std::mem::take(&mut self.n_new));
        NewestWindow {
            tactile: &self.tactile[begin * self.n_taxels..self.end * self.n_taxels],
            pose: &self.pose[begin * self.n_joints..self.end * self.n_joints],
            n_new,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_always_holds_the_last_frames_oldest_first() {
        let mut window = FeatureWindow::new(NonZeroUsize::new(3).unwrap(), 2, 1);
        for k in 0..20 {
            let k = k as f32;
            window.push(&[k, -k], &[k / 2.0], PoseTrust::Fresh);
            if k < 2.0 {
                assert!(!window.is_full());
            } else {
                assert!(window.is_full());
                let newest = window.take();
                assert_eq!(newest.tactile, [k - 2.0, 2.0 - k, k - 1.0, 1.0 - k, k, -k]);
                assert_eq!(newest.pose, [(k - 2.0) / 2.0, (k - 1.0) / 2.0, k / 2.0]);
                assert_eq!(newest.n_new, if k < 3.0 { 3 } else { 1 });
            }
        }
        window.clear();
        assert!(!window.is_full());
    }

    #[test]
    fn a_window_is_trusted_as_the_worst_pose_in_it() {
        let mut window = FeatureWindow::new(NonZeroUsize::new(4).unwrap(), 1, 1);
        for k in 0..40 {
            let trust = |j: i32| match j {
                _ if j < 0 => PoseTrust::Fresh,
                _ if j % 9 == 0 => PoseTrust::Stale,
                _ if j % 5 == 0 => PoseTrust::Held,
                _ => PoseTrust::Fresh,
            };
            window.push(&[0.0], &[0.0], trust(k));
            assert_eq!(Some(window.pose_trust()), (k - 3..=k).map(trust).max(), "frame {k}");
        }
    }

    #[test]
    fn an_inverted_source_reads_positive_when_pressed() {
        let features = TaxelFeatures { taxels: vec![2, 0], sign: -1.0 };
        let mut out = [0.0; 2];
        assert!(features.write(&[90.0, 50.0, 70.0], &[100.0, 0.0, 100.0], &mut out));
        assert_eq!(out, [30.0, 10.0]);
        assert!(!features.write(&[f32::NAN, 50.0, 70.0], &[100.0, 0.0, 100.0], &mut out));
    }
}
