//! The synthetic user's hand: joints, the protocol's poses, and the effect of muscles, tendons and tremor on an intent.

use std::array;

use crate::random::{Noise, Wander};

/// Fingers of a hand, in the order of [`JOINTS`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Finger {
    /// The finger that touches, if a glove has taxels on one finger.
    #[default]
    Index,
    /// Its neighbour.
    Middle,
    /// Two away.
    Ring,
    /// Three away.
    Little,
    /// The thumb, whose four joints are IP, MCP, CMC flexion and CMC abduction.
    Thumb,
}

impl Finger {
    /// All of them, in the order of [`JOINTS`].
    pub const ALL: [Finger; N_FINGERS] = [Finger::Index, Finger::Middle, Finger::Ring, Finger::Little, Finger::Thumb];

    /// Its name, as in the names of its joints.
    pub fn name(self) -> &'static str {
        match self {
            Finger::Index => "index",
            Finger::Middle => "middle",
            Finger::Ring => "ring",
            Finger::Little => "little",
            Finger::Thumb => "thumb",
        }
    }
}

/// Number of fingers, including the thumb.
pub const N_FINGERS: usize = 5;

/// Joint names in the order of [`HandPose::angles`]; flexion and abduction are positive.
pub const JOINTS: [&str; 20] = [
    "index_dip",
    "index_pip",
    "index_mcp_flex",
    "index_mcp_abd",
    "middle_dip",
    "middle_pip",
    "middle_mcp_flex",
    "middle_mcp_abd",
    "ring_dip",
    "ring_pip",
    "ring_mcp_flex",
    "ring_mcp_abd",
    "little_dip",
    "little_pip",
    "little_mcp_flex",
    "little_mcp_abd",
    "thumb_ip",
    "thumb_mcp",
    "thumb_cmc_flex",
    "thumb_cmc_abd",
];

/// Angles of one finger, rad: DIP, PIP, MCP flexion, MCP abduction.
pub type FingerPose = [f64; 4];

/// Angles of all fingers, rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandPose(pub [FingerPose; N_FINGERS]);

impl HandPose {
    /// The angles of one finger, rad.
    pub fn finger(&self, finger: Finger) -> FingerPose {
        self.0[finger as usize]
    }

    /// This pose with another index finger.
    pub fn with_index(mut self, index: FingerPose) -> Self {
        self.0[Finger::Index as usize] = index;
        self
    }

    /// This pose with the angles of another finger and the index finger swapped. A thumb can't follow a finger's
    /// angles: it moves as far as its joints allow.
    pub(crate) fn led_by(mut self, finger: Finger) -> Self {
        let (lead, other) = (self.finger(Finger::Index), self.finger(finger));
        match finger {
            Finger::Index => {}
            Finger::Thumb => {
                self.0[Finger::Thumb as usize] = [lead[0], 0.6 * lead[1], 0.5 * lead[2], 0.4 + lead[3]];
                self.0[Finger::Index as usize] = [other[0], other[1], other[2], 0.0];
            }
            Finger::Middle | Finger::Ring | Finger::Little => {
                self.0[finger as usize] = lead;
                self.0[Finger::Index as usize] = other;
            }
        }
        self
    }

    /// All angles in the order of [`JOINTS`], rad.
    pub fn angles(&self) -> Vec<f64> {
        self.0.concat()
    }
}

/// A hand pose that the protocol asks for by name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TerminalPose {
    /// In snake_case.
    pub name: &'static str,
    /// The pose that the user aims at.
    pub pose: HandPose,
    /// True if the index fingertip is available for tapping.
    pub index_free: bool,
}

const fn terminal(name: &'static str, index_free: bool, pose: [FingerPose; N_FINGERS]) -> TerminalPose {
    TerminalPose { name, pose: HandPose(pose), index_free }
}

