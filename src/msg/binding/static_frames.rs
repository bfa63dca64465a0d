//! Messages of transforms that don't change: `/tf_static` beside `/tf`.

use super::frames::FrameStore;
use super::hand::HandPlan;
use super::{BindingError, JointFields, NamesFrom, SampleError};
use crate::msg::definition::TypeTree;

/// Keeps the frames of one message after another for the joint source that they belong to.
#[derive(Debug, Clone)]
pub struct FramesBinding {
    plan: Option<Box<HandPlan>>, // none for a source without frames, which keeps nothing
}

impl FramesBinding {
    /// Compiles the fields of a joint source for the messages that tell its static frames, which are kept in `frames`.
    ///
    /// # Errors
    /// [`BindingError`] naming the field that is not there or of the wrong kind.
    pub fn compile(fields: &JointFields, tree: &TypeTree, frames: &FrameStore) -> Result<Self, BindingError> {
        let plan = match &fields.names {
            NamesFrom::Hand(hand) => Some(Box::new(HandPlan::compile(&fields.positions, hand, tree, frames)?)),
            NamesFrom::Field(_) | NamesFrom::Constant(_) => None,
        };
        Ok(FramesBinding { plan })
    }

    /// Keeps the frames of a message.
    ///
    /// # Errors
    /// [`SampleError`] when the bytes are not what the definition says.
    pub fn keep(&mut self, cdr: &[u8]) -> Result<(), SampleError> {
        self.plan.as_mut().map_or(Ok(()), |plan| plan.keep_frames(cdr))
    }
}
