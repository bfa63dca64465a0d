//! A calibration from live topics, as `~/calibrate` of the node makes it, without a node.

use std::time::{Duration, Instant};

use tactile_pose_fusion::config::{Config, ParamTree};
use tactile_pose_fusion::fusion::{Event, Fusion};
use tactile_pose_fusion::glove::known;
use tactile_pose_fusion::msg::definition::Definitions;
use tactile_pose_fusion::ros::{
    Calibrator, Delivery, IN_AIR, Inputs, Listener, Names, Purpose, Sample, TopicType, Watched, input_bindings, wanted,
};
use tactile_pose_fusion::zero::{Donning, Zero, ZeroFrom};

use super::super::live::RosArguments;
use super::super::setup::{load_models, shown};
use super::super::zero;
use super::super::{Failure, Outcome, print, say};
use super::press::{self, PressArgs, Recorder};
use super::{Args, gains_text, verdict};
use crate::report::progress::Progress;

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
    press: PressArgs,
    #[command(flatten)]
    ros: RosArguments,
}

pub(super) fn run(args: &Args, mut cfg: Config) -> Result<Outcome, Failure> {
    let live = &args.live;
    live.press.check(&cfg, args.touches)?;
    let duration = live.seconds.map_or(cfg.calibration.duration, Duration::from_secs_f64);
    cfg.calibration.min_duration = cfg.calibration.min_duration.min(duration);
    let models = load_models(&cfg)?;
    let place = live.ros.place(NODE)?;
    let definitions = Definitions::new(cfg.live.message_definitions.as_deref(), &place.environment.prefixes);
    let names = Names::new(&cfg, &[])?; // the graph remaps
    let mut listening = place.join()?;
    let bindings = input_bindings(&cfg, &names, &definitions)?;
    // As the graph of this tool has them: it asks for no more than best effort.
    let wanted = wanted(&cfg, &ParamTree::empty(NODE), &names, &bindings)?;
    for (input, (tree, _)) in names.inputs.iter().zip(&bindings) {
        listening.subscribe(&input.topic, TopicType::Defined(tree), Delivery::of(input))?;
    }
    let mut recorder = match args.touches || live.press.is_asked() {
        true => Some(Recorder::start(&cfg, &names, &definitions, &mut listening)?),
        false => None,
    };
    let listener = listening.start()?;
    say(&format!("for {:.0} s, {IN_AIR}", duration.as_secs_f64()));
    let mut calibrator = Calibrator::new(&cfg, Purpose::Calibrate, duration);
    let mut progress = Progress::time("calibrate", duration);
    let mut began = None::<Instant>;
    let waiting = Instant::now();
    let judge = Fusion::new(cfg.fusion().clone(), models.regressors)?;
    let watched = Watched::new(&cfg, wanted.into_iter().flatten());
    let mut hand = Hand { listener, inputs: Inputs::new(bindings, watched) };
    loop {
        hand.receive(recorder.as_mut(), &mut |event| {
            began.get_or_insert_with(Instant::now); // the graph takes a while to be found
            calibrator.handle(Sample::from(event));
        })?;
        hand.check(&cfg, Some(&judge), "not calibrated")?;
        let elapsed = began.map(|began| began.elapsed()).unwrap_or_default();
        progress.set_time(elapsed);
        if elapsed >= duration || (began.is_none() && waiting.elapsed() >= duration.max(Duration::from_secs(5))) {
            break;
        }
    }
    drop(progress);
    if let Some(why) = hand.inputs.why_silent() {
        return Err(Failure(why));
    }
    let (donning, result) = calibrator.finish(judge, &Donning::default());
    let Some(mut donning) = donning else {
        return Err(Failure(format!("not calibrated: {}", result.message)));
    };
    if !result.message.is_empty() {
        say(&result.message);
    }
    let mut touches = Vec::new();
    if let Some(mut recorder) = recorder {
        let mut next = |recorder: &mut Recorder| {
            hand.receive(Some(recorder), &mut |event| calibrator.handle(Sample::from(event)))?;
            hand.check(&cfg, None, "no gain of the touches")
        };
        let known = press::ask(&live.press, &cfg, &mut recorder, &mut next)?;
        touches = recorder.gains(&cfg, (&donning, duration), calibrator.samples(), &known)?;
        donning.force_gains = vec![None; cfg.fusion().regions().len()];
        touches.iter().for_each(|found| donning.force_gains[found.region] = Some(found.gain));
    }
    hand.listener.leave();
    let taken = Zero::new(ZeroFrom::Live { frames: result.frames }, donning);
    let calibration = taken.to_calibration(&cfg, &known(&cfg, &models.infos).hashes);
    calibration.save(&args.output)?;
    let mut told = format!("{}: zero from {}\n", shown(&args.output), taken.from);
    told += &verdict(&calibration);
    told += &gains_text(&touches, &cfg);
    let spans: Vec<String> = result
        .joints
        .iter()
        .zip(&result.joint_span)
        .filter(|(joint, _)| cfg.fusion().regions().iter().any(|region| region.joints.contains(joint)))
        .map(|(joint, span)| format!("{joint} {:.0}\u{b0}", span.to_degrees()))
        .collect();
    if !spans.is_empty() {
        told += &format!("  the hand moved through: {}\n", spans.join(", "));
    }
    print(&told)?;
    Ok(Outcome::Done)
}

/// The hand that is calibrated: what comes from it, and whether it is as it should be.
struct Hand {
    listener: Listener,
    inputs: Inputs,
}

impl Hand {
    /// Takes the next message, if there is one within a moment.
    fn receive(
        &mut self,
        mut recorder: Option<&mut Recorder>,
        on_event: &mut dyn FnMut(&Event<'_>),
    ) -> Result<(), Failure> {
        press::check_interrupt()?;
        let Some(incoming) = self.listener.next(NAP) else { return Ok(()) };
        if let Some(recorder) = &mut recorder {
            recorder.handle(&incoming);
        }
        self.inputs.handle(&incoming, &mut |event| {
            if let Some(recorder) = &mut recorder {
                recorder.handle_event(event);
            }
            on_event(event);
        });
        Ok(())
    }

    /// Fails where something has been wrong with an input for a while.
    fn check(&mut self, cfg: &Config, core: Option<&Fusion>, what: &str) -> Result<(), Failure> {
        match self.inputs.lasting_problem(&self.listener, cfg, core) {
            Some(problem) => Err(Failure(format!("{what}: {problem}"))),
            None => Ok(()),
        }
    }
}
