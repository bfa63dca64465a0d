//! `tpf monitor`: what a running node says, on a terminal.

mod screen;

use std::time::{Duration, Instant};

use ratatui::crossterm::event::KeyCode;

use super::live::RosArguments;
use super::terminal::Terminal;
use super::{Failure, Outcome, interrupt, print};
use crate::config::{DEFAULT_NODE, NodeName};
use crate::fusion::Flags;
use crate::msg::{ContactArray, ContactState, WireType};
use crate::ros::{DIAGNOSTICS_TYPE, Delivery, Monitored, TopicType, instead, system_now};
use crate::units::Stamp;

/// The node that monitors, unless it is given another name.
const NODE: &str = "/tpf_monitor";

/// How often the screen is drawn.
const FRAME: Duration = Duration::from_millis(100);

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
    let mut listener = listening.start()?;
    let mut watched = Monitored::new(&contacts, node.to_string());
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
    // On DDS, the graph tells which nodes there are.
    let around = if watched.regions.is_empty() { listener.around().ok() } else { None };
    let here = around.map(|around| around.fusion_nodes().into_iter().map(str::to_owned).collect::<Vec<_>>());
    listener.leave();
    if args.plain || args.seconds.is_some() || watched.regions.is_empty() {
        print(&text(&watched, system_now()))?;
    }
    if !watched.regions.is_empty() {
        return Ok(Outcome::Done);
    }
    let why = match here {
        None => format!("; is the node running in this domain, and called {}?", args.node),
        Some(here) if here.contains(&args.node) => {
            format!(", but node {} is there: `tpf call state` shows if it is active", args.node)
        }
        Some(here) => {
            format!(", and no node {} is there: {}", args.node, instead(&here, place.environment.domain_id))
        }
    };
    Err(Failure(format!("nothing came on {contacts}{why}")))
}

/// Everything as text.
fn text(watched: &Monitored, now: Stamp) -> String {
    let mut table = comfy_table::Table::new();
    table.load_style(comfy_table::presets::ASCII_MARKDOWN);
    table.set_header(["Region", "Contact", "Force N", "Base N", "Artifact N", "Pose age ms", "Onsets", "Flags"]);
    for (name, region) in &watched.regions {
        let state = &region.state;
        table.add_row([
            name.clone(),
            if state.contact { "yes" } else { "no" }.to_owned(),
            number(state.force),
            number(state.force_base),
            number(state.artifact),
            number(1e3 * state.pose_age),
            region.n_onsets.to_string(),
            flags(state, watched.is_silent(region, now)),
        ]);
    }
    let mut text = format!("{}\n", watched.headline(now));
    if !watched.regions.is_empty() {
        text += &format!("{table}\n");
    }
    if let Some(age_s) = watched.diagnostics_late_s(now) {
        text += &format!("the node said this {age_s:.0} s ago:\n");
    }
    for health in &watched.diagnostics {
        text += &format!("{} {}: {}\n", health.level, health.name, health.message);
    }
    if let Some(unreadable) = &watched.unreadable {
        text += &format!("some messages could not be read: {unreadable}\n");
    }
    text
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

pub(super) fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.1..=1e6).contains(&seconds) => Ok(seconds),
        _ => Err(format!("expected 0.1 to 1000000 s, got {text:?}")),
    }
}
