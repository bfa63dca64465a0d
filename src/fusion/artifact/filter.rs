//! Gains and offsets of a donning followed while the glove is worn, and touch with them, by one Kalman filter.
//!
//! State: how far each gain and each offset is from the calibration, what each taxel reads of a touch, and the error of each joint's
//! angle. Several frames are averaged to one measurement of all taxels. What goes with changes of pose can only be a gain; a level
//! that stays while the pose changes is touch, unless it comes as slowly as offsets drift, and on each taxel by itself. A touch that
//! begins or ends is an innovation along the pattern of touches that the state did not expect: it widens the touches alone. A large
//! touch goes up and down on its own, so that gains don't have to explain it. A touch that is no larger than its own uncertainty is
//! taken for none.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::falls::{ENDING_SHARE, Falls};
use super::history::JointHistory;
use super::{ALIKE_BLOCKS, ArtifactError, ArtifactFit, ArtifactModel, DRIFT_TIME_S, block_frames};

/// How fast a held touch changes, gF^2/s; and how fast one of more than this force does, as a share of what is above it, in the
/// square root of a second. Chosen on validation data (docs/validation).
const TOUCH_WALK: f64 = 1.0;
const LARGE_TOUCH: f64 = 20.0;
const LARGE_TOUCH_WALK: f64 = 0.2;

/// Share of a touch by which it may read differently on each taxel than the pattern says, as a standard deviation: for as long
/// as it lasts, and from one measurement to the next.
const PATTERN_DEVIATION: f64 = 0.5;
const PATTERN_NOISE: f64 = 0.4;

/// An innovation along the pattern of touch of more deviations than this is a touch that begins or ends.
const ONSET_DEVIATIONS: f64 = 2.5;

/// A touch below this, gF, or below so many deviations of it, most likely is none; with this variance, gF^2, that is taken
/// for a measurement.
const FAINT_TOUCH: f64 = 1.5;
const FAINT_DEVIATIONS: f64 = 2.0;
const FAINT_VARIANCE: f64 = 100.0;

/// The deviation of what is left of a touch that ends is larger by this share of what taxels read of it.
const LEFT_SHARE: f64 = 0.5;

/// Share of a touch that is let go by which taxels may still read one, as a standard deviation, and how fast that goes away, s. No touch
/// is larger than the third, gF: such a reading is at fault, and must not count for long.
const RELAXING_SHARE: f64 = 0.02;
const RELAXING_S: f64 = 0.7;
const LARGEST_TOUCH: f64 = 1e4;

/// Variance of the touch at the start of frames, gF^2: after a calibration, in which there was none, and after a gap.
const CALIBRATED_VARIANCE: f64 = 1.0;
const UNKNOWN_VARIANCE: f64 = 100.0;

/// The error of a joint's angle, in deviations of its measured noise, and how long it stays, s: a tracker holds its angles, they are
/// smoothed, and it has errors that are no noise. Chosen on validation data (docs/validation).
const ANGLE_DEVIATIONS: f64 = 2.0;
const ANGLE_ERROR_S: f64 = 0.1;

/// How slowly the effect of the noise of joint angles on touch follows, s.
const DOUBT_S: f64 = 1.0;

/// Log odds that a touch loses for each e-fold by which noise of the joint angles raises the variance of what the artifact
/// leaves, and how many of them make no difference. Chosen on validation data (docs/validation).
const DOUBT_ODDS: f64 = 10.0;
const TOLERATED_ODDS: f64 = 0.4;

/// A network that is told of that noise keeps its log odds. At most so many are lost where they add up to evidence of a contact.
/// Chosen on validation data (docs/validation).
const MOST_EVIDENCE_LOST: f64 = 1.0;

/// A touch of so many deviations, and of the least force that counts as touch, gF, is held for as long as the measurements
/// are not older than this, s. One that was beyond doubt stays so down to fewer deviations: what is seen of a light touch goes up and down with
/// the pose. Chosen on validation data (docs/validation).
const HELD_DEVIATIONS: f64 = 5.0;
const STILL_HELD_DEVIATIONS: f64 = 3.0;
const LEAST_HELD: f64 = 2.5;
const HELD_FOR_S: f64 = 0.25;

/// How far a gain or an offset may go from its calibration, in standard deviations of its slip or drift, and of what the calibration left
/// unknown.
const MAX_DEVIATIONS: f64 = 3.0;

/// Share of the slip, and of the drift, that may have come since the calibration, at its end: parts of their variances. Chosen on validation
/// data (docs/validation): with more, a touch that is there from the start on is taken for slip. A calibration in which gains are taken for
/// constant does not tell how they slip, so more is assumed after it.
const SLIP_AT_START: f64 = 0.03;
const SLIP_AT_START_UNTOLD: f64 = 0.3;
const DRIFT_AT_START: f64 = 0.05;

/// Keeps the variance of a gain that slip leaves alone above zero.
const LEAST_VARIANCE: f64 = 1e-4;

