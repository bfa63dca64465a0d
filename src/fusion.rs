//! The fusion core: taxels and joint angles in, forces and contacts out. Pure: no clock, no I/O, no environment.
//!
//! [`Fusion::handle`] takes one event, [`Fusion::poll`] gives what it made possible. An estimate is a function of the
//! sequence of events alone; whether a live node or a bag brings them makes no difference.

mod artifact;
mod calibration;
mod config;
mod contact;
mod counters;
mod error;
mod estimate;
mod event;
mod features;
mod frames;
mod gain;
mod geometry;
mod health;
mod joints;
mod queue;
mod region;
mod regressor;

use std::collections::VecDeque;

pub use artifact::{
    ARTIFACT_BASIS, Adaptation, ArtifactError, ArtifactFilter, ArtifactFit, ArtifactFitter, ArtifactModel,
    DonningFrames, Following, HISTORY_S, JointHistory, learn_artifact,
};
pub use calibration::{Baseline, BaselineBuilder, CalibrationError, CalibrationLimits, judge_loaded};
pub use config::{
    ContactBy, ContactThresholds, FrameClock, FusionConfig, JointSource, Receipts, RegionConfig, TactileSource, Timing,
};
pub use contact::{Contact, ContactDetector, ContactEvent};
pub use counters::{Count, Counters, TactileCount};
pub use error::{FusionError, SetupError};
pub use estimate::{Estimate, Flags, Tick, TickTaxels};
pub use event::{Event, JointSample, JointSourceIdx, TactileBlock, TactileSourceIdx};
pub use features::{FeatureWindow, NewestWindow, TaxelFeatures};
pub use frames::{Frame, FrameCutter, RowStamps, TactileCounters};
pub use gain::{ForceGain, GainError, KnownTouch};
pub use geometry::{Patch, Wrench, split};
pub use health::{RateFault, SourceFault, SourceHealth};
pub use joints::{JointAngle, JointCounters, JointTimelines, PoseTrust};
pub use region::RegionCounters;
pub use regressor::{
    Contract, ForceAxes, ForceUnit, Forces, FrameSequence, PoseRange, RegressError, Regressor, SharedWindows,
    TouchLevels, TouchOutput, WindowId, Windows,
};

use crate::units::{Stamp, nanos};
use frames::Continuity;
use queue::ModelQueue;
use region::{Place, Readiness, Region};

/// Frames a second of a source that no region uses: its samples are still checked and counted.
const DEFAULT_RATE_HZ: f64 = 100.0;

/// The pose-aware force estimator of a hand: any number of regions, sources and models.
#[derive(Debug)]
pub struct Fusion {
    cfg: FusionConfig,
    sources: Vec<Source>,
    joints: JointTimelines,
    regions: Vec<Region>,
    models: Vec<ModelQueue>,
    waiting: VecDeque<PendingTick>,
    ready: VecDeque<Tick>,
    current: Option<Tick>,
    spare_ticks: Vec<Tick>,
    spare_pending: Vec<PendingTick>,
    /// When the newest event arrived.
    received: Stamp,
    finishing: bool,
}

#[derive(Debug)]
struct Source {
    cutter: FrameCutter,
    baseline: Option<Baseline>,
    regions: Vec<usize>,
    joints: Vec<usize>,
    pending: VecDeque<PendingFrame>,
    spare: Vec<PendingFrame>,
}

#[derive(Debug, Default)]
struct PendingFrame {
    stamp: Stamp,
    epoch: u64,
    number: i64,
    values: Vec<f32>,
    /// `[regions of the source]`: what was known of its taxels by then.
    faults: Vec<Flags>,
}

/// A frame whose windows wait for their models.
#[derive(Debug, Default)]
struct PendingTick {
    source: usize,
    stamp: Stamp,
    epoch: u64,
    number: i64,
    received: Stamp,
    age_ns: Option<i64>,
    regions: Vec<(usize, Readiness)>,
    taxels: TickTaxels,
}

