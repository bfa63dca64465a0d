//! A calibration in the air while the node runs: samples are collected, then the model judges them before their
//! baseline is used. Pure: time is an argument.

use std::time::Duration;

use crate::config::Config;
use crate::fusion::{
    ArtifactFit, Baseline, BaselineBuilder, CalibrationLimits, Contract, Event, Fusion, JointSample, JointSourceIdx,
    RegionConfig, TactileBlock, TactileSource, TactileSourceIdx,
};
use crate::msg::{CalibrateFeedback, CalibrateResult, Duration as WireDuration};
use crate::units::{NANOS_PER_SEC, Newton, Stamp, nanos};
use crate::zero::{self, ArtifactCollector, ArtifactTimes, Donning, LoadCheck, Movement, Rest, ZeroError, ZeroFrom};

/// The hand is at rest during the whole calibration.
const EVER: Rest = Rest { from: Stamp(i64::MIN), to: Stamp(i64::MAX) };

/// What the wearer should do while the zero is measured.
pub const IN_AIR: &str =
    "in the air: open and close the hand, spread the fingers, go through the poses that you use; touch nothing";

/// What the wearer should do after it, if touches of the force sensors are looked for.
pub const TOUCH: &str =
    "touch the force sensor: each region at least three times with 30 gF or more, half a second each";

/// An event that owns its data, so that it can be stored.
#[derive(Debug, Clone, PartialEq)]
pub enum Sample {
    /// As [`TactileBlock`].
    #[allow(missing_docs)] // there
    Tactile {
        source: TactileSourceIdx,
        stamp: Stamp,
        rows: usize,
        row_period_ns: i64,
        sequence: Option<u32>,
        values: Vec<f32>,
    },
    /// As [`JointSample`].
    #[allow(missing_docs)] // there
    Joints { source: JointSourceIdx, stamp: Stamp, names: Vec<String>, positions: Vec<f64> },
}

impl From<&Event<'_>> for Sample {
    fn from(event: &Event<'_>) -> Self {
        match event {
            Event::Tactile(block) => Sample::Tactile {
                source: block.source,
                stamp: block.stamp,
                rows: block.rows,
                row_period_ns: block.row_period_ns,
                sequence: block.sequence,
                values: block.values.to_vec(),
            },
            Event::Joints(sample) => Sample::Joints {
                source: sample.source,
                stamp: sample.stamp,
                names: sample.names.to_vec(),
                positions: sample.positions.to_vec(),
            },
        }
    }
}

impl Sample {
    /// The sample as the core takes it; its receipt is its stamp.
    pub fn event(&self) -> Event<'_> {
        match self {
            Sample::Tactile { source, stamp, rows, row_period_ns, sequence, values } => Event::Tactile(TactileBlock {
                source: *source,
                stamp: *stamp,
                rows: *rows,
                row_period_ns: *row_period_ns,
                sequence: *sequence,
                values,
                received: *stamp,
            }),
            Sample::Joints { source, stamp, names, positions } => {
                Event::Joints(JointSample { source: *source, stamp: *stamp, names, positions, received: *stamp })
            }
        }
    }
}

/// The purpose of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// A full calibration, in which the hand goes through its poses.
    Calibrate,
    /// A quick new zero, in which the hand may stay still.
    Tare,
}

/// A calibration in progress.
pub struct Calibrator {
    cfg: Config,
    purpose: Purpose,
    duration: Duration,
    builders: Vec<BaselineBuilder>,
    frames: u32,
    movement: Movement,
    samples: Vec<Sample>,
}

impl Calibrator {
    /// A calibration that collects for `duration`.
    pub fn new(cfg: &Config, purpose: Purpose, duration: Duration) -> Self {
        let hole_ns = nanos(cfg.fusion().timing().max_gap).max(NANOS_PER_SEC / 2);
        let builder = |(source_idx, source): (TactileSourceIdx, &TactileSource)| {
            BaselineBuilder::new(source.n_taxels, hole_ns).needing(cfg.fusion().taxels_in_use(source_idx))
        };
        let builders = cfg.fusion().tactile_source_idxs().zip(cfg.fusion().tactile_sources()).map(builder).collect();
        Calibrator {
            cfg: cfg.clone(),
            purpose,
            duration,
            builders,
            frames: 0,
            movement: Movement::default(),
            samples: Vec::new(),
        }
    }

    /// Takes a sample.
    pub fn handle(&mut self, sample: Sample) {
        match &sample {
            Sample::Tactile { source, stamp, rows, row_period_ns, values, .. } => {
                let cfg = &self.cfg.fusion().tactile_sources()[source.position()];
                if rows.checked_mul(cfg.n_taxels) != Some(values.len()) {
                    return; // the core counts it
                }
                for (row_idx, row) in values.chunks_exact(cfg.n_taxels).enumerate() {
                    let before_last = (rows - 1 - row_idx) as i64;
                    let stamp = stamp.offset(cfg.stamp_offset_ns - row_period_ns.saturating_mul(before_last));
                    self.builders[source.position()].handle_sample(stamp, row);
                    self.frames = self.frames.saturating_add(1);
                }
            }
            Sample::Joints { source, names, positions, .. } => {
                self.movement.handle(names, positions, self.cfg.fusion().joint_sources()[source.position()].scale);
            }
        }
        self.samples.push(sample);
    }

