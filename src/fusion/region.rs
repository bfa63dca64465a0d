//! One region: from frames and joint angles to windows, and from forces to estimates.

use serde::Serialize;

use super::artifact::{Adaptation, ArtifactError, ArtifactFilter, ArtifactFit, Following};
use super::calibration::Baseline;
use super::config::{RegionConfig, TactileSource};
use super::contact::{ContactDetector, ContactEvent};
use super::estimate::{Estimate, Flags, TickTaxels};
use super::features::{FeatureWindow, NewestWindow, TaxelFeatures};
use super::frames::Frame;
use super::gain::ForceGain;
use super::geometry::Patch;
use super::hold::Hold;
use super::idx::{ModelIdx, RegionIdx};
use super::joints::{JointTimelines, PoseTrust};
use super::queue::{Answer, ModelForce};
use super::regressor::{Contract, PoseRange};
use crate::units::{GramForce, NANOS_PER_SEC, Newton, Stamp};

/// Contact starts anew with a new zero, as if more time were lost than there is.
const NEW_ZERO: i64 = i64::MAX;

/// Counters of a region's frames, by outcome. Every frame is counted in `estimates` or in exactly one of the five after it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct RegionCounters {
    /// Frames of the region's source.
    pub frames: u64,
    /// Frames with an estimate, degraded ones included.
    pub estimates: u64,
    /// Frames without one: the window was not full.
    pub warmup: u64,
    /// Frames without one: there is no baseline.
    pub uncalibrated: u64,
    /// Frames without one: the pose was unknown or too old, and the model has no base branch to fall back on.
    pub stale_pose: u64,
    /// Frames without one: a taxel or the model's output was NaN or infinite.
    pub non_finite: u64,
    /// Frames without one: the source stood still.
    pub frozen: u64,
    /// Estimates without the pose, because it was unknown or stale: of the base branch alone, or with the artifact of the
    /// last pose.
    pub base_only: u64,
    /// Estimates with a pose that was held for longer than its source's rate explains.
    pub held_pose: u64,
    /// Estimates with a joint outside of what the model was trained on.
    pub pose_out_of_range: u64,
    /// Frames whose stamp was too far from their receipt, with an estimate or without.
    pub late: u64,
    /// Frames that were missing and interpolated.
    pub filled_frames: u64,
    /// Times the window was emptied by a gap or a jump of time.
    pub window_resets: u64,
    /// Contacts that began.
    pub onsets: u64,
    /// Contacts that ended.
    pub offsets: u64,
}

/// State of a region's window after a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Readiness {
    /// True if the window should be run.
    pub(super) run: bool,
    /// True if only the tactile branch of what comes out may be used.
    pub(super) base_only: bool,
    /// Time that was lost before this frame, ns, so that contact starts again; [`NEW_ZERO`] for a new zero.
    pub(super) lost_ns: Option<i64>,
    pub(super) pose_age_ns: Option<i64>,
    pub(super) flags: Flags,
    pub(super) adaptation: Adaptation,
    pub(super) artifact_change: Option<f64>,
    /// Log odds by which a touch must be clearer than the model says.
    pub(super) touch_margin: f64,
    /// Log odds by which the frame is less evidence of a contact.
    pub(super) evidence_margin: f64,
    /// Touch that the artifact filter sees without doubt, gF.
    pub(super) held_gf: Option<f64>,
}

#[derive(Debug, Clone)]
struct LastGood {
    stamp: Stamp,
    epoch: u64,
    number: i64,
}

/// Indices of a region.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Index in the configuration.
    pub(super) region: RegionIdx,
    /// Index of its model.
    pub(super) model: ModelIdx,
    /// Its lane among the windows that wait for that model.
    pub(super) lane: usize,
}

