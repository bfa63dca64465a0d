//! Problems of an input's messages, and which parameter to check.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use super::super::diagnostics::RateMeter;
use crate::fusion::{JointSample, TactileBlock};
use crate::units::Stamp;

/// Maximum number of stamps per second that are compared with the clock.
const MOST_STAMPS: usize = 1024;

/// Maximum number of publishers of a topic that are told apart per second.
const MOST_PUBLISHERS: usize = 16;

/// Messages per second from which a publisher counts as present; below, they may be late messages of one that left.
const FEW: u64 = 3;

/// Messages per second that are enough to judge a stream.
const ENOUGH: u64 = 5;

/// Maximum number of joint names kept per second.
const MOST_NAMES: usize = 256;

/// Maximum number of joint names shown.
const SHOWN: usize = 8;

/// Something wrong with an input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// The same for the same fault, whatever its numbers.
    pub kind: &'static str,
    /// The problem, and what to check.
    pub text: String,
}

/// State of an input, judged once a second.
#[derive(Debug, Clone)]
pub struct InputHealth {
    /// Its parameters: `tactile.glove`.
    key: String,
    topic: String,
    meter: RateMeter,
    newest: Option<Stamp>,
    second: Second,
    unreadable: BTreeMap<&'static str, u64>,
    /// The error of the first message that is for another source.
    for_another: Option<String>,
}

/// Data since the last judgement.
#[derive(Debug, Clone, Default)]
struct Second {
    n: u64,
    n_same: u64,
    n_zero: u64,
    n_back: u64,
    /// Delay of stamps behind the clock, ns.
    behind_ns: Vec<i64>,
    publishers: BTreeMap<[u8; 16], u64>,
    n_unreadable: u64,
    unreadable: Option<String>,
    /// Taxels per row of the newest message with a wrong number of taxels.
    other_length: Option<usize>,
    n_other_length: u64,
    /// The first row received.
    row: Vec<f32>,
    n_non_finite: u64,
    n_malformed: u64,
    /// Names of the joints received.
    names: BTreeSet<String>,
}

/// The expectations for a tactile input.
#[derive(Debug, Clone, Copy)]
pub struct TactileChange<'a> {
    /// Its taxels.
    pub n_taxels: usize,
    /// Problems that the core reports for it, each with its kind.
    pub faults: &'a [(&'static str, String)],
    /// Its zero, if there is one.
    pub zero: Option<&'a [f32]>,
    /// Messages missing by the sender's own count.
    pub n_lost: u64,
    /// Limit on the standard deviation of the time between messages, ms.
    pub max_jitter_ms: f64,
    /// Largest allowed distance of stamps from the clock, ns.
    pub max_behind_ns: i64,
}

/// The expectations for a joint input.
#[derive(Debug, Clone)]
pub struct JointChange<'a> {
    /// Joints that regions need and that were in no message of any source since the last judgement.
    pub missing: &'a [&'a str],
    /// Problem with the unit of its angles.
    pub unit: Option<String>,
    /// Largest allowed distance of stamps from the clock, ns.
    pub max_behind_ns: i64,
}

impl InputHealth {
    /// An input without any message yet.
    pub fn new(key: &str, topic: &str) -> Self {
        InputHealth {
            key: key.to_owned(),
            topic: topic.to_owned(),
            meter: RateMeter::default(),
            newest: None,
            second: Second::default(),
            unreadable: BTreeMap::new(),
            for_another: None,
        }
    }

    /// Its parameters: `tactile.glove`.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// The absolute name of its topic.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Its rate, jitter and age.
    pub fn meter(&self) -> &RateMeter {
        &self.meter
    }

