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
mod fit;
mod frames;
mod gain;
mod geometry;
mod health;
mod hold;
mod idx;
mod joints;
mod queue;
mod region;
mod regressor;

use std::borrow::Cow;
use std::collections::VecDeque;

pub use artifact::{
    ARTIFACT_BASIS, Adaptation, ArtifactError, ArtifactFilter, ArtifactFit, ArtifactFitter, ArtifactModel,
    DonningFrames, FRICTIONLESS_BASIS, Following, HISTORY_S, JointHistory, PLAY_RAD, TRUST_INPUTS, learn_artifact,
};
pub use calibration::{Baseline, BaselineBuilder, CalibrationError, CalibrationLimits, judge_loaded};
pub use config::{
    ContactBy, ContactThresholds, FrameClock, FusionConfig, JointSource, Receipts, RegionConfig, TOUCH_EVIDENCE,
    TactileSource, Timing,
};
#[cfg(feature = "train")]
pub(crate) use contact::log_odds;
pub use contact::{Contact, ContactDetector, ContactEvent};
pub use counters::{Count, Counters, TactileCount};
pub use error::{FusionError, SetupError};
pub use estimate::{Estimate, Flags, Tick, TickTaxels};
pub use event::{Event, JointSample, TactileBlock};
pub use frames::{RowStamps, TactileCounters};
pub use gain::{ForceGain, GainError, KnownTouch};
pub use geometry::{Patch, Wrench, split};
pub use health::{RateFault, SourceFault, SourceHealth};
pub use idx::{JointSourceIdx, ModelIdx, RegionIdx, TactileSourceIdx};
pub use joints::JointCounters;
pub use region::RegionCounters;
pub use regressor::{
    Contract, ForceAxes, ForceUnit, Forces, FrameSequence, PoseRange, RegionTerms, RegressError, Regressor,
    SharedWindows, TouchLevels, TouchOutput, WindowId, Windows,
};

use crate::units::{Stamp, nanos};
use frames::{Continuity, Frame, FrameCutter};
use joints::JointTimelines;
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
    regions: Vec<RegionIdx>,
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
    regions: Vec<(RegionIdx, Readiness)>,
    taxels: TickTaxels,
}

