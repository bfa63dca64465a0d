//! Messages that hold joint angles.

use super::{BindingError, SampleError, StampFrom, StampPlan, plan};
use crate::msg::definition::{TypeTree, canonical_type_name};
use crate::msg::dynamic::{FieldPlan, ReadAs};
use crate::units::Stamp;

/// Which fields of a message hold joint angles.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JointFields {
    /// Where the stamp comes from; `None` where the type has none and nobody has said.
    pub stamp: Option<StampFrom>,
    /// Path of the angles.
    pub positions: String,
    /// Where the names of the joints come from.
    pub names: NamesFrom,
}

/// Where the names of joints come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NamesFrom {
    /// Path of the names in the message.
    Field(String),
    /// The parameters say, in the order of the angles in the message.
    Constant(Vec<String>),
}

impl JointFields {
    /// The fields of a type that is known here: `sensor_msgs/msg/JointState`.
    pub fn for_type(type_name: &str) -> Option<Self> {
        (canonical_type_name(type_name) == "sensor_msgs/msg/JointState").then(|| JointFields {
            stamp: Some(StampFrom::Field("header.stamp".to_owned())),
            positions: "position".to_owned(),
            names: NamesFrom::Field("name".to_owned()),
        })
    }
}

/// One message of joint angles, borrowed from the binding that decoded it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointMessage<'a> {
    /// Stamp of the angles.
    pub stamp: Stamp,
    /// `[joints]`.
    pub names: &'a [String],
    /// `[joints]`, in the source's own unit.
    pub positions: &'a [f64],
}

/// Fields of a message type, compiled: decodes one message after another into buffers that it keeps.
#[derive(Debug, Clone)]
pub struct JointBinding {
    type_name: String,
    stamp: StampPlan,
    positions: FieldPlan,
    names: Option<FieldPlan>, // None: they are constant
    joint_names: Vec<String>,
    angles: Vec<f64>,
}

impl JointBinding {
    /// Compiles the fields against a type.
    ///
    /// # Errors
    /// [`BindingError`] naming the field that is not there or of the wrong kind, or the stamp that is missing.
    pub fn compile(fields: &JointFields, tree: &TypeTree) -> Result<Self, BindingError> {
        let (names, joint_names) = match &fields.names {
            NamesFrom::Field(path) => (Some(plan("names", tree, path, ReadAs::Texts)?), vec![]),
            NamesFrom::Constant(names) => (None, names.clone()),
        };
        Ok(JointBinding {
            type_name: tree.type_name().to_owned(),
            stamp: StampPlan::compile(fields.stamp.as_ref(), tree)?,
            positions: plan("positions", tree, &fields.positions, ReadAs::Numbers)?,
            names,
            joint_names,
            angles: vec![],
        })
    }

    /// Decodes a message that arrived at `received`.
    ///
    /// # Errors
    /// [`SampleError`] when names and angles are not equally many, or there are none of them.
    pub fn decode(&mut self, cdr: &[u8], received: Stamp) -> Result<JointMessage<'_>, SampleError> {
        self.angles.clear();
        self.positions.read_f64(cdr, &mut self.angles)?;
        if let Some(names) = &self.names {
            names.read_texts(cdr, &mut self.joint_names)?;
        }
        let stamp = self.stamp.read(cdr, received)?;
        let (n_names, n_positions) = (self.joint_names.len(), self.angles.len());
        if n_names != n_positions {
            return Err(SampleError::JointCount { type_name: self.type_name.clone(), n_names, n_positions });
        }
        if n_positions == 0 {
            return Err(SampleError::Empty { type_name: self.type_name.clone(), rows: 1, n_values: 0 });
        }
        Ok(JointMessage { stamp, names: &self.joint_names, positions: &self.angles })
    }
}
