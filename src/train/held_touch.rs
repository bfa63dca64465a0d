//! Sessions for a network that gets how far corrected taxels can be trusted: copies in whose air light touches are held.
//!
//! The paper's protocol has no light touch that is held while the hand moves, so a network could not learn what the filter makes
//! of one. Touches are laid on the taxels before the filter takes the artifact out. How they spread over the taxels is
//! that of firm touches of the same session. At times the filter starts, also while something touches, or comes out of minutes of
//! grasp. Some copies have what else the network must cope with: a worse hand tracker, and a filter that does not follow.

mod past;
mod tracked;

use std::collections::BTreeMap;
use std::f32::consts::TAU;
use std::ops::Range;
use std::sync::Arc;

use super::dataset::{Session, SessionFrames};
use super::error::TrainError;
use super::random::{Random, Stream};
use crate::eval::Part;
use crate::fusion::{ArtifactFilter, ArtifactFit, ArtifactFitter, ArtifactModel, Following};
use past::{Grasp, Past, starts};
use tracked::{Age, Tracked};

/// Force of a firm touch, gF: how it spreads is known.
const FIRM_GF: f32 = 40.0;

/// Forces of the held touches, gF.
const FORCES_GF: (f32, f32) = (2.5, 40.0);

/// How long they last, and the air between them, s.
const HELD_S: (f32, f32) = (0.5, 40.0);
const BETWEEN_S: (f32, f32) = (0.5, 400.0);

/// The air after a grasp, s: the network must know what the filter knows no longer.
const AFTER_GRASP_S: (f32, f32) = (10.0, 120.0);

/// How long they take to begin and to end, s: slower ones can't be told from what slip leaves, and teach the network to see touches
/// where there are none.
const RAMP_S: (f32, f32) = (0.03, 1.0);

/// In how many touches, other than grasps, the filter starts, and the time between two starts in one of them, s.
const STARTS_IN_TOUCH: f32 = 0.7;
const TOUCHED_STARTS_S: (f32, f32) = (1.0, 20.0);

/// How many touches are let go in part at first, the shares of them that are left, and for how long, s.
const IN_PART: f32 = 0.3;
const LEFT_SHARES: (f32, f32) = (0.1, 0.7);
const LEFT_S: (f32, f32) = (0.5, 20.0);

/// How long a grasp takes to end, s.
const RELEASE_S: (f32, f32) = (0.03, 2.0);

/// How far the force wanders, as a share of it, how slowly, s, and the least that is left of it.
const WANDER: f32 = 0.2;
const WANDER_S: f32 = 1.0;
const LEAST_SHARE: f32 = 0.2;

/// How long it takes until the touch is spread as another one, and again as before, s.
const SPREAD_S: (f32, f32) = (2.0, 20.0);