/// The state of one region.
#[derive(Debug, Clone)]
pub(super) struct Region {
    pub(super) place: Place,
    features: TaxelFeatures,
    patch: Patch,
    joints: Vec<usize>,
    pose_range: Option<Vec<PoseRange>>,
    has_base: bool,
    artifact: Option<ArtifactFilter>,
    adaptation: Adaptation,
    /// When an artifact was taken out last.
    corrected: Option<Stamp>,
    frame_ns: f64,
    /// Joints of the model's pose input: all of the region's, or none.
    n_input_joints: usize,
    window: FeatureWindow,
    last: Option<LastGood>,
    n_taxels: usize,
    last_tactile: Vec<f32>,
    /// Columns of the model's tactile input: the taxels first.
    tactile: Vec<f32>,
    between: Vec<f32>,
    pose: Vec<f32>,
    faulty: bool,
    /// Gain of the model's forces, from known touches of this donning.
    gain: Option<ForceGain>,
    hold: Hold,
    /// Faults of its taxels at the current frame.
    faults: Flags,
    /// Time that was lost, if the window was emptied since the last frame. Contact learns of it with the next one, because
    /// frames from before may still wait for their forces.
    lost_ns: Option<i64>,
    max_gap_ns: i64,
    pub(super) contact: ContactDetector,
    pub(super) counters: RegionCounters,
}

impl Region {
    /// A region whose joints are given as indices into the timelines.
    pub(super) fn new(
        place: Place,
        cfg: &RegionConfig,
        source: &TactileSource,
        contract: &Contract,
        joints: Vec<usize>,
        max_gap_ns: i64,
        following: Following,
    ) -> Self {
        let (n_columns, n_joints, n_input_joints) = (contract.n_columns(), joints.len(), contract.n_joints);
        let frame_ns = NANOS_PER_SEC as f64 / contract.rate_hz;
        let filter_of = |model: &_| ArtifactFilter::new(std::sync::Arc::clone(model), contract.rate_hz, following);
        Region {
            place,
            features: TaxelFeatures::new(cfg, source),
            patch: cfg.patch.clone(),
            joints,
            pose_range: contract.pose_range.clone(),
            has_base: contract.has_base,
            artifact: contract.artifact.as_ref().map(filter_of),
            adaptation: Adaptation::default(),
            corrected: None,
            frame_ns,
            n_input_joints,
            window: FeatureWindow::new(contract.window, n_columns, n_input_joints),
            last: None,
            n_taxels: cfg.taxels.len(),
            last_tactile: vec![0.0; n_columns],
            tactile: vec![0.0; n_columns],
            between: vec![0.0; n_columns],
            pose: vec![0.0; n_joints],
            faulty: false,
            gain: None,
            hold: Hold::new(frame_ns),
            faults: Flags::default(),
            lost_ns: None,
            max_gap_ns,
            contact: ContactDetector::new(cfg.contact, contract.touch),
            counters: RegionCounters::default(),
        }
    }

    /// Takes note of a new baseline: frames that had another one subtracted are forgotten.
    pub(super) fn handle_baseline(&mut self, cfg: &RegionConfig, baseline: &Baseline) {
        self.faulty = cfg.taxels.iter().any(|&taxel_idx| baseline.faulty[taxel_idx]);
        if let Some(artifact) = &mut self.artifact {
            artifact.clear();
        }
        self.corrected = None;
        self.gain = None;
        self.reset(NEW_ZERO);
    }

    /// Takes the gain of its forces from known touches of this donning.
    pub(super) fn handle_force_gain(&mut self, gain: &ForceGain) {
        self.gain = Some(*gain);
    }

    /// Gain from known touches of this donning.
    pub(super) fn force_gain(&self) -> Option<&ForceGain> {
        self.gain.as_ref()
    }

    /// Takes the artifact of this donning, if the model has artifacts.
    pub(super) fn handle_artifact(&mut self, fit: ArtifactFit) -> Result<(), ArtifactError> {
        self.artifact.as_mut().map_or(Ok(()), |artifact| artifact.handle_fit(fit))
    }

    /// The artifact of this donning as it is now.
    pub(super) fn artifact(&self) -> Option<&ArtifactFilter> {
        self.artifact.as_ref()
    }

