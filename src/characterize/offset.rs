//! Estimates the clock offset between joints and taxels from the delay of an artifact after its motion.

use serde::Serialize;

use super::frames::{Prepared, changes, smoothed};
use super::gram::Gram;
use super::pose_model::Posed;
use super::spread::Spread;

/// Range of lags tried, in both directions, s.
const MAX_LAG_S: f64 = 0.3;
/// Window for motion, s.
const SPAN_S: f64 = 0.06;
/// Interval between fitted rows, s. Neighbouring rows have the same information.
const EVERY_S: f64 = 0.02;
/// Minimum peak for an estimate.
const MIN_PEAK: f64 = 0.4;
/// Length of the blocks left out in turn, s: longer than movements, so that each block has information.
const BLOCK_S: f64 = 4.0;
/// Minimum and maximum number of blocks.
const N_BLOCKS: [usize; 2] = [6, 30];
/// Half width of an interval that contains the true lag in at least 95 of 100 cases, in standard errors: Student's 2.57
/// for six blocks, and some more because neighbouring blocks are not independent.
const INTERVAL_ERRORS: f64 = 3.0;
/// Difference in standard errors by which another lag must be worse to be ruled out. There are 60 lags, so 2 would not
/// be enough.
const RULED_OUT_ERRORS: f64 = 3.0;
/// Maximum width of an interval, ms. A wider one gives no estimate.
const MAX_WIDTH_MS: f64 = 60.0;

/// Range of lags from a sensor's own filter, creep and friction, ms. A clock offset in this range can't be
/// distinguished from them.
pub const OWN_LAG_MS: [f64; 2] = [0.0, 20.0];

/// Delay of changes in the readings in the air after the joint motion that causes them.
///
/// The lag includes the delay of the sensor: its filter, creep and friction delay the taxels by about 10 ms, and a
/// smaller clock offset can't be distinguished from this.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OffsetReport {
    /// Lag of the stamps of taxels behind those of joints, ms; `None` if no session has an estimate.
    pub lag_ms: Option<Spread>,
    /// Interval that contains it in 95 of 100 cases, ms: from the smallest to the largest value over sessions.
    pub interval_ms: Option<[f64; 2]>,
    /// Clock offset, ms: the interval without [`OWN_LAG_MS`]. Positive if stamps of taxels are late.
    pub clock_offset_ms: Option<[f64; 2]>,
    /// Minimum peak for an estimate.
    pub min_peak: f64,
    /// Each session.
    pub by_session: Vec<SessionOffset>,
}

/// Lag of one session.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SessionOffset {
    /// The session.
    pub session: String,
    /// Lag of the taxels, ms, interpolated between frames by a parabola; `None` if the movements don't determine it.
    pub lag_ms: Option<f64>,
    /// Interval that contains it in 95 of 100 cases, ms.
    pub interval_ms: Option<[f64; 2]>,
    /// The reason why there is no estimate.
    pub untold: Option<Untold>,
    /// Correlation at the peak.
    pub peak: Option<f64>,
    /// For each lag: correlation of the change of the reading with its prediction from the earlier motion of the
    /// joints.
    pub curve: Vec<LagPoint>,
}

/// The reason why movements don't determine a lag.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, thiserror::Error)]
#[serde(rename_all = "snake_case", tag = "why")]
pub enum Untold {
    /// Too little motion.
    #[error("there is too little time in the air without gaps: {} s are needed", BLOCK_S * N_BLOCKS[0] as f64)]
    TooShort,
    /// Joints explain too little of the readings at every lag.
    #[error("the joints don't tell what the taxels read in the air at any lag")]
    NoPeak,
    /// The best lag is the first or last that was tried.
    #[error("the best lag is at the end of those that were tried, {} ms either way", 1e3 * MAX_LAG_S)]
    AtTheEnd,
    /// Another lag explains the readings equally well, within the uncertainty of these data.
    #[error("a lag of {other_ms:.0} ms explains the readings as well as one of {lag_ms:.0} ms")]
    SeveralPeaks {
        /// The best lag, ms.
        lag_ms: f64,
        /// The lag furthest from the best, ms.
        other_ms: f64,
    },
    /// The peak is so flat that the interval is too wide to be useful.
    #[error("lags within {width_ms:.0} ms explain the readings alike")]
    Flat {
        /// Width of the interval, ms.
        width_ms: f64,
    },
}

