//! The report on `/diagnostics`, once a second.

use std::sync::atomic::Ordering;
use std::time::Duration;

use super::Running;
use crate::msg::to_cdr;
use crate::ros::node::diagnostics::{Budget, Level, Percentiles, Status};
use crate::ros::node::health::{Announcement, Problem, advice};
use crate::ros::node::interfaces::DiagnosticArray;
use crate::ros::node::watched::timeout;
use crate::ros::wire::args::Severity;

/// How long artifacts must be at the limit of their distance from the calibration before it is reported; a moment is
/// normal.
const CAPPED_FOR: Duration = Duration::from_secs(30);

/// Estimates of a second that are not published before it is reported: one now and then is normal.
const LATE: u64 = 5;

impl Running {
    /// Queues a report for publishing, and logs problems that have lasted or are over.
    pub(super) fn report(&mut self) {
        let now = self.engine.clock.running();
        self.watched.look_around(now, self.engine.neighbours.as_ref());
        let time = self.engine.clock.is_sim().then(|| self.engine.clock.now());
        let mut of_graph = self.watched.judge_graph(&self.engine.outputs.offers);
        of_graph.extend(self.watched.judge_clock(time));
        let of_inputs = self.watched.judge(now, &self.engine.cfg, self.core.as_ref().map(|core| &core.fusion));
        let late = self.late();
        let mut statuses: Vec<Status> =
            of_inputs.iter().enumerate().map(|(input, problems)| self.input_status(input, problems)).collect();
        statuses.push(self.graph_status(&of_graph));
        statuses.push(self.latency_status(late.as_ref()));
        let causes: Vec<&Problem> = of_inputs.iter().chain([&of_graph]).flatten().chain(&late).collect();
        let (estimates, is_enough) = self.estimate_status(&causes);
        let of_node: Vec<&Problem> = of_graph.iter().chain(&late).collect();
        self.announce(now, &of_inputs, &of_node, (!is_enough).then_some(estimates.message.as_str()));
        statuses.push(estimates);
        let hardware_id = self.engine.cfg.glove.clone().unwrap_or_default();
        let message = DiagnosticArray::new(self.engine.clock.now().into(), &hardware_id, statuses);
        self.engine.outbox.send(self.engine.outputs.diagnostics, to_cdr(&message), None);
    }

    /// Logs problems that last and those that are over. `estimates`: their problems, logged if no input is the cause.
    fn announce(&mut self, now: Duration, of_inputs: &[Vec<Problem>], of_node: &[&Problem], estimates: Option<&str>) {
        let mut problems: Vec<(String, String)> = Vec::new();
        for (input, of_input) in self.watched.inputs.iter().zip(of_inputs) {
            let name = |problem: &Problem| (format!("{} ({})", input.key(), problem.kind), problem.text.clone());
            problems.extend(of_input.iter().map(name));
        }
        problems.extend(of_node.iter().map(|problem| (format!("node ({})", problem.kind), problem.text.clone())));
        match estimates {
            Some(text) if problems.is_empty() => problems.push(("estimates".to_owned(), text.to_owned())),
            Some(_) => self.watched.announcer.hold(now, "estimates"), // not solved: its cause is reported instead
            None => {}
        }
        for said in self.watched.announcer.handle(now, &problems) {
            match said {
                Announcement::Began(text) => self.engine.outbox.log(Severity::Warn, text),
                Announcement::Ended(problem) => {
                    self.engine.outbox.log(Severity::Info, format!("solved: \"{problem}\""))
                }
            }
        }
    }

    fn name(&self, part: &str) -> String {
        format!("{}: {part}", self.engine.cfg.node.to_string().trim_start_matches('/'))
    }

    fn budget(&mut self, name: &str, kept: bool) -> Level {
        let sustained = self.engine.cfg.live.sustained;
        let budget = self.budgets.entry(name.to_owned()).or_insert_with(|| Budget::new(sustained));
        budget.handle(self.engine.clock.running(), kept)
    }

    fn input_status(&mut self, input: usize, problems: &[Problem]) -> Status {
        let now = self.engine.clock.running();
        let health = &self.watched.inputs[input];
        let (key, topic, meter) = (health.key().to_owned(), health.topic().to_owned(), health.meter());
        let age = meter.age(now);
        let limit = timeout(&self.engine.cfg, input);
        let stopped = age.is_none_or(|age| age > limit.max(Duration::from_millis(1)));
        let mut values = vec![
            ("topic".to_owned(), topic.clone()),
            ("messages".to_owned(), meter.n_total().to_string()),
            ("rate_hz".to_owned(), number(meter.rate_hz())),
            ("jitter_ms".to_owned(), number(meter.jitter_ms())),
            ("age_ms".to_owned(), number(age.map(|age| age.as_secs_f64() * 1e3))),
        ];
        values.extend(health.unreadable().iter().map(|(reason, n)| (format!("dropped.{reason}"), n.to_string())));
        values.extend(problems.iter().map(|problem| (format!("problem.{}", problem.kind), problem.text.clone())));
        let level = self.budget(&format!("input {key}"), !stopped && problems.is_empty());
        let (level, message) = match (age, problems.first()) {
            (None, Some(problem)) => (Level::Stale, problem.text.clone()),
            (None, None) => (Level::Stale, format!("nothing came on {topic} yet")),
            (Some(_), Some(problem)) => (level, problem.text.clone()),
            (Some(age), None) if stopped => (level, format!("nothing came for {:.1} s", age.as_secs_f64())),
            (Some(_), None) => (level, "messages come".to_owned()),
        };
        Status { name: self.name(&format!("input {key}")), level, message, values }
    }