impl Fusion {
    /// A core without a baseline: every frame is UNCALIBRATED until [`Fusion::handle_baseline`].
    ///
    /// # Errors
    /// [`SetupError`] when regions and models don't fit each other.
    pub fn new(cfg: FusionConfig, regressors: Vec<Box<dyn Regressor>>) -> Result<Self, SetupError> {
        for region in &cfg.regions {
            error::check_region(region, &cfg, &regressors)?;
        }
        let mut joint_names: Vec<String> = cfg.regions.iter().flat_map(|region| region.joints.clone()).collect();
        joint_names.sort();
        joint_names.dedup();
        let joint_idxs = |region: &RegionConfig| -> Vec<usize> {
            region.joints.iter().filter_map(|joint| joint_names.iter().position(|name| name == joint)).collect()
        };
        let sources: Vec<Source> = (0..cfg.tactile_sources.len())
            .map(|source_idx| {
                let in_source = |region: &&RegionConfig| region.source.0 == source_idx;
                let mut joints: Vec<usize> = cfg.regions.iter().filter(in_source).flat_map(joint_idxs).collect();
                joints.sort_unstable();
                joints.dedup();
                let contract = cfg.regions.iter().find(in_source).map(|region| regressors[region.model].contract());
                let rate_hz = contract.map_or(DEFAULT_RATE_HZ, |contract| contract.rate_hz);
                Source {
                    cutter: FrameCutter::new(cfg.tactile_sources[source_idx].clone(), rate_hz, &cfg.timing),
                    baseline: None,
                    regions: (0..cfg.regions.len()).filter(|&idx| in_source(&&cfg.regions[idx])).collect(),
                    joints,
                    pending: VecDeque::new(),
                    spare: Vec::new(),
                }
            })
            .collect();
        let mut models: Vec<ModelQueue> = regressors.into_iter().map(ModelQueue::new).collect();
        let regions = cfg.regions.iter().enumerate().map(|(idx, region)| {
            let model = &mut models[region.model];
            let place = Place { region: idx, model: region.model, lane: model.add_lane() };
            let contract = model.regressor.contract();
            let max_gap_ns = sources[region.source.0].cutter.max_gap_ns();
            let source = &cfg.tactile_sources[region.source.0];
            Region::new(place, region, source, contract, joint_idxs(region), max_gap_ns, cfg.following)
        });
        Ok(Fusion {
            regions: regions.collect(),
            joints: JointTimelines::new(joint_names, cfg.joint_sources.clone(), &cfg.timing),
            sources,
            models,
            waiting: VecDeque::new(),
            ready: VecDeque::new(),
            current: None,
            spare_ticks: Vec::new(),
            spare_pending: Vec::new(),
            received: Stamp::default(),
            finishing: false,
            cfg,
        })
    }

    /// Takes a sample of taxels or joint angles.
    pub fn handle(&mut self, event: Event<'_>) {
        self.received = self.received.max(event.received());
        match event {
            Event::Tactile(block) => self.handle_tactile(&block),
            Event::Joints(sample) => {
                self.joints.handle(&sample);
                for source_idx in 0..self.sources.len() {
                    self.settle(source_idx, sample.received, false);
                }
            }
        }
    }

    /// Takes the baseline of a tactile source. Its windows start again, because their frames had another one subtracted.
    ///
    /// # Errors
    /// [`SetupError::Baseline`] when its length isn't the source's number of taxels; nothing has changed then.
    pub fn handle_baseline(&mut self, source: TactileSourceIdx, baseline: Baseline) -> Result<(), SetupError> {
        let (source_cfg, source) = (&self.cfg.tactile_sources[source.0], &mut self.sources[source.0]);
        error::check_baseline(&baseline, source_cfg)?;
        for &region_idx in &source.regions {
            self.regions[region_idx].handle_baseline(&self.cfg.regions[region_idx], &baseline);
        }
        source.cutter.handle_noise(&baseline.noise);
        source.baseline = Some(baseline);
        Ok(())
    }

    /// Takes the artifact of a region's donning, after the baseline that it was fitted above. A region whose model has no
    /// artifact has no use for one.
    ///
    /// # Errors
    /// [`SetupError::Artifact`] when it belongs to another model; nothing has changed then.
    pub fn handle_artifact(&mut self, region_idx: usize, fit: ArtifactFit) -> Result<(), SetupError> {
        let region = self.cfg.regions[region_idx].name.clone();
        self.regions[region_idx].handle_artifact(fit).map_err(|error| SetupError::Artifact { region, error })
    }

    /// Takes the gain of a region's forces from known touches of this donning, after the baseline
    /// that they were measured above.
    ///
    /// # Errors
    /// [`SetupError::Gain`] if no touches can give this gain; nothing has changed then.
    pub fn handle_force_gain(&mut self, region_idx: usize, gain: &ForceGain) -> Result<(), SetupError> {
        let region = self.cfg.regions[region_idx].name.clone();
        gain.check().map_err(|error| SetupError::Gain { region, error })?;
        self.regions[region_idx].handle_force_gain(gain);
        Ok(())
    }

    /// Gain of a region's forces, from known touches of this donning.
    pub fn force_gain(&self, region_idx: usize) -> Option<&ForceGain> {
        self.regions[region_idx].force_gain()
    }

    /// Filter of a region's artifact, if its model has one.
    pub fn artifact(&self, region_idx: usize) -> Option<&ArtifactFilter> {
        self.regions[region_idx].artifact()
    }

