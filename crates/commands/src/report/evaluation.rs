//! Reports on an evaluation by [`evaluate`](tactile_pose_fusion::evaluate).

mod page;
mod pose_quality;
mod table;
mod tables;
mod text;
mod verdict;

pub use page::page;
pub use tables::{FrameFile, write_scores};
pub use text::{short_text, text};