    /// Messages that were not used, by reason.
    pub fn unreadable(&self) -> &BTreeMap<&'static str, u64> {
        &self.unreadable
    }

    /// Names of the joints received since the last judgement.
    pub fn names(&self) -> &BTreeSet<String> {
        &self.second.names
    }

    /// Records a message from a publisher, if the middleware reports which.
    pub fn handle_arrival(&mut self, now: Duration, publisher: Option<[u8; 16]>) {
        self.meter.handle_arrival(now);
        self.second.n += 1;
        if let Some(publisher) = publisher {
            let publishers = &mut self.second.publishers;
            if publishers.len() < MOST_PUBLISHERS || publishers.contains_key(&publisher) {
                *publishers.entry(publisher).or_default() += 1;
            }
        }
    }

    /// Records messages that can't be read; true if they are the first for this reason.
    pub fn handle_unreadable(&mut self, n: u64, reason: &'static str, text: &str) -> bool {
        self.second.n_unreadable += n;
        self.second.unreadable.get_or_insert_with(|| text.to_owned());
        let counter = self.unreadable.entry(reason).or_default();
        *counter += n;
        *counter == n
    }

    /// Records a message that is for another source of this topic.
    pub fn handle_for_another(&mut self, reason: &'static str, text: &str) {
        *self.unreadable.entry(reason).or_default() += 1;
        self.for_another.get_or_insert_with(|| text.to_owned());
    }

    /// The error of the first message that is for another source.
    pub fn for_another(&self) -> Option<&str> {
        self.for_another.as_deref()
    }

    /// Records taxels for a source with this number of taxels; `offset_ns` is added to their stamps.
    pub fn handle_taxels(&mut self, block: &TactileBlock<'_>, offset_ns: i64, n_taxels: usize) {
        self.handle_stamp(block.stamp, offset_ns, block.received);
        let second = &mut self.second;
        if block.rows.checked_mul(n_taxels) != Some(block.values.len()) {
            second.n_other_length += 1;
            second.other_length = Some(block.values.len() / block.rows.max(1));
        } else if second.row.is_empty() {
            second.row.extend_from_slice(&block.values[..n_taxels]);
        }
        second.n_non_finite += u64::from(block.values.iter().any(|value| !value.is_finite()));
    }

    /// Records joint angles; `offset_ns` is added to their stamps. `needed`: the angles of joints that are used.
    pub fn handle_joints<'n>(
        &mut self,
        sample: &JointSample<'_>,
        offset_ns: i64,
        mut needed: impl Iterator<Item = (&'n str, f64)>,
    ) {
        self.handle_stamp(sample.stamp, offset_ns, sample.received);
        let second = &mut self.second;
        second.n_malformed += u64::from(sample.names.len() != sample.positions.len());
        second.n_non_finite += u64::from(needed.any(|(_, angle)| !angle.is_finite()));
        for name in sample.names {
            if second.names.len() < MOST_NAMES && !second.names.contains(name) {
                second.names.insert(name.clone());
            }
        }
    }

    fn handle_stamp(&mut self, stamp: Stamp, offset_ns: i64, received: Stamp) {
        let second = &mut self.second;
        second.n_zero += u64::from(stamp.0 == 0);
        if let Some(newest) = self.newest {
            second.n_same += u64::from(stamp == newest);
            second.n_back += u64::from(stamp < newest);
        }
        self.newest = Some(stamp);
        if second.behind_ns.len() < MOST_STAMPS {
            second.behind_ns.push(received.nanos_since(stamp.offset(offset_ns)));
        }
    }

    /// Median delay of stamps behind the clock since the last judgement, ns.
    pub fn behind_ns(&self) -> Option<i64> {
        let mut behind = self.second.behind_ns.clone();
        behind.sort_unstable();
        behind.get(behind.len() / 2).copied()
    }

    /// Judges a tactile input, and starts a new period.
    pub fn judge_taxels(&mut self, now: Duration, limits: &TactileChange<'_>) -> Vec<Problem> {
        self.meter.poll(now);
        let mut problems = self.unreadable_problem();
        let Second { n, n_other_length, .. } = self.second;
        let (key, topic) = (&self.key, &self.topic);
        if let Some(length) = self.second.other_length {
            problems.push(Problem {
                kind: "length",
                text: format!(
                    "{n_other_length} of {n} messages on {topic} hold {length} taxels, and {key}.n_taxels is {}: correct it, or {key}.field",
                    limits.n_taxels
                ),
            });
        }
        problems.extend(self.stamp_problems(limits.max_behind_ns));
        if limits.n_lost * 100 > n {
            let text =
                format!("{} messages of {topic} were lost, by their sequence: look at the network", limits.n_lost);
            problems.push(Problem { kind: "lost", text });
        }
        problems.extend(limits.faults.iter().map(|(kind, text)| Problem { kind, text: text.clone() }));
        if let Some(factor) = limits.zero.and_then(|zero| common_factor(&self.second.row, zero)) {
            problems.push(Problem {
                kind: "scale",
                text: format!(
                    "every taxel of {topic} reads about {factor:.3} times its zero, as in another unit: correct its driver, or calibrate again"
                ),
            });
        }
        problems.extend(self.non_finite_problem("taxels"));
        problems.extend(self.publisher_problem());
        if n >= ENOUGH && self.meter.jitter_ms().is_some_and(|jitter_ms| jitter_ms > limits.max_jitter_ms) {
            let text = format!(
                "messages come unevenly on {topic}: their times deviate by {:.1} ms, and diagnostics.max_jitter_ms is {}",
                self.meter.jitter_ms().unwrap_or_default(),
                limits.max_jitter_ms
            );
            problems.push(Problem { kind: "jitter", text });
        }
        self.second = Second::default();
        problems
    }

    /// Judges a joint input, and starts a new period.
    pub fn judge_joints(&mut self, now: Duration, limits: &JointChange<'_>) -> Vec<Problem> {
        self.meter.poll(now);
        let mut problems = self.unreadable_problem();
        let Second { n, n_malformed, .. } = self.second;
        let (key, topic) = (&self.key, &self.topic);
        if n_malformed > 0 {
            let text = format!(
                "{n_malformed} of {n} messages on {topic} have another number of names than of angles: correct {key}.names or the driver"
            );
            problems.push(Problem { kind: "malformed", text });
        }
        if n > 0 && !limits.missing.is_empty() {
            let mut names: Vec<&str> = self.second.names.iter().map(String::as_str).collect();
            names.truncate(SHOWN);
            let names = if names.is_empty() { "no names at all".to_owned() } else { names.join(", ") };
            let missing = limits.missing.iter().take(SHOWN).copied().collect::<Vec<_>>().join(", ");
            problems.push(Problem {
                kind: "names",
                text: format!(
                    "no message has the joints {missing}; on {topic} are {names}: write your names in region.<name>.joints (and, in the same order, those of the model in region.<name>.model_joints), or correct the driver"
                ),
            });
        }
        problems.extend(self.stamp_problems(limits.max_behind_ns));
        problems.extend(limits.unit.iter().map(|text| Problem { kind: "unit", text: text.clone() }));
        problems.extend(self.non_finite_problem("joint angles"));
        problems.extend(self.publisher_problem());
        self.second = Second::default();
        problems
    }

    fn unreadable_problem(&self) -> Vec<Problem> {
        let Second { n, n_unreadable, unreadable, .. } = &self.second;
        let (key, topic) = (&self.key, &self.topic);
        let problem = |text: &String| Problem {
            kind: "unreadable",
            text: format!(
                "{n_unreadable} of {n} messages on {topic} can't be read: {text}: look at {key}.type and {key}.field"
            ),
        };
        unreadable.iter().map(problem).collect()
    }

    fn stamp_problems(&self, max_behind_ns: i64) -> Vec<Problem> {
        let Second { n, n_same, n_zero, n_back, .. } = self.second;
        let (key, topic) = (&self.key, &self.topic);
        let remedy = format!("set {key}.stamp to receipt, or correct the driver");
        let problem = |kind, text| vec![Problem { kind, text }];
        if n_zero * 2 > n {
            return problem("zero", format!("stamps on {topic} are 0: {remedy}"));
        }
        if n_same * 4 > n && n >= ENOUGH {
            let text = format!(
                "{n_same} of {n} messages on {topic} have the stamp of the one before, so that they are left out: {remedy}"
            );
            return problem("frozen", text);
        }
        if n_back > 0 && n_back * 50 > n {
            return problem(
                "back",
                format!("stamps on {topic} ran backwards {n_back} times in {n} messages: {remedy}"),
            );
        }
        let Some(behind_ns) = self.behind_ns().filter(|behind| behind.saturating_abs() > max_behind_ns) else {
            return Vec::new();
        };
        let way = if behind_ns > 0 { "behind" } else { "ahead of" };
        let text = format!(
            "stamps on {topic} lie {} {way} this node's clock: synchronize the clocks, look at the link, or set {key}.stamp_offset_ms or {key}.stamp",
            span(behind_ns)
        );
        problem("clock", text)
    }

    fn non_finite_problem(&self, what: &str) -> Option<Problem> {
        let Second { n, n_non_finite, .. } = self.second;
        let (key, topic) = (&self.key, &self.topic);
        (n_non_finite > 0).then(|| Problem {
            kind: "non_finite",
            text: format!("{n_non_finite} of {n} messages on {topic} hold {what} that are NaN or infinite: look at the driver of {key}"),
        })
    }

    fn publisher_problem(&self) -> Option<Problem> {
        let topic = &self.topic;
        let n_publishers = self.second.publishers.values().filter(|n| **n >= FEW).count();
        (n_publishers > 1).then(|| Problem {
            kind: "publishers",
            text: format!(
                "{n_publishers} publishers send {topic} at the same time: stop all but one, or correct {}.topic",
                self.key
            ),
        })
    }
}

