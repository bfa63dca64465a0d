//! Leads a user through a collection protocol: current instruction, annotations, sensor values, and whether the data
//! are good enough for training. Pure: time is an argument.

mod checks;
mod done;
mod known_touches;
mod quality;
mod senses;
mod session;

pub use checks::{Preflight, Problem};
pub use done::done;
pub use known_touches::TouchGuide;
pub use quality::{ItemQuality, StageQuality};
pub use senses::{Layout, Senses, Spread, Stream, Window};
pub use session::{Command, Happened, LedSession, State};
