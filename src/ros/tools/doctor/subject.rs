//! Findings on a node with given parameters: models, calibration, inputs, names, and the estimates that it would make.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use ros2_client::QosProfile;

use super::super::inputs::Inputs;
use super::super::listener::{Delivery, Incoming, Listener, Listening};
use super::{Finding, Level};
use crate::config::{Config, ParamTree};
use crate::fusion::{Event, Fusion};
use crate::msg::definition::{Definitions, TypeTree};
use crate::msg::{ContactArray, WireType, WrenchStamped};
use crate::ros::node::health::{InputHealth, advice};
use crate::ros::node::{Watched, input_bindings, loading, wanted};
use crate::ros::wire::args::{RosArgs, Severity};
use crate::ros::wire::entities::Names;
use crate::ros::wire::environment::Environment;
use crate::ros::wire::error::NodeError;
use crate::ros::wire::graph::{Around, Endpoint, Wanted, incompatible, why_not_received};
use crate::ros::wire::middleware::TopicType;
use crate::ros::wire::qos::{self, Side};
use crate::units::NANOS_PER_SEC;

/// Maximum number of stamps per input whose age is kept.
const MOST_AGES: usize = 16_384;

/// Number of judgements from which a problem lasts.
const LASTING: u32 = 2;

/// Number of judgements, one a second, from which estimates count: inputs are found, and windows are full.
const SETTLED: u32 = 3;

/// The node that would run.
pub(super) struct Subject {
    cfg: Config,
    names: Names,
    /// `[inputs]`
    types: Vec<TypeTree>,
    /// `[sources]`, tactile sources first.
    wanted: Vec<Wanted>,
    /// Topics of the estimates, and the QoS that would be offered on them.
    offers: Vec<(String, QosProfile)>,
    /// `None` if the models can't be loaded.
    core: Option<Fusion>,
    inputs: Inputs,
    seen: Seen,
    /// The problems of each source by kind: their newest text, and in how many judgements they were.
    problems: BTreeMap<(usize, &'static str), (String, u32)>,
    n_judged: u32,
}

/// The messages of each source.
#[derive(Default)]
struct Seen {
    /// Receipt minus stamp by key, ns.
    ages: BTreeMap<String, Vec<i64>>,
    /// Taxels of the newest message by key.
    taxels: BTreeMap<String, usize>,
    joints: BTreeSet<String>,
}

impl Subject {
    pub(super) fn new(
        cfg: Config,
        tree: &ParamTree,
        calibration: Option<&Path>,
        args: &RosArgs,
        environment: &Environment,
        findings: &mut Vec<Finding>,
    ) -> Result<Self, NodeError> {
        let names = Names::new(&cfg, &args.remaps)?;
        let definitions = Definitions::new(cfg.live.message_definitions.as_deref(), &environment.prefixes);
        let bindings = input_bindings(&cfg, &names, &definitions)?;
        let wanted: Vec<Wanted> = wanted(&cfg, tree, &names, &bindings)?.into_iter().flatten().collect();
        let mut offers = Vec::new();
        for topic in names.estimates.names() {
            let qos = qos::with_overrides(qos::output_default(), tree, topic, Side::Publisher)?;
            offers.push((topic.to_owned(), qos));
        }
        let inputs = names.inputs.iter().map(|input| (input.topic.clone(), Side::Subscription));
        let outputs = names.estimates.names().map(|name| (name.to_owned(), Side::Publisher));
        qos::check_all_used(tree, &inputs.chain(outputs).collect::<Vec<_>>())?;
        let text = format!("a node {} with {} can be set up", cfg.node, tree.files());
        findings.push(Finding::new("parameters", Level::Ok, text));
        let core = match loading::rehearse(&cfg, calibration) {
            Ok((core, notes)) => {
                findings.extend(notes.into_iter().map(|(severity, text)| {
                    let level = match severity {
                        Severity::Debug | Severity::Info => Level::Ok,
                        Severity::Warn => Level::Warning,
                        Severity::Error | Severity::Fatal => Level::Problem,
                    };
                    let text = if level == Level::Ok { text } else { format!("at a start: {text}") };
                    Finding::new("models", level, text)
                }));
                Some(core)
            }
            Err(reason) => {
                findings.push(Finding::new("models", Level::Problem, reason));
                None
            }
        };
        let types = bindings.iter().map(|(ty, _)| ty.clone()).collect();
        let inputs = Inputs::new(bindings, Watched::new(&cfg, wanted.iter().cloned()));
        let (seen, problems) = (Seen::default(), BTreeMap::new());
        Ok(Subject { cfg, names, types, wanted, offers, core, inputs, seen, problems, n_judged: 0 })
    }

