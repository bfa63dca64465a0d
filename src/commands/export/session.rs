//! A bag as it is exported: its estimates, wherever they come from, beside what its sensors sent.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU64;

use super::super::progress::Said;
use super::super::setup::{input_topics, load_models, without_unused_joints};
use super::super::{Failure, interrupt, say};
use super::Args;
use crate::bag::{BagReader, Input, Inputs};
use crate::config::Config;
use crate::export::Session;
use crate::glove::Models;
use crate::msg::EstimateTopics;
use crate::recording::{EstimateTrack, PoseQuality, Samples};
use crate::sessions::{Core, Labelled, Modelled, NeedsTruth, hold_estimates, read_estimates, run_models, session_name};
use crate::units::GramForce;
use crate::zero::ZeroFrom;

/// Reads bags, one after the other.
pub(super) struct Loader<'a> {
    args: &'a Args,
    cfg: &'a Config,
    /// Topic of the estimates in a bag.
    topic: String,
    /// The models, once a bag needed them.
    core: Option<Core>,
    has_said: bool,
    n_bags: usize,
}

/// A bag, ready to be exported.
pub(super) struct Loaded {
    name: String,
    pub(super) synthetic: bool,
    /// `[regions]`
    pub(super) estimates: Vec<EstimateTrack>,
    /// `[regions]`
    truth: Vec<Option<Vec<Option<GramForce>>>>,
    pub(super) samples: Samples,
    labelled: Labelled,
    /// Where the zero of the estimates comes from; `None` where they were in the bag.
    pub(super) zero: Option<ZeroFrom>,
    /// What was lost of the bag.
    pub(super) losses: Vec<String>,
    /// What was dropped of its samples.
    pub(super) drops: Vec<String>,
}

impl<'a> Loader<'a> {
    pub(super) fn new(args: &'a Args, cfg: &'a Config, bags: &[PathBuf]) -> Self {
        let topic = EstimateTopics::of_node(&cfg.node.to_string(), &cfg.fusion).contacts;
        Loader { args, cfg, topic, core: None, has_said: false, n_bags: bags.len() }
    }

    /// Everything of a bag.
    pub(super) fn load(&mut self, bag: &Path) -> Result<Loaded, Failure> {
        let needs_truth = if self.args.truth.is_some() { NeedsTruth::All } else { NeedsTruth::Tared };
        let labelled = Labelled::read(bag, self.cfg, None, needs_truth, &Said)?;
        let in_bag = |failure: Failure| match failure.to_string() {
            text if text.starts_with(&bag.display().to_string()) => Failure(text),
            text => Failure(format!("{}: {text}", bag.display())),
        };
        let (samples, losses, drops) = read_samples(bag, self.cfg).map_err(in_bag)?;
        let is_recorded = !self.args.models.replaces() && hold_estimates(&[bag.to_path_buf()], &self.topic);
        let (estimates, zero) = if is_recorded {
            (read_estimates(bag, self.cfg, &self.topic, &Said)?.0, None)
        } else {
            self.compute(bag, &labelled)?
        };
        let truth = self.cfg.truth_of_region.iter().zip(&estimates);
        let max_gap = self.cfg.fusion.timing.max_gap;
        let truth = truth.map(|(truth_idx, track)| labelled.truth_at(*truth_idx, &track.stamp, max_gap));
        Ok(Loaded {
            name: session_name(bag),
            synthetic: labelled.notes().synthetic,
            truth: truth.collect(),
            estimates,
            samples,
            labelled,
            zero,
            losses,
            drops,
        })
    }

    fn compute(&mut self, bag: &Path, labelled: &Labelled) -> Result<(Vec<EstimateTrack>, Option<ZeroFrom>), Failure> {
        let core = match self.core.take() {
            Some(core) => core,
            None => self.load_core()?,
        };
        let done = AtomicU64::new(0);
        let modelled = run_models(bag, labelled, vec![core], self.args.zero.wanted(), &done, &Said)?;
        let Modelled { mut columns, mut cores, zero, verdict, .. } = modelled;
        let in_bag = |error| Failure(format!("{}: {error}", bag.display()));
        verdict.map_err(in_bag)?.iter().for_each(|note| say(&format!("{}: {note}", bag.display())));
        self.core = cores.pop();
        Ok((columns.pop().unwrap_or_default(), zero))
    }

    /// The models, loaded: once, and again after a bag that failed took them with it.
    fn load_core(&mut self) -> Result<Core, Failure> {
        let is_first = !std::mem::replace(&mut self.has_said, true);
        let mut cfg = self.cfg.clone();
        self.args.models.apply(&mut cfg)?;
        let models = if is_first {
            let several = if self.n_bags > 1 { ", where they hold none" } else { "" };
            say(&format!("no estimates on {} in the bag: the models make them{several}", self.topic));
            load_models(&cfg)?
        } else {
            Models::load(&cfg)?
        };
        cfg.fusion.batch = models.batch_hint();
        if self.args.models.replaces() {
            without_unused_joints(&mut cfg, &models.infos);
        }
        Ok(Core { cfg, infos: models.infos, quality: PoseQuality::default(), regressors: models.regressors })
    }
}

impl Loaded {
    pub(super) fn session(&self) -> Session<'_> {
        Session {
            name: self.name.clone(),
            synthetic: self.synthetic,
            estimates: &self.estimates,
            truth: &self.truth,
            samples: &self.samples,
            annotations: self.labelled.annotations(),
        }
    }
}

/// What the sensors sent, what was lost of the bag, and what was dropped.
fn read_samples(bag: &Path, cfg: &Config) -> Result<(Samples, Vec<String>, Vec<String>), Failure> {
    let mut reader = BagReader::open(&[bag.to_path_buf()])?;
    let mut inputs = Inputs::new(input_topics(cfg), &mut reader)?;
    let mut samples = Samples::new(&cfg.fusion);
    loop {
        interrupt::check()?;
        let Some(message) = reader.next_message()? else { break };
        for part in inputs.parts(message.channel)? {
            if let Input::Event(event) = inputs.decode(&message, part) {
                samples.handle_event(&event)?;
            }
        }
    }
    let used = cfg.fusion.regions.iter().flat_map(|region| &region.joints);
    inputs.check_end(used.map(String::as_str).filter(|joint| !samples.joints.contains_key(*joint)))?;
    let unreadable = inputs.counters().iter().filter_map(|(topic, counters)| {
        let first = counters.first_error.as_ref()?;
        let n: u64 = counters.unreadable.values().sum();
        Some(format!("topic {topic}: {n} messages could not be read: {first}"))
    });
    let losses = reader.losses().iter().map(ToString::to_string).chain(unreadable).collect();
    let mut drops = Vec::new();
    for (source, track) in cfg.fusion.tactile_sources.iter().zip(&samples.tactile) {
        if track.late + track.wrong_length > 0 {
            drops.push(format!(
                "tactile source {}: {} samples came late or twice, {} messages had another length than {} taxels",
                source.name, track.late, track.wrong_length, source.n_taxels
            ));
        }
    }
    let unused: u64 = samples.joints.values().map(|track| track.unused).sum();
    if unused > 0 {
        drops.push(format!("{unused} joint angles came late or twice, or were not finite"));
    }
    Ok((samples, losses, drops))
}
