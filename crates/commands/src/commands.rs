//! One file a subcommand of `tpf`: parse, call, render.

mod calibrate;
#[cfg(feature = "ros")]
mod call;
mod characterize;
mod checks;
#[cfg(feature = "ros")]
mod collect;
mod completions;
mod demo;
mod diff;
#[cfg(feature = "ros")]
mod doctor;
mod eval;
mod export;
mod force;
mod in_air;
mod init;
mod inspect;
mod interrupt;
#[cfg(feature = "ros")]
mod live;
mod merge;
#[cfg(feature = "ros")]
mod monitor;
#[cfg(feature = "ros")]
mod play;
mod replay;
#[cfg(feature = "ros")]
mod run;
mod sessions;
mod setup;
mod simulate;
mod split;
#[cfg(feature = "train")]
mod train;
mod view;
mod zero;

use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::sync::OnceLock;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use tactile_pose_fusion::leave;
use tactile_pose_fusion::location;
use tactile_pose_fusion::model::first_run;
#[cfg(feature = "ros")]
use tactile_pose_fusion::protocol::Protocol;

use crate::report::said::{print, print_as_it_is, say, tell};
use crate::report::terminal::set_voice;

/// Pose-aware tactile force: taxels and joint angles in, wrench and contact out.
#[derive(Debug, Parser)]
#[command(name = "tpf", version, max_term_width = 110)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print results and warnings only, without notes and progress
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Also print how it is done, such as what runs each model
    #[arg(short, long, global = true)]
    verbose: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Args),
    Replay(replay::Args),
    #[cfg(feature = "ros")]
    Run(run::Args),
    #[cfg(feature = "ros")]
    Monitor(monitor::Args),
    #[cfg(feature = "ros")]
    Call(call::Args),
    #[cfg(feature = "ros")]
    Play(play::Args),
    Calibrate(calibrate::Args),
    Characterize(characterize::Args),
    #[cfg(feature = "ros")]
    Collect(collect::Args),
    Completions(completions::Args),
    Diff(diff::Args),
    #[cfg(feature = "ros")]
    Doctor(doctor::Args),
    Eval(Box<eval::Args>),
    Export(Box<export::Args>),
    Init(init::Args),
    Inspect(inspect::Args),
    Merge(Box<merge::Args>),
    Simulate(simulate::Args),
    #[cfg(feature = "train")]
    Train(train::Args),
    View(view::Args),
}

/// How much of a live recording may be lost when the process is killed.
#[cfg(feature = "ros")]
const FLUSH_EVERY: std::time::Duration = std::time::Duration::from_secs(1);

/// How a command ended that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Everything was done.
    Done,
    /// Everything was done, and something the user asked to be held against was not met.
    NotMet,
    /// It was done with what there was: some of the input data was lost, and the output says which.
    InputLost,
}

/// A failure, as the one line that a person reads.
#[derive(Debug)]
pub struct Failure(String);

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl<E: std::error::Error> From<E> for Failure {
    fn from(error: E) -> Self {
        Failure(error.to_string())
    }
}

/// Runs what the command line asks for. Results go to stdout, words to stderr.
///
/// # Errors
/// [`Failure`] with the one line to show.
pub fn run(cli: Cli) -> Result<Outcome, Failure> {
    set_voice(cli.quiet, cli.verbose);
    match cli.command {
        Command::Demo(args) => demo::run(&args),
        Command::Replay(args) => replay::run(&args),
        #[cfg(feature = "ros")]
        Command::Run(args) => run::run(&args),
        #[cfg(feature = "ros")]
        Command::Monitor(args) => monitor::run(&args),
        #[cfg(feature = "ros")]
        Command::Play(args) => play::run(&args),
        #[cfg(feature = "ros")]
        Command::Call(args) => call::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Characterize(args) => characterize::run(&args),
        #[cfg(feature = "ros")]
        Command::Collect(args) => collect::run(&args),
        Command::Completions(args) => completions::run(&args),
        Command::Diff(args) => diff::run(&args),
        #[cfg(feature = "ros")]
        Command::Doctor(args) => doctor::run(&args),
        Command::Eval(args) => eval::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Init(args) => init::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Merge(args) => merge::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        #[cfg(feature = "train")]
        Command::Train(args) => train::run(&args),
        Command::View(args) => view::run(&args),
    }
}

/// The process `tpf`: runs the command line and tells how it went by its exit code.
pub fn main() -> ExitCode {
    if let Some(code) = model_trial() {
        return code.into();
    }
    main_with(std::env::args_os()).into()
}

/// Runs a command line, whose first word is the name of the program; returns the exit code. For programs that hold `tpf`.
///
/// Models are tried in processes of their own where [`first_run::call`] was told which.
pub fn main_with(args: impl IntoIterator<Item = OsString>) -> u8 {
    match parse(args) {
        Ok(cli) => exit("tpf", run(cli)),
        Err(code) => code,
    }
}

/// The command line as it is parsed and shown.
fn command() -> clap::Command {
    crate::report::help::grouped(plain_command())
}

