//! A calibration from live topics, as `~/calibrate` of the node makes it, without a node.

use std::time::{Duration, Instant};

use super::super::live::RosArguments;
use super::super::progress::Progress;
use super::super::setup::{load_models, shown};
use super::super::zero::{self, Zero, ZeroFrom};
use super::super::{Failure, Outcome, interrupt, print, say};
use super::{Args, verdict};
use crate::config::Config;
use crate::fusion::Fusion;
use crate::ros::definitions::Definitions;
use crate::ros::{Calibrator, Delivery, Names, Purpose, Sample, TopicType, input_bindings};

/// The node that calibrates, unless it is given another name.
const NODE: &str = "/tpf_calibrate";

/// How often it is looked whether time is up.
const NAP: Duration = Duration::from_millis(50);

/// What only a live calibration has.
#[derive(Debug, clap::Args)]
pub(super) struct LiveArgs {
    /// Calibrate now, from the live topics that the parameters name, instead of from bags
    #[arg(long, conflicts_with_all = ["bags", "calibrate_first"])]
    pub(super) live: bool,
    /// With --live: for so long instead of `calibration.duration_s` of the parameters
    #[arg(long, value_name = "S", requires = "live", value_parser = zero::seconds)]
    seconds: Option<f64>,
    #[command(flatten)]
    ros: RosArguments,
}

pub(super) fn run(args: &Args, mut cfg: Config) -> Result<Outcome, Failure> {
    let live = &args.live;
    if args.output.exists() {
        return Err(Failure(format!(
            "{}: already exists; choose another name, or remove it first",
            shown(&args.output)
        )));
    }
    let duration = live.seconds.map_or(cfg.calibration.duration, Duration::from_secs_f64);
    cfg.calibration.min_duration = cfg.calibration.min_duration.min(duration);
    let models = load_models(&cfg)?;
    let place = live.ros.place(NODE)?;
    let definitions = Definitions::new(cfg.live.message_definitions.as_deref(), &place.environment.prefixes);
    let names = Names::new(&cfg, &[])?; // the graph remaps
    let mut listening = place.join()?;
    let mut bindings = Vec::new();
    for (topic, (tree, binding)) in names.inputs.iter().zip(input_bindings(&cfg, &names, &definitions)?) {
        listening.hear(topic, TopicType::Defined(&tree), Delivery::Data)?;
        bindings.push(binding);
    }
    interrupt::listen();
    let listener = listening.start()?;
    say(&format!(
        "for {:.0} s, in the air: open and close the hand, spread the fingers, go through the poses that you use; touch nothing",
        duration.as_secs_f64()
    ));
    let mut calibrator = Calibrator::new(&cfg, Purpose::Calibrate, duration);
    let mut progress = Progress::steps("calibrate", duration.as_millis() as u64);
    let mut heard_on = vec![0_u64; names.inputs.len()];
    let mut began = None::<Instant>;
    let waiting = Instant::now();
    loop {
        if interrupt::happened() {
            listener.leave();
            return Err(Failure("interrupted; nothing was written".to_owned()));
        }
        if let Some(heard) = listener.next(NAP)
            && let Ok(cdr) = heard.cdr
            && let Ok(event) = bindings[heard.topic.0].decode(&cdr, heard.received)
        {
            began.get_or_insert_with(Instant::now); // the graph takes a while to be found
            heard_on[heard.topic.0] += 1;
            calibrator.handle(Sample::from(&event));
        }
        let elapsed = began.map(|began| began.elapsed()).unwrap_or_default();
        progress.set(elapsed.as_millis() as u64);
        if elapsed >= duration || (began.is_none() && waiting.elapsed() >= duration.max(Duration::from_secs(5))) {
            break;
        }
    }
    drop(progress);
    listener.leave();
    if let Some(silent) = heard_on.iter().position(|n| *n == 0) {
        return Err(Failure(format!(
            "nothing that can be read came on {}; start its driver, or correct its topic and type in the parameters",
            names.inputs[silent]
        )));
    }
    let judge = Fusion::new(cfg.fusion.clone(), models.regressors)?;
    let (baselines, result) = calibrator.finish(judge);
    let Some(baselines) = baselines else {
        return Err(Failure(format!("not calibrated: {}", result.message)));
    };
    let taken = Zero { from: ZeroFrom::Live { frames: result.frames }, baselines, check: None };
    let calibration = taken.to_calibration(&cfg, &models.infos);
    calibration.save(&args.output)?;
    let mut told = format!("{}: zero from {}\n", shown(&args.output), taken.from);
    told += &verdict(&calibration);
    let spans: Vec<String> = result
        .joints
        .iter()
        .zip(&result.joint_span)
        .filter(|(joint, _)| cfg.fusion.regions.iter().any(|region| region.joints.contains(joint)))
        .map(|(joint, span)| format!("{joint} {:.0}\u{b0}", span.to_degrees()))
        .collect();
    if !spans.is_empty() {
        told += &format!("  the hand moved through: {}\n", spans.join(", "));
    }
    print(&told)?;
    Ok(Outcome::Done)
}
