//! A page in the browser that shows a bag, or a running node: taxels, forces, contacts, flags and artifact.
//!
//! The page is served on the loopback interface alone, under an address that holds a secret. Everything that it needs is in
//! the program. [`BagView::read`] takes a bag to frames in files, [`Server`] gives them to the page a window at a time, and
//! `live` follows a node.

mod assets;
mod bins;
mod error;
#[cfg(feature = "ros")]
mod feed;
mod frames;
#[cfg(feature = "ros")]
pub mod live;
mod rows;
mod scalars;
mod server;
mod session;
mod setup;

pub use error::ViewError;
pub use server::{Content, Server};
pub use session::{BagView, Request};
