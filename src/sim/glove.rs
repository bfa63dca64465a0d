//! Three synthetic gloves: readings of their fingertip taxels under force, under strain, and over time.
//!
//! For taxel i, as a fraction of full scale:
//!
//! ```text
//! x_i = gain_i * (touch gain * pattern_i * slow gain * (1 + c_i . theta) * w_i(location) * compress_i(force)
//!                 + artifact_i(theta) + other_fingers_i) + drift_i
//! ```
//!
//! then cross-talk, low-pass, noise, and 12-bit counts. `contact` holds the effect of force, `strain` that of pose,
//! `readout` that of electronics, `shear` the further axes of taxels that have three; each gives the source of its terms. Other [`Physics`] of the artifact is in
//! `coupled`.
//!
//! A whole-hand glove has such taxels on every fingertip, each strained mostly by the joints of its own finger.

mod bends;
mod contact;
mod coupled;
mod readout;
mod shear;
mod strain;

use contact::ContactField;
use readout::Readout;
use shear::ShearField;
use strain::StrainField;

use super::hand::Finger;
use super::performance::HandState;
use super::spec::{Activity, Axes, Physics, SessionSpec};
use crate::random::{Noise, Wander};
use crate::units::GramForce;

/// A glove as manufactured: its properties that don't change from user to user.
///
/// # Source
/// The numbers come from a throwaway exploration, which found that they reproduce the paper's tactile-only results. The
/// three differ as the paper's gloves do (Sec. VI-B): 1 capacitive, 2 dull to touch, 3 sensitive with strong artifacts.
#[derive(Debug, Clone, PartialEq)]
pub struct GloveDesign {
    /// 1 to 3.
    pub number: u8,
    /// Sensing principle of its taxels.
    pub principle: &'static str,
    /// Positions of the taxels on the fingertip, mm: x to the thumb's side, y to the nail's edge, from the pad's
    /// centre.
    pub taxels: &'static [[f64; 2]],
    /// Force at which a taxel reads half of its maximum.
    pub half_saturation: GramForce,
    /// Noise of a reading, fraction of full scale.
    pub noise: f64,
    /// Force whose reading equals the artifact of a full bend of DIP and PIP, for the median user and donning.
    pub bend_artifact: GramForce,
    /// Fraction of the artifact that lags behind the pose by hysteresis.
    pub hysteresis: f64,
    /// Artifact of all other fingers fully flexed, as a fraction of that of a full bend.
    pub other_fingers: f64,
    /// Change of the gain by a full bend, the mean of all taxels.
    pub pose_gain: f64,
    /// Log-normal spread of the gain from touch to touch.
    pub touch_gain: f64,
    /// Log-normal spread of the gain that wanders over a minute.
    pub slow_gain: f64,
    /// Standard deviation of the change of artifacts from the glove's slipping on the finger.
    pub slip: f64,
    /// Time constant of each taxel, s.
    pub low_pass_s: f64,
    /// Approximate counts at rest.
    pub rest_counts: f64,
    /// Counts of full scale; negative if lower counts mean more pressure.
    pub span_counts: f64,
}

impl GloveDesign {
    /// The glove with this number, if there is one.
    pub fn numbered(number: u8) -> Option<&'static GloveDesign> {
        GLOVES.iter().find(|design| design.number == number)
    }

    /// True if a lower reading means more pressure: `sign: -1` in the parameters.
    pub fn inverted(&self) -> bool {
        self.span_counts < 0.0
    }

    /// The median glove's reading of a straight finger's touch, averaged over touch positions and all taxels, fraction
    /// of full scale.
    pub fn nominal_response(&self, force: GramForce) -> f64 {
        let reach = self.taxels.iter().map(|&taxel| contact::mean_reach(taxel, force.0));
        reach.sum::<f64>() / self.taxels.len() as f64 * contact::compress(force.0, self.half_saturation.0)
    }
}

