//! Messages that hold joint angles.

use super::frames::FrameStore;
use super::hand::{HandFields, HandPlan};
use super::stamp::StampPlan;
use super::{BindingError, OnlyPlan, SampleError, StampFrom, plan};
use crate::msg::definition::{TypeTree, canonical_type_name};
use crate::msg::dynamic::{FieldPlan, ReadAs};
use crate::units::Stamp;

/// Which fields of a message hold joint angles.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JointFields {
    /// Where the stamp comes from; `None` where the type has none and nobody has said.
    pub stamp: Option<StampFrom>,
    /// Path of the angles, or of the positions of a hand's points.
    pub positions: String,
    /// Where the names of the joints come from.
    pub names: NamesFrom,
    /// `field=value` that a message must have to be for this source; all messages are where there is none.
    pub only: Option<String>,
}

/// Where the names of joints come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NamesFrom {
    /// Path of the names in the message.
    Field(String),
    /// The parameters say, in the order of the angles in the message.
    Constant(Vec<String>),
    /// The message holds points of a hand, from whose positions the angles are computed, in rad.
    Hand(Box<HandFields>),
}

impl JointFields {
    /// The fields of a type that is known here: `sensor_msgs/msg/JointState`.
    pub fn for_type(type_name: &str) -> Option<Self> {
        (canonical_type_name(type_name) == "sensor_msgs/msg/JointState").then(|| JointFields {
            stamp: Some(StampFrom::Field("header.stamp".to_owned())),
            positions: "position".to_owned(),
            names: NamesFrom::Field("name".to_owned()),
            only: None,
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
    only: OnlyPlan,
    stamp: StampPlan,
    source: AngleSource,
    joint_names: Vec<String>,
    angles: Vec<f64>,
}

/// Where the angles of a message are, compiled.
#[derive(Debug, Clone)]
enum AngleSource {
    Sent { positions: Box<FieldPlan>, names: Option<Box<FieldPlan>> }, // names: None where they are constant
    Hand(Box<HandPlan>),
}

impl JointBinding {
    /// Compiles the fields against a type.
    ///
    /// # Errors
    /// [`BindingError`] naming the field that is not there or of the wrong kind, or the stamp that is missing.
    pub fn compile(fields: &JointFields, tree: &TypeTree) -> Result<Self, BindingError> {
        Self::compile_with(fields, tree, &FrameStore::default())
    }

    /// As [`compile`](Self::compile), where other topics tell frames of this source, too.
    ///
    /// # Errors
    /// As [`compile`](Self::compile).
    pub fn compile_with(fields: &JointFields, tree: &TypeTree, frames: &FrameStore) -> Result<Self, BindingError> {
        let sent = |names| -> Result<AngleSource, BindingError> {
            let positions = Box::new(plan("positions", tree, &fields.positions, ReadAs::Numbers)?);
            Ok(AngleSource::Sent { positions, names })
        };
        let (source, joint_names) = match &fields.names {
            NamesFrom::Field(path) => (sent(Some(Box::new(plan("names", tree, path, ReadAs::Texts)?)))?, vec![]),
            NamesFrom::Constant(names) => (sent(None)?, names.clone()),
            NamesFrom::Hand(hand) => {
                let plan = HandPlan::compile(&fields.positions, hand, tree, frames)?;
                (AngleSource::Hand(Box::new(plan)), hand.joints.clone())
            }
        };
        Ok(JointBinding {
            type_name: tree.type_name().to_owned(),
            only: OnlyPlan::compile(fields.only.as_ref(), tree)?,
            stamp: StampPlan::compile(fields.stamp.as_ref(), tree)?,
            source,
            joint_names,
            angles: vec![],
        })
    }

    /// Decodes a message that arrived at `received`.
    ///
    /// # Errors
    /// [`SampleError`] when names and angles are not equally many, there are none of them, or they are for another source.
    pub fn decode(&mut self, cdr: &[u8], received: Stamp) -> Result<JointMessage<'_>, SampleError> {
        self.only.admit(cdr)?;
        match &mut self.source {
            AngleSource::Hand(hand) => hand.decode(cdr, &mut self.angles)?,
            AngleSource::Sent { positions, names } => {
                self.angles.clear();
                positions.read_f64(cdr, &mut self.angles)?;
                if let Some(names) = names {
                    names.read_texts(cdr, &mut self.joint_names)?;
                }
            }
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

    /// How often the device's clock was set or started anew, where stamps are those of its own clock.
    pub fn clock_restarts(&self) -> u64 {
        self.stamp.clock_restarts()
    }
}