    /// The samples so far.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// Progress of the calibration, of which this much is left.
    pub fn feedback(&self, left: Duration) -> CalibrateFeedback {
        let (joints, joint_span) = self.movement.spans();
        CalibrateFeedback {
            instruction: String::new(),
            time_left: WireDuration::from_nanos(nanos(left)),
            joints,
            joint_span,
            sources: self.source_names(),
            source_taxels: self.source_taxels(),
            noise: self.noise(),
        }
    }

    /// Ends the calibration. Returns the baselines to use, or `None`; the result then gives the reason.
    ///
    /// `judge` is a core of the same configuration that has received no input yet. `before`: the facts about the
    /// donning that were known before and are still true.
    pub fn finish(&self, judge: Fusion, before: &Donning) -> (Option<Donning>, CalibrateResult) {
        let (joints, joint_span) = self.movement.spans();
        let mut result = CalibrateResult {
            frames: self.frames,
            joints,
            joint_span,
            sources: self.source_names(),
            source_taxels: self.source_taxels(),
            ..CalibrateResult::default()
        };
        match self.judged(judge, before) {
            Ok((donning, noted)) => {
                let baselines = &donning.baselines;
                result.success = true;
                result.message = noted;
                result.noise = baselines.iter().flat_map(|baseline| baseline.noise.iter().copied()).collect();
                let faulty = baselines.iter().flat_map(|baseline| &baseline.faulty).zip(0_u32..);
                result.faulty_taxels = faulty.filter(|(faulty, _)| **faulty).map(|(_, idx)| idx).collect();
                (Some(donning), result)
            }
            Err(reason) => {
                result.noise = self.noise();
                result.message = reason;
                (None, result)
            }
        }
    }

    /// The findings, and the messages about them.
    fn judged(&self, judge: Fusion, before: &Donning) -> Result<(Donning, String), String> {
        let limits = zero::limits(&self.cfg.calibration);
        let limits = CalibrationLimits { min_s: limits.min_s.min(self.duration.as_secs_f64() / 2.0), ..limits };
        if self.purpose == Purpose::Calibrate {
            self.movement.check(&self.cfg).map_err(|error| error.to_string())?;
        }
        let of_source = |(builder, source): (&BaselineBuilder, &TactileSource)| {
            builder.finish(&limits).map_err(|error| format!("tactile source {}: {error}", source.name))
        };
        let sources = self.cfg.fusion().tactile_sources();
        let baselines: Vec<Baseline> = self.builders.iter().zip(sources).map(of_source).collect::<Result<_, _>>()?;
        let artifacts =
            self.artifacts(&judge, &baselines, limits, &before.artifacts).map_err(|error| error.to_string())?;
        let donning = Donning { baselines, artifacts, force_gains: before.force_gains.clone() };
        let noted = self.check_load(judge, &donning, limits).map_err(|error| error.to_string())?;
        Ok((donning, noted.join("; ")))
    }

    /// The artifacts of the collected samples, for models that estimate artifacts.
    fn artifacts(
        &self,
        judge: &Fusion,
        baselines: &[Baseline],
        limits: CalibrationLimits,
        before: &[Option<ArtifactFit>],
    ) -> Result<Vec<Option<ArtifactFit>>, ZeroError> {
        let of_region = |(contract, region): (&Contract, &RegionConfig)| {
            let contract = contract.of_region(&region.name)?;
            Some((contract.artifact.clone()?, contract.rate_hz))
        };
        let artifacts: Vec<_> = judge.contracts().zip(judge.config().regions()).map(of_region).collect();
        let rest = vec![vec![EVER]; baselines.len()];
        let times = ArtifactTimes { most: self.duration, least_s: limits.min_s };
        let mut collector = ArtifactCollector::new(self.cfg.fusion(), &artifacts, baselines, &rest, times)?;
        for sample in self.samples.iter().take_while(|_| artifacts.iter().any(Option::is_some)) {
            collector.handle(sample.event())?;
        }
        collector.finish(before)
    }

    /// Runs the models on the collected samples.
    fn check_load(
        &self,
        mut judge: Fusion,
        donning: &Donning,
        limits: CalibrationLimits,
    ) -> Result<Vec<String>, Box<dyn std::error::Error>> {
        donning.install(&mut judge)?;
        let mut check =
            LoadCheck::new(ZeroFrom::Live { frames: self.frames }, vec![vec![EVER]; donning.baselines.len()], limits);
        for sample in &self.samples {
            judge.handle(sample.event())?;
            while let Some(tick) = judge.poll()? {
                check.takes(tick);
            }
        }
        let mut noted: Vec<String> = check.judge(&self.cfg)?.into_iter().collect();
        if self.purpose == Purpose::Calibrate {
            noted.extend(check.check_pose(&self.cfg)?);
        }
        Ok(noted)
    }

    fn source_names(&self) -> Vec<String> {
        self.cfg.fusion().tactile_sources().iter().map(|source| source.name.clone()).collect()
    }

    fn source_taxels(&self) -> Vec<u32> {
        self.cfg.fusion().tactile_sources().iter().map(|source| source.n_taxels as u32).collect()
    }

    /// Noise of each taxel so far; NaN if there is none yet.
    fn noise(&self) -> Vec<f32> {
        let limits = CalibrationLimits { min_s: 0.0, max_force: Newton(f64::MAX), max_loaded_fraction: 1.0 };
        let of_source = |(builder, source): (&BaselineBuilder, &TactileSource)| {
            builder.finish(&limits).map_or_else(|_| vec![f32::NAN; source.n_taxels], |baseline| baseline.noise)
        };
        self.builders.iter().zip(self.cfg.fusion().tactile_sources()).flat_map(of_source).collect()
    }
}
