//! The effect of a touch on the taxels: saturation, position, creep, and a gain that varies from touch to touch.

use super::GloveDesign;
use super::bends::Bends;
use crate::random::{Lag, Noise, Wander};
use crate::sim::performance::Contact;

/// Response of a soft layer that stiffens as it is compressed; 1 at 1000 gF.
///
/// # Source
/// Compressive, saturating response of foams and textiles: half of the maximum reading at `half_gf`.
pub(super) fn compress(force_gf: f64, half_gf: f64) -> f64 {
    force_gf / (force_gf + half_gf) * (1000.0 + half_gf) / 1000.0
}

/// The fraction of a contact at `spot` that a taxel gets, 0 to 1.
///
/// # Source
/// A fingertip on a flat surface makes a contact patch of some 6 mm that grows with the cube root of force (Hertz).
fn reach(taxel: [f64; 2], spot: [f64; 2], force_gf: f64) -> f64 {
    let width_mm = patch_mm(force_gf);
    libm::exp(-0.5 * square_of(taxel, spot) / (width_mm * width_mm))
}

/// [`reach`], averaged over the positions of touches that aim at the pad's centre.
pub(super) fn mean_reach(taxel: [f64; 2], force_gf: f64) -> f64 {
    let patch = patch_mm(force_gf) * patch_mm(force_gf);
    let spread = SPOT_SD_MM * SPOT_SD_MM + SPOT_WANDER_MM * SPOT_WANDER_MM + DONNING_SPOT_MM * DONNING_SPOT_MM;
    patch / (patch + spread) * libm::exp(-0.5 * square_of(taxel, [0.0; 2]) / (patch + spread))
}

fn patch_mm(force_gf: f64) -> f64 {
    6.0 * (0.8 + 0.25 * libm::cbrt(force_gf / 1000.0))
}

fn square_of(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
}

const CREEP: f64 = 0.08; // share of the force that the layer follows slowly
pub(super) const CREEP_S: [f64; 2] = [0.35, 2.5]; // fast and slow relaxation of elastomers
const PATTERN_SD: f64 = 0.1; // of a taxel's gain from touch to touch: skin never lies twice the same
const SPOT_SD_MM: f64 = 2.0; // where a touch lands
const SPOT_WANDER_MM: f64 = 1.0; // how it rolls about during a touch
const SPOT_BY_BEND_MM: f64 = 3.0; // a bent finger touches with its very tip
const SPOT_BY_SLIP_MM: f64 = 5.0; // for a slip of 1: taxels move with the glove
const DONNING_SPOT_MM: f64 = 1.0;
const SLOW_GAIN_S: f64 = 60.0; // temperature and moisture of the pad
const POSE_GAIN_SPREAD: f64 = 0.4; // of a taxel, as a share of the mean

#[derive(Debug, Clone)]
struct Taxel {
    at_mm: [f64; 2],
    half_gf: f64,
    pose_gain: f64,
    pattern: f64,
}

/// The force response of a glove on a hand.
#[derive(Debug, Clone)]
pub(super) struct ContactField {
    taxels: Vec<Taxel>,
    touch_gain_sd: f64,
    touch: Option<usize>,
    touch_gain: f64,
    touch_spot_mm: [f64; 2],
    worn_at_mm: [f64; 2],
    wander_mm: [Wander; 2],
    slow_gain: Wander,
    creep: [Lag; 2],
    felt: Felt,
}

/// A touch as the glove feels it at one point in time.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Felt {
    /// Gain of all taxels.
    pub(super) gain: f64,
    /// Where the finger is touched, mm.
    pub(super) spot_mm: [f64; 2],
    /// Force after creep, gF.
    pub(super) force_gf: f64,
}

impl ContactField {
    pub(super) fn new(design: &GloveDesign, hardware: &mut Noise, noise: &mut Noise) -> Self {
        let donning_softness = noise.log_normal(0.08); // how tight the glove sits
        let taxels = design.taxels.iter().map(|&at_mm| Taxel {
            at_mm,
            half_gf: design.half_saturation.0 * hardware.log_normal(0.08) * donning_softness,
            pose_gain: design.pose_gain * (1.0 + hardware.normal(POSE_GAIN_SPREAD)),
            pattern: 1.0,
        });
        ContactField {
            taxels: taxels.collect(),
            touch_gain_sd: design.touch_gain,
            touch: None,
            touch_gain: 1.0,
            touch_spot_mm: [0.0; 2],
            worn_at_mm: std::array::from_fn(|_| noise.normal(DONNING_SPOT_MM)),
            wander_mm: std::array::from_fn(|_| Wander::new(SPOT_WANDER_MM, 1.0, noise)),
            slow_gain: Wander::new(design.slow_gain, SLOW_GAIN_S, noise),
            creep: CREEP_S.map(Lag::new),
            felt: Felt::default(),
        }
    }

    /// The touch as it was felt at the last sample.
    pub(super) fn felt(&self) -> Felt {
        self.felt
    }

    /// The fraction of the touch that a taxel got at the last sample, 0 to 1.
    pub(super) fn reach_of(&self, taxel_idx: usize) -> f64 {
        let Felt { spot_mm, force_gf, .. } = self.felt;
        self.taxels.get(taxel_idx).map_or(0.0, |taxel| reach(taxel.at_mm, spot_mm, force_gf))
    }

    /// Readings caused by force, fraction of full scale.
    pub(super) fn advance(
        &mut self,
        dt_s: f64,
        bends: &Bends,
        contact: Option<Contact>,
        slip: f64,
        noise: &mut Noise,
    ) -> Vec<f64> {
        if let Some(Contact { touch, .. }) = contact.filter(|contact| self.touch != Some(contact.touch)) {
            self.touch = Some(touch);
            self.touch_gain = noise.log_normal(self.touch_gain_sd);
            self.touch_spot_mm = std::array::from_fn(|_| noise.normal(SPOT_SD_MM));
            for taxel in &mut self.taxels {
                taxel.pattern = noise.log_normal(PATTERN_SD);
            }
        }
        let gain = self.touch_gain * libm::exp(self.slow_gain.advance(dt_s, noise));
        let wander_mm = self.wander_mm.each_mut().map(|wander| wander.advance(dt_s, noise));
        let mut spot_mm: [f64; 2] =
            std::array::from_fn(|axis| self.worn_at_mm[axis] + self.touch_spot_mm[axis] + wander_mm[axis]);
        spot_mm[1] += SPOT_BY_BEND_MM * bends.flexion() + SPOT_BY_SLIP_MM * slip;
        let force_gf = contact.map_or(0.0, |contact| contact.force.0);
        let [fast, slow] = self.creep.each_mut().map(|creep| creep.advance(dt_s, force_gf));
        let felt_gf = (1.0 - CREEP) * force_gf + CREEP * 0.5 * (fast + slow);
        self.felt = Felt { gain, spot_mm, force_gf: felt_gf };
        let locality = bends.local();
        let reading = |taxel: &Taxel| {
            let by_pose = (1.0 + taxel.pose_gain * locality).max(0.1);
            let pressed = reach(taxel.at_mm, spot_mm, felt_gf) * compress(felt_gf, taxel.half_gf);
            gain * taxel.pattern * by_pose * pressed
        };
        self.taxels.iter().map(reading).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn response_is_compressive_and_one_at_1000_gram_force() {
        assert!((compress(1000.0, 900.0) - 1.0).abs() < 1e-12);
        assert!(compress(500.0, 900.0) > 0.5 && compress(500.0, 350.0) > compress(500.0, 900.0));
    }
}
