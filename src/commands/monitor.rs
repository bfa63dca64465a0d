//! `tpf monitor`: what a running node says, on a terminal.

mod screen;

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use ratatui::crossterm::event::KeyCode;

use super::live::RosArguments;
use super::terminal::Terminal;
use super::{Failure, Outcome, interrupt, print};
use crate::config::{DEFAULT_NODE, NodeName};
use crate::fusion::Flags;
use crate::msg::{ContactArray, ContactState, WireType, from_cdr};
use crate::ros::{DIAGNOSTICS_TYPE, Delivery, Health, TopicType, read_diagnostics, system_now};
use crate::units::{NANOS_PER_SEC, Stamp};

/// The node that monitors, unless it is given another name.
const NODE: &str = "/tpf_monitor";

/// How often the screen is drawn.
const FRAME: Duration = Duration::from_millis(100);

/// Over how long rates and latencies are told, ns.
const SPAN_NS: i64 = 2 * NANOS_PER_SEC;

/// A region that was not heard of for so long is stale, s.
const SILENT_S: f64 = 0.5;

/// Diagnostics that are older than this are no longer true, s.
const LATE_S: f64 = 2.5;

/// Shows force, contact, flags, rates and latency of a running node, live.
#[derive(Debug, clap::Args)]
#[command(after_help = "tpf monitor\ntpf monitor --node /left/tactile_pose_fusion --seconds 5 --plain")]
pub(super) struct Args {
    /// Full name of the node to watch
    #[arg(long, value_name = "NAME", default_value = DEFAULT_NODE)]
    node: String,
    /// Topic with its contacts, if they are remapped
    #[arg(long, value_name = "TOPIC")]
    contacts: Option<String>,
    /// End after so many seconds
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<f64>,
    /// A table at the end instead of a screen; so it is where there is no terminal
    #[arg(long)]
    plain: bool,
    #[command(flatten)]
    ros: RosArguments,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let node = NodeName::parse(&args.node)?;
    let contacts = match &args.contacts {
        Some(topic) => topic.clone(),
        None => node.resolve("~/contacts")?,
    };
    let place = args.ros.place(NODE)?;
    let mut listening = place.join()?;
    let heard_contacts = listening.hear(&contacts, TopicType::Known(ContactArray::TYPE_NAME), Delivery::Data)?;
    listening.hear("/diagnostics", TopicType::Known(DIAGNOSTICS_TYPE), Delivery::Data)?;
    let listener = listening.start()?;
    let mut watched = Watched::new(&contacts, node.to_string());
    let mut terminal = Terminal::open(args.plain)?;
    let limit = args.seconds.or(terminal.is_none().then_some(5.0)).map(Duration::from_secs_f64);
    let started = Instant::now();
    while !interrupt::happened() && limit.is_none_or(|limit| started.elapsed() < limit) {
        let mut next = listener.next(FRAME);
        while let Some(heard) = next {
            match heard.cdr {
                Ok(cdr) if heard.topic == heard_contacts => watched.handle_contacts(&cdr, heard.received),
                Ok(cdr) => watched.handle_diagnostics(&cdr, heard.received),
                Err(text) => watched.unreadable = Some(text),
            }
            next = listener.poll();
        }
        if let Some(terminal) = &mut terminal {
            terminal.draw(|frame| screen::draw(frame, &watched, system_now()))?;
            if matches!(terminal.key()?, Some(KeyCode::Char('q') | KeyCode::Esc)) {
                break;
            }
        }
    }
    drop(terminal);
    listener.leave();
    if args.plain || args.seconds.is_some() || watched.regions.is_empty() {
        print(&watched.text(system_now()))?;
    }
    match watched.regions.is_empty() {
        true => Err(Failure(format!(
            "nothing came on {contacts}; is the node running in this domain, and called {}?",
            args.node
        ))),
        false => Ok(Outcome::Done),
    }
}

/// A region as it was last heard of.
#[derive(Debug, Clone)]
struct Region {
    state: ContactState,
    stamp: Stamp,
    received: Stamp,
    /// Largest force so far, for the scale of its bar, N.
    most: f64,
    /// How often contact began.
    n_onsets: u64,
}

/// What a node was heard to say.
struct Watched {
    topic: String,
    node: String,
    regions: BTreeMap<String, Region>,
    /// When arrays came and how old they were then, s.
    arrivals: VecDeque<(Stamp, f64)>,
    diagnostics: Vec<Health>,
    /// When they came.
    diagnosed: Stamp,
    unreadable: Option<String>,
}

