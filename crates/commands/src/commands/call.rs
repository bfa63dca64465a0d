//! `tpf call`: asks a running node to do something, as its services and its action offer it.

use std::path::Path;
use std::time::Duration;

use clap::ValueEnum;
use tactile_pose_fusion::config::{DEFAULT_NODE, NodeName, ParamTree, ParamValue};
use tactile_pose_fusion::location;
use tactile_pose_fusion::ros::{CallError, Caller, IN_AIR, NodeParameter};
use tactile_pose_fusion::units::NANOS_PER_SEC;

use super::live::RosArguments;
use super::monitor::seconds;
use super::{Failure, Outcome, print, say};
use crate::report::progress::Progress;

/// The node that calls, unless it is given another name.
const NODE: &str = "/tpf_call";

/// Calls a running node: zero, lifecycle, parameters.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "tpf call calibrate --seconds 10\ntpf call activate --node /left/tactile_pose_fusion\ntpf call load zero.yaml\ntpf call parameters contact.force_on 0.2"
)]
pub(super) struct Args {
    /// What the node is to do
    #[arg(value_enum, value_name = "WHAT")]
    what: What,
    /// Of load: FILE. Of parameters: nothing for all, NAME to get one, NAME VALUE to set it
    #[arg(value_name = "ARG", num_args = 0..=2, allow_negative_numbers = true)]
    args: Vec<String>,
    /// Full name of the node
    #[arg(long, value_name = "NAME", default_value = DEFAULT_NODE)]
    node: String,
    /// Of calibrate: for so long instead of calibration.duration_s of the node
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<f64>,
    /// Longest time to find the node
    #[arg(long, value_name = "S", default_value_t = 5.0, value_parser = seconds)]
    wait: f64,
    #[command(flatten)]
    ros: RosArguments,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum What {
    /// Measure the zero while the hand moves in the air; Ctrl-C cancels
    Calibrate,
    /// Measure a quick zero in two seconds
    Tare,
    /// Put a calibration file into use
    Load,
    /// Begin to publish
    Activate,
    /// Stop publishing
    Deactivate,
    /// Load models and calibration
    Configure,
    /// Unload them
    Cleanup,
    /// End the node's lifecycle; its process stays
    Shutdown,
    /// Show the lifecycle state
    State,
    /// List, get or set parameters
    Parameters,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let words: Vec<&str> = args.args.iter().map(String::as_str).collect();
    let takes = match args.what {
        What::Load => 1..=1,
        What::Parameters => 0..=2,
        _ => 0..=0,
    };
    if !takes.contains(&words.len()) || (args.seconds.is_some() && args.what != What::Calibrate) {
        return Err(Failure(format!(
            "tpf call {} takes {} after it, and --seconds is for calibrate",
            name(args.what),
            ["nothing", "FILE", "nothing, NAME, or NAME VALUE"][*takes.end()]
        )));
    }
    if let (What::Load, [file]) = (args.what, &words[..]) {
        location::only_read_here(Path::new(file)).map_err(|error| Failure(format!("{file}: {error}")))?;
    }
    let setting = match words[..] {
        [name, value] => Some((name, parsed(name, value)?)),
        _ => None,
    };
    let place = args.ros.place(NODE)?;
    let mut caller = place.call(NodeName::parse(&args.node)?, Duration::from_secs_f64(args.wait))?;
    let done = match (args.what, &setting, &words[..]) {
        (What::Calibrate, ..) => calibrate(&mut caller, args.seconds),
        (What::Tare, ..) => caller.tare(),
        (What::State, ..) => caller.state(),
        (What::Load, _, [file]) => {
            // A file that is not here may be on the machine of the node, which takes no URI.
            let here = Path::new(file).canonicalize().map(|path| path.display().to_string());
            let file = ParamValue::Str(here.unwrap_or_else(|_| (*file).to_owned()));
            caller.set_parameter("calibration.file", &file).map(|set| format!("in use: {}", value(&set)))
        }
        (What::Parameters, Some((name, value)), _) => caller.set_parameter(name, value).map(|set| line(&set)),
        (What::Parameters, None, words) => caller.parameters(&args.args).map(|all| match (&all[..], words) {
            ([one], [_]) => described(one),
            _ => all.iter().map(line).collect::<Vec<_>>().join("\n"),
        }),
        (transition, ..) => caller.change_state(name(transition)),
    };
    caller.leave();
    print(&format!("{}\n", done?))?;
    Ok(Outcome::Done)
}

fn calibrate(caller: &mut Caller, seconds: Option<f64>) -> Result<String, CallError> {
    say(IN_AIR);
    let (mut progress, mut total_ns) = (None, 0);
    let mut instruction = None::<String>;
    let result = caller.calibrate(Duration::from_secs_f64(seconds.unwrap_or(0.0)), &mut |feedback| {
        let left_ns = feedback.time_left.nanos();
        let is_new = instruction.as_ref() != Some(&feedback.instruction);
        if is_new && instruction.replace(feedback.instruction.clone()).is_some() {
            progress = None; // before a line is said
            say(&format!("now {}", feedback.instruction));
        }
        let progress = progress.get_or_insert_with(|| {
            total_ns = left_ns + NANOS_PER_SEC / 2; // the first feedback comes after half a second
            Progress::time("calibrate", Duration::from_nanos(total_ns.unsigned_abs()))
        });
        progress.set_time(Duration::from_nanos((total_ns - left_ns).unsigned_abs()));
    })?;
    let faulty = match result.faulty_taxels.len() {
        0 => String::new(),
        n => format!("\n{n} of {} taxels never changed or were not finite", result.noise.len()),
    };
    Ok(format!("{}{faulty}", result.message))
}

/// The name of a call, which for a transition is its label.
fn name(what: What) -> &'static str {
    match what {
        What::Calibrate => "calibrate",
        What::Tare => "tare",
        What::Load => "load",
        What::Activate => "activate",
        What::Deactivate => "deactivate",
        What::Configure => "configure",
        What::Cleanup => "cleanup",
        What::Shutdown => "shutdown",
        What::State => "state",
        What::Parameters => "parameters",
    }
}

/// A value as in a parameter file.
fn parsed(name: &str, value: &str) -> Result<ParamValue, Failure> {
    let mut tree = ParamTree::empty("/");
    tree.set_override(&format!("{name}:={value}"))?;
    let param = tree.get(name).ok_or_else(|| Failure(format!("{name:?} is no name of a parameter")))?;
    Ok(param.value.clone())
}

fn value(parameter: &NodeParameter) -> String {
    parameter.value.as_ref().map_or_else(|| "not set".to_owned(), ToString::to_string)
}

fn line(parameter: &NodeParameter) -> String {
    let mark = if parameter.at_run_time { "  # can be set now" } else { "" };
    format!("{}: {}{mark}", parameter.name, value(parameter))
}

fn described(parameter: &NodeParameter) -> String {
    let NodeParameter { about, limits, .. } = parameter;
    let limits = if limits.is_empty() { String::new() } else { format!("\n  {limits}") };
    format!("{}\n  {about}{limits}", line(parameter))
}