impl Untold {
    /// The remedy.
    pub const REMEDY: &'static str = "record half a minute in the air in which each finger bends and straightens by itself, \
                                      fast, at uneven times, with stops in between";
}

/// Correlation at one lag.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LagPoint {
    /// Lag of the taxels, ms.
    pub lag_ms: f64,
    /// Correlation.
    pub correlation: f64,
}

impl OffsetReport {
    /// `chosen`: the joints that explain the artifact.
    pub(super) fn of(sessions: &[Posed<'_>], chosen: &[usize]) -> Self {
        let by_session: Vec<SessionOffset> =
            sessions.iter().map(|posed| SessionOffset::of(&posed.session, chosen)).collect();
        let lag_ms = Spread::of(by_session.iter().map(|session| session.lag_ms));
        let hull =
            |[low, high]: [f64; 2], [other_low, other_high]: [f64; 2]| [low.min(other_low), high.max(other_high)];
        let interval_ms = by_session.iter().filter_map(|session| session.interval_ms).reduce(hull);
        OffsetReport {
            lag_ms,
            interval_ms,
            clock_offset_ms: interval_ms.map(|[low, high]| [low - OWN_LAG_MS[1], high - OWN_LAG_MS[0]]),
            min_peak: MIN_PEAK,
            by_session,
        }
    }
}

impl SessionOffset {
    fn of(session: &Prepared<'_>, chosen: &[usize]) -> Self {
        let lags = Lags::of(session, chosen);
        let left = lags.left(|_| true);
        let correlation = |idx: usize| (1.0 - left[idx] / lags.total()).max(0.0).sqrt();
        let told = lags.told(&left);
        let is_known = lags.total() > 0.0;
        let at = |idx: usize| LagPoint { lag_ms: lags.lag_ms(idx as f64), correlation: correlation(idx) };
        let curve: Vec<LagPoint> = (0..left.len()).filter(|_| is_known).map(at).collect();
        SessionOffset {
            session: session.frames.name.clone(),
            lag_ms: told.ok().map(|(lag_ms, _)| lag_ms),
            interval_ms: told.ok().map(|(_, interval_ms)| interval_ms),
            untold: told.err(),
            peak: curve.iter().map(|point| point.correlation).reduce(f64::max),
            curve,
        }
    }
}

/// Sums of products of the joints' motion with the later change of the reading, by time block and lag.
struct Lags {
    /// `[blocks, lags]`
    blocks: Vec<Vec<Gram>>,
    features: Vec<usize>,
    period_ms: f64,
    max_lag: usize,
}

impl Lags {
    /// Uses the same changes of the reading for every lag: those with motion available at all lags.
    fn of(session: &Prepared<'_>, chosen: &[usize]) -> Self {
        let (span, every) = (session.n_in(SPAN_S), session.n_in(EVERY_S));
        let max_lag = session.n_in(MAX_LAG_S);
        let n_features = 2 * chosen.len();
        let motion = |values: &[f64]| changes(&smoothed(values, span), span);
        let usable = |n: usize| n.saturating_sub(span + 2 * max_lag).div_ceil(every);
        let n_rows: usize = session.in_air.iter().map(|run| usable(run.len())).sum();
        let seconds = n_rows as f64 * every as f64 * session.period_s;
        let n_blocks = ((seconds / BLOCK_S) as usize).min(N_BLOCKS[1]);
        let mut blocks = vec![vec![Gram::new(n_features, 1); 2 * max_lag + 1]; n_blocks];
        let (mut row_idx, mut features) = (0, vec![0.0; n_features]);
        for run in session.in_air.iter().filter(|run| n_blocks > 0 && usable(run.len()) > 0) {
            let of_joint = |joint: usize, power: i32| {
                motion(&run.clone().map(|idx| session.angle(idx, joint).powi(power)).collect::<Vec<_>>())
            };
            let joints: Vec<Vec<f64>> =
                chosen.iter().flat_map(|joint| [of_joint(*joint, 1), of_joint(*joint, 2)]).collect();
            let reading = motion(&session.sum[run.clone()]);
            for at in (max_lag..reading.len() - max_lag).step_by(every) {
                let block = &mut blocks[row_idx * n_blocks / n_rows];
                for (idx, gram) in block.iter_mut().enumerate() {
                    let before = at + max_lag - idx;
                    features.iter_mut().zip(&joints).for_each(|(feature, joint)| *feature = joint[before]);
                    gram.handle(&features, &[reading[at]]);
                }
                row_idx += 1;
            }
        }
        Lags { blocks, features: (0..n_features).collect(), period_ms: 1e3 * session.period_s, max_lag }
    }

