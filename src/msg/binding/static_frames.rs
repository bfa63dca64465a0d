//! Messages of transforms that don't change: `/tf_static` beside `/tf`.

use super::frames::FrameStore;
use super::hand::{HandPlan, TF};
use super::{BindingError, JointFields, NamesFrom, SampleError, Topic};
use crate::msg::definition::{TypeTree, canonical_type_name};

/// The topic with the transforms that don't change, beside the one that a joint source reads: `/tf_static` for `/tf`. None for
/// sources that read no transforms.
pub fn static_topic(topic: &Topic<JointFields>) -> Option<String> {
    let is_hand = matches!(topic.fields.names, NamesFrom::Hand(_));
    (is_hand && canonical_type_name(&topic.type_name) == TF).then(|| format!("{}_static", topic.name))
}

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
