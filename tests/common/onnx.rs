//! Small ONNX models for tests: linear in the last frame, so that a test can do the sum by hand, and breakable in
//! every way that the contract refuses.
//!
//! ```text
//! base     = tactile_gain * sum of the taxels of the last frame
//! residual = pose_gain * sum of the joints of the last frame
//! force    = base - residual
//! ```

use std::path::{Path, PathBuf};

use tactile_pose_fusion::model::onnx::{
    AttributeProto, DimensionProto, EXTERNAL, GraphProto, Message, ModelProto, NodeProto, TensorProto, ValueInfoProto,
    data_type,
};

/// A linear model, and what is wrong with it, if anything is.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearModel {
    /// Frames in a window.
    pub window: usize,
    /// Taxels in a frame.
    pub n_taxels: usize,
    /// Joints in a frame; 0 leaves the pose input out.
    pub n_joints: usize,
    /// Force per unit of a taxel.
    pub tactile_gain: f32,
    /// Artifact per radian of a joint.
    pub pose_gain: f32,
    /// Names of `tactile`, `pose`, `force`, `force_base`, `force_residual` in the file.
    pub names: [String; 5],
    /// Whether `force_base` and `force_residual` are given as outputs.
    pub branch_outputs: bool,
    /// Name of a touch output, if there is one: the sigmoid of the force.
    pub touch: Option<String>,
    /// What the base and the residual are multiplied by for x, y and z, in a model of three axes.
    pub axes: Option<[f32; 3]>,
    /// Entries of `metadata_props`.
    pub metadata: Vec<(String, String)>,
    /// What is wrong with it.
    pub flaw: Option<Flaw>,
}

/// One way in which a model breaks the contract.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Flaw {
    /// `tactile` is `[N, taxels]`: no window.
    TactileOfRankTwo,
    /// `tactile` is float16.
    TactileOfHalfFloats,
    /// Window and taxels have names for sizes: they are known at run time.
    DynamicFrames,
    /// `pose` has one frame more than `tactile`.
    LongerPose,
    /// `force` is `[N, 2]`.
    TwoForces,
    /// `force` is `[N, 2]`, and the file tells no shape.
    TwoForcesUntold,
    /// The file tells no shape of `force`.
    ForceUntold,
    /// `force_base` is `[N, 1]` in a model of three axes.
    BaseOfOneAxis,
    /// The batch is this number, and nothing else.
    FixedBatch(i64),
    /// A further input that nobody feeds.
    ExtraInput,
    /// A weight of the tactile branch is this number.
    Weight(f32),
    /// A weight lies in another file.
    ExternalWeight,
    /// A weight has half of the bytes that its shape wants.
    CutWeight,
    /// `force = base + residual`.
    ResidualAdded,
    /// `force = 2 * base - residual`, a convention of its own.
    BaseDoubled,
    /// The base output is the residual taken away already.
    BaseMovesWithPose,
    /// The mean of the batch is taken away: a window's force depends on its neighbours.
    MixesBatch,
    /// The force is NaN where the base is above this.
    NanAbove(f32),
    /// The force is NaN where all taxels are zero.
    NanAtZero,
    /// The touch output is the force: no probability.
    TouchOfOdds,
    /// An operator that no runtime knows.
    UnknownOperator,
}

impl LinearModel {
    /// A sound model: gains of 1 and 1, branch outputs, no metadata.
    pub fn new(window: usize, n_taxels: usize, n_joints: usize) -> Self {
        LinearModel {
            window,
            n_taxels,
            n_joints,
            tactile_gain: 1.0,
            pose_gain: 1.0,
            names: ["tactile", "pose", "force", "force_base", "force_residual"].map(String::from),
            branch_outputs: true,
            touch: None,
            axes: None,
            metadata: Vec::new(),
            flaw: None,
        }
    }

    /// With other gains.
    pub fn gains(mut self, tactile_gain: f32, pose_gain: f32) -> Self {
        (self.tactile_gain, self.pose_gain) = (tactile_gain, pose_gain);
        self
    }

    /// With forces of three axes: all in this direction.
    pub fn axes(mut self, direction: [f32; 3]) -> Self {
        self.axes = Some(direction);
        self
    }

    /// With one more entry of `metadata_props`.
    pub fn metadata(mut self, key: &str, value: &str) -> Self {
        self.metadata.push((key.to_string(), value.to_string()));
        self
    }

    /// With this flaw.
    pub fn flaw(mut self, flaw: Flaw) -> Self {
        self.flaw = Some(flaw);
        self
    }

    /// With other names for `tactile`, `pose`, `force`, `force_base`, `force_residual`.
    pub fn names(mut self, names: [&str; 5]) -> Self {
        self.names = names.map(String::from);
        self
    }

