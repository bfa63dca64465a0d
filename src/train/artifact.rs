//! The artifact model of training sessions.

use super::dataset::Session;
use super::error::TrainError;
use crate::eval::Part;
use crate::fusion::{ArtifactModel, DonningFrames, learn_artifact};

/// The artifact model of sessions, each of one donning, learned from the frames of their training part.
///
/// # Errors
/// [`TrainError::Artifact`] when there are too few frames in the air, or of light touch.
pub fn fit_artifact(sessions: &[&Session], rate_hz: f64) -> Result<ArtifactModel, TrainError> {
    let learned: Vec<Vec<bool>> = sessions
        .iter()
        .map(|session| session.frames().part.iter().map(|part| *part == Part::Train).collect())
        .collect();
    let donnings: Vec<DonningFrames<'_>> = sessions
        .iter()
        .zip(&learned)
        .map(|(session, learned)| {
            let frames = session.frames();
            DonningFrames {
                tactile: &frames.tactile,
                pose: &frames.pose,
                truth_gf: &frames.truth_gf,
                epoch: &frames.epoch,
                learned,
            }
        })
        .collect();
    let sizes = sessions.first().map_or((0, 0), |session| (session.n_taxels(), session.n_joints()));
    learn_artifact(&donnings, sizes, rate_hz).map_err(|error| TrainError::Artifact { what: error.to_string() })
}
