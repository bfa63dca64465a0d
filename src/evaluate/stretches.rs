//! Stretches of force over time where the judged series did best, worst, and as usual.

use std::collections::BTreeMap;

use sha2::{Digest, Sha256};

use crate::eval::{ScoredFrames, Scoring};
use crate::units::Stamp;

/// Length of a stretch, ns: long enough for a few touches and short enough to see their shape.
const LENGTH_NS: i64 = 20_000_000_000;

/// A stretch has this share of the frames that its length could hold, and this many of them in touch.
const FILLED: f64 = 0.9;
const IN_TOUCH: f64 = 0.1;

/// The frames of a stretch.
#[derive(Debug, Clone, Default)]
pub struct Stretch {
    /// Its rank by error: `Best`, `Median` or `Worst`.
    pub kind: &'static str,
    /// The session.
    pub session: String,
    /// The glove.
    pub glove: String,
    /// The stage and substage.
    pub stage: String,
    /// Mean absolute error over it.
    pub mae_gf: f64,
    /// From the beginning of the session's scored frames to that of the stretch, s.
    pub from_s: f64,
    /// `[frames]`: since its begin.
    pub seconds: Vec<f64>,
    /// `[frames]`.
    pub truth_gf: Vec<f64>,
    /// `[frames]`; empty where there is no base.
    pub base_gf: Vec<f64>,
    /// `[frames]`.
    pub force_gf: Vec<f64>,
    /// `[frames]`: by the true force.
    pub is_touch: Vec<bool>,
    /// `[frames]`: as estimated.
    pub contact: Vec<bool>,
}

/// Those of one session and region.
#[derive(Debug, Clone)]
pub(super) struct BestAndWorst {
    pub(super) best: Stretch,
    pub(super) median: Stretch,
    pub(super) worst: Stretch,
}

impl BestAndWorst {
    /// Of the frames of a session; `None` where no stretch is whole and holds touches.
    pub(super) fn of(frames: &ScoredFrames) -> Option<Self> {
        let mut found = candidates(frames);
        found.sort_by(|a, b| a.mae_gf.total_cmp(&b.mae_gf));
        let last = found.len().checked_sub(1)?;
        let (best, median) = (found[0].clone(), found[last / 2].clone());
        Some(BestAndWorst { best, median, worst: found.swap_remove(last) })
    }
}

/// Medians that are kept, for memory that does not grow with the number of sessions.
const MAX_MEDIANS: usize = 256;

/// Looks for them, session by session: it keeps the best and the worst of all, and the medians of some.
#[derive(Debug, Default)]
pub(super) struct Stretches {
    best: Option<Stretch>,
    /// Those with the lowest hashes: of many sessions always the same ones, whatever their order.
    medians: BTreeMap<[u8; 32], Stretch>,
    worst: Option<Stretch>,
}

impl Stretches {
    /// Takes those of a session and region.
    pub(super) fn handle(&mut self, found: BestAndWorst) {
        let BestAndWorst { best, median, worst } = found;
        self.medians.insert(hash(&median), median);
        if self.medians.len() > MAX_MEDIANS {
            self.medians.pop_last();
        }
        if self.best.as_ref().is_none_or(|known| best.mae_gf < known.mae_gf) {
            self.best = Some(best);
        }
        if self.worst.as_ref().is_none_or(|known| worst.mae_gf > known.mae_gf) {
            self.worst = Some(worst);
        }
    }

    /// The best of all, the median of the session whose median is in the middle, and the worst of all.
    pub(super) fn finish(self) -> Vec<Stretch> {
        let mut medians: Vec<Stretch> = self.medians.into_values().collect();
        medians.sort_by(|a, b| a.mae_gf.total_cmp(&b.mae_gf));
        let middle = medians.len().saturating_sub(1) / 2;
        let median = medians.into_iter().nth(middle);
        let kinds = [("Best", self.best), ("Median", median), ("Worst", self.worst)];
        kinds.into_iter().filter_map(|(kind, stretch)| Some(Stretch { kind, ..stretch? })).collect()
    }
}

fn hash(stretch: &Stretch) -> [u8; 32] {
    let mut hash = Sha256::new();
    for text in [&stretch.session, &stretch.glove, &stretch.stage] {
        hash.update(text);
    }
    for number in [stretch.mae_gf, stretch.from_s] {
        hash.update(number.to_le_bytes());
    }
    hash.finalize().into()
}

/// Every stretch of a session that is whole and holds touches.
fn candidates(frames: &ScoredFrames) -> Vec<Stretch> {
    let scoring = Scoring::default();
    let Some(&first) = frames.stamp.first() else { return Vec::new() };
    let mut found = Vec::new();
    let mut start = 0;
    while start < frames.stamp.len() {
        let from = frames.stamp[start];
        let by_length = start + frames.stamp[start..].partition_point(|stamp| stamp.nanos_since(from) < LENGTH_NS);
        let resumed = frames.resumes.iter().copied().find(|resumed| *resumed > start).unwrap_or(frames.stamp.len());
        let range = start..by_length.min(resumed);
        start = range.end.max(start + 1);
        let known =
            || range.clone().filter(|idx| frames.truth_gf[*idx].is_finite() && frames.estimate_gf[*idx].is_some());
        let (n, touches) = (known().count(), known().filter(|idx| scoring.is_touch(frames.truth_gf[*idx])).count());
        let possible = expected_frames(frames);
        if (n as f64) < FILLED * possible || (touches as f64) < IN_TOUCH * n as f64 {
            continue;
        }
        let error = |idx: usize| (frames.estimate_gf[idx].unwrap_or(f64::NAN) - frames.truth_gf[idx]).abs();
        let mae_gf = known().map(error).sum::<f64>() / n as f64;
        found.push(stretch(frames, range, first, mae_gf));
    }
    found
}