    /// Subscribes to the inputs, before anything else is subscribed to.
    pub(super) fn listen(&self, listening: &mut Listening) -> Result<(), NodeError> {
        for (input, ty) in self.names.inputs.iter().zip(&self.types) {
            listening.subscribe(&input.topic, TopicType::Defined(ty), Delivery::Data)?;
        }
        Ok(())
    }

    /// Takes a message, as the node would.
    pub(super) fn handle(&mut self, incoming: &Incoming) {
        let Subject { cfg, core, inputs, seen, .. } = self;
        let mut estimates = Vec::new();
        inputs.handle(incoming, &mut |event| {
            seen.handle(event, cfg);
            if let Some(fusion) = core
                && fusion.handle(*event).is_ok()
            {
                while let Ok(Some(tick)) = fusion.poll() {
                    estimates.extend(tick.estimates.iter().copied());
                }
            }
        });
        inputs.handle_estimates(&estimates);
    }

    /// Judges the inputs, once a second.
    pub(super) fn judge(&mut self, listener: &Listener) {
        let Some(judged) = self.inputs.judge(listener, &self.cfg, self.core.as_ref()) else { return };
        self.n_judged += 1;
        if self.n_judged == SETTLED
            && let Some(core) = &self.core
        {
            let elapsed = self.inputs.elapsed();
            self.inputs.take_outcomes(elapsed, core); // the first windows fill
        }
        for (source, problems) in judged.into_iter().enumerate() {
            for problem in problems {
                let known = self.problems.entry((source, problem.kind)).or_default();
                *known = (problem.text, known.1 + 1);
            }
        }
    }

    /// The findings on the node.
    pub(super) fn findings(&mut self, around: &Around) -> Vec<Finding> {
        let mut findings = Vec::new();
        for (source, wanted) in self.wanted_by_source().into_iter().enumerate() {
            findings.extend(self.of_input(source, &wanted, around));
        }
        // One cause is told once: what an input explains is no finding of its own.
        let input_fails = findings.iter().any(|finding| finding.level == Level::Problem);
        if !(input_fails && self.seen.joints.is_empty()) {
            findings.extend(self.of_joints());
        }
        findings.extend(self.of_names(around));
        if self.cfg.use_sim_time && !around.publishers.iter().any(|endpoint| endpoint.topic == "/clock") {
            let text =
                "use_sim_time is true and nobody publishes /clock: start what does, or set use_sim_time to false";
            findings.push(Finding::new("clock", Level::Problem, text));
        }
        findings.extend(self.of_estimates(input_fails, self.n_running(around) > 0));
        findings
    }

    /// In the order of the inputs' health.
    fn wanted_by_source(&self) -> Vec<Wanted> {
        let of_key = |health: &InputHealth| self.wanted.iter().find(|wanted| wanted.key == health.key()).cloned();
        self.inputs.health().iter().filter_map(of_key).collect()
    }

