//! `tpf collect`: leads a person through the collection protocol, and records it.

mod begun;
mod collection;
mod desk;
mod folder;
mod screen;

use std::path::PathBuf;

use tactile_pose_fusion::bag::quoted_path;
use tactile_pose_fusion::leave;

use super::live::RosArguments;
use super::setup::ParamArgs;
use super::{Failure, Outcome, print, say};
use crate::report::collection::clock;
use begun::Begun;
use collection::{Collection, End};
use desk::Desk;
use screen::Screen;

/// The node that collects, unless it is given another name.
const NODE: &str = "/tpf_collect";

/// Length of the protocol that --short stands for, minutes.
const SHORT_MINUTES: f64 = 10.0;

/// Leads a person with a glove through the collection protocol and records taxels, joint angles, force and annotations.
#[derive(Debug, clap::Args)]
#[command(after_help = "tpf collect --params-file glove.yaml -o anna_1 --user anna --donning 1\n\
                        tpf collect --params-file glove.yaml -o anna_1 --user anna --resume")]
pub(super) struct Args {
    #[command(flatten)]
    params: ParamArgs,
    /// Folder for this session; DIR.mcap is in it when everything was done
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// A protocol of your own; the paper's is built in (params/protocol.yaml)
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    protocol: Option<PathBuf>,
    /// The same protocol in ten minutes: fewer repetitions
    #[arg(long, conflicts_with_all = ["minutes", "resume"])]
    short: bool,
    /// The same protocol in about so many minutes, besides the checks and the known touches
    #[arg(long, value_name = "M", conflicts_with = "resume", value_parser = minutes)]
    minutes: Option<f64>,
    /// Who wears the glove, instead of `user` in the parameters
    #[arg(long, value_name = "NAME")]
    user: Option<String>,
    /// Which donning of the glove by this user
    #[arg(long, value_name = "N", default_value_t = 1, conflicts_with = "resume")]
    donning: u32,
    /// Orders poses: the same seed, user and donning, the same order
    #[arg(long, value_name = "S", default_value_t = 1, conflicts_with = "resume")]
    seed: u64,
    /// Go on with a session that was broken off
    #[arg(long)]
    resume: bool,
    /// With --resume: make the bag of what has been recorded, without doing the rest
    #[arg(long, requires = "resume")]
    finish: bool,
    /// Prompts as lines instead of a screen, without waiting between stages; what the checks find ends it, and so do known
    /// touches that are not felt
    #[arg(long)]
    plain: bool,
    /// Begin in spite of what the checks find, and go on if no known touch is felt
    #[arg(long)]
    accept_checks: bool,
    #[command(flatten)]
    ros: RosArguments,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let mut cfg = args.params.load()?;
    if let Some(user) = &args.user {
        cfg.user = Some(user.clone());
    }
    if cfg.use_sim_time {
        return Err(Failure("use_sim_time is true, but a collection needs real time; set it to false".to_owned()));
    }
    let place = args.ros.place(NODE)?;
    let begun = match args.resume {
        true => Begun::again(args, &cfg)?,
        false => Begun::anew(args, &cfg)?,
    };
    if args.finish {
        return begun.complete(&cfg);
    }
    let mut desk = Desk::open(&cfg, &place)?;
    let mut screen = Screen::open(args.plain)?;
    let mut collection = Collection::new(args, begun);
    let ended = collection.run(&mut desk, &mut screen);
    let _kept = leave::keep(); // until everything is on the disk
    drop(screen);
    let (unreadable, missed) = (std::mem::take(&mut desk.unreadable), desk.missed());
    desk.close()?;
    if missed > 0 {
        say(&format!("{missed} messages were lost because this machine was too slow; record to a faster disk"));
    }
    for (topic, (n, first)) in &unreadable {
        say(&format!("topic {topic}: {n} messages could not be read: {first}"));
    }
    match ended? {
        End::Complete => {
            collection.complete(&cfg)?;
            Ok(if unreadable.is_empty() && missed == 0 { Outcome::Done } else { Outcome::InputLost })
        }
        End::Quit => {
            let left = clock(collection.left_s());
            let folder = quoted_path(&args.output);
            let go_on = format!("tpf collect{} -o {folder} --resume", args.params.as_given());
            let end = "--finish beside --resume makes the bag of what there is";
            print(&format!("{}: {left} are left; go on with: {go_on}\n{end}\n", args.output.display()))?;
            Ok(Outcome::NotMet)
        }
        End::Unfelt(note) => Err(Failure(format!(
            "{note}. Nothing of the protocol was recorded; --resume asks for the touches again, and --accept-checks goes on without them"
        ))),
        End::NotBegun(problems) => {
            problems.iter().for_each(|problem| say(problem));
            let failed = if problems.len() == 1 {
                "a check failed".to_owned()
            } else {
                format!("{} checks failed", problems.len())
            };
            Err(Failure(format!("{failed} and nothing was recorded; --accept-checks begins all the same")))
        }
    }
}

fn minutes(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(minutes) if (0.05..=600.0).contains(&minutes) => Ok(minutes),
        _ => Err(format!("expected 0.05 to 600 minutes, got {text:?}")),
    }
}