/// The 14 terminal poses, 10 of them with the index fingertip available.
///
/// The paper shows its poses only as drawings; these are everyday hand shapes that span the range of every joint. In
/// none of them does the index fingertip touch the hand itself, so that zero load is zero load: the fist is loose and
/// the pinch is open.
///
/// # Source
/// Pose-aware tactile gloves, Sec. IV and Fig. 3D; joint ranges as in anatomy (DIP 1.2, PIP 1.75, MCP 1.55 rad).
pub const TERMINAL_POSES: [TerminalPose; 14] = {
    const OPEN: FingerPose = [0.04, 0.08, 0.05, 0.0];
    const CURLED: FingerPose = [0.85, 1.45, 1.2, 0.0];
    const THUMB_OUT: FingerPose = [0.05, 0.05, 0.05, 0.75];
    const THUMB_IN: FingerPose = [0.6, 0.6, 0.6, 0.25];
    const THUMB_REST: FingerPose = [0.2, 0.2, 0.2, 0.4];
    [
        terminal("flat", true, [OPEN, OPEN, OPEN, OPEN, THUMB_REST]),
        terminal(
            "spread",
            true,
            [
                [0.02, 0.04, 0.0, 0.3],
                [0.02, 0.04, 0.0, 0.05],
                [0.02, 0.04, 0.0, -0.18],
                [0.03, 0.06, 0.0, -0.35],
                THUMB_OUT,
            ],
        ),
        terminal(
            "relaxed",
            true,
            [
                [0.22, 0.42, 0.35, 0.02],
                [0.27, 0.5, 0.42, 0.0],
                [0.3, 0.55, 0.48, 0.0],
                [0.3, 0.55, 0.5, -0.05],
                THUMB_REST,
            ],
        ),
        terminal("point", true, [[0.06, 0.12, 0.15, 0.0], CURLED, CURLED, CURLED, THUMB_IN]),
        terminal("l_shape", true, [[0.04, 0.08, 0.02, 0.12], CURLED, CURLED, CURLED, THUMB_OUT]),
        terminal("victory", true, [[0.03, 0.06, 0.05, 0.22], [0.03, 0.06, 0.05, -0.15], CURLED, CURLED, THUMB_IN]),
        terminal("three", true, [[0.05, 0.1, 0.1, 0.15], OPEN, [0.05, 0.1, 0.1, -0.12], CURLED, THUMB_IN]),
        terminal(
            "tabletop",
            true,
            [[0.06, 0.1, 1.15, 0.0], [0.06, 0.1, 1.2, 0.0], [0.06, 0.1, 1.2, 0.0], [0.06, 0.1, 1.15, 0.0], THUMB_REST],
        ),
        terminal(
            "cup",
            true,
            [
                [0.45, 0.7, 0.5, 0.1],
                [0.45, 0.72, 0.5, 0.02],
                [0.45, 0.75, 0.52, -0.08],
                [0.4, 0.7, 0.55, -0.15],
                [0.4, 0.4, 0.5, 0.7],
            ],
        ),
        terminal(
            "claw",
            true,
            [
                [0.8, 1.15, 0.1, 0.08],
                [0.8, 1.2, 0.1, 0.0],
                [0.8, 1.2, 0.12, -0.08],
                [0.75, 1.1, 0.15, -0.15],
                [0.5, 0.4, 0.3, 0.5],
            ],
        ),
        terminal("loose_fist", false, [[0.75, 1.3, 1.1, 0.0], CURLED, CURLED, CURLED, THUMB_IN]),
        terminal("thumbs_up", false, [[0.8, 1.4, 1.15, 0.0], CURLED, CURLED, CURLED, THUMB_OUT]),
        terminal("open_pinch", false, [[0.5, 0.85, 0.75, 0.05], OPEN, OPEN, OPEN, [0.35, 0.4, 0.6, 0.6]]),
        terminal(
            "hook",
            false,
            [[1.0, 1.55, 0.08, 0.0], [1.0, 1.6, 0.08, 0.0], [1.0, 1.6, 0.1, 0.0], [0.95, 1.5, 0.12, -0.05], THUMB_REST],
        ),
    ]
};

/// The other fingers' motion while the index finger does a pose or a movement.
pub const INDEX_BASE: HandPose = HandPose([
    [0.05, 0.1, 0.1, 0.0],
    [0.15, 0.3, 0.25, 0.0],
    [0.2, 0.35, 0.3, 0.0],
    [0.2, 0.35, 0.3, -0.05],
    [0.2, 0.2, 0.2, 0.4],
]);

/// A pose of the index finger alone that the protocol asks for by name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IndexPose {
    /// In snake_case.
    pub name: &'static str,
    /// rad.
    pub index: FingerPose,
}

/// The 5 index poses: a bend is DIP and PIP, a fold is MCP.
pub const INDEX_POSES: [IndexPose; 5] = [
    IndexPose { name: "straight", index: [0.05, 0.1, 0.1, 0.0] },
    IndexPose { name: "small_bend", index: [0.4, 0.6, 0.15, 0.0] },
    IndexPose { name: "large_bend", index: [0.85, 1.25, 0.2, 0.0] },
    IndexPose { name: "small_fold", index: [0.08, 0.14, 0.5, 0.0] },
    IndexPose { name: "large_fold", index: [0.1, 0.18, 1.05, 0.0] },
];

