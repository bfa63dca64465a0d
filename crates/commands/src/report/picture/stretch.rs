//! The part of a session that a picture shows.

use std::ops::Range;

use tactile_pose_fusion::eval::{ScoredFrames, Scoring};
use tactile_pose_fusion::units::Stamp;

/// Length of the stretch that is shown of one region, and of several, s. In the longer one, more than one finger is touched.
const SPAN_S: f64 = 25.0;
const HAND_SPAN_S: f64 = 40.0;

/// Upper limit of the force axis, gF: a firm press must not make light touches invisible.
const CUT_GF: f64 = 100.0;

/// A region counts as touched if it is touched in one of so many frames of a stretch: for 1 s of [`HAND_SPAN_S`].
const FRAMES_A_TOUCH: usize = 40;

/// The frames that are shown, and the limits of the force axis.
pub(super) struct Stretch {
    frames: Range<usize>,
    start: Stamp,
    pub(super) span_s: f64,
    /// Forces beyond the limits are drawn at the edge.
    pub(super) lowest_gf: f64,
    pub(super) highest_gf: f64,
}

impl Stretch {
    /// The stretch that shows most of a session, by the true force and the contact of its regions.
    pub(super) fn telling(regions: &[ScoredFrames]) -> Self {
        let span_s = if regions.len() > 1 { HAND_SPAN_S } else { SPAN_S };
        let frames = telling_frames(regions, span_s);
        let start = regions.first().and_then(|region| region.stamp.get(frames.start)).copied().unwrap_or_default();
        let truth = regions.iter().filter_map(|region| region.truth_gf.get(frames.clone())).flatten();
        let highest = truth.filter(|force| force.is_finite()).fold(30.0_f64, |most, force| most.max(*force));
        let highest_gf = (1.3 * highest).min(CUT_GF);
        Stretch { frames, start, span_s, lowest_gf: -0.2 * highest_gf, highest_gf }
    }

    /// A value of each frame over seconds from the start.
    pub(super) fn points<T>(&self, frames: &ScoredFrames, value: impl Fn(usize) -> T) -> Vec<(f64, T)> {
        let known = self.frames.clone().filter(|idx| *idx < frames.stamp.len());
        known.map(|idx| (frames.stamp[idx].nanos_since(self.start) as f64 * 1e-9, value(idx))).collect()
    }
}

/// The stretch in which most regions are touched, and among those the one in which contact is most often wrong; of stretches that
/// hold touch and air.
fn telling_frames(regions: &[ScoredFrames], span_s: f64) -> Range<usize> {
    let Some(stamps) = regions.iter().map(|region| &region.stamp).min_by_key(|stamps| stamps.len()) else {
        return 0..0;
    };
    let n = stamps.len();
    let scoring = Scoring::default();
    let is_touch = |region: &ScoredFrames, idx: usize| scoring.is_touch(region.truth_gf[idx]);
    let span_ns = (span_s * 1e9) as i64;
    let end_of =
        |start: usize| start + stamps[start..].partition_point(|stamp| stamp.nanos_since(stamps[start]) < span_ns);
    let n_whole = end_of(0);
    let mut best = (0..n.min(1), (0, 0));
    for start in (0..n).step_by(100) {
        let end = end_of(start);
        let n_frames = end - start;
        let n_touch_of = |region: &&ScoredFrames| (start..end).filter(|&idx| is_touch(region, idx)).count();
        let n_touched = regions.iter().filter(|region| n_touch_of(region) * FRAMES_A_TOUCH >= n_whole).count();
        let n_touch = (start..end).filter(|&idx| regions.iter().any(|region| is_touch(region, idx))).count();
        let is_wrong = |region: &ScoredFrames, idx: usize| region.contact[idx] != is_touch(region, idx);
        let wrong = |region: &ScoredFrames| (start..end).filter(|&idx| is_wrong(region, idx)).count();
        let telling = (n_touched, regions.iter().map(wrong).sum::<usize>());
        if (n_frames / 5..=n_frames * 4 / 5).contains(&n_touch) && telling >= best.1 {
            best = (start..end, telling);
        }
    }
    let (frames, (_, n_wrong)) = best;
    if n_wrong > 0 { frames } else { 0..n_whole }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of a minute at 100 Hz, touched for these seconds; contact is told at these.
    fn frames(touched: Range<usize>, told: Range<usize>) -> ScoredFrames {
        let seconds = |idx: usize| idx / 100;
        ScoredFrames {
            stamp: (0..6_000).map(|idx| Stamp(idx * 10_000_000)).collect(),
            truth_gf: (0..6_000).map(|idx| if touched.contains(&seconds(idx)) { 20.0 } else { f64::NAN }).collect(),
            contact: (0..6_000).map(|idx| told.contains(&seconds(idx))).collect(),
            ..ScoredFrames::default()
        }
    }

    #[test]
    fn of_a_hand_the_stretch_is_shown_in_which_most_fingers_touch() {
        let most_wrong = frames(0..8, 0..30);
        let alone = telling_frames(std::slice::from_ref(&most_wrong), 25.0);
        assert!(alone.start < 600, "{alone:?}");
        let hand = [most_wrong, frames(38..42, 0..0), frames(44..50, 44..52)];
        let shown = telling_frames(&hand, 25.0);
        assert!(shown.contains(&4_100) && shown.contains(&4_450), "both touches: {shown:?}");
        assert_eq!(shown.len(), 2_500);
        assert_eq!(telling_frames(&[], 25.0), 0..0);
        assert_eq!(telling_frames(&[ScoredFrames::default()], 25.0), 0..0);
    }
}
