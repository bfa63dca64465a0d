//! A live synthetic user with a synthetic glove who follows the prompts of a collection.

use super::super::glove::GloveDesign;
use super::super::manipulation::MAX_MANIPULATION_MINUTES;
use super::super::performance::Performance;
use super::super::touch::ForceStyle;
use super::{Activity, Record, SessionSpec, SimError, SimulatedSession, User, design};
use crate::protocol::{Action, KnownTouches, Plan, Protocol, Trial};
use crate::random::Noise;
use crate::units::{Newton, Stamp};

/// A fault in the laboratory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// A taxel with a broken line: its reading never changes.
    DeadTaxel(usize),
    /// A driver that swaps the names of DIP and PIP of the index finger.
    SwappedJoints,
    /// A load cell that was not tared.
    UntaredLoadCell,
}

/// Reading of a load cell that was not tared: the weight of the parts mounted on it.
const UNTARED: Newton = Newton(1.5);

/// Reading of a broken line: the level at which the converter's input floats.
const DEAD_COUNTS: f32 = 512.0;

/// Time for a user to begin a press that is held, s.
const PRESS_DELAY_S: f64 = 0.5;

/// Number of times a user repeats a movement for the checks, and the duration of each, s.
const CHECK_MOVEMENTS: u8 = 2;
const CHECK_MOVEMENT_S: f64 = 1.8;

/// Longest press while poses change, s; no user holds one for longer.
const LONGEST_PRESS_S: f64 = 60.0;

/// The user's task from now on: an annotation, as it is published.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Prompt {
    /// Stage of the protocol, 1 to 3; 0 outside of it.
    pub stage: u8,
    /// Substage, empty outside of one.
    pub substage: String,
    /// Pose or movement, empty when free.
    pub pose: String,
    /// Repetition within the substage.
    pub repetition: u16,
}

/// A session that continues as long as it is polled.
#[derive(Debug)]
pub struct LiveSession {
    session: SimulatedSession,
    style: ForceStyle,
    noise: Noise,
    protocol: Protocol,
    /// True if the user follows prompts.
    follows: bool,
    doing: Option<Prompt>,
    faults: Vec<Fault>,
}

impl LiveSession {
    /// Begins at `start`. A user who doesn't follow prompts goes through the protocol at their own pace; free
    /// manipulation has no prompts.
    ///
    /// # Errors
    /// [`SimError`] when there is no such glove.
    pub fn new(
        spec: &SessionSpec,
        protocol: Protocol,
        start: Stamp,
        follows: bool,
        faults: &[Fault],
    ) -> Result<Self, SimError> {
        let design = design(spec)?;
        super::check::check(spec)?;
        let user = User::new(spec);
        let mut noise = user.of_session("performance");
        let plan = Plan::new(&protocol, Some(spec.minutes), &format!("{}, plan", spec.session_name()));
        let finger = spec.conditions.touching.unwrap_or_default();
        let follows = follows && spec.activity == Activity::Protocol;
        let performance = match spec.activity {
            _ if follows => Performance::idle(&user.hand, finger, &mut noise),
            Activity::Protocol => Performance::new(&protocol, &plan, &user.hand, &user.style, finger, &mut noise),
            Activity::Manipulation => {
                let total_s = 60.0 * spec.minutes.min(MAX_MANIPULATION_MINUTES); // who is asked for more rests then
                Performance::manipulation(&user.hand, &user.style, total_s, user.repertoire(), &mut noise)
            }
        };
        let style = user.style.clone();
        let mut session = SimulatedSession::begin(user, design, plan, performance, start);
        session.end_s = f64::INFINITY;
        session.next_annotation = None;
        session.annotations = Vec::new().into_iter();
        let untared = faults.contains(&Fault::UntaredLoadCell);
        session.load_cell.set_zero(if untared { UNTARED.0 } else { 0.0 });
        Ok(LiveSession { session, style, noise, protocol, follows, doing: None, faults: faults.to_vec() })
    }

    /// The glove.
    pub fn design(&self) -> Option<&'static GloveDesign> {
        GloveDesign::numbered(self.session.spec.glove)
    }

    /// The user reads a prompt, `t_s` into the session.
    pub fn handle_prompt(&mut self, prompt: &Prompt, t_s: f64) {
        // Another step of the same trial: the touch that the user expected.
        if !self.follows || self.doing.as_ref() == Some(prompt) {
            return;
        }
        let before = self.doing.replace(prompt.clone());
        let same_trial = |before: &Prompt| {
            Prompt { pose: String::new(), ..before.clone() } == Prompt { pose: String::new(), ..prompt.clone() }
        };
        let trial = self.protocol.trial(prompt.stage, &prompt.substage, prompt.repetition, &prompt.pose);
        let mut actor = self.session.performer.actor(&self.style, &mut self.noise, self.protocol.pose_s);
        match trial {
            Some(Trial { action: Action::PressThrough(poses), .. }) => {
                if !before.as_ref().is_some_and(same_trial) {
                    actor.performance.stop(t_s);
                    actor.hold_press(t_s + PRESS_DELAY_S, t_s + LONGEST_PRESS_S);
                }
                poses.iter().for_each(|pose| actor.take_pose(pose, t_s));
            }
            Some(trial) => {
                actor.performance.stop(t_s);
                actor.perform(&trial, t_s);
            }
            None if prompt.substage == KnownTouches::SUBSTAGE && prompt.pose == KnownTouches::PRESS => {
                actor.performance.stop(t_s);
                actor.hold_press(t_s + PRESS_DELAY_S, t_s + LONGEST_PRESS_S);
            }
            None => {
                actor.performance.stop(t_s);
                for k in 0..CHECK_MOVEMENTS {
                    let from_s = t_s + 0.2 + f64::from(k) * CHECK_MOVEMENT_S;
                    actor.move_out_and_back(&prompt.pose, false, from_s, from_s + CHECK_MOVEMENT_S);
                }
            }
        }
    }

    /// Records that have arrived by `t_s` into the session, one after the other.
    pub fn poll(&mut self, t_s: f64) -> Option<Record> {
        while self.session.channels.iter().any(|channel| channel.next_s() <= t_s) {
            self.session.advance();
        }
        let now = self.session.stamp(t_s);
        let first = self.session.on_the_way.first_entry().filter(|first| first.key().0 <= now)?;
        let mut record = first.remove();
        self.faults.iter().for_each(|fault| fault.apply(&mut record));
        Some(record)
    }
}