impl Watched {
    fn new(topic: &str, node: String) -> Self {
        Watched {
            topic: topic.to_owned(),
            node,
            regions: BTreeMap::new(),
            arrivals: VecDeque::new(),
            diagnostics: Vec::new(),
            diagnosed: Stamp(0),
            unreadable: None,
        }
    }

    fn handle_contacts(&mut self, cdr: &[u8], received: Stamp) {
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
                    self.regions.insert(name, Region { state, stamp, received, most, n_onsets });
                }
            }
        }
    }

    fn handle_diagnostics(&mut self, cdr: &[u8], received: Stamp) {
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
    fn rate_hz(&self, now: Stamp) -> f64 {
        let recent = self.arrivals.iter().filter(|(at, _)| now.nanos_since(*at) <= SPAN_NS).count();
        recent as f64 * NANOS_PER_SEC as f64 / SPAN_NS as f64
    }

    /// Stamp to arrival: median and 99th percentile of the last seconds, ms.
    fn latency_ms(&self) -> Option<(f64, f64)> {
        let mut ages: Vec<f64> = self.arrivals.iter().map(|(_, age_s)| 1e3 * age_s).collect();
        ages.sort_by(f64::total_cmp);
        let at = |part: f64| ages.get(((ages.len().max(1) - 1) as f64 * part).round() as usize).copied();
        Some((at(0.5)?, at(0.99)?))
    }

    fn is_silent(&self, region: &Region, now: Stamp) -> bool {
        now.nanos_since(region.received) as f64 > SILENT_S * NANOS_PER_SEC as f64
    }

    /// How long ago the node last said how it is, where that is too long; it does so once a second.
    fn diagnostics_late_s(&self, now: Stamp) -> Option<f64> {
        let age_s = now.nanos_since(self.diagnosed) as f64 / NANOS_PER_SEC as f64;
        (!self.diagnostics.is_empty() && age_s > LATE_S).then_some(age_s)
    }

    /// One line about the stream of contacts.
    fn headline(&self, now: Stamp) -> String {
        let latency = match self.latency_ms() {
            Some((p50, p99)) => format!("stamp to here p50 {p50:.1} ms, p99 {p99:.1} ms"),
            None => "nothing came yet".to_owned(),
        };
        format!("{}  {:.0} Hz  {latency}", self.topic, self.rate_hz(now))
    }

    /// Everything as text.
    fn text(&self, now: Stamp) -> String {
        let mut table = comfy_table::Table::new();
        table.load_style(comfy_table::presets::ASCII_MARKDOWN);
        table.set_header(["Region", "Contact", "Force N", "Base N", "Artifact N", "Pose age ms", "Onsets", "Flags"]);
        for (name, region) in &self.regions {
            let state = &region.state;
            table.add_row([
                name.clone(),
                if state.contact { "yes" } else { "no" }.to_owned(),
                number(state.force),
                number(state.force_base),
                number(state.artifact),
                number(1e3 * state.pose_age),
                region.n_onsets.to_string(),
                flags(state, self.is_silent(region, now)),
            ]);
        }
        let mut text = format!("{}\n", self.headline(now));
        if !self.regions.is_empty() {
            text += &format!("{table}\n");
        }
        if let Some(age_s) = self.diagnostics_late_s(now) {
            text += &format!("the node said this {age_s:.0} s ago:\n");
        }
        for health in &self.diagnostics {
            text += &format!("{} {}: {}\n", health.level, health.name, health.message);
        }
        if let Some(unreadable) = &self.unreadable {
            text += &format!("some messages could not be read: {unreadable}\n");
        }
        text
    }
}

fn number(value: f64) -> String {
    let value = if value.abs() < 0.005 { 0.0 } else { value }; // no -0.00
    if value.is_finite() { format!("{value:.2}") } else { "-".to_owned() }
}

/// The names of the flags that are set.
fn flags(state: &ContactState, is_silent: bool) -> String {
    let set = Flags::from_bits(state.flags);
    let names = Flags::names().filter(|(flag, _)| set.contains(*flag)).map(|(_, name)| name);
    names.chain(is_silent.then_some("SILENT")).collect::<Vec<_>>().join(" ")
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.1..=1e6).contains(&seconds) => Ok(seconds),
        _ => Err(format!("expected 0.1 to 1000000 s, got {text:?}")),
    }
}
