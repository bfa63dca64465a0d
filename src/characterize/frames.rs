//! Frames of one region in one session, and values derived from them for all analyses.

use std::ops::Range;

use super::spread::median;

/// Data of one session for one region, frame by frame.
///
/// # Shapes
/// n frames, T taxels of the region, J joints of the recording; the same T and J in all sessions.
#[derive(Debug, Clone, Default)]
pub struct SessionFrames {
    /// Its name in the results.
    pub name: String,
    /// `[n]`: since the first frame, s.
    pub time_s: Vec<f64>,
    /// `[n]`: changes at each gap in the frames.
    pub stretch: Vec<u32>,
    /// `[n, T]` row-major, baseline subtracted, in the sensor's own unit.
    pub tactile: Vec<f32>,
    /// `[n, J]` row-major, rad.
    pub pose: Vec<f32>,
    /// `[n]`: true if nothing touches the glove.
    pub in_air: Vec<bool>,
    /// `[n]`: tared true force, gF, NaN if unknown; empty without a force sensor.
    pub truth_gf: Vec<f64>,
    /// `[n]`: index into `poses` while an instructed pose or movement is taken up.
    pub instructed: Vec<Option<usize>>,
    /// Names of the instructed poses and movements.
    pub poses: Vec<String>,
    /// Tare of the force sensor over time: s since the first frame, gF.
    pub tare: Vec<(f64, f64)>,
}

/// A session with the derived values that every analysis needs.
#[derive(Debug)]
pub(super) struct Prepared<'a> {
    pub(super) frames: &'a SessionFrames,
    pub(super) n_taxels: usize,
    pub(super) n_joints: usize,
    /// Time between frames, s.
    pub(super) period_s: f64,
    /// `[n]`: sum of all taxels.
    pub(super) sum: Vec<f64>,
    /// Consecutive frames in the air.
    pub(super) in_air: Vec<Range<usize>>,
    /// Consecutive frames of any kind.
    pub(super) connected: Vec<Range<usize>>,
}

impl<'a> Prepared<'a> {
    pub(super) fn new(frames: &'a SessionFrames, n_taxels: usize, n_joints: usize) -> Self {
        let n = frames.time_s.len();
        let mut steps: Vec<f64> = frames.time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let sum = |row: &[f32]| row.iter().map(|reading| f64::from(*reading)).sum();
        Prepared {
            n_taxels,
            n_joints,
            period_s: median(&mut steps).filter(|step| *step > 0.0).unwrap_or(0.01),
            sum: frames.tactile.chunks_exact(n_taxels.max(1)).map(sum).collect(),
            in_air: runs(n, |a, b| frames.stretch[a] == frames.stretch[b], |idx| frames.in_air[idx]),
            connected: runs(n, |a, b| frames.stretch[a] == frames.stretch[b], |_| true),
            frames,
        }
    }

    /// Number of frames in a time, at least one.
    pub(super) fn n_in(&self, seconds: f64) -> usize {
        ((seconds / self.period_s).round() as usize).max(1)
    }

    /// A joint's angle at a frame, rad.
    pub(super) fn angle(&self, idx: usize, joint: usize) -> f64 {
        f64::from(self.frames.pose[idx * self.n_joints + joint])
    }

    /// A taxel's reading at a frame.
    pub(super) fn reading(&self, idx: usize, taxel: usize) -> f64 {
        f64::from(self.frames.tactile[idx * self.n_taxels + taxel])
    }

    /// The tared true force at a frame, gF, if known.
    pub(super) fn truth_gf(&self, idx: usize) -> Option<f64> {
        self.frames.truth_gf.get(idx).copied().filter(|force| force.is_finite())
    }

    /// `[n]` values, smoothed within each run of frames in the air and unchanged elsewhere.
    pub(super) fn smoothed_in_air(&self, values: &[f64], seconds: f64) -> Vec<f64> {
        let mut all = values.to_vec();
        for run in &self.in_air {
            all[run.clone()].copy_from_slice(&smoothed(&values[run.clone()], self.n_in(seconds)));
        }
        all
    }

    /// Time spent in the air, s.
    pub(super) fn in_air_s(&self) -> f64 {
        self.in_air.iter().map(|run| run.len() as f64 * self.period_s).sum()
    }
}

/// Runs of consecutive wanted indices up to `n`; `connects` must hold between each and the next.
pub(super) fn runs(
    n: usize,
    connects: impl Fn(usize, usize) -> bool,
    is_wanted: impl Fn(usize) -> bool,
) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for idx in (0..n).filter(|idx| is_wanted(*idx)) {
        match runs.last_mut() {
            Some(run) if run.end == idx && connects(idx - 1, idx) => run.end = idx + 1,
            _ => runs.push(idx..idx + 1),
        }
    }
    runs
}

/// Moving average without lag: the mean of each value with its neighbours on both sides.
///
/// Near the ends there are fewer neighbours, equally many on both sides.
pub(super) fn smoothed(values: &[f64], window: usize) -> Vec<f64> {
    let half = window / 2;
    let mut sums = Vec::with_capacity(values.len() + 1);
    sums.push(0.0);
    for value in values {
        sums.push(sums[sums.len() - 1] + value);
    }
    (0..values.len())
        .map(|idx| {
            let reach = half.min(idx).min(values.len() - 1 - idx);
            (sums[idx + reach + 1] - sums[idx - reach]) / (2 * reach + 1) as f64
        })
        .collect()
}

/// Increase of each value over `span` frames. The result is shorter than `values` by `span`, and empty if `values` is
/// too short. Element k belongs to the frame `k + span / 2`.
pub(super) fn changes(values: &[f64], span: usize) -> Vec<f64> {
    values.iter().zip(values.iter().skip(span)).map(|(from, to)| to - from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_end_where_frames_are_missing_or_unwanted() {
        let frames = SessionFrames {
            time_s: (0..8).map(f64::from).collect(),
            stretch: vec![1, 1, 1, 2, 2, 2, 2, 2],
            tactile: vec![1.0; 16],
            in_air: vec![true, true, true, true, true, false, true, true],
            ..SessionFrames::default()
        };
        let prepared = Prepared::new(&frames, 2, 0);
        assert_eq!(prepared.in_air, [0..3, 3..5, 6..8]);
        assert_eq!(prepared.connected, [0..3, 3..8]);
        assert_eq!((prepared.sum[0], prepared.n_in(3.2), prepared.n_in(0.0)), (2.0, 3, 1));
    }

    #[test]
    fn smoothing_moves_no_line_and_changes_tell_its_slope() {
        let line: Vec<f64> = (0..20).map(|k| 2.0 * f64::from(k)).collect();
        let smooth = smoothed(&line, 5);
        assert!(smooth.iter().zip(&line).all(|(a, b)| (a - b).abs() < 1e-12), "{smooth:?}");
        assert_eq!(changes(&line, 3), vec![6.0; 17]);
        assert!(changes(&line, 30).is_empty());
    }
}
