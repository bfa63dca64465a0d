//! Sessions for a network that gets the touch of the artifact filter: copies in whose air light touches are held.
//!
//! The paper's protocol has no light touch that is held while the hand moves, so a network could not learn how the filter
//! follows one. Touches are laid on the taxels before the filter takes the artifact out. How they spread over the taxels is
//! that of firm touches of the same session. Some copies have what else the network must cope with: a worse hand tracker, and
//! a filter that does not follow.

use std::f32::consts::TAU;
use std::ops::Range;
use std::sync::Arc;

use super::dataset::{Session, SessionFrames};
use super::error::TrainError;
use super::random::{Random, Stream};
use crate::eval::Part;
use crate::fusion::{ArtifactFilter, ArtifactFit, ArtifactFitter, ArtifactModel, Following};

/// Force of a firm touch, gF: how it spreads is known.
const FIRM_GF: f32 = 40.0;

/// Forces of the held touches, gF.
const FORCES_GF: (f32, f32) = (2.5, 40.0);

/// How long they last, and the air between them, s.
const HELD_S: (f32, f32) = (0.5, 40.0);
const BETWEEN_S: (f32, f32) = (0.5, 80.0);

/// How long they take to begin and to end, s: the filter takes slow ones for slip, and the network must know what is left then.
const RAMP_S: (f32, f32) = (0.03, 30.0);

/// How far the force wanders, as a share of it, how slowly, s, and the least that is left of it.
const WANDER: f32 = 0.2;
const WANDER_S: f32 = 1.0;
const LEAST_SHARE: f32 = 0.2;

/// How long it takes until the touch is spread as another one, and again as before, s.
const SPREAD_S: (f32, f32) = (2.0, 20.0);

/// How often frames are lost for the filter, a minute.
const RESTARTS_PER_MIN: f32 = 1.0;

/// A worse tracker: the largest noise and bias of its angles as standard deviations, rad, its delay, s, and its rate, 1/s, in
/// most copies; how often it is blind, 1/s, and for how long, s; its last angles count as held for so long, s.
const NOISE_RAD: f32 = 0.087;
const BIAS_RAD: f32 = 0.175;
const DELAY_S: f32 = 0.06;
const SLOW_HZ: f64 = 30.0;
const SLOW_SHARE: f32 = 0.7;
const BLIND_PER_S: f32 = 0.1;
const BLIND_S: (f32, f32) = (0.1, 2.0);
const HELD_POSE_S: f64 = 0.1;

/// Time in the air that a calibration takes, s.
const CALIBRATION_S: f64 = 10.0;

/// What is special about a copy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Condition {
    /// Nothing but its touches.
    Plain,
    /// The hand tracker is worse.
    BadlyTracked,
    /// Gains are those of the calibration.
    Frozen,
}

/// The copies of all sessions in turn. A network that sees more of frozen filters is worse where filters follow (docs/validation).
const COPIES: [Condition; 12] = {
    use Condition::{BadlyTracked, Frozen, Plain};
    [Plain, BadlyTracked, Plain, Plain, BadlyTracked, Plain, Plain, BadlyTracked, Frozen, Plain, BadlyTracked, Plain]
};

/// Columns of the network's input for a session, and its labels, from which copies are made.
#[derive(Debug, Clone, Copy)]
pub struct TouchedSession<'a> {
    /// Taxels with their artifact, and joint angles.
    pub raw: &'a Session,
    /// The artifact model of its region.
    pub artifact: &'a Arc<ArtifactModel>,
    /// The artifact of its donning, by its calibration.
    pub fit: &'a ArtifactFit,
    /// Model frames a second.
    pub rate_hz: f64,
}

