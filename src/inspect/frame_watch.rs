//! Which frames the messages of `/tf` tell.

use std::collections::BTreeMap;

use crate::msg::binding::{TF, hand_paths};
use crate::msg::definition::TypeTree;
use crate::msg::dynamic::{FieldPlan, ReadAs};

/// Most frames of a topic whose names are kept.
const MAX_FRAMES: usize = 1024;

/// The frames that the messages of a topic tell.
#[derive(Debug)]
pub(super) struct FrameWatch {
    names: FieldPlan,
    /// By their name in lower case.
    pub(super) frames: BTreeMap<String, String>,
}

/// A watch for messages of transforms.
pub(super) fn watch(tree: &TypeTree) -> Option<FrameWatch> {
    let names = hand_paths(tree.type_name()).filter(|_| tree.type_name() == TF)?.names[0];
    Some(FrameWatch { names: FieldPlan::compile(tree, names, ReadAs::Texts).ok()?, frames: BTreeMap::new() })
}

impl FrameWatch {
    /// Takes in a message; one that can't be read is counted elsewhere.
    pub(super) fn handle(&mut self, cdr: &[u8], texts: &mut Vec<String>) {
        if self.names.read_texts(cdr, texts).is_err() {
            return;
        }
        for name in texts.iter() {
            let key = name.to_ascii_lowercase();
            if self.frames.len() < MAX_FRAMES || self.frames.contains_key(&key) {
                self.frames.entry(key).or_insert_with(|| name.clone());
            }
        }
    }
}
