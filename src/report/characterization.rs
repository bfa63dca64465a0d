//! Reports on a [`characterization`](crate::characterization).

mod page;
mod text;

pub use page::page;
pub use text::text;
