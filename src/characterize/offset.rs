//! How far the clocks of joints and taxels are apart, by when an artifact follows its motion.

use serde::Serialize;

use super::frames::{changes, smoothed};
use super::pose_model::Posed;
use super::spread::Spread;

/// Lags that are tried, both ways, s.
const MAX_LAG_S: f64 = 0.3;
/// Over which time motion is taken, s.
const SPAN_S: f64 = 0.06;
/// A peak that is lower is no estimate.
const MIN_PEAK: f64 = 0.4;

/// When readings in the air change, after the joints that change them.
///
/// The lag holds whatever delays the sensor, too: its filter, creep and friction make the taxels late by some 10 ms,
/// and a clock that is off by less can't be told from that.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OffsetReport {
    /// Lag of the taxels behind the joints by their stamps, ms; `None` where no session has an estimate.
    pub lag_ms: Option<Spread>,
    /// A peak below this is no estimate.
    pub min_peak: f64,
    /// Each session.
    pub by_session: Vec<SessionOffset>,
}

/// Lag of one session.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SessionOffset {
    /// The session.
    pub session: String,
    /// Lag of the taxels, ms, between two frames by a parabola; `None` for a peak that is too low, or at the end of the
    /// lags that were tried.
    pub lag_ms: Option<f64>,
    /// Absolute correlation at the peak.
    pub peak: Option<f64>,
    /// Correlation of the motion with the later change of the reading, by lag.
    pub curve: Vec<LagPoint>,
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
    pub(super) fn of(sessions: &[Posed<'_>]) -> Self {
        let by_session: Vec<SessionOffset> = sessions.iter().map(SessionOffset::of).collect();
        let lag_ms = Spread::of(by_session.iter().map(|session| session.lag_ms));
        OffsetReport { lag_ms, min_peak: MIN_PEAK, by_session }
    }
}

impl SessionOffset {
    fn of(posed: &Posed<'_>) -> Self {
        let (curve, period_ms) = (curve(posed), 1e3 * posed.session.period_s);
        let size = |idx: usize| curve.get(idx).map(|point: &LagPoint| point.correlation.abs());
        let top = (0..curve.len()).max_by(|a, b| size(*a).partial_cmp(&size(*b)).unwrap_or(std::cmp::Ordering::Equal));
        let peak = top.and_then(size);
        let between = || {
            let (top, peak) = (top?, peak.filter(|peak| *peak >= MIN_PEAK)?);
            let (before, after) = (size(top.checked_sub(1)?)?, size(top + 1)?);
            let bend = before - 2.0 * peak + after;
            let part = if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
            Some(curve[top].lag_ms + part * period_ms)
        };
        SessionOffset { session: posed.session.frames.name.clone(), lag_ms: between(), peak, curve }
    }
}

/// Correlation of the motion of the bend score with the change of the reading a lag later, over the time in the air.
fn curve(posed: &Posed<'_>) -> Vec<LagPoint> {
    let session = &posed.session;
    let Some(score) = &posed.score else { return Vec::new() };
    let span = session.n_in(SPAN_S);
    let motion = |values: &[f64]| changes(&smoothed(values, span), span);
    let runs = session.in_air.iter().filter(|run| run.len() > span);
    let runs: Vec<(Vec<f64>, Vec<f64>)> =
        runs.map(|run| (motion(&score[run.clone()]), motion(&session.sum[run.clone()]))).collect();
    let max_lag = session.n_in(MAX_LAG_S) as i64;
    let at = |lag: i64| {
        let (mut n, mut x, mut y, mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for (joints, taxels) in &runs {
            let (ahead, behind) = (lag.max(0) as usize, (-lag).max(0) as usize);
            for (joint, taxel) in joints.iter().skip(behind).zip(taxels.iter().skip(ahead)) {
                (n, x, y) = (n + 1.0, x + joint, y + taxel);
                (xx, yy, xy) = (xx + joint * joint, yy + taxel * taxel, xy + joint * taxel);
            }
        }
        let (xx, yy, xy) = (n * xx - x * x, n * yy - y * y, n * xy - x * y);
        let lag_ms = 1e3 * lag as f64 * session.period_s;
        (xx > 0.0 && yy > 0.0).then(|| LagPoint { lag_ms, correlation: xy / (xx * yy).sqrt() })
    };
    (-max_lag..=max_lag).filter_map(at).collect()
}
