//! `tpf init`: a complete parameter file from what is in bags, or comes on the topics of a live graph.

#[cfg(feature = "ros")]
mod live;
mod person;

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use tactile_pose_fusion::bag::{printable, quoted_path};
use tactile_pose_fusion::init::{self, Ask, BestGuess, Request, Written};
use tactile_pose_fusion::inspect::{self, BagReport};

use super::{Failure, Outcome, interrupt, print, say, tell};
use crate::report::progress::Shown;
use person::{NoOne, Person};

/// Writes a parameter file from what is in bags, or on the topics of a live graph: topics, types, fields, rates, taxels, joints, regions, each with its reason.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// MCAP or .db3 files or bag folders of one glove
    #[cfg_attr(feature = "ros", arg(required_unless_present = "live", value_name = "BAG"))]
    #[cfg_attr(not(feature = "ros"), arg(required = true, value_name = "BAG"))]
    bags: Vec<PathBuf>,
    /// Parameter file to write
    #[arg(short, long, value_name = "FILE", default_value = "glove.yaml")]
    output: PathBuf,
    /// Model to use: its taxels, joints and rate decide what the bags leave open
    #[arg(long, value_name = "ONNX")]
    model: Option<PathBuf>,
    /// Ask nothing: take the likeliest answer, and say so
    #[arg(short, long)]
    yes: bool,
    /// Folder with the .msg files of types that a bag doesn't define, searched before AMENT_PREFIX_PATH
    #[arg(long, value_name = "FOLDER")]
    message_definitions: Option<PathBuf>,
    /// Replace a file that is already there
    #[arg(long)]
    overwrite: bool,
    #[cfg(feature = "ros")]
    #[command(flatten)]
    live: live::LiveArgs,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let request = Request {
        output: &args.output,
        model: args.model.as_deref(),
        message_definitions: args.message_definitions.as_deref(),
        remarks: &[],
        overwrite: args.overwrite,
    };
    request.check()?;
    interrupt::listen();
    let Looked { bags, told: remarks } = args.look()?;
    let mut outcome = Outcome::Done;
    for loss in bags.iter().flat_map(|bag| &bag.losses) {
        say(&format!("input lost: {}", printable(loss)));
        outcome = Outcome::InputLost;
    }
    let mut person = Person;
    let mut no_one = NoOne;
    let mut best = BestGuess;
    let ask: &mut dyn Ask = match (args.yes, std::io::stdin().is_terminal()) {
        (true, _) => &mut best,
        (false, true) => &mut person,
        (false, false) => &mut no_one,
    };
    let written = init::write(&bags, &Request { remarks: &remarks, ..request }, ask)?;
    written.notes.iter().for_each(|note| tell(note));
    print(&told(&written, args))?;
    Ok(outcome)
}

/// The bags that were looked at, or one of a live graph.
struct Looked {
    bags: Vec<BagReport>,
    /// Topics of a live graph, a line each, for the end of the file.
    told: Vec<String>,
}

impl Args {
    /// Looks at bags, or at a live graph.
    fn look(&self) -> Result<Looked, Failure> {
        let read = |path: &Path| BagReport::read(path, self.message_definitions.as_deref(), &Shown::bytes("inspect"));
        #[cfg(feature = "ros")]
        if self.live.live {
            let recorded = live::record(&self.live, self.message_definitions.as_deref())?;
            let mut bag = read(&recorded.bag())?;
            bag.path = format!("the topics of a live graph, for {} s", self.live.seconds);
            let heading =
                "Received on the live graph; the node's own QoS, best effort and volatile, goes with all of these:";
            let told = std::iter::once(heading.to_owned()).chain(recorded.told).collect();
            return Ok(Looked { bags: vec![bag], told });
        }
        let bags = inspect::all_recordings(&self.bags).iter().map(|path| read(path)).collect::<Result<_, _>>()?;
        Ok(Looked { bags, told: Vec::new() })
    }
}

