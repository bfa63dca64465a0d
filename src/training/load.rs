//! From bags to sessions that can be trained on: every column by the core that also runs live.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::Arc;

use super::TrainingError;
use crate::bag::{BagReader, Inputs};
use crate::config::Config;
use crate::eval::{Split, TruthError};
use crate::fusion::{ArtifactFilter, ArtifactFit, ArtifactModel, Following, ForceAxes, RegionIdx};
use crate::observer::{self, Observer};
use crate::recording::{self, Labels, Listener, Notes, RowCollector, Rows, aligned, input_topics, read};
use crate::sessions::{InAir, SessionError, annotated, session_name};
use crate::train::{ContactAxes, Session, SessionFrames};
use crate::units::Stamp;
use crate::zero::{self, KnownModels, Wanted};

/// Frames a second where neither parameters nor a model say it; the paper's.
const DEFAULT_RATE_HZ: f64 = 100.0;

/// How far the frames of a source may be from the rate that a model is trained for.
const RATE_TOLERANCE: f64 = 0.05;

/// One region's data out of bags.
pub(super) struct TrainingLoader<'c> {
    cfg: &'c Config,
    region_idx: usize,
    truth_idx: usize,
    window: NonZeroUsize,
    split: Split,
    rate_hz: f64,
    artifact: Option<Arc<ArtifactModel>>,
    in_air: Option<&'c InAir>,
    /// Of a force that has three.
    axes: Option<ContactAxes>,
}

/// A session, and what was noted about it.
pub(super) struct LoadedSession {
    pub(super) session: Session,
    pub(super) notes: Notes,
    /// Frames that could be used but for the truth, which was not measured there.
    pub(super) n_without_truth: usize,
    /// Its artifact, as its calibration found it.
    pub(super) fit: Option<ArtifactFit>,
}

impl<'c> TrainingLoader<'c> {
    /// A loader of the only region of a configuration; the network's kind decides whether its joints are read.
    pub(super) fn new(
        cfg: &'c Config,
        window: NonZeroUsize,
        split: Split,
        in_air: Option<&'c InAir>,
        axes: ForceAxes,
    ) -> Result<Self, TrainingError> {
        let region_idx = 0;
        let region = &cfg.fusion().regions()[region_idx];
        let Some(truth_idx) = cfg.truth_of_region()[region_idx] else {
            return Err(TrainingError::NoTruth { region: region.name.clone() });
        };
        let axes = match axes {
            ForceAxes::Normal => None,
            ForceAxes::Patch if cfg.truth_sources()[truth_idx].axes.is_none() => {
                return Err(TrainingError::OneAxis { truth: cfg.truth_sources()[truth_idx].name.clone() });
            }
            ForceAxes::Patch => Some(ContactAxes::of(&region.patch.normal_in_patch)),
        };
        let rate_hz = cfg.models()[region.model.position()].spec.rate_hz.unwrap_or(DEFAULT_RATE_HZ);
        Ok(TrainingLoader { cfg, region_idx, truth_idx, window, split, rate_hz, artifact: None, in_air, axes })
    }

    /// From now on taxels are those that this artifact was taken out of, followed as while the glove is worn. Returns the one before.
    pub(super) fn take_out(&mut self, artifact: Arc<ArtifactModel>) -> Option<Arc<ArtifactModel>> {
        self.artifact.replace(artifact)
    }

    /// Joints of its region, in their order, as the model is to name them.
    pub(super) fn joints(&self) -> &[String] {
        &self.cfg.fusion().regions()[self.region_idx].joints
    }

    /// The axes of a force that has three.
    pub(super) fn axes(&self) -> Option<ContactAxes> {
        self.axes
    }

    /// Model frames a second.
    pub(super) fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Name of its region.
    pub(super) fn region(&self) -> &str {
        &self.cfg.fusion().regions()[self.region_idx].name
    }

    /// Topic of the true force.
    pub(super) fn truth_topic(&self) -> &str {
        &self.cfg.truth()[self.truth_idx].name
    }

    /// Topics of a bag.
    pub(super) fn topics(bag: &Path) -> Result<BTreeSet<String>, TrainingError> {
        let reader = BagReader::open(&[bag.to_path_buf()])?;
        Ok(reader.channels().iter().map(|channel| channel.topic.clone()).collect())
    }

