//! Fits a network to a dataset.
//!
//! A batch is cut into a fixed number of shards. Each shard runs forward and backward separately, on any free thread,
//! and the gradients are added in the order of the shards: the number of threads does not affect the result. Batch
//! normalization uses one shard at a time.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use burn::tensor::Device;
use serde::Serialize;

use super::architecture::{Architecture, Kind};
use super::dataset::Dataset;
use super::error::TrainError;
use super::loss::LossTerms;
use super::network::Network;
use super::random::{Random, Stream};
use crate::eval::Part;

mod adam;
mod checkpoint;
mod config;
mod step;
mod validation;

use adam::Adam;
use checkpoint::Best;
pub use checkpoint::Checkpoint;
pub use config::{Schedule, TrainConfig};
pub(super) use step::on_threads;
#[cfg(test)]
pub(super) use step::{Given, run_shard, track};
pub use validation::{Validation, validate};

/// Target frames per training window of the causal network: they share most of their computation.
const OUTPUTS: usize = 64;

/// Progress after a step.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Progress {
    /// Steps done.
    pub step: u64,
    /// Total number of steps.
    pub steps: u64,
    /// Completed passes over the training windows.
    pub epochs: f64,
    /// The step's learning rate.
    pub learning_rate: f64,
    /// The step's losses.
    pub loss: LossTerms,
    /// Norm of the step's gradient, before clipping.
    pub gradient_norm: f64,
    /// Validation result, if this step has a validation.
    pub validation: Option<Validation>,
    /// True if that was the best so far.
    pub is_best: bool,
}

/// Result of training.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The network with the smallest validation loss; the last one if there is no validation part.
    pub best: Network,
    /// Step of that network.
    pub best_step: u64,
    /// Its validation result.
    pub best_validation: Option<Validation>,
    /// The network after the last step.
    pub last: Network,
    /// Steps done.
    pub steps: u64,
    /// True if it was stopped before its last step.
    pub stopped: bool,
}

/// A training run.
#[derive(Debug)]
pub struct Trainer<'a> {
    cfg: TrainConfig,
    dataset: &'a Dataset,
    /// The training data, if it is not `dataset`: windows that give several forces each.
    long: Option<Dataset>,
    fingerprint: String,
    threads: usize,
    network: Network,
    adam: Adam,
    step: u64,
    best: Option<Best>,
    order: EpochOrder,
}

impl<'a> Trainer<'a> {
    /// A new run, on at most `threads` threads.
    ///
    /// # Errors
    /// [`TrainError::Setting`], or [`TrainError::Architecture`] when kind and data don't fit.
    pub fn new(cfg: TrainConfig, dataset: &'a Dataset, threads: usize) -> Result<Self, TrainError> {
        cfg.check()?;
        let architecture = Architecture {
            kind: cfg.kind,
            window: dataset.spec().window,
            n_taxels: dataset.n_taxels(),
            n_joints: if cfg.kind.uses_pose() { dataset.n_joints() } else { 0 },
            tactile_scale: cfg.tactile_scale.unwrap_or_else(|| dataset.tactile_scale()),
            force_scale: cfg.force_scale,
            touch_scale: cfg.touch_scale,
            axes: cfg.axes,
        };
        if architecture.n_axes() > dataset.n_axes() {
            let what = "a force of three axes needs a true force of three axes".to_string();
            return Err(TrainError::Architecture { what });
        }
        let long = match cfg.kind {
            Kind::Adaptive => Some(dataset.with_outputs(OUTPUTS)?),
            _ => None,
        };
        if cfg.kind.uses_pose() != dataset.spec().needs_pose {
            let what = "the dataset's needs_pose must be what the kind of network needs".to_string();
            return Err(TrainError::Architecture { what });
        }
        let network = Network::new(architecture, cfg.seed)?;
        let adam = Adam::new(&network);
        Ok(Trainer {
            fingerprint: dataset.fingerprint(),
            order: EpochOrder::default(),
            threads: threads.max(1),
            step: 0,
            best: None,
            cfg,
            dataset,
            long,
            network,
            adam,
        })
    }

    /// Resumes from a checkpoint. The result is the same as that of an uninterrupted run.
    ///
    /// # Errors
    /// [`TrainError::OtherRun`] when the checkpoint was made with other data.
    pub fn resume(checkpoint: Checkpoint, dataset: &'a Dataset, threads: usize) -> Result<Self, TrainError> {
        let mut trainer = Trainer::new(checkpoint.cfg, dataset, threads)?;
        if trainer.fingerprint != checkpoint.dataset {
            return Err(TrainError::OtherRun { what: "recordings, or another split of them" });
        }
        let fits = trainer.network.architecture == checkpoint.network.architecture
            && [&checkpoint.network.values, &checkpoint.adam.first, &checkpoint.adam.second]
                .iter()
                .all(|values| values.len() == trainer.network.values.len());
        if !fits {
            return Err(TrainError::OtherRun { what: "network shapes" });
        }
        trainer.network = checkpoint.network;
        trainer.adam = checkpoint.adam;
        trainer.step = checkpoint.step;
        trainer.best = checkpoint.best;
        Ok(trainer)
    }

