//! The full report about one region, from the frames of its sessions.

use serde::Serialize;

use super::artifact::ArtifactReport;
use super::correlation::Correlation;
use super::drift::{DriftReport, at_rest};
use super::following::FollowingReport;
use super::frames::{Prepared, SessionFrames};
use super::hysteresis::HysteresisReport;
use super::noise::NoiseReport;
use super::offset::OffsetReport;
use super::pose_model::{BendScore, Posed};
use super::response::{ResponseReport, session_curve};
use super::selection::{Sample, Selection, samples};
use super::spread::quantile;

/// Quantiles that bound the range of a joint's angles in a session.
const RANGE_QUANTILES: [f64; 2] = [0.005, 0.995];

/// Results for one region.
///
/// # Shapes
/// J joints of the recording, T taxels of the region, S sessions.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RegionReport {
    /// `[J]`
    pub joints: Vec<String>,
    /// Taxels of the region.
    pub n_taxels: usize,
    /// `[S]`
    pub sessions: Vec<RegionSession>,
    /// Correlation of joints with taxels.
    pub correlation: Correlation,
    /// Joints that explain the artifact.
    pub selection: Selection,
    /// Quantiles that bound `pose_range`.
    pub pose_range_quantiles: [f64; 2],
    /// Range of each chosen joint, loaded or not.
    pub pose_range: Vec<JointRange>,
    /// The bend score, which is used for classes, sweeps and lags; `None` without a chosen joint.
    pub bend_score: Option<BendScore>,
    /// Response to force; `None` if no force is known.
    pub response: Option<ResponseReport>,
    /// Size of artifacts.
    pub artifact: ArtifactReport,
    /// Part of the artifacts that is specific to a donning, and the part that would remain if they were followed.
    pub following: FollowingReport,
    /// Hysteresis of artifact and touch.
    pub hysteresis: HysteresisReport,
    /// Drift at rest.
    pub drift: DriftReport,
    /// Noise and faults of taxels.
    pub noise: NoiseReport,
    /// Clock offset between joints and taxels.
    pub offset: OffsetReport,
}

/// Amount of data of one session.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RegionSession {
    /// The session.
    pub session: String,
    /// Time with taxels and all joints, s.
    pub seconds: f64,
    /// Time in the air, s.
    pub in_air_s: f64,
    /// Frames that are not in the air and have a known force.
    pub n_loaded: usize,
}

/// Range of a joint, rad.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JointRange {
    /// Its name.
    pub joint: String,
    /// Minimum.
    pub min: f64,
    /// Maximum.
    pub max: f64,
}

/// Characterizes one region from all its sessions. A joint is chosen as long as it adds `min_gain` to the explained
/// fraction of the artifact.
///
/// # Shapes
/// `joints`: `[J]`, the joints of every session.
pub fn characterize(sessions: &[SessionFrames], joints: &[String], n_taxels: usize, min_gain: f64) -> RegionReport {
    let prepared: Vec<Prepared<'_>> =
        sessions.iter().map(|frames| Prepared::new(frames, n_taxels, joints.len())).collect();
    let samples: Vec<Vec<Sample>> = prepared.iter().map(samples).collect();
    let correlation = Correlation::of(&prepared);
    let selection = Selection::of(&samples, joints, n_taxels, min_gain);
    let chosen = selection.chosen_idxs();
    let bend_score = BendScore::of(&samples, joints, &chosen);
    let posed: Vec<Posed<'_>> = prepared
        .into_iter()
        .zip(&samples)
        .map(|(session, samples)| Posed::new(session, samples, &chosen, bend_score.as_ref()))
        .collect();
    let curves: Vec<_> = posed.iter().map(session_curve).collect();
    let rest: Vec<Vec<usize>> = posed.iter().map(|posed| at_rest(posed, &chosen)).collect();
    RegionReport {
        joints: joints.to_vec(),
        n_taxels,
        sessions: posed.iter().map(|posed| RegionSession::of(&posed.session)).collect(),
        correlation,
        pose_range_quantiles: RANGE_QUANTILES,
        pose_range: chosen.iter().filter_map(|joint| range(&posed, *joint, &joints[*joint])).collect(),
        response: ResponseReport::of(&posed),
        artifact: ArtifactReport::of(&posed, &curves),
        following: FollowingReport::of(posed.iter().map(|posed| &posed.session), joints, n_taxels, &chosen),
        hysteresis: HysteresisReport::of(&posed),
        drift: DriftReport::of(&posed, &rest, &curves),
        noise: NoiseReport::of(posed.iter().map(|posed| &posed.session), &rest),
        offset: OffsetReport::of(&posed, &chosen),
        bend_score,
        selection,
    }
}

impl RegionSession {
    fn of(session: &Prepared<'_>) -> Self {
        let loaded = |idx: &usize| !session.frames.in_air[*idx] && session.truth_gf(*idx).is_some();
        RegionSession {
            session: session.frames.name.clone(),
            seconds: session.sum.len() as f64 * session.period_s,
            in_air_s: session.in_air_s(),
            n_loaded: (0..session.sum.len()).filter(loaded).count(),
        }
    }
}

fn range(sessions: &[Posed<'_>], joint: usize, name: &str) -> Option<JointRange> {
    let of_session = |posed| {
        let Posed { session, .. }: &Posed<'_> = posed;
        (0..session.sum.len()).map(|idx| session.angle(idx, joint)).collect::<Vec<_>>()
    };
    let mut angles: Vec<f64> = sessions.iter().flat_map(of_session).collect();
    let [min, max] = RANGE_QUANTILES.map(|share| quantile(&mut angles, share));
    Some(JointRange { joint: name.to_owned(), min: min?, max: max? })
}
