//! Results as people and other programs read them: text for a terminal, pages, pictures, tables, and checks for continuous
//! integration.

pub mod characterization;
pub mod checks;
#[cfg(feature = "ros")]
pub(crate) mod collection;
pub mod comparison;
#[cfg(feature = "ros")]
pub mod doctor;
pub mod evaluation;
pub(crate) mod help;
pub mod inspection;
#[cfg(feature = "ros")]
pub(crate) mod monitor;
pub mod picture;
pub(crate) mod progress;
pub(crate) mod said;
#[cfg(feature = "ros")]
pub(crate) mod screen;
pub(crate) mod terminal;
#[cfg(feature = "train")]
pub mod training;
