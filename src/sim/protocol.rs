//! The paper's collection protocol as a plan: which trial follows which, for how long, without the person who does it.

use super::hand::{INDEX_POSES, MOVEMENTS, TERMINAL_POSES};
use crate::random::Noise;

/// Time to take up a pose before a touch, s. The user interface asks for the touch after it, so nothing touches yet.
pub const POSE_S: f64 = 1.0;
/// A 3-tap sequence with its [`POSE_S`], s. The paper gives no time; with this one its session lasts 27.7 minutes.
pub const TAPS_S: f64 = 4.0;
/// A 5 s press with its [`POSE_S`], s.
pub const PRESS_S: f64 = 6.0;
/// Holding a terminal pose, a movement out and back, a transition under load, s.
pub const STEP_S: f64 = 2.0;
/// Press, bend, unbend, fold, unfold, unpress, s.
pub const SEQUENCE_S: f64 = 6.0;
/// In-air free movement after each stage, s. The paper gives no time; see [`TAPS_S`].
pub const IN_AIR_S: f64 = 24.0;

const MIN_IN_AIR_S: f64 = 4.0;

/// Where a touch happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Setting {
    /// At a pose of [`TERMINAL_POSES`].
    Terminal(usize),
    /// At a pose of [`INDEX_POSES`].
    Index(usize),
    /// While the index finger moves from straight to a pose of [`INDEX_POSES`].
    Transition(usize),
    /// While the fingers move freely.
    Free,
}

/// What a user is asked to do in a trial.
#[derive(Debug, Clone, PartialEq)]
pub enum Action {
    /// Take a pose of [`TERMINAL_POSES`] in the air and hold it.
    Hold(usize),
    /// One of [`MOVEMENTS`] in the air.
    Move {
        /// Index into [`MOVEMENTS`].
        movement: usize,
        /// Whether the other fingers do the same.
        all_fingers: bool,
    },
    /// Move all fingers freely in the air.
    MoveFreely,
    /// A light, a medium and a heavy tap.
    Taps(Setting),
    /// A press with varying force.
    Press(Setting),
    /// Go through poses of [`TERMINAL_POSES`] during one press, [`STEP_S`] each.
    PressThrough(Vec<usize>),
    /// Press, bend, unbend, fold, unfold, unpress.
    PressSequence {
        /// Whether the other fingers do the same.
        all_fingers: bool,
    },
}

/// One trial of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// 1 to 3.
    pub stage: u8,
    /// In snake_case, one of [`SUBSTAGES`].
    pub substage: &'static str,
    /// Repetition within the substage, from 0.
    pub repetition: u16,
    /// How long it takes, s.
    pub duration_s: f64,
    /// What is to be done.
    pub action: Action,
}

/// Name of the in-air free movement at the end of every stage.
pub const IN_AIR: &str = "in_air_free_movement";

/// Every substage with its stage, in the order of a session. Those of pseudo-unseen poses have `free_movement` in them.
///
/// # Source
/// Pose-aware tactile gloves, Sec. IV.
pub const SUBSTAGES: [(u8, &str); 18] = [
    (1, "terminal_poses"),
    (1, "index_movements"),
    (1, "all_finger_movements"),
    (1, IN_AIR),
    (2, "terminal_pose_taps"),
    (2, "terminal_pose_presses"),
    (2, "index_pose_taps"),
    (2, "index_pose_presses"),
    (2, "index_movement_taps"),
    (2, "index_movement_presses"),
    (2, "free_movement_taps"),
    (2, "free_movement_presses"),
    (2, IN_AIR),
    (3, "terminal_pose_transitions"),
    (3, "index_movement_sequence"),
    (3, "all_finger_movement_sequence"),
    (3, "free_movement_during_press"),
    (3, IN_AIR),
];

/// The trials of a session in their order.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    trials: Vec<Trial>,
}

/// The shortest session that has every substage and every kind of trial, minutes.
pub const MIN_MINUTES: f64 = 1.7;
/// The whole protocol, minutes.
pub const FULL_MINUTES: f64 = 27.7;

