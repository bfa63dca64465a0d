//! Observation 1: size of an artifact, as a reading and as the force of a tap with the same reading.

use std::collections::BTreeMap;

use serde::Serialize;

use super::curve::ForceCurve;
use super::pose_model::Posed;
use super::spread::{Spread, quantile};
use crate::units::{GramForce, Newton};

/// Readings are smoothed over this time, s, so that noise does not count as an artifact.
const SMOOTH_S: f64 = 0.05;
/// The hand counts as straight up to this bend score.
const STRAIGHT: f64 = 0.1;
/// Minimum time in a pose per session for a result, s.
const MIN_POSE_S: f64 = 0.3;

/// Size of artifacts: the distance of readings in the air from those of the straight hand.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ArtifactReport {
    /// All time in the air.
    pub movement: ArtifactSize,
    /// Each instructed pose and movement, the largest first.
    pub by_pose: Vec<PoseArtifact>,
    /// All time in the air of each session.
    pub by_session: Vec<ArtifactSize>,
}

/// Absolute sizes, sum of all taxels. Over several sessions, these are medians of the sessions' figures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ArtifactSize {
    /// Median, in units of the sensor.
    pub median: Option<Spread>,
    /// 95th percentile, in units of the sensor.
    pub p95: Option<Spread>,
    /// Force of a tap with the same reading as the median, gF; `None` without a force sensor, or if the artifact is
    /// larger than any press.
    pub median_gf: Option<Spread>,
    /// The same, N.
    pub median_n: Option<Spread>,
    /// Force of a tap with the same reading as the 95th percentile, gF.
    pub p95_gf: Option<Spread>,
    /// The same, N.
    pub p95_n: Option<Spread>,
    /// Number of sessions in which the 95th percentile is larger than any press, so that it has no force.
    pub n_beyond: usize,
}

/// The artifact of one instructed pose or movement.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PoseArtifact {
    /// Its name in the annotations.
    pub pose: String,
    /// Time in it, s.
    pub seconds: f64,
    /// Its size.
    pub size: ArtifactSize,
}

/// Sizes of one session.
#[derive(Debug, Clone, Copy)]
struct Size {
    median: f64,
    p95: f64,
    median_gf: Option<f64>,
    p95_gf: Option<f64>,
    has_curve: bool,
}

impl Size {
    fn of(mut sizes: Vec<f64>, curve: Option<&ForceCurve>) -> Option<Self> {
        let (median, p95) = (quantile(&mut sizes, 0.5)?, quantile(&mut sizes, 0.95)?);
        let force = |size| curve.and_then(|curve| curve.force_gf(size));
        Some(Size { median, p95, median_gf: force(median), p95_gf: force(p95), has_curve: curve.is_some() })
    }
}

impl ArtifactSize {
    fn of(sizes: &[Size]) -> Self {
        let spread = |figure: fn(&Size) -> Option<f64>| Spread::of(sizes.iter().map(figure));
        let newtons = |force: Option<f64>| force.map(|force| Newton::from(GramForce(force)).0);
        ArtifactSize {
            median: spread(|size| Some(size.median)),
            p95: spread(|size| Some(size.p95)),
            median_gf: spread(|size| size.median_gf),
            median_n: Spread::of(sizes.iter().map(|size| newtons(size.median_gf))),
            p95_gf: spread(|size| size.p95_gf),
            p95_n: Spread::of(sizes.iter().map(|size| newtons(size.p95_gf))),
            n_beyond: sizes.iter().filter(|size| size.has_curve && size.p95_gf.is_none()).count(),
        }
    }
}

impl ArtifactReport {
    /// The artifacts of all sessions; the curve of each session converts readings to forces.
    pub(super) fn of(sessions: &[Posed<'_>], curves: &[Option<ForceCurve>]) -> Self {
        let (mut movement, mut by_session) = (Vec::new(), Vec::new());
        let mut by_pose: BTreeMap<&str, (f64, Vec<Size>)> = BTreeMap::new();
        for (posed, curve) in sessions.iter().zip(curves) {
            let (frames, artifacts) = (posed.session.frames, artifacts(posed));
            let size = Size::of(artifacts.iter().map(|(_, size)| *size).collect(), curve.as_ref());
            by_session.push(ArtifactSize::of(size.as_slice()));
            movement.extend(size);
            let mut of_pose: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
            for (idx, size) in artifacts {
                let pose = frames.instructed.get(idx).copied().flatten();
                of_pose.entry(pose.map_or("", |pose| frames.poses[pose].as_str())).or_default().push(size);
            }
            for (pose, sizes) in of_pose.into_iter().filter(|(pose, _)| !pose.is_empty()) {
                let seconds = sizes.len() as f64 * posed.session.period_s;
                let (total, known) = by_pose.entry(pose).or_default();
                *total += seconds;
                known.extend(Size::of(sizes, curve.as_ref()).filter(|_| seconds >= MIN_POSE_S));
            }
        }
        let told = by_pose.into_iter().filter(|(_, (_, sizes))| !sizes.is_empty());
        let mut by_pose: Vec<PoseArtifact> = told
            .map(|(pose, (seconds, sizes))| PoseArtifact {
                pose: pose.to_owned(),
                seconds,
                size: ArtifactSize::of(&sizes),
            })
            .collect();
        let p95 = |pose: &PoseArtifact| pose.size.p95.map_or(0.0, |spread| spread.median);
        by_pose.sort_by(|a, b| p95(b).total_cmp(&p95(a)));
        ArtifactReport { movement: ArtifactSize::of(&movement), by_pose, by_session }
    }
}

/// Absolute distance of each frame in the air from the reading of the straight hand.
fn artifacts(posed: &Posed<'_>) -> Vec<(usize, f64)> {
    let session = &posed.session;
    let smooth = session.smoothed_in_air(&session.sum, SMOOTH_S);
    let in_air = || session.in_air.iter().cloned().flatten();
    let is_straight = |idx: &usize| posed.score.as_ref().is_none_or(|score| score[*idx] <= STRAIGHT);
    let mut straight: Vec<f64> = in_air().filter(is_straight).map(|idx| smooth[idx]).collect();
    let reference = quantile(&mut straight, 0.5).unwrap_or(0.0);
    in_air().map(|idx| (idx, (smooth[idx] - reference).abs())).collect()
}