impl TouchedSession<'_> {
    /// Copies of the session with held touches in its air, without its test part. The same seed and number give the same copy. The
    /// numbers count the copies of all sessions: their conditions come in turn. Where the condition is worse than that of a
    /// recording, the validation part is left out, too. Each copy is told to `on_copy`.
    ///
    /// There are none of a session without firm touches, or without air, in its training part.
    ///
    /// # Errors
    /// [`TrainError::Artifact`] if the fit belongs to another model, and those of `on_copy`.
    pub fn copies<E: From<TrainError>>(
        &self,
        seed: u64,
        numbers: Range<usize>,
        mut on_copy: impl FnMut() -> Result<(), E>,
    ) -> Result<Vec<Session>, E> {
        let frames = self.raw.frames();
        let clean = self.columns(&frames.tactile, &Tracked::of(frames), self.fit, Following::On, None)?;
        let mut copies = Vec::new();
        for number in numbers {
            copies.extend(self.copy(&clean, seed, number)?);
            on_copy()?;
        }
        Ok(copies)
    }

    /// A copy of the session, whose columns without further touches are `clean`.
    fn copy(&self, clean: &[f32], seed: u64, number: usize) -> Result<Option<Session>, TrainError> {
        let TouchedSession { raw, artifact, rate_hz, .. } = *self;
        let frames = raw.frames();
        let mut random = Random::new(seed, Stream::HeldTouch(number as u64));
        let n_columns = artifact.n_columns();
        let is_firm = |frame: &usize| frames.part[*frame] == Part::Train && frames.truth_gf[*frame] >= FIRM_GF;
        let firm: Vec<usize> = (0..raw.n_frames()).filter(is_firm).collect();
        if firm.is_empty() {
            return Ok(None);
        }
        let spread = |random: &mut Random| -> Vec<f32> {
            let frame = firm[((random.unit() * firm.len() as f32) as usize).min(firm.len() - 1)];
            let taxels = &clean[frame * n_columns..][..artifact.n_taxels];
            taxels.iter().map(|value| value / frames.truth_gf[frame]).collect()
        };
        let mut touched = frames.clone();
        for air in runs_in_air(frames) {
            let mut begin = air.start + n_frames(&mut random, BETWEEN_S, rate_hz);
            while begin < air.end {
                let held = begin..(begin + n_frames(&mut random, HELD_S, rate_hz)).min(air.end);
                begin = held.end + n_frames(&mut random, BETWEEN_S, rate_hz);
                let ends = [spread(&mut random), spread(&mut random)];
                hold(&mut touched, held, &ends, rate_hz, &mut random);
            }
        }
        let kind = COPIES[number % COPIES.len()];
        let (mut tracked, mut fit) = (Tracked::of(frames), self.fit.clone());
        if kind == Condition::BadlyTracked {
            tracked = Tracked::badly(frames, artifact.n_joints, rate_hz, &mut random);
            fit = self.fitted(&tracked).unwrap_or(fit);
        }
        let following = if kind == Condition::Frozen { Following::Frozen } else { Following::On };
        let columns = self.columns(&touched.tactile, &tracked, &fit, following, Some(&mut random))?;
        let is_kept = |part: Part| part == Part::Train || (part == Part::Validation && kind == Condition::Plain);
        let kept = kept(&touched, &columns, n_columns, number, is_kept);
        if !kept.zero_load.contains(&true) {
            return Ok(None);
        }
        Ok(Some(Session::new(kept)?))
    }

    /// The network's input of all frames, of these taxels. With random numbers, frames are lost now and then.
    fn columns(
        &self,
        tactile: &[f32],
        tracked: &Tracked,
        fit: &ArtifactFit,
        following: Following,
        mut random: Option<&mut Random>,
    ) -> Result<Vec<f32>, TrainError> {
        let (frames, artifact) = (self.raw.frames(), self.artifact);
        let (n, n_columns) = (artifact.n_taxels, artifact.n_columns());
        let mut filter = ArtifactFilter::new(Arc::clone(artifact), self.rate_hz, following);
        filter.handle_fit(fit.clone()).map_err(|error| TrainError::Artifact { what: error.to_string() })?;
        let chance = RESTARTS_PER_MIN / 60.0 / self.rate_hz as f32;
        let mut columns = vec![0.0; frames.truth_gf.len() * n_columns];
        let rows = columns.chunks_exact_mut(n_columns).zip(tactile.chunks_exact(n));
        let poses = tracked.pose.chunks_exact(artifact.n_joints).zip(&tracked.age);
        let mut before = None;
        for ((row, taxels), ((pose, age), epoch)) in rows.zip(poses.zip(&frames.epoch)) {
            let is_gap = before.replace(*epoch).is_some_and(|before| before != *epoch);
            let is_lost = random.as_mut().is_some_and(|random| random.unit() < chance);
            if is_gap || is_lost {
                filter.restart();
            }
            let (of_taxels, of_touch) = row.split_at_mut(n);
            of_taxels.copy_from_slice(taxels);
            filter.correct(of_taxels, (*age != Age::Old).then_some(pose), 1, *age == Age::Fresh);
            filter.write_touch(of_touch);
        }
        Ok(columns)
    }

    /// The artifact of the donning by the angles of another tracker: of its first seconds in the air. `None` if they are too few.
    fn fitted(&self, tracked: &Tracked) -> Option<ArtifactFit> {
        let (frames, artifact) = (self.raw.frames(), self.artifact);
        let mut fitter = ArtifactFitter::new(Arc::clone(artifact), self.rate_hz);
        let rows = frames.tactile.chunks_exact(artifact.n_taxels).zip(tracked.pose.chunks_exact(artifact.n_joints));
        let mut left = (CALIBRATION_S * self.rate_hz) as usize;
        for (frame, (taxels, pose)) in rows.enumerate() {
            fitter.handle_frame(taxels, pose, i32::from(frame > 0), frames.zero_load[frame]);
            left = left.saturating_sub(usize::from(frames.zero_load[frame]));
            if left == 0 {
                break;
            }
        }
        fitter.finish(None).ok()
    }
}

