//! Converts a session to a table with one row per region and frame, at the rate of the model.

use super::{ExportError, SessionToExport};
use crate::columns::{Cells, Kind};
use crate::config::Config;
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

/// Where a model gives forces of three axes: x, y, z in the frame of the patch.
const TANGENTIAL: [&str; 3] = ["tangential_x_n", "tangential_y_n", "tangential_z_n"];

/// The same of the truth, where force sensors of the parameters have three axes.
const TANGENTIAL_TRUTH: [&str; 3] = ["truth_tangential_x_n", "truth_tangential_y_n", "truth_tangential_z_n"];

/// Columns of a table beside its fixed ones, as its first session decides.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TableLayout {
    joints: Vec<String>,
    /// `[regions]`: whether its estimates have tangential forces. The columns are there if one has.
    tangential: Vec<bool>,
    tangential_truth: bool,
}

impl TableLayout {
    /// The layout of a table whose first session is this one.
    pub fn of(cfg: &Config, session: &SessionToExport<'_>) -> Self {
        TableLayout {
            joints: session.samples.joint_names.clone(),
            tangential: session.estimates.iter().map(EstimateTrack::has_tangential).collect(),
            tangential_truth: cfg.truth_sources().iter().any(|source| source.axes.is_some()),
        }
    }

    fn has_tangential(&self) -> bool {
        self.tangential.contains(&true)
    }

    /// The columns of the table.
    pub fn columns(&self) -> Vec<(String, Kind)> {
        let fixed = COLUMNS.iter().map(|(name, kind)| ((*name).to_owned(), *kind));
        let tangential = TANGENTIAL.iter().filter(|_| self.has_tangential());
        let tangential = tangential.map(|name| ((*name).to_owned(), Kind::Number));
        let joints = self.joints.iter().map(|joint| (format!("joint.{joint}"), Kind::Number));
        let truth = TANGENTIAL_TRUTH.iter().filter(|_| self.tangential_truth);
        let truth = truth.map(|name| ((*name).to_owned(), Kind::Number));
        fixed.chain(tangential).chain(truth).chain(joints).collect()
    }
}

/// Rows of a session, region by region.
///
/// # Errors
/// [`ExportError::OtherJoints`] when the session lacks a joint of the table, [`ExportError::OtherAxes`] when it has
/// tangential forces and the table does not.
pub fn rows(
    cfg: &FusionConfig,
    layout: &TableLayout,
    session: &SessionToExport<'_>,
) -> Result<Vec<Vec<Cells>>, ExportError> {
    let joints = &layout.joints;
    refuse_other_axes(cfg, &layout.tangential, session)?;
    if let Some(missing) = joints.iter().find(|joint| !session.samples.joints.contains_key(*joint)) {
        let (expected, got) = (missing.clone(), session.samples.joint_names.join(", "));
        return Err(ExportError::OtherJoints { expected, got });
    }
    let regions = cfg.regions().iter().zip(session.estimates).enumerate();
    Ok(regions
        .map(|(region_idx, (region, track))| {
            let truth = session.truth.get(region_idx).and_then(Option::as_deref).unwrap_or_default();
            let truth = (0..track.stamp.len()).map(|idx| finite(Newton::from((*truth.get(idx)?)?)));
            let mut cells = of_region(session, region, track, truth.collect());
            if layout.has_tangential() {
                let axis = |axis: usize| track.tangential.iter().map(move |force| finite((*force)?[axis])).collect();
                cells.extend((0..TANGENTIAL.len()).map(|idx| Cells::Number(axis(idx))));
            }
            if layout.tangential_truth {
                let truth = session.tangential_truth.get(region_idx).and_then(Option::as_deref).unwrap_or_default();
                let at = |idx: usize, axis: usize| finite(Newton::from((*truth.get(idx)?)?[axis]));
                let axis = |axis: usize| (0..track.stamp.len()).map(|idx| at(idx, axis)).collect();
                cells.extend((0..TANGENTIAL_TRUTH.len()).map(|idx| Cells::Number(axis(idx))));
            }
            let max_age_ns = nanos(cfg.timing().usual_pose_age());
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

/// Refuses tangential forces that have no place: they would be lost.
fn refuse_other_axes(
    cfg: &FusionConfig,
    tangential: &[bool],
    session: &SessionToExport<'_>,
) -> Result<(), ExportError> {
    let regions = cfg.regions().iter().zip(session.estimates).zip(tangential);
    let mut regions = regions.filter(|((_, track), has_place)| track.has_tangential() && !**has_place);
    match regions.next() {
        Some(((region, _), _)) => Err(ExportError::OtherAxes { region: region.name.clone() }),
        None => Ok(()),
    }
}

fn of_region(
    session: &SessionToExport<'_>,
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