/// All gloves.
pub const GLOVES: [GloveDesign; 3] = [
    GloveDesign {
        number: 1,
        principle: "capacitive",
        taxels: &[[-2.5, -5.0], [2.5, -5.0], [-2.5, 0.0], [2.5, 0.0], [-2.5, 5.0], [2.5, 5.0]], // a grid
        half_saturation: GramForce(900.0),
        noise: 0.008,
        bend_artifact: GramForce(112.0), // the paper's example, Sec. I
        hysteresis: 0.25,
        other_fingers: 0.15,
        pose_gain: 0.22,
        touch_gain: 0.09,
        slow_gain: 0.08,
        slip: 0.15,
        low_pass_s: 0.010,
        rest_counts: 420.0,
        span_counts: 2400.0,
    },
    GloveDesign {
        number: 2,
        principle: "piezoresistive textile in a pull-up divider",
        taxels: &[[0.0, 0.0], [0.0, 5.5], [5.2, 1.7], [3.2, -4.4], [-3.2, -4.4], [-5.2, 1.7]], // a rosette
        half_saturation: GramForce(900.0),
        noise: 0.014,
        bend_artifact: GramForce(130.0),
        hysteresis: 0.3,
        other_fingers: 0.2,
        pose_gain: -0.22, // a taut fabric takes part of the force
        touch_gain: 0.20,
        slow_gain: 0.12,
        slip: 0.15,
        low_pass_s: 0.015,
        rest_counts: 3500.0,
        span_counts: -2300.0, // pressure lowers the resistance and with it the divider's voltage
    },
    GloveDesign {
        number: 3,
        principle: "conductive elastomer channels",
        taxels: &[[0.0, -5.5], [-4.0, -2.0], [4.0, -2.0], [-3.0, 2.5], [3.0, 2.5], [0.0, 6.5]], // along the pad's rim
        half_saturation: GramForce(350.0),
        noise: 0.008,
        bend_artifact: GramForce(150.0),
        hysteresis: 0.3,
        other_fingers: 0.2,
        pose_gain: 0.28,
        touch_gain: 0.07,
        slow_gain: 0.06,
        slip: 0.3,
        low_pass_s: 0.010,
        rest_counts: 650.0,
        span_counts: 2000.0,
    },
];

/// The taxels of one fingertip on a user's hand, for one donning.
#[derive(Debug)]
pub struct WornGlove {
    strain: StrainField,
    has_artifacts: bool,
    contact: ContactField,
    readout: Readout,
    /// Of taxels with three axes.
    shear: Option<ShearField>,
    slip: Slip,
    jumps: Option<Jumps>,
    noise: Noise,
}

impl WornGlove {
    /// The index fingertip of a glove, with this user's donning for this session.
    pub fn new(design: &'static GloveDesign, spec: &SessionSpec) -> Self {
        WornGlove::on(Finger::Index, design, spec)
    }

    /// A fingertip of a glove, with this user's donning for this session.
    pub fn on(finger: Finger, design: &'static GloveDesign, spec: &SessionSpec) -> Self {
        // Separate random streams, so that the hardware is the same for all, a user is the same in all sessions, and
        // the index fingertip is the same with and without the other four.
        let of_finger = |what: String| match finger {
            Finger::Index => Noise::named(&what),
            other => Noise::named(&format!("{what}, {}", other.name())),
        };
        let of_glove = format!("glove {}", design.number);
        let of_session = format!("{}, {of_glove}", spec.session_name());
        let mut hardware = of_finger(of_glove.clone());
        let mut user = of_finger(format!("{}, skin", spec.user_name()));
        let mut noise = of_finger(of_session.clone());
        let mut strain = StrainField::new(finger, design, &mut hardware, &mut user, &mut noise);
        if spec.conditions.physics == Physics::Coupled {
            let mut hardware = of_finger(format!("{of_glove}, coupled"));
            strain.couple(design, &mut hardware, &mut of_finger(format!("{of_session}, coupled")));
        }
        let every_s = match (spec.conditions.slips_per_min, spec.activity) {
            (None, Activity::Protocol) => None,
            (None, Activity::Manipulation) => Some(JUMP_EVERY_S),
            (Some(per_min), _) => (per_min > 0.0).then(|| 60.0 / per_min),
        };
        let shear = (spec.conditions.axes == Axes::Three).then(|| {
            let hardware = of_finger(format!("{of_glove}, shear"));
            ShearField::new(design, hardware, of_finger(format!("{of_session}, shear")))
        });
        WornGlove {
            shear,
            strain,
            has_artifacts: spec.conditions.physics != Physics::None,
            contact: ContactField::new(design, &mut hardware, &mut noise),
            readout: Readout::new(design, &mut hardware, &mut noise),
            slip: Slip::new(design, &mut noise),
            jumps: every_s.map(|every_s| Jumps::new(design, every_s, of_finger(format!("{of_session}, jumps")))),
            noise,
        }
    }

