//! A user goes through a plan: finger movements and touches with human variation, and the annotations that go with them.

use super::hand::{
    Finger, FingerPose, Hand, HandPose, INDEX_BASE, INDEX_POSES, MOVEMENTS, N_FINGERS, TERMINAL_POSES, Unsteadiness,
};
use super::protocol::{Action, POSE_S, Plan, STEP_S, Setting, Trial};
use super::touch::{ForceStyle, Touch, minimum_jerk};
use crate::random::{Noise, Wander};
use crate::units::GramForce;

/// What the user interface of the collection wrote down. It holds until the next one.
#[derive(Debug, Clone, PartialEq)]
pub struct Annotation {
    /// s into the session.
    pub at_s: f64,
    /// 1 to 3; 0 when the session is over.
    pub stage: u8,
    /// In snake_case; empty outside of the protocol.
    pub substage: &'static str,
    /// Instructed pose or movement, in snake_case; empty when free.
    pub pose: &'static str,
    /// Counted from 0 within the substage.
    pub repetition: u16,
    /// Whether nothing touches the fingertip. Never true during a touch; false also while a touch is only expected.
    pub zero_load: bool,
}

/// Everything that a user intends in a session, fixed before it begins.
#[derive(Debug, Clone)]
pub struct Performance {
    tracks: [Track; N_FINGERS],
    touches: Vec<Touch>,
    annotations: Vec<Annotation>,
    end_s: f64,
}

/// Movements of one finger, one after the other.
#[derive(Debug, Clone)]
struct Track {
    start: FingerPose,
    moves: Vec<(f64, f64, FingerPose)>, // from when, until when, where to
}

impl Track {
    fn new(start: FingerPose) -> Self {
        Track { start, moves: Vec::new() }
    }

    /// Moves there, as soon as the movement before is over.
    fn move_to(&mut self, at_s: f64, duration_s: f64, to: FingerPose) {
        let from_s = self.moves.last().map_or(at_s, |&(_, until_s, _)| at_s.max(until_s));
        self.moves.push((from_s, from_s + duration_s, to));
    }

    fn at(&self, t_s: f64) -> FingerPose {
        let after = self.moves.partition_point(|&(from_s, _, _)| from_s <= t_s);
        let Some(&(from_s, until_s, to)) = after.checked_sub(1).and_then(|now| self.moves.get(now)) else {
            return self.start;
        };
        let from = after.checked_sub(2).and_then(|before| self.moves.get(before)).map_or(self.start, |&(_, _, to)| to);
        let progress = minimum_jerk((t_s - from_s) / (until_s - from_s));
        std::array::from_fn(|j| from[j] + (to[j] - from[j]) * progress)
    }
}

impl Performance {
    /// What a user makes of a plan.
    pub(crate) fn new(plan: &Plan, hand: &Hand, style: &ForceStyle, noise: &mut Noise) -> Self {
        let start = hand.aim(&TERMINAL_POSES[2].pose, noise); // relaxed
        let mut actor = Actor {
            hand,
            style,
            noise,
            performance: Performance {
                tracks: start.0.map(Track::new),
                touches: Vec::new(),
                annotations: Vec::new(),
                end_s: 0.0,
            },
        };
        for trial in plan.trials() {
            actor.perform(trial);
        }
        let mut performance = actor.performance;
        let over =
            Annotation { at_s: performance.end_s, stage: 0, substage: "", pose: "", repetition: 0, zero_load: false };
        performance.annotations.push(over);
        performance
    }

    /// Touches in their order.
    pub fn touches(&self) -> &[Touch] {
        &self.touches
    }

    /// Annotations in their order.
    pub fn annotations(&self) -> &[Annotation] {
        &self.annotations
    }

    /// How long the session takes, s.
    pub fn end_s(&self) -> f64 {
        self.end_s
    }

    /// The hand pose that muscles are told at `t_s`.
    pub fn intent(&self, t_s: f64) -> HandPose {
        HandPose(std::array::from_fn(|f| self.tracks[f].at(t_s)))
    }

    /// Index of the first touch that isn't over at `t_s`.
    fn next_touch(&self, t_s: f64) -> usize {
        self.touches.partition_point(|touch| touch.end_s <= t_s)
    }
}

/// Turns trials into movements and touches.
struct Actor<'a> {
    hand: &'a Hand,
    style: &'a ForceStyle,
    noise: &'a mut Noise,
    performance: Performance,
}

