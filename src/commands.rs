//! One file a subcommand of `tpf`: parse, call, render.

mod calibrate;
mod characterize;
mod checks;
#[cfg(feature = "ros")]
mod collect;
mod demo;
mod diff;
mod eval;
mod export;
mod inspect;
mod interrupt;
#[cfg(feature = "ros")]
mod live;
#[cfg(feature = "ros")]
mod monitor;
#[cfg(feature = "ros")]
mod play;
mod progress;
mod replay;
#[cfg(feature = "ros")]
mod run;
mod sessions;
mod setup;
mod simulate;
mod split;
mod summary;
#[cfg(feature = "ros")]
mod terminal;
#[cfg(feature = "train")]
mod train;
mod zero;

use std::io::Write;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Pose-aware tactile force: taxels and joint angles in, wrench and contact out.
#[derive(Debug, Parser)]
#[command(name = "tpf", version, max_term_width = 110)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
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
    Play(play::Args),
    Calibrate(calibrate::Args),
    Characterize(characterize::Args),
    #[cfg(feature = "ros")]
    Collect(collect::Args),
    Diff(diff::Args),
    Eval(Box<eval::Args>),
    Export(Box<export::Args>),
    Inspect(inspect::Args),
    Simulate(simulate::Args),
    #[cfg(feature = "train")]
    Train(train::Args),
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
    match cli.command {
        Command::Demo(args) => demo::run(&args),
        Command::Replay(args) => replay::run(&args),
        #[cfg(feature = "ros")]
        Command::Run(args) => run::run(&args),
        #[cfg(feature = "ros")]
        Command::Monitor(args) => monitor::run(&args),
        #[cfg(feature = "ros")]
        Command::Play(args) => play::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Characterize(args) => characterize::run(&args),
        #[cfg(feature = "ros")]
        Command::Collect(args) => collect::run(&args),
        Command::Diff(args) => diff::run(&args),
        Command::Eval(args) => eval::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        #[cfg(feature = "train")]
        Command::Train(args) => train::run(&args),
    }
}

/// What `tpf` does as a process: runs the command line and tells how it went by its exit code.
pub fn main() -> ExitCode {
    // clap prints usage errors itself and leaves with 2.
    exit("tpf", run(Cli::parse()))
}

/// What `tactile_pose_fusion_node` does as a process: `tpf run` with its own arguments.
pub fn node_main() -> ExitCode {
    let name = "tactile_pose_fusion_node";
    if cfg!(not(feature = "ros")) {
        let missing = "this build is without the live node; build with the cargo feature `ros`";
        return exit(name, Err(Failure(missing.to_owned())));
    }
    let mut args = std::env::args_os();
    let program = args.next().unwrap_or_else(|| name.into());
    exit(name, run(Cli::parse_from([program, "run".into()].into_iter().chain(args))))
}

fn exit(program: &str, outcome: Result<Outcome, Failure>) -> ExitCode {
    match outcome {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::NotMet) => ExitCode::from(1),
        Ok(Outcome::InputLost) => ExitCode::from(3),
        Err(failure) => {
            say(&format!("{program}: {failure}"));
            ExitCode::from(1)
        }
    }
}

/// Writes a result to stdout. A reader that has gone away (`| head`) is no failure of ours.
fn print(text: &str) -> Result<(), Failure> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(Failure(format!("stdout: {error}"))),
        _ => Ok(()),
    }
}

/// Says something to the person at the terminal; a closed stderr is nobody to tell.
pub(crate) fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}
