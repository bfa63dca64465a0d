//! Pictures of the estimates for RViz and Foxglove: markers, images of the taxels, and the frames of patches.
//!
//! The engine hands over frames at the rate of pictures. The publishing thread draws those that somebody wants, between two
//! messages. The thread that reads inputs never waits for it.

mod colour;
mod image;
mod markers;

use std::time::Duration;

use self::image::image;
use self::markers::{frame, markers};
use crate::config::{Config, TaxelLayout, VisualsConfig};
use crate::fusion::{Estimate, Fusion, RegionConfig, TactileSourceIdx, Tick};
use crate::msg::{Image, MarkerArray, TFMessage};
use crate::units::{NANOS_PER_SEC, Stamp, nanos};

/// How long the largest reading determines the colours, as a time constant.
const MEMORY_S: f64 = 10.0;

/// A frame to draw: the regions of one tactile source.
#[derive(Debug, Clone)]
pub(super) struct Shown {
    source: TactileSourceIdx,
    pub(super) stamp: Stamp,
    pub(super) regions: Vec<ShownRegion>,
}

/// A region to draw.
#[derive(Debug, Clone)]
pub(super) struct ShownRegion {
    pub(super) estimate: Estimate,
    /// `[taxels]`: readings above the zero, positive under pressure; NaN where the zero is unknown.
    raw: Vec<f32>,
    /// `[taxels]`: the same as the model gets them, so without the artifact if it is removed; NaN where it gets none.
    corrected: Vec<f32>,
}

/// Chooses the frames to draw.
#[derive(Debug)]
pub(super) struct Selection {
    period_ns: i64,
    /// `[tactile sources]`: stamp of the last frame that was drawn.
    last: Vec<Option<Stamp>>,
    /// `[regions]`
    n_taxels: Vec<usize>,
}

impl Selection {
    pub(super) fn new(cfg: &Config) -> Self {
        let period_ns = NANOS_PER_SEC as f64 / cfg.live.visuals.rate_hz;
        Selection {
            period_ns: period_ns as i64,
            last: vec![None; cfg.fusion().tactile_sources().len()],
            n_taxels: cfg.fusion().regions().iter().map(|region| region.taxels.len()).collect(),
        }
    }

    /// The frame to draw, if it is time for one. Its readings are still as sent.
    pub(super) fn handle(&mut self, tick: &Tick) -> Option<Shown> {
        let last = &mut self.last[tick.source.position()];
        // After a jump of time in either direction, too.
        if last.is_some_and(|last| tick.stamp.nanos_since(last).abs() < self.period_ns) || tick.estimates.is_empty() {
            return None;
        }
        *last = Some(tick.stamp);
        let mut begin = 0;
        let region = |estimate: &Estimate| {
            let taxels = begin..begin + self.n_taxels[estimate.region.position()];
            begin = taxels.end;
            let (raw, corrected) = (tick.taxels.reading[taxels.clone()].to_vec(), tick.taxels.feature[taxels].to_vec());
            ShownRegion { estimate: *estimate, raw, corrected }
        };
        Some(Shown { source: tick.source, stamp: tick.stamp, regions: tick.estimates.iter().map(region).collect() })
    }
}

impl Shown {
    /// Takes the zero out of the readings.
    pub(super) fn subtract_zero(&mut self, fusion: &Fusion) {
        let (cfg, baseline) = (fusion.config(), fusion.baseline(self.source));
        let sign = if cfg.tactile_sources()[self.source.position()].inverted { -1.0 } else { 1.0 };
        for ShownRegion { estimate, raw, .. } in &mut self.regions {
            for (reading, &taxel_idx) in raw.iter_mut().zip(&cfg.regions()[estimate.region.position()].taxels) {
                *reading = baseline.map_or(f32::NAN, |baseline| sign * (*reading - baseline.median[taxel_idx]));
            }
        }
    }
}

/// Draws frames.
#[derive(Debug)]
pub(super) struct Drawing {
    cfg: VisualsConfig,
    /// `[regions]`
    regions: Vec<Scene>,
}

/// A region and what is known of its colours.
#[derive(Debug)]
struct Scene {
    region: RegionConfig,
    layout: TaxelLayout,
    /// Reading with the strongest colour.
    range: f32,
    drawn: Option<Stamp>,
}

impl Drawing {
    pub(super) fn new(cfg: &Config) -> Self {
        let visuals = cfg.live.visuals.clone();
        let range = visuals.taxel_range.unwrap_or(0.0) as f32;
        let scene = |(region, layout): (&RegionConfig, &TaxelLayout)| Scene {
            region: region.clone(),
            layout: layout.clone(),
            range,
            drawn: None,
        };
        Drawing { regions: cfg.fusion().regions().iter().zip(cfg.layouts()).map(scene).collect(), cfg: visuals }
    }

    /// Takes note of a frame before it is drawn: its largest reading.
    pub(super) fn handle(&mut self, shown: &Shown) {
        if self.cfg.taxel_range.is_some() {
            return;
        }
        for ShownRegion { estimate, raw, corrected } in &shown.regions {
            let scene = &mut self.regions[estimate.region.position()];
            let passed_s = scene.drawn.map_or(0.0, |drawn| shown.stamp.nanos_since(drawn) as f64 * 1e-9);
            scene.drawn = Some(shown.stamp);
            scene.range *= (-passed_s.max(0.0) / MEMORY_S).exp() as f32;
            let readings = raw.iter().chain(corrected).filter(|reading| reading.is_finite());
            scene.range = readings.map(|reading| reading.abs()).fold(scene.range, f32::max);
        }
    }

    /// The markers of a frame.
    pub(super) fn markers(&self, shown: &Shown) -> MarkerArray {
        let lifetime = Duration::from_secs_f64((3.0 / self.cfg.rate_hz).max(0.5)); // a source that stops vanishes
        let of_region = |region: &ShownRegion| {
            let scene = &self.regions[region.estimate.region.position()];
            markers(scene, region, shown.stamp, self.cfg.arrow_m_per_n, nanos(lifetime))
        };
        MarkerArray { markers: shown.regions.iter().flat_map(of_region).collect() }
    }

    /// The taxels of a region: as sent on the left, and where an artifact is removed from them, without it on the right.
    pub(super) fn image(&self, region: &ShownRegion, stamp: Stamp) -> Image {
        image(&self.regions[region.estimate.region.position()], region, stamp)
    }
}

/// The pose of each patch in the frame of its region.
pub(super) fn patch_frames(cfg: &Config, stamp: Stamp) -> TFMessage {
    let regions = cfg.fusion().regions().iter().zip(cfg.layouts());
    TFMessage { transforms: regions.map(|(region, layout)| frame(region, layout, stamp)).collect() }
}

#[cfg(test)]
mod tests;
