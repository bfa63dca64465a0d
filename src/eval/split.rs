//! Which frames train and which test: always the earlier and the later ones, so that no future leaks into a model.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::units::Stamp;

/// What is known of a frame besides its data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameLabel<'a> {
    /// Its stamp.
    pub stamp: Stamp,
    /// The session's stage that it belongs to.
    pub stage: &'a str,
    /// The substage of the stage.
    pub substage: &'a str,
}

/// Within what a session is cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplitBy {
    /// Each stage by itself, so that the test set holds all of them. The default.
    #[default]
    Stage,
    /// The session as a whole: the paper's words (Sec. VI-A). Of a staged session that tests the last stage alone.
    Session,
}

/// What a frame is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Training.
    Train,
    /// Neither: between the two, so that no window of a test frame holds a training frame.
    Guard,
    /// Testing.
    Test,
}

/// A split that can't be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum SplitError {
    #[error("share of frames to train on is {0}, expected above 0 and below 1; the paper's is 0.8")]
    Share(f64),
    #[error("substage {name} is not in the data, which has {}; name one of these", .available.join(", "))]
    UnknownSubstage { name: String, available: Vec<String> },
}

/// A chronological split.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Split {
    by: SplitBy,
    train_share: f64,
    guard_frames: usize,
}

impl Default for Split {
    /// 80/20 within each stage, without a guard.
    fn default() -> Self {
        Split { by: SplitBy::Stage, train_share: 0.8, guard_frames: 0 }
    }
}

impl Split {
    /// A split in which `train_share` of the frames train, the next `guard_frames` are left out and the rest tests.
    ///
    /// The paper has no guard. With windows of 64 frames a guard of 63 keeps training frames out of every test window
    /// that follows them directly. It does nothing where the training frames of a stage follow the test frames of the
    /// one before: who trains there leaves out windows that reach over the seam.
    ///
    /// # Errors
    /// [`SplitError::Share`] unless the share is between 0 and 1.
    pub fn new(by: SplitBy, train_share: f64, guard_frames: usize) -> Result<Self, SplitError> {
        if !(train_share > 0.0 && train_share < 1.0) {
            return Err(SplitError::Share(train_share));
        }
        Ok(Split { by, train_share, guard_frames })
    }

    /// The part of each frame of one session, in the order in which the frames are given.
    ///
    /// The frames of a stage are put in the order of their stamps, equal ones in the order given; the first
    /// `floor(share * n)` train. A stage that was interrupted and taken up again is one stage.
    ///
    /// # Shapes
    /// `frames`: `[n_frames]` of one session; the result: `[n_frames]`.
    pub fn parts(&self, frames: &[FrameLabel<'_>]) -> Vec<Part> {
        let mut groups: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (idx, frame) in frames.iter().enumerate() {
            let group = match self.by {
                SplitBy::Stage => frame.stage,
                SplitBy::Session => "",
            };
            groups.entry(group).or_default().push(idx);
        }
        let mut parts = vec![Part::Train; frames.len()];
        for mut group in groups.into_values() {
            group.sort_by_key(|&idx| frames[idx].stamp);
            let n_train = (self.train_share * group.len() as f64).floor() as usize;
            for (position, idx) in group.into_iter().enumerate().skip(n_train) {
                parts[idx] = if position - n_train < self.guard_frames { Part::Guard } else { Part::Test };
            }
        }
        parts
    }
}

/// Which frames belong to the named substages: how the free movements, the paper's "unseen" poses, are told apart.
///
/// # Shapes
/// The result: `[n_frames]`.
/// # Errors
/// [`SplitError::UnknownSubstage`] for a name that no frame has, so that a typing error isn't an empty result.
/// # Source
/// Pose-aware tactile gloves, Sec. VI-B, "Generalizability against unseen poses".
pub fn substage_frames(frames: &[FrameLabel<'_>], names: &[&str]) -> Result<Vec<bool>, SplitError> {
    let available: BTreeSet<&str> = frames.iter().map(|frame| frame.substage).collect();
    if let Some(name) = names.iter().find(|name| !available.contains(**name)) {
        let available = available.into_iter().map(str::to_owned).collect();
        return Err(SplitError::UnknownSubstage { name: (*name).to_owned(), available });
    }
    let wanted: BTreeSet<&str> = names.iter().copied().collect();
    Ok(frames.iter().map(|frame| wanted.contains(frame.substage)).collect())
}
