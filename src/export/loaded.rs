//! Loads a bag for export: its estimates, recorded or computed, and the samples of its sensors.

use std::path::Path;
use std::sync::atomic::AtomicU64;

use super::{ExportError, Request, SessionToExport};
use crate::bag::{BagReader, Input, Inputs};
use crate::config::Config;
use crate::glove::{Models, replace_model};
use crate::msg::EstimateTopics;
use crate::observer::{Observer, check};
use crate::recording::{EstimateTrack, PoseQuality, Samples, input_topics};
use crate::sessions::{
    Labelled, ModelRun, Modelled, NeedsTruth, annotated, hold_estimates, read_estimates, run_models, session_name,
};
use crate::units::GramForce;
use crate::zero::ZeroFrom;

/// Loads bags, one after another.
pub(super) struct ExportLoader<'a> {
    request: &'a Request<'a>,
    cfg: &'a Config,
    observer: &'a dyn Observer,
    /// Topic of the estimates in a bag.
    topic: String,
    /// The models, loaded when the first bag needs them.
    core: Option<ModelRun>,
    has_said: bool,
}

/// A bag that is ready for export.
pub(super) struct Loaded {
    name: String,
    pub(super) synthetic: bool,
    /// `[regions]`
    pub(super) estimates: Vec<EstimateTrack>,
    /// `[regions]`
    truth: Vec<Option<Vec<Option<GramForce>>>>,
    /// `[regions]`
    tangential_truth: Vec<Option<Vec<Option<[GramForce; 3]>>>>,
    pub(super) samples: Samples,
    labelled: Labelled,
    /// Source of the zero of the estimates. `None` if the estimates are from the bag.
    pub(super) zero: Option<ZeroFrom>,
    /// Data of the bag that were lost.
    pub(super) losses: Vec<String>,
    /// Samples that were dropped, with reasons.
    pub(super) drops: Vec<String>,
}

impl<'a> ExportLoader<'a> {
    pub(super) fn new(request: &'a Request<'a>, cfg: &'a Config, observer: &'a dyn Observer) -> Self {
        let topic = EstimateTopics::of_node(&cfg.node.to_string(), cfg.fusion()).contacts;
        ExportLoader { request, cfg, observer, topic, core: None, has_said: false }
    }

    /// Loads everything from a bag.
    pub(super) fn load(&mut self, bag: &Path) -> Result<Loaded, ExportError> {
        let needs_truth = if self.request.needs_truth { NeedsTruth::All } else { NeedsTruth::Tared };
        let cfg = annotated(self.cfg, &[bag.to_path_buf()], self.request.in_air, self.observer)?;
        let labelled = Labelled::read(bag, &cfg, None, needs_truth, self.observer)?;
        if labelled.is_untared() {
            self.observer.warn(&format!(
                "{}: no true force is written, because no stage annotations on {} tell where nothing touches the glove to tare the force sensor: give --in-air FROM..TO or --zero-load-below FORCE",
                bag.display(),
                cfg.stage_topic
            ));
        }
        let in_bag = |error: ExportError| match error.to_string() {
            text if text.starts_with(&bag.display().to_string()) => error,
            _ => ExportError::in_bag(bag, &error),
        };
        let (samples, losses, drops) = read_samples(bag, self.cfg, self.observer).map_err(in_bag)?;
        let is_recorded = self.request.model.is_none() && hold_estimates(&[bag.to_path_buf()], &self.topic);
        let (estimates, zero) = if is_recorded {
            (read_estimates(bag, self.cfg, &self.topic, self.observer)?.0, None)
        } else {
            self.compute(bag, &labelled)?
        };
        let of_regions = || self.cfg.truth_of_region().iter().zip(&estimates);
        let max_gap = self.cfg.fusion().timing().max_gap;
        let truth = of_regions().map(|(truth_idx, track)| labelled.truth_at(*truth_idx, &track.stamp, max_gap));
        let truth = truth.collect();
        let tangential_truth = of_regions()
            .map(|(truth_idx, track)| labelled.tangential_truth_at(*truth_idx, &track.stamp, max_gap))
            .collect();
        Ok(Loaded {
            name: session_name(bag),
            synthetic: labelled.notes().synthetic,
            truth,
            tangential_truth,
            estimates,
            samples,
            labelled,
            zero,
            losses,
            drops,
        })
    }

