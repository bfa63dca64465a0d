//! A session of a protocol: the order of its trials and their durations.

use std::collections::BTreeSet;

use super::{Name, Protocol, Settings, Substage, Task};
use crate::random::Noise;

/// Pose or movement during a touch.
#[derive(Debug, Clone, PartialEq)]
pub enum Setting {
    /// At a pose.
    Pose(Name),
    /// While the index finger moves from straight to a pose.
    Transition(Name),
    /// While the fingers move freely.
    Free,
}

/// The user's task in a trial.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Take up a pose in the air and hold it.
    Hold(Name),
    /// A movement in the air.
    Move {
        /// The movement.
        movement: Name,
        /// True if the other fingers do the same.
        all_fingers: bool,
    },
    /// Move all fingers freely in the air.
    MoveFreely,
    /// A light, a medium and a heavy tap.
    Taps(Setting),
    /// A press with varying force.
    Press(Setting),
    /// Go through poses during one press, the same time each.
    PressThrough(Vec<Name>),
    /// Press, go through movements, unpress.
    PressSequence {
        /// The movements, one after the other.
        movements: Vec<Name>,
        /// True if the other fingers do the same.
        all_fingers: bool,
    },
}

/// One trial of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// 1 to 3.
    pub stage: u8,
    /// In snake_case.
    pub substage: Name,
    /// Repetition within the substage, from 0.
    pub repetition: u16,
    /// Duration, s.
    pub duration_s: f64,
    /// The task.
    pub action: Action,
}

/// A part of a trial with its own annotation.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Start, s into the trial.
    pub at_s: f64,
    /// Instructed pose or movement; empty when free.
    pub pose: Name,
    /// True if nothing touches the fingertip. False also while a touch is only expected.
    pub zero_load: bool,
}

impl Trial {
    /// The annotations and their times.
    pub fn steps(&self, protocol: &Protocol) -> Vec<Step> {
        let alone = |pose: &Name, zero_load: bool| vec![Step { at_s: 0.0, pose: pose.clone(), zero_load }];
        match &self.action {
            Action::Hold(pose) => alone(pose, true),
            Action::Move { movement, .. } => alone(movement, true),
            Action::MoveFreely => alone(&"".into(), true),
            Action::Taps(setting) | Action::Press(setting) => {
                let pose: Name = match setting {
                    Setting::Pose(pose) | Setting::Transition(pose) => pose.clone(),
                    Setting::Free => "".into(),
                };
                let step = |at_s: f64, zero_load: bool| Step { at_s, pose: pose.clone(), zero_load };
                vec![step(0.0, true), step(protocol.pose_s, false)]
            }
            Action::PressThrough(poses) => {
                let each_s = self.duration_s / poses.len() as f64;
                let step =
                    |(k, pose): (usize, &Name)| Step { at_s: k as f64 * each_s, pose: pose.clone(), zero_load: false };
                poses.iter().enumerate().map(step).collect()
            }
            Action::PressSequence { movements, .. } => alone(&movements.join("_").into(), false),
        }
    }
}

/// The trials of a session in order. The default has no protocol and no trials.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plan {
    trials: Vec<Trial>,
}

impl Plan {
    /// Plans a session of about this many minutes, or of the whole protocol.
    ///
    /// A shorter session has fewer repetitions of each substage, and below one repetition it has not every pose. It
    /// keeps every substage, every movement and the order of the substages, so it is never shorter than
    /// [`shortest_s`](Self::shortest_s). `order` names the random stream that orders the poses: the same name gives the
    /// same plan.
    pub fn new(protocol: &Protocol, minutes: Option<f64>, order: &str) -> Plan {
        let of_share = |share: f64| Plan::of_share(protocol, share, &mut Noise::named(order));
        let Some(minutes) = minutes else { return of_share(1.0) };
        let (mut low, mut high) = (0.0, 1.0);
        if of_share(high).duration_s() > 60.0 * minutes + 1e-6 {
            for _ in 0..24 {
                let middle = 0.5 * (low + high);
                if of_share(middle).duration_s() > 60.0 * minutes { high = middle } else { low = middle }
            }
            high = low;
        }
        of_share(high)
    }

    /// Duration of the shortest session of a protocol, s.
    pub fn shortest_s(protocol: &Protocol) -> f64 {
        Plan::of_share(protocol, 0.0, &mut Noise::named("")).duration_s()
    }