/// The command line as clap knows it, with negative numbers as values and not as flags: their range is ours to tell.
fn plain_command() -> clap::Command {
    fn with_numbers(command: clap::Command) -> clap::Command {
        command
            .mut_args(|arg| match arg.get_action().takes_values() && !arg.is_positional() {
                true => arg.allow_negative_numbers(true),
                false => arg,
            })
            .mut_subcommands(with_numbers)
    }
    with_numbers(Cli::command())
}

/// The words that this process was called with, once they are parsed.
static WORDS: OnceLock<Vec<OsString>> = OnceLock::new();

/// Parses a command line. What is asked of the command line itself, and usage errors, are printed; `Err` is the exit code.
fn parse(args: impl IntoIterator<Item = OsString>) -> Result<Cli, u8> {
    let args: Vec<OsString> = args.into_iter().map(location::in_word).collect();
    let _ = WORDS.set(args.clone()); // a process has one command line
    let parsed = command().try_get_matches_from(args).and_then(|matches| Cli::from_arg_matches(&matches));
    parsed.map_err(|error| {
        let _ = error.print(); // a closed stdout or stderr is nobody to tell
        u8::try_from(error.exit_code()).unwrap_or(2)
    })
}

/// Tries a model, where this process was called for that; where not, models are tried by such processes from now on.
fn model_trial() -> Option<u8> {
    let mut args = std::env::args_os().skip(1);
    if args.next().is_none_or(|first| first != first_run::ARGUMENT) {
        first_run::call_this_program();
        return None;
    }
    let request = args.next().unwrap_or_default();
    Some(match first_run::answer(&request.to_string_lossy()) {
        Ok(()) => 0,
        Err(line) => {
            // Whoever called has gone where nobody reads it.
            let _ = writeln!(std::io::stdout(), "{line}");
            1
        }
    })
}

/// The process `tactile_pose_fusion_node`: `tpf run` with its own arguments.
pub fn node_main() -> ExitCode {
    if let Some(code) = model_trial() {
        return code.into();
    }
    let name = "tactile_pose_fusion_node";
    if cfg!(not(feature = "ros")) {
        let missing = "this build is without the live node; build with the cargo feature `ros`";
        return exit(name, Err(Failure(missing.to_owned()))).into();
    }
    let mut args = std::env::args_os();
    let program = args.next().unwrap_or_else(|| name.into());
    let code = match parse([program, "run".into()].into_iter().chain(args)) {
        Ok(cli) => exit(name, run(cli)),
        Err(code) => code,
    };
    code.into()
}

/// The exit code of an outcome, after a failure was said.
fn exit(program: &str, outcome: Result<Outcome, Failure>) -> u8 {
    // What ended a part of the process is why it ends, however well the rest did.
    let outcome = leave::failure().map_or(outcome, |why| Err(Failure(why.to_owned())));
    match outcome {
        Ok(Outcome::Done) => 0,
        Ok(Outcome::NotMet) => 1,
        Ok(Outcome::InputLost) => 3,
        Err(failure) => {
            say(&format!("{program}: {failure}"));
            1
        }
    }
}

/// The protocol in a file of this machine, or the paper's.
#[cfg(feature = "ros")]
fn protocol(file: Option<&Path>) -> Result<Protocol, Failure> {
    let Some(file) = file else { return Ok(Protocol::paper()) };
    location::only_read_here(file).map_err(|error| Failure(format!("{}: {error}", file.display())))?;
    Ok(Protocol::load(file)?)
}

/// Refuses an output that can't be written, or that is there and is not to be replaced.
fn check_output(path: &Path, overwrite: bool) -> Result<(), Failure> {
    location::check_output(path, overwrite).map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => {
            Failure(format!("{} is there already; give another name, or --overwrite", path.display()))
        }
        _ => Failure(format!("{}: {error}", path.display())),
    })
}

/// How many there are of something: `1 message`, `2 messages`.
fn counted(n: u64, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_of_a_thing_is_no_plural() {
        assert_eq!([counted(0, "bag"), counted(1, "bag"), counted(2, "bag")], ["0 bags", "1 bag", "2 bags"]);
    }

    #[test]
    fn a_negative_number_is_a_value_of_every_option_that_takes_one() {
        let refused = |args: &[&str]| command().try_get_matches_from(args).unwrap_err().to_string();
        if cfg!(feature = "train") {
            let text = refused(&["tpf", "train", "bag", "-o", "m.onnx", "--batch", "-1"]);
            assert!(text.contains("invalid value '-1' for '--batch <N>'") && !text.contains("-- -1"), "{text}");
            let train = ["tpf", "train", "bag", "--params-file", "p.yaml", "-o", "m.onnx", "--lambda", "-1"];
            assert!(command().try_get_matches_from(train).is_ok(), "its range is for the command to say");
        }
        assert!(!refused(&["tpf", "replay", "bag", "-o", "x", "--batch", "-3"]).contains("-- -3"));
    }
}
