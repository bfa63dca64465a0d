//! Fits the artifacts of a donning to the frames of its calibration.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Duration;

use super::{Donning, ZeroError};
use crate::bag::{Rest, printable};
use crate::fusion::{
    ArtifactFit, ArtifactFitter, ArtifactModel, Baseline, Event, Fusion, FusionConfig, FusionError, RegionIdx,
    SetupError,
};
use crate::recording::{RowCollector, Rows};

/// Number of consecutive frames that are needed. If fewer are missing, they are interpolated.
const WINDOW: NonZeroUsize = NonZeroUsize::new(16).expect("it is above 0");

/// Most names of joints that are compared. Two hands have 50.
const MAX_NAMES: usize = 128;

/// An artifact model, and the frame rate that it was made for, Hz.
pub type TimedArtifact = (Arc<ArtifactModel>, f64);

/// Time limits for the fit of an artifact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArtifactTimes {
    /// Maximum time of frames at zero load that are used for the fit.
    pub most: Duration,
    /// Minimum time of frames at zero load with joint angles, s.
    pub least_s: f64,
}

/// Collects, for each region, the frames to which its artifact is fitted.
#[derive(Debug)]
pub struct ArtifactCollector {
    times: ArtifactTimes,
    regions: Vec<Option<Collecting>>,
}

#[derive(Debug)]
struct Collecting {
    name: String,
    model: Arc<ArtifactModel>,
    rate_hz: f64,
    rest: Vec<Rest>,
    rows: RowCollector,
    core: Fusion,
    n_at_rest: usize,
    is_done: bool,
    /// Joints of the region that no message has had yet, and the names that messages had.
    missing: BTreeSet<String>,
    seen: BTreeSet<String>,
}

impl ArtifactCollector {
    /// A collector for the regions whose models have an artifact model.
    ///
    /// # Shapes
    /// `artifacts`: `[regions]`; `baselines` and `rest`: `[tactile sources]`.
    ///
    /// # Errors
    /// [`SetupError`] if a region doesn't fit its sources, or a baseline its source.
    pub fn new(
        cfg: &FusionConfig,
        artifacts: &[Option<TimedArtifact>],
        baselines: &[Baseline],
        rest: &[Vec<Rest>],
        times: ArtifactTimes,
    ) -> Result<Self, SetupError> {
        let at_rest = Donning { baselines: baselines.to_vec(), ..Donning::default() };
        let collecting = |region_idx: RegionIdx, (model, rate_hz): &TimedArtifact| {
            let only = cfg.clone().only(region_idx);
            let only = only.ok_or(SetupError::UnknownRegion { got: region_idx, n_regions: cfg.regions().len() })?;
            let region = &only.regions()[0];
            let (name, rest) = (region.name.clone(), rest[region.source.position()].clone());
            let (missing, seen) = (region.joints.iter().cloned().collect(), BTreeSet::new());
            let (rows, mut core) = RowCollector::new(only, WINDOW, *rate_hz, None)?;
            at_rest.install(&mut core)?;
            let (model, rate_hz) = (Arc::clone(model), *rate_hz);
            Ok(Collecting { name, model, rate_hz, rest, rows, core, n_at_rest: 0, is_done: false, missing, seen })
        };
        let all = artifacts.iter().enumerate();
        let regions = all.map(|(idx, artifact)| {
            artifact.as_ref().map(|artifact| collecting(RegionIdx::at(idx), artifact)).transpose()
        });
        Ok(ArtifactCollector { times, regions: regions.collect::<Result<_, SetupError>>()? })
    }

    /// True if more events are needed.
    pub fn wants_more(&self) -> bool {
        self.regions.iter().flatten().any(|region| !region.is_done)
    }

    /// Adds a sample.
    ///
    /// # Errors
    /// [`FusionError`], which the cores in this collector never return.
    pub fn handle(&mut self, event: Event<'_>) -> Result<(), FusionError> {
        for region in self.regions.iter_mut().flatten().filter(|region| !region.is_done) {
            if let (Event::Joints(sample), false) = (&event, region.missing.is_empty()) {
                for name in sample.names.iter().take(MAX_NAMES) {
                    if !region.missing.remove(name) && region.seen.len() < MAX_NAMES {
                        region.seen.insert(name.clone());
                    }
                }
            }
            region.core.handle(event)?;
            region.poll(self.times)?;
        }
        Ok(())
    }

    /// The fitted artifacts, starting from the previous ones. `None` for regions whose models have no artifact model.
    ///
    /// # Shapes
    /// `before` and the result: `[regions]`.
    ///
    /// # Errors
    /// [`ZeroError::ArtifactTooShort`], [`ZeroError::Artifact`].
    pub fn finish(mut self, before: &[Option<ArtifactFit>]) -> Result<Vec<Option<ArtifactFit>>, ZeroError> {
        let mut fits = Vec::with_capacity(self.regions.len());
        for (idx, region) in self.regions.iter_mut().enumerate() {
            let Some(mut region) = region.take() else {
                fits.push(None);
                continue;
            };
            region.core.handle_end();
            region.poll(self.times)?;
            fits.push(Some(region.fit(self.times, before.get(idx).and_then(Option::as_ref))?));
        }
        Ok(fits)
    }
}

impl Collecting {
    fn poll(&mut self, times: ArtifactTimes) -> Result<(), FusionError> {
        let enough = (times.most.as_secs_f64() * self.rate_hz) as usize;
        while let Some(tick) = self.core.poll()? {
            self.rows.handle_tick(tick);
            self.n_at_rest += usize::from(Rest::any_holds(&self.rest, tick.stamp) && tick.estimates[0].force.is_some());
            let is_over = self.rest.last().is_none_or(|last| tick.stamp > last.to);
            self.is_done |= self.n_at_rest >= enough || is_over;
        }
        Ok(())
    }

    fn fit(self, times: ArtifactTimes, before: Option<&ArtifactFit>) -> Result<ArtifactFit, ZeroError> {
        let Rows { stamp, tactile, pose, stretch } = self.rows.finish();
        let mut fitter = ArtifactFitter::new(Arc::clone(&self.model), self.rate_hz, before);
        let rows = tactile.chunks_exact(self.model.n_taxels).zip(pose.chunks_exact(self.model.n_joints));
        let mut last = None;
        for ((tactile, pose), (stamp, stretch)) in rows.zip(stamp.iter().zip(stretch)) {
            let follows = last.replace(stretch) == Some(stretch);
            fitter.handle_frame(tactile, pose, i32::from(follows), Rest::any_holds(&self.rest, *stamp));
        }
        let got_s = fitter.n_frames() as f64 / self.rate_hz;
        if got_s < times.least_s && !self.missing.is_empty() {
            let [missing, seen] = [&self.missing, &self.seen].map(|names| {
                let names: Vec<String> = names.iter().map(|name| printable(name)).collect();
                if names.is_empty() { "none".to_owned() } else { names.join(", ") }
            });
            return Err(ZeroError::MissingJoints { region: self.name, missing, seen });
        }
        if got_s < times.least_s {
            return Err(ZeroError::ArtifactTooShort { region: self.name, got_s, need_s: times.least_s });
        }
        fitter.finish().map_err(|error| ZeroError::Artifact { region: self.name, error })
    }
}