    /// The trials in order.
    pub fn trials(&self) -> &[Trial] {
        &self.trials
    }

    /// Duration of the session, s.
    pub fn duration_s(&self) -> f64 {
        self.trials.iter().map(|trial| trial.duration_s).sum()
    }

    /// Single taps in the session.
    pub fn n_taps(&self) -> usize {
        3 * self.trials.iter().filter(|trial| matches!(trial.action, Action::Taps(_))).count()
    }

    /// Presses in the session, with those of stage 3.
    pub fn n_presses(&self) -> usize {
        let is_press = |trial: &&Trial| {
            matches!(trial.action, Action::Press(_) | Action::PressThrough(_) | Action::PressSequence { .. })
        };
        self.trials.iter().filter(is_press).count()
    }

    /// The stages of the session, in order.
    pub fn stages(&self) -> BTreeSet<u8> {
        self.trials.iter().map(|trial| trial.stage).collect()
    }

    fn of_share(protocol: &Protocol, share: f64, noise: &mut Noise) -> Plan {
        let mut plan = Builder { share, noise, trials: Vec::new() };
        protocol.substages.iter().for_each(|substage| plan.add(substage));
        Plan { trials: plan.trials }
    }
}

struct Builder<'a> {
    share: f64,
    noise: &'a mut Noise,
    trials: Vec<Trial>,
}

impl Builder<'_> {
    fn add(&mut self, substage: &Substage) {
        let settings = |settings: &Settings| match settings {
            Settings::Poses(poses) => poses.iter().cloned().map(Setting::Pose).collect(),
            Settings::Transitions(poses) => poses.iter().cloned().map(Setting::Transition).collect(),
            Settings::Free => vec![Setting::Free],
        };
        match &substage.task {
            Task::Hold(poses) => self.add_each(substage, poses.iter().cloned().map(Action::Hold).collect()),
            Task::Move { movements, all_fingers } => {
                let action = |movement: &Name| Action::Move { movement: movement.clone(), all_fingers: *all_fingers };
                self.add_each(substage, movements.iter().map(action).collect());
            }
            Task::Taps(of) => self.add_each(substage, settings(of).into_iter().map(Action::Taps).collect()),
            Task::Press(of) => self.add_each(substage, settings(of).into_iter().map(Action::Press).collect()),
            Task::PressSequence { movements, all_fingers } => {
                let (movements, all_fingers) = (movements.clone(), *all_fingers);
                self.add_each(substage, vec![Action::PressSequence { movements, all_fingers }]);
            }
            Task::PressThrough(poses) => self.add_transitions(substage, poses),
            Task::MoveFreely => {
                let duration_s = (substage.seconds * self.share).max(substage.at_least.min(substage.seconds));
                for repetition in 0..substage.repetitions {
                    self.push(substage, repetition, duration_s, Action::MoveFreely);
                }
            }
        }
    }

    /// Adds a share of all repetitions of `actions`, in a new random order for each repetition.
    fn add_each(&mut self, substage: &Substage, mut actions: Vec<Action>) {
        let mut left = self.share_of(substage, actions.len());
        for repetition in 0..substage.repetitions {
            self.noise.shuffle(&mut actions);
            for action in actions.iter().take(left) {
                self.push(substage, repetition, substage.seconds, action.clone());
            }
            left = left.saturating_sub(actions.len());
        }
    }

    /// Adds one press per repetition, through all poses, in a different order each time.
    fn add_transitions(&mut self, substage: &Substage, poses: &[Name]) {
        let mut left = self.share_of(substage, poses.len());
        for repetition in 0..substage.repetitions {
            let mut order = poses.to_vec();
            self.noise.shuffle(&mut order);
            order.truncate(left);
            left -= order.len();
            if !order.is_empty() {
                let duration_s = substage.seconds * order.len() as f64;
                self.push(substage, repetition, duration_s, Action::PressThrough(order));
            }
        }
    }

    fn push(&mut self, substage: &Substage, repetition: u16, duration_s: f64, action: Action) {
        let (stage, substage) = (substage.stage, substage.name.clone());
        self.trials.push(Trial { stage, substage, repetition, duration_s, action });
    }

    /// Number of items of a substage in this session. `n_actions` items make a repetition.
    fn share_of(&self, substage: &Substage, n_actions: usize) -> usize {
        let full = usize::from(substage.repetitions) * n_actions;
        ((full as f64 * self.share).round() as usize).clamp((substage.at_least as usize).min(full), full)
    }
}