/// A movement of a finger from straight to its end and back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Movement {
    /// In snake_case.
    pub name: &'static str,
    /// Turning point, rad.
    pub end: FingerPose,
}

/// The 3 dynamic movements: bend (DIP and PIP), fold (MCP), roll (all three).
pub const MOVEMENTS: [Movement; 3] = [
    Movement { name: "bend", end: [1.1, 1.5, 0.15, 0.0] },
    Movement { name: "fold", end: [0.1, 0.18, 1.3, 0.0] },
    Movement { name: "roll", end: [0.95, 1.3, 1.05, 0.0] },
];

/// The pose that a user takes up for a name in the protocol; `None` if the user doesn't know the name.
pub fn pose_named(name: &str) -> Option<HandPose> {
    let terminal = TERMINAL_POSES.iter().find(|pose| pose.name == name).map(|pose| pose.pose);
    let index = || INDEX_POSES.iter().find(|pose| pose.name == name).map(|pose| INDEX_BASE.with_index(pose.index));
    terminal.or_else(index)
}

/// Turning point of a movement of the protocol, by its name, rad.
pub fn movement_named(name: &str) -> Option<FingerPose> {
    MOVEMENTS.iter().find(|movement| movement.name == name).map(|movement| movement.end)
}

const LIMITS: [(f64, f64); 4] = [(-0.15, 1.3), (-0.1, 1.8), (-0.35, 1.6), (-0.45, 0.45)]; // rad, active range
const THUMB_LIMITS: [(f64, f64); 4] = [(-0.2, 1.4), (-0.1, 1.1), (-0.3, 1.0), (-0.1, 1.1)];

/// How much a finger follows a neighbour's flexion without intent: index, middle, ring, little, thumb.
///
/// # Source
/// Enslaving of fingers by shared muscles and tendons; the size is for free movement, some 5-20 % for neighbours.
const ENSLAVING: [[f64; N_FINGERS]; N_FINGERS] = [
    [0.0, 0.10, 0.03, 0.01, 0.01],
    [0.13, 0.0, 0.14, 0.04, 0.01],
    [0.05, 0.16, 0.0, 0.15, 0.01],
    [0.02, 0.06, 0.18, 0.0, 0.01],
    [0.03, 0.02, 0.01, 0.01, 0.0],
];

/// Properties of a user's hand that stay the same from session to session.
#[derive(Debug, Clone)]
pub struct Hand {
    reach: [FingerPose; N_FINGERS],
    habit: [FingerPose; N_FINGERS],
    enslaving: f64,
    tempo: f64,
    tremor_rad: f64,
    tremor_hz: f64,
    sloppiness: f64,
}

impl Hand {
    pub(crate) fn new(noise: &mut Noise) -> Self {
        Hand {
            reach: array::from_fn(|_| array::from_fn(|_| 1.0 + noise.normal(0.07))),
            habit: array::from_fn(|_| array::from_fn(|_| noise.normal(0.04))),
            enslaving: noise.log_normal(0.3),
            tempo: noise.log_normal(0.12),
            tremor_rad: 0.0025 * noise.log_normal(0.3), // 0.15 deg: healthy physiological tremor
            tremor_hz: noise.uniform(8.0, 12.0),
            sloppiness: noise.log_normal(0.25),
        }
    }

    /// How slowly this user moves; 1 is normal.
    pub fn tempo(&self) -> f64 {
        self.tempo
    }

    /// The pose that the user really aims at for a named pose, different each time.
    pub(crate) fn aim(&self, asked: &HandPose, noise: &mut Noise) -> HandPose {
        let effort = 1.0 + noise.normal(0.05 * self.sloppiness);
        HandPose(array::from_fn(|f| {
            let limits = if f == Finger::Thumb as usize { THUMB_LIMITS } else { LIMITS };
            array::from_fn(|j| {
                let aimed = asked.0[f][j] * self.reach[f][j] * effort + self.habit[f][j];
                (aimed + noise.normal(0.035 * self.sloppiness)).clamp(limits[j].0, limits[j].1)
            })
        }))
    }

    /// The effect of tendons on an intent: fingers partly follow their neighbours' flexion.
    pub fn follow(&self, intent: &HandPose) -> HandPose {
        let mut pose = *intent;
        for (f, followed) in ENSLAVING.iter().enumerate() {
            for (g, share) in followed.iter().enumerate() {
                for j in 0..3 {
                    pose.0[f][j] += self.enslaving * share * (intent.0[g][j] - intent.0[f][j]);
                }
            }
        }
        pose
    }
}

/// Unintended motion: physiological tremor, and the slow drift of a held posture.
#[derive(Debug, Clone)]
pub(crate) struct Unsteadiness {
    fingers: [[Wander; 3]; N_FINGERS], // two quadratures of tremor, and posture
    tremor_hz: f64,
}