/// Lines of the file to check that are shown, at most.
const SHOWN_CHECKS: usize = 8;

/// What is marked CHECK: the values with their keys, and whole comments. A comment on a line of its own is of the next value.
fn to_check(text: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    let mut comment: Option<String> = None;
    // The keys above a line, each with how far it is indented.
    let mut above: Vec<(usize, &str)> = Vec::new();
    for (indent, line) in text.lines().map(|line| (line.len() - line.trim_start().len(), line.trim())) {
        if let Some(words) = line.strip_prefix('#') {
            match &mut comment {
                Some(comment) if !words.contains("CHECK:") => *comment += words,
                _ if words.contains("CHECK:") => found.extend(comment.replace(line.to_owned())),
                _ => {}
            }
            continue;
        }
        if line.is_empty() {
            found.extend(comment.take());
            continue;
        }
        above.retain(|(of_key, _)| *of_key < indent);
        let keys = above.iter().map(|(_, key)| *key).filter(|key| !matches!(*key, "/**" | "ros__parameters"));
        let path: String = keys.map(|key| format!("{key}.")).collect();
        above.push((indent, line.split(['#', ' ']).next().unwrap_or_default().trim_end_matches(':')));
        found.extend(comment.take().map(|comment| format!("{path}{line}  {comment}")));
        if line.contains("CHECK:") {
            found.push(path + line);
        }
    }
    found.extend(comment);
    found
}

/// A summary of the written file, and what to do next.
fn told(written: &Written, args: &Args) -> String {
    let made = &written.document;
    let (regions, topics) = (made.regions.join(", "), made.topics.join(", "));
    let mut text = format!("{}: regions {regions}; reads {topics}\n", args.output.display());
    let output = quoted_path(&args.output);
    let to_check = to_check(&made.text);
    if !to_check.is_empty() {
        text += "look at these lines:\n";
        to_check.iter().take(SHOWN_CHECKS).for_each(|line| text += &format!("  {line}\n"));
        if to_check.len() > SHOWN_CHECKS {
            text += &format!("  and {} more that are marked CHECK\n", to_check.len() - SHOWN_CHECKS);
        }
    }
    let bags: Vec<String> = inspect::all_recordings(&args.bags).iter().map(|bag| quoted_path(bag)).collect();
    let bag = bags.first().map_or("BAG", String::as_str);
    let all_bags = if bags.is_empty() { "BAG".to_owned() } else { bags.join(" ") };
    text += &match (written.has_model, made.has_truth) {
        (true, _) if args.bags.is_empty() => {
            format!(
                "next: tpf calibrate --live --params-file {output} -o zero.yaml, then tpf run --params-file {output} --calibration zero.yaml\n"
            )
        }
        (true, _) => {
            // Nothing else tells when nothing touches the glove.
            let zero = if made.has_annotations { "" } else { " --calibrate-first 10" };
            format!("next: tpf replay {bag} --params-file {output}{zero} --merge -o forces.mcap\n")
        }
        (false, true) => {
            let region = if made.regions.len() > 1 { format!(" --region {}", made.regions[0]) } else { String::new() };
            let at_rest = if made.has_annotations { "" } else { " --zero-load-below 0.1N" };
            let model = match &made.regions[..] {
                [_] => "fingertip.onnx".to_owned(), // as the file names it
                all => format!("{}.onnx", all[0]),
            };
            let model = args.output.with_file_name(model);
            let first = match args.bags.is_empty() {
                true => format!(
                    "next: record sessions with the force sensor (tpf collect --params-file {output} -o DIR, or ros2 bag record)\n"
                ),
                false => String::new(),
            };
            format!(
                "{first}next: tpf train {all_bags} --params-file {output}{region}{at_rest} -o {}\n",
                quoted_path(&model)
            )
        }
        (false, false) => format!(
            "next: a model of this glove: name it by --model, or collect data for one (tpf collect --params-file {output}); these bags hold no true force beside the taxels, so none can be trained on them\n"
        ),
    };
    text
}
