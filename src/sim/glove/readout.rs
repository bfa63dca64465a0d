//! Converts taxel values to the counts that the glove sends: gain, cross-talk, drift, low-pass, noise, quantization.

use super::GloveDesign;
use crate::random::{Lag, Noise, Wander};

const HARDWARE_GAIN_SD: f64 = 0.1; // from taxel to taxel, as made
const DONNING_GAIN_SD: f64 = 0.15; // all taxels of a donning: tightness
const DONNING_OFFSET_COUNTS: f64 = 60.0; // pre-load by a tight glove, a taxel
const CROSS_TALK: f64 = 0.06; // share of its neighbours that a taxel reads: common layers and shared lines
const CROSS_TALK_MM: f64 = 6.0; // how far neighbours are
const DRIFT: f64 = 0.01; // of full scale, sd
const DRIFT_S: f64 = 300.0;
const MAX_COUNTS: f64 = 4095.0; // 12 bit
const SHEAR_REST_COUNTS: f64 = 2048.0; // in the middle
const SHEAR_SPAN: f64 = 0.8; // of the counts of pressure: room for both ways

#[derive(Debug, Clone)]
struct Taxel {
    gain: f64,
    rest_counts: f64,
    neighbours: Vec<f64>,
    drift: Wander,
    low_pass: Lag,
}

/// The electronics of a glove.
#[derive(Debug, Clone)]
pub(super) struct Readout {
    taxels: Vec<Taxel>,
    span_counts: f64,
    noise: f64,
}

impl Readout {
    pub(super) fn new(design: &GloveDesign, hardware: &mut Noise, noise: &mut Noise) -> Self {
        let donning_gain = noise.log_normal(DONNING_GAIN_SD);
        let taxels = design.taxels.iter().enumerate().map(|(taxel_idx, at)| Taxel {
            gain: donning_gain * hardware.log_normal(HARDWARE_GAIN_SD),
            rest_counts: design.rest_counts + hardware.normal(40.0) + noise.normal(DONNING_OFFSET_COUNTS),
            neighbours: neighbours(design, taxel_idx, *at),
            drift: Wander::new(DRIFT, DRIFT_S, noise),
            low_pass: Lag::new(design.low_pass_s),
        });
        Readout { taxels: taxels.collect(), span_counts: design.span_counts, noise: design.noise }
    }

    /// The electronics of one shear axis, which reads both ways.
    pub(super) fn of_shear(design: &GloveDesign, hardware: &mut Noise, noise: &mut Noise) -> Self {
        let mut readout = Readout::new(design, hardware, noise);
        let shift = SHEAR_REST_COUNTS - design.rest_counts;
        readout.taxels.iter_mut().for_each(|taxel| taxel.rest_counts += shift);
        readout.span_counts = SHEAR_SPAN * design.span_counts.abs();
        readout
    }

    /// Counts as sent, for taxel values as fractions of full scale.
    pub(super) fn advance(&mut self, dt_s: f64, mut felt: Vec<f64>, noise: &mut Noise) -> Vec<f32> {
        for (felt, taxel) in felt.iter_mut().zip(&mut self.taxels) {
            *felt = *felt * taxel.gain + taxel.drift.advance(dt_s, noise);
        }
        let mixed: Vec<f64> = self
            .taxels
            .iter()
            .zip(&felt)
            .map(|(taxel, own)| own + taxel.neighbours.iter().zip(&felt).map(|(share, felt)| share * felt).sum::<f64>())
            .collect();
        let counts = self.taxels.iter_mut().zip(mixed).map(|(taxel, mixed)| {
            let read = taxel.low_pass.advance(dt_s, mixed) + noise.normal(self.noise);
            (taxel.rest_counts + self.span_counts * read).round().clamp(0.0, MAX_COUNTS) as f32
        });
        counts.collect()
    }
}

/// Cross-talk: the fraction of each other taxel's value in a taxel's reading.
fn neighbours(design: &GloveDesign, taxel_idx: usize, at: [f64; 2]) -> Vec<f64> {
    let near: Vec<bool> = design
        .taxels
        .iter()
        .enumerate()
        .map(|(other, to)| other != taxel_idx && libm::hypot(at[0] - to[0], at[1] - to[1]) < CROSS_TALK_MM)
        .collect();
    let n_near = near.iter().filter(|near| **near).count().max(1);
    near.into_iter().map(|near| if near { CROSS_TALK / n_near as f64 } else { 0.0 }).collect()
}
