//! Adds light touches to training windows of the causal network.
//!
//! The protocol presses firmly and briefly: nearly every low and steady reading in its sessions is a residue of pose, so a
//! network trained on them alone takes a light touch that is held for a residue too. The taxels of an adaptive model
//! have their artifact removed, so a touch adds to them: a window in the air, with the residues that it has, plus a
//! scaled-down window with a touch is a window with a light touch, and its force is known.

use super::dataset::Batch;
use super::random::{Random, Stream};

/// Forces that a touch is scaled down to, gF: log-uniform between these.
const FORCES_GF: (f32, f32) = (2.5, 40.0);

/// Touches that are scaled down are at least this firm, so that their own residues become small.
const FIRM_GF: f32 = 40.0;

/// Replaces a share of the windows in the air by windows with a light touch.
///
/// The same seed and step choose the same windows. Windows without a firm touch in the same part of the batch stay as
/// they are.
pub(super) fn add(batch: &mut Batch, share: f32, outputs: usize, seed: u64, step: u64) {
    let n = batch.n;
    if n == 0 || share <= 0.0 {
        return;
    }
    let length = batch.tactile.len() / n;
    let mut random = Random::new(seed, Stream::LightTouch(step));
    let last = (outputs - 1) * n; // of the outputs the last is the window's last frame
    let firm: Vec<usize> = (0..n).filter(|window| batch.truth_gf[last + window] >= FIRM_GF).collect();
    if firm.is_empty() {
        return;
    }
    let original = batch.clone();
    for window in 0..n {
        let (chance, which, level) = (random.unit(), random.unit(), random.unit());
        if !original.zero_load[window] || chance >= share {
            continue;
        }
        let touch = firm[((which * firm.len() as f32) as usize).min(firm.len() - 1)];
        let force = FORCES_GF.0 * (FORCES_GF.1 / FORCES_GF.0).powf(level);
        let scale = force / original.truth_gf[last + touch];
        let source = &original.tactile[touch * length..(touch + 1) * length];
        let target = &mut batch.tactile[window * length..(window + 1) * length];
        target.iter_mut().zip(source).for_each(|(sum, value)| *sum += scale * value);
        for output in 0..outputs {
            batch.truth_gf[output * n + window] =
                original.truth_gf[output * n + window].max(0.0) + scale * original.truth_gf[output * n + touch];
        }
        batch.zero_load[window] = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two frames of one taxel: a window in the air that reads 0.5, and one of 80 gF that reads 8.
    fn batch() -> Batch {
        Batch {
            n: 2,
            tactile: vec![0.5, 0.5, 4.0, 8.0],
            truth_gf: vec![0.0, 40.0, 0.0, 80.0],
            zero_load: vec![true, false],
            ..Batch::default()
        }
    }

    #[test]
    fn a_window_in_the_air_gets_a_share_of_a_touch_and_the_same_share_of_its_force() {
        let (before, mut after) = (batch(), batch());
        add(&mut after, 1.0, 2, 7, 3);
        let scale = (after.tactile[1] - 0.5) / 8.0;
        assert!((2.5 / 80.0..=0.5).contains(&scale), "{scale}");
        assert!((after.tactile[0] - (0.5 + 4.0 * scale)).abs() < 1e-6);
        assert!((after.truth_gf[0] - 40.0 * scale).abs() < 1e-5 && (after.truth_gf[2] - 80.0 * scale).abs() < 1e-5);
        assert_eq!(after.zero_load, [false, false]);
        assert_eq!((&after.tactile[2..], after.truth_gf[1], after.truth_gf[3]), (&before.tactile[2..], 40.0, 80.0));
        let mut again = batch();
        add(&mut again, 1.0, 2, 7, 3);
        assert_eq!(again, after);
    }

    #[test]
    fn nothing_changes_without_a_share_or_a_touch_to_scale() {
        let mut after = batch();
        add(&mut after, 0.0, 2, 7, 3);
        assert_eq!(after, batch());
        let light = Batch { truth_gf: vec![0.0, 20.0, 0.0, 39.0], ..batch() };
        let mut after = light.clone();
        add(&mut after, 1.0, 2, 7, 3);
        assert_eq!(after, light);
    }
}
