//! `tpf eval --parquet` and `--frames`: scores and frames as tables.

use std::path::{Path, PathBuf};

use tactile_pose_fusion::columns::{Cells, ColumnFile, ColumnsError, Kind};
use tactile_pose_fusion::eval::{GroupScore, Measure, Metric, ScoredFrames, TangentialScore};
use tactile_pose_fusion::evaluate::{Evaluated, Series, SessionToScore};

const SCORES: [(&str, Kind); 23] = [
    ("model", Kind::Text),
    ("by", Kind::Text),
    ("free_movement", Kind::Flag),
    ("glove", Kind::Text),
    ("user", Kind::Text),
    ("session", Kind::Text),
    ("stage", Kind::Text),
    ("substage", Kind::Text),
    ("ba", Kind::Number),
    ("f1", Kind::Number),
    ("mdf_gf", Kind::Number),
    ("mdf", Kind::Text),
    ("mae_gf", Kind::Number),
    ("r2", Kind::Number),
    ("tangential_mae_gf", Kind::Number),
    ("angle_deg", Kind::Number),
    ("n_tangential", Kind::Whole),
    ("n_scored", Kind::Whole),
    ("n_without_truth", Kind::Whole),
    ("n_without_estimate", Kind::Whole),
    ("synthetic", Kind::Flag),
    ("model_sha256", Kind::Text),
    ("scored", Kind::Text),
];

const FRAMES: [(&str, Kind); 24] = [
    ("stamp", Kind::Stamp),
    ("model", Kind::Text),
    ("glove", Kind::Text),
    ("user", Kind::Text),
    ("session", Kind::Text),
    ("stage", Kind::Text),
    ("substage", Kind::Text),
    ("pose", Kind::Text),
    ("zero_load", Kind::Flag),
    ("truth_gf", Kind::Number),
    ("estimate_gf", Kind::Number),
    ("true_tangential_x_gf", Kind::Number),
    ("true_tangential_y_gf", Kind::Number),
    ("true_tangential_z_gf", Kind::Number),
    ("tangential_x_gf", Kind::Number),
    ("tangential_y_gf", Kind::Number),
    ("tangential_z_gf", Kind::Number),
    ("base_gf", Kind::Number),
    ("artifact_gf", Kind::Number),
    ("touch", Kind::Number),
    ("contact", Kind::Flag),
    ("base_contact", Kind::Flag),
    ("pose_age_ms", Kind::Number),
    ("synthetic", Kind::Flag),
];

/// Writes one row a model and group: every score that the JSON has.
///
/// # Errors
/// [`ColumnsError`] when the file can't be written.
pub fn write_scores(path: &Path, result: &Evaluated, overwrite: bool) -> Result<(), ColumnsError> {
    let mut file = ColumnFile::create(path, &SCORES, &notes(result.synthetic), overwrite)?;
    for model in &result.models {
        for (scores, is_free) in [(&model.by, false), (&model.free_movement, true)] {
            for (by, groups) in scores {
                let n = groups.len();
                let name = |of: fn(&GroupScore) -> &Option<String>| {
                    Cells::Text(groups.iter().map(|one| of(one).clone()).collect())
                };
                let metric =
                    |of: fn(&GroupScore) -> Metric| Cells::Number(groups.iter().map(|one| of(one).value()).collect());
                let count = |of: fn(&GroupScore) -> u64| {
                    Cells::Whole(groups.iter().map(|one| i64::try_from(of(one)).ok()).collect())
                };
                // Absent where truth or model has one axis.
                let tangential = |of: fn(TangentialScore) -> Option<f64>| {
                    Cells::Number(groups.iter().map(|one| one.score.tangential.and_then(of)).collect())
                };
                let text = |text: &str| Cells::Text(vec![Some(text.to_owned()); n]);
                file.write(&[
                    text(&model.name),
                    text(by),
                    Cells::Flag(vec![Some(is_free); n]),
                    name(|one| &one.group.glove),
                    name(|one| &one.group.user),
                    name(|one| &one.group.session),
                    name(|one| &one.group.stage),
                    name(|one| &one.group.substage),
                    metric(|one| one.score.ba),
                    metric(|one| one.score.f1),
                    Cells::Number(groups.iter().map(|one| Measure::Mdf.value(&one.score)).collect()),
                    Cells::Text(groups.iter().map(|one| Some(one.score.mdf.to_string())).collect()),
                    metric(|one| one.score.mae_gf),
                    metric(|one| one.score.r2),
                    tangential(|score| score.mae_gf.value()),
                    tangential(|score| score.angle_deg.value()),
                    Cells::Whole(
                        groups
                            .iter()
                            .map(|one| one.score.tangential.and_then(|of| i64::try_from(of.n_frames).ok()))
                            .collect(),
                    ),
                    count(|one| one.score.coverage.n_scored),
                    count(|one| one.score.coverage.n_without_truth),
                    count(|one| one.score.coverage.n_without_estimate),
                    Cells::Flag(vec![Some(result.synthetic); n]),
                    Cells::Text(vec![model.sha256.clone(); n]),
                    text(result.scored),
                ])?;
            }
        }
    }
    file.finish()
}