    /// Reads one bag.
    pub(super) fn load(&self, bag: &Path, observer: &dyn Observer) -> Result<LoadedSession, TrainingError> {
        let bags = [bag.to_path_buf()];
        let cfg = annotated(self.cfg, &bags, self.in_air, observer)?;
        let mut topics = input_topics(&cfg);
        topics.truth = vec![self.cfg.truth()[self.truth_idx].clone()];
        let mut reader = BagReader::open(&bags)?;
        let mut inputs = Inputs::new(topics, &mut reader).map_err(|error| TrainingError::at(bag, &error))?;
        inputs.read_only_these(&mut reader);
        if !inputs.has_annotations() {
            return Err(TrainingError::at(
                bag,
                &format!(
                    "no stage annotations on {}; training needs to know where nothing touches the glove: give --in-air FROM..TO or --zero-load-below FORCE, record that topic, or set stage_topic",
                    self.cfg.stage_topic
                ),
            ));
        }
        let known = KnownModels {
            artifacts: self.cfg.models().iter().map(|_| self.artifact.clone().map(|of| (of, self.rate_hz))).collect(),
            ..KnownModels::default()
        };
        let zero = zero::find(Wanted::Any, &cfg, &bags, &known).map_err(|error| TrainingError::at(bag, &error))?;
        zero.notes.iter().for_each(|note| observer.note(note));
        // What is trained on is followed, whatever the parameters of a node say.
        let fusion = self.cfg.fusion().clone().with_following(Following::On);
        let artifact = self.artifact.clone();
        let (mut rows, fusion) = RowCollector::new(fusion, self.window, self.rate_hz, artifact)?;
        let mut cores = [fusion];
        zero.install(&mut cores[0])?;
        let fit = cores[0].artifact(RegionIdx::at(0)).and_then(ArtifactFilter::fit);
        let mut labels = Labels::new(&self.cfg.truth_sources()[self.truth_idx..=self.truth_idx]);
        let listener = Listener::<SessionError> {
            on_tick: &mut |_, tick| rows.handle_tick(tick),
            on_other: &mut |_| Ok(()),
            is_wanted: &|_| true,
            pose: &mut [],
            between: &mut |_| Ok(observer::check(observer)?),
        };
        read(&mut reader, &mut inputs, &mut labels, &mut cores, listener).map_err(|error| error.of_bag(bag))?;
        let [fusion] = cores;
        inputs.check_end(fusion.missing_joints()).map_err(|error| TrainingError::at(bag, &error))?;
        for doubt in inputs.angle_doubts() {
            observer.warn(&format!("{}: {doubt}", bag.display()));
        }
        for loss in reader.losses() {
            observer.warn(&format!("{}: input lost: {loss}", bag.display()));
        }
        let measured = fusion.counters().tactile.first().and_then(|source| source.measured_rate_hz);
        if let Some(measured) = measured.filter(|hz| (hz / self.rate_hz - 1.0).abs() > RATE_TOLERANCE) {
            let (model, rate_hz) =
                (&self.cfg.models()[self.cfg.fusion().regions()[self.region_idx].model.position()].name, self.rate_hz);
            return Err(TrainingError::at(
                bag,
                &format!(
                    "frames come at {measured:.1} Hz and the model is trained for {rate_hz} Hz; set model.{model}.rate_hz, or frame_clock: grid"
                ),
            ));
        }
        let found = self.session(session_name(bag), &labels, rows.finish(), fit, observer);
        found.map_err(|error| TrainingError::at(bag, &error))
    }

    /// Puts rows and labels together.
    fn session(
        &self,
        name: String,
        labels: &Labels,
        rows: Rows,
        fit: Option<ArtifactFit>,
        observer: &dyn Observer,
    ) -> Result<LoadedSession, TrainingError> {
        let region = &self.cfg.fusion().regions()[self.region_idx];
        let n_joints = if self.artifact.is_some() { 0 } else { region.joints.len() };
        let n_taxels = self.artifact.as_ref().map_or(region.taxels.len(), |artifact| artifact.n_columns());
        let track = &labels.truth[0];
        let end = track.span().map_or(Stamp(i64::MIN), |(_, last)| last);
        let zero_load = recording::zero_load(&labels.annotations, end);
        let of_truth = |error: TruthError| TrainingError::At {
            path: format!("truth {}", track.name()),
            reason: error.to_string(),
        };
        let tare = track.tare(&zero_load).map_err(of_truth)?;
        let axes = match self.axes {
            Some(axes) => track.axis_tares(&zero_load).map_err(of_truth)?.map(|tares| (axes, tares)),
            None => None,
        };
        track.doubts(&tare).iter().for_each(|doubt| observer.warn(&format!("{name}: {doubt}")));
        let cuts = self.split.cuts(&recording::stage_spans(&labels.annotations, end.offset(1)));
        let truth = aligned(track, &tare, &rows.stamp, self.cfg.fusion().timing().max_gap);
        let mut frames = SessionFrames { name, n_taxels, n_joints, ..SessionFrames::default() };
        let (mut epoch, mut last, mut n_without_truth) = (0, None, 0);
        for (row, truth) in truth.iter().enumerate() {
            let stamp = rows.stamp[row];
            let tangential = axes.as_ref().and_then(|(axes, tares)| {
                let force = track.tangential_at(tares, stamp, self.cfg.fusion().timing().max_gap)?;
                Some(axes.tangents(force.map(|force| force.0)))
            });
            let Some(truth) = truth else {
                (last, n_without_truth) = (None, n_without_truth + 1);
                continue;
            };
            if last != Some(rows.stretch[row]) {
                (epoch, last) = (epoch + 1, Some(rows.stretch[row]));
            }
            // Before the first annotation there is no stage: nothing there is scored either.
            let Some(part) = cuts.part_at(stamp) else { continue };
            frames.tactile.extend_from_slice(&rows.tactile[row * n_taxels..(row + 1) * n_taxels]);
            frames.pose.extend_from_slice(&rows.pose[row * n_joints..(row + 1) * n_joints]);
            frames.truth_gf.push(truth.0 as f32);
            frames.tangential_gf.extend(tangential.into_iter().flatten().map(|force| force as f32));
            frames.zero_load.push(labels.annotations.at(stamp).is_some_and(|annotation| annotation.zero_load));
            frames.part.push(part);
            frames.epoch.push(epoch);
        }
        Ok(LoadedSession { session: Session::new(frames)?, notes: labels.notes.clone(), n_without_truth, fit })
    }
}
