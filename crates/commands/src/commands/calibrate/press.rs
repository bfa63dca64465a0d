//! Touches of a known force while the glove is worn.

use std::io::BufRead;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::fusion::{Event, Fusion};
use tactile_pose_fusion::msg::binding::TruthBinding;
use tactile_pose_fusion::msg::definition::Definitions;
use tactile_pose_fusion::recording::ToldTouch;
use tactile_pose_fusion::ros::{Delivery, Incoming, Listening, Names, Sample, SubscribedTopic, TOUCH, TopicType};
use tactile_pose_fusion::sessions::{KnownForces, RegionTouches, TruthReading, live_force_gains};
use tactile_pose_fusion::units::{GramForce, NANOS_PER_SEC, Newton, Stamp};
use tactile_pose_fusion::zero::Donning;

use super::super::setup::load_models;
use super::super::{Failure, interrupt, say};

/// How long a press whose force a person tells is looked at, from the moment they say that it is held.
const HELD: Duration = Duration::from_millis(1500);

/// What the touches of a live calibration are known by.
#[derive(Debug, clap::Args)]
pub(super) struct PressArgs {
    /// With --live --touches: how long to wait for touches of the force sensor, after the zero
    #[arg(long, value_name = "S", default_value = "30", value_parser = super::super::zero::seconds)]
    touch_seconds: f64,
    /// With --live: after the zero, ask for a press of this force, in gF or N, as a kitchen scale shows it; one --press for
    /// each, at least three. Press, hold, and press Enter when the scale shows it
    #[arg(long, value_name = "[REGION:]FORCE", value_parser = press, requires = "live", conflicts_with_all = ["touches", "touch"])]
    press: Vec<Press>,
}

/// A press as the command line asks for it.
#[derive(Debug, Clone, PartialEq)]
struct Press {
    region: Option<String>,
    force: Newton,
    /// As it was written.
    text: String,
}

fn press(text: &str) -> Result<Press, String> {
    let (region, rest) = match text.split_once(':') {
        Some((region, rest)) => (Some(region.to_owned()), rest),
        None => (None, text),
    };
    match crate::commands::force::force(rest) {
        Some(force) if force.0 > 0.0 => Ok(Press { region, force, text: rest.to_owned() }),
        _ => Err(format!("expected a force, such as 200gF or thumb:2N, got {text:?}")),
    }
}

impl PressArgs {
    /// Whether presses are asked for.
    pub(super) fn is_asked(&self) -> bool {
        !self.press.is_empty()
    }

    /// Refuses, before anything is measured, what can't be done.
    pub(super) fn check(&self, cfg: &Config, by_sensor: bool) -> Result<(), Failure> {
        if by_sensor && cfg.truth().is_empty() {
            return Err(Failure(
                "--touches needs the true force: set truth_sources and truth.*.topic in the parameters, or tell the forces by --press"
                    .to_owned(),
            ));
        }
        self.press.iter().try_for_each(|press| region_of(press, cfg).map(|_| ()))
    }
}

fn region_of(press: &Press, cfg: &Config) -> Result<String, Failure> {
    let names: Vec<&str> = cfg.fusion().regions().iter().map(|region| region.name.as_str()).collect();
    match (&press.region, names.as_slice()) {
        (Some(name), names) if names.contains(&name.as_str()) => Ok(name.clone()),
        (Some(name), names) => {
            Err(Failure(format!("--press names region {name}, the parameters have {}", names.join(", "))))
        }
        (None, [only]) => Ok((*only).to_owned()),
        (None, names) => Err(Failure(format!(
            "--press {}: the parameters have several regions; name one of {}, as in {}:{}",
            press.text,
            names.join(", "),
            names.first().unwrap_or(&"region"),
            press.text
        ))),
    }
}

/// What came of the force sensors in a live calibration.
pub(super) struct Recorder {
    readings: Vec<TruthReading>,
    /// Topic, sensor, and how its messages are read.
    sensors: Vec<(usize, usize, TruthBinding)>,
    /// True if it was said that a message can't be read.
    is_said: bool,
    /// Stamps of the first and of the newest tactile sample.
    span: Option<(Stamp, Stamp)>,
}

impl Recorder {
    /// Subscribes to the force sensors, beside the inputs of the core that were subscribed to before.
    pub(super) fn start(
        cfg: &Config,
        names: &Names,
        definitions: &Definitions,
        listening: &mut Listening,
    ) -> Result<Self, Failure> {
        let mut topics: Vec<&String> = names.inputs.iter().map(|input| &input.topic).collect();
        let mut sensors = Vec::new();
        for (sensor, truth) in cfg.truth().iter().enumerate() {
            let tree = definitions.tree(&truth.type_name)?;
            let binding = TruthBinding::compile(&truth.fields, &tree)
                .map_err(|error| Failure(format!("topic {}: {error}", truth.name)))?;
            // A force sensor may be on a topic that feeds the core, too.
            let known = topics.iter().position(|topic| **topic == truth.name);
            if known.is_none() {
                listening.subscribe(&truth.name, TopicType::Defined(&tree), Delivery::Data)?;
                topics.push(&truth.name);
            }
            sensors.push((known.unwrap_or(topics.len() - 1), sensor, binding));
        }
        Ok(Recorder { readings: Vec::new(), sensors, is_said: false, span: None })
    }

