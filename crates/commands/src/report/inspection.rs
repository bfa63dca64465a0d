//! Reports on a bag or a model, as [`inspect`](tactile_pose_fusion::inspect) found it.

mod bag;
mod format;
mod model;

pub use bag::text as bag;
pub use model::text as model;
