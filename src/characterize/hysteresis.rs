//! Lags: of the artifact behind the bend, and of the reading behind the force.

use serde::Serialize;

use super::curve::{EDGES_GF, bin_of};
use super::frames::{changes, runs, smoothed};
use super::pose_model::Posed;
use super::response::TOUCH_GF;
use super::spread::{Spread, median, quantile};

/// Scores and readings are smoothed over this time, s.
const SMOOTH_S: f64 = 0.08;
/// Minimum range of the bend score in a sweep.
const MIN_SWEEP: f64 = 0.4;
/// A sweep ends when the score returns by this much.
const TURN: f64 = 0.08;
/// Minimum number of sweeps in each direction.
const MIN_SWEEPS: usize = 3;
/// Part of a sweep that is compared: not its turning points.
const MIDDLE: (f64, f64) = (0.25, 0.75);
/// Number of points of the shown loop.
const N_LOOP: usize = 10;
/// Maximum rate of force when comparing loading with unloading, gF/s: slow enough that 10 ms of lag are 2 gF.
const SPEED_GF_S: (f64, f64) = (10.0, 200.0);
/// Minimum force when comparing loading with unloading, gF.
const MIN_FORCE_GF: f64 = 20.0;
/// Minimum number of frames of a touch in a bin of force in each direction.
const MIN_FRAMES: usize = 3;

/// Lags over all sessions.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HysteresisReport {
    /// How much higher readings in the air are while the hand straightens than while it bends, at an equal pose, as a
    /// fraction of the whole range of readings in the air. It includes all lags: friction, creep, and a clock offset.
    pub artifact: Option<Spread>,
    /// How much higher readings are on unloading than on loading, at an equal force within one touch, as a fraction of
    /// the reading that the touch adds; only while the force changes slowly.
    pub touch: Option<Spread>,
    /// Each session.
    pub by_session: Vec<SessionHysteresis>,
    /// The loop of the artifact, pooled: bend score, mean reading while it rises, mean reading while it falls.
    pub artifact_loop: Vec<[f64; 3]>,
}

/// Lags in one session.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SessionHysteresis {
    /// The session.
    pub session: String,
    /// Width of the loop of the artifact, as a fraction of the range.
    pub artifact: Option<f64>,
    /// Sweeps of the bend score up and down that were compared.
    pub n_sweeps: [usize; 2],
    /// Unloading over loading, as a fraction of the reading.
    pub touch: Option<f64>,
    /// Touches and forces that were compared.
    pub n_touch_pairs: usize,
}

impl HysteresisReport {
    pub(super) fn of(sessions: &[Posed<'_>]) -> Self {
        let mut bins = [[(0.0, 0.0); N_LOOP]; 2];
        let of_session = |posed: &Posed<'_>| {
            let (artifact, n_sweeps) = artifact(posed, &mut bins);
            let (touch, n_touch_pairs) = touch(posed);
            SessionHysteresis { session: posed.session.frames.name.clone(), artifact, n_sweeps, touch, n_touch_pairs }
        };
        let by_session: Vec<SessionHysteresis> = sessions.iter().map(of_session).collect();
        let point = |bin: usize| {
            let [rising, falling] = [0, 1].map(|direction| bins[direction][bin]);
            let score = (bin as f64 + 0.5) / N_LOOP as f64;
            let seen = rising.1 > 0.0 && falling.1 > 0.0;
            seen.then(|| [score, rising.0 / rising.1, falling.0 / falling.1])
        };
        HysteresisReport {
            artifact: Spread::of(by_session.iter().map(|session| session.artifact)),
            touch: Spread::of(by_session.iter().map(|session| session.touch)),
            artifact_loop: (0..N_LOOP).filter_map(point).collect(),
            by_session,
        }
    }
}