    /// With a touch output of this name.
    pub fn touch(mut self, name: &str) -> Self {
        self.touch = Some(name.to_owned());
        self
    }

    /// With the final force as the only output.
    pub fn force_only(mut self) -> Self {
        self.branch_outputs = false;
        self
    }

    /// What a sound model gives for a last frame: force and base.
    pub fn expected(&self, last_taxels: &[f32], last_joints: &[f32]) -> (f32, f32) {
        let base = self.tactile_gain * last_taxels.iter().sum::<f32>();
        (base - self.pose_gain * last_joints.iter().sum::<f32>(), base)
    }

    /// The model as bytes of an ONNX file.
    pub fn bytes(&self) -> Vec<u8> {
        self.proto().encode_to_vec()
    }

    /// Writes the model into `folder` and gives its path.
    pub fn write(&self, folder: &Path, file_name: &str) -> PathBuf {
        let path = folder.join(file_name);
        std::fs::write(&path, self.bytes()).unwrap();
        path
    }

    /// The model as a message: opset 17, IR version 8, operators that both runtimes know.
    pub fn proto(&self) -> ModelProto {
        let mut model = ModelProto::with_graph(self.graph(), 17);
        self.metadata.iter().for_each(|(key, value)| model.push_metadata(key, value));
        model
    }

    fn graph(&self) -> GraphProto {
        let [tactile, pose, force, ..] = &self.names;
        let [base, residual] = match self.axes {
            None => [self.names[3].as_str(), self.names[4].as_str()],
            Some(_) => ["base_along", "residual_along"],
        };
        let flaw = self.flaw;
        let mut weights = vec![TensorProto::int64("last", &[], &[-1]), self.tactile_weight()];
        let mut nodes = Vec::new();
        let mut node = |op: &str, inputs: &[&str], output: &str, attributes: Vec<AttributeProto>| {
            nodes.push(NodeProto::standard(op, inputs, &[output], attributes));
        };

        let mut last_taxels = tactile.as_str();
        if flaw == Some(Flaw::TactileOfHalfFloats) {
            node("Cast", &[tactile], "tactile_f32", vec![AttributeProto::int("to", i64::from(data_type::FLOAT))]);
            last_taxels = "tactile_f32";
        }
        if flaw != Some(Flaw::TactileOfRankTwo) {
            node("Gather", &[last_taxels, "last"], "last_taxels", vec![AttributeProto::int("axis", 1)]);
            last_taxels = "last_taxels";
        }
        node("MatMul", &[last_taxels, "tactile_weight"], "taxel_sum", vec![]);
        if self.n_joints > 0 {
            weights.push(TensorProto::float32(
                "pose_weight",
                &[self.n_joints as i64, 1],
                &vec![self.pose_gain; self.n_joints],
            ));
            node("Gather", &[pose, "last"], "last_joints", vec![AttributeProto::int("axis", 1)]);
            node("MatMul", &["last_joints", "pose_weight"], residual, vec![]);
        } else {
            weights.push(TensorProto::float32("zero", &[], &[0.0]));
            node("Mul", &["taxel_sum", "zero"], residual, vec![]);
        }

        match flaw {
            Some(Flaw::MixesBatch) => {
                let axes = vec![AttributeProto::ints("axes", &[0]), AttributeProto::int("keepdims", 1)];
                node("ReduceMean", &["taxel_sum"], "batch_mean", axes);
                node("Sub", &["taxel_sum", "batch_mean"], base, vec![]);
            }
            Some(Flaw::BaseMovesWithPose) => node("Sub", &["taxel_sum", residual], base, vec![]),
            _ => node("Identity", &["taxel_sum"], base, vec![]),
        }
        let [base, residual] = match self.axes {
            None => [base, residual],
            Some(direction) => {
                weights.push(TensorProto::float32("direction", &[1, 3], &direction));
                let [whole_base, whole_residual] = [self.names[3].as_str(), self.names[4].as_str()];
                match flaw {
                    Some(Flaw::BaseOfOneAxis) => node("Identity", &[base], whole_base, vec![]),
                    _ => node("Mul", &[base, "direction"], whole_base, vec![]),
                }
                node("Mul", &[residual, "direction"], whole_residual, vec![]);
                [whole_base, whole_residual]
            }
        };
        match flaw {
            Some(Flaw::ResidualAdded) => node("Add", &[base, residual], force, vec![]),
            Some(Flaw::BaseDoubled) => {
                node("Add", &[base, base], "twice", vec![]);
                node("Sub", &["twice", residual], force, vec![]);
            }
            Some(Flaw::NanAbove(limit)) => {
                weights.push(TensorProto::float32("limit", &[], &[limit]));
                weights.push(TensorProto::float32("nothing", &[], &[0.0]));
                node("Sub", &[base, residual], "sound_force", vec![]);
                node("Sub", &["limit", base], "room", vec![]);
                node("Sqrt", &["room"], "root", vec![]);
                node("Mul", &["root", "nothing"], "poison", vec![]);
                node("Add", &["sound_force", "poison"], force, vec![]);
            }
            Some(Flaw::NanAtZero) => {
                node("Sub", &[base, residual], "sound_force", vec![]);
                node("Div", &[base, base], "one", vec![]);
                node("Mul", &["sound_force", "one"], force, vec![]);
            }
            Some(Flaw::TwoForces | Flaw::TwoForcesUntold) => {
                node("Sub", &[base, residual], "one_force", vec![]);
                node("Concat", &["one_force", "one_force"], force, vec![AttributeProto::int("axis", 1)]);
            }
            Some(Flaw::UnknownOperator) => node("TurnIntoForce", &[base, residual], force, vec![]),
            _ => node("Sub", &[base, residual], force, vec![]),
        }

        match (&self.touch, flaw) {
            (Some(touch), Some(Flaw::TouchOfOdds)) => node("Identity", &[force], touch, vec![]),
            (Some(touch), _) => node("Sigmoid", &[force], touch, vec![]),
            (None, _) => {}
        }

        let (input, output) = (self.inputs(), self.outputs());
        GraphProto { name: "linear".into(), node: nodes, initializer: weights, input, output, ..Default::default() }
    }