/// Lays a touch on frames. Its spread goes from one end to the other and back.
fn hold(frames: &mut SessionFrames, held: Range<usize>, ends: &[Vec<f32>; 2], rate_hz: f64, random: &mut Random) {
    let level = log_uniform(random, FORCES_GF);
    let [rise, fall] = [(); 2].map(|()| n_frames(random, RAMP_S, rate_hz).max(1) as f32);
    let turn = n_frames(random, SPREAD_S, rate_hz).max(1) as f32;
    let keep = (-1.0 / (WANDER_S * rate_hz as f32)).exp();
    let step = WANDER * (3.0 * (1.0 - keep * keep)).sqrt(); // a uniform number up to 1 has a variance of 1/3
    let mut wander = 0.0;
    let n = frames.n_taxels;
    for frame in held.clone() {
        wander = keep * wander + random.symmetric(step);
        let (since, left) = ((frame - held.start + 1) as f32, (held.end - frame) as f32);
        let force = level * (since / rise).min(left / fall).min(1.0) * (1.0 + wander).max(LEAST_SHARE);
        let share = 0.5 - 0.5 * (TAU * since / turn).cos();
        let taxels = frames.tactile[frame * n..(frame + 1) * n].iter_mut();
        for (value, (first, second)) in taxels.zip(ends[0].iter().zip(&ends[1])) {
            *value += force * (first + share * (second - first));
        }
        frames.truth_gf[frame] = frames.truth_gf[frame].max(0.0) + force;
        frames.zero_load[frame] = false;
    }
}

/// The frames of the parts that are kept, with these columns.
fn kept(
    frames: &SessionFrames,
    columns: &[f32],
    n_columns: usize,
    number: usize,
    is_kept: impl Fn(Part) -> bool,
) -> SessionFrames {
    let name = format!("{} with held touches {number}", frames.name);
    let mut kept = SessionFrames { name, n_taxels: n_columns, ..SessionFrames::default() };
    let (mut epoch, mut last) = (0, None);
    for frame in (0..frames.truth_gf.len()).filter(|frame| is_kept(frames.part[*frame])) {
        let follows = last.replace((frames.epoch[frame], frame + 1)) == Some((frames.epoch[frame], frame));
        epoch += u32::from(!follows);
        kept.tactile.extend_from_slice(&columns[frame * n_columns..(frame + 1) * n_columns]);
        kept.truth_gf.push(frames.truth_gf[frame]);
        kept.zero_load.push(frames.zero_load[frame]);
        kept.part.push(frames.part[frame]);
        kept.epoch.push(epoch);
    }
    kept
}

/// Runs of frames in the air, each of one part; none of the test part.
fn runs_in_air(frames: &SessionFrames) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    let is_air = |frame: &usize| frames.zero_load[*frame] && frames.part[*frame] != Part::Test;
    let follows =
        |frame: usize| frames.epoch[frame] == frames.epoch[frame - 1] && frames.part[frame] == frames.part[frame - 1];
    for frame in (0..frames.truth_gf.len()).filter(is_air) {
        match runs.last_mut() {
            Some(run) if run.end == frame && follows(frame) => run.end += 1,
            _ => runs.push(frame..frame + 1),
        }
    }
    runs
}

/// How old the angles of a frame are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Age {
    Fresh,
    Held,
    Old,
}

/// Joint angles as a hand tracker gives them.
struct Tracked {
    /// `[frames, joints]`, rad.
    pose: Vec<f32>,
    /// `[frames]`
    age: Vec<Age>,
}

impl Tracked {
    fn of(frames: &SessionFrames) -> Self {
        Tracked { pose: frames.pose.clone(), age: vec![Age::Fresh; frames.truth_gf.len()] }
    }

