//! A second physics of the artifact, beside the one that models were first judged on: it is not a sum over joints, it
//! has slack, and folds that buckle. Its sizes are assumed, and were fixed before any model was run on it.
//!
//! With `b_j` the strained bend of joint j as a fraction of a full bend, and a full bend of DIP and PIP from the
//! design:
//!
//! ```text
//! artifact_i = size * (1 + slip_i) * (0.55 a_i taut(T) + 0.25 sum_jk c_ijk w_jk b_j b_k + sum_f k_if share_f p_f)
//! T          = sum_j locality_j b_j / full bend
//! taut(T)    = (softplus(T - s) - softplus(-s)) / (softplus(1 - 0.25) - softplus(-0.25))
//! softplus(x)= 0.08 ln(1 + exp(x / 0.08))
//! s          = slack of the donning (0.25, log-normal 0.4) + 0.3 slip
//! p_f        = 1 from where the fold pops up until it lies down again, each within 30 ms
//! ```

use super::bends::{FULL_BEND, LOCALITY, pattern};
use super::{GloveDesign, Slipped};
use crate::random::{Lag, Noise};

const TAUT: f64 = 0.55; // share of fabric that is drawn tight
const SLACK: f64 = 0.25; // of a full bend, before the fabric is tight
const SLACK_SD: f64 = 0.4; // log-normal, from donning to donning
const SLACK_BY_SLIP: f64 = 0.3; // a glove that has slipped up the finger is looser
const SOFTNESS: f64 = 0.08; // of the change from slack to tight
const CROSS: f64 = 0.25; // share that two joints have only together: a seam that crosses both
/// Pairs of joints with a seam across them, and its weight.
const PAIRS: [(usize, usize, f64); 3] = [(0, 1, 1.0), (1, 2, 0.5), (2, 3, 0.3)];
/// Folds: the weights of DIP, PIP and MCP, how much the folds press, and the bend at which they pop up.
const FOLDS: [([f64; 3], f64, f64); 2] = [([0.7, 0.3, 0.0], 0.12, 0.45), ([0.0, 0.6, 0.4], 0.08, 0.45)];
const FOLD_SD: f64 = 0.15; // log-normal, of where a fold pops up in this donning
const LIES_DOWN: f64 = 0.6; // as a share of where it pops up: buckling snaps through
const POP_S: f64 = 0.03;

#[derive(Debug, Clone)]
struct Fold {
    pops_up: f64,
    is_up: bool,
    lag: Lag,
    pattern: Vec<f64>,
}

/// An artifact that can't be separated by joint.
#[derive(Debug, Clone)]
pub(super) struct Coupled {
    size: f64,
    slack: f64,
    taut: Vec<f64>,
    pairs: [Vec<f64>; PAIRS.len()],
    folds: [Fold; FOLDS.len()],
}

impl Coupled {
    /// `size`: size of the artifact at a bend of 1, fraction of full scale.
    pub(super) fn new(design: &GloveDesign, size: f64, hardware: &mut Noise, noise: &mut Noise) -> Self {
        let n_taxels = design.taxels.len();
        Coupled {
            size: size * FULL_BEND,
            slack: SLACK * noise.log_normal(SLACK_SD),
            taut: pattern(n_taxels, hardware),
            pairs: std::array::from_fn(|_| pattern(n_taxels, hardware)),
            folds: FOLDS.map(|(_, _, pops_up)| Fold {
                pops_up: pops_up * noise.log_normal(FOLD_SD),
                is_up: false,
                lag: Lag::new(POP_S),
                pattern: pattern(n_taxels, hardware),
            }),
        }
    }

    /// Artifacts of strained bends, `dt_s` after the previous ones. `[taxels]`, fraction of full scale.
    pub(super) fn advance(&mut self, dt_s: f64, strain: &[f64; 4], slip: &Slipped) -> Vec<f64> {
        let tension = strain.iter().zip(LOCALITY).map(|(bend, weight)| bend * weight).sum::<f64>() / FULL_BEND;
        let tight = taut(tension, self.slack + SLACK_BY_SLIP * slip.common);
        let pressed: [f64; FOLDS.len()] = std::array::from_fn(|f| {
            let (by, share, _) = FOLDS[f];
            let bend = by.iter().zip(strain).map(|(weight, bend)| weight * bend).sum::<f64>();
            share * self.folds[f].advance(dt_s, bend)
        });
        let artifact = |(taxel, slipped): (usize, &f64)| {
            let crossed = PAIRS.iter().zip(&self.pairs);
            let crossed: f64 = crossed.map(|(&(j, k, weight), own)| own[taxel] * weight * strain[j] * strain[k]).sum();
            let folded: f64 = self.folds.iter().zip(pressed).map(|(fold, pressed)| fold.pattern[taxel] * pressed).sum();
            self.size * (1.0 + slipped) * (TAUT * self.taut[taxel] * tight + CROSS * crossed + folded)
        };
        slip.taxels.iter().enumerate().map(artifact).collect()
    }
}

impl Fold {
    fn advance(&mut self, dt_s: f64, bend: f64) -> f64 {
        self.is_up = bend > if self.is_up { LIES_DOWN * self.pops_up } else { self.pops_up };
        self.lag.advance(dt_s, if self.is_up { 1.0 } else { 0.0 })
    }
}

/// Tightness of the fabric at a tension: 1 at a full bend with the usual slack.
fn taut(tension: f64, slack: f64) -> f64 {
    let softplus = |x: f64| SOFTNESS * libm::log1p(libm::exp(x / SOFTNESS));
    (softplus(tension - slack) - softplus(-slack)) / (softplus(1.0 - SLACK) - softplus(-SLACK))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::glove::GLOVES;

    fn coupled() -> (Coupled, Slipped) {
        let coupled = Coupled::new(&GLOVES[0], 1.0, &mut Noise::named("made"), &mut Noise::named("worn"));
        (coupled, Slipped { common: 0.0, taxels: vec![0.0; 6] })
    }

    fn mean(coupled: &mut Coupled, slip: &Slipped, strain: [f64; 4]) -> f64 {
        let settled = (0..100).map(|_| coupled.advance(0.01, &strain, slip)).last().unwrap();
        settled.iter().sum::<f64>() / settled.len() as f64
    }

    #[test]
    fn a_full_bend_is_that_of_the_design_and_no_sum_over_joints() {
        let (mut coupled, slip) = coupled();
        coupled.slack = SLACK;
        let full = mean(&mut coupled, &slip, [1.0, 1.0, 0.0, 0.0]);
        assert!((full - FULL_BEND).abs() < 1e-6, "{full}");
        let dip = mean(&mut coupled, &slip, [1.0, 0.0, 0.0, 0.0]);
        let pip = mean(&mut coupled, &slip, [0.0, 1.0, 0.0, 0.0]);
        assert!(full > 1.2 * (dip + pip), "{full}, apart {dip} and {pip}");
    }

    #[test]
    fn a_slack_glove_feels_no_small_bend_and_a_fold_stays_up_on_the_way_back() {
        let (mut coupled, slip) = coupled();
        coupled.slack = SLACK;
        assert!(mean(&mut coupled, &slip, [0.1, 0.1, 0.0, 0.0]) < 0.05 * FULL_BEND);
        let half = [0.38, 0.38, 0.38, 0.0];
        let out = mean(&mut coupled, &slip, half);
        mean(&mut coupled, &slip, [1.0; 4]);
        let back = mean(&mut coupled, &slip, half);
        assert!(back > out + 0.1, "{out} on the way out, {back} on the way back");
    }
}