    fn compute(
        &mut self,
        bag: &Path,
        labelled: &Labelled,
    ) -> Result<(Vec<EstimateTrack>, Option<ZeroFrom>), ExportError> {
        let core = match self.core.take() {
            Some(core) => core,
            None => self.load_core()?,
        };
        let done = AtomicU64::new(0);
        let modelled = run_models(bag, labelled, vec![core], self.request.zero, &done, self.observer)?;
        let Modelled { mut columns, mut cores, zero, verdict, .. } = modelled;
        let verdict = verdict.map_err(|error| ExportError::in_bag(bag, &error))?;
        verdict.iter().for_each(|note| self.observer.warn(&format!("{}: {note}", bag.display())));
        self.core = cores.pop();
        Ok((columns.pop().unwrap_or_default(), zero))
    }

    /// Loads the models: at first use, and again after a bag that failed, because its error consumed them.
    fn load_core(&mut self) -> Result<ModelRun, ExportError> {
        let is_first = !std::mem::replace(&mut self.has_said, true);
        let mut cfg = self.cfg.clone();
        if let Some(path) = self.request.model {
            replace_model(&mut cfg, path.to_path_buf())?.iter().for_each(|note| self.observer.note(note));
        }
        if let Some(backend) = self.request.backend {
            cfg.models_mut().iter_mut().for_each(|model| model.spec.backend = backend);
        }
        if is_first {
            let which = if self.request.bags.len() > 1 { "some bags have" } else { "the bag has" };
            self.observer.note(&format!("{which} no estimates on {}: the models make them", self.topic));
        }
        let models = Models::load(&cfg)?;
        if is_first {
            models.tell(&cfg, self.observer);
        }
        cfg.set_batch(models.batch_hint());
        Ok(ModelRun { cfg, infos: models.infos, quality: PoseQuality::default(), regressors: models.regressors })
    }
}

impl Loaded {
    pub(super) fn session(&self) -> SessionToExport<'_> {
        SessionToExport {
            name: self.name.clone(),
            synthetic: self.synthetic,
            estimates: &self.estimates,
            truth: &self.truth,
            tangential_truth: &self.tangential_truth,
            samples: &self.samples,
            annotations: self.labelled.annotations(),
        }
    }
}

/// The samples of the sensors, the data of the bag that were lost, and the samples that were dropped.
fn read_samples(
    bag: &Path,
    cfg: &Config,
    observer: &dyn Observer,
) -> Result<(Samples, Vec<String>, Vec<String>), ExportError> {
    let mut reader = BagReader::open(&[bag.to_path_buf()])?;
    let mut inputs = Inputs::new(input_topics(cfg), &mut reader)?;
    inputs.read_only_these(&mut reader);
    let mut samples = Samples::new(cfg.fusion());
    loop {
        check(observer)?;
        let Some(message) = reader.next_message()? else { break };
        for part in inputs.parts(message.channel)? {
            if let Input::Event(event) = inputs.decode(&message, part) {
                samples.handle_event(&event)?;
            }
        }
    }
    let used = cfg.fusion().regions().iter().flat_map(|region| &region.joints);
    inputs.check_end(used.map(String::as_str).filter(|joint| !samples.joints.contains_key(*joint)))?;
    let counters = inputs.counters();
    let unreadable = counters.iter().filter_map(|(topic, counters)| {
        let first = counters.first_error.as_ref()?;
        let n: u64 = counters.unreadable.values().sum();
        Some(format!("topic {topic}: {n} messages could not be read: {first}"))
    });
    let losses = reader.losses().iter().map(ToString::to_string).chain(unreadable).collect();
    let mut drops = Vec::new();
    for (source, track) in cfg.fusion().tactile_sources().iter().zip(&samples.tactile) {
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
