//! Clients of a graph for the commands: what listens to topics, and what plays a bag.

mod listener;
mod player;

pub use listener::{Delivery, Heard, HeardTopic, Listener, Listening, SpokenTopic};
pub use player::{NotPlayed, PlayedTopic, Player};
