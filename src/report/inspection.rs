//! What [`inspect`](crate::inspect) found in a bag or a model.

mod bag;
mod format;
mod model;

pub use bag::text as bag;
pub use model::text as model;