    /// Takes a frame of the region's source, with the faults of its taxels, and returns whether there is a window to run.
    pub(super) fn handle_frame(
        &mut self,
        frame: &Frame<'_>,
        faults: Flags,
        baseline: Option<&Baseline>,
        joints: &JointTimelines,
    ) -> Readiness {
        self.counters.frames += 1;
        self.faults = faults;
        self.adaptation = self.artifact.as_ref().map(ArtifactFilter::idle).unwrap_or_default();
        let since_last_ns = self.last.as_ref().map(|last| frame.stamp.nanos_since(last.stamp));
        let is_connected = |last: &LastGood| last.epoch == frame.epoch && since_last_ns <= Some(self.max_gap_ns);
        let connected = self.last.as_ref().is_some_and(is_connected);
        if let Some(lost_ns) = since_last_ns.filter(|_| !connected) {
            self.reset(lost_ns);
        }
        let Some(baseline) = baseline else { return self.no_estimate(Flags::UNCALIBRATED, None) };
        if faults.contains(Flags::FROZEN) {
            // Readings that stand still are no data: the window starts again after it, as after a gap.
            self.reset(0);
            let (_, pose_age_ns) = self.read_pose(joints, frame.stamp);
            return self.no_estimate(Flags::FROZEN, pose_age_ns);
        }
        if !self.features.write(frame.values, &baseline.median, &mut self.tactile) {
            let (_, pose_age_ns) = self.read_pose(joints, frame.stamp);
            return self.no_estimate(Flags::NON_FINITE, pose_age_ns);
        }
        let (trust, pose_age_ns) = self.read_pose(joints, frame.stamp);
        self.correct(frame, trust);
        if self.fill_up_to(frame, joints) {
            self.read_pose(joints, frame.stamp); // of this frame again
        }
        self.window.push(&self.tactile, &self.pose[..self.n_input_joints], trust);
        self.last = Some(LastGood { stamp: frame.stamp, epoch: frame.epoch, number: frame.number });
        self.last_tactile.copy_from_slice(&self.tactile);
        if !self.window.is_full() {
            return self.no_estimate(Flags::WARMUP, pose_age_ns);
        }
        let mut flags = Flags::default();
        let trust = self.window.pose_trust();
        let stale = trust == PoseTrust::Stale;
        let base_only = stale && self.n_input_joints > 0;
        if stale {
            flags.insert(Flags::STALE_POSE);
            if base_only && !self.has_base {
                return self.no_estimate(flags, pose_age_ns);
            }
        } else {
            if trust == PoseTrust::Held {
                flags.insert(Flags::HELD_POSE);
            }
            if self.is_out_of_range() {
                flags.insert(Flags::POSE_OUT_OF_RANGE);
            }
        }
        let touch_margin = self.artifact.as_ref().map_or(0.0, ArtifactFilter::touch_margin);
        let evidence_margin = self.artifact.as_ref().map_or(0.0, ArtifactFilter::evidence_margin);
        let held_gf = self.artifact.as_ref().and_then(ArtifactFilter::held_touch_gf);
        Readiness {
            run: true,
            base_only,
            touch_margin,
            evidence_margin,
            held_gf,
            ..self.no_estimate(flags, pose_age_ns)
        }
    }

    /// Adds its taxels of the frame that [`Region::handle_frame`] was given last.
    pub(super) fn keep_taxels(&self, frame: &Frame<'_>, taxels: &[usize], kept: &mut TickTaxels) {
        kept.reading.extend(taxels.iter().map(|&taxel_idx| frame.values[taxel_idx]));
        let is_input = |last: &LastGood| last.epoch == frame.epoch && last.number == frame.number;
        match self.last.as_ref().is_some_and(is_input) {
            true => kept.feature.extend_from_slice(&self.tactile[..taxels.len()]),
            false => kept.feature.extend(taxels.iter().map(|_| f32::NAN)),
        }
    }