/// Handling of the gains after the calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Following {
    /// Taxels are left as they are: nothing is taken out of them.
    Off,
    /// The gains of the calibration are kept.
    Frozen,
    /// Gains are followed.
    #[default]
    On,
}

/// State of a filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Adaptation {
    /// There is no artifact model, or nothing is taken out.
    #[default]
    Off,
    /// The gains of the calibration, or of the training donnings where there is none, are used and not followed.
    Frozen,
    /// Gains are followed.
    Learning,
    /// Gains are followed, and this frame can't teach them: joint angles are missing, taxels are at fault, or a touch hides
    /// the artifact.
    Waiting,
    /// A gain is as far from the calibration as it may go.
    Capped,
    /// Gains are followed, slowly: joint angles are so noisy that they tell the artifact badly. A touch must be clearer.
    Noisy,
}

/// Takes the artifact out of the taxels of a region, frame by frame.
#[derive(Debug, Clone)]
pub struct ArtifactFilter {
    model: Arc<ArtifactModel>,
    following: Following,
    fit: Option<ArtifactFit>,
    history: JointHistory,
    /// Slow states of a taxel: its gains, and its offset if offsets are followed.
    width: usize,
    /// `[taxels, width]` of the last frame with angles; what the offset is multiplied with is 1.
    shapes: Vec<f64>,
    /// `[taxels * width, taxels, joints]`: change of each gain and offset since the calibration, what each taxel reads of a touch, and
    /// the error of each angle, rad.
    state: DVector<f64>,
    covariance: DMatrix<f64>,
    /// Covariance of the changes of gains and offsets after long, and the share of each that is left after a step.
    slip: DMatrix<f64>,
    keep: Vec<f64>,
    /// How far each gain and each offset may go from the calibration.
    limits: Vec<f64>,
    /// Time for which a touch has hidden how offsets drift, s.
    hidden_s: f64,
    falls: Falls,
    /// Frames of a block, and the frames and sums of the one that is being collected.
    block_frames: usize,
    n_block: usize,
    block_tactile: Vec<f64>,
    block_shapes: Vec<f64>,
    frame_s: f64,
    /// Frames since the last measurement, and since the last angles.
    n_since: i32,
    n_without_pose: i32,
    is_capped: bool,
    /// True if a touch was larger than its uncertainty at the last measurement.
    sees_touch: bool,
    /// True if it was larger by far, and has been well above it since then.
    sees_held: bool,
    /// That uncertainty at the last measurement, gF; of a touch that is seen, at most what it was when it was seen first.
    seen_deviation: f64,
    /// Standard deviation of what gains and offsets that are not known better leave of the artifact, as a touch, gF: at the last
    /// measurement, or the least one since a touch that is seen.
    left_deviation: f64,
    /// What the taxels read of a touch, gF: now, and the most of late.
    reading: f64,
    recent_reading: f64,
    innovation: Vec<f64>,
    noise: Vec<f64>,
    /// `[taxels, joints]`: what an error of each angle puts into each taxel at this pose, for each rad.
    slopes: Vec<f64>,
    /// By how much that noise raises the variance along the pattern of touch: 0 for none, 1 for twice as much.
    doubt: f64,
    scratch: DVector<f64>,
    scaled: Vec<f64>,
}

impl ArtifactFilter {
    /// A filter without a calibration: it uses the mean gains of the training donnings.
    pub fn new(model: Arc<ArtifactModel>, rate_hz: f64, following: Following) -> Self {
        let width = model.n_joints + usize::from(!model.drift.is_empty());
        let (n, n_slow) = (model.n_taxels, model.n_taxels * width);
        let n_state = n_slow + n + model.n_joints;
        let is_offset = |slow: usize| slow % width == model.n_joints;
        ArtifactFilter {
            history: JointHistory::new(model.n_joints, rate_hz),
            width,
            shapes: (0..n_slow).map(|slow| f64::from(u8::from(is_offset(slow)))).collect(),
            state: DVector::zeros(n_state),
            covariance: DMatrix::zeros(n_state, n_state),
            slip: DMatrix::zeros(n_slow, n_slow),
            keep: vec![0.0; n_slow],
            limits: vec![0.0; n_slow],
            hidden_s: 0.0,
            falls: Falls::default(),
            block_frames: block_frames(rate_hz),
            n_block: 0,
            block_tactile: vec![0.0; n],
            block_shapes: vec![0.0; n_slow],
            frame_s: 1.0 / rate_hz,
            n_since: 0,
            n_without_pose: 0,
            is_capped: false,
            sees_touch: false,
            sees_held: false,
            seen_deviation: UNKNOWN_VARIANCE.sqrt(),
            left_deviation: UNKNOWN_VARIANCE.sqrt(),
            reading: 0.0,
            recent_reading: 0.0,
            innovation: vec![0.0; n],
            noise: vec![0.0; n],
            slopes: vec![0.0; n * model.n_joints],
            doubt: 0.0,
            scratch: DVector::zeros(n_state),
            scaled: vec![0.0; n_state],
            fit: None,
            following,
            model,
        }
    }

