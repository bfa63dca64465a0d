//! The screen of a collection: what a person sees while a session is collected.

mod screen;
mod view;

pub(crate) use screen::draw;
pub(crate) use view::{Mood, View, clock};
