//! The shape of the paper's network (Sec. V): its parameters, by name.

use serde::{Deserialize, Serialize};

use super::error::TrainError;

/// Width of the tactile and of the pose features, and of every convolution.
pub const N_FEATURES: usize = 64;

/// Hidden width of the Bi-LSTM, each direction.
pub(super) const LSTM_HIDDEN: usize = 32;

/// Dilations, and also paddings, of the multi-scale block.
pub(super) const DILATIONS: [usize; 3] = [1, 2, 4];

/// Taps of every convolution.
pub(super) const TAPS: usize = 3;

/// Channels and dilations of the causal network: the last frame depends on all frames of a window but one.
pub(super) const CAUSAL_CHANNELS: usize = 64;
pub(super) const CAUSAL_DILATIONS: [usize; 5] = [1, 2, 4, 8, 16];

/// Frames that the causal network needs for one force.
pub(super) const CAUSAL_FRAMES: usize = 63;

/// Hidden widths of the decoders. The paper gives two fully connected layers with a ReLU between, not their width.
const BASE_HIDDEN: usize = 32;
const FUSION_HIDDEN: usize = 64;

/// Kind of network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The paper's: a tactile force minus a residual from pose and touch, with the auxiliary decoder.
    PoseAware,
    /// The tactile branch alone: the paper's baseline.
    TactileOnly,
    /// One decoder over the concatenated features, which the paper found worse: kept for comparison.
    EarlyFusion,
    /// A causal convolutional network over taxels with the artifact model subtracted, with an output for touch.
    Adaptive,
}

impl Kind {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Kind::PoseAware => "pose-aware",
            Kind::TactileOnly => "tactile-only",
            Kind::EarlyFusion => "early-fusion",
            Kind::Adaptive => "adaptive",
        }
    }

    /// True if the network takes joint angles.
    pub fn uses_pose(self) -> bool {
        matches!(self, Kind::PoseAware | Kind::EarlyFusion)
    }

    /// True if it needs joint angles, in the network or before it.
    pub fn needs_joints(self) -> bool {
        self != Kind::TactileOnly
    }
}

/// A network's shape and scales.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Architecture {
    /// Its kind.
    pub kind: Kind,
    /// Frames per window.
    pub window: usize,
    /// Taxels per frame.
    pub n_taxels: usize,
    /// Joint angles per frame; not used without pose.
    pub n_joints: usize,
    /// Divides the taxels, so that the network gets numbers of about 1 for any sensor unit.
    pub tactile_scale: f32,
    /// Multiplies the outputs of the force decoders, in gF: the decoders work on numbers of about 1.
    pub force_scale: f32,
    /// A taxel's reading of a light touch, for the causal network: it also gets the taxels in this unit, limited to 1.
    #[serde(default = "one")]
    pub touch_scale: f32,
    /// The axes of a force that has three; the decoders give one number each, or these three.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axes: Option<ContactAxes>,
}

/// The axes in which a network of three decodes its force: it learns the normal force as the paper does, and beside it what
/// is tangential.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ContactAxes {
    /// The contact normal, and two tangents, each x, y, z in the frame of the patch; orthonormal.
    pub in_patch: [[f64; 3]; 3],
}

impl ContactAxes {
    /// Axes of a contact normal. The tangents are arbitrary: losses and scores don't depend on them.
    pub fn of(normal: &nalgebra::Unit<nalgebra::Vector3<f64>>) -> Self {
        // The axis of the patch that is least along the normal is well away from it.
        let least = normal.iamin();
        let aside = nalgebra::Vector3::from_fn(|axis, _| if axis == least { 1.0 } else { 0.0 });
        let first = (aside - normal.into_inner() * normal.dot(&aside)).normalize();
        let second = normal.cross(&first);
        ContactAxes { in_patch: [normal.into_inner(), first, second].map(Into::into) }
    }

    /// Components of a tangential force along the two tangents.
    pub fn tangents(&self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        let along = |axis: [f64; 3]| axis[0] * x + axis[1] * y + axis[2] * z;
        [along(self.in_patch[1]), along(self.in_patch[2])]
    }

    /// A tangential force x, y, z of its components along the two tangents.
    pub fn across(&self, [first, second]: [f64; 2]) -> [f64; 3] {
        std::array::from_fn(|axis| self.in_patch[1][axis] * first + self.in_patch[2][axis] * second)
    }
}

fn one() -> f32 {
    1.0
}

/// A tensor of weights: its name, and its place in [`Network::values`](super::Network::values).
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Parameter {
    /// Name, as in PyTorch.
    pub name: String,
    /// Shape, row-major.
    pub dims: Vec<usize>,
    /// Index of its first value.
    pub start: usize,
}

impl Parameter {
    /// Number of its values.
    pub fn n_values(&self) -> usize {
        self.dims.iter().product()
    }

    /// Index range of its values.
    pub fn range(&self) -> std::ops::Range<usize> {
        self.start..self.start + self.n_values()
    }

    /// Inputs that each output sums over: uniform start values are bounded by 1 / sqrt of it, as in PyTorch.
    pub(super) fn fan_in(&self, siblings: &[Parameter]) -> usize {
        if self.name.starts_with("pose.lstm") {
            return LSTM_HIDDEN;
        }
        let weight_name = self.name.replace(".bias", ".weight");
        let weight = siblings.iter().find(|parameter| parameter.name == weight_name).unwrap_or(self);
        weight.dims.iter().skip(1).product()
    }