/// Width of the loop as a fraction of the range, and the number of sweeps used. Adds their readings to the loop that is
/// shown.
///
/// Compares the reading minus the prediction from pose, because two sweeps never go through the same poses.
fn artifact(posed: &Posed<'_>, bins: &mut [[(f64, f64); N_LOOP]; 2]) -> (Option<f64>, [usize; 2]) {
    let session = &posed.session;
    let Some(score) = &posed.score else { return (None, [0; 2]) };
    let smooth = session.smoothed_in_air(score, SMOOTH_S);
    let mut beyond: [Vec<f64>; 2] = Default::default();
    for run in &session.in_air {
        for (from, to) in sweeps(&smooth[run.clone()]) {
            let (low, span) = (smooth[run.start + from], smooth[run.start + to] - smooth[run.start + from]);
            let direction = usize::from(span < 0.0);
            let of_sweep: Vec<usize> = (run.start + from..=run.start + to).collect();
            let is_middle = |idx: &&usize| (MIDDLE.0..MIDDLE.1).contains(&((smooth[**idx] - low) / span));
            let middle: Vec<f64> = of_sweep.iter().filter(is_middle).map(|idx| posed.rise(*idx)).collect();
            if !middle.is_empty() {
                beyond[direction].push(middle.iter().sum::<f64>() / middle.len() as f64);
            }
            for idx in of_sweep.into_iter().filter(|idx| (0.0..1.0).contains(&smooth[*idx])) {
                let bin = &mut bins[direction][(smooth[idx] * N_LOOP as f64) as usize];
                *bin = (bin.0 + session.sum[idx], bin.1 + 1.0);
            }
        }
    }
    let n_sweeps = [beyond[0].len(), beyond[1].len()];
    let mut readings: Vec<f64> = session.in_air.iter().cloned().flatten().map(|idx| posed.in_air[idx]).collect();
    let [low, high] = [0.01, 0.99].map(|share| quantile(&mut readings, share));
    let [rising, falling] = beyond.map(|mut sweeps| median(&mut sweeps));
    let width = || Some((falling? - rising?) / (high? - low?));
    (width().filter(|width| width.is_finite() && n_sweeps.iter().all(|n| *n >= MIN_SWEEPS)), n_sweeps)
}

/// Sweeps in which a score goes all the way up or down: first and last index of each.
fn sweeps(score: &[f64]) -> Vec<(usize, usize)> {
    let mut sweeps = Vec::new();
    let (mut pivot, mut extreme, mut direction) = (0, 0, 0.0);
    for (idx, now) in score.iter().enumerate() {
        if direction == 0.0 && (now - score[pivot]).abs() > TURN {
            (direction, extreme) = ((now - score[pivot]).signum(), idx);
        }
        if direction * (now - score[extreme]) > 0.0 {
            extreme = idx;
        } else if direction * (score[extreme] - now) > TURN {
            sweeps.push((pivot, extreme));
            (pivot, extreme, direction) = (extreme, idx, -direction);
        }
    }
    sweeps.push((pivot, extreme));
    sweeps.retain(|(from, to)| {
        (score.get(*to).zip(score.get(*from))).is_some_and(|(to, from)| (to - from).abs() >= MIN_SWEEP)
    });
    sweeps
}

/// Unloading over loading as a fraction of the reading that a touch adds, and the number of touches and forces used.
fn touch(posed: &Posed<'_>) -> (Option<f64>, usize) {
    let session = &posed.session;
    let (window, span) = (session.n_in(SMOOTH_S), session.n_in(SMOOTH_S));
    let mut shares = Vec::new();
    for run in &session.connected {
        let forces: Vec<f64> = run
            .clone()
            .map(|idx| session.truth_gf(idx).filter(|_| !session.frames.in_air[idx]).unwrap_or(0.0))
            .collect();
        let forces = smoothed(&forces, window);
        let grows = changes(&forces, span);
        let speed =
            |k: usize| grows.get(k.checked_sub(span / 2)?).map(|grows| grows / (span as f64 * session.period_s));
        for touch in runs(forces.len(), |_, _| true, |k| forces[k] >= TOUCH_GF) {
            let mut bins = vec![[(0.0, 0_usize); 2]; EDGES_GF.len()];
            for k in touch {
                let (Some(bin), Some(speed)) = (bin_of(forces[k]), speed(k)) else { continue };
                if forces[k] >= MIN_FORCE_GF && (SPEED_GF_S.0..SPEED_GF_S.1).contains(&speed.abs()) {
                    let of = &mut bins[bin][usize::from(speed < 0.0)];
                    // Divided by force, because forces within a bin differ.
                    *of = (of.0 + posed.rise(run.start + k) / forces[k], of.1 + 1);
                }
            }
            for [loading, unloading] in bins {
                if loading.1.min(unloading.1) >= MIN_FRAMES {
                    let [loading, unloading] = [loading, unloading].map(|(sum, n)| sum / n as f64);
                    shares.push((unloading - loading) / (0.5 * (unloading + loading)));
                }
            }
        }
    }
    let n = shares.len();
    (median(&mut shares).filter(|share| share.is_finite() && n >= MIN_SWEEPS), n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sweeps_end_where_the_score_turns_and_small_ones_are_left_out() {
        let way = [0.0, 0.3, 0.6, 0.9, 0.88, 0.92, 0.5, 0.1, 0.3, 0.15, 0.1, 0.2];
        assert_eq!(sweeps(&way), [(0, 5), (5, 7)]);
        assert!(sweeps(&[0.5; 9]).is_empty() && sweeps(&[]).is_empty());
    }
}