    /// The taxel readings, raw counts, `dt_s` after the previous sample.
    ///
    /// # Shapes
    /// Returns `[taxels]` in the order of [`GloveDesign::taxels`]; of taxels with three axes `[taxels, 3]`: x, y, and z, which is
    /// pressure.
    pub fn sample(&mut self, dt_s: f64, state: &HandState) -> Vec<f32> {
        if let Some(jumps) = &mut self.jumps {
            jumps.advance(dt_s, &mut self.slip);
        }
        let slip = self.slip.advance(dt_s, &mut self.noise);
        let (mut artifacts, bends) = self.strain.advance(dt_s, &state.pose, &slip);
        if !self.has_artifacts {
            artifacts.fill(0.0);
        }
        let touched = self.contact.advance(dt_s, &bends, state.contact, slip.common, &mut self.noise);
        let felt = touched.iter().zip(&artifacts).map(|(touched, artifact)| touched + artifact).collect();
        let pressed = self.readout.advance(dt_s, felt, &mut self.noise);
        let Some(shear) = &mut self.shear else { return pressed };
        let tangential = state.contact.and_then(|contact| contact.tangential).unwrap_or([GramForce(0.0); 2]);
        let [x, y] = shear.advance(dt_s, &self.contact, tangential, (&touched, &artifacts), &slip);
        x.into_iter().zip(y).zip(pressed).flat_map(|((x, y), z)| [x, y, z]).collect()
    }
}

/// How far the glove has slipped on the finger, relative: it moves with sweat and use, over a minute or two.
#[derive(Debug, Clone)]
struct Slip {
    common: Wander,
    taxels: Vec<Wander>,
}

/// The current value of [`Slip`].
#[derive(Debug, Clone)]
struct Slipped {
    common: f64,
    taxels: Vec<f64>,
}

const SLIP_S: f64 = 90.0;

/// Sudden slips: friction holds the glove until it gives way.
#[derive(Debug)]
struct Jumps {
    size: f64,
    every_s: f64,
    next_s: f64,
    noise: Noise,
}

const JUMP_EVERY_S: f64 = 45.0; // on average, in free manipulation

impl Jumps {
    fn new(design: &GloveDesign, every_s: f64, mut noise: Noise) -> Self {
        let size = design.slip * std::f64::consts::FRAC_1_SQRT_2;
        Jumps { size, every_s, next_s: noise.exponential(every_s), noise }
    }

    fn advance(&mut self, dt_s: f64, slip: &mut Slip) {
        self.next_s -= dt_s;
        while self.next_s <= 0.0 {
            self.next_s += self.noise.exponential(self.every_s);
            slip.common.push(self.noise.normal(self.size));
            for own in &mut slip.taxels {
                own.push(self.noise.normal(self.size));
            }
        }
    }
}

impl Slip {
    fn new(design: &GloveDesign, noise: &mut Noise) -> Self {
        let half = design.slip * std::f64::consts::FRAC_1_SQRT_2; // half of the variance common, half a taxel's own
        let mut wander = || Wander::new(half, SLIP_S, noise);
        Slip { common: wander(), taxels: design.taxels.iter().map(|_| wander()).collect() }
    }

    fn advance(&mut self, dt_s: f64, noise: &mut Noise) -> Slipped {
        let common = self.common.advance(dt_s, noise);
        Slipped { common, taxels: self.taxels.iter_mut().map(|own| common + own.advance(dt_s, noise)).collect() }
    }
}