/// How often frames are lost for the filter, a minute.
const RESTARTS_PER_MIN: f32 = 1.0;

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
        let clean = self.columns(frames, &BTreeMap::new(), &Tracked::of(frames), self.fit, Following::On, None)?;
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
        let mut past = BTreeMap::new();
        for air in runs_in_air(frames) {
            let begins = starts(&air, rate_hz, &mut random);
            past.extend(begins.into_iter().map(|frame| (frame, Past::start(&mut random))));
            let mut begin = air.start + n_frames(&mut random, BETWEEN_S, rate_hz);
            while begin < air.end {
                let ends = [spread(&mut random), spread(&mut random)];
                let grasp = Grasp::before(begin - air.start, rate_hz, ends[0].clone(), &mut random);
                let (length, course, between) = match &grasp {
                    Some((grasp, left)) => (*left, Course::end_of(grasp.force_gf, rate_hz, &mut random), AFTER_GRASP_S),
                    None => (n_frames(&mut random, HELD_S, rate_hz), Course::new(rate_hz, &mut random), BETWEEN_S),
                };
                let mut held = begin..(begin + length).min(air.end);
                hold(&mut touched, held.clone(), &ends, &course, &mut random);
                if random.unit() < IN_PART {
                    let (left, rest) = course.left(&held, &mut random);
                    held.end = left.end.min(air.end);
                    hold(&mut touched, left.start..held.end, &ends, &rest, &mut random);
                }
                match grasp {
                    Some((grasp, _)) => _ = past.insert(begin, Past::Grasp(grasp)),
                    None if random.unit() < STARTS_IN_TOUCH => {
                        let mut at = begin + held.len() / 4;
                        while at < held.end {
                            past.insert(at, Past::start(&mut random));
                            at += n_frames(&mut random, TOUCHED_STARTS_S, rate_hz).max(1);
                        }
                    }
                    None => {}
                }
                begin = held.end + n_frames(&mut random, between, rate_hz);
            }
        }
        // Frames on both sides of what the copy leaves out follow no longer on each other.
        let mut left_out = 0;
        for (frame, epoch) in touched.epoch.iter_mut().enumerate() {
            left_out += u32::from(past.contains_key(&frame));
            *epoch += left_out;
        }
        let kind = COPIES[number % COPIES.len()];
        let (mut tracked, mut fit) = (Tracked::of(frames), self.fit.clone());
        if kind == Condition::BadlyTracked {
            tracked = Tracked::badly(frames, artifact.n_joints, rate_hz, &mut random);
            fit = self.fitted(&tracked).unwrap_or(fit);
        }
        let following = if kind == Condition::Frozen { Following::Frozen } else { Following::On };
        let columns = self.columns(&touched, &past, &tracked, &fit, following, Some(&mut random))?;
        let is_kept = |part: Part| part == Part::Train || (part == Part::Validation && kind == Condition::Plain);
        let kept = kept(&touched, &columns, n_columns, number, is_kept);
        if !kept.zero_load.contains(&true) {
            return Ok(None);
        }
        Ok(Some(Session::new(kept)?))
    }

    /// The network's input of all frames, of these taxels and what the filter went through before some of them. With random
    /// numbers, frames are lost now and then.
    fn columns(
        &self,
        frames: &SessionFrames,
        past: &BTreeMap<usize, Past>,
        tracked: &Tracked,
        fit: &ArtifactFit,
        following: Following,
        mut random: Option<&mut Random>,
    ) -> Result<Vec<f32>, TrainError> {
        let artifact = self.artifact;
        let (n, n_columns) = (artifact.n_taxels, artifact.n_columns());
        let started = |fit: &ArtifactFit| -> Result<ArtifactFilter, TrainError> {
            let mut filter = ArtifactFilter::new(Arc::clone(artifact), self.rate_hz, following);
            filter.handle_fit(fit.clone()).map_err(|error| TrainError::Artifact { what: error.to_string() })?;
            Ok(filter)
        };
        let correct = |filter: &mut ArtifactFilter, taxels: &mut [f32], frame: usize| {
            let pose = &tracked.pose[frame * artifact.n_joints..][..artifact.n_joints];
            let age = tracked.age[frame];
            filter.correct(taxels, (age != Age::Old).then_some(pose), 1, age == Age::Fresh);
        };
        let mut filter = started(fit)?;
        let chance = RESTARTS_PER_MIN / 60.0 / self.rate_hz as f32;
        let mut columns = vec![0.0; frames.truth_gf.len() * n_columns];
        for (frame, row) in columns.chunks_exact_mut(n_columns).enumerate() {
            let taxels_of = |frame: usize| &frames.tactile[frame * n..(frame + 1) * n];
            let is_lost = random.as_mut().is_some_and(|random| random.unit() < chance);
            match past.get(&frame) {
                Some(Past::Start) => filter = started(fit)?,
                Some(Past::StartKnowing) => filter = started(filter.fit().as_ref().unwrap_or(fit))?,
                Some(Past::Grasp(grasp)) => {
                    let mut taxels = vec![0.0; n];
                    for (again, force) in grasp.frames(frame) {
                        let held =
                            taxels_of(again).iter().zip(&grasp.spread).map(|(value, share)| value + force * share);
                        taxels.iter_mut().zip(held).for_each(|(taxel, held)| *taxel = held);
                        correct(&mut filter, &mut taxels, again);
                    }
                }
                None if is_lost || (frame > 0 && frames.epoch[frame] != frames.epoch[frame - 1]) => filter.restart(),
                None => {}
            }
            let (of_taxels, trust) = row.split_at_mut(n);
            of_taxels.copy_from_slice(taxels_of(frame));
            correct(&mut filter, of_taxels, frame);
            filter.write_trust(trust);
        }
        Ok(columns)
    }

    /// The artifact of the donning by the angles of another tracker: of its first seconds in the air. `None` if they are too few.
    fn fitted(&self, tracked: &Tracked) -> Option<ArtifactFit> {
        let (frames, artifact) = (self.raw.frames(), self.artifact);
        let mut fitter = ArtifactFitter::new(Arc::clone(artifact), self.rate_hz, None);
        let rows = frames.tactile.chunks_exact(artifact.n_taxels).zip(tracked.pose.chunks_exact(artifact.n_joints));
        let mut left = (CALIBRATION_S * self.rate_hz) as usize;
        for (frame, (taxels, pose)) in rows.enumerate() {
            fitter.handle_frame(taxels, pose, i32::from(frame > 0), frames.zero_load[frame]);
            left = left.saturating_sub(usize::from(frames.zero_load[frame]));
            if left == 0 {
                break;
            }
        }
        fitter.finish().ok()
    }
}