    fn graph_status(&mut self, problems: &[Problem]) -> Status {
        let level = self.budget("graph", problems.is_empty());
        let message = problems
            .first()
            .map_or("no other node publishes the same, and all subscribers match", |problem| &problem.text)
            .to_owned();
        let values = problems.iter().map(|problem| (format!("problem.{}", problem.kind), problem.text.clone()));
        Status { name: self.name("graph"), level, message, values: values.collect() }
    }

    /// Estimates of the last second that were computed and not published, because something made them too late.
    fn late(&mut self) -> Option<Problem> {
        let n_sources = self.engine.cfg.fusion().tactile_sources().len();
        let n_outdated: u64 = (0..n_sources).map(|source_idx| self.order.n_outdated(source_idx)).sum();
        let n_waited = self.engine.outbox.stats().waited.load(Ordering::Relaxed);
        let [outdated, waited] = std::mem::replace(&mut self.n_late, [n_outdated, n_waited]);
        let (outdated, waited) = (n_outdated.saturating_sub(outdated), n_waited.saturating_sub(waited));
        (self.active && outdated + waited >= LATE).then(|| Problem {
            kind: "late",
            text: format!(
                "{} estimates of the last second were not published: {waited} waited in this node for longer than timing.max_age_ms, {outdated} came after it was reported that their source is silent; this machine is too busy, or messages come late: stop other programs, or raise timing.max_age_ms",
                outdated + waited
            ),
        })
    }

    fn latency_status(&mut self, late: Option<&Problem>) -> Status {
        let stats = self.engine.outbox.stats();
        let [stamp, received] = stats.take_latencies();
        let (dropped, failed) = (stats.dropped.load(Ordering::Relaxed), stats.failed.load(Ordering::Relaxed));
        let no_picture = stats.pictures_failed.load(Ordering::Relaxed);
        let (published, waited) = (stats.published.load(Ordering::Relaxed), stats.waited.load(Ordering::Relaxed));
        let limit_ms = self.engine.cfg.live.max_latency.as_secs_f64() * 1e3;
        let within = |stamp: Percentiles| stamp.p99 <= limit_ms && stamp.p50 >= -limit_ms;
        let level = match (late, stamp) {
            (Some(_), _) => self.budget("latency", false),
            (None, Some(stamp)) => self.budget("latency", within(stamp)),
            (None, None) => Level::Stale, // nothing was measured
        };
        let message = match (late, stamp) {
            (Some(problem), _) => problem.text.clone(),
            (None, None) => "not measured: nothing was published in the last second".to_owned(),
            (None, Some(stamp)) if stamp.p50 < 0.0 => {
                format!("stamps lie {:.1} ms ahead of this node's clock (median): synchronize the clocks", -stamp.p50)
            }
            (None, Some(stamp)) => {
                format!("{:.1} ms from stamp to publish (99th percentile), limit {limit_ms} ms", stamp.p99)
            }
        };
        let mut values = vec![
            ("published".to_owned(), published.to_string()),
            ("dropped.queue_full".to_owned(), dropped.to_string()),
            ("dropped.not_sent".to_owned(), failed.to_string()),
            ("dropped.waited_too_long".to_owned(), waited.to_string()),
            ("dropped.pictures".to_owned(), no_picture.to_string()),
        ];
        for (name, percentiles) in [("stamp_to_publish_ms", stamp), ("receive_to_publish_ms", received)] {
            let part = |part: fn(Percentiles) -> f64| number(percentiles.map(part));
            values.push((format!("{name}.p50"), part(|p| p.p50)));
            values.push((format!("{name}.p99"), part(|p| p.p99)));
            values.push((format!("{name}.max"), part(|p| p.max)));
        }
        Status { name: self.name("latency"), level, message, values }
    }

