//! What the recorder noted about a session as a whole.

use crate::bag::{BagMetadata, printable};

/// Name of the notes within a bag that say who wore which glove.
pub const SESSION_NOTES: &str = "tactile_pose_fusion.session";

/// Who wore which glove, where the recorder noted it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Notes {
    /// The glove.
    pub glove: Option<String>,
    /// Who wore it.
    pub user: Option<String>,
    /// Which donning by this user.
    pub donning: Option<String>,
    /// Whether it is no recording but made by a simulator.
    pub synthetic: bool,
}

impl Notes {
    /// Takes the notes of a bag, if they are ours.
    pub fn handle(&mut self, metadata: &BagMetadata<'_>) {
        if metadata.name != SESSION_NOTES {
            return;
        }
        let noted =
            |key: &str| metadata.metadata.get(key).filter(|value| !value.is_empty()).map(|value| printable(value));
        self.glove = noted("glove").or_else(|| self.glove.take());
        self.user = noted("user").or_else(|| self.user.take());
        self.donning = noted("donning").or_else(|| self.donning.take());
        self.synthetic |= noted("synthetic").is_some_and(|value| value == "true");
    }
}
