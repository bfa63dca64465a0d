//! Health of the node: problems of inputs, frames by outcome, and when to log them. Pure: time is an argument, as the
//! span since any fixed moment.

mod announcer;
mod inputs;
mod outcomes;

pub use announcer::{Announcement, Announcer};
pub use inputs::{InputHealth, JointChange, Problem, TactileChange};
pub use outcomes::{Outcomes, advice};