impl Fusion {
    /// A core without a baseline: every frame is UNCALIBRATED until [`Fusion::handle_baseline`].
    ///
    /// # Errors
    /// [`SetupError`] when regions and models don't fit each other: no such model, other numbers of taxels or joints, joints
    /// of other names, joints without a source, models of several rates for one source.
    pub fn new(cfg: FusionConfig, regressors: Vec<Box<dyn Regressor>>) -> Result<Self, SetupError> {
        for region in cfg.regions() {
            fit::check_region(region, &cfg, &regressors)?;
        }
        let mut joint_names: Vec<String> = cfg.regions().iter().flat_map(|region| region.joints.clone()).collect();
        joint_names.sort();
        joint_names.dedup();
        let joint_idxs = |region: &RegionConfig| -> Vec<usize> {
            region.joints.iter().filter_map(|joint| joint_names.iter().position(|name| name == joint)).collect()
        };
        let of_source = |(source_idx, source): (TactileSourceIdx, &TactileSource)| {
            let regions = || cfg.region_idxs().zip(cfg.regions()).filter(|(_, region)| region.source == source_idx);
            let mut joints: Vec<usize> = regions().flat_map(|(_, region)| joint_idxs(region)).collect();
            joints.sort_unstable();
            joints.dedup();
            let contract = regions().next().map(|(_, region)| regressors[region.model.position()].contract());
            let rate_hz = contract.map_or(DEFAULT_RATE_HZ, |contract| contract.rate_hz);
            Source {
                cutter: FrameCutter::new(source.clone(), rate_hz, cfg.timing()),
                baseline: None,
                regions: regions().map(|(region_idx, _)| region_idx).collect(),
                joints,
                pending: VecDeque::new(),
                spare: Vec::new(),
            }
        };
        let sources: Vec<Source> = cfg.tactile_source_idxs().zip(cfg.tactile_sources()).map(of_source).collect();
        let mut models: Vec<ModelQueue> = regressors.into_iter().map(ModelQueue::new).collect();
        let regions = cfg.region_idxs().zip(cfg.regions()).map(|(region_idx, region)| {
            let model = &mut models[region.model.position()];
            let place = Place { region: region_idx, model: region.model, lane: model.add_lane() };
            let contract = model.regressor.contract();
            let contract = contract.of_region(&region.name).unwrap_or(Cow::Borrowed(contract)); // checked above
            let max_gap_ns = sources[region.source.position()].cutter.max_gap_ns();
            let source = &cfg.tactile_sources()[region.source.position()];
            Region::new(place, region, source, &contract, joint_idxs(region), max_gap_ns, cfg.following())
        });
        Ok(Fusion {
            regions: regions.collect(),
            joints: JointTimelines::new(joint_names, cfg.joint_sources().to_vec(), cfg.timing()),
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
    ///
    /// # Errors
    /// [`FusionError::NoTactileSource`] and [`FusionError::NoJointSource`] when it comes of a source that this core doesn't
    /// have; nothing has changed then.
    pub fn handle(&mut self, event: Event<'_>) -> Result<(), FusionError> {
        match event {
            Event::Tactile(block) => {
                let (got, n_sources) = (block.source, self.sources.len());
                if got.position() >= n_sources {
                    return Err(FusionError::NoTactileSource { got, n_sources });
                }
                self.received = self.received.max(block.received);
                self.handle_tactile(&block);
            }
            Event::Joints(sample) => {
                let (got, n_sources) = (sample.source, self.cfg.joint_sources().len());
                if got.position() >= n_sources {
                    return Err(FusionError::NoJointSource { got, n_sources });
                }
                self.received = self.received.max(sample.received);
                self.joints.handle(&sample);
                for source_idx in 0..self.sources.len() {
                    self.settle(source_idx, sample.received, false);
                }
            }
        }
        Ok(())
    }

    /// Takes the baseline of a tactile source. Its windows start again, because their frames had another one subtracted.
    ///
    /// # Errors
    /// [`SetupError::UnknownTactileSource`], and [`SetupError::Baseline`] when its length isn't the source's number of
    /// taxels; nothing has changed then.
    pub fn handle_baseline(&mut self, source: TactileSourceIdx, baseline: Baseline) -> Result<(), SetupError> {
        let (got, n_sources) = (source, self.sources.len());
        let found = self.cfg.tactile_source(source).zip(self.sources.get_mut(source.position()));
        let (source_cfg, source) = found.ok_or(SetupError::UnknownTactileSource { got, n_sources })?;
        fit::check_baseline(&baseline, source_cfg)?;
        for region_idx in source.regions.iter().map(|region_idx| region_idx.position()) {
            self.regions[region_idx].handle_baseline(&self.cfg.regions()[region_idx], &baseline);
        }
        source.cutter.handle_noise(&baseline.noise);
        source.baseline = Some(baseline);
        Ok(())
    }

    /// Takes the artifact of a region's donning, after the baseline that it was fitted above. A region whose model has no
    /// artifact has no use for one.
    ///
    /// # Errors
    /// [`SetupError::UnknownRegion`], and [`SetupError::Artifact`] when it belongs to another model; nothing has changed
    /// then.
    pub fn handle_artifact(&mut self, region: RegionIdx, fit: ArtifactFit) -> Result<(), SetupError> {
        let (cfg, region) = self.region_mut(region)?;
        region.handle_artifact(fit).map_err(|error| SetupError::Artifact { region: cfg.name.clone(), error })
    }

    /// Takes the gain of a region's forces from known touches of this donning, after the baseline
    /// that they were measured above.
    ///
    /// # Errors
    /// [`SetupError::UnknownRegion`], and [`SetupError::Gain`] if no touches can give this gain; nothing has changed then.
    pub fn handle_force_gain(&mut self, region: RegionIdx, gain: &ForceGain) -> Result<(), SetupError> {
        let (cfg, region) = self.region_mut(region)?;
        gain.check().map_err(|error| SetupError::Gain { region: cfg.name.clone(), error })?;
        region.handle_force_gain(gain);
        Ok(())
    }

    /// Gain of a region's forces, from known touches of this donning. `None` if there are none, or no such region.
    pub fn force_gain(&self, region: RegionIdx) -> Option<&ForceGain> {
        self.regions.get(region.position())?.force_gain()
    }

    /// Filter of a region's artifact. `None` if its model has none, or if there is no such region.
    pub fn artifact(&self, region: RegionIdx) -> Option<&ArtifactFilter> {
        self.regions.get(region.position())?.artifact()
    }

    /// Takes other contact thresholds for the regions, from the next estimate on.
    ///
    /// # Shapes
    /// `thresholds`: `[regions]`.
    ///
    /// # Errors
    /// Those of [`FusionConfig::with_thresholds`]; nothing has changed then.
    pub fn handle_thresholds(&mut self, thresholds: &[ContactThresholds]) -> Result<(), SetupError> {
        self.cfg = self.cfg.clone().with_thresholds(thresholds)?;
        for (region, thresholds) in self.regions.iter_mut().zip(thresholds) {
            region.contact.handle_thresholds(*thresholds);
        }
        Ok(())
    }

    /// The baseline of a tactile source; `None` if it has none, or if there is no such source.
    pub fn baseline(&self, source: TactileSourceIdx) -> Option<&Baseline> {
        self.sources.get(source.position())?.baseline.as_ref()
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
            let batch = self.cfg.batch().get();
            let n_ticks = self.waiting.len().min(batch);
            if n_ticks > 0 && (n_ticks == batch || self.finishing) {
                self.run_batch(n_ticks)?;
            }
        }
        self.current = self.ready.pop_front();
        Ok(self.current.as_ref())
    }

    /// The configuration given at the start, with the contact thresholds that hold now.
    pub fn config(&self) -> &FusionConfig {
        &self.cfg
    }

    /// The models, for another core.
    pub fn into_regressors(self) -> Vec<Box<dyn Regressor>> {
        self.models.into_iter().map(|model| model.regressor).collect()
    }

    /// The contract of the model of a region; `None` if there is no such region.
    pub fn contract(&self, region: RegionIdx) -> Option<&Contract> {
        let region = self.cfg.region(region)?;
        Some(self.models.get(region.model.position())?.regressor.contract())
    }

    /// The contract of the model of each region, in the order of the regions.
    pub fn contracts(&self) -> impl Iterator<Item = &Contract> {
        self.cfg.region_idxs().filter_map(|region| self.contract(region))
    }

    /// Joints that regions need and that no message has named so far.
    pub fn missing_joints(&self) -> impl Iterator<Item = &str> {
        self.joints.missing()
    }

    /// Current faults of the tactile sources.
    pub fn source_faults(&self) -> Vec<SourceFault<'_>> {
        let sources = self.cfg.tactile_sources().iter().zip(&self.sources);
        let faults = |(cfg, source): (_, &Source)| Some(source.cutter.health().faults(cfg, self.model_hz(source)?));
        sources.filter_map(faults).flatten().collect()
    }

    /// Rate fault of a tactile source, over all of its frames so far. `None` if it has none, or if there is no such source.
    pub fn rate_fault(&self, source: TactileSourceIdx) -> Option<RateFault<'_>> {
        let (cfg, source) = self.cfg.tactile_source(source).zip(self.sources.get(source.position()))?;
        RateFault::judge(cfg, source.cutter.measured_rate_hz()?, self.model_hz(source)?)
    }