    fn lag_ms(&self, idx: f64) -> f64 {
        (idx - self.max_lag as f64) * self.period_ms
    }

    fn n_lags(&self) -> usize {
        2 * self.max_lag + 1
    }

    /// Sum of squared changes of the reading.
    fn total(&self) -> f64 {
        let none = Gram::new(self.features.len(), 1).fit(&[]);
        self.blocks.iter().map(|block| block[0].squares(&none)[0]).sum()
    }

    /// `[lags]`: residual of the changes in some of the blocks, for the best weights of the joints.
    fn left(&self, is_in: impl Fn(usize) -> bool) -> Vec<f64> {
        let of_lag = |idx: usize| {
            let gram = self.sum(idx, &is_in);
            gram.squares(&gram.fit(&self.features))[1]
        };
        (0..self.n_lags()).map(of_lag).collect()
    }

    fn sum(&self, lag_idx: usize, is_in: &impl Fn(usize) -> bool) -> Gram {
        let mut sum = Gram::new(self.features.len(), 1);
        let blocks = self.blocks.iter().enumerate().filter(|(block, _)| is_in(*block));
        blocks.for_each(|(_, block)| sum.add(&block[lag_idx]));
        sum
    }

    /// The lag and its interval, ms, from the residual at each lag.
    fn told(&self, left: &[f64]) -> Result<(f64, [f64; 2]), Untold> {
        if self.blocks.len() < N_BLOCKS[0] {
            return Err(Untold::TooShort);
        }
        let total = self.total();
        let best = least(left);
        if self.features.is_empty() || total <= 0.0 || 1.0 - left[best] / total < MIN_PEAK * MIN_PEAK {
            return Err(Untold::NoPeak);
        }
        let top = between(left).ok_or(Untold::AtTheEnd)?;
        let n = self.blocks.len() as f64;
        let without: Vec<f64> = (0..self.blocks.len())
            .map(|out| self.left(|block| block != out))
            .map(|left| between(&left).unwrap_or(least(&left) as f64))
            .collect();
        let mean = without.iter().sum::<f64>() / n;
        // The jackknife's standard error.
        let error = ((n - 1.0) / n * without.iter().map(|one| (one - mean).powi(2)).sum::<f64>()).sqrt();
        // Joint stamps may be anywhere between two frames.
        let half = (INTERVAL_ERRORS * error + 0.5) * self.period_ms;
        if 2.0 * half > MAX_WIDTH_MS {
            return Err(Untold::Flat { width_ms: 2.0 * half });
        }
        // Lags within this distance belong to the same peak.
        let reach_ms = 2.5 * half + 2.0 * self.period_ms;
        let is_other = |idx: &usize| (self.lag_ms(*idx as f64) - self.lag_ms(top)).abs() > reach_ms;
        let rivals = (0..left.len()).filter(is_other).filter(|idx| !self.is_ruled_out(*idx, best));
        let distance = |idx: &usize| idx.abs_diff(best);
        if let Some(other) = rivals.max_by_key(distance) {
            return Err(Untold::SeveralPeaks { lag_ms: self.lag_ms(top), other_ms: self.lag_ms(other as f64) });
        }
        let lag_ms = self.lag_ms(top);
        Ok((lag_ms, [lag_ms - half, lag_ms + half]))
    }