    /// Forgets the calibration: frames before it had another zero.
    pub fn clear(&mut self) {
        self.fit = None;
        self.state.fill(0.0);
        self.is_capped = false;
        self.restart();
    }

    /// Starts from the calibration of a donning.
    ///
    /// # Errors
    /// [`ArtifactError`] when it belongs to another model; nothing has changed then.
    pub fn handle_fit(&mut self, fit: ArtifactFit) -> Result<(), ArtifactError> {
        fit.check(&self.model)?;
        self.clear();
        self.begin(&fit);
        self.fit = Some(fit);
        Ok(())
    }

    /// The state at the end of a calibration.
    fn begin(&mut self, fit: &ArtifactFit) {
        self.state.fill(0.0);
        let (n, joints, width) = (self.model.n_taxels, self.model.n_joints, self.width);
        let slip = self.model.slip.powi(2);
        for (first, other, joint) in
            (0..n).flat_map(|first| (0..n).flat_map(move |other| (0..joints).map(move |joint| (first, other, joint))))
        {
            let share = if first == other { 1.0 } else { self.model.slip_common };
            let (row, column) = (first * width + joint, other * width + joint);
            let gain = |taxel: usize| fit.gains[taxel * joints + joint];
            self.slip[(row, column)] = slip * share * (gain(first) * gain(other));
        }
        for (taxel, drift) in self.model.drift.iter().enumerate() {
            let offset = taxel * width + joints;
            self.slip[(offset, offset)] = drift * drift;
        }
        (0..n * width).for_each(|slow| self.slip[(slow, slow)] += LEAST_VARIANCE);
        self.covariance.fill(0.0);
        self.covariance.view_mut((0, 0), (n * width, n * width)).copy_from(&self.slip);
        self.covariance *= self.slip_at_start();
        for offset in self.offsets() {
            self.covariance[(offset, offset)] = DRIFT_AT_START * self.slip[(offset, offset)];
        }
        for (idx, value) in fit.covariance.iter().enumerate() {
            let (taxel, column, row) = (idx / (joints * joints), idx / joints % joints, idx % joints);
            // Half of it on each side of the diagonal, because that of a file may differ there in its last bit.
            self.covariance[(taxel * width + row, taxel * width + column)] += 0.5 * value;
            self.covariance[(taxel * width + column, taxel * width + row)] += 0.5 * value;
        }
        if self.model.uncertain_offsets {
            // An offset that was found with a gain that is off is off by what that gain had wrong at the poses of the calibration.
            for (idx, value) in fit.offset_covariance.iter().enumerate() {
                let (row, offset) = (idx, idx / width * width + joints);
                self.covariance[(row, offset)] += value;
                if row != offset {
                    self.covariance[(offset, row)] += value;
                }
            }
        }
        for (slow, limit) in self.limits.iter_mut().enumerate() {
            let own = self.slip[(slow, slow)];
            let unknown = if self.model.uncertain_offsets { self.covariance[(slow, slow)] } else { 0.0 };
            *limit = MAX_DEVIATIONS * (own + unknown).sqrt();
        }
        self.forget_angle_errors();
        self.widen_touch(CALIBRATED_VARIANCE);
        (self.sees_touch, self.sees_held, self.left_deviation) = (false, false, UNKNOWN_VARIANCE.sqrt());
        self.hidden_s = 0.0;
        self.falls = Falls::default();
    }

    /// Share of the slip that may have come since the calibration, at its end.
    fn slip_at_start(&self) -> f64 {
        if self.model.uncertain_offsets { SLIP_AT_START } else { SLIP_AT_START_UNTOLD }
    }

    /// The calibration with the gains as they are now, to be taken up again in the same donning.
    pub fn fit(&self) -> Option<ArtifactFit> {
        let mut fit = self.fit.clone()?;
        let (joints, width) = (self.model.n_joints, self.width);
        for (gain, value) in fit.gains.iter_mut().enumerate() {
            *value += self.state[gain / joints * width + gain % joints];
        }
        if width > joints {
            fit.offset.iter_mut().enumerate().for_each(|(taxel, value)| *value += self.state[taxel * width + joints]);
        }
        for (idx, value) in fit.covariance.iter_mut().enumerate() {
            let (taxel, column, row) = (idx / (joints * joints), idx / joints % joints, idx % joints);
            *value = self.covariance[(taxel * width + row, taxel * width + column)];
        }
        if self.model.uncertain_offsets {
            let of_offset = |idx: usize| self.covariance[(idx, idx / width * width + joints)];
            fit.offset_covariance = (0..self.n_slow()).map(of_offset).collect();
        }
        Some(fit)
    }

    /// State while there are no frames to correct.
    pub fn idle(&self) -> Adaptation {
        match (self.following, &self.fit) {
            (Following::Off, _) => Adaptation::Off,
            (Following::On, Some(_)) => Adaptation::Waiting,
            (Following::On, None) | (Following::Frozen, _) => Adaptation::Frozen,
        }
    }