    /// The window that [`Region::handle_frame`] said to run.
    pub(super) fn window(&mut self) -> NewestWindow<'_> {
        self.window.take()
    }

    /// Turns the model's output, if it was run, into the estimate of the frame at `stamp`.
    pub(super) fn estimate(&mut self, stamp: Stamp, readiness: &Readiness, answer: Option<Answer>) -> Estimate {
        let mut flags = readiness.flags;
        let (given, given_base, mut touch) = match answer {
            // Touch is of taxels and pose together, as the force is that is not used.
            Some(Answer { base, .. }) if readiness.base_only => (base, base, None),
            Some(Answer { force, base, touch }) => {
                (Some(force), base, touch.map(|touch| less_certain(touch, readiness.touch_margin)))
            }
            None => (None, None, None),
        };
        let (mut force, mut tangential) = self.along_and_across(given);
        if let Some(held) = self.hold(stamp, readiness, &mut touch) {
            force = force.map(|force| if force < held { held } else { force }); // and NaN stays
        }
        let (mut force_base, base_tangential) = self.along_and_across(given_base);
        let forces = [force, force_base]
            .into_iter()
            .chain([tangential, base_tangential].into_iter().flatten().flatten().map(Some));
        let numbers = forces.map(|force| force.map(|force| force.0)).chain([touch]);
        if numbers.flatten().any(|number| !number.is_finite()) {
            flags.insert(Flags::NON_FINITE);
            (force, tangential, force_base, touch) = (None, None, None, None);
        }
        let counters = &mut self.counters;
        match force {
            Some(_) => {
                counters.estimates += 1;
                counters.base_only += u64::from(flags.contains(Flags::STALE_POSE));
                counters.held_pose += u64::from(flags.contains(Flags::HELD_POSE));
                counters.pose_out_of_range += u64::from(flags.contains(Flags::POSE_OUT_OF_RANGE));
            }
            None if flags.contains(Flags::FROZEN) => counters.frozen += 1,
            None if flags.contains(Flags::NON_FINITE) => counters.non_finite += 1,
            None if flags.contains(Flags::UNCALIBRATED) => counters.uncalibrated += 1,
            None if flags.contains(Flags::STALE_POSE) => counters.stale_pose += 1,
            None => counters.warmup += 1,
        }
        if readiness.lost_ns.is_some() {
            self.contact.handle_reset();
        }
        let contact = self.contact.handle_estimate(stamp, force, touch, readiness.evidence_margin);
        counters.onsets += u64::from(contact.event == ContactEvent::Onset);
        counters.offsets += u64::from(contact.event == ContactEvent::Offset);
        let Readiness { pose_age_ns, adaptation, artifact_change, .. } = *readiness;
        let region = self.place.region;
        Estimate {
            region,
            force,
            tangential,
            force_base,
            touch,
            contact,
            pose_age_ns,
            flags,
            adaptation,
            artifact_change,
        }
    }

    /// Raises the probability of a touch that is [held](Hold) to that of contact, and returns the force that the artifact filter sees.
    fn hold(&mut self, stamp: Stamp, readiness: &Readiness, touch: &mut Option<f64>) -> Option<Newton> {
        if let Some(lost_ns) = readiness.lost_ns {
            self.hold.handle_gap(stamp, lost_ns, self.contact.state());
            return None;
        }
        let Some((touch, on)) = touch.as_mut().zip(self.contact.touch_on()) else {
            self.hold.handle_unknown();
            return None;
        };
        let held_gf = self.hold.handle_touch(stamp, *touch, on, readiness.held_gf)?;
        *touch = on;
        Some(self.of_donning(GramForce(held_gf).into()))
    }

    /// Normal and tangential force of what the model gave, in this donning. The gain of the donning is that of all axes:
    /// known touches tell how much the glove feels, and change no direction.
    fn along_and_across(&self, given: Option<ModelForce>) -> (Option<Newton>, Option<[Newton; 3]>) {
        let of_donning = |force| self.of_donning(force);
        match given {
            None => (None, None),
            Some(ModelForce::Normal(force)) => (Some(of_donning(force)), None),
            Some(ModelForce::Patch(force)) => {
                let (along, across) = self.patch.split(force);
                (Some(of_donning(along)), Some(across.map(of_donning)))
            }
        }
    }

    fn of_donning(&self, force: Newton) -> Newton {
        Newton(self.gain.map_or(1.0, |known| known.gain) * force.0)
    }

    fn no_estimate(&mut self, flags: Flags, pose_age_ns: Option<i64>) -> Readiness {
        let lost_ns = self.lost_ns.take();
        let (adaptation, flags) = (self.adaptation, self.with_fault(flags));
        let artifact_change = self.artifact_change();
        let (run, base_only, touch_margin, evidence_margin, held_gf) = (false, false, 0.0, 0.0, None);
        Readiness {
            run,
            base_only,
            lost_ns,
            pose_age_ns,
            flags,
            adaptation,
            artifact_change,
            touch_margin,
            evidence_margin,
            held_gf,
        }
    }

    fn artifact_change(&self) -> Option<f64> {
        self.artifact.as_ref().filter(|_| self.adaptation != Adaptation::Off).map(ArtifactFilter::change)
    }

    fn with_fault(&self, flags: Flags) -> Flags {
        let flags = flags | self.faults;
        if self.faulty { flags | Flags::FAULTY_TAXEL } else { flags }
    }

    fn reset(&mut self, lost_ns: i64) {
        if self.last.take().is_some() {
            self.counters.window_resets += 1;
        }
        self.window.clear();
        if let Some(artifact) = &mut self.artifact {
            artifact.restart();
        }
        self.lost_ns = self.lost_ns.max(Some(lost_ns));
    }

    /// Takes the artifact of the region's joints out of the taxels.
    fn correct(&mut self, frame: &Frame<'_>, trust: PoseTrust) {
        let Some(artifact) = &mut self.artifact else { return };
        // Also after a gap: the glove was worn all the while.
        let elapsed_ns = self.corrected.replace(frame.stamp).map_or(0, |last| frame.stamp.nanos_since(last));
        let n_frames = (elapsed_ns as f64 / self.frame_ns).round().clamp(1.0, f64::from(i32::MAX)) as i32;
        let may_learn = trust == PoseTrust::Fresh && self.faults.is_empty() && !self.faulty;
        let pose = (trust != PoseTrust::Stale).then_some(self.pose.as_slice());
        let (tactile, trust) = self.tactile.split_at_mut(self.n_taxels);
        self.adaptation = artifact.correct(tactile, pose, n_frames, may_learn);
        if !trust.is_empty() {
            artifact.write_trust(trust);
        }
    }

    /// Interpolates the frames that are missing since the last good one; whether there were any.
    fn fill_up_to(&mut self, frame: &Frame<'_>, joints: &JointTimelines) -> bool {
        let Some(last) = self.last.clone() else { return false };
        let missing = frame.number - last.number - 1;
        let span_ns = frame.stamp.nanos_since(last.stamp);
        for k in 1..=missing {
            let part = k as f64 / (missing + 1) as f64;
            for (between, (&before, &after)) in self.between.iter_mut().zip(self.last_tactile.iter().zip(&self.tactile))
            {
                *between = (f64::from(before) + (f64::from(after) - f64::from(before)) * part) as f32;
            }
            let (trust, _) = self.read_pose(joints, last.stamp.offset((span_ns as f64 * part) as i64));
            self.window.push(&self.between, &self.pose[..self.n_input_joints], trust);
            self.counters.filled_frames += 1;
        }
        missing > 0
    }

    /// Reads the joints at `stamp` into `pose`; how far the worst of them may be trusted, and the age of the oldest.
    ///
    /// A joint that has never been seen leaves its last value in place: such a frame is never used with its pose.
    fn read_pose(&mut self, joints: &JointTimelines, stamp: Stamp) -> (PoseTrust, Option<i64>) {
        let (mut trust, mut seen, mut age_ns) = (PoseTrust::Fresh, true, 0);
        for (angle, &joint_idx) in self.pose.iter_mut().zip(&self.joints) {
            match joints.angle_at(joint_idx, stamp) {
                Some(joint) => {
                    *angle = joint.angle as f32;
                    trust = trust.max(joint.trust);
                    age_ns = age_ns.max(joint.age_ns);
                }
                None => (trust, seen) = (PoseTrust::Stale, false),
            }
        }
        (trust, (seen && !self.joints.is_empty()).then_some(age_ns))
    }

    fn is_out_of_range(&self) -> bool {
        let Some(ranges) = &self.pose_range else { return false };
        let mut angles = self.pose.iter().zip(ranges);
        angles.any(|(&angle, range)| f64::from(angle) < range.min || f64::from(angle) > range.max)
    }
}

/// A probability whose log odds are lower by `margin`.
fn less_certain(probability: f64, margin: f64) -> f64 {
    if margin > 0.0 { probability / (probability + (1.0 - probability) * margin.exp()) } else { probability }
}
