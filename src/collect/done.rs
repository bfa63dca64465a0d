//! Finds the completed items of a collection from its annotations.

use std::collections::BTreeSet;

use crate::protocol::{Annotation, Annotations, Plan, Protocol, Step, Trial};
use crate::units::{NANOS_PER_SEC, Stamp};

/// An item that ended earlier than planned by at most this time still counts as complete, s, because annotations follow
/// the clock of the screen.
const EARLY_S: f64 = 0.1;

/// The completed items of a plan, and the stamps of items that were begun but not completed.
pub fn done(annotations: &Annotations, protocol: &Protocol, plan: &Plan) -> (BTreeSet<usize>, Vec<Stamp>) {
    let mut done = BTreeSet::new();
    let mut broken = Vec::new();
    let mut left = annotations.all();
    while let Some(first) = left.first() {
        let Some((trial_idx, n_steps, end_s)) = begun(protocol, plan, left) else {
            if first.stage != 0 {
                broken.push(first.from); // a later step without the first one
            }
            left = &left[1..];
            continue;
        };
        let (steps, rest) = left.split_at(n_steps);
        let n_expected = plan.trials()[trial_idx].steps(protocol).len();
        let ended_s = rest.first().map(|next| seconds(next.from.nanos_since(first.from)));
        match n_steps == n_expected && ended_s.is_some_and(|ended_s| ended_s >= end_s - EARLY_S) {
            true => {
                done.insert(trial_idx);
            }
            false => broken.extend(steps.iter().map(|step| step.from)),
        }
        left = rest;
    }
    (done, broken)
}

/// The trial that begins with these annotations, the number of annotations that are its steps, and its duration.
fn begun(protocol: &Protocol, plan: &Plan, annotations: &[Annotation]) -> Option<(usize, usize, f64)> {
    let first = annotations.first()?;
    let of = |trial: &Trial, annotation: &Annotation| {
        trial.stage == annotation.stage
            && *trial.substage == *annotation.substage
            && trial.repetition == annotation.repetition
    };
    plan.trials().iter().enumerate().filter(|(_, trial)| of(trial, first)).find_map(|(idx, trial)| {
        let steps = trial.steps(protocol);
        let is_step = |(step, annotation): &(&Step, &Annotation)| {
            of(trial, annotation) && *step.pose == *annotation.pose && step.zero_load == annotation.zero_load
        };
        let n_steps = steps.iter().zip(annotations).take_while(is_step).count();
        (n_steps > 0).then_some((idx, n_steps, trial.duration_s))
    })
}

fn seconds(nanos: i64) -> f64 {
    nanos as f64 / NANOS_PER_SEC as f64
}
