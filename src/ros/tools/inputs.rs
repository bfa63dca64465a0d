//! The inputs of a configuration as a tool beside the node receives them, and what is wrong with them.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use super::listener::{Incoming, Listener, SubscribedTopic};
use crate::config::Config;
use crate::fusion::{Estimate, Event, Fusion};
use crate::msg::binding::SampleBinding;
use crate::msg::definition::TypeTree;
use crate::ros::node::Watched;
use crate::ros::node::health::{InputHealth, Outcomes, Problem};

/// Interval between two judgements of the inputs.
const JUDGE_EVERY: Duration = Duration::from_secs(1);

/// Number of judgements in a row with the same problem from which it lasts.
const LASTING: u32 = 2;

/// Receives the inputs of a configuration.
pub struct Inputs {
    /// `[inputs]`: the first topics of the listener; topics after them are for others.
    bindings: Vec<(TypeTree, Vec<SampleBinding>)>,
    watched: Watched,
    began: Instant,
    judged: Duration,
    /// The problems of the last judgement, and the number of judgements in a row that had them.
    wrong: BTreeMap<(usize, &'static str), u32>,
}

impl Inputs {
    /// Inputs that are the first topics of a listener.
    pub fn new(bindings: Vec<(TypeTree, Vec<SampleBinding>)>, watched: Watched) -> Self {
        let (began, judged) = (Instant::now(), Duration::ZERO);
        Inputs { bindings, watched, began, judged, wrong: BTreeMap::new() }
    }

    /// Reads a message for every source that it is for.
    pub fn handle(&mut self, incoming: &Incoming, on_event: &mut dyn FnMut(&Event<'_>)) {
        let Incoming { topic: SubscribedTopic(input), cdr: Ok(cdr), received, publisher } = incoming else { return };
        for binding in self.bindings.get_mut(*input).into_iter().flat_map(|(_, bindings)| bindings) {
            let source = self.watched.source_of(binding);
            let decoded = binding.decode(cdr, *received);
            let health = &mut self.watched.inputs[source];
            match &decoded {
                Err(error) if error.is_kept() => continue,
                Err(error) if error.is_for_another() => {
                    health.handle_for_another(error.reason(), &error.to_string());
                    continue;
                }
                _ => health.handle_arrival(self.began.elapsed(), *publisher),
            }
            match decoded {
                Ok(event) => {
                    self.watched.handle(&event);
                    on_event(&event);
                }
                Err(error) => {
                    health.handle_unreadable(1, error.reason(), &error.to_string());
                }
            }
        }
    }

    /// The state of each source's input: tactile sources first, then joint sources.
    pub fn health(&self) -> &[InputHealth] {
        &self.watched.inputs
    }

    /// Time since the start.
    pub fn elapsed(&self) -> Duration {
        self.began.elapsed()
    }

    /// The current problems of each source's input, once a second; `None` in between.
    pub fn judge(&mut self, listener: &Listener, cfg: &Config, core: Option<&Fusion>) -> Option<Vec<Vec<Problem>>> {
        let now = self.began.elapsed();
        if now.saturating_sub(self.judged) < JUDGE_EVERY {
            return None;
        }
        self.judged = now;
        listener.look_around(&mut self.watched, now);
        Some(self.watched.judge(now, cfg, core))
    }

    /// A problem that lasts and would make another zero.
    pub fn lasting_problem(&mut self, listener: &Listener, cfg: &Config, core: Option<&Fusion>) -> Option<String> {
        let problems = self.judge(listener, cfg, core)?;
        let before = std::mem::take(&mut self.wrong);
        let mut lasting = None;
        for (input, problem) in
            problems.iter().enumerate().flat_map(|(input, of)| of.iter().map(move |one| (input, one)))
        {
            // Times that vary and messages that are lost make no other zero.
            if matches!(problem.kind, "jitter" | "lost" | "rate") {
                continue;
            }
            let n = before.get(&(input, problem.kind)).map_or(1, |n| n + 1);
            self.wrong.insert((input, problem.kind), n);
            if n >= LASTING {
                lasting.get_or_insert_with(|| problem.text.clone());
            }
        }
        lasting
    }

    /// Counts estimates.
    pub(super) fn handle_estimates(&mut self, estimates: &[Estimate]) {
        estimates.iter().for_each(|estimate| self.watched.handle_estimate(estimate));
    }

    /// The estimates since the last call, and the number that the core would make.
    pub(super) fn take_outcomes(&mut self, now: Duration, core: &Fusion) -> (Outcomes, f64) {
        self.watched.take_outcomes(now, core)
    }

    /// The reason why a source has received nothing, for the first one that hasn't.
    pub fn why_silent(&self) -> Option<String> {
        let silent = self.watched.inputs.iter().find(|input| input.meter().n_total() == 0)?;
        let (key, topic) = (silent.key(), silent.topic());
        Some(match silent.for_another() {
            Some(other) => format!("nothing for {key} came on {topic}: {other}; correct {key}.only"),
            None => format!(
                "nothing that can be read came on {topic}; start its driver, or correct its topic and type in the parameters"
            ),
        })
    }
}
