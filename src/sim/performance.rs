//! A user goes through a plan: finger movements and touches with human variation, and their annotations.

use super::hand::{
    Finger, FingerPose, Hand, HandPose, INDEX_BASE, N_FINGERS, TERMINAL_POSES, Unsteadiness, movement_named, pose_named,
};
use super::touch::{ForceStyle, Touch, minimum_jerk};
use crate::protocol::{Action, Name, Plan, Protocol, Setting, Trial};
use crate::random::{Noise, Wander};
use crate::units::GramForce;

/// An annotation by the user interface of the collection. It holds until the next one.
#[derive(Debug, Clone, PartialEq)]
pub struct Annotation {
    /// s into the session.
    pub at_s: f64,
    /// 1 to 3; 0 when the session is over.
    pub stage: u8,
    /// In snake_case; empty outside of the protocol.
    pub substage: Name,
    /// Instructed pose or movement, in snake_case; empty when free.
    pub pose: Name,
    /// Counted from 0 within the substage.
    pub repetition: u16,
    /// True if nothing touches the fingertip. Never true during a touch; false also while a touch is only expected.
    pub zero_load: bool,
}

/// All intents of a user in a session, fixed before it begins.
#[derive(Debug, Clone)]
pub struct Performance {
    tracks: [Track; N_FINGERS],
    touches: Vec<Touch>,
    annotations: Vec<Annotation>,
    load_cell: Vec<(f64, Finger)>, // from when on, under which finger
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

    /// Moves to a target after the previous movement.
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
    /// A user's performance of a plan.
    pub(crate) fn new(
        protocol: &Protocol,
        plan: &Plan,
        hand: &Hand,
        style: &ForceStyle,
        finger: Finger,
        noise: &mut Noise,
    ) -> Self {
        let mut performance = Performance::idle(hand, finger, noise);
        let mut actor = Actor { hand, style, noise, pose_s: protocol.pose_s, performance: &mut performance };
        let mut at_s = 0.0;
        for trial in plan.trials() {
            actor.perform(trial, at_s);
            actor.performance.annotate(protocol, trial, at_s);
            at_s += trial.duration_s;
        }
        performance.end(at_s);
        performance
    }

    /// A user with a relaxed hand who does nothing, with the load cell under a finger.
    pub(crate) fn idle(hand: &Hand, finger: Finger, noise: &mut Noise) -> Self {
        let start = hand.aim(&TERMINAL_POSES[2].pose, noise); // relaxed
        Performance {
            tracks: start.0.map(Track::new),
            touches: Vec::new(),
            annotations: Vec::new(),
            load_cell: vec![(f64::NEG_INFINITY, finger)],
            end_s: f64::INFINITY,
        }
    }

    pub(super) fn touch(&mut self, touch: Touch) {
        self.touches.push(touch);
    }

    pub(super) fn annotate_as(&mut self, annotation: Annotation) {
        self.annotations.push(annotation);
    }

    /// Puts the load cell under a finger.
    pub(super) fn move_load_cell(&mut self, at_s: f64, finger: Finger) {
        self.load_cell.push((at_s, finger));
    }

    /// The finger above the load cell at `t_s`: the only one that touches.
    pub fn finger_at(&self, t_s: f64) -> Finger {
        let after = self.load_cell.partition_point(|&(from_s, _)| from_s <= t_s);
        after.checked_sub(1).and_then(|now| self.load_cell.get(now)).map_or(Finger::default(), |&(_, finger)| finger)
    }

    /// Annotates the end of the session.
    pub(super) fn end(&mut self, at_s: f64) {
        let over = Annotation { at_s, stage: 0, substage: "".into(), pose: "".into(), repetition: 0, zero_load: false };
        self.annotations.push(over);
        self.end_s = at_s;
    }

    /// Ends the current touch, and drops all movements and touches that have not begun.
    pub(crate) fn stop(&mut self, at_s: f64) {
        self.tracks.iter_mut().for_each(|track| track.moves.retain(|&(from_s, _, _)| from_s <= at_s));
        self.touches.retain(|touch| touch.start_s <= at_s);
        if let Some(last) = self.touches.last_mut() {
            last.let_go(at_s);
        }
    }

    /// Touches in order.
    pub fn touches(&self) -> &[Touch] {
        &self.touches
    }

    /// Annotations in order.
    pub fn annotations(&self) -> &[Annotation] {
        &self.annotations
    }

