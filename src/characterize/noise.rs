//! Noise and faults of each taxel at rest.

use serde::Serialize;

use super::frames::Prepared;
use super::spread::{Spread, median};

/// Factor from the median absolute difference of two normal readings to the standard deviation of one.
const MEDIAN_TO_SD: f64 = 1.0 / (0.674_49 * std::f64::consts::SQRT_2);
/// A reading that stays at the end of a taxel's range for this many frames is saturated.
const MIN_STUCK: usize = 10;
/// Minimum fraction of the session for which it must be at the end.
const MIN_STUCK_SHARE: f64 = 1e-3;

/// Noise and faults of taxels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NoiseReport {
    /// `[T]`
    pub by_taxel: Vec<TaxelNoise>,
    /// Standard deviation of the noise, median over all taxels, units of the sensor.
    pub sd: Option<Spread>,
}

/// Noise and faults of one taxel.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TaxelNoise {
    /// Index within the region.
    pub taxel: usize,
    /// Standard deviation of its noise at rest in the air, units of the sensor; excludes slow drift.
    pub sd: Option<Spread>,
    /// Number of sessions in which it never changed.
    pub n_dead: usize,
    /// Largest fraction of a session's frames at the end of its range; 0 if it never stuck there.
    pub saturated_share: f64,
}

impl NoiseReport {
    /// Noise of all sessions, from the frames of each in which the hand is still.
    pub(super) fn of<'p>(sessions: impl Iterator<Item = &'p Prepared<'p>>, at_rest: &[Vec<usize>]) -> Self {
        let sessions: Vec<&Prepared<'_>> = sessions.collect();
        let n_taxels = sessions.first().map_or(0, |session| session.n_taxels);
        let sds: Vec<Vec<Option<f64>>> = sessions
            .iter()
            .zip(at_rest)
            .map(|(session, rest)| (0..n_taxels).map(|taxel| noise(session, rest, taxel)).collect())
            .collect();
        let of_taxel = |taxel: usize| {
            let ends: Vec<(bool, f64)> = sessions.iter().map(|session| ends(session, taxel)).collect();
            TaxelNoise {
                taxel,
                sd: Spread::of(sds.iter().map(|session| session[taxel])),
                n_dead: ends.iter().filter(|(is_dead, _)| *is_dead).count(),
                saturated_share: ends.iter().map(|(_, stuck)| *stuck).fold(0.0, f64::max),
            }
        };
        let of_session = |sds: &Vec<Option<f64>>| median(&mut sds.iter().copied().flatten().collect::<Vec<_>>());
        NoiseReport { by_taxel: (0..n_taxels).map(of_taxel).collect(), sd: Spread::of(sds.iter().map(of_session)) }
    }
}

/// Standard deviation of a taxel's noise from the differences of neighbouring frames at rest.
fn noise(session: &Prepared<'_>, at_rest: &[usize], taxel: usize) -> Option<f64> {
    let neighbours = at_rest.windows(2).filter(|pair| pair[1] == pair[0] + 1);
    let step = |pair: &[usize]| (session.reading(pair[1], taxel) - session.reading(pair[0], taxel)).abs();
    let mut steps: Vec<f64> = neighbours.map(step).collect();
    let typical = median(&mut steps)? * MEDIAN_TO_SD;
    // If the noise is smaller than one count of the sensor, more than half of the steps are zero. Their mean square
    // still measures it.
    let square = steps.iter().map(|step| step * step).sum::<f64>() / steps.len() as f64;
    Some(if typical > 0.0 { typical } else { (0.5 * square).sqrt() })
}

/// True if a taxel never changed, and the fraction of frames in which it stuck at an end of its range.
fn ends(session: &Prepared<'_>, taxel: usize) -> (bool, f64) {
    let readings: Vec<f64> = (0..session.sum.len()).map(|idx| session.reading(idx, taxel)).collect();
    let extremes =
        || Some((readings.iter().copied().min_by(f64::total_cmp)?, readings.iter().copied().max_by(f64::total_cmp)?));
    let Some((least, greatest)) = extremes() else { return (false, 0.0) };
    if least == greatest {
        return (true, 0.0);
    }
    let stuck =
        readings.chunk_by(|a, b| a == b).filter(|run| run.len() >= MIN_STUCK && [least, greatest].contains(&run[0]));
    let share = stuck.map(<[f64]>::len).sum::<usize>() as f64 / readings.len() as f64;
    (false, if share >= MIN_STUCK_SHARE { share } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::super::frames::SessionFrames;
    use super::*;
    use crate::random::Noise;

    #[test]
    fn noise_is_told_apart_from_drift_and_dead_and_saturated_taxels_are_found() {
        let n = 4000;
        let mut white = Noise::named("a taxel at rest");
        let tactile: Vec<f32> = (0..n)
            .flat_map(|k| {
                [white.normal(2.0) + 0.01 * k as f64, 7.0, (k as f64 * 0.01).sin().clamp(-2.0, 0.8)].map(|x| x as f32)
            })
            .collect();
        let time_s = (0..n).map(|k| k as f64 * 0.01).collect();
        let (stretch, in_air) = (vec![0; n], vec![true; n]);
        let frames = SessionFrames { time_s, stretch, tactile, in_air, ..SessionFrames::default() };
        let session = Prepared::new(&frames, 3, 0);
        let found = NoiseReport::of([&session].into_iter(), &[(0..n).collect()]);
        let sd = found.by_taxel[0].sd.unwrap().median;
        assert!((sd - 2.0).abs() < 0.15, "{sd}"); // three standard errors of the median of 4000 steps

        assert_eq!(found.by_taxel.iter().map(|taxel| taxel.n_dead).collect::<Vec<_>>(), [0, 1, 0]);
        assert!(found.by_taxel[2].saturated_share > 0.1 && found.by_taxel[0].saturated_share == 0.0);
    }
}
