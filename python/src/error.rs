//! The crate's errors as Python exceptions: each with the one line that `tpf` would say.

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use tactile_pose_fusion::calibrate::CalibrateError;
use tactile_pose_fusion::calibration::CalibrationFileError;
use tactile_pose_fusion::characterization::CharacterizeError;
use tactile_pose_fusion::config::ConfigError;
use tactile_pose_fusion::evaluate::EvaluateError;
use tactile_pose_fusion::export::ExportError;
use tactile_pose_fusion::fusion::{FusionError, SetupError};
use tactile_pose_fusion::glove::{GloveError, SeveralModels};
use tactile_pose_fusion::inspect::InspectError;
use tactile_pose_fusion::replay::ReplayError;
use tactile_pose_fusion::sessions::SessionError;
use tactile_pose_fusion::synthetic::SyntheticError;
use tactile_pose_fusion::training::TrainingError;
use tactile_pose_fusion::zero::ZeroError;

create_exception!(
    tactile_pose_fusion,
    TactilePoseFusionError,
    PyException,
    "Something can't be done; the text is one line that says why and what to do."
);
create_exception!(
    tactile_pose_fusion,
    ParameterError,
    TactilePoseFusionError,
    "A parameter or an argument is refused."
);
create_exception!(tactile_pose_fusion, ModelError, TactilePoseFusionError, "A model can't be used.");
create_exception!(tactile_pose_fusion, BagError, TactilePoseFusionError, "A bag can't be read or written.");
create_exception!(
    tactile_pose_fusion,
    CalibrationError,
    TactilePoseFusionError,
    "There is no zero to measure forces from: a calibration is refused, or a recording holds none."
);

/// Puts the exceptions into the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("TactilePoseFusionError", py.get_type::<TactilePoseFusionError>())?;
    module.add("ParameterError", py.get_type::<ParameterError>())?;
    module.add("ModelError", py.get_type::<ModelError>())?;
    module.add("BagError", py.get_type::<BagError>())?;
    module.add("CalibrationError", py.get_type::<CalibrationError>())
}

/// What kind of exception an error of the crate is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Parameter,
    Model,
    Bag,
    Calibration,
    Other,
}

/// An error of the crate.
pub(crate) trait Refusal: std::fmt::Display {
    /// Its kind.
    fn kind(&self) -> Kind;
}

/// The exception of an error.
pub(crate) fn raise(error: &(impl Refusal + ?Sized)) -> PyErr {
    exception(error.kind(), error.to_string())
}

/// An exception of a kind.
pub(crate) fn exception(kind: Kind, line: String) -> PyErr {
    match kind {
        Kind::Parameter => ParameterError::new_err(line),
        Kind::Model => ModelError::new_err(line),
        Kind::Bag => BagError::new_err(line),
        Kind::Calibration => CalibrationError::new_err(line),
        Kind::Other => TactilePoseFusionError::new_err(line),
    }
}

/// Errors of one kind.
macro_rules! all_of {
    ($($error:ty => $kind:ident),* $(,)?) => {
        $(impl Refusal for $error {
            fn kind(&self) -> Kind {
                Kind::$kind
            }
        })*
    };
}

all_of! {
    ConfigError => Parameter,
    SetupError => Parameter,
    SeveralModels => Parameter,
    FusionError => Model,
    ZeroError => Calibration,
    CalibrationFileError => Calibration,
}

impl Refusal for GloveError {
    fn kind(&self) -> Kind {
        match self {
            GloveError::Config(_) | GloveError::Setup(_) => Kind::Parameter,
            GloveError::Model(_) => Kind::Model,
        }
    }
}

impl Refusal for ReplayError {
    fn kind(&self) -> Kind {
        match self {
            ReplayError::Bag(_)
            | ReplayError::Input(_)
            | ReplayError::NotWhole { .. }
            | ReplayError::OtherTopics { .. } => Kind::Bag,
            ReplayError::Model(_) | ReplayError::Fusion(_) => Kind::Model,
            ReplayError::Zero(error) => error.kind(),
            ReplayError::Setup(_) | ReplayError::TopicTaken { .. } | ReplayError::Idle { .. } => Kind::Parameter,
            ReplayError::Cancelled(_) => Kind::Other,
        }
    }
}

