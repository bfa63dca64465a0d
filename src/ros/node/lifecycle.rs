//! The lifecycle of a managed node as `lifecycle_msgs` defines it: states and transitions. Pure.
//!
//! # Source
//! The numbers and names are those of `lifecycle_msgs/msg/State` and `Transition`, the table that of rcl_lifecycle.

/// Lifecycle state of a node. The numbers are those of `lifecycle_msgs/msg/State`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum State {
    /// It has no model.
    Unconfigured = 1,
    /// Models are loaded; nothing is published.
    Inactive = 2,
    /// It publishes.
    Active = 3,
    /// It has ended.
    Finalized = 4,
    /// Between unconfigured and inactive.
    Configuring = 10,
    /// Between inactive and unconfigured.
    CleaningUp = 11,
    /// On the way to finalized.
    ShuttingDown = 12,
    /// Between inactive and active.
    Activating = 13,
    /// Between active and inactive.
    Deactivating = 14,
    /// Handling an error.
    ErrorProcessing = 15,
}

impl State {
    /// All states, in the order of their numbers.
    pub const ALL: [State; 10] = [
        State::Unconfigured,
        State::Inactive,
        State::Active,
        State::Finalized,
        State::Configuring,
        State::CleaningUp,
        State::ShuttingDown,
        State::Activating,
        State::Deactivating,
        State::ErrorProcessing,
    ];

    /// Its number in `lifecycle_msgs`.
    pub fn id(self) -> u8 {
        self as u8
    }

    /// Its name in rcl_lifecycle.
    pub fn label(self) -> &'static str {
        match self {
            State::Unconfigured => "unconfigured",
            State::Inactive => "inactive",
            State::Active => "active",
            State::Finalized => "finalized",
            State::Configuring => "configuring",
            State::CleaningUp => "cleaningup",
            State::ShuttingDown => "shuttingdown",
            State::Activating => "activating",
            State::Deactivating => "deactivating",
            State::ErrorProcessing => "errorprocessing",
        }
    }
}

/// A transition from one state to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transition {
    /// Its number in `lifecycle_msgs`.
    pub id: u8,
    /// Its name in rcl_lifecycle.
    pub label: &'static str,
    /// Start state.
    pub start: State,
    /// End state.
    pub goal: State,
}

const fn step(id: u8, label: &'static str, start: State, goal: State) -> Transition {
    Transition { id, label, start, goal }
}

/// All transitions.
pub const TRANSITIONS: [Transition; 25] = {
    use State::*;
    [
        step(1, "configure", Unconfigured, Configuring),
        step(10, "transition_success", Configuring, Inactive),
        step(11, "transition_failure", Configuring, Unconfigured),
        step(12, "transition_error", Configuring, ErrorProcessing),
        step(2, "cleanup", Inactive, CleaningUp),
        step(20, "transition_success", CleaningUp, Unconfigured),
        step(21, "transition_failure", CleaningUp, Inactive),
        step(22, "transition_error", CleaningUp, ErrorProcessing),
        step(3, "activate", Inactive, Activating),
        step(30, "transition_success", Activating, Active),
        step(31, "transition_failure", Activating, Inactive),
        step(32, "transition_error", Activating, ErrorProcessing),
        step(4, "deactivate", Active, Deactivating),
        step(40, "transition_success", Deactivating, Inactive),
        step(41, "transition_failure", Deactivating, Active),
        step(42, "transition_error", Deactivating, ErrorProcessing),
        step(5, "shutdown", Unconfigured, ShuttingDown),
        step(6, "shutdown", Inactive, ShuttingDown),
        step(7, "shutdown", Active, ShuttingDown),
        step(50, "transition_success", ShuttingDown, Finalized),
        step(51, "transition_failure", ShuttingDown, Finalized),
        step(52, "transition_error", ShuttingDown, ErrorProcessing),
        step(60, "transition_success", ErrorProcessing, Unconfigured),
        step(61, "transition_failure", ErrorProcessing, Finalized),
        step(62, "transition_error", ErrorProcessing, Finalized),
    ]
};

/// The work of a transition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// Load models and calibration.
    Configure,
    /// Drop them.
    CleanUp,
    /// Begin to publish.
    Activate,
    /// Stop publishing.
    Deactivate,
    /// End.
    ShutDown,
}

/// Maximum number of characters shown of an unknown label.
const MAX_SHOWN: usize = 60;

/// The lifecycle of one node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lifecycle {
    state: State,
}

/// A requested transition that does not start from the current state.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{asked} is not possible in state {}: {}", state.label(), self.instead())]
pub struct NotPossible {
    asked: String,
    state: State,
    possible: Vec<&'static str>,
}

impl NotPossible {
    /// The possible transitions, or what to do.
    fn instead(&self) -> String {
        match (self.possible.as_slice(), self.state) {
            ([], State::Finalized) => "its life is over; end the node and start it anew".to_owned(),
            ([], _) => "a transition is under way; wait until it is over".to_owned(),
            (possible, _) => format!("expected {}", possible.join(", ")),
        }
    }
}

