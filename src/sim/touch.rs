//! One touch of the synthetic fingertip: how the normal force rises, varies and falls.

use crate::random::Noise;
use crate::units::GramForce;

/// Kind of an instructed touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TouchKind {
    /// One tap of a 3-tap sequence: 0 light, 1 medium, 2 heavy.
    Tap(usize),
    /// A sustained press.
    Press,
    /// A touch that is held at a level.
    Hold,
    /// An object that is held and turned.
    Grasp,
    /// Force that rises slowly.
    Ramp,
}

/// A touch from first contact to release. The force is zero outside of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Touch {
    /// The instructed kind.
    pub kind: TouchKind,
    /// First contact, s into the session.
    pub start_s: f64,
    /// Release, s into the session.
    pub end_s: f64,
    rise_s: f64,
    fall_s: f64,
    knots: Vec<(f64, f64)>, // when, gF
    lift_rad: f64,
}

/// Instructed taps: light is a touchscreen tap, heavy stays well under the 10 N limit given to users.
///
/// # Source
/// Pose-aware tactile gloves, Sec. I (touchscreen taps 0.5 N on average) and Sec. IV (light, medium, heavy, under 10 N).
const TAP_LEVELS_GF: [f64; 3] = [65.0, 180.0, 400.0];
const MAX_FORCE_GF: f64 = 880.0; // with the errors of force control on top still under 10 N

const LEAST_GRASP_GF: f64 = 20.0; // less, and the thing falls
const RAMP_KNOT_S: f64 = 0.5; // between knots force is minimum-jerk, so a ramp has steps of this length that nobody feels

/// A user's force control, the same in all sessions.
#[derive(Debug, Clone)]
pub struct ForceStyle {
    gain: f64,
    briskness: f64,
    consistency: f64,
}

impl ForceStyle {
    pub(crate) fn new(noise: &mut Noise) -> Self {
        ForceStyle {
            gain: noise.log_normal(0.2),
            briskness: noise.log_normal(0.2),
            consistency: noise.log_normal(0.2), // spread of levels, as a factor
        }
    }

    /// A flat-topped tap of level 0, 1 or 2 that begins at `start_s`.
    pub(crate) fn tap(&self, level: usize, start_s: f64, noise: &mut Noise) -> Touch {
        let peak = self.limited(TAP_LEVELS_GF[level] * noise.log_normal(0.25 * self.consistency));
        let rise_s = self.briskness * noise.uniform(0.025, 0.06);
        let fall_s = self.briskness * noise.uniform(0.03, 0.07);
        let end_s = start_s + rise_s + self.briskness * noise.uniform(0.08, 0.2) + fall_s;
        let sagged = peak * noise.uniform(0.9, 1.03);
        let knots = vec![(start_s + rise_s, peak), (end_s - fall_s, sagged)];
        Touch {
            kind: TouchKind::Tap(level),
            start_s,
            end_s,
            rise_s,
            fall_s,
            knots,
            lift_rad: noise.uniform(0.03, 0.12),
        }
    }

    /// A press whose force the user varies widely, as instructed.
    ///
    /// # Source
    /// The span is chosen so that about 8 % of the loaded frames are under 40 gF and force has a standard deviation of
    /// some 130 gF over a session. The MAE and R2 of the paper's Table I imply this for errors of usual shape.
    pub(crate) fn varying_press(&self, start_s: f64, end_s: f64, noise: &mut Noise) -> Touch {
        let mut knots = Vec::new();
        let mut at_s = start_s;
        while at_s < end_s {
            knots.push((at_s, self.limited(noise.log_uniform(34.0, 620.0))));
            at_s += noise.uniform(0.5, 1.5);
        }
        self.press(start_s, end_s, knots, noise)
    }

    /// A press that the user tries to hold while moving fingers disturb it.
    pub(crate) fn held_press(&self, start_s: f64, end_s: f64, noise: &mut Noise) -> Touch {
        let level = noise.log_uniform(60.0, 450.0);
        let mut knots = Vec::new();
        let mut at_s = start_s;
        while at_s < end_s {
            knots.push((at_s, self.limited(level * noise.log_normal(0.3 * self.consistency))));
            at_s += noise.uniform(0.4, 1.1);
        }
        self.press(start_s, end_s, knots, noise)
    }

    /// A touch held at a level, gF; the force departs from the level by `spread` (log-normal) and returns to it. The
    /// level does not depend on how hard this user presses otherwise.
    pub(super) fn hold_at(&self, start_s: f64, end_s: f64, level_gf: f64, spread: f64, noise: &mut Noise) -> Touch {
        let mut knots = Vec::new();
        let mut at_s = start_s;
        while at_s < end_s {
            knots.push((at_s, (level_gf * noise.log_normal(spread * self.consistency)).min(MAX_FORCE_GF)));
            at_s += noise.uniform(0.8, 3.0);
        }
        Touch { kind: TouchKind::Hold, ..self.press(start_s, end_s, knots, noise) }
    }

