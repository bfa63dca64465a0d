//! Touches of a known force while the glove is worn: recorded, and read as those in a bag are.

use std::io::BufRead;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use tactile_pose_fusion::bag::{BEST_EFFORT_QOS, BagWriter, NewChannel, OutChannel, WriteOptions, shown};
use tactile_pose_fusion::config::Config;
use tactile_pose_fusion::fusion::{Event, Fusion};
use tactile_pose_fusion::msg::definition::Definitions;
use tactile_pose_fusion::msg::type_hash;
use tactile_pose_fusion::recording::ToldTouch;
use tactile_pose_fusion::ros::{Delivery, Incoming, Listening, Names, SubscribedTopic, TopicType};
use tactile_pose_fusion::sessions::{KnownForces, RegionTouches, force_gains};
use tactile_pose_fusion::units::{GramForce, NANOS_PER_SEC, Newton, Stamp};
use tactile_pose_fusion::zero::{Donning, Zero, ZeroFrom};

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
        if by_sensor && cfg.truth.is_empty() {
            return Err(Failure(
                "--touches needs the true force: set truth_sources and truth.*.topic in the parameters, or tell the forces by --press"
                    .to_owned(),
            ));
        }
        self.press.iter().try_for_each(|press| region_of(press, cfg).map(|_| ()))
    }
}

fn region_of(press: &Press, cfg: &Config) -> Result<String, Failure> {
    let names: Vec<&str> = cfg.fusion.regions().iter().map(|region| region.name.as_str()).collect();
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

/// The inputs of a live calibration as a bag of its own, which is gone afterwards.
pub(super) struct Recorder {
    folder: tempfile::TempDir,
    bag: BagWriter,
    channels: Vec<OutChannel>,
    /// Stamps of the first and of the newest tactile sample.
    span: Option<(Stamp, Stamp)>,
}

impl Recorder {
    /// Records the inputs of the core, and subscribes to the force sensors besides.
    pub(super) fn start(
        cfg: &Config,
        names: &Names,
        definitions: &Definitions,
        listening: &mut Listening,
    ) -> Result<Self, Failure> {
        let folder = tempfile::tempdir()?;
        let mut bag = BagWriter::create(&folder.path().join("touches.mcap"), WriteOptions::default())?;
        let inputs = names.inputs.iter().map(|input| (&input.topic, &input.type_name));
        let truths = cfg.truth.iter().map(|truth| (&truth.name, &truth.type_name));
        let mut known: Vec<&String> = Vec::new();
        let mut channels = Vec::new();
        for (idx, (topic, type_name)) in inputs.chain(truths).enumerate() {
            if known.contains(&topic) {
                continue; // a force sensor on a topic that feeds the core, too
            }
            known.push(topic);
            let tree = definitions.tree(type_name)?;
            if idx >= names.inputs.len() {
                listening.subscribe(topic, TopicType::Defined(&tree), Delivery::Data)?;
            }
            let schema_text = definitions.schema_text(type_name)?;
            let type_hash = type_hash(&tree);
            let (schema_text, type_hash) = (schema_text.as_str(), type_hash.as_str());
            let channel = NewChannel { topic, type_name, schema_text, qos_yaml: BEST_EFFORT_QOS, type_hash };
            channels.push(bag.add_live_input(channel)?);
        }
        Ok(Recorder { folder, bag, channels, span: None })
    }

    /// Keeps a message.
    pub(super) fn handle(&mut self, incoming: &Incoming) -> Result<(), Failure> {
        let (SubscribedTopic(idx), Ok(cdr)) = (incoming.topic, &incoming.cdr) else { return Ok(()) };
        Ok(self.bag.write(self.channels[idx], 0, incoming.received, incoming.received, cdr)?)
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

    /// The gain of each region that was touched.
    fn gains(
        self,
        cfg: &Config,
        donning: &Donning,
        rest: Duration,
        known: &KnownForces,
    ) -> Result<Vec<RegionTouches>, Failure> {
        self.bag.finish()?;
        let bags: [PathBuf; 1] = [self.folder.path().join("touches.mcap")];
        // The force sensor was free of load while the zero was taken.
        let seconds = vec![rest.as_secs_f64(); cfg.fusion.tactile_sources().len()];
        let zero = Zero::new(ZeroFrom::First { seconds }, donning.clone());
        let mut core = Fusion::new(cfg.fusion.clone(), load_models(cfg)?.regressors)?;
        zero.install(&mut core)?;
        let found = force_gains(&bags, cfg, &zero, core, known, &super::Said);
        found.map_err(|error| {
            let text = error.to_string();
            let file = format!("{}: ", shown(&bags[0]));
            Failure(format!("no gain of the touches: {}", text.strip_prefix(&file).unwrap_or(&text)))
        })
    }
}

/// Asks for touches, records them, and fits their gain. `next` handles what comes for a moment, and fails where an input is
/// at fault.
pub(super) fn gains(
    args: &PressArgs,
    cfg: &Config,
    mut recorder: Recorder,
    donning: &Donning,
    rest: Duration,
    next: &mut dyn FnMut(&mut Recorder) -> Result<(), Failure>,
) -> Result<Vec<RegionTouches>, Failure> {
    if args.press.is_empty() {
        say(&format!(
            "now touch the force sensor: each region at least three times with 30 gF or more, half a second each; {:.0} s",
            args.touch_seconds
        ));
        let begun = Instant::now();
        while begun.elapsed().as_secs_f64() < args.touch_seconds {
            next(&mut recorder)?;
        }
        return recorder.gains(cfg, donning, rest, &KnownForces::Sensor);
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
            next(&mut recorder)?;
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
            next(&mut recorder)?;
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
        next(&mut recorder)?;
    }
    recorder.gains(cfg, donning, rest, &KnownForces::Told(told))
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
