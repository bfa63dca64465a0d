//! Notes of the recorder about the whole session.

use crate::bag::{BagMetadata, printable};

/// Name of the bag metadata with these notes.
pub const SESSION_NOTES: &str = "tactile_pose_fusion.session";

/// Notes on the glove and its wearer, as far as the recorder wrote them.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Notes {
    /// The glove.
    pub glove: Option<String>,
    /// The person who wore it.
    pub user: Option<String>,
    /// Donning by this person.
    pub donning: Option<String>,
    /// True if the data are simulated, not recorded.
    pub synthetic: bool,
}

impl Notes {
    /// Reads the metadata of a bag, if they are ours.
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