impl Fault {
    fn apply(self, record: &mut Record) {
        match (self, record) {
            (Fault::DeadTaxel(taxel_idx), Record::Taxels { values, .. }) => {
                if let Some(value) = values.get_mut(taxel_idx) {
                    *value = DEAD_COUNTS;
                }
            }
            (Fault::SwappedJoints, Record::Joints { names, .. }) => {
                let swapped = |name: &String| match name.as_str() {
                    "index_dip" => "index_pip".to_owned(),
                    "index_pip" => "index_dip".to_owned(),
                    other => other.to_owned(),
                };
                *names = names.iter().map(swapped).collect();
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::{GramForce, NANOS_PER_SEC};

    use super::super::Tracking;

    fn spec() -> SessionSpec {
        SessionSpec {
            glove: 3,
            user: 1,
            session: 1,
            seed: 5,
            minutes: crate::sim::FULL_MINUTES,
            activity: Activity::Protocol,
            tracking: Tracking::Markers,
            conditions: super::super::Conditions::default(),
        }
    }

    fn prompt(stage: u8, substage: &str, pose: &str) -> Prompt {
        Prompt { stage, substage: substage.to_owned(), pose: pose.to_owned(), repetition: 0 }
    }

    /// Normal force at each sample of the load cell until `t_s`, s and gF.
    fn forces(live: &mut LiveSession, t_s: f64) -> Vec<(f64, f64)> {
        let mut forces = Vec::new();
        while let Some(record) = live.poll(t_s) {
            if let Record::Truth { stamp, force, .. } = record {
                forces.push((stamp.0 as f64 / NANOS_PER_SEC as f64, GramForce::from(Newton(force[2])).0));
            }
        }
        forces
    }

    #[test]
    fn a_user_does_what_prompts_say_and_lets_go_when_told() {
        let mut live = LiveSession::new(&spec(), Protocol::paper(), Stamp(0), true, &[]).unwrap();
        assert!(forces(&mut live, 2.0).iter().all(|(_, force)| force.abs() < 15.0));
        let press = prompt(2, "terminal_pose_presses", "flat");
        live.handle_prompt(&press, 2.0);
        live.handle_prompt(&press, 3.0); // the step in which it is touched
        let pressed = forces(&mut live, 5.0);
        assert!(pressed.iter().filter(|(t_s, _)| *t_s < 3.0).all(|(_, force)| force.abs() < 15.0));
        assert!(pressed.iter().filter(|(t_s, _)| *t_s > 4.0).all(|(_, force)| *force > 20.0));
        live.handle_prompt(&prompt(0, "", ""), 5.0);
        assert!(forces(&mut live, 9.0).iter().filter(|(t_s, _)| *t_s > 5.3).all(|(_, force)| force.abs() < 15.0));
    }

    #[test]
    fn one_press_is_held_through_all_poses() {
        let mut live = LiveSession::new(&spec(), Protocol::paper(), Stamp(0), true, &[]).unwrap();
        for (at_s, pose) in [(0.0, "flat"), (2.0, "claw"), (4.0, "cup")] {
            live.handle_prompt(&prompt(3, "terminal_pose_transitions", pose), at_s);
            let forces = forces(&mut live, at_s + 2.0);
            assert!(forces.iter().filter(|(t_s, _)| *t_s > 1.5).all(|(_, force)| *force > 15.0), "{pose}");
        }
    }

    #[test]
    fn a_known_touch_is_held_until_it_is_let_go() {
        let mut live = LiveSession::new(&spec(), Protocol::paper(), Stamp(0), true, &[]).unwrap();
        live.handle_prompt(&prompt(0, KnownTouches::SUBSTAGE, KnownTouches::PRESS), 1.0);
        assert!(forces(&mut live, 5.0).iter().filter(|(t_s, _)| *t_s > 3.0).all(|(_, force)| *force > 30.0));
        live.handle_prompt(&prompt(0, "", ""), 5.0);
        assert!(forces(&mut live, 9.0).iter().filter(|(t_s, _)| *t_s > 5.5).all(|(_, force)| force.abs() < 15.0));
    }

    #[test]
    fn a_load_cell_that_nobody_tared_says_so() {
        let mut live = LiveSession::new(&spec(), Protocol::paper(), Stamp(0), true, &[Fault::UntaredLoadCell]).unwrap();
        assert!(forces(&mut live, 1.0).iter().all(|(_, force)| *force > 100.0));
    }
}