/// The factor between every taxel's reading and its zero; given only if it is the same for all taxels and too far from
/// 1 to be a touch.
fn common_factor(row: &[f32], zero: &[f32]) -> Option<f64> {
    const FAR: f64 = 10.0; // a decade: units differ by at least that, and a touch is not the same everywhere
    const ALIKE: f64 = 1.5;
    if row.len() < 3 || row.len() != zero.len() {
        return None;
    }
    let mut factors: Vec<f64> =
        row.iter().zip(zero).map(|(reading, zero)| f64::from(*reading) / f64::from(*zero)).collect();
    factors.sort_unstable_by(f64::total_cmp);
    let (least, most) = (factors[0], factors[factors.len() - 1]);
    let is_same = least.is_finite() && most.is_finite() && least > 0.0 && most / least < ALIKE;
    let factor = factors[factors.len() / 2];
    (is_same && !(1.0 / FAR..=FAR).contains(&factor)).then_some(factor)
}

/// A span in words.
fn span(ns: i64) -> String {
    let seconds = ns.unsigned_abs() as f64 * 1e-9;
    match seconds {
        _ if seconds < 1.0 => format!("{:.0} ms", seconds * 1e3),
        _ if seconds < 86_400.0 => format!("{seconds:.1} s"),
        _ => format!("{:.0} days", seconds / 86_400.0),
    }
}

#[cfg(test)]
#[path = "inputs_tests.rs"]
mod tests;
