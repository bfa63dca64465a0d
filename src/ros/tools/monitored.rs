//! Contacts and diagnostics of a running node, as a listener keeps them.

use std::collections::{BTreeMap, VecDeque};

use crate::msg::{ContactArray, ContactState, from_cdr};
use crate::ros::node::{Health, read_diagnostics};
use crate::units::{NANOS_PER_SEC, Stamp};

/// Over how long rates and latencies are told, ns.
const SPAN_NS: i64 = 2 * NANOS_PER_SEC;

/// A region without contacts for so long is stale, s.
const SILENT_S: f64 = 0.5;

/// Diagnostics that are older than this are no longer true, s.
const LATE_S: f64 = 2.5;

/// A region in the last contacts that had it.
#[derive(Debug, Clone)]
pub struct MonitoredRegion {
    /// Its newest state.
    pub state: ContactState,
    /// Stamp of that state.
    pub stamp: Stamp,
    /// Receipt time of that state.
    pub received: Stamp,
    /// Largest force so far, at least 1 N: the scale of its bar.
    pub most: f64,
    /// How often contact began.
    pub n_onsets: u64,
}

/// Contacts and diagnostics of a node.
#[derive(Debug, Clone)]
pub struct Monitored {
    /// The topic with its contacts.
    pub topic: String,
    node: String,
    /// By name.
    pub regions: BTreeMap<String, MonitoredRegion>,
    /// When arrays came and how old they were then, s.
    arrivals: VecDeque<(Stamp, f64)>,
    /// The newest statuses of the node.
    pub diagnostics: Vec<Health>,
    /// When they came.
    diagnosed: Stamp,
    /// Why the newest message that can't be read can't be read.
    pub unreadable: Option<String>,
}

impl Monitored {
    /// Nothing has come yet from a node with contacts on `topic`.
    pub fn new(topic: &str, node: String) -> Self {
        Monitored {
            topic: topic.to_owned(),
            node,
            regions: BTreeMap::new(),
            arrivals: VecDeque::new(),
            diagnostics: Vec::new(),
            diagnosed: Stamp(0),
            unreadable: None,
        }
    }

    /// Takes a message of `~/contacts`.
    pub fn handle_contacts(&mut self, cdr: &[u8], received: Stamp) {
        let array = match from_cdr::<ContactArray>(cdr) {
            Ok(array) => array,
            Err(error) => {
                self.unreadable = Some(error.to_string());
                return;
            }
        };
        let stamp: Stamp = array.header.stamp.into();
        self.arrivals.push_back((received, received.nanos_since(stamp) as f64 / NANOS_PER_SEC as f64));
        while self.arrivals.front().is_some_and(|(at, _)| received.nanos_since(*at) > SPAN_NS) {
            self.arrivals.pop_front();
        }
        for state in array.contacts {
            let began = state.event == ContactState::ONSET;
            let force = if state.force.is_finite() { state.force } else { 0.0 };
            match self.regions.get_mut(&state.region) {
                Some(region) => {
                    region.most = region.most.max(force);
                    region.n_onsets += u64::from(began);
                    (region.state, region.stamp, region.received) = (state, stamp, received);
                }
                None => {
                    let name = state.region.clone();
                    let (most, n_onsets) = (force.max(1.0), u64::from(began));
                    self.regions.insert(name, MonitoredRegion { state, stamp, received, most, n_onsets });
                }
            }
        }
    }

    /// Takes a message of `/diagnostics`, of this node or another.
    pub fn handle_diagnostics(&mut self, cdr: &[u8], received: Stamp) {
        let node = format!("{}: ", self.node.trim_start_matches('/'));
        let of_node = |health: &Health| health.name.starts_with(&node);
        if let Some(all) = read_diagnostics(cdr) {
            let ours: Vec<Health> = all.into_iter().filter(of_node).collect();
            if !ours.is_empty() {
                (self.diagnostics, self.diagnosed) = (ours, received);
            }
        }
    }

    /// Arrays a second.
    pub fn rate_hz(&self, now: Stamp) -> f64 {
        let recent = || self.arrivals.iter().map(|(at, _)| *at).filter(|at| now.nanos_since(*at) <= SPAN_NS);
        let (Some(first), Some(last)) = (recent().min(), recent().max()) else { return 0.0 };
        // Until the newest one: a listener that looks now and then has not seen those that came since.
        let is_silent = now.nanos_since(last) as f64 > SILENT_S * NANOS_PER_SEC as f64;
        let span_ns = if is_silent { now.nanos_since(first) } else { last.nanos_since(first) };
        (recent().count() - 1) as f64 * NANOS_PER_SEC as f64 / span_ns.max(1) as f64
    }

    /// Stamp to arrival: median and 99th percentile of the last seconds, ms.
    pub fn latency_ms(&self) -> Option<(f64, f64)> {
        let mut ages: Vec<f64> = self.arrivals.iter().map(|(_, age_s)| 1e3 * age_s).collect();
        ages.sort_by(f64::total_cmp);
        let at = |part: f64| ages.get(((ages.len().max(1) - 1) as f64 * part).round() as usize).copied();
        Some((at(0.5)?, at(0.99)?))
    }

    /// True if no contacts had a region for a while.
    pub fn is_silent(&self, region: &MonitoredRegion, now: Stamp) -> bool {
        now.nanos_since(region.received) as f64 > SILENT_S * NANOS_PER_SEC as f64
    }

    /// How long ago contacts came last, s; `None` before the first.
    pub fn age_s(&self, now: Stamp) -> Option<f64> {
        let last = self.regions.values().map(|region| region.received).max()?;
        Some(now.nanos_since(last) as f64 / NANOS_PER_SEC as f64)
    }

    /// How long ago the node last said how it is, where that is too long; it does so once a second.
    pub fn diagnostics_late_s(&self, now: Stamp) -> Option<f64> {
        let age_s = now.nanos_since(self.diagnosed) as f64 / NANOS_PER_SEC as f64;
        (!self.diagnostics.is_empty() && age_s > LATE_S).then_some(age_s)
    }

    /// One line about the stream of contacts.
    pub fn headline(&self, now: Stamp) -> String {
        let latency = match self.latency_ms() {
            Some((p50, p99)) => format!("stamp to here p50 {p50:.1} ms, p99 {p99:.1} ms"),
            None => "nothing came yet".to_owned(),
        };
        format!("{}  {:.0} Hz  {latency}", self.topic, self.rate_hz(now))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::to_cdr;

    #[test]
    fn a_rate_is_that_of_what_came_until_the_newest_and_falls_once_nothing_comes() {
        let mut node = Monitored::new("/contacts", "/node".to_owned());
        let ms = |ms: i64| Stamp(ms * 1_000_000);
        assert_eq!(node.rate_hz(ms(0)), 0.0);
        let array = to_cdr(&ContactArray::default());
        (0..300).for_each(|frame| node.handle_contacts(&array, ms(10 * frame)));
        // Looked at between two messages, and by a listener that has not seen the last 120 ms.
        for now in [2990, 2995, 3110] {
            assert!((node.rate_hz(ms(now)) - 100.0).abs() < 0.1, "{} Hz", node.rate_hz(ms(now)));
        }
        let silent = node.rate_hz(ms(3990));
        assert!((40.0..60.0).contains(&silent), "{silent} Hz");
        assert_eq!(node.rate_hz(ms(5100)), 0.0);
    }
}