    /// Keeps the readings of a message.
    pub(super) fn handle(&mut self, incoming: &Incoming) {
        let (SubscribedTopic(topic), Ok(cdr)) = (incoming.topic, &incoming.cdr) else { return };
        for (_, sensor, binding) in self.sensors.iter_mut().filter(|(of, ..)| *of == topic) {
            match binding.decode(cdr, incoming.received) {
                Ok((stamp, force)) => self.readings.push(TruthReading { sensor: *sensor, stamp, force }),
                Err(error) if error.is_for_another() || std::mem::replace(&mut self.is_said, true) => {}
                Err(error) => say(&format!("a message of a force sensor can't be read: {error}")),
            }
        }
    }

    /// Notes the time of a sample.
    pub(super) fn handle_event(&mut self, event: &Event<'_>) {
        if let Event::Tactile(block) = event {
            let first = self.span.map_or(block.stamp, |(first, _)| first);
            self.span = Some((first, block.stamp));
        }
    }

    fn elapsed_s(&self) -> f64 {
        self.span.map_or(0.0, |(first, newest)| newest.nanos_since(first) as f64 / NANOS_PER_SEC as f64)
    }

    /// The gain of each region that was touched, of the samples of a calibration that began with `rest` without load.
    pub(super) fn gains(
        &self,
        cfg: &Config,
        (donning, rest): (&Donning, Duration),
        samples: &[Sample],
        known: &KnownForces,
    ) -> Result<Vec<RegionTouches>, Failure> {
        let core = Fusion::new(cfg.fusion().clone(), load_models(cfg)?.regressors)?;
        live_force_gains(cfg, core, (donning, rest), samples.iter().map(Sample::event), &self.readings, known)
            .map_err(|reason| Failure(format!("no gain of the touches: {reason}")))
    }
}

/// Asks for touches, and says how their forces are known. `next` handles what comes for a moment, and fails where an input is
/// at fault.
pub(super) fn ask(
    args: &PressArgs,
    cfg: &Config,
    recorder: &mut Recorder,
    next: &mut dyn FnMut(&mut Recorder) -> Result<(), Failure>,
) -> Result<KnownForces, Failure> {
    if args.press.is_empty() {
        say(&format!("now {TOUCH}; {:.0} s", args.touch_seconds));
        let begun = Instant::now();
        while begun.elapsed().as_secs_f64() < args.touch_seconds {
            next(recorder)?;
        }
        return Ok(KnownForces::Sensor);
    }
    let lines = stdin_lines();
    let mut told = Vec::new();
    for (idx, press) in args.press.iter().enumerate() {
        let region = region_of(press, cfg)?;
        say(&format!(
            "press {} of {}: {region} with {} ({:.0} gF); hold it, and press Enter",
            idx + 1,
            args.press.len(),
            press.text,
            GramForce::from(press.force).0
        ));
        loop {
            next(recorder)?;
            match lines.try_recv() {
                Ok(Some(())) => break,
                Ok(None) => return Err(Failure("standard input has ended; nothing was written".to_owned())),
                Err(_) => {}
            }
        }
        let from_s = recorder.elapsed_s();
        let to_s = from_s + HELD.as_secs_f64();
        let begun = Instant::now();
        while recorder.elapsed_s() < to_s {
            next(recorder)?;
            if begun.elapsed() > 4 * HELD {
                return Err(Failure("the taxels stopped during the press; nothing was written".to_owned()));
            }
        }
        say("release");
        told.push((region, ToldTouch { force: press.force, from_s, to_s }));
    }
    // The frames of the last press come out of the core with what follows them.
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_millis(300) {
        next(recorder)?;
    }
    Ok(KnownForces::Told(told))
}

/// The lines of standard input as they come, and `None` at its end.
fn stdin_lines() -> Receiver<Option<()>> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines() {
            if line.is_err() || sender.send(Some(())).is_err() {
                break;
            }
        }
        let _ = sender.send(None); // nobody may wait any more
    });
    receiver
}

/// Fails when there was an interrupt.
pub(super) fn check_interrupt() -> Result<(), Failure> {
    match interrupt::happened() {
        true => Err(Failure("interrupted; nothing was written".to_owned())),
        false => Ok(()),
    }
}