    /// Seen by a tracker with noise, bias and delay, which is slow and blind at times.
    fn badly(frames: &SessionFrames, joints: usize, rate_hz: f64, random: &mut Random) -> Self {
        let n = frames.truth_gf.len();
        let uniform = |deviation: f32| 3.0f32.sqrt() * deviation;
        let how_bad = random.unit();
        let noise = uniform(NOISE_RAD * how_bad);
        let bias: Vec<f32> = (0..joints).map(|_| random.symmetric(uniform(BIAS_RAD * how_bad))).collect();
        let delay = (DELAY_S * random.unit() * rate_hz as f32) as usize;
        let every = if random.unit() < SLOW_SHARE { (rate_hz / SLOW_HZ).round().max(1.0) as usize } else { 1 };
        let goes_blind = BLIND_PER_S * random.unit() / rate_hz as f32;
        let mut samples = Vec::with_capacity((n / every + 2) * joints);
        for sample in 0..n / every + 2 {
            let seen = (sample * every).saturating_sub(delay).min(n - 1);
            let angles = frames.pose[seen * joints..(seen + 1) * joints].iter().zip(&bias);
            samples.extend(angles.map(|(angle, bias)| angle + bias + random.symmetric(noise)));
        }
        let (mut pose, mut age) = (Vec::with_capacity(n * joints), Vec::with_capacity(n));
        let (mut blind, mut since) = (0, 0);
        for frame in 0..n {
            if blind == 0 && random.unit() < goes_blind {
                blind = n_frames(random, BLIND_S, rate_hz);
            }
            if blind > 0 && frame > 0 {
                (blind, since) = (blind - 1, since + 1);
                age.push(if f64::from(since) > HELD_POSE_S * rate_hz { Age::Old } else { Age::Held });
                pose.extend_from_within((frame - 1) * joints..frame * joints);
                continue;
            }
            since = 0;
            age.push(Age::Fresh);
            let (sample, share) = (frame / every, (frame % every) as f32 / every as f32);
            let angles = samples[sample * joints..].iter().zip(&samples[(sample + 1) * joints..]).take(joints);
            pose.extend(angles.map(|(before, after)| before + share * (after - before)));
        }
        Tracked { pose, age }
    }
}

fn log_uniform(random: &mut Random, (least, most): (f32, f32)) -> f32 {
    least * (most / least).powf(random.unit())
}