    /// Takes other contact thresholds for the regions, from the next estimate on.
    ///
    /// # Shapes
    /// `thresholds`: `[regions]`.
    pub fn handle_thresholds(&mut self, thresholds: &[ContactThresholds]) {
        for ((region, cfg), thresholds) in self.regions.iter_mut().zip(&mut self.cfg.regions).zip(thresholds) {
            cfg.contact = *thresholds;
            region.contact.handle_thresholds(*thresholds);
        }
    }

    /// The baseline of a tactile source; `None` if it has none.
    pub fn baseline(&self, source: TactileSourceIdx) -> Option<&Baseline> {
        self.sources[source.0].baseline.as_ref()
    }

    /// Ends the stream: frames that still wait for joints are settled with what is here, and the last batch is run
    /// however small it is. What completes them is the last event, so they count as received when that was.
    pub fn handle_end(&mut self) {
        for source_idx in 0..self.sources.len() {
            self.settle(source_idx, self.received, true);
        }
        self.finishing = true;
    }

    /// The next finished frame, oldest first, or `None` until more events come.
    ///
    /// # Errors
    /// [`FusionError`] when a model's runtime fails; this core gives no more frames then.
    pub fn poll(&mut self) -> Result<Option<&Tick>, FusionError> {
        if let Some(tick) = self.current.take() {
            self.spare_ticks.push(tick);
        }
        if self.ready.is_empty() {
            let n_ticks = self.waiting.len().min(self.cfg.batch.max(1));
            if n_ticks > 0 && (n_ticks == self.cfg.batch.max(1) || self.finishing) {
                self.run_batch(n_ticks)?;
            }
        }
        self.current = self.ready.pop_front();
        Ok(self.current.as_ref())
    }

    /// The configuration given at the start.
    pub fn config(&self) -> &FusionConfig {
        &self.cfg
    }

    /// The models, for another core.
    pub fn into_regressors(self) -> Vec<Box<dyn Regressor>> {
        self.models.into_iter().map(|model| model.regressor).collect()
    }

    /// The contract of the model of a region.
    pub fn contract(&self, region_idx: usize) -> &Contract {
        self.models[self.cfg.regions[region_idx].model].regressor.contract()
    }

    /// Joints that regions need and that no message has named so far.
    pub fn missing_joints(&self) -> impl Iterator<Item = &str> {
        self.joints.missing()
    }