    /// Status of the published estimates.
    fn estimate_status(&mut self, causes: &[&Problem]) -> (Status, bool) {
        let name = self.name("estimates");
        let now = self.engine.clock.running();
        let Some(core) = &self.core else {
            let message = "not configured".to_owned();
            return (Status { name, level: Level::Warn, message, values: Vec::new() }, true);
        };
        let (outcomes, n_expected) = self.watched.take_outcomes(now, &core.fusion);
        let (share, limit) = (outcomes.share(n_expected), self.engine.cfg.live.min_estimates);
        let capped = self.watched.capped_for(now, &outcomes).filter(|capped| self.active && *capped >= CAPPED_FOR);
        let is_calibrated = core.calibration.is_some();
        let is_enough = (share >= limit && is_calibrated) || !self.active;
        let sustained = self.engine.cfg.live.sustained;
        let budget = self.budgets.entry("estimates".to_owned()).or_insert_with(|| Budget::new(sustained));
        let level = budget.handle(now, is_enough && (causes.is_empty() || !self.active));
        let percent = (100.0 * share).floor();
        let cause = match (causes, outcomes.worst()) {
            ([], Some(flag)) => advice(flag).to_owned(),
            ([], None) => "no frames come: look at the taxels".to_owned(),
            (causes, _) => causes.iter().take(2).map(|problem| problem.text.as_str()).collect::<Vec<_>>().join("; "),
        };
        let (level, message) = match (is_calibrated, self.active) {
            (false, _) => (
                level.max(Level::Warn),
                "not calibrated: calibrate (tpf call calibrate), or start with --calibration FILE".to_owned(),
            ),
            (_, false) => (Level::Ok, "inactive: nothing is published".to_owned()),
            _ if share < limit => {
                let reasons = outcomes.reasons(n_expected);
                let min = 100.0 * limit;
                (
                    level,
                    format!(
                        "{percent} % of the last second's frames have a full estimate, below diagnostics.min_estimates of {min} % ({reasons}): {cause}"
                    ),
                )
            }
            _ if !causes.is_empty() => {
                (level, format!("{percent} % of the last second's frames have a full estimate, but {cause}"))
            }
            _ if capped.is_some() => {
                let text = "the artifact of pose has been as far from its calibration as it may go for half a minute or more: call ~/calibrate, the glove may have been put on anew";
                (
                    level.max(Level::Warn),
                    format!("{percent} % of the last second's frames have a full estimate, but {text}"),
                )
            }
            _ if outcomes.is_noisy() => {
                let text =
                    "joint angles are so noisy that light touches are reported less: a better hand tracker helps";
                (level, format!("estimating: {percent} % of the last second's frames have a full estimate; {text}"))
            }
            _ => (level, format!("estimating: {percent} % of the last second's frames have a full estimate")),
        };
        let frames = [
            ("frames.expected", format!("{n_expected:.0}")),
            ("frames.came", outcomes.n.to_string()),
            ("frames.with_force", outcomes.n_with_force.to_string()),
            ("frames.full_estimate", outcomes.n_good.to_string()),
            ("frames.artifact_followed", outcomes.n_followed.to_string()),
            ("frames.artifact_capped", outcomes.n_capped.to_string()),
            ("frames.artifact_noisy", outcomes.n_noisy.to_string()),
        ];
        let mut values: Vec<(String, String)> =
            core.models.iter().map(|(name, runs)| (format!("model.{name}"), runs.clone())).collect();
        values.extend(frames.map(|(name, value)| (name.to_owned(), value)));
        values.extend(outcomes.flags.iter().map(|(flag, n)| (format!("frames.{flag}"), n.to_string())));
        values.push(("calibration".to_owned(), core.calibration.clone().unwrap_or_else(|| "none".to_owned())));
        values.push(("frames_waiting".to_owned(), core.fusion.n_pending().to_string()));
        let missing: Vec<&str> = core.fusion.missing_joints().collect();
        values.push(("joints_never_seen".to_owned(), missing.join(", ")));
        values.push(("unrecorded".to_owned(), self.unrecorded.to_string()));
        for (source_idx, source) in self.engine.cfg.fusion().tactile_sources().iter().enumerate() {
            let n_outdated = self.order.n_outdated(source_idx);
            values.push((format!("tactile.{}.not_published_outdated", source.name), n_outdated.to_string()));
        }
        if let Ok(counters) = serde_json::to_value(core.fusion.counters()) {
            flatten("", &counters, &mut values);
        }
        (Status { name, level, message, values }, is_enough)
    }
}

/// Counters as dotted names and values; list entries are named by their own `name`.
fn flatten(prefix: &str, value: &serde_json::Value, values: &mut Vec<(String, String)>) {
    let below = |key: &str| if prefix.is_empty() { key.to_owned() } else { format!("{prefix}.{key}") };
    match value {
        serde_json::Value::Object(entries) => {
            entries
                .iter()
                .filter(|(key, _)| *key != "name")
                .for_each(|(key, value)| flatten(&below(key), value, values));
        }
        serde_json::Value::Array(items) => {
            for item in items {
                let name = item.get("name").and_then(serde_json::Value::as_str).unwrap_or_default();
                flatten(&below(name), item, values);
            }
        }
        serde_json::Value::Null => values.push((prefix.to_owned(), "unknown".to_owned())),
        value => values.push((prefix.to_owned(), value.to_string())),
    }
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "unknown".to_owned(), |value| format!("{value:.3}"))
}
