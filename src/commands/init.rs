//! `tpf init`: a complete parameter file from what is in bags.

mod person;

use std::io::IsTerminal;
use std::path::PathBuf;

use super::progress::Shown;
use super::{Failure, Outcome, interrupt, print, say};
use crate::bag::printable;
use crate::init::{self, Ask, BestGuess, Request, Written};
use crate::inspect::{self, BagReport};
use person::{NoOne, Person};

/// Writes a parameter file from what is in bags: topics, types, fields, rates, taxels, joints, patches, each with its reason.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// MCAP or .db3 files or bag folders of one glove
    #[arg(required = true, value_name = "BAG")]
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
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let request = Request {
        output: &args.output,
        model: args.model.as_deref(),
        message_definitions: args.message_definitions.as_deref(),
        overwrite: args.overwrite,
    };
    request.check()?;
    interrupt::listen();
    let mut bags = Vec::new();
    for path in inspect::all_recordings(&args.bags) {
        bags.push(BagReport::read(&path, args.message_definitions.as_deref(), &Shown::bytes("inspect"))?);
    }
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
    let written = init::write(&bags, &request, ask)?;
    written.notes.iter().for_each(|note| say(note));
    print(&told(&written, args))?;
    Ok(outcome)
}

/// What was written, and what to do with it.
fn told(written: &Written, args: &Args) -> String {
    let made = &written.document;
    let output = args.output.display();
    let mut text = format!("{output}: patches {}; reads {}\n", made.regions.join(", "), made.topics.join(", "));
    let bag = args.bags.first().map_or_else(String::new, |bag| bag.display().to_string());
    text += &match (written.has_model, made.has_truth) {
        (true, _) => format!("next: tpf replay {bag} --params-file {output} -o forces.mcap\n"),
        (false, true) => {
            let region = if made.regions.len() > 1 { format!(" --region {}", made.regions[0]) } else { String::new() };
            format!("next: tpf train {bag} --params-file {output}{region} -o MODEL.onnx\n")
        }
        (false, false) => "next: a model, see the file; the bags hold no true force to train one on\n".to_owned(),
    };
    text
}