    /// Says that frames were lost: nobody knows how long joints were where they are now, nor what is touched.
    pub fn restart(&mut self) {
        self.history.clear();
        self.drop_block();
        (self.n_since, self.n_without_pose) = (0, 0);
        (self.reading, self.recent_reading) = (0.0, 0.0);
        self.forget_angle_errors();
        self.forget_touch();
    }

    /// Whatever touched, nobody knows what touches now.
    fn forget_touch(&mut self) {
        self.touches().for_each(|touch| self.forget_part(touch));
        self.widen_touch(UNKNOWN_VARIANCE);
        self.falls.restart();
        (self.sees_touch, self.sees_held) = (false, false);
    }

    fn forget_angle_errors(&mut self) {
        for joint in 0..self.model.n_joints {
            let error = self.touches().end + joint;
            self.forget_part(error);
            self.covariance[(error, error)] = self.angle_variance(joint);
        }
    }

    /// Nothing is known of a state, not even together with the others.
    fn forget_part(&mut self, idx: usize) {
        self.state[idx] = 0.0;
        self.covariance.row_mut(idx).fill(0.0);
        self.covariance.column_mut(idx).fill(0.0);
    }

    /// Keeps such a share of a state, and of what is known of it together with the others.
    fn keep_part(&mut self, idx: usize, share: f64) {
        self.state[idx] *= share;
        self.covariance.row_mut(idx).iter_mut().for_each(|value| *value *= share);
        self.covariance.column_mut(idx).iter_mut().for_each(|value| *value *= share);
    }

    /// Variance of the error of a joint's angle, rad^2.
    fn angle_variance(&self, joint: usize) -> f64 {
        (ANGLE_DEVIATIONS * self.history.noise(joint)).powi(2)
    }

    /// Takes the artifact out of a frame, `n_frames` after the last one, and learns from it.
    ///
    /// Without trusted angles the artifact of the last ones is taken out, and nothing is learned; nor is it where
    /// `may_learn` is false. What is taken out rests on frames before this one.
    ///
    /// # Shapes
    /// `tactile`: `[taxels]`, above the baseline, finite; `pose`: `[joints]`, rad, of this frame where it is known.
    pub fn correct(&mut self, tactile: &mut [f32], pose: Option<&[f32]>, n_frames: i32, may_learn: bool) -> Adaptation {
        if self.following == Following::Off {
            return Adaptation::Off;
        }
        let pose = pose.filter(|pose| JointHistory::takes(pose));
        self.n_without_pose = self.n_without_pose.saturating_add(n_frames);
        if let Some(pose) = pose {
            self.history.advance(pose, std::mem::take(&mut self.n_without_pose));
            self.model.write_shapes(self.history.basis(), self.width, &mut self.shapes);
            self.measure_pose_noise();
        }
        self.n_since = self.n_since.saturating_add(n_frames);
        if !self.history.has_begun() {
            return self.idle();
        }
        let is_measured = may_learn && pose.is_some() && self.fit.is_some();
        let learns = is_measured && self.following == Following::On;
        if is_measured {
            self.block_tactile.iter_mut().zip(&*tactile).for_each(|(sum, value)| *sum += f64::from(*value));
            self.block_shapes.iter_mut().zip(&self.shapes).for_each(|(sum, shape)| *sum += shape);
            self.n_block += 1;
        } else {
            self.drop_block();
        }
        for (taxel, value) in tactile.iter_mut().enumerate() {
            *value = (f64::from(*value) - self.artifact(taxel, &self.shapes[taxel * self.width..])) as f32;
        }
        if self.model.trust_inputs {
            self.reading = self.along_pattern(tactile.iter().map(|value| f64::from(*value)));
            let kept = (-f64::from(n_frames) * self.frame_s / RELAXING_S).exp();
            self.recent_reading = (self.recent_reading * kept).max(self.reading.min(LARGEST_TOUCH));
        }
        if self.n_block == self.block_frames {
            self.end_block(learns);
        }
        match learns && !self.sees_touch {
            false => self.idle(),
            true if self.is_capped => Adaptation::Capped,
            true if self.margin_of_noise() > 0.0 => Adaptation::Noisy,
            true => Adaptation::Learning,
        }
    }

    /// The touch that the filter sees, gF: what taxels read of it, along the pattern of touches.
    pub fn touch_gf(&self) -> f64 {
        self.along_pattern(self.state.iter().skip(self.n_slow()).copied())
    }

    /// The touch, gF, that these taxels read along the pattern of touches.
    fn along_pattern(&self, taxels: impl Iterator<Item = f64>) -> f64 {
        let along: f64 = self.model.touch.iter().zip(taxels).map(|(pattern, value)| pattern * value).sum();
        along / self.pattern_square()
    }