    /// A grasp: force follows the handling of the object, and never drops to zero.
    pub(super) fn grasp(&self, start_s: f64, end_s: f64, noise: &mut Noise) -> Touch {
        let weight_gf = noise.log_uniform(30.0, 150.0);
        let mut knots = Vec::new();
        let mut at_s = start_s;
        while at_s < end_s {
            let level_gf = (weight_gf * noise.log_normal(0.5)).max(LEAST_GRASP_GF);
            knots.push((at_s, self.limited(level_gf).max(LEAST_GRASP_GF)));
            at_s += noise.uniform(0.6, 4.0);
        }
        Touch { kind: TouchKind::Grasp, ..self.press(start_s, end_s, knots, noise) }
    }

    /// Force that rises evenly from zero to `top_gf` over the whole touch, and is released within half a second.
    pub(super) fn ramp(&self, start_s: f64, end_s: f64, top_gf: f64, noise: &mut Noise) -> Touch {
        let n_knots = ((end_s - start_s) / RAMP_KNOT_S).ceil().max(1.0);
        let at = |k: f64| (start_s + (end_s - start_s) * k / n_knots, top_gf * k / n_knots);
        let knots = (0..=n_knots as usize).map(|k| at(k as f64)).collect();
        Touch { kind: TouchKind::Ramp, rise_s: 0.1, fall_s: 0.4, ..self.press(start_s, end_s, knots, noise) }
    }

    /// Ramps last 3 to 10 % of a press.
    fn press(&self, start_s: f64, end_s: f64, knots: Vec<(f64, f64)>, noise: &mut Noise) -> Touch {
        let length_s = (end_s - start_s).min(5.0); // longer presses begin and end no slower
        let rise_s = length_s * noise.uniform(0.03, 0.10);
        let fall_s = length_s * noise.uniform(0.03, 0.10);
        let lift_rad = noise.uniform(0.03, 0.12);
        Touch { kind: TouchKind::Press, start_s, end_s, rise_s, fall_s, knots, lift_rad }
    }

    fn limited(&self, level_gf: f64) -> f64 {
        (self.gain * level_gf).min(MAX_FORCE_GF)
    }
}

/// Minimum-jerk progress from 0 to 1, for `u` of any size.
///
/// # Source
/// Flash and Hogan 1985: the shape of voluntary arm and hand movements.
pub(crate) fn minimum_jerk(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * u * (10.0 + u * (6.0 * u - 15.0))
}

impl Touch {
    /// The intended normal force at `t_s`; zero outside of the touch.
    pub fn force(&self, t_s: f64) -> GramForce {
        if t_s <= self.start_s || t_s >= self.end_s {
            return GramForce(0.0);
        }
        let envelope =
            minimum_jerk((t_s - self.start_s) / self.rise_s) * minimum_jerk((self.end_s - t_s) / self.fall_s);
        let after = self.knots.partition_point(|&(at_s, _)| at_s <= t_s);
        let level = match (after.checked_sub(1).and_then(|before| self.knots.get(before)), self.knots.get(after)) {
            (Some(&(from_s, from)), Some(&(to_s, to))) => {
                from + (to - from) * minimum_jerk((t_s - from_s) / (to_s - from_s))
            }
            (Some(&(_, level)), None) | (None, Some(&(_, level))) => level,
            (None, None) => 0.0,
        };
        GramForce(level * envelope)
    }

    /// Ends it soon after `at_s`, if it isn't over by then.
    pub(crate) fn let_go(&mut self, at_s: f64) {
        const REACTION_S: f64 = 0.15; // simple reaction to something seen takes a person 0.2 s or so
        const FALL_S: f64 = 0.06;
        let end_s = at_s.max(self.start_s) + REACTION_S + FALL_S;
        if end_s < self.end_s {
            (self.end_s, self.fall_s) = (end_s, FALL_S);
        }
    }

    /// Lift of the finger at its MCP just before and after the touch, rad.
    pub(crate) fn lift(&self, t_s: f64) -> f64 {
        let u = if t_s < self.start_s { (self.start_s - t_s) / 0.2 } else { (t_s - self.end_s) / 0.2 };
        if (0.0..1.0).contains(&u) { self.lift_rad * 16.0 * u * u * (1.0 - u) * (1.0 - u) } else { 0.0 }
    }
}
