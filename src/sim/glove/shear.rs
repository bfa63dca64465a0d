//! The shear axes of taxels that have three: readings along x (to the little finger's side of a right hand) and y (to the nail's
//! edge) of the patch, beside those of pressure.
//!
//! For taxel i and axis k, as a fraction of full scale, before the electronics:
//!
//! ```text
//! s_ik = touch gain * slow gain * w_i(place) * (squeeze(force_k) + 0.15 compress(force) * (p_ik - place_k) / 6 mm)
//!        + c_ik pressure_i + a_ik artifact_i
//! ```
//!
//! then turned about the normal by how the glove sits on the finger.

use super::contact::{ContactField, compress};
use super::readout::Readout;
use super::{GloveDesign, Slipped};
use crate::random::Noise;
use crate::units::GramForce;

const BULGE: f64 = 0.15; // a pad that is pressed bulges outwards, and shears the taxels beside the touch
const BULGE_MM: f64 = 6.0; // the width of a contact patch
const CROSS_SD: f64 = 0.05; // of pressure in a shear axis: no taxel is made quite straight
const ARTIFACT: [f64; 2] = [0.2, 0.5]; // of a bend, as a share of that in pressure: skin stretches along the finger
const ARTIFACT_SD: f64 = 0.3;
const SEAT_RAD: f64 = 0.1; // sd, from donning to donning, of how the glove is turned on the finger
const SEAT_BY_SLIP_RAD: f64 = 0.2; // for a slip of 1

#[derive(Debug, Clone)]
struct Taxel {
    /// In the frame of the patch.
    at_mm: [f64; 2],
    half_gf: f64,
    cross: [f64; 2],
    artifact: [f64; 2],
}

/// The shear response of a glove on a hand.
#[derive(Debug)]
pub(super) struct ShearField {
    taxels: Vec<Taxel>,
    seat_rad: f64,
    readouts: [Readout; 2],
    noise: Noise,
}

impl ShearField {
    /// `hardware` is the glove's, `noise` that of this session: streams of their own, so that the readings of pressure are those
    /// of a glove without shear axes.
    pub(super) fn new(design: &GloveDesign, mut hardware: Noise, mut noise: Noise) -> Self {
        let taxels = design.taxels.iter().map(|&[x, y]| Taxel {
            at_mm: [-x, y], // designs count x to the thumb's side
            half_gf: design.half_saturation.0 * hardware.log_normal(0.08),
            cross: std::array::from_fn(|_| hardware.normal(CROSS_SD)),
            artifact: ARTIFACT.map(|share| share * (1.0 + hardware.normal(ARTIFACT_SD))),
        });
        let taxels = taxels.collect();
        let seat_rad = noise.normal(SEAT_RAD);
        let readouts = std::array::from_fn(|_| Readout::of_shear(design, &mut hardware, &mut noise));
        ShearField { taxels, seat_rad, readouts, noise }
    }

    /// Counts along x and y, `[2][taxels]`. `pressure` and `artifacts` are those of the same sample, `tangential` acts on the
    /// hand.
    pub(super) fn advance(
        &mut self,
        dt_s: f64,
        contact: &ContactField,
        tangential: [GramForce; 2],
        (pressure, artifacts): (&[f64], &[f64]),
        slip: &Slipped,
    ) -> [Vec<f32>; 2] {
        let felt = contact.felt();
        let place_mm = [-felt.spot_mm[0], felt.spot_mm[1]];
        let (sin, cos) = {
            let turned = self.seat_rad + SEAT_BY_SLIP_RAD * slip.common;
            (libm::sin(turned), libm::cos(turned))
        };
        let mut sheared = [Vec::new(), Vec::new()];
        for (idx, taxel) in self.taxels.iter().enumerate() {
            let reach = contact.reach_of(idx);
            let along: [f64; 2] = std::array::from_fn(|axis| {
                let bulge = BULGE * compress(felt.force_gf, taxel.half_gf);
                let bulge = bulge * (taxel.at_mm[axis] - place_mm[axis]) / BULGE_MM;
                felt.gain * reach * (squeeze(tangential[axis].0, taxel.half_gf) + bulge)
                    + taxel.cross[axis] * pressure[idx]
                    + taxel.artifact[axis] * artifacts[idx]
            });
            sheared[0].push(cos * along[0] - sin * along[1]);
            sheared[1].push(sin * along[0] + cos * along[1]);
        }
        let [x, y] = sheared;
        let [of_x, of_y] = &mut self.readouts;
        [of_x.advance(dt_s, x, &mut self.noise), of_y.advance(dt_s, y, &mut self.noise)]
    }
}

/// [`compress`] of a force that may point either way.
fn squeeze(force_gf: f64, half_gf: f64) -> f64 {
    compress(force_gf.abs(), half_gf).copysign(force_gf)
}
