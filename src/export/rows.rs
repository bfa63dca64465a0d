//! Converts a session to a table with one row per region and frame, at the rate of the model.

use super::{ExportError, Session};
use crate::columns::{Cells, Kind};
use crate::fusion::{FusionConfig, RegionConfig};
use crate::protocol::Annotation;
use crate::recording::EstimateTrack;
use crate::units::{Newton, nanos};

const COLUMNS: [(&str, Kind); 16] = [
    ("stamp", Kind::Stamp),
    ("session", Kind::Text),
    ("region", Kind::Text),
    ("force_n", Kind::Number),
    ("base_n", Kind::Number),
    ("artifact_n", Kind::Number),
    ("touch", Kind::Number),
    ("contact", Kind::Flag),
    ("flags", Kind::Text),
    ("pose_age_ms", Kind::Number),
    ("truth_n", Kind::Number),
    ("stage", Kind::Whole),
    ("substage", Kind::Text),
    ("pose", Kind::Text),
    ("zero_load", Kind::Flag),
    ("synthetic", Kind::Flag),
];

/// Columns of a table with these joints.
pub fn columns(joints: &[String]) -> Vec<(String, Kind)> {
    let fixed = COLUMNS.iter().map(|(name, kind)| ((*name).to_owned(), *kind));
    fixed.chain(joints.iter().map(|joint| (format!("joint.{joint}"), Kind::Number))).collect()
}

/// Rows of a session, region by region.
///
/// # Errors
/// [`ExportError::OtherJoints`] if the session lacks a joint of the table.
pub fn rows(cfg: &FusionConfig, joints: &[String], session: &Session<'_>) -> Result<Vec<Vec<Cells>>, ExportError> {
    if let Some(missing) = joints.iter().find(|joint| !session.samples.joints.contains_key(*joint)) {
        let (expected, got) = (missing.clone(), session.samples.joint_names.join(", "));
        return Err(ExportError::OtherJoints { expected, got });
    }
    let regions = cfg.regions.iter().zip(session.estimates).enumerate();
    Ok(regions
        .map(|(region_idx, (region, track))| {
            let truth = session.truth.get(region_idx).and_then(Option::as_deref).unwrap_or_default();
            let truth = (0..track.stamp.len()).map(|idx| finite(Newton::from((*truth.get(idx)?)?)));
            let mut cells = of_region(session, region, track, truth.collect());
            let max_age_ns = nanos(cfg.timing.usual_pose_age());
            cells.extend(
                joints
                    .iter()
                    .filter_map(|joint| session.samples.joints.get(joint))
                    .map(|joint| Cells::Number(track.stamp.iter().map(|stamp| joint.at(*stamp, max_age_ns)).collect())),
            );
            cells
        })
        .collect())
}

fn of_region(
    session: &Session<'_>,
    region: &RegionConfig,
    track: &EstimateTrack,
    truth: Vec<Option<f64>>,
) -> Vec<Cells> {
    let n = track.stamp.len();
    let text = |text: &str| Cells::Text(vec![Some(text.to_owned()); n]);
    let asked: Vec<Option<&Annotation>> = track.stamp.iter().map(|stamp| session.annotations.at(*stamp)).collect();
    let of_asked = |of: fn(&Annotation) -> &String| {
        Cells::Text(asked.iter().map(|asked| asked.map(|asked| of(asked).clone())).collect())
    };
    let known = |idx: usize| track.force[idx].is_some();
    vec![
        Cells::Stamp(track.stamp.iter().copied().map(Some).collect()),
        text(&session.name),
        text(&region.name),
        Cells::Number(track.force.iter().map(|force| force.and_then(finite)).collect()),
        Cells::Number(track.base.iter().map(|base| base.and_then(finite)).collect()),
        Cells::Number((0..n).map(|idx| track.artifact(idx).and_then(finite)).collect()),
        Cells::Number(track.touch.clone()),
        Cells::Flag((0..n).map(|idx| known(idx).then_some(track.contact[idx])).collect()),
        Cells::Text(track.flags.iter().map(|flags| Some(flags.to_string())).collect()),
        Cells::Number(track.pose_age_ns.iter().map(|age| age.map(|age| age as f64 / 1e6)).collect()),
        Cells::Number(truth),
        Cells::Whole(asked.iter().map(|asked| asked.map(|asked| i64::from(asked.stage))).collect()),
        of_asked(|asked| &asked.substage),
        of_asked(|asked| &asked.pose),
        Cells::Flag(asked.iter().map(|asked| asked.map(|asked| asked.zero_load)).collect()),
        Cells::Flag(vec![Some(session.synthetic); n]),
    ]
}

fn finite(force: Newton) -> Option<f64> {
    Some(force.0).filter(|force| force.is_finite())
}
