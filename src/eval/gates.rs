//! Limits that results are held against: what a release must not fall below.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::curve::Mdf;
use super::evaluation::{ContactReport, GroupScore};
use super::groups::{Group, GroupBy};
use super::metric::Metric;
use super::metrics::Score;
use super::statistics::Distribution;

/// The metric of a gate. Shares are 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GateMetric {
    /// Balanced accuracy of touch, share.
    Ba,
    /// F1 of the touch class, share.
    F1,
    /// Minimal detectable force, gF; its upper bound where the first bin is above 90 % already.
    MdfGf,
    /// Mean absolute error, gF.
    MaeGf,
    /// Coefficient of determination.
    R2,
    /// Touches detected in the air, a minute.
    FalseTouchesPerMinute,
    /// Share of the true touches that were not detected.
    MissedTouches,
    /// Median of detected onset minus true onset, ms.
    OnsetMsP50,
    /// 95th percentile of the same.
    OnsetMsP95,
    /// 95th percentile of detected offset minus true offset, ms.
    OffsetMsP95,
    /// Share of the touches detected by the base branch that the correction removed.
    RemovedTouches,
    /// Share of the touches detected by both that the correction delayed.
    DelayedTouches,
}

impl GateMetric {
    /// Its name in a file of gates.
    pub fn name(self) -> &'static str {
        match self {
            GateMetric::Ba => "ba",
            GateMetric::F1 => "f1",
            GateMetric::MdfGf => "mdf_gf",
            GateMetric::MaeGf => "mae_gf",
            GateMetric::R2 => "r2",
            GateMetric::FalseTouchesPerMinute => "false_touches_per_minute",
            GateMetric::MissedTouches => "missed_touches",
            GateMetric::OnsetMsP50 => "onset_ms_p50",
            GateMetric::OnsetMsP95 => "onset_ms_p95",
            GateMetric::OffsetMsP95 => "offset_ms_p95",
            GateMetric::RemovedTouches => "removed_touches",
            GateMetric::DelayedTouches => "delayed_touches",
        }
    }

    fn higher_is_better(self) -> bool {
        matches!(self, GateMetric::Ba | GateMetric::F1 | GateMetric::R2)
    }

    fn is_of_contacts(self) -> bool {
        !matches!(self, GateMetric::Ba | GateMetric::F1 | GateMetric::MdfGf | GateMetric::MaeGf | GateMetric::R2)
    }

    fn of_score(self, score: &Score) -> Result<f64, String> {
        let metric = |metric: Metric| match metric {
            Metric::Value(value) => Ok(value),
            Metric::Undefined { undefined } => Err(undefined.to_string()),
        };
        match self {
            GateMetric::Ba => metric(score.ba),
            GateMetric::F1 => metric(score.f1),
            GateMetric::MaeGf => metric(score.mae_gf),
            GateMetric::R2 => metric(score.r2),
            GateMetric::MdfGf => match score.mdf {
                Mdf::Crossed { force_gf, .. } => Ok(force_gf),
                Mdf::AlreadyAboveInFirstBin { centre_gf, .. } => Ok(centre_gf),
                other => Err(other.to_string()),
            },
            _ => Err("it is counted in contacts".to_owned()),
        }
    }

    fn of_contacts(self, report: &ContactReport) -> Result<f64, String> {
        let share = |part: u64, whole: u64| match whole {
            0 => Err("no touch".to_owned()),
            _ => Ok(part as f64 / whole as f64),
        };
        let found = &report.detection;
        let kept = report.preservation.as_ref().ok_or_else(|| "the model gives no base force".to_owned());
        let latency = |of: Option<Distribution>, percentile: fn(Distribution) -> f64| {
            of.map(percentile).ok_or_else(|| "no onset or offset was seen".to_owned())
        };
        match self {
            GateMetric::FalseTouchesPerMinute => {
                found.air.per_minute.value().ok_or_else(|| "no time in air".to_owned())
            }
            GateMetric::MissedTouches => share(found.n_missed, found.n_true),
            GateMetric::OnsetMsP50 => latency(found.onset_ms, |onset| onset.p50),
            GateMetric::OnsetMsP95 => latency(found.onset_ms, |onset| onset.p95),
            GateMetric::OffsetMsP95 => latency(found.offset_ms, |offset| offset.p95),
            GateMetric::RemovedTouches => kept.and_then(|kept| share(kept.n_removed, kept.n_kept + kept.n_removed)),
            GateMetric::DelayedTouches => kept.and_then(|kept| share(kept.n_delayed, kept.n_kept)),
            _ => Err("it is counted in frames".to_owned()),
        }
    }
}