    /// Writes how far taxels that it corrected can be trusted, for a network that gets this: how much noise of the joint angles
    /// adds to them, and the standard deviation of what gains that are not known better leave of the artifact at this pose, and of what taxels
    /// still read of a large touch that was let go a moment ago.
    /// Where gains are kept, it counts what may have slipped since the calibration. Without a calibration, without trusted angles
    /// for a moment, and at most, it is 10 gF.
    ///
    /// The touch that it sees is not among it, on purpose: where it took a touch for artifact, a network that got it would go on
    /// reporting a touch that is over (`docs/validation/2026-11-25-told-of-touch.md`).
    ///
    /// # Shapes
    /// `out`: `[TRUST_INPUTS]`, taxel units: what a taxel reads on average of a touch that is so large.
    pub fn write_trust(&self, out: &mut [f32]) {
        let is_known = self.fit.is_some() && self.is_recent();
        let unknown = UNKNOWN_VARIANCE.sqrt();
        let relaxing = RELAXING_SHARE * (self.recent_reading - self.reading.max(0.0)).max(0.0);
        let left = if is_known { self.left_deviation.hypot(relaxing).min(unknown) } else { unknown };
        let noise = unknown * self.doubt.ln_1p();
        let reading = self.model.touch.iter().map(|touch| touch.abs()).sum::<f64>() / self.model.n_taxels as f64;
        for (out, deviation) in out.iter_mut().zip([noise, left]) {
            *out = (reading * deviation) as f32;
        }
    }

    fn is_recent(&self) -> bool {
        f64::from(self.n_since) * self.frame_s <= HELD_FOR_S
    }

    /// A touch that is beyond doubt for the filter, gF, which remembers for how long it has lasted.
    pub fn held_touch_gf(&self) -> Option<f64> {
        (self.sees_held && self.is_recent() && self.following == Following::On).then(|| self.touch_gf())
    }

    /// Log odds by which a touch must be clearer than the network says, because joint angles are noisier than those that it was
    /// trained with: what they leave of the artifact looks like light touches. Zero with a good tracker, and for a network that
    /// gets the noise itself.
    pub fn touch_margin(&self) -> f64 {
        if self.model.trust_inputs { 0.0 } else { self.margin_of_noise() }
    }

    /// Log odds by which each frame is less evidence of a contact, for a network that gets the noise itself: errors of a camera stay
    /// for several frames, so that many frames of a doubtful touch must not add up to a sure one. Zero with a good tracker, and
    /// for any other network, whose log odds [`ArtifactFilter::touch_margin`] has lowered already.
    pub fn evidence_margin(&self) -> f64 {
        if self.model.trust_inputs { self.margin_of_noise().min(MOST_EVIDENCE_LOST) } else { 0.0 }
    }

    fn margin_of_noise(&self) -> f64 {
        (DOUBT_ODDS * self.doubt.ln_1p() - TOLERATED_ODDS).max(0.0)
    }

    /// How far the gains are from the calibration: root mean square of their changes, as a share of that of the gains.
    pub fn change(&self) -> f64 {
        let Some(fit) = &self.fit else { return 0.0 };
        let squares = |values: &mut dyn Iterator<Item = f64>| values.map(|value| value * value).sum::<f64>();
        let is_gain = |slow: &usize| slow % self.width < self.model.n_joints;
        let changes = squares(&mut (0..self.n_slow()).filter(is_gain).map(|gain| self.state[gain]));
        let gains = squares(&mut fit.gains.iter().copied());
        if gains > 0.0 { (changes / gains).sqrt() } else { 0.0 }
    }

    /// Artifact of a taxel for its shapes, the first ones of `shapes`.
    fn artifact(&self, taxel: usize, shapes: &[f64]) -> f64 {
        let joints = self.model.n_joints;
        let Some(fit) = &self.fit else { return shapes[..joints].iter().sum() };
        let first = taxel * self.width;
        let gain = |joint: usize| fit.gains[taxel * joints + joint] + self.state[first + joint];
        let drifted = if self.width > joints { self.state[first + joints] } else { 0.0 };
        fit.offset[taxel]
            + drifted
            + shapes[..joints].iter().enumerate().map(|(joint, shape)| gain(joint) * shape).sum::<f64>()
    }

    /// What errors of joint angles put into the taxels at this pose, and how far noise of the angles looks like a touch.
    fn measure_pose_noise(&mut self) {
        let (n, joints) = (self.model.n_taxels, self.model.n_joints);
        let mut along = 0.0;
        for joint in 0..joints {
            let mut of_joint = 0.0;
            for taxel in 0..n {
                let gain = taxel * joints + joint;
                let slope = self.model.slope(taxel, joint, self.history.slopes());
                let change = self.state[taxel * self.width + joint];
                let size = self.fit.as_ref().map_or(1.0, |fit| fit.gains[gain] + change);
                self.slopes[gain] = size * slope;
                of_joint += self.model.touch[taxel] * self.slopes[gain];
            }
            along += (of_joint * self.history.noise(joint)).powi(2);
        }
        let residual: f64 = self.model.touch.iter().zip(&self.model.residual).map(|(k, left)| k * k * left).sum();
        self.doubt += (1.0 - (-self.frame_s / DOUBT_S).exp()) * (along / residual - self.doubt);
    }

    /// What errors of the angles, the last of `states`, put into a taxel.
    fn of_angles(&self, taxel: usize, states: &[f64]) -> f64 {
        let joints = self.model.n_joints;
        dot(&self.slopes[taxel * joints..(taxel + 1) * joints], &states[self.touches().end..])
    }

