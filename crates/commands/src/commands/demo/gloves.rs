//! The gloves that the demo can show, and the models of each.

use plotters::style::RGBColor;
use tactile_pose_fusion::sim::Fingers;
use tactile_pose_fusion::synthetic::{SHIPPED, SHIPPED_HAND1, Shipped};

use crate::report::picture;

/// A synthetic glove for which models ship.
#[derive(Debug, Clone, Copy)]
pub(super) enum Glove {
    /// Glove 1, 2 or 3, with taxels on the index fingertip.
    OneFinger {
        /// Its number.
        number: u8,
        /// Its parameters and models.
        shipped: &'static Shipped,
    },
    /// The taxels of glove 1 on all five fingertips.
    Hand1,
}

impl Glove {
    /// The glove of this name.
    ///
    /// # Errors
    /// A text for people, if there is none.
    pub(super) fn named(text: &str) -> Result<Self, String> {
        let of_one_finger = (1_u8..).zip(&SHIPPED).find(|(number, _)| number.to_string() == text);
        match (text, of_one_finger) {
            ("hand1", _) => Ok(Glove::Hand1),
            (_, Some((number, shipped))) => Ok(Glove::OneFinger { number, shipped }),
            _ => Err(format!("expected 1, 2, 3 or hand1, got {text:?}")),
        }
    }

    /// The number of the simulated glove.
    pub(super) fn number(self) -> u8 {
        match self {
            Glove::OneFinger { number, .. } => number,
            Glove::Hand1 => 1,
        }
    }

    /// The fingers that have taxels.
    pub(super) fn fingers(self) -> Fingers {
        match self {
            Glove::OneFinger { .. } => Fingers::Index,
            Glove::Hand1 => Fingers::All,
        }
    }

    /// The beginning of the names of its files.
    pub(super) fn file_stem(self) -> String {
        match self {
            Glove::OneFinger { number, .. } => format!("glove{number}"),
            Glove::Hand1 => "hand1".to_owned(),
        }
    }

    /// Name and text of the parameter file, which names the adaptive model.
    pub(super) fn params(self) -> (String, String) {
        match self {
            // Whoever goes on with this file wants the best of the models.
            Glove::OneFinger { number, shipped } => {
                (format!("glove{number}.yaml"), shipped.params.replace("_pose_aware.onnx", "_adaptive.onnx"))
            }
            Glove::Hand1 => ("hand1_shared.yaml".to_owned(), SHIPPED_HAND1.params.to_owned()),
        }
    }

    /// The models that are compared, from the simplest to the best.
    pub(super) fn models(self) -> &'static [Model] {
        match self {
            Glove::OneFinger { .. } => &[Model::Gain, Model::TactileOnly, Model::PoseAware, Model::Adaptive],
            Glove::Hand1 => &[Model::Gain, Model::Adaptive],
        }
    }

    /// The model whose errors the picture shows, and with which a person compares the adaptive one.
    pub(super) fn baseline(self) -> Model {
        match self {
            Glove::OneFinger { .. } => Model::TactileOnly,
            Glove::Hand1 => Model::Gain,
        }
    }

    /// The ONNX files that ship.
    pub(super) fn shipped_models(self) -> Vec<(Model, &'static [u8])> {
        match self {
            Glove::OneFinger { shipped, .. } => vec![
                (Model::TactileOnly, shipped.tactile_only),
                (Model::PoseAware, shipped.pose_aware),
                (Model::Adaptive, shipped.adaptive),
            ],
            Glove::Hand1 => vec![(Model::Adaptive, SHIPPED_HAND1.adaptive)],
        }
    }
}

/// A method that the demo compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Model {
    Gain,
    TactileOnly,
    PoseAware,
    Adaptive,
}

impl Model {
    /// As people read it.
    pub(super) fn name(self) -> &'static str {
        match self {
            Model::Gain => "taxels-times-gain",
            Model::Adaptive => "adaptive",
            Model::TactileOnly => "tactile-only",
            Model::PoseAware => "pose-aware",
        }
    }

    /// As in names of files.
    pub(super) fn file_stem(self) -> String {
        self.name().replace('-', "_")
    }

    /// Its colour in the picture.
    pub(super) fn colour(self) -> RGBColor {
        match self {
            Model::Gain => picture::LIGHT_GRAY,
            Model::TactileOnly => picture::ORANGE,
            Model::PoseAware => picture::BLUE,
            Model::Adaptive => picture::GREEN,
        }
    }
}