/// Which groups a gate looks at; a name that is absent matches all.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Only {
    /// Glove, or glove/region where the parameters have several regions.
    pub glove: Option<String>,
    /// User.
    pub user: Option<String>,
    /// Session.
    pub session: Option<String>,
    /// Stage.
    pub stage: Option<String>,
    /// Substage.
    pub substage: Option<String>,
}

impl Only {
    fn matches(&self, group: &Group) -> bool {
        let pairs = [
            (&self.glove, &group.glove),
            (&self.user, &group.user),
            (&self.session, &group.session),
            (&self.stage, &group.stage),
            (&self.substage, &group.substage),
        ];
        pairs.into_iter().all(|(wanted, got)| wanted.is_none() || wanted == got)
    }
}

/// One line of a file of gates: limits on a metric, each group on its own.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gate {
    /// The metric that it limits.
    pub metric: GateMetric,
    /// Groups that are looked at one by one.
    #[serde(default = "by_glove")]
    pub by: GroupBy,
    /// Some of them only.
    #[serde(default)]
    pub only: Only,
    /// Free movement alone.
    #[serde(default)]
    pub free_movement: bool,
    /// Smallest value that passes.
    pub at_least: Option<f64>,
    /// Largest value that passes.
    pub at_most: Option<f64>,
    /// How much worse than the stored reference passes, in the metric's own unit.
    pub worse_by: Option<f64>,
    /// The same as a share of the reference.
    pub worse_by_share: Option<f64>,
    /// Whether a group without a value, such as one without touch, is left out; else it fails.
    #[serde(default)]
    pub skip_undefined: bool,
}

fn by_glove() -> GroupBy {
    GroupBy::Glove
}

/// A file of gates.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gates {
    /// The gates.
    pub gates: Vec<Gate>,
    /// File of the reference values, from the folder of this one; needed where a gate says `worse_by`.
    pub reference: Option<std::path::PathBuf>,
}

/// Gates that can't be meant.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("gate {number} ({metric}): {reason}")]
pub struct GateError {
    number: usize,
    metric: &'static str,
    reason: &'static str,
}

/// Scores of a model, as gates look at them.
#[derive(Debug, Clone, Copy)]
pub struct Scored<'a> {
    /// Scores of all scored frames, by the name of the kind of group.
    pub all: &'a BTreeMap<&'static str, Vec<GroupScore>>,
    /// Those of free movement.
    pub free_movement: &'a BTreeMap<&'static str, Vec<GroupScore>>,
    /// Contacts by glove.
    pub contacts: &'a BTreeMap<String, ContactReport>,
}

/// How one gate went for one group.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Check {
    /// The gate and the group; the same from run to run.
    pub name: String,
    /// The score, where there is a value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// The limit, in words.
    pub expected: String,
    /// How it went.
    #[serde(flatten)]
    pub verdict: Verdict,
}

/// How a check went.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "verdict", content = "reason", rename_all = "snake_case")]
pub enum Verdict {
    /// As wanted.
    Passed,
    /// Not as wanted: why.
    Failed(String),
    /// Not looked at: why.
    Skipped(String),
}

impl Gates {
    /// Refuses gates that can't be meant.
    ///
    /// # Errors
    /// [`GateError`] naming the first.
    pub fn check(&self) -> Result<(), GateError> {
        for (idx, gate) in self.gates.iter().enumerate() {
            let refuse = |reason| Err(GateError { number: idx + 1, metric: gate.metric.name(), reason });
            let limits = [gate.at_least, gate.at_most, gate.worse_by, gate.worse_by_share];
            if limits.iter().all(Option::is_none) {
                return refuse("expected at_least, at_most, worse_by or worse_by_share");
            }
            if limits.iter().flatten().any(|limit| !limit.is_finite()) {
                return refuse("a limit is not finite");
            }
            if [gate.worse_by, gate.worse_by_share].into_iter().flatten().any(|limit| limit < 0.0) {
                return refuse("worse_by and worse_by_share must be 0 or more");
            }
            if gate.needs_reference() && self.reference.is_none() {
                return refuse("worse_by needs a reference: FILE beside the gates");
            }
            let narrow = gate.free_movement || !matches!(gate.by, GroupBy::Glove);
            if gate.metric.is_of_contacts() && narrow {
                return refuse("contacts are counted by glove only, over all frames");
            }
        }
        Ok(())
    }

