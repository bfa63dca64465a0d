//! What [`characterization`](crate::characterization) found.

mod page;
mod text;

pub use page::page;
pub use text::text;