impl Default for Lifecycle {
    fn default() -> Self {
        Lifecycle { state: State::Unconfigured }
    }
}

impl Lifecycle {
    /// Starts a transition, by its label if given and else by its number. Returns the work to do and the transition.
    ///
    /// # Errors
    /// [`NotPossible`] naming the possible transitions; the state has not changed.
    pub fn handle_request(&mut self, id: u8, label: &str) -> Result<(Work, Transition), NotPossible> {
        let asked = |step: &&Transition| if label.is_empty() { step.id == id } else { step.label == label };
        let found = self.available().find(asked).copied().and_then(|step| Some((work(step.id)?, step)));
        let Some((work, step)) = found else {
            let asked = match label.char_indices().nth(MAX_SHOWN) {
                _ if label.is_empty() => format!("transition {id}"),
                None => format!("transition {label:?}"),
                Some((end, _)) => format!("transition {:?}...", &label[..end]),
            };
            // A caller can't decide how a transition in progress ends.
            let possible = self.available().filter(|step| work(step.id).is_some()).map(|step| step.label).collect();
            return Err(NotPossible { asked, state: self.state, possible });
        };
        self.state = step.goal;
        Ok((work, step))
    }

    /// Ends the transition in progress and returns the transition. `None` if none is in progress.
    pub fn handle_outcome(&mut self, succeeded: bool) -> Option<Transition> {
        let label = if succeeded { "transition_success" } else { "transition_failure" };
        let step = *self.available().find(|step| step.label == label)?;
        self.state = step.goal;
        Some(step)
    }

    /// The current state.
    pub fn state(&self) -> State {
        self.state
    }

    /// The transitions that start from the current state.
    pub fn available(&self) -> impl Iterator<Item = &'static Transition> {
        let state = self.state;
        TRANSITIONS.iter().filter(move |step| step.start == state)
    }
}

fn work(id: u8) -> Option<Work> {
    Some(match id {
        1 => Work::Configure,
        2 => Work::CleanUp,
        3 => Work::Activate,
        4 => Work::Deactivate,
        5..=7 => Work::ShutDown,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manager_can_bring_the_node_up_and_down() {
        let mut life = Lifecycle::default();
        for (id, label, work, between, after) in [
            (1, "", Work::Configure, State::Configuring, State::Inactive),
            (0, "activate", Work::Activate, State::Activating, State::Active),
            (4, "", Work::Deactivate, State::Deactivating, State::Inactive),
            (2, "", Work::CleanUp, State::CleaningUp, State::Unconfigured),
            (0, "shutdown", Work::ShutDown, State::ShuttingDown, State::Finalized),
        ] {
            let (todo, step) = life.handle_request(id, label).unwrap();
            assert_eq!((todo, step.goal, life.state()), (work, between, between));
            life.handle_outcome(true).unwrap();
            assert_eq!(life.state(), after);
        }
        assert_eq!(life.available().count(), 0);
    }

    #[test]
    fn a_failed_transition_leads_back() {
        let mut life = Lifecycle::default();
        life.handle_request(1, "").unwrap();
        assert_eq!(life.handle_outcome(false).unwrap().id, 11);
        assert_eq!(life.state(), State::Unconfigured);
    }

    #[test]
    fn what_is_not_possible_is_refused_and_changes_nothing() {
        let mut life = Lifecycle::default();
        let error = life.handle_request(3, "").unwrap_err().to_string();
        assert_eq!(error, "transition 3 is not possible in state unconfigured: expected configure, shutdown");
        assert!(life.handle_request(10, "").is_err(), "a callback's outcome is not for others to give");
        let long = life.handle_request(0, &"x".repeat(1_000_000)).unwrap_err().to_string();
        assert!(long.len() < 200 && long.ends_with("expected configure, shutdown"), "{long}");
        assert_eq!(life.state(), State::Unconfigured);
        assert_eq!(life.handle_outcome(true), None);
    }

    #[test]
    fn where_nothing_is_possible_the_text_says_what_to_do() {
        let mut life = Lifecycle::default();
        life.handle_request(0, "shutdown").unwrap();
        let error = life.handle_request(0, "configure").unwrap_err().to_string();
        let told = "a transition is under way; wait until it is over";
        assert_eq!(error, format!("transition \"configure\" is not possible in state shuttingdown: {told}"));
        life.handle_outcome(true).unwrap();
        let error = life.handle_request(0, "configure").unwrap_err().to_string();
        let told = "its life is over; end the node and start it anew";
        assert_eq!(error, format!("transition \"configure\" is not possible in state finalized: {told}"));
    }

    #[test]
    fn no_two_transitions_from_a_state_share_a_label() {
        for step in &TRANSITIONS {
            let same = TRANSITIONS.iter().filter(|other| (other.start, other.label) == (step.start, step.label));
            assert_eq!(same.count(), 1, "{step:?}");
        }
    }
}
