//! Inputs and frames since the last report, and their problems: for the node, and for a tool that reads its inputs.

use std::collections::BTreeSet;
use std::time::Duration;

use super::health::{Announcer, InputHealth, JointChange, Outcomes, Problem, TactileChange};
use crate::config::Config;
use crate::fusion::{Estimate, Event, Flags, Fusion, JointSource, SourceFault, TactileSource, TactileSourceIdx};
use crate::msg::AngleWatch;
use crate::msg::binding::SampleBinding;
use crate::ros::wire::graph::{Endpoint, Wanted, why_not_received};
use crate::ros::wire::middleware::Neighbours;
use crate::units::{NANOS_PER_SEC, Stamp, nanos};

/// Time for discovery before the node reports that nobody is there.
const DISCOVERY: Duration = Duration::from_secs(3);

/// Interval between two looks at the other entities in the graph.
const LOOK_EVERY: Duration = Duration::from_secs(2);

/// How long an input must be silent before that is a separate problem; its statistics show it at once.
const STOPPED: Duration = Duration::from_millis(500);

/// Inputs and frames since the last report.
pub struct Watched {
    pub(crate) inputs: Vec<InputHealth>,
    pub(crate) outcomes: Outcomes,
    /// `[regions]`: frames until the window is full again after a new zero.
    renewing: Vec<usize>,
    pub(crate) announcer: Announcer,
    wanted: Vec<Wanted>,
    tactile: Vec<TactileSource>,
    joints: Vec<JointSource>,
    /// One per joint source: the joints that are needed.
    angles: Vec<AngleWatch>,
    needed: BTreeSet<String>,
    publishers: Option<Vec<Endpoint>>,
    subscriptions: Vec<Endpoint>,
    looked: Option<Duration>,
    /// Time when the node was configured.
    begun: Duration,
    /// Start of the time in which artifacts have been at their limit of distance from the calibration.
    capped_since: Option<Duration>,
    reported: Duration,
    /// Messages lost by the sender's own count until the last report, by tactile source.
    lost: Vec<u64>,
    /// Time on `/clock` at the last report.
    clock: Option<Stamp>,
}

/// How long an input may be silent: after that its frames lack an estimate.
pub(super) fn timeout(cfg: &Config, input_idx: usize) -> Duration {
    let is_tactile = input_idx < cfg.fusion().tactile_sources().len();
    if is_tactile { cfg.live.tactile_timeout } else { cfg.fusion().timing().shortest_hold() }
}

impl Watched {
    /// The inputs of a configuration with the requirements of their sources, in any order.
    pub fn new(cfg: &Config, wanted: impl IntoIterator<Item = Wanted>) -> Self {
        let tactile = cfg.fusion().tactile_sources().iter().map(|source| format!("tactile.{}", source.name));
        let keys: Vec<String> =
            tactile.chain(cfg.fusion().joint_sources().iter().map(|source| format!("joint.{}", source.name))).collect();
        let mut wanted: Vec<Wanted> = wanted.into_iter().collect();
        wanted.sort_by_key(|wanted| keys.iter().position(|key| *key == wanted.key));
        Watched {
            inputs: wanted.iter().map(|wanted| InputHealth::new(&wanted.key, &wanted.topic)).collect(),
            angles: cfg.fusion().joint_sources().iter().map(|source| AngleWatch::new(source.scale)).collect(),
            outcomes: Outcomes::default(),
            renewing: vec![0; cfg.fusion().regions().len()],
            announcer: Announcer::default(),
            wanted,
            tactile: cfg.fusion().tactile_sources().to_vec(),
            joints: cfg.fusion().joint_sources().to_vec(),
            needed: cfg.needed_joints(),
            publishers: None,
            subscriptions: Vec::new(),
            looked: None,
            begun: Duration::ZERO,
            reported: Duration::ZERO,
            capped_since: None,
            lost: vec![0; cfg.fusion().tactile_sources().len()],
            clock: None,
        }
    }

    /// Records that the node was configured, with a core that has received no input yet.
    pub(crate) fn begin(&mut self, now: Duration) {
        (self.begun, self.reported) = (now, now);
        self.outcomes = Outcomes::default();
        self.renewing.fill(0);
        self.lost.fill(0);
        self.capped_since = None;
    }

    /// Records a new zero: windows begin anew, which is no fault of the inputs for as many frames as they have.
    ///
    /// # Shapes
    /// `windows`: `[regions]`, frames.
    pub(crate) fn handle_zero(&mut self, windows: impl Iterator<Item = usize>) {
        self.renewing.iter_mut().zip(windows).for_each(|(renewing, window)| *renewing = window);
    }

