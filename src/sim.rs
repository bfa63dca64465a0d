//! A **synthetic** glove, hand and load cell: whoever shows a number that came from here says so.
//!
//! There is no public recording of glove taxels with joint angles and force truth, so the package brings a physical
//! model of one: a user ([`hand`]) goes through the paper's [`protocol`](crate::protocol) ([`performance`]) wearing one of
//! three gloves ([`glove`]) and pressing on a load cell ([`load_cell`]), or handles things freely ([`manipulation`]);
//! [`session`] streams what would be recorded.
//! Its parameters come from physics and from what the paper observed, never from how well a model does on it.
//!
//! Everything is a function of [`SessionSpec`]: random numbers are a seeded ChaCha stream, and transcendental functions
//! are those of the `libm` crate, because the platform's may differ in the last bit from machine to machine.

pub mod glove;
pub mod hand;
pub mod load_cell;
pub mod manipulation;
pub mod performance;
pub mod session;
pub mod touch;

/// Where a synthetic glove that publishes says that it is one, as `std_msgs/msg/String`.
pub const SYNTHETIC_TOPIC: &str = "/synthetic_glove";

pub use session::{
    Activity, Conditions, FULL_MINUTES, Fault, Fingers, LiveSession, MIN_MINUTES, Physics, Prompt, Record, Session,
    SessionSpec, SimError, Tracking, TrackingErrors, simulate,
};
