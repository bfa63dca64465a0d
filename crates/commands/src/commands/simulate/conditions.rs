//! Options of `tpf simulate` that make a session otherwise than those that models were first judged on.

use std::fmt;

use tactile_pose_fusion::sim::hand::Finger;
use tactile_pose_fusion::sim::manipulation::{Episode, Start};
use tactile_pose_fusion::sim::{Activity, Axes, Conditions, Fingers, Physics, TrackingErrors};

/// A glove as it is asked for.
#[derive(Debug, Clone, Copy)]
pub(super) struct GloveArg {
    /// 1 to 3, or one that there isn't.
    pub(super) number: u8,
    fingers: Fingers,
}

impl fmt::Display for GloveArg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.fingers == Fingers::All { "hand" } else { "glove" };
        write!(f, "{kind}{}", self.number)
    }
}

/// Of all sessions that are written.
#[derive(Debug, clap::Args)]
pub(super) struct ConditionArgs {
    /// How a pose becomes an artifact: separable (a sum over joints), coupled (of several joints together, with slack and
    /// with folds that buckle), or none (it does not: what is left limits any correction)
    #[arg(long, value_name = "NAME", default_value = "separable", value_parser = physics, help_heading = "Glove")]
    physics: Physics,
    /// Axes of a taxel: 1 (pressure), or 3: x, y and z of the patch, for a hand that also drags. Then the message has three numbers
    /// a taxel, and the force truth has a tangential force
    #[arg(long, value_name = "N", default_value = "1", value_parser = axes, help_heading = "Glove")]
    axes: Axes,
    /// Sudden slips of the glove per minute, on average, 0 to 60; if not given, 0 in the protocol and 1.33 in free manipulation
    #[arg(long, value_name = "PER_MINUTE", help_heading = "Glove", allow_negative_numbers = true)]
    slips: Option<f64>,
    /// With hand1 to hand3, the finger that touches the load cell: index, middle, ring, little, thumb; without it sessions of the
    /// protocol go through the fingers in turn, and free manipulation touches with any
    #[arg(long, value_name = "NAME", value_parser = finger, help_heading = "Glove")]
    finger: Option<Finger>,
    /// Episodes of free manipulation, separated by commas: air, still_air, light_hold (3 to 20 gF for 10 to 90 s while the finger
    /// moves), still_hold, grasp (minutes without air), ramp, touches; all if not given. Air comes first and between touches
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = episode, help_heading = "Free manipulation")]
    episodes: Vec<Episode>,
    /// How free manipulation begins: in-air, in-contact, or either (one session in four in contact)
    #[arg(long, value_name = "HOW", default_value = "either", value_parser = start, help_heading = "Free manipulation")]
    start: Start,
    #[command(flatten)]
    tracking: TrackingArgs,
}

/// Errors of joint angles: on top of the markers' own, in place of the camera's.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Hand tracking (on top of the markers' errors, in place of the camera's)")]
struct TrackingArgs {
    /// Constant error of each joint, its spread in degrees, 0 to 90
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    tracking_bias: Option<f64>,
    /// Noise of each joint, standard deviation in degrees, 0 to 90; half of its variance stays for 0.3 s
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    tracking_noise: Option<f64>,
    /// How much later than it was a pose is stamped, in ms, 0 to 1000
    #[arg(long, value_name = "MS", allow_negative_numbers = true)]
    tracking_delay: Option<f64>,
    /// Samples a second, 1 to 1000
    #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
    tracking_rate: Option<f64>,
    /// Drop-outs of a third of a second to a second, per minute on average, 0 to 60
    #[arg(long, value_name = "PER_MINUTE", allow_negative_numbers = true)]
    tracking_drop_outs: Option<f64>,
}

impl ConditionArgs {
    /// Those of a session.
    pub(super) fn of_session(&self, glove: GloveArg, activity: Activity, session: u32) -> Conditions {
        let in_turn = || Finger::ALL.get(session.saturating_sub(1) as usize % Finger::ALL.len()).copied();
        let touching = match (glove.fingers, activity) {
            (Fingers::All, Activity::Protocol) => self.finger.or_else(in_turn),
            _ => self.finger,
        };
        let errors = &self.tracking;
        Conditions {
            physics: self.physics,
            fingers: glove.fingers,
            axes: self.axes,
            touching,
            episodes: self.episodes.clone(),
            start: self.start,
            slips_per_min: self.slips,
            tracking: TrackingErrors {
                bias_deg: errors.tracking_bias,
                noise_deg: errors.tracking_noise,
                delay_ms: errors.tracking_delay,
                rate_hz: errors.tracking_rate,
                drop_outs_per_min: errors.tracking_drop_outs,
            },
        }
    }
}

pub(super) fn glove(text: &str) -> Result<GloveArg, String> {
    let (fingers, number) = match text.strip_prefix("hand") {
        Some(number) => (Fingers::All, number),
        None => (Fingers::Index, text),
    };
    let number = number.parse().map_err(|_| format!("expected 1, 2, 3, hand1, hand2 or hand3, got {text:?}"))?;
    Ok(GloveArg { number, fingers })
}

/// The one of this name.
fn named<T: Copy>(known: &[T], name: fn(T) -> &'static str, text: &str) -> Result<T, String> {
    let names = || known.iter().map(|one| name(*one)).collect::<Vec<_>>().join(", ");
    let found = known.iter().copied().find(|one| name(*one) == text);
    found.ok_or_else(|| format!("expected one of {}, got {text:?}", names()))
}

fn physics(text: &str) -> Result<Physics, String> {
    named(&Physics::ALL, Physics::name, text)
}

fn axes(text: &str) -> Result<Axes, String> {
    let found = [Axes::One, Axes::Three].into_iter().find(|axes| axes.n().to_string() == text);
    found.ok_or_else(|| format!("expected 1 or 3, got {text:?}"))
}

fn finger(text: &str) -> Result<Finger, String> {
    named(&Finger::ALL, Finger::name, text)
}

fn episode(text: &str) -> Result<Episode, String> {
    named(&Episode::ALL, Episode::name, text)
}

fn start(text: &str) -> Result<Start, String> {
    named(&[Start::Either, Start::InAir, Start::InContact], Start::name, text)
}