    /// Current faults of the tactile sources.
    pub fn source_faults(&self) -> Vec<SourceFault<'_>> {
        let sources = self.cfg.tactile_sources.iter().zip(&self.sources);
        let faults = |(cfg, source): (_, &Source)| Some(source.cutter.health().faults(cfg, self.model_hz(source)?));
        sources.filter_map(faults).flatten().collect()
    }

    /// Rate fault of a tactile source, over all of its frames so far.
    pub fn rate_fault(&self, source: TactileSourceIdx) -> Option<RateFault<'_>> {
        let (cfg, source) = (&self.cfg.tactile_sources[source.0], &self.sources[source.0]);
        RateFault::judge(cfg, source.cutter.measured_rate_hz()?, self.model_hz(source)?)
    }

    /// Model rate that a source's regions share; `None` if no region uses the source.
    fn model_hz(&self, source: &Source) -> Option<f64> {
        Some(self.contract(*source.regions.first()?).rate_hz)
    }

    /// Frames that wait for joint states or for their batch.
    pub fn n_pending(&self) -> usize {
        self.waiting.len() + self.sources.iter().map(|source| source.pending.len()).sum::<usize>()
    }

    /// Input counters, by outcome.
    pub fn counters(&self) -> Counters<'_> {
        let tactile = self.cfg.tactile_sources.iter().zip(&self.sources);
        let joints = self.cfg.joint_sources.iter().zip(self.joints.counters());
        let regions = self.cfg.regions.iter().zip(&self.regions);
        Counters {
            tactile: tactile
                .map(|(cfg, Source { cutter, .. })| TactileCount {
                    name: &cfg.name,
                    counts: *cutter.counters(),
                    measured_rate_hz: cutter.measured_rate_hz(),
                })
                .collect(),
            joints: joints.map(|(cfg, counts)| Count { name: &cfg.name, counts: *counts }).collect(),
            regions: regions.map(|(cfg, region)| Count { name: &cfg.name, counts: region.counters }).collect(),
        }
    }

    fn handle_tactile(&mut self, block: &TactileBlock<'_>) {
        let source_idx = block.source.0;
        if self.sources[source_idx].cutter.handle_header(block) == Continuity::Jumped {
            self.settle(source_idx, block.received, true);
        }
        let (Source { cutter, pending, spare, regions, .. }, cfg) = (&mut self.sources[source_idx], &self.cfg);
        cutter.cut(block, |frame, health| {
            let mut waiting = spare.pop().unwrap_or_default();
            (waiting.stamp, waiting.epoch, waiting.number) = (frame.stamp, frame.epoch, frame.number);
            waiting.values.clear();
            waiting.values.extend_from_slice(frame.values);
            waiting.faults.clear();
            waiting.faults.extend(regions.iter().map(|&region_idx| health.flags(&cfg.regions[region_idx].taxels)));
            pending.push_back(waiting);
        });
        self.settle(source_idx, block.received, false);
    }

    /// Settles the frames whose joint angles are final: the later state has arrived, or the wait is over.
    fn settle(&mut self, source_idx: usize, received: Stamp, all: bool) {
        let slack_ns = nanos(self.cfg.timing.joint_slack);
        loop {
            let source = &mut self.sources[source_idx];
            let Some(frame) = source.pending.front() else { return };
            let over = source.cutter.newest().is_some_and(|newest| newest.nanos_since(frame.stamp) >= slack_ns);
            let settled = || source.joints.iter().all(|&joint_idx| self.joints.is_settled(joint_idx, frame.stamp));
            if !(all || over || settled()) {
                return;
            }
            let Some(frame) = source.pending.pop_front() else { return };
            self.queue_tick(source_idx, &frame, received);
            self.sources[source_idx].spare.push(frame);
        }
    }

    /// Shows a settled frame to every region of its source, and queues the windows that are ready.
    fn queue_tick(&mut self, source_idx: usize, frame: &PendingFrame, received: Stamp) {
        let source = &self.sources[source_idx];
        let mut tick = self.spare_pending.pop().unwrap_or_default();
        (tick.source, tick.stamp, tick.received) = (source_idx, frame.stamp, received);
        (tick.epoch, tick.number) = (frame.epoch, frame.number);
        tick.age_ns = (self.cfg.receipts == Receipts::Live).then(|| received.nanos_since(frame.stamp));
        let max_age_ns = self.cfg.timing.max_age.map(|max_age| nanos(max_age).unsigned_abs());
        let late = tick.age_ns.zip(max_age_ns).is_some_and(|(age_ns, max_ns)| age_ns.unsigned_abs() > max_ns);
        tick.regions.clear();
        tick.taxels.clear();
        let PendingFrame { stamp, epoch, number, ref values, ref faults } = *frame;
        for (&region_idx, &faults) in source.regions.iter().zip(faults) {
            let region = &mut self.regions[region_idx];
            let seen = Frame { stamp, epoch, number, values };
            let mut readiness = region.handle_frame(&seen, faults, source.baseline.as_ref(), &self.joints);
            if late {
                region.counters.late += 1;
                readiness.flags.insert(Flags::LATE);
            }
            if readiness.run {
                let Place { model, lane, .. } = region.place;
                self.models[model].push(lane, region.window());
            }
            tick.regions.push((region_idx, readiness));
            if self.cfg.keep_taxels {
                region.keep_taxels(&seen, &self.cfg.regions[region_idx].taxels, &mut tick.taxels);
            }
        }
        self.waiting.push_back(tick);
    }

    /// Runs the first `n_ticks` waiting frames, one call a model, and turns forces into estimates.
    fn run_batch(&mut self, n_ticks: usize) -> Result<(), FusionError> {
        let due = self.waiting.iter().take(n_ticks).flat_map(|tick| &tick.regions);
        for (region_idx, _) in due.filter(|(_, readiness)| readiness.run) {
            let Place { model, lane, .. } = self.regions[*region_idx].place;
            self.models[model].make_due(lane);
        }
        for model in &mut self.models {
            model.run()?;
        }
        for _ in 0..n_ticks {
            let Some(mut pending) = self.waiting.pop_front() else { break };
            let mut tick = self.spare_ticks.pop().unwrap_or_else(|| Tick {
                source: TactileSourceIdx(0),
                stamp: Stamp(0),
                epoch: 0,
                number: 0,
                received: Stamp(0),
                age_ns: None,
                estimates: Vec::new(),
                taxels: TickTaxels::default(),
            });
            tick.source = TactileSourceIdx(pending.source);
            (tick.stamp, tick.received) = (pending.stamp, pending.received);
            (tick.epoch, tick.number, tick.age_ns) = (pending.epoch, pending.number, pending.age_ns);
            tick.estimates.clear();
            std::mem::swap(&mut tick.taxels, &mut pending.taxels);
            for &(region_idx, ref readiness) in &pending.regions {
                let region = &mut self.regions[region_idx];
                let Place { model, lane, .. } = region.place;
                let answer = readiness.run.then(|| self.models[model].pop(lane)).flatten();
                tick.estimates.push(region.estimate(pending.stamp, readiness, answer));
            }
            self.spare_pending.push(pending);
            self.ready.push_back(tick);
        }
        Ok(())
    }
}
