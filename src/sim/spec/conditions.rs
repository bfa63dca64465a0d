//! Conditions that may differ from the sessions that models were first judged on.

use super::super::hand::Finger;
use super::super::manipulation::{Episode, Start};

/// How joint angles are measured.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Tracking {
    /// Optical motion capture with markers, as the paper used: 100 Hz, a few degrees off.
    #[default]
    Markers,
    /// A camera that looks at the hand: 30 Hz, late, noisy, off by ten degrees and sometimes blind.
    Camera,
}

impl Tracking {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Tracking::Markers => "markers",
            Tracking::Camera => "camera",
        }
    }
}

/// How a pose becomes an artifact.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Physics {
    /// As a sum over joints, each with hysteresis and creep.
    #[default]
    Separable,
    /// From several joints together, with slack and with folds that buckle.
    Coupled,
    /// Not at all: what is left limits any correction.
    None,
}

impl Physics {
    /// All of them.
    pub const ALL: [Physics; 3] = [Physics::Separable, Physics::Coupled, Physics::None];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Physics::Separable => "separable",
            Physics::Coupled => "coupled",
            Physics::None => "none",
        }
    }
}

/// Positions of a glove's taxels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Fingers {
    /// On the index fingertip.
    #[default]
    Index,
    /// On all five fingertips, in one message: those of the index finger, middle, ring, little finger and thumb.
    All,
}

/// Axes of a glove's taxels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Axes {
    /// Pressure alone.
    #[default]
    One,
    /// x, y and z of the patch: shear along the skin, and pressure. The hand drags, and the truth has three axes.
    Three,
}

impl Axes {
    /// How many.
    pub fn n(self) -> usize {
        match self {
            Axes::One => 1,
            Axes::Three => 3,
        }
    }
}

/// Errors of joint angles that can be set one by one: added to the markers' own errors, replacing the camera's.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TrackingErrors {
    /// Spread of a constant error from joint to joint, degrees, 0 to 90.
    pub bias_deg: Option<f64>,
    /// Standard deviation of an error of which half of the variance stays for 0.3 s, degrees, 0 to 90.
    pub noise_deg: Option<f64>,
    /// Delay of the pose stamps, ms, 0 to 1000.
    pub delay_ms: Option<f64>,
    /// Sample rate, Hz, 1 to 1000.
    pub rate_hz: Option<f64>,
    /// Drop-outs of a third of a second to a second, average number per minute, 0 to 60.
    pub drop_outs_per_min: Option<f64>,
}

/// Conditions that can be changed. The default is the same, byte for byte, as sessions before this choice existed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Conditions {
    /// How a pose becomes an artifact.
    pub physics: Physics,
    /// Positions of the glove's taxels.
    pub fingers: Fingers,
    /// Axes of the glove's taxels.
    pub axes: Axes,
    /// The finger that touches the load cell. `None`: the index finger in the protocol, and in free manipulation any
    /// finger with taxels.
    pub touching: Option<Finger>,
    /// Episodes of free manipulation; empty for all kinds. Air comes first and between touches whatever they are.
    pub episodes: Vec<Episode>,
    /// Beginning of free manipulation.
    pub start: Start,
    /// Sudden slips of the glove per minute on average, 0 to 60. `None`: 0 in the protocol, 1.33 in free manipulation.
    pub slips_per_min: Option<f64>,
    /// Errors of joint angles.
    pub tracking: TrackingErrors,
}

impl Conditions {
    /// The given quantities: name, value, unit, minimum and maximum.
    pub(in crate::sim) fn quantities(&self) -> [(&'static str, Option<f64>, &'static str, f64, f64); 6] {
        let TrackingErrors { bias_deg, noise_deg, delay_ms, rate_hz, drop_outs_per_min } = self.tracking;
        [
            ("slips", self.slips_per_min, "per minute", 0.0, 60.0),
            ("tracking bias", bias_deg, "degrees", 0.0, 90.0),
            ("tracking noise", noise_deg, "degrees", 0.0, 90.0),
            ("tracking delay", delay_ms, "ms", 0.0, 1000.0),
            ("tracking rate", rate_hz, "Hz", 1.0, 1000.0),
            ("tracking drop-outs", drop_outs_per_min, "per minute", 0.0, 60.0),
        ]
    }

    /// Conditions that differ from the default, for the notes beside a recording.
    pub(in crate::sim) fn notes(&self) -> impl Iterator<Item = (String, String)> {
        let quantities = self.quantities().into_iter();
        let numbers =
            quantities.filter_map(|(name, value, ..)| Some((name.replace([' ', '-'], "_"), value?.to_string())));
        let physics = (self.physics != Physics::default()).then(|| self.physics.name().to_owned());
        let start = (self.start != Start::default()).then(|| self.start.name().to_owned());
        let episodes: Vec<&str> = self.episodes.iter().map(|episode| episode.name()).collect();
        let episodes = (!episodes.is_empty()).then(|| episodes.join(","));
        let touching = self.touching.map(|finger| finger.name().to_owned());
        let axes = (self.axes != Axes::default()).then(|| self.axes.n().to_string());
        let words =
            [("physics", physics), ("start", start), ("episodes", episodes), ("touching", touching), ("axes", axes)];
        numbers.chain(words.into_iter().filter_map(|(name, word)| Some((name.to_owned(), word?))))
    }
}