    /// True if a lag explains the blocks worse than the best one by more than chance can explain.
    fn is_ruled_out(&self, idx: usize, best: usize) -> bool {
        let fit = |idx: usize| self.sum(idx, &|_| true).fit(&self.features);
        let (of_other, of_best) = (fit(idx), fit(best));
        let worse: Vec<f64> = self
            .blocks
            .iter()
            .map(|block| block[idx].squares(&of_other)[1] - block[best].squares(&of_best)[1])
            .collect();
        let n = worse.len() as f64;
        let mean = worse.iter().sum::<f64>() / n;
        let variance = worse.iter().map(|one| (one - mean).powi(2)).sum::<f64>() / (n - 1.0);
        mean > RULED_OUT_ERRORS * (variance / n).sqrt()
    }
}

fn least(left: &[f64]) -> usize {
    (0..left.len()).min_by(|a, b| left[*a].total_cmp(&left[*b])).unwrap_or(0)
}

/// Position of the minimum between two lags, by a parabola; `None` for the first and the last.
fn between(left: &[f64]) -> Option<f64> {
    let best = least(left);
    let (before, after) = (left.get(best.checked_sub(1)?)?, left.get(best + 1)?);
    let bend = before - 2.0 * left[best] + after;
    let part = if bend > 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
    Some(best as f64 + part)
}

#[cfg(test)]
mod tests {
    use super::super::frames::SessionFrames;
    use super::*;
    use crate::random::Noise;

    /// Motion of the joints.
    #[derive(Debug, Clone, Copy)]
    enum Motion {
        /// Each joint alone, quickly and at uneven times, as people do when asked to.
        Lively,
        /// One slow sine wave, with a phase of a quarter period between the joints.
        SlowWaves,
        /// One fast sine wave, which is the same a period later.
        FastWave,
        /// Like `Lively`, but the second joint moves some time after the first.
        InTurn,
        /// Slowly and smoothly, at random.
        Slow,
    }

    const N_JOINTS: usize = 3;

    /// `[frames][joints]` at 1 kHz, rad.
    fn motion(kind: Motion, n: usize, random: &mut Noise) -> Vec<[f64; N_JOINTS]> {
        let wave =
            |hz: f64, phase: f64, k: usize| 0.6 + 0.6 * (std::f64::consts::TAU * (hz * k as f64 * 1e-3 + phase)).sin();
        let mut steps = |least_s: f64, speed: f64, n_joints: usize| {
            let (mut goal, mut at, mut next) = ([0.0; N_JOINTS], [0.0; N_JOINTS], 0);
            let mut speeds = [0.0; N_JOINTS];
            (0..n)
                .map(|k| {
                    if k >= next {
                        let joint = (random.uniform(0.0, 1.0) * n_joints as f64) as usize % n_joints;
                        goal[joint] = 1.4 * random.uniform(0.0, 1.0);
                        next = k + ((least_s + least_s * random.uniform(0.0, 1.0)) * 1e3) as usize;
                    }
                    for joint in 0..N_JOINTS {
                        // A spring without overshoot, so that position and speed are smooth.
                        let pull = speed * speed * (goal[joint] - at[joint]) - 2.0 * speed * speeds[joint];
                        speeds[joint] += pull * 1e-3;
                        at[joint] += speeds[joint] * 1e-3;
                    }
                    at
                })
                .collect::<Vec<_>>()
        };
        match kind {
            Motion::Lively => steps(0.4, 14.0, N_JOINTS),
            Motion::Slow => steps(3.0, 1.2, N_JOINTS),
            Motion::SlowWaves => (0..n).map(|k| [wave(0.1, 0.0, k), wave(0.1, 0.25, k), wave(0.1, 0.4, k)]).collect(),
            Motion::FastWave => (0..n).map(|k| [wave(4.0, 0.0, k); N_JOINTS]).collect(),
            Motion::InTurn => {
                let first = steps(0.5, 12.0, 1);
                (0..n).map(|k| [first[k][0], first[k.saturating_sub(90)][0], 0.3]).collect()
            }
        }
    }

