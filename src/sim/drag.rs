//! The tangential force of a touch: a finger that presses also drags, as far as friction holds it.

use super::performance::Contact;
use crate::random::{Noise, Wander};
use crate::units::GramForce;

/// Coefficient of friction of a gloved fingertip on a smooth plate: beyond, the finger slides and the force stays there.
///
/// # Source
/// Measured coefficients of skin and of fabrics on metal and glass lie between 0.3 and 1 (Derler and Gerhardt 2012).
const FRICTION: f64 = 0.6;
/// Spread of the drag of a touch along each axis, as a share of the normal force. An assumption: people press without meaning
/// to drag, and are off by some 15 degrees.
const DRAG_SD: f64 = 0.22;
const WANDER_SD: f64 = 0.12; // of the same, within a touch
const WANDER_S: f64 = 0.4;

/// The drag of a hand in a session, as a share of the normal force.
#[derive(Debug)]
pub(super) struct Drag {
    touch: Option<usize>,
    of_touch: [f64; 2],
    wander: [Wander; 2],
    noise: Noise,
    now_s: f64,
}

impl Drag {
    pub(super) fn new(mut noise: Noise) -> Self {
        let wander = std::array::from_fn(|_| Wander::new(WANDER_SD, WANDER_S, &mut noise));
        Drag { touch: None, of_touch: [0.0; 2], wander, noise, now_s: 0.0 }
    }

    /// The tangential force of a contact at `t_s`, which never goes back: on the hand, along x and y of the patch.
    pub(super) fn advance(&mut self, t_s: f64, contact: &Contact) -> [GramForce; 2] {
        let dt_s = (t_s - self.now_s).max(0.0);
        self.now_s = self.now_s.max(t_s);
        if self.touch != Some(contact.touch) {
            self.touch = Some(contact.touch);
            self.of_touch = std::array::from_fn(|_| self.noise.normal(DRAG_SD));
        }
        let wandered = self.wander.each_mut().map(|wander| wander.advance(dt_s, &mut self.noise));
        let [x, y]: [f64; 2] = std::array::from_fn(|axis| self.of_touch[axis] + wandered[axis]);
        let held = (FRICTION / libm::hypot(x, y)).min(1.0);
        [x, y].map(|share| GramForce(share * held * contact.force.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn friction_bounds_the_drag_and_a_touch_drags_its_own_way() {
        let mut drag = Drag::new(Noise::named("drag"));
        let (mut most, mut ways) = (0.0_f64, Vec::new());
        for touch in 0..200 {
            let contact = Contact { touch, force: GramForce(200.0), tangential: None };
            for k in 0..20 {
                let [x, y] = drag.advance((touch * 20 + k) as f64 * 0.01, &contact).map(|force| force.0);
                most = most.max(x.hypot(y));
                if k == 0 {
                    ways.push(x);
                }
            }
        }
        assert!(most <= 200.0 * FRICTION + 1e-9 && most > 100.0, "{most}");
        assert!(ways.iter().any(|x| *x > 20.0) && ways.iter().any(|x| *x < -20.0));
        let still = Contact { touch: 0, force: GramForce(0.0), tangential: None };
        assert_eq!(drag.advance(50.0, &still), [GramForce(0.0); 2]);
    }
}
