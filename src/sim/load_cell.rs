//! The synthetic force truth: a six-axis load cell under a flat end effector, as the paper used.

use super::performance::Contact;
use crate::random::{Noise, Wander};
use crate::units::Newton;

/// A load cell sample: the force and torque on it, with z pointing into it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadCellReading {
    /// N, x y z. z is the normal force of the fingertip, positive under pressure, untared.
    pub force: [f64; 3],
    /// N m, x y z, about the centre of the end effector's face.
    pub torque: [f64; 3],
}

/// A load cell with resolution, noise and a zero that drifts.
///
/// # Source
/// ATI Nano17 SI-12-0.12: 1/320 N (0.32 gF, as in the paper) and 1/64 N mm. The paper tares dynamically because the
/// zero drifts; here the drift is warm-up (0.06 N, a quarter of an hour) and a slow wander. Noise is about one count.
#[derive(Debug)]
pub(crate) struct LoadCell {
    offset: [f64; 6],
    warm_up: [f64; 6],
    wander: [Wander; 6],
    friction: [Wander; 2],
    spot_mm: [Wander; 2],
    noise: Noise,
    now_s: f64,
}

const FORCE_STEP: f64 = 1.0 / 320.0; // N
const TORQUE_STEP: f64 = 1.0 / 64_000.0; // N m
const WARM_UP_S: f64 = 900.0;

impl LoadCell {
    pub(crate) fn new(mut noise: Noise) -> Self {
        let scale = |axis: usize| if axis < 3 { 1.0 } else { 0.005 }; // N to N m
        LoadCell {
            offset: std::array::from_fn(|axis| noise.normal(0.4) * scale(axis)),
            warm_up: std::array::from_fn(|axis| noise.normal(0.06) * scale(axis)),
            wander: std::array::from_fn(|axis| Wander::new(0.006 * scale(axis), 400.0, &mut noise)),
            friction: std::array::from_fn(|_| Wander::new(0.06, 0.5, &mut noise)),
            spot_mm: std::array::from_fn(|_| Wander::new(2.0, 2.0, &mut noise)),
            noise,
            now_s: 0.0,
        }
    }

    /// Sets its zero: the reading under no load, N along z and nothing else.
    pub(crate) fn set_zero(&mut self, normal: f64) {
        self.offset = [0.0, 0.0, normal, 0.0, 0.0, 0.0];
    }

    /// The reading at `t_s`, which never goes back.
    pub(crate) fn read(&mut self, t_s: f64, contact: Option<Contact>) -> LoadCellReading {
        let dt_s = (t_s - self.now_s).max(0.0);
        self.now_s = t_s;
        let noise = &mut self.noise;
        let [drag_x, drag_y] = self.friction.each_mut().map(|drag| drag.advance(dt_s, noise));
        let [x_m, y_m] = self.spot_mm.each_mut().map(|spot| spot.advance(dt_s, noise) * 1e-3);
        let normal = contact.map_or(0.0, |contact| Newton::from(contact.force).0);
        let (fx, fy) = match contact.and_then(|contact| contact.tangential) {
            None => (normal * drag_x, normal * drag_y),
            // On the cell, whose x is that of the patch, and whose y and z are the other way.
            Some([x, y]) => (-Newton::from(x).0, Newton::from(y).0),
        };
        let load = [fx, fy, normal, y_m * normal, -x_m * normal, x_m * fy - y_m * fx];
        let warm = 1.0 - libm::exp(-t_s / WARM_UP_S);
        let reading: [f64; 6] = std::array::from_fn(|axis| {
            let step = if axis < 3 { FORCE_STEP } else { TORQUE_STEP };
            let zero = self.offset[axis] + self.warm_up[axis] * warm + self.wander[axis].advance(dt_s, noise);
            ((load[axis] + zero + noise.normal(step)) / step).round() * step
        });
        let [fx, fy, fz, tx, ty, tz] = reading;
        LoadCellReading { force: [fx, fy, fz], torque: [tx, ty, tz] }
    }
}