    /// Duration of the session, s.
    pub fn end_s(&self) -> f64 {
        self.end_s
    }

    /// The intended hand pose at `t_s`.
    pub fn intent(&self, t_s: f64) -> HandPose {
        HandPose(std::array::from_fn(|f| self.tracks[f].at(t_s)))
    }

    /// Index of the first touch that isn't over at `t_s`.
    fn next_touch(&self, t_s: f64) -> usize {
        self.touches.partition_point(|touch| touch.end_s <= t_s)
    }

    fn annotate(&mut self, protocol: &Protocol, trial: &Trial, start_s: f64) {
        for step in trial.steps(protocol) {
            self.annotations.push(Annotation {
                at_s: start_s + step.at_s,
                stage: trial.stage,
                substage: trial.substage.clone(),
                pose: step.pose,
                repetition: trial.repetition,
                zero_load: step.zero_load,
            });
        }
    }
}

/// Converts trials to movements and touches.
pub(crate) struct Actor<'a> {
    pub(crate) hand: &'a Hand,
    pub(crate) style: &'a ForceStyle,
    pub(crate) noise: &'a mut Noise,
    /// Time to take up a pose before a touch, s.
    pub(crate) pose_s: f64,
    pub(crate) performance: &'a mut Performance,
}

impl Actor<'_> {
    /// Performs a trial from `start_s` on. Poses and movements that the user doesn't know are left out.
    pub(crate) fn perform(&mut self, trial: &Trial, start_s: f64) {
        let end_s = start_s + trial.duration_s;
        match &trial.action {
            Action::Hold(pose) => self.take_pose(pose, start_s),
            Action::Move { movement, all_fingers } => {
                self.move_out_and_back(movement, *all_fingers, start_s + 0.1, end_s - 0.1);
            }
            Action::MoveFreely => self.move_freely(start_s, end_s, 1.0),
            Action::Taps(setting) => {
                let touch_s = self.set_up(setting, start_s, end_s);
                let mut at_s = touch_s + self.noise.uniform(0.15, 0.4);
                for level in 0..3 {
                    let tap = self.style.tap(level, at_s, self.noise);
                    at_s = tap.end_s + self.noise.uniform(0.35, 0.6);
                    self.performance.touches.push(tap);
                }
            }
            Action::Press(setting) => {
                let touch_s = self.set_up(setting, start_s, end_s);
                let (from_s, until_s) =
                    (touch_s + self.noise.uniform(0.1, 0.3), end_s - self.noise.uniform(0.05, 0.25));
                let press = self.style.varying_press(from_s, until_s, self.noise);
                self.performance.touches.push(press);
            }
            Action::PressThrough(poses) => {
                let each_s = trial.duration_s / poses.len() as f64;
                for (k, pose) in poses.iter().enumerate() {
                    self.take_pose(pose, start_s + k as f64 * each_s);
                }
                let (from_s, until_s) = (start_s + self.noise.uniform(0.3, 0.7), end_s - self.noise.uniform(0.1, 0.4));
                self.hold_press(from_s, until_s);
            }
            Action::PressSequence { movements, all_fingers } => {
                let (from_s, until_s) = (start_s + self.noise.uniform(0.3, 0.6), end_s - self.noise.uniform(0.3, 0.6));
                let middle_s = 0.5 * (from_s + until_s) + self.noise.uniform(-0.2, 0.2);
                let margin_s = 0.5;
                let halves = [(from_s + margin_s, middle_s), (middle_s + 0.05, until_s - margin_s)];
                for (movement, (from_s, until_s)) in movements.iter().zip(halves) {
                    self.move_out_and_back(movement, *all_fingers, from_s, until_s);
                }
                self.hold_press(from_s, until_s);
            }
        }
    }

    /// Presses with the intent to hold the force.
    pub(crate) fn hold_press(&mut self, from_s: f64, until_s: f64) {
        let press = self.style.held_press(from_s, until_s, self.noise);
        self.performance.touches.push(press);
    }

    /// Takes up the pose of a touch; returns the time from which it may be touched.
    fn set_up(&mut self, setting: &Setting, start_s: f64, end_s: f64) -> f64 {
        let touch_s = start_s + self.pose_s;
        match setting {
            Setting::Pose(pose) => self.take_pose(pose, start_s),
            Setting::Transition(pose) => {
                let finger = self.performance.finger_at(start_s);
                self.aim_for(&INDEX_BASE, start_s);
                let from_s = touch_s + self.noise.uniform(0.1, 0.4);
                let until_s = end_s - self.noise.uniform(0.3, 0.7);
                let bent = self.hand.aim(&pose_named(pose).unwrap_or(INDEX_BASE).led_by(finger), self.noise);
                self.track(finger).move_to(from_s, until_s - from_s, bent.finger(finger));
            }
            // The tip must still reach the load cell, so the finger that touches keeps out of its last third.
            Setting::Free => self.move_freely(start_s, end_s, 0.7),
        }
        touch_s
    }

    /// Takes up a pose, by its name.
    pub(crate) fn take_pose(&mut self, name: &str, at_s: f64) {
        if let Some(pose) = pose_named(name) {
            self.aim_for(&pose, at_s);
        }
    }

    fn track(&mut self, finger: Finger) -> &mut Track {
        &mut self.performance.tracks[finger as usize]
    }

    fn aim_for(&mut self, asked: &HandPose, at_s: f64) {
        let aimed = self.hand.aim(&asked.led_by(self.performance.finger_at(at_s)), self.noise);
        let reaction_s = self.noise.uniform(0.1, 0.25);
        for (track, to) in self.performance.tracks.iter_mut().zip(aimed.0) {
            let duration_s = (0.5 * self.hand.tempo() * self.noise.log_normal(0.15)).min(0.7);
            track.move_to(at_s + reaction_s + self.noise.uniform(0.0, 0.05), duration_s, to);
        }
    }

    /// Goes through a movement, by its name.
    pub(crate) fn move_out_and_back(&mut self, movement: &str, all_fingers: bool, start_s: f64, end_s: f64) {
        let Some(end) = movement_named(movement) else { return };
        let out = match all_fingers {
            // A thumb can't follow a finger's angles: it closes as far as its joints allow.
            true => HandPose([end, end, end, end, [0.7 * end[0], 0.5 * end[1], 0.4 * end[2], 0.4]]),
            false => INDEX_BASE.with_index(end),
        };
        let finger = self.performance.finger_at(start_s);
        let out = if all_fingers { out } else { out.led_by(finger) };
        let (out, back) = (self.hand.aim(&out, self.noise), self.hand.aim(&INDEX_BASE.led_by(finger), self.noise));
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

    /// All fingers move independently. The joints of a finger flex partly together, as in natural movement, DIP and PIP
    /// nearly as one, because they share a tendon.
    pub(super) fn move_freely(&mut self, start_s: f64, end_s: f64, reach_of_touching: f64) {
        let touching = self.performance.finger_at(start_s) as usize;
        for f in 0..N_FINGERS {
            let reach = if f == touching { reach_of_touching } else { 1.0 };
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

/// A contact of the fingertip at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Index of the touch in the session.
    pub touch: usize,
    /// Normal force.
    pub force: GramForce,
    /// Tangential force on the hand along x and y of the patch; `None` where nobody asked for it.
    pub tangential: Option<[GramForce; 2]>,
}

/// Hand and contact at one point in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandState {
    /// True joint angles.
    pub pose: HandPose,
    /// The contact, if there is one.
    pub contact: Option<Contact>,
}

/// Executes a performance and adds unintended motion and force.
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

    /// The user who performs trials from now on, with their own force style.
    pub(crate) fn actor<'a>(&'a mut self, style: &'a ForceStyle, noise: &'a mut Noise, pose_s: f64) -> Actor<'a> {
        Actor { hand: &self.hand, style, noise, pose_s, performance: &mut self.performance }
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
        for touch in next.checked_sub(1).into_iter().chain([next]).filter_map(|touch| touches.get(touch)) {
            pose.0[self.performance.finger_at(touch.start_s) as usize][2] -= touch.lift(t_s);
        }
        let intended = touches.get(next).map_or(0.0, |touch| touch.force(t_s).0);
        let force = (intended * (1.0 + slow + fast)).max(0.0);
        if force <= 0.0 {
            return HandState { pose, contact: None };
        }
        let give = force / (force + YIELD_GF);
        let touching = &mut pose.0[self.performance.finger_at(t_s) as usize];
        for (angle, yielded) in touching.iter_mut().zip(YIELD_RAD) {
            *angle -= yielded * give;
        }
        HandState { pose, contact: Some(Contact { touch: next, force: GramForce(force), tangential: None }) }
    }
}
