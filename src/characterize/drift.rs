//! Drift of the reading at rest over a session.

use serde::Serialize;

use super::curve::ForceCurve;
use super::frames::{changes, smoothed};
use super::pose_model::Posed;
use super::spread::{Spread, median, theil_sen};
use crate::units::{GramForce, Newton};

/// A hand is at rest while none of the chosen joints turns faster than this, rad/s.
const REST_RAD_S: f64 = 0.15;
/// Window for speeds, s.
const SPEED_S: f64 = 0.1;
/// Window for readings at rest, s.
const PIECE_S: f64 = 5.0;
/// Minimum rest per window, s.
const MIN_REST_S: f64 = 0.3;
/// Minimum number of windows for a slope.
const MIN_PIECES: usize = 5;

/// Drift of the sum of all taxels, at rest in the air, minus the effect of the pose.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DriftReport {
    /// A hand is at rest below this speed of the chosen joints, rad/s.
    pub rest_rad_s: f64,
    /// Slope of each session with its sign, units of the sensor per minute.
    pub per_min: Option<Spread>,
    /// Largest distance from the session's median, units of the sensor.
    pub largest: Option<Spread>,
    /// Force of a tap with the same reading as the largest distance, gF.
    pub largest_gf: Option<Spread>,
    /// The same, N.
    pub largest_n: Option<Spread>,
    /// Each session.
    pub by_session: Vec<SessionDrift>,
}

/// Drift of one session.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SessionDrift {
    /// The session.
    pub session: String,
    /// Slope by Theil and Sen, units of the sensor per minute.
    pub per_min: Option<f64>,
    /// Largest distance from the median, units of the sensor.
    pub largest: Option<f64>,
    /// Force of a tap with the same reading, gF.
    pub largest_gf: Option<f64>,
    /// Readings at rest: s into the session, units of the sensor.
    pub at_rest: Vec<(f64, f64)>,
    /// Slope of the force sensor's own tare by Theil and Sen, gF per minute.
    pub truth_gf_per_min: Option<f64>,
    /// Range of the force sensor's tare, from minimum to maximum, gF.
    pub truth_range_gf: Option<f64>,
}

impl DriftReport {
    /// `rest`: the frames of each session in which the hand is still.
    pub(super) fn of(sessions: &[Posed<'_>], rest: &[Vec<usize>], curves: &[Option<ForceCurve>]) -> Self {
        let by_session: Vec<SessionDrift> = sessions
            .iter()
            .zip(rest)
            .zip(curves)
            .map(|((posed, rest), curve)| SessionDrift::of(posed, rest, curve.as_ref()))
            .collect();
        let largest_gf = || by_session.iter().map(|session| session.largest_gf);
        DriftReport {
            rest_rad_s: REST_RAD_S,
            per_min: Spread::of(by_session.iter().map(|session| session.per_min)),
            largest: Spread::of(by_session.iter().map(|session| session.largest)),
            largest_gf: Spread::of(largest_gf()),
            largest_n: Spread::of(largest_gf().map(|force| Some(Newton::from(GramForce(force?)).0))),
            by_session,
        }
    }
}

impl SessionDrift {
    fn of(posed: &Posed<'_>, at_rest: &[usize], curve: Option<&ForceCurve>) -> Self {
        let session = &posed.session;
        let mut pieces = Vec::new();
        let piece = |idx: &usize| (session.frames.time_s[*idx] / PIECE_S) as i64;
        for of_piece in at_rest.chunk_by(|a, b| piece(a) == piece(b)) {
            if of_piece.len() < session.n_in(MIN_REST_S) {
                continue;
            }
            let mut readings: Vec<f64> = of_piece.iter().map(|idx| posed.rise(*idx)).collect();
            let at_s = session.frames.time_s[of_piece[of_piece.len() / 2]];
            pieces.extend(median(&mut readings).map(|reading| (at_s, reading)));
        }
        let middle = median(&mut pieces.iter().map(|piece| piece.1).collect::<Vec<_>>()).unwrap_or(0.0);
        let away = pieces.iter().map(|piece| (piece.1 - middle).abs());
        let largest = away.max_by(f64::total_cmp).filter(|_| pieces.len() >= MIN_PIECES);
        let tare = &session.frames.tare;
        let tares = || tare.iter().map(|(_, force)| *force);
        let range = || Some(tares().max_by(f64::total_cmp)? - tares().min_by(f64::total_cmp)?);
        SessionDrift {
            session: session.frames.name.clone(),
            per_min: theil_sen(&pieces).filter(|_| pieces.len() >= MIN_PIECES).map(|per_s| 60.0 * per_s),
            largest,
            largest_gf: largest.and_then(|largest| curve?.force_gf(largest)),
            at_rest: pieces,
            truth_gf_per_min: theil_sen(tare).filter(|_| tare.len() >= MIN_PIECES).map(|per_s| 60.0 * per_s),
            truth_range_gf: range().filter(|_| tare.len() >= MIN_PIECES),
        }
    }
}

/// Frames in the air in which the hand is still.
pub(super) fn at_rest(posed: &Posed<'_>, joints: &[usize]) -> Vec<usize> {
    let session = &posed.session;
    let span = session.n_in(SPEED_S);
    let limit = REST_RAD_S * span as f64 * session.period_s;
    let mut rest = Vec::new();
    for run in session.in_air.iter().filter(|run| run.len() > span) {
        let turns: Vec<Vec<f64>> = joints
            .iter()
            .map(|joint| {
                let angles: Vec<f64> = run.clone().map(|idx| session.angle(idx, *joint)).collect();
                changes(&smoothed(&angles, span), span)
            })
            .collect();
        let is_still = |k: &usize| turns.iter().all(|turn| turn[*k].abs() < limit);
        rest.extend((0..run.len() - span).filter(is_still).map(|k| run.start + k + span / 2));
    }
    rest
}