impl Plan {
    /// A session of about `minutes`, at least [`MIN_MINUTES`] and at most [`FULL_MINUTES`].
    ///
    /// A shorter session has fewer repetitions of each substage, and below one repetition not every pose; each
    /// substage, each of the movements, and the order of substages stay. `order` names the stream that orders poses.
    pub(crate) fn new(minutes: f64, order: &str) -> Plan {
        let of_share = |share: f64| Plan::of_share(share, &mut Noise::named(order));
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

    /// The trials in their order.
    pub fn trials(&self) -> &[Trial] {
        &self.trials
    }

    /// How long the session takes, s.
    pub fn duration_s(&self) -> f64 {
        self.trials.iter().map(|trial| trial.duration_s).sum()
    }

    /// Single taps in the session.
    pub fn n_taps(&self) -> usize {
        3 * self.trials.iter().filter(|trial| matches!(trial.action, Action::Taps(_))).count()
    }

    /// Presses in the session, those of stage 3 included.
    pub fn n_presses(&self) -> usize {
        let is_press = |trial: &&Trial| {
            matches!(trial.action, Action::Press(_) | Action::PressThrough(_) | Action::PressSequence { .. })
        };
        self.trials.iter().filter(is_press).count()
    }

    fn of_share(share: f64, noise: &mut Noise) -> Plan {
        let mut plan = Builder { share, noise, trials: Vec::new() };
        let tappable: Vec<usize> = (0..TERMINAL_POSES.len()).filter(|&pose| TERMINAL_POSES[pose].index_free).collect();
        for (stage, substage) in SUBSTAGES {
            let at = (stage, substage);
            match substage {
                "terminal_poses" => plan.add(at, 5, 2, STEP_S, (0..TERMINAL_POSES.len()).map(Action::Hold)),
                "index_movements" | "all_finger_movements" => {
                    let all_fingers = substage == "all_finger_movements";
                    let moves = (0..MOVEMENTS.len()).map(|movement| Action::Move { movement, all_fingers });
                    plan.add(at, 10, MOVEMENTS.len(), STEP_S, moves);
                }
                "terminal_pose_taps" => plan.add_taps(at, 5, tappable.iter().map(|&pose| Setting::Terminal(pose))),
                "terminal_pose_presses" => {
                    plan.add_presses(at, 5, tappable.iter().map(|&pose| Setting::Terminal(pose)));
                }
                "index_pose_taps" => plan.add_taps(at, 5, (0..INDEX_POSES.len()).map(Setting::Index)),
                "index_pose_presses" => plan.add_presses(at, 5, (0..INDEX_POSES.len()).map(Setting::Index)),
                "index_movement_taps" => plan.add_taps(at, 5, (1..INDEX_POSES.len()).map(Setting::Transition)),
                "index_movement_presses" => plan.add_presses(at, 5, (1..INDEX_POSES.len()).map(Setting::Transition)),
                "free_movement_taps" => plan.add_taps(at, 10, [Setting::Free].into_iter()),
                "free_movement_presses" | "free_movement_during_press" => {
                    plan.add_presses(at, 10, [Setting::Free].into_iter());
                }
                "terminal_pose_transitions" => plan.add_transitions(at, 5, &tappable),
                "index_movement_sequence" | "all_finger_movement_sequence" => {
                    let all_fingers = substage == "all_finger_movement_sequence";
                    plan.add(at, 10, 1, SEQUENCE_S, [Action::PressSequence { all_fingers }].into_iter());
                }
                _ => plan.add_in_air(at),
            }
        }
        Plan { trials: plan.trials }
    }
}

struct Builder<'a> {
    share: f64,
    noise: &'a mut Noise,
    trials: Vec<Trial>,
}

type Place = (u8, &'static str);

impl Builder<'_> {
    /// Adds the share of `repetitions` of all `actions`, in another random order each repetition.
    fn add(
        &mut self,
        (stage, substage): Place,
        repetitions: usize,
        at_least: usize,
        duration_s: f64,
        actions: impl Iterator<Item = Action>,
    ) {
        let mut actions: Vec<Action> = actions.collect();
        let mut left = self.share_of(repetitions * actions.len(), at_least);
        for repetition in 0..repetitions as u16 {
            self.noise.shuffle(&mut actions);
            for action in actions.iter().take(left) {
                self.trials.push(Trial { stage, substage, repetition, duration_s, action: action.clone() });
            }
            left = left.saturating_sub(actions.len());
        }
    }

    fn add_taps(&mut self, at: Place, repetitions: usize, settings: impl Iterator<Item = Setting>) {
        self.add(at, repetitions, 1, TAPS_S, settings.map(Action::Taps));
    }

    fn add_presses(&mut self, at: Place, repetitions: usize, settings: impl Iterator<Item = Setting>) {
        self.add(at, repetitions, 1, PRESS_S, settings.map(Action::Press));
    }

    /// One press a repetition, through all poses in another order each.
    fn add_transitions(&mut self, (stage, substage): Place, repetitions: usize, poses: &[usize]) {
        let mut left = self.share_of(repetitions * poses.len(), 2);
        for repetition in 0..repetitions as u16 {
            let mut order = poses.to_vec();
            self.noise.shuffle(&mut order);
            order.truncate(left);
            left -= order.len();
            if !order.is_empty() {
                let duration_s = STEP_S * order.len() as f64;
                let action = Action::PressThrough(order);
                self.trials.push(Trial { stage, substage, repetition, duration_s, action });
            }
        }
    }

    fn add_in_air(&mut self, (stage, substage): Place) {
        let duration_s = (IN_AIR_S * self.share).max(MIN_IN_AIR_S);
        self.trials.push(Trial { stage, substage, repetition: 0, duration_s, action: Action::MoveFreely });
    }

    fn share_of(&self, full: usize, at_least: usize) -> usize {
        ((full as f64 * self.share).round() as usize).clamp(at_least, full)
    }
}
