//! The effect of a pose on the taxels without any touch: the pose-related artifact.

use super::bends::{Bends, FULL_BEND, FULL_RAD, LOCALITY, pattern};
use super::contact::CREEP_S;
use super::coupled::Coupled;
use super::{GloveDesign, Slipped};
use crate::random::{Lag, Noise};
use crate::sim::hand::{Finger, HandPose};

const QUADRATIC: f64 = 0.3; // share of the artifact that grows with the square: fabric wrinkles late in a bend
const CREEP: f64 = 0.15; // share of the strain that the glove follows slowly
const RATE_S: f64 = 0.015; // viscous part: strain by speed of the bend
const RATE_LAG_S: f64 = 0.05;
const PLAY: [f64; 2] = [0.08, 0.2]; // half-widths of two play operators, shares of a full bend
const USER_SD: f64 = 0.3; // of the artifact, from user to user: finger size and fit
const USER_JOINT_SD: f64 = 0.1; // of a joint's weight: where creases lie
const DONNING_SD: f64 = 0.25; // of the artifact, from donning to donning
/// Share of thumb and neighbours in the artifact of other fingers, by the finger with the taxels: neighbours pull most.
fn others_of(finger: Finger) -> [(Finger, f64); 4] {
    use Finger::{Index, Little, Middle, Ring, Thumb};
    match finger {
        Index => [(Middle, 0.6), (Ring, 0.15), (Little, 0.05), (Thumb, 0.2)],
        Middle => [(Index, 0.4), (Ring, 0.4), (Little, 0.1), (Thumb, 0.1)],
        Ring => [(Middle, 0.4), (Little, 0.4), (Index, 0.1), (Thumb, 0.1)],
        Little => [(Ring, 0.6), (Middle, 0.2), (Index, 0.1), (Thumb, 0.1)],
        Thumb => [(Index, 0.6), (Middle, 0.2), (Ring, 0.1), (Little, 0.1)],
    }
}

/// Converts one joint's bend to strain.
#[derive(Debug, Clone)]
struct Material {
    hysteresis: f64,
    play: [Option<f64>; 2],
    creep: [Lag; 2],
    rate: Lag,
}

impl Material {
    fn new(hysteresis: f64) -> Self {
        Material { hysteresis, play: [None; 2], creep: CREEP_S.map(Lag::new), rate: Lag::new(RATE_LAG_S) }
    }

    /// Strain `dt_s` later: hysteresis by play operators (friction of fabric on skin), then creep and rate.
    fn advance(&mut self, dt_s: f64, bend: f64) -> f64 {
        let mut lagging = 0.0;
        for (play, half_width) in self.play.iter_mut().zip(PLAY) {
            let moved = play.unwrap_or(bend).clamp(bend - half_width, bend + half_width);
            *play = Some(moved);
            lagging += moved / PLAY.len() as f64;
        }
        let strain = (1.0 - self.hysteresis) * bend + self.hysteresis * lagging;
        let [fast, slow] = self.creep.each_mut().map(|creep| creep.advance(dt_s, strain));
        let rate = (strain - self.rate.advance(dt_s, strain)) / RATE_LAG_S;
        (1.0 - CREEP) * strain + CREEP * 0.5 * (fast + slow) + RATE_S * rate
    }
}

#[derive(Debug, Clone)]
struct Taxel {
    linear: [f64; 4],
    quadratic: [f64; 4],
    others: f64,
}

/// The pose response of a glove on a hand.
#[derive(Debug, Clone)]
pub(super) struct StrainField {
    finger: Finger,
    size: f64,
    joints: [Material; 4],
    taxels: Vec<Taxel>,
    coupled: Option<Coupled>,
}

impl StrainField {
    pub(super) fn new(
        finger: Finger,
        design: &GloveDesign,
        hardware: &mut Noise,
        user: &mut Noise,
        noise: &mut Noise,
    ) -> Self {
        let size = design.nominal_response(design.bend_artifact) / FULL_BEND
            * user.log_normal(USER_SD)
            * noise.log_normal(DONNING_SD);
        let user_joint: [f64; 4] = std::array::from_fn(|_| user.log_normal(USER_JOINT_SD));
        let n_taxels = design.taxels.len();
        let mut patterns =
            |n_joints: usize| -> Vec<Vec<f64>> { (0..n_joints).map(|_| pattern(n_taxels, hardware)).collect() };
        let (linear, quadratic, others) = (patterns(4), patterns(4), pattern(n_taxels, hardware));
        let weight = |j: usize, share: f64, own: f64| size * LOCALITY[j] * user_joint[j] * share * own;
        let taxels = (0..n_taxels).map(|taxel| Taxel {
            linear: std::array::from_fn(|j| weight(j, 1.0 - QUADRATIC, linear[j][taxel])),
            quadratic: std::array::from_fn(|j| weight(j, QUADRATIC, quadratic[j][taxel])),
            others: size * FULL_BEND * design.other_fingers * others[taxel],
        });
        let joints = std::array::from_fn(|_| Material::new(design.hysteresis));
        StrainField { finger, size, joints, taxels: taxels.collect(), coupled: None }
    }

    /// Replaces the artifact that is separable by joint with one that is not.
    pub(super) fn couple(&mut self, design: &GloveDesign, hardware: &mut Noise, noise: &mut Noise) {
        self.coupled = Some(Coupled::new(design, self.size, hardware, noise));
    }

    /// Artifacts, fraction of full scale, and the bends that caused them.
    pub(super) fn advance(&mut self, dt_s: f64, pose: &HandPose, slip: &Slipped) -> (Vec<f64>, Bends) {
        let bends = Bends::of(pose, self.finger);
        let mut strain = bends.0;
        for (strain, joint) in strain.iter_mut().zip(&mut self.joints) {
            *strain = joint.advance(dt_s, *strain);
        }
        let others: f64 = others_of(self.finger)
            .into_iter()
            .map(|(finger, share)| {
                let angles = pose.finger(finger);
                share * (0..3).map(|j| angles[j] / FULL_RAD[j]).sum::<f64>() / 3.0
            })
            .sum();
        if let Some(coupled) = &mut self.coupled {
            let own = coupled.advance(dt_s, &strain, slip);
            return (own.iter().zip(&self.taxels).map(|(own, taxel)| own + taxel.others * others).collect(), bends);
        }
        let artifact = |(taxel, slipped): (&Taxel, &f64)| {
            let by_joint = strain
                .iter()
                .enumerate()
                .map(|(j, strain)| taxel.linear[j] * strain + taxel.quadratic[j] * strain * strain.abs());
            (1.0 + slipped) * by_joint.sum::<f64>() + taxel.others * others
        };
        (self.taxels.iter().zip(&slip.taxels).map(artifact).collect(), bends)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strain_on_the_way_back_is_higher_than_on_the_way_out() {
        let mut material = Material::new(0.3);
        let mut half_way = Vec::new();
        for k in 0..=400 {
            let bend = 1.0 - (f64::from(k) / 200.0 - 1.0).abs(); // out and back in 40 s, too slow for creep
            let strain = material.advance(0.1, bend);
            if k == 100 || k == 300 {
                half_way.push(strain);
            }
        }
        assert!(half_way[1] - half_way[0] > 0.05, "{half_way:?}");
    }
}