impl Actor<'_> {
    fn perform(&mut self, trial: &Trial) {
        let start_s = self.performance.end_s;
        let end_s = start_s + trial.duration_s;
        self.performance.end_s = end_s;
        match &trial.action {
            Action::Hold(pose) => {
                self.annotate(trial, start_s, TERMINAL_POSES[*pose].name, true);
                self.take_pose(&TERMINAL_POSES[*pose].pose, start_s);
            }
            Action::Move { movement, all_fingers } => {
                self.annotate(trial, start_s, MOVEMENTS[*movement].name, true);
                self.move_out_and_back(&MOVEMENTS[*movement].end, *all_fingers, start_s + 0.1, end_s - 0.1);
            }
            Action::MoveFreely => {
                self.annotate(trial, start_s, "", true);
                self.move_freely(start_s, end_s, 1.0);
            }
            Action::Taps(setting) => {
                let touch_s = self.set_up(trial, *setting, start_s, end_s);
                let mut at_s = touch_s + self.noise.uniform(0.15, 0.4);
                for level in 0..3 {
                    let tap = self.style.tap(level, at_s, self.noise);
                    at_s = tap.end_s + self.noise.uniform(0.35, 0.6);
                    self.performance.touches.push(tap);
                }
            }
            Action::Press(setting) => {
                let touch_s = self.set_up(trial, *setting, start_s, end_s);
                let (from_s, until_s) =
                    (touch_s + self.noise.uniform(0.1, 0.3), end_s - self.noise.uniform(0.05, 0.25));
                let press = self.style.varying_press(from_s, until_s, self.noise);
                self.performance.touches.push(press);
            }
            Action::PressThrough(poses) => {
                for (k, &pose) in poses.iter().enumerate() {
                    let at_s = start_s + k as f64 * STEP_S;
                    self.annotate(trial, at_s, TERMINAL_POSES[pose].name, false);
                    self.take_pose(&TERMINAL_POSES[pose].pose, at_s);
                }
                let (from_s, until_s) = (start_s + self.noise.uniform(0.3, 0.7), end_s - self.noise.uniform(0.1, 0.4));
                let press = self.style.held_press(from_s, until_s, self.noise);
                self.performance.touches.push(press);
            }
            Action::PressSequence { all_fingers } => {
                self.annotate(trial, start_s, "bend_fold", false);
                let (from_s, until_s) = (start_s + self.noise.uniform(0.3, 0.6), end_s - self.noise.uniform(0.3, 0.6));
                let middle_s = 0.5 * (from_s + until_s) + self.noise.uniform(-0.2, 0.2);
                let margin_s = 0.5;
                self.move_out_and_back(&MOVEMENTS[0].end, *all_fingers, from_s + margin_s, middle_s);
                self.move_out_and_back(&MOVEMENTS[1].end, *all_fingers, middle_s + 0.05, until_s - margin_s);
                let press = self.style.held_press(from_s, until_s, self.noise);
                self.performance.touches.push(press);
            }
        }
    }

    /// Annotates a trial with touches, takes up its pose, and says from when on it may be touched.
    fn set_up(&mut self, trial: &Trial, setting: Setting, start_s: f64, end_s: f64) -> f64 {
        let touch_s = start_s + POSE_S;
        let pose = match setting {
            Setting::Terminal(pose) => {
                self.take_pose(&TERMINAL_POSES[pose].pose, start_s);
                TERMINAL_POSES[pose].name
            }
            Setting::Index(pose) => {
                self.take_pose(&INDEX_BASE.with_index(INDEX_POSES[pose].index), start_s);
                INDEX_POSES[pose].name
            }
            Setting::Transition(pose) => {
                self.take_pose(&INDEX_BASE, start_s);
                let from_s = touch_s + self.noise.uniform(0.1, 0.4);
                let until_s = end_s - self.noise.uniform(0.3, 0.7);
                let bent = self.hand.aim(&INDEX_BASE.with_index(INDEX_POSES[pose].index), self.noise);
                self.track(Finger::Index).move_to(from_s, until_s - from_s, bent.finger(Finger::Index));
                INDEX_POSES[pose].name
            }
            Setting::Free => {
                // The tip must still reach the load cell, so the index finger keeps out of its last third.
                self.move_freely(start_s, end_s, 0.7);
                ""
            }
        };
        self.annotate(trial, start_s, pose, true);
        self.annotate(trial, touch_s, pose, false);
        touch_s
    }

    fn annotate(&mut self, trial: &Trial, at_s: f64, pose: &'static str, zero_load: bool) {
        let Trial { stage, substage, repetition, .. } = *trial;
        self.performance.annotations.push(Annotation { at_s, stage, substage, pose, repetition, zero_load });
    }

    fn track(&mut self, finger: Finger) -> &mut Track {
        &mut self.performance.tracks[finger as usize]
    }

    fn take_pose(&mut self, asked: &HandPose, at_s: f64) {
        let aimed = self.hand.aim(asked, self.noise);
        let reaction_s = self.noise.uniform(0.1, 0.25);
        for (track, to) in self.performance.tracks.iter_mut().zip(aimed.0) {
            let duration_s = (0.5 * self.hand.tempo() * self.noise.log_normal(0.15)).min(0.7);
            track.move_to(at_s + reaction_s + self.noise.uniform(0.0, 0.05), duration_s, to);
        }
    }

    fn move_out_and_back(&mut self, end: &FingerPose, all_fingers: bool, start_s: f64, end_s: f64) {
        let out = match all_fingers {
            // A thumb can't follow a finger's angles: it closes by as much as its joints allow.
            true => HandPose([*end, *end, *end, *end, [0.7 * end[0], 0.5 * end[1], 0.4 * end[2], 0.4]]),
            false => INDEX_BASE.with_index(*end),
        };
        let (out, back) = (self.hand.aim(&out, self.noise), self.hand.aim(&INDEX_BASE, self.noise));
        let turn = self.noise.uniform(0.44, 0.56);
        let pause_s = self.noise.uniform(0.0, 0.08) * (end_s - start_s);
        for f in 0..N_FINGERS {
            let delay_s = self.noise.uniform(0.0, 0.06);
            let turn_s = start_s + turn * (end_s - start_s);
            let track = &mut self.performance.tracks[f];
            track.move_to(start_s + delay_s, turn_s - pause_s - start_s - delay_s, out.0[f]);
            track.move_to(turn_s, end_s - turn_s, back.0[f]);
        }
    }

    /// Every finger as it likes. Its joints flex partly together, as in all natural movement, DIP and PIP nearly as one,
    /// because they share a tendon.
    fn move_freely(&mut self, start_s: f64, end_s: f64, index_reach: f64) {
        for f in 0..N_FINGERS {
            let reach = if f == Finger::Index as usize { index_reach } else { 1.0 };
            let mut at_s = start_s + self.noise.uniform(0.0, 0.3);
            loop {
                let duration_s = self.hand.tempo() * self.noise.uniform(0.35, 0.9);
                if at_s + duration_s > end_s {
                    break;
                }
                let flexion = self.noise.uniform(0.0, 1.0);
                let curl = reach * (0.5 * flexion + self.noise.uniform(0.0, 0.5));
                let fold = reach * (0.5 * flexion + self.noise.uniform(-0.05, 0.4));
                let dip = curl * (0.7 + self.noise.normal(0.15));
                let to = match f == Finger::Thumb as usize {
                    true => [curl, 0.7 * curl, 0.7 * fold, self.noise.uniform(0.0, 0.8)],
                    false => [1.4 * dip, 1.5 * curl, 1.3 * fold, self.noise.uniform(-0.25, 0.25)],
                };
                self.performance.tracks[f].move_to(at_s, duration_s, to);
                at_s += duration_s + self.noise.exponential(0.3);
            }
        }
    }
}