    /// A session whose taxels lag behind the joints by `lag_ms`, with noise as this fraction of the motion's effect.
    fn session(kind: Motion, lag_ms: f64, noise: f64, seconds: usize, seed: u64) -> SessionFrames {
        let mut random = Noise::named(&format!("offset {seed}"));
        let margin = 400;
        let path = motion(kind, seconds * 1000 + 2 * margin, &mut random);
        let weights = [40.0, if random.uniform(0.0, 1.0) < 0.5 { -25.0 } else { 25.0 }, 10.0];
        let read = |at: usize| -> f64 {
            path[at].iter().zip(weights).map(|(angle, weight)| weight * (angle + 0.2 * angle * angle)).sum()
        };
        let n = seconds * 100;
        let (mut pose, mut tactile) = (Vec::new(), Vec::new());
        let mut drift = 0.0;
        for k in 0..n {
            let at = margin + 10 * k;
            pose.extend(path[at].map(|angle| (angle + random.normal(0.003)) as f32));
            drift += random.normal(0.05);
            let reading = read((at as f64 - lag_ms).round() as usize) + drift + random.normal(noise * 20.0);
            tactile.push(reading as f32);
        }
        SessionFrames {
            name: format!("{kind:?}"),
            time_s: (0..n).map(|k| k as f64 * 0.01).collect(),
            stretch: vec![0; n],
            tactile,
            pose,
            in_air: vec![true; n],
            ..SessionFrames::default()
        }
    }

    /// Number of sessions with an estimate. Each estimate must contain the true lag and be near it.
    fn n_told(kind: Motion, noise: f64, lags_ms: &[f64]) -> usize {
        let mut n_told = 0;
        for seed in 0..6 {
            for &lag_ms in lags_ms {
                let frames = session(kind, lag_ms, noise, 30, seed);
                let found = SessionOffset::of(&Prepared::new(&frames, 1, N_JOINTS), &[0, 1, 2]);
                assert_eq!(found.lag_ms.is_some(), found.untold.is_none());
                let (Some(found_ms), Some([low, high])) = (found.lag_ms, found.interval_ms) else { continue };
                assert!(low <= lag_ms && lag_ms <= high, "{kind:?}, {noise}, {lag_ms}: {found_ms} in {low} to {high}");
                assert!((found_ms - lag_ms).abs() < 15.0, "{kind:?}, {noise}, {lag_ms}: {found_ms}");
                n_told += 1;
            }
        }
        n_told
    }

    #[test]
    fn a_lag_is_told_with_an_interval_that_holds_it_where_movements_tell_it() {
        // 12 sessions each.
        assert_eq!(n_told(Motion::Lively, 0.02, &[2.0, -120.0]), 12);
        assert!(n_told(Motion::Lively, 0.2, &[0.0, 30.0]) >= 8);
        assert!(n_told(Motion::InTurn, 0.02, &[0.0, 77.0]) >= 8);
        n_told(Motion::Lively, 0.6, &[2.0, -40.0]);
    }

    #[test]
    fn movements_that_do_not_tell_a_lag_give_none() {
        for kind in [Motion::Slow, Motion::SlowWaves, Motion::FastWave] {
            for noise in [0.02, 0.2] {
                assert_eq!(n_told(kind, noise, &[2.0, 30.0]), 0, "{kind:?}, {noise}");
            }
        }
        let frames = session(Motion::Lively, 2.0, 0.02, 12, 1);
        let found = SessionOffset::of(&Prepared::new(&frames, 1, N_JOINTS), &[0, 1, 2]);
        assert_eq!((found.lag_ms, found.untold), (None, Some(Untold::TooShort)));
        let still = SessionOffset::of(&Prepared::new(&frames, 1, N_JOINTS), &[]);
        assert_eq!(still.lag_ms, None);
    }
}
