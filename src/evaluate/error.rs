//! Why sessions can't be scored.

use std::path::PathBuf;

use crate::bag::BagError;
use crate::columns::ColumnsError;
use crate::eval::MetricError;
use crate::fusion::SetupError;
use crate::glove::SeveralModels;
use crate::model::ModelError;
use crate::observer::Cancelled;
use crate::sessions::SessionError;

/// Why sessions can't be scored. Each text is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum EvaluateError {
    #[error(transparent)]
    Bag(#[from] BagError),
    #[error(transparent)]
    Model(#[from] ModelError),
    #[error(transparent)]
    Models(#[from] SeveralModels),
    #[error(transparent)]
    Setup(#[from] SetupError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Metric(#[from] MetricError),
    #[error(transparent)]
    Columns(#[from] ColumnsError),
    #[error("{path}: {error}")]
    File { path: PathBuf, error: std::io::Error },
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error("worse joint angles are tried on a model that takes pose; give one by --model")]
    NoPose,
    #[error(
        "contact of the estimates in the bags was decided when they were made; give the model by --model to judge its touch otherwise"
    )]
    DecidedBefore,
    #[error(
        "{model}: there is no such model; `tpf train --hold-out users` makes one for each user, trained without them"
    )]
    NoFolds { model: PathBuf },
    #[error(
        "{model}: does not tell which sessions it was trained without (metadata held_out); `tpf train --hold-out` writes it"
    )]
    NoFold { model: PathBuf },
    #[error("{bag}: no model {model} was trained without it, so none can be scored on it as unseen")]
    InNoFold { bag: String, model: PathBuf },
    #[error("what models never saw is scored by models; give one by --model")]
    NoModel,
    #[error("{bag}: {reason}")]
    InBag { bag: String, reason: String },
    #[error("{first}")]
    OneFailed { first: String },
    #[error("none of {n} bags could be scored; the first: {first}")]
    AllFailed { n: usize, first: String },
    #[error("{0}")]
    OfCaller(Box<dyn std::error::Error + Send + Sync>),
}

impl EvaluateError {
    /// An error in a bag.
    pub(super) fn in_bag(bag: &str, reason: &dyn std::fmt::Display) -> Self {
        EvaluateError::InBag { bag: bag.to_owned(), reason: reason.to_string() }
    }
}