    fn of_input(&self, source: usize, wanted: &Wanted, around: &Around) -> Vec<Finding> {
        let (health, part) = (&self.inputs.health()[source], format!("input {}", wanted.key));
        if health.meter().n_total() == 0 {
            let why = match (health.for_another(), health.unreadable().keys().next()) {
                (Some(other), _) => format!("nothing for it came on {}: {other}: correct its only", wanted.topic),
                (None, Some(reason)) => format!("nothing on {} could be read: {reason}", wanted.topic),
                (None, None) => wanted.why_absent(&around.publishers),
            };
            return vec![Finding::new(&part, Level::Problem, why)];
        }
        let lasting = self.problems.range((source, "")..).take_while(|((of, _), _)| *of == source);
        let lasting = lasting.filter(|(_, (_, n))| *n >= LASTING);
        let mut problems: Vec<Finding> = lasting
            .map(|((_, kind), (text, _))| {
                let level = match *kind {
                    "jitter" | "lost" | "rate" | "definition" => Level::Warning,
                    _ => Level::Problem,
                };
                Finding::new(&part, level, text.clone())
            })
            .collect();
        // This tool asks for less than the node may, so it gets what the node would not.
        let of_type = |other: &&Endpoint| other.topic == wanted.topic && other.type_name == wanted.type_name;
        let mut publishers = around.publishers.iter().filter(of_type).peekable();
        if publishers.peek().is_some() && publishers.all(|other| incompatible(&other.qos, &wanted.qos).is_some()) {
            problems.push(Finding::new(&part, Level::Problem, wanted.why_absent(&around.publishers)));
        }
        if problems.iter().any(|finding| finding.level == Level::Problem) {
            return problems;
        }
        let rate =
            health.meter().rate_hz().map_or_else(|| "too few to tell a rate".to_owned(), |hz| format!("{hz:.1} Hz"));
        let taxels = self.seen.taxels.get(&wanted.key).map(|n| format!(", {n} taxels")).unwrap_or_default();
        let mut ages = self.seen.ages.get(&wanted.key).cloned().unwrap_or_default();
        ages.sort_unstable();
        let age = ages.get(ages.len() / 2).map(|ns| *ns as f64 / NANOS_PER_SEC as f64 * 1e3);
        let age = age.map(|ms| format!(", stamps {ms:.1} ms before receipt (median)")).unwrap_or_default();
        let text = format!("{} as {}: {rate}{taxels}{age}", wanted.topic, wanted.type_name);
        problems.insert(0, Finding::new(&part, Level::Ok, text));
        problems
    }

    /// The joints that the regions need.
    fn of_joints(&self) -> Option<Finding> {
        let needed = self.cfg.needed_joints();
        let missing: Vec<&str> =
            needed.iter().filter(|name| !self.seen.joints.contains(*name)).map(String::as_str).collect();
        if needed.is_empty() {
            return None;
        }
        Some(match missing.as_slice() {
            [] => Finding::new("joints", Level::Ok, format!("all {} joints that the regions need come", needed.len())),
            missing => {
                let other: Vec<&str> = self.seen.joints.iter().map(String::as_str).take(12).collect();
                let advice = match other.is_empty() {
                    true => "no joints came: see their input".to_owned(),
                    false => format!(
                        "{} came: write your names in region.<name>.joints and, in the same order, those of the model in region.<name>.model_joints",
                        other.join(", ")
                    ),
                };
                let (n_missing, n_needed) = (missing.len(), needed.len());
                let text = format!("{n_missing} of {n_needed} joints are missing: {}; {advice}", missing.join(", "));
                Finding::new("joints", Level::Problem, text)
            }
        })
    }

    /// The node's own name, services and topics.
    fn of_names(&self, around: &Around) -> Vec<Finding> {
        let node = self.cfg.node.to_string();
        let n_same = self.n_running(around);
        let mut findings = Vec::new();
        if n_same == 0 {
            let services =
                ["tare", "change_state", "get_parameters", "set_parameters"].map(|name| format!("{node}/{name}"));
            let taken = around.servers.iter().find(|server| services.contains(&server.service));
            findings.extend(taken.map(|server| {
                let text = format!(
                    "another node already serves {}: calls would reach both; give this one another name or namespace (-r __ns:=/left)",
                    server.service
                );
                Finding::new("names", Level::Problem, text)
            }));
            let published =
                self.offers.iter().find(|(topic, _)| around.publishers.iter().any(|other| other.topic == *topic));
            findings.extend(published.map(|(topic, _)| {
                let text = format!(
                    "somebody else publishes {topic} already: stop that node, or give one of both another name or namespace (-r __ns:=/left)"
                );
                Finding::new("names", Level::Problem, text)
            }));
        }
        let type_of = |idx: usize| {
            if idx + 1 < self.offers.len() { WrenchStamped::TYPE_NAME } else { ContactArray::TYPE_NAME }
        };
        for (idx, (topic, qos)) in self.offers.iter().enumerate() {
            findings.extend(
                why_not_received(topic, qos, &around.subscriptions)
                    .map(|text| Finding::new("names", Level::Warning, text)),
            );
            let other = around.subscriptions.iter().find(|sub| sub.topic == *topic && sub.type_name != type_of(idx));
            findings.extend(other.map(|sub| {
                let text = format!(
                    "a subscriber of {topic} expects {}, and the node publishes {}: correct the subscriber",
                    sub.type_name,
                    type_of(idx)
                );
                Finding::new("names", Level::Warning, text)
            }));
        }
        if findings.is_empty() {
            let text = match n_same {
                0 => format!("{node} is free: nobody else has its services, or publishes its topics"),
                _ => format!("{node} runs already; start no second one with this name"),
            };
            findings.push(Finding::new("names", Level::Ok, text));
        }
        findings
    }