    /// Holds what a model scored against every gate. `reference` has values by the names of the checks.
    pub fn judge(&self, scored: Scored<'_>, reference: &BTreeMap<String, f64>) -> Vec<Check> {
        let mut checks = Vec::new();
        for gate in &self.gates {
            let values = gate.values(scored);
            if values.is_empty() {
                let verdict = Verdict::Failed("nothing that was scored is of this group".to_owned());
                checks.push(Check { name: gate.name("none"), value: None, expected: gate.expected(None), verdict });
            }
            checks.extend(values.into_iter().map(|(group, value)| gate.judge(&group, value, reference)));
        }
        checks
    }

    /// The values that a reference file keeps: those of the gates that are held against one.
    pub fn references(&self, scored: Scored<'_>) -> BTreeMap<String, f64> {
        let gates = self.gates.iter().filter(|gate| gate.needs_reference());
        let values = gates.flat_map(|gate| {
            gate.values(scored).into_iter().filter_map(|(group, value)| Some((gate.name(&group), value.ok()?)))
        });
        values.collect()
    }
}

impl Gate {
    fn needs_reference(&self) -> bool {
        self.worse_by.is_some() || self.worse_by_share.is_some()
    }

    fn name(&self, group: &str) -> String {
        let frames = if self.free_movement { " in free movement" } else { "" };
        format!("{}{frames}: {group}", self.metric.name())
    }

    fn values(&self, scored: Scored<'_>) -> Vec<(String, Result<f64, String>)> {
        if self.metric.is_of_contacts() {
            let wanted = |glove: &&String| self.only.glove.as_ref().is_none_or(|only| only == *glove);
            let contacts = scored.contacts.iter().filter(|(glove, _)| wanted(glove));
            return contacts.map(|(glove, report)| (glove.clone(), self.metric.of_contacts(report))).collect();
        }
        let groups = if self.free_movement { scored.free_movement } else { scored.all };
        let groups = groups.get(self.by.name()).into_iter().flatten();
        let wanted = groups.filter(|one| self.only.matches(&one.group));
        wanted.map(|one| (one.group.to_string(), self.metric.of_score(&one.score))).collect()
    }

    /// The limit that a reference makes: the worst value that passes.
    fn relative(&self, reference: f64) -> Option<f64> {
        let allowed = [self.worse_by, self.worse_by_share.map(|share| share * reference.abs())];
        let allowed = allowed.into_iter().flatten().reduce(f64::max)?;
        Some(if self.metric.higher_is_better() { reference - allowed } else { reference + allowed })
    }

    fn expected(&self, reference: Option<f64>) -> String {
        let mut parts = Vec::new();
        parts.extend(self.at_least.map(|limit| format!("at least {limit}")));
        parts.extend(self.at_most.map(|limit| format!("at most {limit}")));
        if let Some((reference, limit)) = reference.and_then(|value| Some((value, self.relative(value)?))) {
            let side = if self.metric.higher_is_better() { "at least" } else { "at most" };
            parts.push(format!("{side} {limit:.4} (reference {reference:.4})"));
        } else if self.needs_reference() {
            parts.push("as the reference".to_owned());
        }
        parts.join(", ")
    }

