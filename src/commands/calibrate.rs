//! `tpf calibrate`: the zero-load baseline of a bag, or of a glove that is worn now, kept in a file.

#[cfg(feature = "ros")]
mod live;

use std::path::PathBuf;

use super::setup::{ModelArgs, ParamArgs, input_topics, load_models, shown};
use super::zero::ZeroArgs;
use super::{Failure, Outcome, print, say};
use crate::bag::{BagReader, Input, Inputs};
use crate::calibration::Calibration;
use crate::fusion::Fusion;
use crate::glove::known;

/// Takes the zero-load baseline from bags, checks that the models read no force in it, and keeps it in a file.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// MCAP file or bag folder: one recording; several are parts of one, merged by time
    #[cfg_attr(feature = "ros", arg(required_unless_present = "live", value_name = "BAG"))]
    #[cfg_attr(not(feature = "ros"), arg(required = true, value_name = "BAG"))]
    bags: Vec<PathBuf>,
    #[command(flatten)]
    params: ParamArgs,
    /// Calibration file to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    models: ModelArgs,
    /// Take the first seconds, in which nothing may touch the glove, instead of annotated zero-load stretches
    #[arg(long, value_name = "SECONDS", value_parser = super::zero::seconds)]
    calibrate_first: Option<f64>,
    #[cfg(feature = "ros")]
    #[command(flatten)]
    live: live::LiveArgs,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let mut cfg = args.params.load()?;
    args.models.apply(&mut cfg)?;
    cfg.calibration.file = None; // a new calibration doesn't start from the old one
    #[cfg(feature = "ros")]
    if args.live.live {
        return live::run(args, cfg);
    }
    let models = load_models(&cfg)?;
    let mut zero = ZeroArgs::first(args.calibrate_first).find(&cfg, &args.bags, &models.infos)?;
    let calibration = zero.to_calibration(&cfg, &known(&cfg, &models.infos).hashes);
    let mut fusion = Fusion::new(cfg.fusion.clone(), models.regressors)?;
    zero.install(&mut fusion)?;
    if let Some(mut check) = zero.check.take() {
        let mut reader = BagReader::open(&args.bags)?;
        let mut inputs = Inputs::new(input_topics(&cfg), &mut reader)?;
        'calibration: while let Some(message) = reader.next_message()? {
            for part in inputs.parts(message.channel)? {
                let Input::Event(event) = inputs.decode(&message, part) else { continue };
                fusion.handle(event);
                while let Some(tick) = fusion.poll()? {
                    if !check.takes(tick) {
                        break 'calibration;
                    }
                }
            }
        }
        check.judge(&cfg)?.iter().for_each(|note| say(note));
    }
    calibration.save(&args.output)?;
    let mut text = format!("{}: zero from {}\n", shown(&args.output), zero.from);
    text += &verdict(&calibration);
    print(&text)?;
    Ok(Outcome::Done)
}

/// What a person should make of a calibration.
fn verdict(calibration: &Calibration) -> String {
    let mut text = String::new();
    for (name, baseline) in &calibration.sources {
        let faulty: Vec<String> =
            (0..baseline.faulty.len()).filter(|&idx| baseline.faulty[idx]).map(|idx| idx.to_string()).collect();
        let dead = if faulty.is_empty() { "none".to_owned() } else { faulty.join(", ") };
        text += &format!("  tactile {name}: {} taxels, never moved: {dead}\n", baseline.median.len());
    }
    let faulty = calibration.sources.values().any(|baseline| baseline.faulty.contains(&true));
    text += match faulty {
        false => "  good: nothing was touched, and every taxel is alive\n",
        true => {
            "  usable: nothing was touched, but estimates of taxels that never moved will be flagged FAULTY_TAXEL\n"
        }
    };
    text
}
