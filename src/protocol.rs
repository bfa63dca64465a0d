//! The collection protocol: the user's tasks, their order, and their annotations.
//!
//! A protocol is a YAML file. The paper's protocol is built in. `tpf collect` leads a user through a [`Plan`] of it,
//! and the synthetic users of `tpf simulate` follow the same plan.

mod annotations;
mod file;
mod plan;

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::units::GramForce;

pub use annotations::{Annotation, Annotations};
pub use file::{MAX_BYTES, ProtocolError};
pub use plan::{Action, Plan, Setting, Step, Trial};

/// A name used in annotations: a pose, a movement or a substage, in snake_case.
pub type Name = Arc<str>;

/// The content of a session.
#[derive(Debug, Clone, PartialEq)]
pub struct Protocol {
    /// Its name.
    pub name: String,
    /// Time to take up a pose before a touch, s.
    pub pose_s: f64,
    /// Time before the first item, and after a pause, s.
    pub lead_s: f64,
    /// Time to let go of the load cell after a touch, s. It has no annotation. Synthetic users don't need it.
    pub let_go_s: f64,
    /// Force of taps.
    pub levels: ForceLevels,
    /// Checks before the session begins.
    pub checks: Checks,
    /// Presses of the load cell at the start of a donning, if it asks for them.
    pub known_touches: Option<KnownTouches>,
    substages: Vec<Substage>,
    wording: BTreeMap<Name, String>,
    source: Arc<str>,
}

/// Force range of taps, N: from and to.
#[derive(Debug, Clone, PartialEq)]
pub struct ForceLevels {
    /// Light, medium and heavy.
    pub taps: [(f64, f64); 3],
    /// Maximum force, which must never be exceeded.
    pub most: f64,
}

/// Presses of the load cell at the start of a donning, from which the gain of its forces is fitted later.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownTouches {
    /// Number of presses.
    pub presses: u16,
    /// Longest time for a press, s.
    pub seconds: f64,
    /// Time for which the force must be held, s.
    pub hold_s: f64,
    /// Smallest force that counts, N.
    pub at_least: f64,
    /// Text that the person sees.
    pub ask: String,
}

impl KnownTouches {
    /// Forces below this are too small for a gain, because noise and artifact are not small compared with them.
    pub const LIGHTEST: GramForce = GramForce(30.0);

    /// Fewest presses from which a gain is fitted.
    pub const FEWEST: u16 = 3;

    /// Substage in the annotations of these presses. They are outside of the stages of the protocol.
    pub const SUBSTAGE: &str = "known_touches";

    /// The pose in the annotation after the last press, if the force sensor felt none of them.
    pub const UNFELT: &str = "unfelt";

    /// The pose in the annotation of a press.
    pub const PRESS: &str = "press";
}

/// Checks before a session begins.
#[derive(Debug, Clone, PartialEq)]
pub struct Checks {
    /// Time for which nothing may move or touch, s.
    pub still_s: f64,
    /// Largest allowed load cell reading during that time, N.
    pub load_cell_zero: f64,
    /// Minimum message rates, per second: of taxels, joint angles, and the load cell.
    pub rates_hz: [f64; 3],
    /// Longest time without a message, s.
    pub max_gap_s: f64,
    /// A joint counts as moving if its angle spans this, rad.
    pub min_movement: f64,
    /// Movements in the air that identify the joints.
    pub movements: Vec<CheckMovement>,
}

/// A movement that identifies joints.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckMovement {
    /// Instruction to the user.
    pub ask: String,
    /// Name of the movement, for the annotation.
    pub pose: Name,
    /// Duration, s.
    pub seconds: f64,
    /// Parts of joint names, sorted by expected movement, largest first.
    pub most_first: Vec<String>,
}

/// One substage.
#[derive(Debug, Clone, PartialEq)]
pub struct Substage {
    /// 1 to 3.
    pub stage: u8,
    /// In snake_case.
    pub name: Name,
    task: Task,
    repetitions: u16,
    /// Duration of one item, s.
    seconds: f64,
    /// Number of items in the shortest session; seconds, for free movement.
    at_least: f64,
    ask: String,
    touch: String,
}