/// Frames on their way to a table, session by session.
pub struct FrameFile {
    path: PathBuf,
    overwrite: bool,
    file: Option<ColumnFile>,
}

impl FrameFile {
    /// A table that is made with its first session.
    pub fn new(path: &Path, overwrite: bool) -> Self {
        FrameFile { path: path.to_path_buf(), overwrite, file: None }
    }

    /// Takes a session: every series of the table, and no pose that was made worse.
    ///
    /// # Errors
    /// [`ColumnsError`] when the file can't be written.
    pub fn handle_session(&mut self, series: &[Series], session: &SessionToScore) -> Result<(), ColumnsError> {
        if self.file.is_none() {
            let notes = notes(session.summary.synthetic);
            self.file = Some(ColumnFile::create(&self.path, &FRAMES, &notes, self.overwrite)?);
        }
        let Some(file) = &mut self.file else { return Ok(()) };
        for (series, of_regions) in series.iter().zip(&session.frames).filter(|(one, _)| one.quality.is_none()) {
            for frames in of_regions {
                file.write(&cells(&series.name, frames, session.summary.synthetic))?;
            }
        }
        Ok(())
    }

    /// Gives the table its name.
    ///
    /// # Errors
    /// [`ColumnsError`] when the file can't be written.
    pub fn finish(self) -> Result<(), ColumnsError> {
        self.file.map_or(Ok(()), ColumnFile::finish)
    }
}

fn cells(model: &str, frames: &ScoredFrames, is_synthetic: bool) -> [Cells; FRAMES.len()] {
    let n = frames.stamp.len();
    let origin = |of: fn(&tactile_pose_fusion::eval::Origin) -> &String| {
        Cells::Text(frames.origin.iter().map(|idx| frames.origins.get(*idx).map(|origin| of(origin).clone())).collect())
    };
    let asked = |idx: &usize| frames.asked.get(*idx);
    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    let axis = |column: &[Option<[f64; 3]>], axis: usize| {
        let force = |idx: usize| finite((*column.get(idx)?)?[axis]);
        Cells::Number((0..n).map(force).collect())
    };
    let base = |idx: usize| frames.base_gf.get(idx).copied().flatten();
    let artifact = |idx: usize| Some(base(idx)? - frames.estimate_gf[idx]?);
    [
        Cells::Stamp(frames.stamp.iter().copied().map(Some).collect()),
        Cells::Text(vec![Some(model.to_owned()); n]),
        origin(|origin| &origin.glove),
        origin(|origin| &origin.user),
        origin(|origin| &origin.session),
        origin(|origin| &origin.stage),
        origin(|origin| &origin.substage),
        Cells::Text(frames.origin.iter().map(|idx| asked(idx).map(|asked| asked.pose.clone())).collect()),
        Cells::Flag(frames.origin.iter().map(|idx| asked(idx).map(|asked| asked.zero_load)).collect()),
        Cells::Number(frames.truth_gf.iter().map(|truth| finite(*truth)).collect()),
        Cells::Number(frames.estimate_gf.clone()),
        axis(&frames.true_tangential_gf, 0),
        axis(&frames.true_tangential_gf, 1),
        axis(&frames.true_tangential_gf, 2),
        axis(&frames.tangential_gf, 0),
        axis(&frames.tangential_gf, 1),
        axis(&frames.tangential_gf, 2),
        Cells::Number((0..n).map(base).collect()),
        Cells::Number((0..n).map(artifact).collect()),
        Cells::Number((0..n).map(|idx| frames.touch.get(idx).copied().flatten()).collect()),
        Cells::Flag(frames.contact.iter().copied().map(Some).collect()),
        Cells::Flag((0..n).map(|idx| frames.base_contact.get(idx).copied()).collect()),
        Cells::Number(frames.pose_age_ns.iter().map(|age| age.map(|age| age as f64 / 1e6)).collect()),
        Cells::Flag(vec![Some(is_synthetic); n]),
    ]
}

fn notes(is_synthetic: bool) -> [(&'static str, String); 2] {
    [("synthetic", is_synthetic.to_string()), ("made_by", format!("tactile_pose_fusion {}", env!("CARGO_PKG_VERSION")))]
}