/// A contact of the fingertip as it is now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Which touch of the session it is.
    pub touch: usize,
    /// Normal force.
    pub force: GramForce,
}

/// Hand and contact at one point in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandState {
    /// True joint angles.
    pub pose: HandPose,
    /// What is touched, if anything.
    pub contact: Option<Contact>,
}

/// Lives through a performance: adds what nobody intends.
#[derive(Debug)]
pub(crate) struct Performer {
    performance: Performance,
    hand: Hand,
    unsteadiness: Unsteadiness,
    force_error: [Wander; 2],
    noise: Noise,
    now_s: f64,
}

/// How far DIP, PIP and MCP give way under a firm press, rad, and the force at which most of it has happened.
///
/// # Source
/// Joint compliance: a loaded fingertip is pushed back at its DIP first, by several degrees at a few newtons.
const YIELD_RAD: [f64; 3] = [0.10, 0.03, 0.03];
const YIELD_GF: f64 = 250.0;

impl Performer {
    pub(crate) fn new(performance: Performance, hand: Hand, mut noise: Noise) -> Self {
        let unsteadiness = Unsteadiness::new(&hand, &mut noise);
        // Force control: a slow error of a few percent, and tremor of the whole arm that stays below 2 %.
        let force_error = [Wander::new(0.04, 0.3, &mut noise), Wander::new(0.015, 0.02, &mut noise)];
        Performer { performance, hand, unsteadiness, force_error, noise, now_s: 0.0 }
    }

    pub(crate) fn performance(&self) -> &Performance {
        &self.performance
    }

    /// Hand and contact at `t_s`, which never goes back.
    pub(crate) fn advance(&mut self, t_s: f64) -> HandState {
        let dt_s = (t_s - self.now_s).max(0.0);
        self.now_s = t_s;
        let [slow, fast] = self.force_error.each_mut().map(|error| error.advance(dt_s, &mut self.noise));
        let held = self.hand.follow(&self.performance.intent(t_s));
        let mut pose = self.unsteadiness.advance(t_s, dt_s, &held, &mut self.noise);
        let next = self.performance.next_touch(t_s);
        let touches = self.performance.touches();
        let index = &mut pose.0[Finger::Index as usize];
        for touch in next.checked_sub(1).into_iter().chain([next]).filter_map(|touch| touches.get(touch)) {
            index[2] -= touch.lift(t_s);
        }
        let intended = touches.get(next).map_or(0.0, |touch| touch.force(t_s).0);
        let force = (intended * (1.0 + slow + fast)).max(0.0);
        if force <= 0.0 {
            return HandState { pose, contact: None };
        }
        let give = force / (force + YIELD_GF);
        for (angle, yielded) in index.iter_mut().zip(YIELD_RAD) {
            *angle -= yielded * give;
        }
        HandState { pose, contact: Some(Contact { touch: next, force: GramForce(force) }) }
    }
}
