//! Reports on a [`characterization`](tactile_pose_fusion::characterization).

mod page;
mod text;

pub use page::page;
pub use text::text;