impl Refusal for SessionError {
    fn kind(&self) -> Kind {
        match self {
            SessionError::Setup(_) => Kind::Parameter,
            SessionError::Cancelled(_) => Kind::Other,
            _ => Kind::Bag,
        }
    }
}

impl Refusal for EvaluateError {
    fn kind(&self) -> Kind {
        match self {
            EvaluateError::Model(_) | EvaluateError::NoFolds { .. } | EvaluateError::NoFold { .. } => Kind::Model,
            EvaluateError::Models(_)
            | EvaluateError::NoPose
            | EvaluateError::DecidedBefore
            | EvaluateError::NoModel => Kind::Parameter,
            EvaluateError::Session(error) => error.kind(),
            EvaluateError::Cancelled(_) | EvaluateError::OfCaller(_) => Kind::Other,
            _ => Kind::Bag,
        }
    }
}

impl Refusal for CalibrateError {
    fn kind(&self) -> Kind {
        match self {
            CalibrateError::Bag(_) | CalibrateError::Input(_) => Kind::Bag,
            CalibrateError::Model(_) | CalibrateError::Fusion(_) => Kind::Model,
            CalibrateError::Setup(_) => Kind::Parameter,
            CalibrateError::Zero(error) => error.kind(),
            CalibrateError::Session(error) => error.kind(),
            CalibrateError::Cancelled(_) => Kind::Other,
        }
    }
}

impl Refusal for CharacterizeError {
    fn kind(&self) -> Kind {
        match self {
            CharacterizeError::Setup(_) => Kind::Parameter,
            CharacterizeError::Cancelled(_) => Kind::Other,
            _ => Kind::Bag,
        }
    }
}

impl Refusal for ExportError {
    fn kind(&self) -> Kind {
        match self {
            ExportError::Model(_) => Kind::Model,
            ExportError::Models(_) | ExportError::Rate { .. } | ExportError::Window { .. } => Kind::Parameter,
            ExportError::Session(error) => error.kind(),
            ExportError::Cancelled(_)
            | ExportError::NoFolder { .. }
            | ExportError::DatasetExists { .. }
            | ExportError::TableExists { .. } => Kind::Other,
            _ => Kind::Bag,
        }
    }
}

impl Refusal for SyntheticError {
    fn kind(&self) -> Kind {
        match self {
            SyntheticError::Sim(_) => Kind::Parameter,
            SyntheticError::Bag(_) => Kind::Bag,
            SyntheticError::Cancelled(_) => Kind::Other,
        }
    }
}

impl Refusal for InspectError {
    fn kind(&self) -> Kind {
        match self {
            InspectError::Bag(_) => Kind::Bag,
            InspectError::Model(_) => Kind::Model,
            InspectError::Definitions { .. } => Kind::Bag,
            InspectError::Cancelled(_) => Kind::Other,
        }
    }
}

impl Refusal for TrainingError {
    fn kind(&self) -> Kind {
        match self {
            TrainingError::Setup(_)
            | TrainingError::Train(_)
            | TrainingError::Split(_)
            | TrainingError::SeveralRegions { .. }
            | TrainingError::NoSuchRegion { .. }
            | TrainingError::NoJoints { .. }
            | TrainingError::NoTruth { .. }
            | TrainingError::LightTouches
            | TrainingError::NotOnnx { .. } => Kind::Parameter,
            TrainingError::Bag(_)
            | TrainingError::Dataset(_)
            | TrainingError::NoUser { .. }
            | TrainingError::OneGroup { .. } => Kind::Bag,
            TrainingError::Session(error) => error.kind(),
            TrainingError::Evaluate(error) => error.kind(),
            _ => Kind::Other,
        }
    }
}
