//! Whether the node's user gets what they think: what is wrong with inputs, what became of frames, and when a person is
//! told. Pure: time is an argument, as the span since any fixed moment.

mod announcer;
mod inputs;
mod outcomes;

pub use announcer::{Announcement, Announcer};
pub use inputs::{InputHealth, JointChange, Problem, TactileChange};
pub use outcomes::{Outcomes, advice};
