//! What `/diagnostics` says, once a second.

use std::sync::atomic::Ordering;

use super::Running;
use crate::msg::to_cdr;
use crate::ros::diagnostics::{Budget, Level, Percentiles, Status};
use crate::ros::interfaces::DiagnosticArray;

impl Running {
    /// Leaves a report to be published.
    pub(super) fn report(&mut self) {
        let now = self.engine.clock.running();
        self.meters.iter_mut().for_each(|meter| meter.poll(now));
        let mut statuses: Vec<Status> = (0..self.topics.len()).map(|input| self.input_status(input)).collect();
        statuses.push(self.latency_status());
        statuses.push(self.estimate_status());
        let hardware_id = self.engine.cfg.glove.clone().unwrap_or_default();
        let message = DiagnosticArray::new(self.engine.clock.now().into(), &hardware_id, statuses);
        self.engine.outbox.send(self.engine.outputs.diagnostics, to_cdr(&message), None);
    }

    fn name(&self, part: &str) -> String {
        format!("{}: {part}", self.engine.cfg.node.to_string().trim_start_matches('/'))
    }

    fn budget(&mut self, name: &str, kept: bool) -> Level {
        let sustained = self.engine.cfg.live.sustained;
        let budget = self.budgets.entry(name.to_owned()).or_insert_with(|| Budget::new(sustained));
        budget.handle(self.engine.clock.running(), kept)
    }

    fn input_status(&mut self, input: usize) -> Status {
        let now = self.engine.clock.running();
        let meter = &self.meters[input];
        let (rate_hz, jitter_ms, age, n_total) = (meter.rate_hz(), meter.jitter_ms(), meter.age(now), meter.n_total());
        let topic = self.topics[input].clone();
        let is_tactile = input < self.engine.cfg.fusion.tactile_sources.len();
        let limit =
            if is_tactile { self.engine.cfg.live.tactile_timeout } else { self.engine.cfg.fusion.timing.max_pose_age };
        let stopped = age.is_none_or(|age| age > limit.max(std::time::Duration::from_millis(1)));
        let steady = !is_tactile
            || jitter_ms.is_none_or(|jitter_ms| jitter_ms <= self.engine.cfg.live.max_jitter.as_secs_f64() * 1e3);
        let level = self.budget(&format!("input {topic}"), !stopped && steady);
        let (level, message) = match age {
            None => (Level::Stale, format!("nothing came on {topic} yet")),
            Some(age) if stopped => (level, format!("nothing came for {:.1} s", age.as_secs_f64())),
            _ if !steady => (level, "messages come unevenly".to_owned()),
            _ => (level, "messages come".to_owned()),
        };
        let mut values = vec![
            ("topic".to_owned(), topic.clone()),
            ("messages".to_owned(), n_total.to_string()),
            ("rate_hz".to_owned(), number(rate_hz)),
            ("jitter_ms".to_owned(), number(jitter_ms)),
            ("age_ms".to_owned(), number(age.map(|age| age.as_secs_f64() * 1e3))),
        ];
        values.extend(self.unreadable[input].iter().map(|(reason, n)| (format!("dropped.{reason}"), n.to_string())));
        Status { name: self.name(&format!("input {topic}")), level, message, values }
    }

    fn latency_status(&mut self) -> Status {
        let stats = self.engine.outbox.stats();
        let [stamp, received] = stats.take_latencies();
        let (dropped, failed) = (stats.dropped.load(Ordering::Relaxed), stats.failed.load(Ordering::Relaxed));
        let published = stats.published.load(Ordering::Relaxed);
        let limit_ms = self.engine.cfg.live.max_latency.as_secs_f64() * 1e3;
        let level = self.budget("latency", stamp.is_none_or(|stamp| stamp.p99 <= limit_ms));
        let message = match stamp {
            None => "nothing was published in the last second".to_owned(),
            Some(stamp) => format!("{:.1} ms from stamp to publish (99th percentile), budget {limit_ms} ms", stamp.p99),
        };
        let mut values = vec![
            ("published".to_owned(), published.to_string()),
            ("dropped.queue_full".to_owned(), dropped.to_string()),
            ("dropped.not_sent".to_owned(), failed.to_string()),
        ];
        for (name, percentiles) in [("stamp_to_publish_ms", stamp), ("receive_to_publish_ms", received)] {
            let part = |part: fn(Percentiles) -> f64| number(percentiles.map(part));
            values.push((format!("{name}.p50"), part(|p| p.p50)));
            values.push((format!("{name}.p99"), part(|p| p.p99)));
            values.push((format!("{name}.max"), part(|p| p.max)));
        }
        Status { name: self.name("latency"), level, message, values }
    }

    fn estimate_status(&mut self) -> Status {
        let name = self.name("estimates");
        let Some(core) = &self.core else {
            return Status { name, level: Level::Warn, message: "not configured".to_owned(), values: Vec::new() };
        };
        let n_stale =
            (0..self.engine.cfg.fusion.tactile_sources.len()).filter(|&idx| self.watchdog.is_stale(idx)).count();
        let (level, message) = match (&core.calibration, self.active) {
            (None, _) => (Level::Warn, "not calibrated: call ~/calibrate or ~/tare".to_owned()),
            (_, false) => (Level::Ok, "inactive: nothing is published".to_owned()),
            _ if n_stale > 0 => (Level::Error, format!("{n_stale} tactile sources have stopped")),
            _ => (Level::Ok, "estimating".to_owned()),
        };
        let mut values: Vec<(String, String)> =
            core.models.iter().map(|(name, runs)| (format!("model.{name}"), runs.clone())).collect();
        values.push(("calibration".to_owned(), core.calibration.clone().unwrap_or_else(|| "none".to_owned())));
        values.push(("frames_waiting".to_owned(), core.fusion.n_pending().to_string()));
        let missing: Vec<&str> = core.fusion.missing_joints().collect();
        values.push(("joints_never_seen".to_owned(), missing.join(", ")));
        values.push(("unrecorded".to_owned(), self.unrecorded.to_string()));
        if let Ok(counters) = serde_json::to_value(core.fusion.counters()) {
            flatten("", &counters, &mut values);
        }
        Status { name, level, message, values }
    }
}

/// Counters as dotted names and values; entries of lists go by their own `name`.
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