    /// Model rate that a source's regions share; `None` if no region uses the source.
    fn model_hz(&self, source: &Source) -> Option<f64> {
        Some(self.contract(*source.regions.first()?)?.rate_hz)
    }

    /// A region and its configuration.
    fn region_mut(&mut self, region: RegionIdx) -> Result<(&RegionConfig, &mut Region), SetupError> {
        let found = self.cfg.region(region).zip(self.regions.get_mut(region.position()));
        found.ok_or(SetupError::UnknownRegion { got: region, n_regions: self.cfg.regions().len() })
    }

    /// Frames that wait for joint states or for their batch.
    pub fn n_pending(&self) -> usize {
        self.waiting.len() + self.sources.iter().map(|source| source.pending.len()).sum::<usize>()
    }

    /// Input counters, by outcome.
    pub fn counters(&self) -> Counters<'_> {
        let tactile = self.cfg.tactile_sources().iter().zip(&self.sources);
        let joints = self.cfg.joint_sources().iter().zip(self.joints.counters());
        let regions = self.cfg.regions().iter().zip(&self.regions);
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
        let source_idx = block.source.position();
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
            waiting
                .faults
                .extend(regions.iter().map(|&region_idx| health.flags(&cfg.regions()[region_idx.position()].taxels)));
            pending.push_back(waiting);
        });
        self.settle(source_idx, block.received, false);
    }

    /// Settles the frames whose joint angles are final: the later state has arrived, or the wait is over.
    fn settle(&mut self, source_idx: usize, received: Stamp, all: bool) {
        let slack_ns = nanos(self.cfg.timing().joint_slack);
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
        tick.age_ns = (self.cfg.receipts() == Receipts::Live).then(|| received.nanos_since(frame.stamp));
        let max_age_ns = self.cfg.timing().max_age.map(|max_age| nanos(max_age).unsigned_abs());
        let late = tick.age_ns.zip(max_age_ns).is_some_and(|(age_ns, max_ns)| age_ns.unsigned_abs() > max_ns);
        tick.regions.clear();
        tick.taxels.clear();
        let PendingFrame { stamp, epoch, number, ref values, ref faults } = *frame;
        for (&region_idx, &faults) in source.regions.iter().zip(faults) {
            let region = &mut self.regions[region_idx.position()];
            let seen = Frame { stamp, epoch, number, values };
            let mut readiness = region.handle_frame(&seen, faults, source.baseline.as_ref(), &self.joints);
            if late {
                region.counters.late += 1;
                readiness.flags.insert(Flags::LATE);
            }
            if readiness.run {
                let Place { model, lane, .. } = region.place;
                self.models[model.position()].push(lane, region.window());
            }
            tick.regions.push((region_idx, readiness));
            if self.cfg.keeps_taxels() {
                region.keep_taxels(&seen, &self.cfg.regions()[region_idx.position()].taxels, &mut tick.taxels);
            }
        }
        self.waiting.push_back(tick);
    }

    /// Runs the first `n_ticks` waiting frames, one call a model, and turns forces into estimates.
    fn run_batch(&mut self, n_ticks: usize) -> Result<(), FusionError> {
        let due = self.waiting.iter().take(n_ticks).flat_map(|tick| &tick.regions);
        for (region_idx, _) in due.filter(|(_, readiness)| readiness.run) {
            let Place { model, lane, .. } = self.regions[region_idx.position()].place;
            self.models[model.position()].make_due(lane);
        }
        for model in &mut self.models {
            model.run()?;
        }
        for _ in 0..n_ticks {
            let Some(mut pending) = self.waiting.pop_front() else { break };
            let mut tick = self.spare_ticks.pop().unwrap_or_else(|| Tick {
                source: TactileSourceIdx::at(0),
                stamp: Stamp(0),
                epoch: 0,
                number: 0,
                received: Stamp(0),
                age_ns: None,
                estimates: Vec::new(),
                taxels: TickTaxels::default(),
            });
            tick.source = TactileSourceIdx::at(pending.source);
            (tick.stamp, tick.received) = (pending.stamp, pending.received);
            (tick.epoch, tick.number, tick.age_ns) = (pending.epoch, pending.number, pending.age_ns);
            tick.estimates.clear();
            std::mem::swap(&mut tick.taxels, &mut pending.taxels);
            for &(region_idx, ref readiness) in &pending.regions {
                let region = &mut self.regions[region_idx.position()];
                let Place { model, lane, .. } = region.place;
                let answer = readiness.run.then(|| self.models[model.position()].pop(lane)).flatten();
                tick.estimates.push(region.estimate(pending.stamp, readiness, answer));
            }
            self.spare_pending.push(pending);
            self.ready.push_back(tick);
        }
        Ok(())
    }
}
