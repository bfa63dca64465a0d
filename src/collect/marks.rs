//! Annotations as a collection makes them, and what they say has been done.

use std::collections::{BTreeMap, BTreeSet};

use crate::protocol::{Plan, Protocol, Trial};
use crate::units::{NANOS_PER_SEC, Stamp};

/// How much before its end an item may have been ended and still be whole, s: annotations come with the screen's clock.
const EARLY_S: f64 = 0.1;

/// An annotation: what holds from a stamp until the next one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mark {
    /// From when on.
    pub from: Stamp,
    /// Stage of the protocol, 1 to 3; 0 outside of it.
    pub stage: u8,
    /// Substage, empty outside of one.
    pub substage: String,
    /// Pose or movement, empty when free.
    pub pose: String,
    /// Repetition within the substage.
    pub repetition: u16,
    /// Whether nothing touches the glove.
    pub zero_load: bool,
}

impl Mark {
    /// Nothing is asked for: between items, or instead of an annotation that no longer holds.
    pub fn outside(from: Stamp) -> Self {
        Mark { from, stage: 0, substage: String::new(), pose: String::new(), repetition: 0, zero_load: false }
    }
}

/// All annotations of a collection. Of two with one stamp the one that came later holds.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Marks(BTreeMap<Stamp, Mark>);

impl Marks {
    /// Takes one more, in any order.
    pub fn handle(&mut self, mark: Mark) {
        self.0.insert(mark.from, mark);
    }

    /// Those that hold, in the order of their stamps.
    pub fn all(&self) -> impl Iterator<Item = &Mark> {
        self.0.values()
    }

    /// The items of a plan that were done from beginning to end, and the marks of items that were begun and not ended.
    pub fn done(&self, protocol: &Protocol, plan: &Plan) -> (BTreeSet<usize>, Vec<Stamp>) {
        let mut done = BTreeSet::new();
        let mut broken = Vec::new();
        let marks: Vec<&Mark> = self.0.values().collect();
        let mut at = 0;
        while at < marks.len() {
            let Some((trial_idx, n_steps, end_s)) = begun(protocol, plan, &marks[at..]) else {
                if marks[at].stage != 0 {
                    broken.push(marks[at].from); // a later step without the first one
                }
                at += 1;
                continue;
            };
            let steps = plan.trials()[trial_idx].steps(protocol).len();
            let ended = marks.get(at + n_steps).map(|next| seconds(next.from.nanos_since(marks[at].from)));
            match n_steps == steps && ended.is_some_and(|ended_s| ended_s >= end_s - EARLY_S) {
                true => {
                    done.insert(trial_idx);
                }
                false => broken.extend(marks[at..at + n_steps].iter().map(|mark| mark.from)),
            }
            at += n_steps;
        }
        (done, broken)
    }
}

/// The trial that marks begin with, how many of them are its steps, and how long it takes.
fn begun(protocol: &Protocol, plan: &Plan, marks: &[&Mark]) -> Option<(usize, usize, f64)> {
    let first = marks.first()?;
    let of = |trial: &Trial, mark: &Mark| {
        trial.stage == mark.stage && *trial.substage == *mark.substage && trial.repetition == mark.repetition
    };
    plan.trials().iter().enumerate().filter(|(_, trial)| of(trial, first)).find_map(|(idx, trial)| {
        let steps = trial.steps(protocol);
        let is_step = |(step, mark): &(&crate::protocol::Step, &&Mark)| {
            of(trial, mark) && *step.pose == *mark.pose && step.zero_load == mark.zero_load
        };
        let n_steps = steps.iter().zip(marks).take_while(is_step).count();
        (n_steps > 0).then_some((idx, n_steps, trial.duration_s))
    })
}

fn seconds(nanos: i64) -> f64 {
    nanos as f64 / NANOS_PER_SEC as f64
}