impl Unsteadiness {
    pub(crate) fn new(hand: &Hand, noise: &mut Noise) -> Self {
        let fingers = array::from_fn(|_| {
            [
                Wander::new(hand.tremor_rad, 0.4, noise),
                Wander::new(hand.tremor_rad, 0.4, noise),
                Wander::new(0.012 * hand.sloppiness, 1.5, noise),
            ]
        });
        Unsteadiness { fingers, tremor_hz: hand.tremor_hz }
    }

    /// The pose `dt_s` later, at `t_s`, around the pose that the tendons hold.
    pub(crate) fn advance(&mut self, t_s: f64, dt_s: f64, held: &HandPose, noise: &mut Noise) -> HandPose {
        let phase = std::f64::consts::TAU * self.tremor_hz * t_s;
        let (sin, cos) = libm::sincos(phase);
        let mut pose = *held;
        for (finger, wanderers) in pose.0.iter_mut().zip(&mut self.fingers) {
            let [a, b, posture] = wanderers.each_mut().map(|wander| wander.advance(dt_s, noise));
            let shake = a * cos + b * sin;
            for (angle, share) in finger.iter_mut().zip([(0.6, 0.6), (0.8, 1.0), (1.0, 0.7), (0.3, 0.4)]) {
                *angle += share.0 * shake + share.1 * posture;
            }
        }
        pose
    }
}

/// Optical motion capture of the hand: markers sit on a glove and on skin that moves over the bone.
///
/// # Source
/// Marker jitter of an optical system is some 0.1 mm over a phalanx of 25 mm. Joint angles from skin markers are off
/// by a few degrees, and this error stays the same until the markers are attached again.
#[derive(Debug, Clone)]
pub(crate) struct MotionCapture {
    offset: [f64; JOINTS.len()],
    gain: [f64; JOINTS.len()],
}

const MOCAP_NOISE_RAD: f64 = 0.004;

impl MotionCapture {
    pub(crate) fn new(noise: &mut Noise) -> Self {
        MotionCapture {
            offset: array::from_fn(|_| noise.normal(0.03)),
            gain: array::from_fn(|_| 1.0 + noise.normal(0.03)),
        }
    }

    /// Measured angles, in the order of [`JOINTS`], rad.
    pub(crate) fn measure(&self, pose: &HandPose, noise: &mut Noise) -> Vec<f64> {
        let mut angles = pose.angles();
        for ((angle, offset), gain) in angles.iter_mut().zip(self.offset).zip(self.gain) {
            *angle = *angle * gain + offset + noise.normal(MOCAP_NOISE_RAD);
        }
        angles
    }
}

/// Additional tracker errors: those of a camera that looks at the hand, with angles that a network estimates from its
/// pictures; or errors that the user of the simulation set.
///
/// Each joint has a constant bias for the session, and an error that is partly the same for several frames, because
/// it depends on how the hand is seen. The delay is in [`session`](super::session).
///
/// # Source
/// Sizes for a camera are assumed: a correction by pose should tolerate a bias of 10 degrees and 5 degrees of noise.
#[derive(Debug)]
pub(crate) struct SeenBadly {
    bias: [f64; JOINTS.len()],
    slow: Vec<Wander>,
    fast_rad: f64,
    noise: Noise,
}

/// Spread of a camera's bias from joint to joint, rad.
pub(crate) const CAMERA_BIAS_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Noise of a camera's angles, rad.
pub(crate) const CAMERA_NOISE_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;
const SLOW_S: f64 = 0.3;

impl SeenBadly {
    pub(crate) fn new(bias_rad: f64, noise_rad: f64, mut noise: Noise) -> Self {
        let share = noise_rad * std::f64::consts::FRAC_1_SQRT_2; // half of the variance is slow
        SeenBadly {
            bias: array::from_fn(|_| noise.normal(bias_rad)),
            slow: JOINTS.iter().map(|_| Wander::new(share, SLOW_S, &mut noise)).collect(),
            fast_rad: share,
            noise,
        }
    }

    /// Adds errors to angles, `dt_s` after the previous ones. `[joints]` in the order of [`JOINTS`], rad.
    pub(crate) fn put_on(&mut self, dt_s: f64, angles: &mut [f64]) {
        for ((angle, bias), slow) in angles.iter_mut().zip(self.bias).zip(&mut self.slow) {
            let fast = self.noise.normal(self.fast_rad);
            *angle += bias + slow.advance(dt_s, &mut self.noise) + fast;
        }
    }
}
