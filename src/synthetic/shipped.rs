//! The parameters and models that ship for the synthetic gloves.

/// Parameters and models of a synthetic glove. Its models were trained on SYNTHETIC data.
#[derive(Debug, Clone, Copy)]
pub struct Shipped {
    /// Text of the parameter file, which names the pose-aware model as `../models/glove<N>_pose_aware.onnx`.
    pub params: &'static str,
    /// ONNX file of the paper's network.
    pub pose_aware: &'static [u8],
    /// ONNX file of the model that sees taxels alone.
    pub tactile_only: &'static [u8],
    /// ONNX file of the model that follows the artifact.
    pub adaptive: &'static [u8],
}

macro_rules! shipped {
    ($glove:literal) => {
        Shipped {
            params: include_str!(concat!("../../params/glove", $glove, ".yaml")),
            pose_aware: include_bytes!(concat!("../../models/glove", $glove, "_pose_aware.onnx")),
            tactile_only: include_bytes!(concat!("../../models/glove", $glove, "_tactile_only.onnx")),
            adaptive: include_bytes!(concat!("../../models/glove", $glove, "_adaptive.onnx")),
        }
    };
}

/// Those of the gloves 1, 2 and 3.
pub const SHIPPED: [Shipped; 3] = [shipped!("1"), shipped!("2"), shipped!("3")];

/// Parameters and the model of a synthetic glove with taxels on all five fingertips. The model was trained on SYNTHETIC data.
#[derive(Debug, Clone, Copy)]
pub struct ShippedHand {
    /// Text of the parameter file, which names the model as `../models/hand<N>_adaptive.onnx`.
    pub params: &'static str,
    /// ONNX file of the model that follows the artifact, one for all five fingertips.
    pub adaptive: &'static [u8],
}

/// Those of the glove hand1.
pub const SHIPPED_HAND1: ShippedHand = ShippedHand {
    params: include_str!("../../params/hand1_shared.yaml"),
    adaptive: include_bytes!("../../models/hand1_adaptive.onnx"),
};
