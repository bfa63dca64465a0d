//! `tpf monitor`: what a running node says, on a terminal.

use std::time::{Duration, Instant};

use ratatui::crossterm::event::KeyCode;
use tactile_pose_fusion::config::{DEFAULT_NODE, NodeName};
use tactile_pose_fusion::msg::{ContactArray, WireType};
use tactile_pose_fusion::ros::{DIAGNOSTICS_TYPE, Delivery, Monitored, TopicType, instead, system_now};

use super::live::RosArguments;
use super::{Failure, Outcome, interrupt, print};
use crate::report::monitor::{draw, text};
use crate::report::screen::Terminal;

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
    let contacts_topic = listening.subscribe(&contacts, TopicType::Known(ContactArray::TYPE_NAME), Delivery::Data)?;
    listening.subscribe("/diagnostics", TopicType::Known(DIAGNOSTICS_TYPE), Delivery::Data)?;
    let mut listener = listening.start()?;
    let mut watched = Monitored::new(&contacts, node.to_string());
    let mut terminal = Terminal::open(args.plain)?;
    let has_screen = terminal.is_some();
    let limit = args.seconds.or((!has_screen).then_some(5.0)).map(Duration::from_secs_f64);
    let started = Instant::now();
    while !interrupt::happened() && limit.is_none_or(|limit| started.elapsed() < limit) {
        let mut next = listener.next(FRAME);
        while let Some(incoming) = next {
            match incoming.cdr {
                Ok(cdr) if incoming.topic == contacts_topic => watched.handle_contacts(&cdr, incoming.received),
                Ok(cdr) => watched.handle_diagnostics(&cdr, incoming.received),
                Err(text) => watched.unreadable = Some(text),
            }
            next = listener.poll();
        }
        if let Some(terminal) = &mut terminal {
            terminal.draw(|frame| draw(frame, &watched, system_now()))?;
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
    if !has_screen || args.seconds.is_some() || watched.regions.is_empty() {
        print(&text(&watched, system_now()))?;
    }
    if !watched.regions.is_empty() {
        return Ok(Outcome::Done);
    }
    let why = match here {
        None => format!("; is the node running in this domain, and called {}?", args.node),
        Some(here) if here.contains(&args.node) => {
            format!(
                ", but node {} is there: `tpf call state` shows if it is active; if it is, its log and /diagnostics say why it publishes nothing",
                args.node
            )
        }
        Some(here) => {
            format!(", and no node {} is there: {}", args.node, instead(&here, place.environment.domain_id))
        }
    };
    Err(Failure(format!("nothing came on {contacts}{why}")))
}

pub(super) fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.1..=1e6).contains(&seconds) => Ok(seconds),
        _ => Err(format!("expected 0.1 to 1000000 s, got {text:?}")),
    }
}