    /// Variance of what noise of the joint angles puts into a taxel.
    fn pose_variance(&self, taxel: usize) -> f64 {
        let joints = self.model.n_joints;
        let slopes = self.slopes[taxel * joints..(taxel + 1) * joints].iter().enumerate();
        slopes.map(|(joint, slope)| (slope * self.history.noise(joint)).powi(2)).sum()
    }

    fn drop_block(&mut self) {
        self.n_block = 0;
        self.block_tactile.fill(0.0);
        self.block_shapes.fill(0.0);
    }

    /// Gains and offsets that are followed.
    fn n_slow(&self) -> usize {
        self.model.n_taxels * self.width
    }

    /// The offsets among them.
    fn offsets(&self) -> impl Iterator<Item = usize> + use<> {
        let n_offsets = if self.width > self.model.n_joints { self.model.n_taxels } else { 0 };
        (self.model.n_joints..).step_by(self.width).take(n_offsets)
    }

    /// What each taxel reads of a touch, behind them in the state.
    fn touches(&self) -> Range<usize> {
        let first = self.n_slow();
        first..first + self.model.n_taxels
    }

    fn pattern_square(&self) -> f64 {
        self.model.touch.iter().map(|pattern| pattern * pattern).sum()
    }

    /// Adds to the variance of touch: so much, gF^2, along the pattern, and a share of it on each taxel by itself.
    fn widen_touch(&mut self, variance: f64) {
        let first = self.n_slow();
        for (column, of_column) in self.model.touch.iter().enumerate() {
            for (row, of_row) in self.model.touch.iter().enumerate() {
                let own = if row == column { 1.0 + PATTERN_DEVIATION * PATTERN_DEVIATION } else { 1.0 };
                self.covariance[(first + row, first + column)] += variance * own * (of_row * of_column);
            }
        }
    }

    /// Takes the mean of a block: to learn from it, or only to know how uncertain the artifact is at its pose.
    fn end_block(&mut self, learns: bool) {
        let n_block = self.n_block as f64;
        self.block_shapes.iter_mut().for_each(|sum| *sum /= n_block);
        if learns {
            self.predict(f64::from(self.n_since) * self.frame_s);
            self.measure();
        } else if self.model.trust_inputs {
            self.look_along_touch();
            let of_offset = |offset: usize| self.scratch[offset].powi(2) * self.slip[(offset, offset)];
            let drift: f64 = self.offsets().map(of_offset).sum();
            let slow = 0..self.n_slow();
            let slip = self.along_scratch(&self.slip, slow.clone()) - drift;
            let since = (1.0 - self.slip_at_start()) * slip + (1.0 - DRIFT_AT_START) * drift;
            self.tell_left(self.along_scratch(&self.covariance, slow) + since);
        }
        self.n_since = 0;
        self.drop_block();
    }

    /// One step of the filter, by the mean of a block.
    fn measure(&mut self) {
        let (width, first) = (self.width, self.n_slow());
        let n_block = self.n_block as f64;
        for taxel in 0..self.model.n_taxels {
            let expected = self.artifact(taxel, &self.block_shapes[taxel * width..]);
            let touch = self.state[first + taxel];
            let of_angles = self.of_angles(taxel, self.state.as_slice());
            self.innovation[taxel] = self.block_tactile[taxel] / n_block - expected - touch - of_angles;
            let of_pose = ALIKE_BLOCKS * self.model.n_taxels as f64 * self.pose_variance(taxel);
            self.noise[taxel] = self.model.unexplained(taxel, self.n_block) + of_pose + (PATTERN_NOISE * touch).powi(2);
        }
        self.open_for_touch();
        for taxel in 0..self.model.n_taxels {
            self.take(taxel);
        }
        self.doubt_faint_touch();
        self.cap();
        self.begin_again_if_broken();
    }

    /// Readings beyond what numbers can hold leave no state to go on from: it begins again at the calibration.
    fn begin_again_if_broken(&mut self) {
        let variances = (0..self.state.len()).map(|idx| self.covariance[(idx, idx)]);
        let is_sound =
            variances.zip(&self.state).all(|(variance, value)| variance >= 0.0 && (value + variance).is_finite());
        if !is_sound && let Some(fit) = self.fit.take() {
            self.begin(&fit);
            self.fit = Some(fit);
        }
    }

