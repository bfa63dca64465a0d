//! Where the zero of the forces comes from, and whether to believe it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::setup::{calibration_limits, input_topics};
use super::{Failure, say};
use crate::bag::{BagReader, Baselines, Inputs, ZeroLoad, collect_baselines};
use crate::calibration::Calibration;
use crate::config::Config;
use crate::fusion::{Baseline, CalibrationLimits, Fusion, Tick, judge_forces};
use crate::model::ModelInfo;
use crate::units::{Newton, Stamp};

/// What the command line says about it.
#[derive(Debug, clap::Args)]
pub(super) struct ZeroArgs {
    /// Take the baseline from this file, made by `tpf calibrate`
    #[arg(long, value_name = "FILE", conflicts_with = "calibrate_first")]
    calibration: Option<PathBuf>,
    /// Take the baseline from the first seconds, in which nothing may touch the glove
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    calibrate_first: Option<f64>,
}

/// Where a baseline came from, for summaries and files.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "from")]
pub(super) enum ZeroFrom {
    /// A calibration file.
    File { file: String },
    /// The stretches that annotations say are at zero load.
    Annotations { seconds: Vec<f64> },
    /// The first seconds.
    First { seconds: Vec<f64> },
    /// Live topics.
    #[cfg(feature = "ros")]
    Live { frames: u32 },
}

/// Baselines of all tactile sources, and what is left to check about them.
pub(super) struct Zero {
    pub(super) from: ZeroFrom,
    pub(super) baselines: Vec<Baseline>,
    pub(super) check: Option<LoadCheck>,
}

impl ZeroArgs {
    /// As if the command line asked for the first seconds, or for nothing.
    pub(super) fn first(calibrate_first: Option<f64>) -> Self {
        ZeroArgs { calibration: None, calibrate_first }
    }

    /// Finds the baseline: what the command line asks for, else annotations, else `calibration.file`, else the first
    /// `calibration.duration_s` seconds.
    pub(super) fn find(&self, cfg: &Config, bags: &[PathBuf], models: &[ModelInfo]) -> Result<Zero, Failure> {
        if let Some(file) = &self.calibration {
            return from_file(file, cfg, models);
        }
        if let Some(seconds) = self.calibrate_first {
            return from_bag(cfg, bags, ZeroLoad::First(seconds));
        }
        if Inputs::new(input_topics(cfg), &mut BagReader::open(bags)?)?.has_annotations() {
            return from_bag(cfg, bags, ZeroLoad::Annotated);
        }
        if let Some(file) = &cfg.calibration.file {
            return from_file(file, cfg, models);
        }
        let seconds = cfg.calibration.duration.as_secs_f64();
        say(&format!(
            "no stage annotations on {} and no calibration file: taking the first {seconds} s as zero load",
            cfg.stage_topic
        ));
        from_bag(cfg, bags, ZeroLoad::First(seconds))
    }
}

impl Zero {
    /// Gives a core its baselines.
    pub(super) fn install(&self, fusion: &mut Fusion) -> Result<(), Failure> {
        for (source_idx, baseline) in self.baselines.iter().enumerate() {
            fusion.handle_baseline(crate::fusion::TactileSourceIdx(source_idx), baseline.clone())?;
        }
        Ok(())
    }

    /// The baselines as a calibration file of this glove, user and these models.
    pub(super) fn to_calibration(&self, cfg: &Config, models: &[ModelInfo]) -> Calibration {
        let names = cfg.fusion.tactile_sources.iter().map(|source| source.name.clone());
        let sources: BTreeMap<String, Baseline> = names.zip(self.baselines.iter().cloned()).collect();
        let text = |value: &Option<String>| value.clone().unwrap_or_default();
        let mut calibration = Calibration::new(&text(&cfg.glove), &text(&cfg.user), self.from.to_string(), sources);
        let hashes = cfg.models.iter().zip(models).map(|(model, info)| (model.name.clone(), info.sha256.clone()));
        calibration.models = hashes.collect();
        calibration
    }
}