/// Frames that a stretch would have, were none missing.
fn expected_frames(frames: &ScoredFrames) -> f64 {
    let mut intervals: Vec<i64> = frames.stamp.windows(2).map(|pair| pair[1].nanos_since(pair[0])).collect();
    let middle = intervals.len() / 2;
    match intervals.is_empty() {
        true => 1.0,
        false => LENGTH_NS as f64 / (*intervals.select_nth_unstable(middle).1).max(1) as f64,
    }
}

fn stretch(frames: &ScoredFrames, range: std::ops::Range<usize>, first: Stamp, mae_gf: f64) -> Stretch {
    let scoring = Scoring::default();
    let from = frames.stamp[range.start];
    let known = |of: &[Option<f64>]| -> Vec<f64> {
        of.get(range.clone()).unwrap_or_default().iter().map(|force| force.unwrap_or(f64::NAN)).collect()
    };
    let origin = frames.origins.get(frames.origin[range.start]).cloned().unwrap_or_default();
    Stretch {
        kind: "",
        session: origin.session,
        glove: origin.glove,
        stage: format!("stage {}, {}", origin.stage, origin.substage),
        mae_gf,
        from_s: from.nanos_since(first) as f64 / 1e9,
        seconds: frames.stamp[range.clone()].iter().map(|stamp| stamp.nanos_since(from) as f64 / 1e9).collect(),
        truth_gf: frames.truth_gf[range.clone()].to_vec(),
        base_gf: known(&frames.base_gf),
        force_gf: known(&frames.estimate_gf),
        is_touch: frames.truth_gf[range.clone()].iter().map(|truth| scoring.is_touch(*truth)).collect(),
        contact: frames.contact[range.clone()].to_vec(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::Origin;

    /// A session of stretches, one after the other, each with this error.
    fn session(name: &str, errors: &[f64]) -> ScoredFrames {
        let n = errors.len() * 2000;
        ScoredFrames {
            stamp: (0..n as i64).map(|idx| Stamp(idx * 10_000_000)).collect(),
            truth_gf: (0..n).map(|idx| if idx % 200 < 100 { 100.0 } else { 0.0 }).collect(),
            estimate_gf: (0..n)
                .map(|idx| Some(errors[idx / 2000] + if idx % 200 < 100 { 100.0 } else { 0.0 }))
                .collect(),
            contact: vec![false; n],
            pose_age_ns: vec![None; n],
            origin: vec![0; n],
            origins: vec![Origin { session: name.to_owned(), ..Origin::default() }],
            ..ScoredFrames::default()
        }
    }

    #[test]
    fn the_best_the_middle_and_the_worst_are_found_among_all_sessions() {
        let mut stretches = Stretches::default();
        for (name, errors) in [("a", [5.0, 1.0, 9.0]), ("b", [6.0, 30.0, 2.0]), ("c", [20.0, 21.0, 22.0])] {
            BestAndWorst::of(&session(name, &errors)).into_iter().for_each(|found| stretches.handle(found));
        }
        let found = stretches.finish();
        let told: Vec<_> = found.iter().map(|one| (one.kind, one.session.as_str(), one.mae_gf, one.from_s)).collect();
        assert_eq!(told, [("Best", "a", 1.0, 20.0), ("Median", "b", 6.0, 0.0), ("Worst", "b", 30.0, 20.0)]);
    }

    #[test]
    fn of_many_sessions_the_middle_is_found_in_bounded_memory_whatever_their_order() {
        let of = |idx: usize| {
            let stretch = |mae_gf: f64| Stretch { session: format!("{idx}"), mae_gf, ..Stretch::default() };
            let mae_gf = (idx * 7 % 1000) as f64;
            BestAndWorst { best: stretch(mae_gf - 1.0), median: stretch(mae_gf), worst: stretch(mae_gf + 1.0) }
        };
        let found = |order: &mut dyn Iterator<Item = usize>| {
            let mut stretches = Stretches::default();
            order.for_each(|idx| stretches.handle(of(idx)));
            assert_eq!(stretches.medians.len(), MAX_MEDIANS);
            stretches.finish().iter().map(|one| (one.kind, one.session.clone(), one.mae_gf)).collect::<Vec<_>>()
        };
        let forwards = found(&mut (0..1000));
        assert_eq!(forwards, found(&mut (0..1000).rev()));
        let [best, median, worst] = forwards.as_slice() else { panic!("{forwards:?}") };
        assert_eq!((best.2, worst.2), (-1.0, 1000.0));
        assert!((median.2 - 500.0).abs() < 100.0, "{median:?}");
    }

    #[test]
    fn a_stretch_spans_no_frames_that_were_left_out_and_is_whole() {
        let mut frames = session("a", &[1.0, 2.0]);
        frames.resumes = vec![0, 1000];
        let found = candidates(&frames);
        assert_eq!(found.len(), 1, "half a stretch before the cut, one behind it, half of one at the end");
        assert_eq!((found[0].from_s, found[0].seconds.len()), (10.0, 2000));
    }
}
