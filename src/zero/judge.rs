//! Checks a zero by the forces that the models estimate while nothing should touch the glove.

use std::collections::BTreeMap;

use super::{ZeroError, ZeroFrom, forgiven};
use crate::bag::Rest;
use crate::config::{CalibrationConfig, Config};
use crate::fusion::{CalibrationLimits, Estimate, Flags, RegionConfig, RegionIdx, Tick, judge_loaded};

/// The limits at which a calibration is refused.
pub fn limits(cfg: &CalibrationConfig) -> CalibrationLimits {
    CalibrationLimits {
        min_s: cfg.min_duration.as_secs_f64(),
        max_force: cfg.max_force,
        max_loaded_fraction: cfg.max_loaded_fraction,
    }
}

/// Collects the models' forces in the frames at rest, and checks the zero by them.
#[derive(Debug, Clone)]
pub struct LoadCheck {
    from: ZeroFrom,
    /// `[tactile sources]`: spans at rest, in order of time.
    rest: Vec<Vec<Rest>>,
    /// `[tactile sources]`: true if its last span at rest is over.
    over: Vec<bool>,
    limits: CalibrationLimits,
    regions: BTreeMap<RegionIdx, Tally>,
}

#[derive(Debug, Clone, Default)]
struct Tally {
    n_frames: u64,
    n_estimates: u64,
    n_loaded: u64,
    n_without_pose: u64,
    without_estimate: BTreeMap<Flags, u64>,
}

impl LoadCheck {
    /// A check of a zero on the frames of these spans.
    ///
    /// # Shapes
    /// `rest`: `[tactile sources]`, each in order of time.
    pub fn new(from: ZeroFrom, rest: Vec<Vec<Rest>>, limits: CalibrationLimits) -> Self {
        LoadCheck { from, over: vec![false; rest.len()], rest, limits, regions: BTreeMap::new() }
    }

    /// Adds the estimates of a frame, if it is of a source that has spans at rest. True if more frames at rest may follow.
    pub fn takes(&mut self, tick: &Tick) -> bool {
        let source = tick.source.position();
        if let (Some(over @ false), Some(rest)) = (self.over.get_mut(source), self.rest.get(source)) {
            *over = rest.last().is_none_or(|last| tick.stamp > last.to);
            if Rest::any_holds(rest, tick.stamp) {
                tick.estimates.iter().for_each(|estimate| self.handle(estimate));
            }
        }
        self.over.contains(&false)
    }

    fn handle(&mut self, estimate: &Estimate) {
        let tally = self.regions.entry(estimate.region).or_default();
        // A window that is not full yet gives no information about the zero.
        if estimate.force.is_none() && estimate.flags.contains(Flags::WARMUP) {
            return;
        }
        tally.n_frames += 1;
        tally.n_without_pose += u64::from(estimate.flags.contains(Flags::STALE_POSE));
        match estimate.force {
            Some(force) => {
                tally.n_estimates += 1;
                tally.n_loaded += u64::from(force.0.abs() > self.limits.max_force.0);
            }
            None => *tally.without_estimate.entry(estimate.flags).or_default() += 1,
        }
    }

    /// Refuses a zero under load, or one for which there was no estimate. With `calibration.insist` it returns a note
    /// instead.
    ///
    /// # Errors
    /// [`ZeroError::Loaded`], [`ZeroError::LoadedHere`], [`ZeroError::Unjudged`].
    pub fn judge(&self, cfg: &Config) -> Result<Option<String>, ZeroError> {
        for (region, tally) in self.judged(cfg) {
            if let Err(error) = self.judge_region(region.name.clone(), tally) {
                return forgiven(cfg, error);
            }
        }
        Ok(None)
    }

    fn judge_region(&self, region: String, tally: &Tally) -> Result<(), ZeroError> {
        let commonest = tally.without_estimate.iter().max_by_key(|(_, n)| **n);
        if let (0, Some((flags, _))) = (tally.n_estimates, commonest) {
            return Err(ZeroError::Unjudged { region, n_frames: tally.n_frames, flags: *flags });
        }
        let percent = 100.0 * tally.n_loaded as f64 / tally.n_estimates as f64;
        let (limit, limit_percent) = (self.limits.max_force, 100.0 * self.limits.max_loaded_fraction);
        judge_loaded(tally.n_loaded, tally.n_estimates, &self.limits).map_err(|error| match &self.from {
            ZeroFrom::File { file } => {
                ZeroError::LoadedHere { region, file: file.clone(), percent, limit, limit_percent }
            }
            ZeroFrom::Annotations { .. } | ZeroFrom::First { .. } => {
                ZeroError::LoadedInBag { region, percent, limit, limit_percent }
            }
            ZeroFrom::Live { .. } => ZeroError::Loaded { region, error },
        })
    }

    /// Refuses a calibration in which most frames had no joint angles, because the model then did not see the movement.
    ///
    /// # Errors
    /// [`ZeroError::WithoutPose`], unless `calibration.insist` is set.
    pub fn check_pose(&self, cfg: &Config) -> Result<Option<String>, ZeroError> {
        for (region, tally) in self.judged(cfg) {
            if !region.joints.is_empty() && 2 * tally.n_without_pose > tally.n_frames {
                let percent = 100.0 * tally.n_without_pose as f64 / tally.n_frames as f64;
                return forgiven(cfg, ZeroError::WithoutPose { region: region.name.clone(), percent });
            }
        }
        Ok(None)
    }

    /// Regions of a configuration that had estimates.
    fn judged<'c>(&self, cfg: &'c Config) -> impl Iterator<Item = (&'c RegionConfig, &Tally)> {
        self.regions.iter().filter_map(|(idx, tally)| Some((cfg.fusion().region(*idx)?, tally)))
    }
}