/// A random time, in frames.
fn n_frames(random: &mut Random, seconds: (f32, f32), rate_hz: f64) -> usize {
    (f64::from(log_uniform(random, seconds)) * rate_hz) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fusion::TOUCH_INPUTS;

    const HZ: f64 = 100.0;

    /// Two taxels that read 10 and 20 of a gF, and 50 of a rad of their joint.
    fn artifact() -> Arc<ArtifactModel> {
        let model = ArtifactModel {
            n_taxels: 2,
            n_joints: 1,
            shapes: [50.0, 0.0, 0.0, 0.0].repeat(2),
            gain_variance: vec![0.1; 2],
            slip: 0.3,
            slip_common: 0.3,
            slip_time_s: 90.0,
            touch: vec![10.0, 20.0],
            residual: vec![25.0; 2],
            touch_inputs: true,
        };
        model.check().unwrap();
        Arc::new(model)
    }

    fn fit() -> ArtifactFit {
        ArtifactFit { gains: vec![1.0; 2], offset: vec![0.0; 2], covariance: vec![1e-3; 2] }
    }

    /// Two minutes in the air, a firm touch of ten seconds, and twenty that are kept for the test.
    fn raw() -> Session {
        let n = 15_000;
        let angle = |frame: usize| 0.5 + 0.4 * (frame as f32 * 0.03).sin();
        let force = |frame: usize| if (12_000..13_000).contains(&frame) { 80.0 } else { 0.0 };
        let taxels = |frame: usize| [10.0, 20.0].map(|touch| 50.0 * angle(frame) + touch * force(frame));
        Session::new(SessionFrames {
            name: "session".into(),
            n_taxels: 2,
            n_joints: 1,
            tactile: (0..n).flat_map(taxels).collect(),
            pose: (0..n).map(angle).collect(),
            truth_gf: (0..n).map(force).collect(),
            tangential_gf: Vec::new(),
            zero_load: (0..n).map(|frame| force(frame) == 0.0).collect(),
            part: (0..n)
                .map(|frame| match frame {
                    0..12_500 => Part::Train,
                    12_500..13_000 => Part::Validation,
                    _ => Part::Test,
                })
                .collect(),
            epoch: vec![1; n],
        })
        .unwrap()
    }

    fn copy_of(seed: u64, number: usize) -> SessionFrames {
        let (raw, artifact, fit) = (raw(), artifact(), fit());
        let touched = TouchedSession { raw: &raw, artifact: &artifact, fit: &fit, rate_hz: HZ };
        let copies = touched.copies::<TrainError>(seed, number..number + 1, || Ok(())).unwrap();
        copies[0].frames().clone()
    }

    /// The number of the first copy of a kind.
    fn number(kind: Condition) -> usize {
        COPIES.iter().position(|of| *of == kind).unwrap()
    }

    #[test]
    fn light_touches_are_held_in_the_air_but_not_in_the_test_part_and_the_filter_sees_them() {
        let copy = copy_of(7, number(Condition::Plain));
        assert_eq!((copy.n_taxels, copy.truth_gf.len(), copy.tactile.len()), (2 + TOUCH_INPUTS, 13_000, 13_000 * 6));
        assert_eq!(copy.part, [vec![Part::Train; 12_500], vec![Part::Validation; 500]].concat());
        assert_eq!((copy.truth_gf[12_100], copy.truth_gf[12_600]), (80.0, 80.0), "firm touches stay");
        let (mut told, mut n_told, mut n_held) = (0.0, 0, 0);
        for copy in (7..13).map(|seed| copy_of(seed, number(Condition::Plain))) {
            let air = &copy.truth_gf[..12_000];
            n_held += air.iter().filter(|truth| **truth > 0.0).count();
            assert!(air.iter().all(|truth| (0.0..90.0).contains(truth)));
            assert!(copy.zero_load.iter().zip(&copy.truth_gf).all(|(zero_load, truth)| *zero_load == (*truth == 0.0)));
            // Where a touch of 8 gF or more has been held for a while, the filter tells it.
            for (frame, truth) in air.iter().enumerate().skip(100) {
                if air[frame - 100..frame].iter().all(|before| *before >= 8.0) {
                    told += copy.tactile[frame * 6 + 2] / 15.0 / truth;
                    n_told += 1;
                }
            }
        }
        assert!((6_000..60_000).contains(&n_held), "{n_held} frames are held");
        let told = told / n_told as f32;
        assert!(n_told > 1000 && (0.7..1.3).contains(&told), "{n_told} frames, {told} of the touch");
    }

    #[test]
    fn copies_are_those_of_their_seed_and_number_and_differ_otherwise() {
        assert_eq!(copy_of(7, 0), copy_of(7, 0));
        assert_ne!(copy_of(7, 0).truth_gf, copy_of(8, 0).truth_gf);
        assert_ne!(copy_of(7, 0).truth_gf, copy_of(7, 2).truth_gf);
    }

    #[test]
    fn a_frozen_filter_knows_no_touch_and_a_bad_tracker_has_noise() {
        let column = |copy: &SessionFrames, column: usize| -> Vec<f32> {
            copy.tactile.chunks_exact(6).map(|row| row[column]).collect()
        };
        let frozen = copy_of(7, number(Condition::Frozen));
        assert!(column(&frozen, 2).iter().all(|touch| *touch == 0.0));
        assert!(column(&frozen, 3).iter().all(|deviation| (*deviation - 150.0).abs() < 1e-3));
        let noise = |copy: &SessionFrames| column(copy, 4).iter().sum::<f32>() / copy.part.len() as f32;
        let (plain, shaken) =
            (noise(&copy_of(7, number(Condition::Plain))), noise(&copy_of(7, number(Condition::BadlyTracked))));
        assert!(shaken > 3.0 * plain, "{shaken} and {plain}");
    }

    #[test]
    fn a_session_without_firm_touches_or_air_has_no_copy_and_the_fit_of_another_model_is_refused() {
        let (artifact, fit) = (artifact(), fit());
        let light = SessionFrames { truth_gf: vec![0.0; 15_000], ..raw().frames().clone() };
        let light = Session::new(light).unwrap();
        let touched = TouchedSession { raw: &light, artifact: &artifact, fit: &fit, rate_hz: HZ };
        let copies = |of: TouchedSession<'_>| of.copies::<TrainError>(7, 0..2, || Ok(()));
        assert!(copies(touched).unwrap().is_empty());
        let part = vec![Part::Test; 12_000].into_iter().chain(vec![Part::Train; 1000]).chain(vec![Part::Test; 2000]);
        let without_air = SessionFrames { part: part.collect(), ..raw().frames().clone() };
        let without_air = Session::new(without_air).unwrap();
        assert!(copies(TouchedSession { raw: &without_air, ..touched }).unwrap().is_empty());
        let (raw, other) = (raw(), ArtifactFit { gains: vec![1.0; 3], ..fit.clone() });
        let refused = copies(TouchedSession { raw: &raw, fit: &other, ..touched }).unwrap_err();
        assert!(matches!(refused, TrainError::Artifact { .. }), "{refused}");
    }
}
