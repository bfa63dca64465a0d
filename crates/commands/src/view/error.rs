//! Why a view can't be shown.

use std::io;

use tactile_pose_fusion::bag::BagError;
use tactile_pose_fusion::observer::Cancelled;
use tactile_pose_fusion::replay::ReplayError;
use tactile_pose_fusion::sessions::SessionError;

/// A view that can't be shown. Each text is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum ViewError {
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Replay(#[from] ReplayError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error("{bag}: no frame in it has an estimate or a flag of a region of the parameters")]
    Empty { bag: String },
    #[error("port {port} of 127.0.0.1 can't be used: {error}; choose another --port, or leave it out")]
    Port { port: u16, error: io::Error },
    #[error("the page can't be served: {0}")]
    Serve(io::Error),
    #[error("frames can't be kept in a temporary file in {folder}: {error}; set TMPDIR to a folder with more space")]
    Keep { folder: String, error: io::Error },
    #[cfg(feature = "ros")]
    #[error(transparent)]
    Node(#[from] tactile_pose_fusion::ros::NodeError),
}

impl ViewError {
    /// A temporary file that can't be made, written or read.
    pub(super) fn keep(error: io::Error) -> Self {
        ViewError::Keep { folder: std::env::temp_dir().display().to_string(), error }
    }
}