/// How the force of a touch goes.
struct Course {
    level_gf: f32,
    /// How many frames it takes to begin, to end, and to be spread as another one and again as before.
    rise: f32,
    fall: f32,
    turn: f32,
    rate_hz: f64,
}

impl Course {
    fn new(rate_hz: f64, random: &mut Random) -> Self {
        let level_gf = log_uniform(random, FORCES_GF);
        let [rise, fall] = [(); 2].map(|()| n_frames(random, RAMP_S, rate_hz).max(1) as f32);
        Course { level_gf, rise, fall, turn: n_frames(random, SPREAD_S, rate_hz).max(1) as f32, rate_hz }
    }

    /// The end of a grasp with this force.
    fn end_of(level_gf: f32, rate_hz: f64, random: &mut Random) -> Self {
        let fall = n_frames(random, RELEASE_S, rate_hz).max(1) as f32;
        Course { level_gf, fall, rise: 1.0, ..Course::new(rate_hz, random) }
    }

    /// What is left for a while of a touch in these frames that is let go in part, and its frames: it rises as the touch falls.
    fn left(&self, held: &Range<usize>, random: &mut Random) -> (Range<usize>, Self) {
        let level_gf = self.level_gf * log_uniform(random, LEFT_SHARES);
        let begin = held.end - (self.fall as usize).min(held.len());
        let frames = begin..held.end + n_frames(random, LEFT_S, self.rate_hz);
        (frames, Course { level_gf, rise: self.fall, ..Course::new(self.rate_hz, random) })
    }
}