    /// The constant start value, for normalizations; other parameters start random.
    pub(super) fn constant_start(&self) -> Option<f32> {
        let normalization = self.name.starts_with("tactile.norm") || self.name.starts_with("pose.norm");
        normalization.then(|| if self.name.ends_with(".weight") { 1.0 } else { 0.0 })
    }
}

impl Architecture {
    /// Checks that the shape can be built.
    ///
    /// # Errors
    /// [`TrainError::Architecture`].
    pub fn check(&self) -> Result<(), TrainError> {
        let refuse = |what: &str| Err(TrainError::Architecture { what: what.to_string() });
        if self.window == 0 || self.n_taxels == 0 {
            return refuse("window and taxels must be at least 1");
        }
        if self.kind.uses_pose() && self.n_joints == 0 {
            return refuse("a network with pose needs at least one joint; train kind tactile-only without");
        }
        if [self.window, self.n_taxels, self.n_joints].iter().any(|size| *size > 1 << 16) {
            return refuse("window, taxels and joints must be at most 65536");
        }
        let scales = [self.tactile_scale, self.force_scale, self.touch_scale];
        if !scales.iter().all(|scale| scale.is_finite() && *scale > 0.0) {
            return refuse("tactile_scale, force_scale and touch_scale must be positive");
        }
        if self.kind == Kind::Adaptive && self.axes.is_some() {
            return refuse(
                "an adaptive network gives the normal force only; train kind pose-aware or tactile-only for three axes",
            );
        }
        if self.kind == Kind::Adaptive && self.window < CAUSAL_FRAMES {
            return refuse("an adaptive network needs a window of 63 frames or more");
        }
        Ok(())
    }

    /// Numbers of a force: 1, or 3.
    pub fn n_axes(&self) -> usize {
        if self.axes.is_some() { 3 } else { 1 }
    }

    /// The parameters in their order in [`Network::values`](super::Network::values).
    pub fn parameters(&self) -> Vec<Parameter> {
        let mut list = Layout::default();
        if self.kind == Kind::Adaptive {
            for (idx, _) in CAUSAL_DILATIONS.into_iter().enumerate() {
                let n_in = if idx == 0 { 2 * self.n_taxels } else { CAUSAL_CHANNELS };
                list.push(&format!("causal.conv{idx}"), &[CAUSAL_CHANNELS, n_in, TAPS]);
            }
            list.push_decoder("base", CAUSAL_CHANNELS, BASE_HIDDEN, 1);
            list.push_decoder("touch", CAUSAL_CHANNELS, BASE_HIDDEN, 1);
            return list.0;
        }
        list.push("tactile.conv0", &[N_FEATURES, self.n_taxels, TAPS]);
        list.push_norm("tactile.norm", N_FEATURES);
        for idx in 1..=DILATIONS.len() {
            list.push(&format!("tactile.conv{idx}"), &[N_FEATURES, N_FEATURES, TAPS]);
        }
        if self.kind != Kind::EarlyFusion {
            list.push_decoder("base", N_FEATURES, BASE_HIDDEN, self.n_axes());
        }
        if self.kind.uses_pose() {
            list.push_norm("pose.norm", 2 * self.n_joints);
            list.push("pose.embed", &[N_FEATURES, 2 * self.n_joints]);
            for layer in 0..2 {
                for direction in ["forward", "backward"] {
                    let name = format!("pose.lstm{layer}.{direction}");
                    list.push_tensor(&format!("{name}.weight_ih"), &[4 * LSTM_HIDDEN, N_FEATURES]);
                    list.push_tensor(&format!("{name}.weight_hh"), &[4 * LSTM_HIDDEN, LSTM_HIDDEN]);
                    list.push_tensor(&format!("{name}.bias_ih"), &[4 * LSTM_HIDDEN]);
                    list.push_tensor(&format!("{name}.bias_hh"), &[4 * LSTM_HIDDEN]);
                }
            }
        }
        match self.kind {
            Kind::TactileOnly | Kind::Adaptive => {}
            Kind::EarlyFusion => list.push_decoder("fused", 2 * N_FEATURES, FUSION_HIDDEN, self.n_axes()),
            Kind::PoseAware => {
                list.push_decoder("residual", 3 * N_FEATURES, FUSION_HIDDEN, self.n_axes());
                list.push_decoder("auxiliary", N_FEATURES, FUSION_HIDDEN, self.n_taxels);
            }
        }
        list.0
    }
}

#[derive(Default)]
struct Layout(Vec<Parameter>);

impl Layout {
    fn push_tensor(&mut self, name: &str, dims: &[usize]) {
        let start = self.0.last().map_or(0, |last| last.range().end);
        self.0.push(Parameter { name: name.to_string(), dims: dims.to_vec(), start });
    }

    fn push(&mut self, name: &str, weight_dims: &[usize]) {
        self.push_tensor(&format!("{name}.weight"), weight_dims);
        self.push_tensor(&format!("{name}.bias"), &weight_dims[..1]);
    }

    fn push_norm(&mut self, name: &str, width: usize) {
        self.push(name, &[width]);
    }

    fn push_decoder(&mut self, name: &str, n_in: usize, hidden: usize, n_out: usize) {
        self.push(&format!("{name}.0"), &[hidden, n_in]);
        self.push(&format!("{name}.1"), &[n_out, hidden]);
    }
}