    /// Records the outcome of a frame.
    pub(crate) fn handle_estimate(&mut self, estimate: &Estimate) {
        let renewing = self.renewing.get_mut(estimate.region.position());
        match renewing.filter(|renewing| **renewing > 0) {
            Some(renewing) if estimate.flags.contains(Flags::WARMUP) => {
                *renewing -= 1;
                self.outcomes.n_renewed += 1;
            }
            Some(renewing) => {
                *renewing = 0;
                self.outcomes.handle(estimate);
            }
            None => self.outcomes.handle(estimate),
        }
    }

    /// How long artifacts have been at their limit of distance from the calibration, by the frames of a report.
    pub(crate) fn capped_for(&mut self, now: Duration, outcomes: &Outcomes) -> Option<Duration> {
        self.capped_since = outcomes.is_capped().then(|| self.capped_since.unwrap_or(now));
        self.capped_since.map(|since| now.saturating_sub(since))
    }

    /// The index of the input of a binding's source: tactile sources first, then joint sources.
    pub(crate) fn source_of(&self, binding: &SampleBinding) -> usize {
        match binding {
            SampleBinding::Taxels(source, _) => source.position(),
            SampleBinding::Joints(source, _) | SampleBinding::Frames(source, _) => {
                self.tactile.len() + source.position()
            }
        }
    }

    /// Records the content of a message.
    pub(crate) fn handle(&mut self, event: &Event<'_>) {
        match event {
            Event::Tactile(block) => {
                let source = &self.tactile[block.source.position()];
                self.inputs[block.source.position()].handle_taxels(block, source.stamp_offset_ns, source.n_taxels);
            }
            Event::Joints(sample) => {
                let source = &self.joints[sample.source.position()];
                let needed = &self.needed;
                let angles = sample.names.iter().map(String::as_str).zip(sample.positions.iter().copied());
                let angles = angles.filter(|(name, _)| needed.contains(*name));
                self.angles[sample.source.position()].handle(angles.clone());
                self.inputs[self.tactile.len() + sample.source.position()].handle_joints(
                    sample,
                    source.stamp_offset_ns,
                    angles,
                );
            }
        }
    }

    /// Frames since the last report and the expected number of frames; starts a new report.
    pub(crate) fn take_outcomes(&mut self, now: Duration, core: &Fusion) -> (Outcomes, f64) {
        let elapsed_s = now.saturating_sub(self.reported).as_secs_f64();
        self.reported = now;
        let n_expected = core.contracts().map(|contract| elapsed_s * contract.rate_hz).sum();
        (std::mem::take(&mut self.outcomes), n_expected)
    }

    /// Looks at the other entities in the graph, now and then.
    pub(in crate::ros) fn look_around(&mut self, now: Duration, neighbours: Option<&Neighbours>) {
        let Some(neighbours) = neighbours else { return };
        if self.looked.is_some_and(|looked| now.saturating_sub(looked) < LOOK_EVERY) {
            return;
        }
        self.looked = Some(now);
        self.publishers = Some(neighbours.publishers());
        self.subscriptions = neighbours.subscriptions();
    }