    /// Nodes of this package that have the name of the one that is examined.
    fn n_running(&self, around: &Around) -> usize {
        let node = self.cfg.node.to_string();
        around.fusion_nodes().iter().filter(|name| **name == node).count()
    }

    /// The estimates that the node would have made. Nothing if an input that fails explains why there are none, or if none
    /// can be tried and the node runs already.
    fn of_estimates(&mut self, input_fails: bool, runs_already: bool) -> Option<Finding> {
        let (core, elapsed) = (self.core.as_ref()?, self.inputs.elapsed());
        let (outcomes, n_expected) = self.inputs.take_outcomes(elapsed, core);
        if outcomes.n == 0 {
            let text = "no frame could be made of what came, so no estimate was tried; see the inputs";
            return (!input_fails).then(|| Finding::new("estimates", Level::Problem, text));
        }
        if core.config().tactile_source_idxs().all(|source| core.baseline(source).is_none()) {
            if runs_already {
                return None; // what the node says of its own is among the findings
            }
            let text = format!(
                "not tried on the {} frames that came: without a calibration no node gives a force; name that of the node by --calibration",
                outcomes.n
            );
            return Some(Finding::new("estimates", Level::Warning, text));
        }
        let n_expected = if self.n_judged >= SETTLED { n_expected } else { 0.0 };
        let percent = (100.0 * outcomes.share(n_expected)).floor();
        let min = 100.0 * self.cfg.live.min_estimates;
        Some(if percent >= min {
            let why = match outcomes.reasons(n_expected) {
                reasons if percent < 100.0 && !reasons.is_empty() => format!(" (not full: {reasons})"),
                _ => String::new(),
            };
            let text = format!("{percent} % of {} frames have a full estimate{why}", outcomes.n);
            Finding::new("estimates", Level::Ok, text)
        } else {
            let what = match input_fails {
                true => "see the inputs",
                false => outcomes.worst().map_or("look at the inputs", advice),
            };
            let reasons = outcomes.reasons(n_expected);
            let text = format!(
                "{percent} % of {} frames have a full estimate, below diagnostics.min_estimates of {min} % ({reasons}): {what}",
                outcomes.n
            );
            Finding::new("estimates", Level::Warning, text)
        })
    }
}

impl Seen {
    fn handle(&mut self, event: &Event<'_>, cfg: &Config) {
        let (key, age_ns) = match event {
            Event::Tactile(block) => {
                let source = &cfg.fusion().tactile_sources()[block.source.position()];
                let key = format!("tactile.{}", source.name);
                if let Some(n_taxels) = block.values.len().checked_div(block.rows) {
                    self.taxels.insert(key.clone(), n_taxels);
                }
                (key, block.received.nanos_since(block.stamp.offset(source.stamp_offset_ns)))
            }
            Event::Joints(sample) => {
                let source = &cfg.fusion().joint_sources()[sample.source.position()];
                let needed = cfg.needed_joints();
                let known = self.joints.len();
                if known < needed.len() + 256 {
                    self.joints.extend(sample.names.iter().cloned());
                }
                let key = format!("joint.{}", source.name);
                (key, sample.received.nanos_since(sample.stamp.offset(source.stamp_offset_ns)))
            }
        };
        let ages = self.ages.entry(key).or_default();
        if ages.len() < MOST_AGES {
            ages.push(age_ns);
        }
    }
}
