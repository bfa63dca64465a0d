//! `tpf calibrate`: the zero-load baseline of a bag, or of a glove that is worn now, kept in a file.

#[cfg(feature = "ros")]
mod live;
#[cfg(feature = "ros")]
mod press;

use std::path::PathBuf;

use tactile_pose_fusion::calibrate::{self, Calibrated, Request};
use tactile_pose_fusion::calibration::Calibration;
use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::recording::ToldTouch;
use tactile_pose_fusion::sessions::{KnownForces, RegionTouches};

use super::force::number;
use super::in_air::InAirArgs;
use super::setup::{ModelArgs, ParamArgs, shown};
use super::{Failure, Outcome, interrupt, print};
use crate::report::progress::Said;

/// Takes the zero-load baseline from bags, checks that the models read no force in it, and keeps it in a file.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// MCAP or .db3 file or bag folder: one recording; several are parts of one, merged by time
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
    #[command(flatten)]
    in_air: InAirArgs,
    /// Also fit the factor of the forces in this donning to touches of the load cell, in the bag or live: at least three, of
    /// 30 gF or more, each held for 0.1 s
    #[arg(long, conflicts_with = "touch")]
    touches: bool,
    /// The same by touches whose force you know, from a kitchen scale or a weight: the force in gF or N, and from when to when
    /// it was held, in seconds from the begin of the bag; one --touch for each, at least three
    #[arg(long, value_name = "[REGION:]FORCE@FROM-TO", value_parser = touch)]
    #[cfg_attr(feature = "ros", arg(conflicts_with = "live"))]
    touch: Vec<AskedTouch>,
    #[cfg(feature = "ros")]
    #[command(flatten)]
    live: live::LiveArgs,
}

/// A touch as the command line tells it.
#[derive(Debug, Clone, PartialEq)]
struct AskedTouch {
    region: Option<String>,
    told: ToldTouch,
}

fn touch(text: &str) -> Result<AskedTouch, String> {
    let expected =
        || format!("expected a force and when it was held, such as 200gF@12.5-15 or thumb:2N@3-4, got {text:?}");
    let (region, rest) = match text.split_once(':') {
        Some((region, rest)) => (Some(region.to_owned()), rest),
        None => (None, text),
    };
    let (force, span) = rest.split_once('@').ok_or_else(expected)?;
    let (from, to) = span.split_once('-').ok_or_else(expected)?;
    match (super::force::force(force), number(from), number(to)) {
        (Some(force), Some(from_s), Some(to_s)) if force.0 > 0.0 && from_s < to_s => {
            Ok(AskedTouch { region, told: ToldTouch { force, from_s, to_s } })
        }
        _ => Err(expected()),
    }
}

/// Where the forces of touches are known from, if they are asked for.
fn known_forces(args: &Args, cfg: &Config) -> Result<Option<KnownForces>, Failure> {
    if args.touches {
        return Ok(Some(KnownForces::Sensor));
    }
    let only = match cfg.fusion().regions() {
        [only] => Some(&only.name),
        _ => None,
    };
    let told = args.touch.iter().map(|asked| {
        let region = asked.region.as_ref().or(only).cloned();
        let missing =
            || Failure("--touch: the parameters have several regions; name one, as in thumb:200gF@12-15".to_owned());
        Ok((region.ok_or_else(missing)?, asked.told))
    });
    let told: Vec<_> = told.collect::<Result<_, Failure>>()?;
    Ok((!told.is_empty()).then_some(KnownForces::Told(told)))
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    let mut cfg = args.params.load()?;
    args.models.apply(&mut cfg)?;
    Calibration::check_new(&args.output)?;
    #[cfg(feature = "ros")]
    if args.live.live {
        return live::run(args, cfg);
    }
    interrupt::listen();
    let known_forces = known_forces(args, &cfg)?;
    let request = Request { bags: &args.bags, first_s: args.calibrate_first, in_air: args.in_air.told(), known_forces };
    let Calibrated { calibration, from, touches } = calibrate::run(cfg.clone(), &request, &Said)?;
    calibration.save(&args.output)?;
    let mut text = format!("{}: zero from {}\n", shown(&args.output), from);
    text += &verdict(&calibration);
    text += &gains_text(&touches, &cfg);
    print(&text)?;
    Ok(Outcome::Done)
}

/// The force gains from known touches, a line a region.
fn gains_text(touches: &[RegionTouches], cfg: &Config) -> String {
    touches.iter().map(|found| format!("  {}\n", found.text(cfg))).collect()
}

/// A verdict on a calibration, for a person.
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