    /// The settings of the run.
    pub fn config(&self) -> &TrainConfig {
        &self.cfg
    }

    /// Total number of steps.
    pub fn steps(&self) -> u64 {
        self.cfg.schedule.steps
    }

    /// The current state of the run.
    pub fn checkpoint(&self) -> Checkpoint {
        Checkpoint {
            format: checkpoint::FORMAT,
            tool_version: env!("CARGO_PKG_VERSION").to_string(),
            dataset: self.fingerprint.clone(),
            cfg: self.cfg.clone(),
            step: self.step,
            network: self.network.clone(),
            adam: self.adam.clone(),
            best: self.best.clone(),
        }
    }

    /// Runs until the last step, or until `stop` is set; reports every step.
    ///
    /// With a `checkpoint` file, the run is saved there at regular steps and at the end, so that nothing is lost.
    ///
    /// # Errors
    /// [`TrainError::Diverged`], or [`TrainError::File`] for the checkpoint.
    pub fn run(
        &mut self,
        stop: &AtomicBool,
        checkpoint: Option<&Path>,
        on_progress: &mut dyn FnMut(&Progress),
    ) -> Result<Outcome, TrainError> {
        let steps = self.cfg.schedule.steps;
        let mut written = self.step;
        while self.step < steps && !stop.load(Ordering::Relaxed) {
            let progress = self.step()?;
            on_progress(&progress);
            if let Some(path) = checkpoint.filter(|_| self.step - written >= self.cfg.checkpoint_every) {
                self.checkpoint().save(path)?;
                written = self.step;
            }
        }
        if let Some(path) = checkpoint {
            self.checkpoint().save(path)?;
        }
        let last = self.network.clone();
        let (best, best_step, best_validation) = match &self.best {
            Some(best) => (best.network.clone(), best.step, Some(best.validation.clone())),
            None => (last.clone(), self.step, None),
        };
        Ok(Outcome { best, best_step, best_validation, last, steps: self.step, stopped: self.step < steps })
    }

    /// One step.
    fn step(&mut self) -> Result<Progress, TrainError> {
        let dataset = self.long.as_ref().unwrap_or(self.dataset);
        let n_windows = dataset.n_windows(Part::Train);
        let batch_len = self.cfg.batch.min(n_windows);
        let steps_per_epoch = (n_windows / batch_len) as u64;
        let order = self.order.of(self.cfg.seed, self.step / steps_per_epoch, n_windows);
        let start = (self.step % steps_per_epoch) as usize * batch_len;
        let windows = &order[start..start + batch_len];

        let device = Device::flex().autodiff();
        let mut given = step::run(&self.network, dataset, windows, self.step, &self.cfg, self.threads, &device);
        let gradient_norm = step::norm(&given.gradient);
        if !given.loss.total.is_finite() || !gradient_norm.is_finite() {
            return Err(TrainError::Diverged { step: self.step + 1, loss: given.loss.total });
        }
        step::clip(&mut given.gradient, gradient_norm, self.cfg.clip_norm);
        let learning_rate = self.cfg.schedule.learning_rate(self.step);
        self.adam.step(&mut self.network, &given.gradient, learning_rate, self.cfg.weight_decay);
        step::track(&mut self.network.statistics, &given.statistics);
        self.step += 1;

        let validation = self.look()?;
        let is_best = validation.as_ref().is_some_and(|now| self.is_best(now));
        if let (true, Some(validation)) = (is_best, &validation) {
            let network = self.network.clone();
            self.best = Some(Best { step: self.step, validation: validation.clone(), network });
        }
        Ok(Progress {
            step: self.step,
            steps: self.cfg.schedule.steps,
            epochs: self.step as f64 / steps_per_epoch as f64,
            learning_rate,
            loss: given.loss,
            gradient_norm,
            validation,
            is_best,
        })
    }

    /// The validation of this step, at regular steps and the last one.
    fn look(&self) -> Result<Option<Validation>, TrainError> {
        let due = self.step.is_multiple_of(self.cfg.validate_every) || self.step == self.cfg.schedule.steps;
        if !due || self.dataset.n_windows(Part::Validation) == 0 {
            return Ok(None);
        }
        validate(&self.network, self.dataset, Part::Validation, &self.cfg.loss, self.threads).map(Some)
    }

    fn is_best(&self, now: &Validation) -> bool {
        self.best.as_ref().is_none_or(|best| now.loss < best.validation.loss)
    }
}

/// The order of the windows of an epoch, kept for the whole epoch.
#[derive(Debug, Default)]
struct EpochOrder(Option<(u64, Vec<usize>)>);

impl EpochOrder {
    /// The order, from seed and epoch alone.
    fn of(&mut self, seed: u64, epoch: u64, n_windows: usize) -> &[usize] {
        if self.0.as_ref().is_none_or(|(kept, _)| *kept != epoch) {
            let mut order: Vec<usize> = (0..n_windows).collect();
            Random::new(seed, Stream::Epoch(epoch)).shuffle(&mut order);
            self.0 = Some((epoch, order));
        }
        self.0.as_ref().map_or(&[], |(_, order)| order)
    }
}