/// The task of a substage.
#[derive(Debug, Clone, PartialEq)]
enum Task {
    Hold(Vec<Name>),
    Move { movements: Vec<Name>, all_fingers: bool },
    MoveFreely,
    Taps(Settings),
    Press(Settings),
    PressThrough(Vec<Name>),
    PressSequence { movements: Vec<Name>, all_fingers: bool },
}

#[derive(Debug, Clone, PartialEq)]
enum Settings {
    Poses(Vec<Name>),
    Transitions(Vec<Name>),
    Free,
}

impl Protocol {
    /// The paper's protocol.
    ///
    /// # Source
    /// Pose-aware tactile gloves, Sec. IV.
    pub fn paper() -> Self {
        Self::parse(include_str!("../params/protocol.yaml")).expect("the protocol that is built in is tested")
    }

    /// Text of the file that it was read from.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Every substage with its stage, in the order of a session.
    pub fn substages(&self) -> impl Iterator<Item = (u8, &Name)> {
        self.substages.iter().map(|substage| (substage.stage, &substage.name))
    }

    /// The trial of an annotation; `None` if this protocol has no such substage, or no such pose in it.
    pub fn trial(&self, stage: u8, substage: &str, repetition: u16, pose: &str) -> Option<Trial> {
        let found = self.substages.iter().find(|known| known.stage == stage && &*known.name == substage)?;
        let known = |names: &[Name]| names.iter().find(|name| &***name == pose).cloned();
        let setting = |settings: &Settings| match settings {
            Settings::Poses(poses) => known(poses).map(Setting::Pose),
            Settings::Transitions(poses) => known(poses).map(Setting::Transition),
            Settings::Free => Some(Setting::Free),
        };
        let action = match &found.task {
            Task::Hold(poses) => Action::Hold(known(poses)?),
            Task::Move { movements, all_fingers } => {
                Action::Move { movement: known(movements)?, all_fingers: *all_fingers }
            }
            Task::MoveFreely => Action::MoveFreely,
            Task::Taps(of) => Action::Taps(setting(of)?),
            Task::Press(of) => Action::Press(setting(of)?),
            Task::PressThrough(poses) => Action::PressThrough(vec![known(poses)?]),
            Task::PressSequence { movements, all_fingers } => {
                Action::PressSequence { movements: movements.clone(), all_fingers: *all_fingers }
            }
        };
        Some(Trial { stage, substage: found.name.clone(), repetition, duration_s: found.seconds, action })
    }

    /// Instruction for a pose or movement.
    pub fn wording<'a>(&'a self, name: &'a str) -> &'a str {
        self.wording.get(name).map_or(name, String::as_str)
    }

    /// Instruction for a step of a trial.
    pub fn prompt(&self, trial: &Trial, step: &Step) -> String {
        let of_trial = |substage: &&Substage| substage.stage == trial.stage && substage.name == trial.substage;
        let Some(substage) = self.substages.iter().find(of_trial) else { return String::new() };
        let text = if step.zero_load { &substage.ask } else { &substage.touch };
        text.replace("{}", self.wording(&step.pose))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_protocol_has_its_three_stages_and_a_wording_for_everything() {
        let protocol = Protocol::paper();
        let stages: Vec<u8> = protocol.substages().map(|(stage, _)| stage).collect();
        assert_eq!(stages, [[1_u8; 4].as_slice(), &[2; 9], &[3; 5]].concat());
        let plan = Plan::new(&protocol, None, "any");
        for trial in plan.trials() {
            for step in &trial.steps(&protocol) {
                let prompt = protocol.prompt(trial, step);
                assert!(!prompt.is_empty() && !prompt.contains("{}"), "{trial:?}: {prompt:?}");
            }
        }
    }

    #[test]
    fn nothing_is_told_to_be_touched_while_it_is_annotated_as_zero_load() {
        let protocol = Protocol::paper();
        for trial in Plan::new(&protocol, None, "any").trials() {
            for step in trial.steps(&protocol).iter().filter(|step| step.zero_load) {
                let prompt = protocol.prompt(trial, step);
                assert!(prompt.starts_with("In the air") || prompt.starts_with("Over the load cell"), "{prompt}");
            }
        }
    }
}
