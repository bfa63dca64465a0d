//! Parameters of a session.

mod conditions;

pub use conditions::{Axes, Conditions, Fingers, Physics, Tracking, TrackingErrors};

use super::hand::Finger;
use super::manipulation::{Episode, MAX_MANIPULATION_MINUTES, MIN_MANIPULATION_MINUTES, MIN_MINUTES_WITHOUT_GRASP};

/// The shortest session that has every substage and every kind of trial, minutes.
pub const MIN_MINUTES: f64 = 1.7;
/// The whole protocol, minutes.
pub const FULL_MINUTES: f64 = 27.7;

/// Parameters of a session. The same ones give the same records on every machine.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionSpec {
    /// Number of the glove, 1 to 3.
    pub glove: u8,
    /// Number of the user: the same hand, force style and skin in all of their sessions.
    pub user: u32,
    /// Number of the donning of the glove by this user.
    pub session: u32,
    /// Seed of the world: another seed has other users. Gloves are the same in all.
    pub seed: u64,
    /// Duration, within the limits of the [`activity`](Self::activity).
    pub minutes: f64,
    /// The activity.
    pub activity: Activity,
    /// How joint angles are measured.
    pub tracking: Tracking,
    /// Other conditions that differ from the defaults.
    pub conditions: Conditions,
}

/// A user's activity in a session.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Activity {
    /// The paper's protocol, [`MIN_MINUTES`] to [`FULL_MINUTES`]; shorter has fewer repetitions, never fewer substages.
    #[default]
    Protocol,
    /// Free [`manipulation`](super::manipulation), [`MIN_MANIPULATION_MINUTES`] to [`MAX_MANIPULATION_MINUTES`], in which
    /// the glove slips in jumps besides.
    Manipulation,
}

impl Activity {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Activity::Protocol => "protocol",
            Activity::Manipulation => "manipulation",
        }
    }
}

impl SessionSpec {
    /// Possible durations, minutes. Free manipulation without grasps, which take minutes, may be shorter.
    pub(super) fn minutes_range(&self) -> std::ops::RangeInclusive<f64> {
        let chosen = &self.conditions.episodes;
        match self.activity {
            Activity::Protocol => MIN_MINUTES..=FULL_MINUTES,
            Activity::Manipulation if chosen.is_empty() || chosen.contains(&Episode::Grasp) => {
                MIN_MANIPULATION_MINUTES..=MAX_MANIPULATION_MINUTES
            }
            Activity::Manipulation => MIN_MINUTES_WITHOUT_GRASP..=MAX_MANIPULATION_MINUTES,
        }
    }

    pub(super) fn user_name(&self) -> String {
        format!("seed {}, user {}", self.seed, self.user)
    }

    /// The name of the glove: its number, or hand1 to hand3 if it has taxels on all fingertips.
    pub fn glove_name(&self) -> String {
        match self.conditions.fingers {
            Fingers::Index => self.glove.to_string(),
            Fingers::All => format!("hand{}", self.glove),
        }
    }

    /// The fingers that have taxels, in the order of the message.
    pub(super) fn fingers(&self) -> &'static [Finger] {
        match self.conditions.fingers {
            Fingers::Index => &[Finger::Index],
            Fingers::All => &Finger::ALL,
        }
    }

    pub(super) fn session_name(&self) -> String {
        format!("{}, session {}", self.user_name(), self.session)
    }
}