/// Lays a touch on frames. Its spread goes from one end to the other and back.
fn hold(frames: &mut SessionFrames, held: Range<usize>, ends: &[Vec<f32>; 2], course: &Course, random: &mut Random) {
    let &Course { level_gf, rise, fall, turn, rate_hz } = course;
    let keep = (-1.0 / (WANDER_S * rate_hz as f32)).exp();
    let step = WANDER * (3.0 * (1.0 - keep * keep)).sqrt(); // a uniform number up to 1 has a variance of 1/3
    let mut wander = 0.0;
    let n = frames.n_taxels;
    for frame in held.clone() {
        wander = keep * wander + random.symmetric(step);
        let (since, left) = ((frame - held.start + 1) as f32, (held.end - frame) as f32);
        let force = level_gf * (since / rise).min(left / fall).min(1.0) * (1.0 + wander).max(LEAST_SHARE);
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
    use crate::fusion::TRUST_INPUTS;

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
            drift: Vec::new(),
            noise: Vec::new(),
            misfit: Vec::new(),
            uncertain_offsets: false,
            trust_inputs: true,
        };
        model.check().unwrap();
        Arc::new(model)
    }

    fn fit() -> ArtifactFit {
        ArtifactFit {
            gains: vec![1.0; 2],
            offset: vec![0.0; 2],
            covariance: vec![1e-3; 2],
            offset_covariance: Vec::new(),
        }
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
    fn light_touches_are_held_in_the_air_but_not_in_the_test_part_and_stay_in_the_taxels() {
        let copy = copy_of(7, number(Condition::Plain));
        assert_eq!((copy.n_taxels, copy.truth_gf.len(), copy.tactile.len()), (2 + TRUST_INPUTS, 13_000, 13_000 * 4));
        assert_eq!(copy.part, [vec![Part::Train; 12_500], vec![Part::Validation; 500]].concat());
        assert_eq!((copy.truth_gf[12_100], copy.truth_gf[12_600]), (80.0, 80.0), "firm touches stay");
        let (mut left, mut n_held) = (Vec::new(), 0);
        for copy in (7..31).map(|seed| copy_of(seed, number(Condition::Plain))) {
            let air = &copy.truth_gf[..12_000];
            n_held += air.iter().filter(|truth| **truth > 0.0).count();
            assert!(air.iter().all(|truth| (0.0..1000.0).contains(truth)), "a grasp is the most");
            assert!(copy.zero_load.iter().zip(&copy.truth_gf).all(|(zero_load, truth)| *zero_load == (*truth == 0.0)));
            // Where a touch of 8 gF or more has been held for a while, the filter leaves it there. Taxel 0 reads 10 of each gF.
            for (frame, truth) in air.iter().enumerate().skip(100) {
                if air[frame - 100..=frame].iter().all(|force| *force >= 8.0) {
                    left.push(copy.tactile[frame * 4] / 10.0 / truth);
                }
            }
        }
        assert!((3_000..100_000).contains(&n_held), "{n_held} frames are held");
        left.sort_unstable_by(f32::total_cmp);
        let median = left[left.len() / 2];
        assert!(left.len() > 1000 && (0.7..1.3).contains(&median), "{} frames, {median} of the touch", left.len());
    }

    #[test]
    fn the_filter_starts_at_times_and_comes_out_of_grasps() {
        let (mut n_starts, mut n_grasps) = (0, 0);
        for copy in (7..13).map(|seed| copy_of(seed, number(Condition::Plain))) {
            for frame in (1..12_000).filter(|frame| copy.epoch[*frame] != copy.epoch[frame - 1]) {
                // A filter that starts has followed nothing yet: 10 gF, which is 150 of a taxel. In a grasp the touch is in the
                // first frame.
                let [before, left] = [frame - 1, frame].map(|frame| copy.tactile[frame * 4 + 3]);
                let is_grasp = copy.truth_gf[frame] >= 20.0 && copy.truth_gf[frame - 1] == 0.0;
                n_grasps += usize::from(is_grasp);
                n_starts += usize::from(!is_grasp);
                assert!(is_grasp || left > before, "{left} after {before}");
            }
        }
        assert!(n_starts >= 6 && n_grasps >= 3, "{n_starts} starts, {n_grasps} grasps");
    }

    #[test]
    fn a_start_goes_back_to_the_calibration_or_goes_on_from_what_the_filter_knew() {
        let (raw, artifact) = (raw(), artifact());
        let off = ArtifactFit { gains: vec![0.8; 2], ..fit() };
        let touched = TouchedSession { raw: &raw, artifact: &artifact, fit: &off, rate_hz: HZ };
        let left_after = |past: Past| {
            let (frames, at) = (raw.frames(), 11_000);
            let past = BTreeMap::from([(at, past)]);
            let columns = touched.columns(frames, &past, &Tracked::of(frames), &off, Following::On, None).unwrap();
            columns[at * 4].abs()
        };
        let (back, on) = (left_after(Past::Start), left_after(Past::StartKnowing));
        assert!(back > 1.0 && on < 0.2 * back, "{back} is left at the calibration, {on} of what the filter knew");
    }

    #[test]
    fn copies_are_those_of_their_seed_and_number_and_differ_otherwise() {
        assert_eq!(copy_of(7, 0), copy_of(7, 0));
        assert_ne!(copy_of(7, 0).truth_gf, copy_of(8, 0).truth_gf);
        assert_ne!(copy_of(7, 0).truth_gf, copy_of(7, 2).truth_gf);
    }

    #[test]
    fn a_frozen_filter_is_told_and_a_bad_tracker_has_noise() {
        let column = |copy: &SessionFrames, column: usize| -> Vec<f32> {
            copy.tactile.chunks_exact(4).map(|row| row[column]).collect()
        };
        let frozen = copy_of(7, number(Condition::Frozen));
        let left = |copy: &SessionFrames| column(copy, 3).iter().sum::<f32>() / copy.part.len() as f32;
        let (kept, followed) = (left(&frozen), left(&copy_of(7, number(Condition::Plain))));
        assert!(
            kept > 1.2 * followed && kept < 150.0,
            "{kept} where gains are kept, {followed} where they are followed"
        );
        let noise = |copy: &SessionFrames| column(copy, 2).iter().sum::<f32>() / copy.part.len() as f32;
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