impl std::fmt::Display for ZeroFrom {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let spans = |seconds: &[f64]| seconds.iter().map(|s| format!("{s:.2} s")).collect::<Vec<_>>().join(", ");
        match self {
            ZeroFrom::File { file } => write!(f, "calibration {file}"),
            ZeroFrom::Annotations { seconds } => write!(f, "annotated zero-load stretches, {}", spans(seconds)),
            ZeroFrom::First { seconds } => write!(f, "the first {}", spans(seconds)),
            #[cfg(feature = "ros")]
            ZeroFrom::Live { frames } => write!(f, "{frames} live frames"),
        }
    }
}

/// Collects the forces that the models read while the baseline was taken, and judges them when that time is over.
pub(super) struct LoadCheck {
    ends: Vec<Stamp>,
    limits: CalibrationLimits,
    forces: BTreeMap<usize, Vec<Newton>>,
}

impl LoadCheck {
    /// Takes the estimates of a frame; whether frames are still to come before the calibration is over.
    pub(super) fn takes(&mut self, tick: &Tick) -> bool {
        let end = &mut self.ends[tick.source.0];
        if tick.stamp <= *end {
            for estimate in &tick.estimates {
                self.forces.entry(estimate.region).or_default().extend(estimate.force);
            }
        } else {
            *end = Stamp(i64::MIN);
        }
        self.ends.iter().any(|end| *end != Stamp(i64::MIN))
    }

    /// Refuses a calibration that looks loaded.
    pub(super) fn judge(&self, cfg: &Config) -> Result<(), Failure> {
        for (&region, forces) in &self.forces {
            judge_forces(forces, &self.limits)
                .map_err(|error| Failure(format!("region {}: {error}", cfg.fusion.regions[region].name)))?;
        }
        Ok(())
    }
}

fn from_file(path: &Path, cfg: &Config, models: &[ModelInfo]) -> Result<Zero, Failure> {
    let text = |value: &Option<String>| value.clone().unwrap_or_default();
    let sources = &cfg.fusion.tactile_sources;
    let calibration = Calibration::load(path, &text(&cfg.glove), &text(&cfg.user), sources)?;
    for (model, info) in cfg.models.iter().zip(models) {
        if calibration.models.get(&model.name).is_some_and(|hash| *hash != info.sha256) {
            let file = path.display();
            say(&format!("{file}: was judged with another model {} than this one; its baseline is used", model.name));
        }
    }
    let baselines = sources.iter().filter_map(|source| calibration.sources.get(&source.name).cloned()).collect();
    Ok(Zero { from: ZeroFrom::File { file: super::setup::shown(path) }, baselines, check: None })
}

fn from_bag(cfg: &Config, bags: &[PathBuf], zero_load: ZeroLoad) -> Result<Zero, Failure> {
    let mut reader = BagReader::open(bags)?;
    let mut inputs = Inputs::new(input_topics(cfg), &mut reader)?;
    let limits = calibration_limits(cfg);
    let Baselines { baselines, spans_s, ends } =
        collect_baselines(&mut reader, &mut inputs, &cfg.fusion, zero_load, &limits)?;
    let seconds = spans_s;
    Ok(match zero_load {
        ZeroLoad::Annotated => Zero { from: ZeroFrom::Annotations { seconds }, baselines, check: None },
        ZeroLoad::First(_) => {
            let check = Some(LoadCheck { ends, limits, forces: BTreeMap::new() });
            Zero { from: ZeroFrom::First { seconds }, baselines, check }
        }
    })
}

/// A span in seconds, from the command line.
pub(super) fn seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|_| format!("expected seconds, got {text:?}"))?;
    if seconds > 0.0 && seconds <= 3600.0 { Ok(seconds) } else { Err(format!("{seconds} s is outside of (0, 3600]")) }
}