    fn judge(&self, group: &str, value: Result<f64, String>, reference: &BTreeMap<String, f64>) -> Check {
        let name = self.name(group);
        let known = reference.get(&name).copied();
        let expected = self.expected(known);
        let verdict = match &value {
            Err(reason) if self.skip_undefined => Verdict::Skipped(format!("no value: {reason}")),
            Err(reason) => Verdict::Failed(format!("no value: {reason}")),
            Ok(_) if self.needs_reference() && known.is_none() => {
                Verdict::Failed("the reference has no value for it; --update-refs stores one".to_owned())
            }
            Ok(value) => {
                let relative = known.and_then(|known| self.relative(known));
                let (floor, ceiling) = match self.metric.higher_is_better() {
                    true => ([self.at_least, relative], [self.at_most, None]),
                    false => ([self.at_least, None], [self.at_most, relative]),
                };
                let is_met = floor.into_iter().flatten().all(|limit| *value >= limit)
                    && ceiling.into_iter().flatten().all(|limit| *value <= limit);
                if is_met { Verdict::Passed } else { Verdict::Failed(format!("{value:.4}, expected {expected}")) }
            }
        };
        Check { name, value: value.ok(), expected, verdict }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::{Scoring, Tally};

    /// A group whose estimates are off by `error` everywhere.
    fn scored(user: &str, error: f64) -> GroupScore {
        let mut tally = Tally::new(Scoring::default());
        for idx in 0..4000 {
            let truth = if idx % 2 == 0 { 0.0 } else { f64::from(idx % 200) };
            tally.add(truth, Some(truth + error));
        }
        let group = Group { glove: Some("1".into()), user: Some(user.into()), ..Group::default() };
        GroupScore { group, score: tally.score() }
    }

    fn judge(yaml: &str, reference: &[(&str, f64)]) -> Vec<Check> {
        let gates: Gates = serde_saphyr::from_str(yaml).unwrap();
        gates.check().unwrap();
        let groups = BTreeMap::from([("user", vec![scored("a", 1.0), scored("b", 3.0)])]);
        let reference = reference.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
        let contacts = BTreeMap::new();
        gates.judge(Scored { all: &groups, free_movement: &groups, contacts: &contacts }, &reference)
    }

    #[test]
    fn each_group_is_held_against_the_limit() {
        let checks = judge("gates:\n- {metric: mae_gf, by: user, at_most: 2.0}\n", &[]);
        assert_eq!(checks.len(), 2);
        assert_eq!(checks[0].name, "mae_gf: 1 / a");
        assert_eq!(checks[0].verdict, Verdict::Passed);
        assert_eq!(checks[1].verdict, Verdict::Failed("3.0000, expected at most 2".into()));
        let checks = judge("gates:\n- {metric: mae_gf, by: user, only: {user: a}, at_most: 2.0}\n", &[]);
        assert_eq!(checks.len(), 1);
    }

    #[test]
    fn a_reference_is_a_limit_on_the_worse_side_only() {
        let yaml = "reference: r.json\ngates:\n- {metric: mae_gf, by: user, worse_by_share: 0.1}\n";
        let checks = judge(yaml, &[("mae_gf: 1 / a", 0.95), ("mae_gf: 1 / b", 2.0)]);
        assert_eq!(checks[0].verdict, Verdict::Passed);
        let Verdict::Failed(reason) = &checks[1].verdict else { panic!("{checks:?}") };
        assert_eq!(reason, "3.0000, expected at most 2.2000 (reference 2.0000)");
        let better = judge(yaml, &[("mae_gf: 1 / a", 9.0), ("mae_gf: 1 / b", 9.0)]);
        assert!(better.iter().all(|check| check.verdict == Verdict::Passed));
        let unknown = judge(yaml, &[("mae_gf: 1 / a", 9.0)]);
        assert!(matches!(&unknown[1].verdict, Verdict::Failed(reason) if reason.contains("--update-refs")));
    }

    #[test]
    fn what_has_no_value_fails_unless_it_may_be_left_out() {
        let nothing = judge("gates:\n- {metric: removed_touches, at_most: 0.05}\n", &[]);
        assert!(matches!(&nothing[0].verdict, Verdict::Failed(reason) if reason.contains("nothing")), "{nothing:?}");
        let missing = judge("gates:\n- {metric: ba, only: {user: c}, by: user, at_least: 0.5}\n", &[]);
        assert!(matches!(&missing[0].verdict, Verdict::Failed(_)));
    }

    #[test]
    fn gates_that_can_not_be_meant_are_refused() {
        for (gate, reason) in [
            ("{metric: ba}", "gate 1 (ba): expected at_least, at_most, worse_by or worse_by_share"),
            ("{metric: ba, worse_by: 0.1}", "gate 1 (ba): worse_by needs a reference: FILE beside the gates"),
            ("{metric: ba, at_least: .nan}", "gate 1 (ba): a limit is not finite"),
            (
                "{metric: onset_ms_p95, by: user, at_most: 1.0}",
                "gate 1 (onset_ms_p95): contacts are counted by glove only, over all frames",
            ),
        ] {
            let gates: Gates = serde_saphyr::from_str(&format!("gates:\n- {gate}\n")).unwrap();
            assert_eq!(gates.check().unwrap_err().to_string(), reason);
        }
    }
}