    fn tactile_weight(&self) -> TensorProto {
        let mut values = vec![self.tactile_gain; self.n_taxels];
        if let Some(Flaw::Weight(value)) = self.flaw {
            values[self.n_taxels - 1] = value;
        }
        let mut weight = TensorProto::float32("tactile_weight", &[self.n_taxels as i64, 1], &values);
        match (self.flaw, &mut weight.raw_data) {
            (Some(Flaw::CutWeight), Some(raw)) => raw.truncate(raw.len() / 2),
            (Some(Flaw::ExternalWeight), raw) => {
                *raw = None;
                weight.data_location = EXTERNAL;
            }
            _ => {}
        }
        weight
    }

    fn inputs(&self) -> Vec<ValueInfoProto> {
        let size = |name: &str, size: usize| match self.flaw {
            Some(Flaw::DynamicFrames) => DimensionProto::named(name),
            _ => DimensionProto::fixed(size as i64),
        };
        let (elem_type, mut dims) = match self.flaw {
            Some(Flaw::TactileOfHalfFloats) => (data_type::FLOAT16, vec![self.batch()]),
            _ => (data_type::FLOAT, vec![self.batch()]),
        };
        if self.flaw != Some(Flaw::TactileOfRankTwo) {
            dims.push(size("window", self.window));
        }
        dims.push(size("taxels", self.n_taxels));
        let mut inputs = vec![ValueInfoProto::tensor(&self.names[0], elem_type, dims)];
        if self.n_joints > 0 {
            let frames = self.window + usize::from(self.flaw == Some(Flaw::LongerPose));
            let dims = vec![self.batch(), size("window", frames), size("joints", self.n_joints)];
            inputs.push(ValueInfoProto::float32(&self.names[1], dims));
        }
        if self.flaw == Some(Flaw::ExtraInput) {
            inputs.push(ValueInfoProto::float32("temperature", vec![self.batch(), DimensionProto::fixed(1)]));
        }
        inputs
    }

    fn outputs(&self) -> Vec<ValueInfoProto> {
        let n_outputs = if self.branch_outputs { 3 } else { 1 };
        let width = |idx: usize| match (self.flaw, idx) {
            (Some(Flaw::TwoForces), 0) => 2,
            (Some(Flaw::BaseOfOneAxis), 1) => 1,
            _ => {
                if self.axes.is_some() {
                    3
                } else {
                    1
                }
            }
        };
        let names = self.names[2..].iter().take(n_outputs).enumerate();
        let mut outputs: Vec<ValueInfoProto> = names
            .map(|(idx, name)| ValueInfoProto::float32(name, vec![self.batch(), DimensionProto::fixed(width(idx))]))
            .collect();
        if matches!(self.flaw, Some(Flaw::TwoForcesUntold | Flaw::ForceUntold))
            && let Some(tensor) = outputs[0].r#type.as_mut().and_then(|r#type| r#type.tensor_type.as_mut())
        {
            tensor.shape = None;
        }
        outputs.extend(
            self.touch.iter().map(|name| ValueInfoProto::float32(name, vec![self.batch(), DimensionProto::fixed(1)])),
        );
        outputs
    }

    fn batch(&self) -> DimensionProto {
        match self.flaw {
            Some(Flaw::FixedBatch(n)) => DimensionProto::fixed(n),
            _ => DimensionProto::named("N"),
        }
    }
}