    /// The current problems of each input. `[inputs]`
    pub(crate) fn judge(&mut self, now: Duration, cfg: &Config, core: Option<&Fusion>) -> Vec<Vec<Problem>> {
        let came: BTreeSet<String> = self.inputs.iter().flat_map(|input| input.names()).cloned().collect();
        let missing: Vec<&str> = self.needed.iter().filter(|name| !came.contains(*name)).map(String::as_str).collect();
        let max_latency_ns = nanos(cfg.live.max_latency);
        let mut judged = Vec::new();
        for (input_idx, input) in self.inputs.iter_mut().enumerate() {
            let mut problems = match self.tactile.get(input_idx) {
                Some(source) => {
                    let lost = core.map_or(0, |core| core.counters().tactile[input_idx].counts.lost_messages);
                    let n_lost = lost.saturating_sub(self.lost[input_idx]);
                    self.lost[input_idx] = lost;
                    let faults: Vec<(&'static str, String)> =
                        core.map_or_else(Vec::new, |core| faults(core, &source.name));
                    let zero = core.and_then(|core| core.baseline(TactileSourceIdx::at(input_idx)));
                    input.judge_taxels(
                        now,
                        &TactileChange {
                            n_taxels: source.n_taxels,
                            faults: &faults,
                            zero: zero.map(|zero| zero.median.as_slice()),
                            n_lost,
                            max_jitter_ms: cfg.live.max_jitter.as_secs_f64() * 1e3,
                            max_behind_ns: max_latency_ns,
                        },
                    )
                }
                None => {
                    let angles = &mut self.angles[input_idx - self.tactile.len()];
                    let unit = angles.doubt(input.key());
                    angles.begin_count();
                    let max_behind_ns = max_latency_ns.max(nanos(cfg.fusion().timing().shortest_hold()));
                    input.judge_joints(now, &JointChange { missing: &missing, unit, max_behind_ns })
                }
            };
            if problems.iter().any(|problem| problem.kind == "publishers") {
                problems.retain(|problem| problem.kind != "rate"); // of all of them together
            }
            let limit = timeout(cfg, input_idx);
            let wanted = &self.wanted[input_idx];
            let why = |publishers: &Option<Vec<Endpoint>>| match publishers {
                Some(publishers) => wanted.why_absent(publishers),
                None => format!("start its driver, or correct {}.topic", wanted.key),
            };
            let topic = &wanted.topic;
            match input.meter().age(now) {
                None if now.saturating_sub(self.begun) >= DISCOVERY => {
                    let other =
                        |text| format!("nothing for {} came on {topic} yet: {text}: correct its only", wanted.key);
                    let absent = || format!("nothing came on {topic} yet: {}", why(&self.publishers));
                    let text = input.for_another().map_or_else(absent, other);
                    problems.push(Problem { kind: "absent", text });
                }
                Some(age) if age > limit.max(STOPPED) => {
                    let age_s = age.as_secs_f64();
                    let text = format!("nothing came on {topic} for {age_s:.1} s: {}", why(&self.publishers));
                    problems.insert(0, Problem { kind: "stopped", text });
                }
                _ => {}
            }
            let other = self.publishers.as_ref().and_then(|publishers| wanted.other_definition(publishers));
            problems.extend(other.map(|text| Problem { kind: "definition", text }));
            judged.push(problems);
        }
        judged
    }

    /// Problems in the graph around the node's outputs.
    pub(super) fn judge_graph(&self, offers: &[(String, ros2_client::QosProfile)]) -> Vec<Problem> {
        let mut problems = Vec::new();
        let others = self.publishers.iter().flatten();
        if let Some((topic, _)) = offers.iter().find(|(topic, _)| others.clone().any(|other| other.topic == *topic)) {
            let text = format!(
                "somebody else publishes {topic}, too: stop that node, or give one of both another name or namespace (-r __ns:=/left)"
            );
            problems.push(Problem { kind: "publishers", text });
        }
        let unheard = offers.iter().find_map(|(topic, qos)| why_not_received(topic, qos, &self.subscriptions));
        problems.extend(unheard.map(|text| Problem { kind: "subscribers", text }));
        problems
    }

    /// Problem with the time on `/clock`, at `time` of it.
    pub(crate) fn judge_clock(&mut self, time: Option<Stamp>) -> Option<Problem> {
        let time = time?;
        let before = self.clock.replace(time);
        let text = match before {
            _ if time.0 == 0 => {
                "use_sim_time is true and nothing comes on /clock: start what publishes it, or set use_sim_time to false"
            }
            Some(before) if before == time => "the time of /clock stands still",
            Some(before) if time < before.offset(-NANOS_PER_SEC) => "the time of /clock jumped back",
            _ => return None,
        };
        Some(Problem { kind: "clock", text: text.to_owned() })
    }
}

/// Problems that the core reports for a tactile source, each with its kind.
fn faults(core: &Fusion, source: &str) -> Vec<(&'static str, String)> {
    let fault = |fault: SourceFault<'_>| {
        let (of, kind) = match &fault {
            SourceFault::Frozen(of) => (*of, "repeats"),
            SourceFault::Interleaved(of) => (*of, "interleaved"),
            SourceFault::Stuck(of, _) => (*of, "stuck"),
            SourceFault::Rate(rate) => (rate.source, "rate"),
        };
        (of == source).then(|| (kind, fault.to_string()))
    };
    core.source_faults().into_iter().filter_map(fault).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{self, DEFAULT_NODE};
    use crate::units::Newton;

    #[test]
    fn a_new_zero_excuses_a_window_of_frames_and_no_gap_after_it() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("params/glove1.yaml");
        let cfg = config::load(&path, DEFAULT_NODE).unwrap();
        let mut watched = Watched::new(&cfg, []);
        let warming = Estimate { flags: Flags::WARMUP, ..Estimate::default() };
        let good = Estimate { force: Some(Newton(0.0)), ..Estimate::default() };
        let counted = |watched: &mut Watched, estimates: &[(usize, Estimate)]| {
            for (n, estimate) in estimates {
                (0..*n).for_each(|_| watched.handle_estimate(estimate));
            }
            let outcomes = std::mem::take(&mut watched.outcomes);
            (outcomes.n_renewed, outcomes.n, outcomes.n_good)
        };
        assert_eq!(counted(&mut watched, &[(10, warming)]), (0, 10, 0), "nobody asked for it");
        watched.handle_zero([64].into_iter());
        assert_eq!(counted(&mut watched, &[(63, warming), (37, good)]), (63, 37, 37));
        assert_eq!(counted(&mut watched, &[(20, warming), (80, good)]), (0, 100, 80), "a gap after it");
        // Gaps that let no window fill are not excused for longer than a window.
        watched.handle_zero([64].into_iter());
        assert_eq!(counted(&mut watched, &[(100, warming)]), (64, 36, 0));
    }
}