    /// Lets time pass: gains and offsets lean back to the calibration and may have slipped and drifted, touch may have changed.
    fn predict(&mut self, elapsed_s: f64) {
        let first = self.n_slow();
        // While something touches, nothing tells drift from touch: were its uncertainty to grow, the touch would become doubtful.
        self.hidden_s += elapsed_s;
        let drift_s = if self.sees_touch { 0.0 } else { std::mem::take(&mut self.hidden_s) };
        let [of_gain, of_offset] =
            [elapsed_s / self.model.slip_time_s, drift_s / DRIFT_TIME_S].map(|time| (-time).exp());
        for of_taxel in self.keep.chunks_exact_mut(self.width) {
            let (gains, offset) = of_taxel.split_at_mut(self.model.n_joints);
            gains.fill(of_gain);
            offset.fill(of_offset);
        }
        let n = self.state.len();
        let mut slip = self.slip.as_slice().chunks_exact(first).zip(&self.keep);
        for column in self.covariance.as_mut_slice().chunks_exact_mut(n) {
            let (of_slow, of_touches) = column.split_at_mut(first);
            match slip.next() {
                Some((slip, of_column)) => {
                    for (value, (slip, keep)) in of_slow.iter_mut().zip(slip.iter().zip(&self.keep)) {
                        let kept = of_column * keep;
                        *value = *value * kept + slip * (1.0 - kept);
                    }
                    of_touches.iter_mut().for_each(|value| *value *= of_column);
                }
                None => of_slow.iter_mut().zip(&self.keep).for_each(|(value, keep)| *value *= keep),
            }
        }
        self.state.as_mut_slice()[..first].iter_mut().zip(&self.keep).for_each(|(slow, keep)| *slow *= keep);
        let kept = (-elapsed_s / ANGLE_ERROR_S).exp();
        for joint in 0..self.model.n_joints {
            let error = self.touches().end + joint;
            self.keep_part(error, kept);
            self.covariance[(error, error)] += self.angle_variance(joint) * (1.0 - kept * kept);
        }
        let above = if self.sees_touch { (self.touch_gf() - LARGE_TOUCH).max(0.0) } else { 0.0 };
        self.widen_touch((TOUCH_WALK + (LARGE_TOUCH_WALK * above).powi(2)) * elapsed_s);
    }

    /// Widens touch where the taxels together say that one began or ended.
    fn open_for_touch(&mut self) {
        let square = self.pattern_square();
        let change = self.along_pattern(self.innovation.iter().copied());
        // The variance of that: of the state, seen along the pattern, and of the measurement.
        self.look_along_touch();
        if self.model.trust_inputs {
            self.tell_left(self.along_scratch(&self.covariance, 0..self.n_slow()));
        }
        let noise = self.model.touch.iter().zip(&self.noise).map(|(k, noise)| k * k * noise).sum::<f64>();
        let deviation = (self.along_scratch(&self.covariance, 0..self.state.len()) + noise).max(0.0).sqrt() / square;
        let touch = self.touch_gf();
        let is_sudden = change.abs() > ONSET_DEVIATIONS * deviation;
        let reading = touch + change;
        if self.falls.handle_reading(reading, self.sees_touch) || is_sudden && change < -ENDING_SHARE * touch {
            self.end_touch(reading);
        } else if is_sudden {
            self.widen_touch(4.0 * change * change);
        }
    }

    /// What is left of a touch that ends is unknown, and so is what it hid: offsets have drifted meanwhile.
    fn end_touch(&mut self, left_gf: f64) {
        let touches = self.state.iter().skip(self.n_slow());
        self.innovation.iter_mut().zip(touches).for_each(|(value, touch)| *value += touch);
        self.forget_touch();
        self.widen_touch((LEFT_SHARE * left_gf).powi(2));
        let grown = 1.0 - (-2.0 * std::mem::take(&mut self.hidden_s) / DRIFT_TIME_S).exp();
        for offset in self.offsets() {
            self.covariance[(offset, offset)] += grown * self.slip[(offset, offset)];
        }
        if self.model.trust_inputs {
            self.tell_left(self.along_scratch(&self.covariance, 0..self.n_slow()));
        }
    }

    /// Points `scratch` along the pattern of touch at the pose of the block.
    fn look_along_touch(&mut self) {
        let (width, first) = (self.width, self.n_slow());
        for (taxel, pattern) in self.model.touch.iter().enumerate() {
            for slow in taxel * width..(taxel + 1) * width {
                self.scratch[slow] = pattern * self.block_shapes[slow];
            }
            self.scratch[first + taxel] = *pattern;
        }
        for joint in 0..self.model.n_joints {
            let slopes = self.slopes.iter().skip(joint).step_by(self.model.n_joints);
            let along = self.model.touch.iter().zip(slopes).map(|(pattern, slope)| pattern * slope).sum();
            self.scratch[first + self.model.n_taxels + joint] = along;
        }
    }

    /// A touch that is seen does not become more doubtful, however long it hides the artifact: the taxels tell it from what came before.
    /// Told is the least deviation since it began.
    fn tell_left(&mut self, variance: f64) {
        let deviation = variance.max(0.0).sqrt() / self.pattern_square();
        self.left_deviation = if self.sees_touch { deviation.min(self.left_deviation) } else { deviation };
    }

    /// Variance of a part of the state with this covariance, along `scratch`.
    fn along_scratch(&self, covariance: &DMatrix<f64>, part: Range<usize>) -> f64 {
        let along = self.scratch.as_slice();
        let columns = covariance.as_slice().chunks_exact(covariance.nrows()).zip(along);
        let of_part = columns.take(part.end).skip(part.start);
        of_part.map(|(rows, right)| right * dot(&rows[part.clone()], &along[part.clone()])).sum()
    }

