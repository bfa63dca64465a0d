//! A **synthetic** glove, hand and load cell: any number computed from it must be labelled as synthetic.
//!
//! There is no public recording of glove taxels with joint angles and true force, so the package has a physical
//! model of one. A user ([`hand`]) goes through the paper's [`protocol`](crate::protocol) ([`performance`]), wearing
//! one of three gloves ([`glove`]) and pressing on a load cell ([`load_cell`]) or dragging on it (`drag`), or handles objects freely
//! ([`manipulation`]). [`session`] streams the data that would be recorded. Its parameters come from physics and from
//! the paper's observations, never from the score of a model on its data.
//!
//! Everything is a function of [`SessionSpec`]: random numbers are a seeded ChaCha stream, and transcendental functions
//! are those of the `libm` crate, because the platform's may differ in the last bit from machine to machine.

mod drag;
pub mod glove;
pub mod hand;
pub mod load_cell;
pub mod manipulation;
pub mod performance;
pub mod session;
mod spec;
pub mod touch;

/// Topic on which a synthetic glove announces that it is one, as `std_msgs/msg/String`.
pub const SYNTHETIC_TOPIC: &str = "/synthetic_glove";

pub use session::{Fault, LiveSession, Prompt, Record, SimError, SimulatedSession, simulate};
pub use spec::{
    Activity, Axes, Conditions, FULL_MINUTES, Fingers, MIN_MINUTES, Physics, SessionSpec, Tracking, TrackingErrors,
};
