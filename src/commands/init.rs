//! `tpf init`: a complete parameter file from what is in bags, or comes on the topics of a live graph.

#[cfg(feature = "ros")]
mod live;
mod model_file;
mod person;

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use super::progress::Shown;
use super::{Failure, Outcome, interrupt, print, say};
use crate::bag::{Recordings, printable, recordings_at};
use crate::config::{self, DEFAULT_NODE};
use crate::files;
use crate::init::{Ask, BestGuess, Document, document};
use crate::inspect::BagReport;
use person::{NoOne, Person};

/// Writes a parameter file from what is in bags, or on the topics of a live graph: topics, types, fields, rates, taxels, joints, patches, each with its reason.
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
    let output = &args.output;
    if output.exists() && !args.overwrite {
        return Err(is_there(output));
    }
    interrupt::listen();
    let Looked { bags, told: heard } = args.look()?;
    let mut outcome = Outcome::Done;
    for loss in bags.iter().flat_map(|bag| &bag.losses) {
        say(&format!("input lost: {}", printable(loss)));
        outcome = Outcome::InputLost;
    }
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let model = model_file::of(args.model.as_deref(), folder, &bags)?;
    let mut person = Person;
    let mut no_one = NoOne;
    let mut best = BestGuess;
    let ask: &mut dyn Ask = match (args.yes, std::io::stdin().is_terminal()) {
        (true, _) => &mut best,
        (false, true) => &mut person,
        (false, false) => &mut no_one,
    };
    let mut made = document(&bags, model.as_ref(), ask)?;
    if let Some(definitions) = &args.message_definitions {
        let path = model_file::relative(definitions, folder)?;
        made.text += &format!("\n    message_definitions: {}\n", crate::inspect::yaml_text(&path));
    }
    if !heard.is_empty() {
        made.text +=
            "\n# Heard on the live graph; the node's own QoS, best effort and volatile, goes with all of these:\n";
        heard.iter().for_each(|line| made.text += &format!("# {line}\n"));
    }
    refuse_what_would_not_load(&made, output)?;
    made.guesses.iter().for_each(|guess| say(&format!("guessed: {}", printable(guess))));
    write(output, made.text.as_bytes(), args.overwrite)?;
    print(&told(&made, args, model.is_some()))?;
    Ok(outcome)
}

/// What was looked at.
struct Looked {
    bags: Vec<BagReport>,
    /// What came on a live graph, a line a topic.
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
            return Ok(Looked { bags: vec![bag], told: recorded.told });
        }
        let bags = recordings(&self.bags).iter().map(|path| read(path)).collect::<Result<_, _>>()?;
        Ok(Looked { bags, told: Vec::new() })
    }
}

/// Each path, or the recordings in it where it is a folder of several files.
fn recordings(paths: &[PathBuf]) -> Vec<PathBuf> {
    let of_path = |path: &PathBuf| match recordings_at(path) {
        Ok(Recordings { paths, .. }) if !paths.is_empty() => paths,
        _ => vec![path.clone()],
    };
    paths.iter().flat_map(of_path).collect()
}

/// A file that is written loads.
fn refuse_what_would_not_load(made: &Document, output: &Path) -> Result<(), Failure> {
    let label = output.to_string_lossy();
    let tree = config::parse_param_files(&[(made.text.as_str(), label.as_ref())], DEFAULT_NODE);
    let refuse = |error: String| Failure(format!("the bags make no parameter file that loads: {error}"));
    let tree = tree.map_err(|error| refuse(error.to_string()))?;
    config::Config::from_tree(&tree).map_err(|error| refuse(error.to_string()))?;
    Ok(())
}

fn write(output: &Path, text: &[u8], overwrite: bool) -> Result<(), Failure> {
    let cannot = |error: std::io::Error| Failure(format!("{}: cannot write: {error}", output.display()));
    if overwrite {
        return files::replace(output, text).map_err(cannot);
    }
    let beside = files::written_beside(output, text).map_err(cannot)?;
    match beside.persist_noclobber(output) {
        Ok(_) => Ok(()),
        Err(failed) if failed.error.kind() == std::io::ErrorKind::AlreadyExists => Err(is_there(output)),
        Err(failed) => Err(cannot(failed.error)),
    }
}

fn is_there(output: &Path) -> Failure {
    Failure(format!("{} is there already; give another name, or --overwrite", output.display()))
}

/// What was written, and what to do with it.
fn told(made: &Document, args: &Args, has_model: bool) -> String {
    let output = args.output.display();
    let mut text = format!("{output}: patches {}; reads {}\n", made.regions.join(", "), made.topics.join(", "));
    let bag = args.bags.first().map_or_else(|| "BAG".to_owned(), |bag| bag.display().to_string());
    text += &match (has_model, made.has_truth) {
        (true, _) if args.bags.is_empty() => {
            format!(
                "next: tpf calibrate --live --params-file {output} -o zero.yaml, then tpf run --params-file {output} --calibration zero.yaml\n"
            )
        }
        (true, _) => format!("next: tpf replay {bag} --params-file {output} -o forces.mcap\n"),
        (false, true) => {
            let region = if made.regions.len() > 1 { format!(" --region {}", made.regions[0]) } else { String::new() };
            format!("next: tpf train {bag} --params-file {output}{region} -o MODEL.onnx\n")
        }
        (false, false) => "next: a model, see the file; the bags hold no true force to train one on\n".to_owned(),
    };
    text
}