    /// Updates the state by the measurement of one taxel. Noise of taxels is independent, so one after the other is the same
    /// as all at once.
    fn take(&mut self, taxel: usize) {
        let (width, first) = (self.width, self.n_slow());
        let gains = taxel * width..(taxel + 1) * width;
        let n = self.state.len();
        let column = |idx: usize| idx * n..(idx + 1) * n;
        let covariance = self.covariance.as_slice();
        let seen = self.scratch.as_mut_slice();
        seen.fill(0.0);
        for gain in gains.clone() {
            let shape = self.block_shapes[gain];
            seen.iter_mut().zip(&covariance[column(gain)]).for_each(|(sum, value)| *sum += value * shape);
        }
        seen.iter_mut().zip(&covariance[column(first + taxel)]).for_each(|(sum, value)| *sum += value);
        let joints = self.model.n_joints;
        for (joint, slope) in self.slopes[taxel * joints..(taxel + 1) * joints].iter().enumerate() {
            let of_angle = &covariance[column(first + self.model.n_taxels + joint)];
            seen.iter_mut().zip(of_angle).for_each(|(sum, value)| *sum += value * slope);
        }
        let seen = gains.map(|gain| self.block_shapes[gain] * self.scratch[gain]).sum::<f64>();
        let of_angles = self.of_angles(taxel, self.scratch.as_slice());
        let variance = seen + self.scratch[first + taxel] + of_angles + self.noise[taxel];
        if variance.is_nan() || variance < self.noise[taxel] {
            return; // rounding, of readings beyond all reason
        }
        let innovation = self.innovation[taxel];
        self.update(innovation, variance);
        // What the next taxels did not expect is less by what was learned here.
        let step = innovation / variance;
        for other in taxel + 1..self.model.n_taxels {
            let gains = other * width..(other + 1) * width;
            let learned: f64 = gains.map(|gain| self.block_shapes[gain] * self.scratch[gain]).sum();
            let of_angles = self.of_angles(other, self.scratch.as_slice());
            self.innovation[other] -= step * (learned + self.scratch[first + other] + of_angles);
        }
    }

    /// A touch that is no larger than its uncertainty most likely is none, to either side alike: were it only below, what the
    /// noise adds would stay and what it takes would not.
    fn doubt_faint_touch(&mut self) {
        let first = self.n_slow();
        for (taxel, pattern) in self.model.touch.iter().enumerate() {
            self.scratch[first + taxel] = *pattern;
        }
        let deviation = self.along_scratch(&self.covariance, self.touches()).max(0.0).sqrt() / self.pattern_square();
        let touch = self.touch_gf();
        // Gains and offsets become less certain while a touch hides them. The touch itself is as sure as when it was seen first.
        let follows_drift = !self.model.drift.is_empty();
        let doubt = if follows_drift && self.sees_touch { deviation.min(self.seen_deviation) } else { deviation };
        self.sees_touch = touch >= FAINT_TOUCH.max(FAINT_DEVIATIONS * doubt);
        self.seen_deviation = doubt;
        let limit = if self.sees_held { STILL_HELD_DEVIATIONS } else { HELD_DEVIATIONS };
        self.sees_held = touch >= LEAST_HELD.max(limit * deviation);
        if self.sees_touch {
            return;
        }
        for taxel in 0..self.model.n_taxels {
            let touch = first + taxel;
            self.scratch.copy_from(&self.covariance.column(touch));
            let noise = FAINT_VARIANCE * self.model.n_taxels as f64 * self.model.touch[taxel].powi(2);
            self.update(-self.state[touch], self.covariance[(touch, touch)] + noise);
        }
    }

    /// The update by one number: `scratch` is its covariance with the state, `variance` that of the innovation.
    fn update(&mut self, innovation: f64, variance: f64) {
        self.state.axpy(innovation / variance, &self.scratch, 1.0);
        let scale = variance.sqrt().recip();
        self.scaled.iter_mut().zip(&self.scratch).for_each(|(scaled, value)| *scaled = value * scale);
        // Slices, because the compiler makes vectors of them: this is where the filter spends its time. What is taken is the product of the
        // same two numbers above and below the diagonal, so the covariance stays symmetric to the last bit.
        for (column, right) in self.covariance.as_mut_slice().chunks_exact_mut(self.scaled.len()).zip(&self.scaled) {
            column.iter_mut().zip(&self.scaled).for_each(|(value, left)| *value -= left * right);
        }
    }

    fn cap(&mut self) {
        self.is_capped = false;
        for gain in 0..self.n_slow() {
            let limit = self.limits[gain];
            self.is_capped |= self.state[gain].abs() > limit;
            self.state[gain] = self.state[gain].clamp(-limit, limit);
        }
    }
}

/// Sum of the products of two vectors of the same length, in four sums side by side.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a, a_rest) = a.as_chunks::<4>();
    let (b, b_rest) = b.as_chunks::<4>();
    let mut sums = [0.0; 4];
    for (a, b) in a.iter().zip(b) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum += a * b;
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums[0] + sums[1] + (sums[2] + sums[3]) + rest
}
