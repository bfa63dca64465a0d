//! Decodes messages with joint angles.

use super::frames::FrameStore;
use super::hand::{HandFields, HandPlan};
use super::stamp::StampPlan;
use super::{BindingError, OnlyPlan, SampleError, StampFrom, plan};
use crate::msg::definition::{TypeTree, canonical_type_name};
use crate::msg::dynamic::{FieldPlan, ReadAs};
use crate::units::Stamp;

/// Fields of a message with joint angles.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JointFields {
    /// Source of the stamp. `None` if the type has no stamp and the parameters don't name one.
    pub stamp: Option<StampFrom>,
    /// Path of the angles, or of the positions of a hand's keypoints.
    pub positions: String,
    /// Source of the joint names.
    pub names: NamesFrom,
    /// `field=value` that selects the messages of this source. Without it, all messages are for this source.
    pub only: Option<String>,
}

/// Source of the joint names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NamesFrom {
    /// Path of the names in the message.
    Field(String),
    /// Names from the parameters, in the order of the angles in the message.
    Constant(Vec<String>),
    /// The message has keypoints of a hand. The angles are computed from their positions, in rad.
    Hand(Box<HandFields>),
}

impl JointFields {
    /// Fields of a type that we know: `sensor_msgs/msg/JointState`.
    pub fn for_type(type_name: &str) -> Option<Self> {
        (canonical_type_name(type_name) == "sensor_msgs/msg/JointState").then(|| JointFields {
            stamp: Some(StampFrom::Field("header.stamp".to_owned())),
            positions: "position".to_owned(),
            names: NamesFrom::Field("name".to_owned()),
            only: None,
        })
    }
}

/// Joint angles of one message, borrowed from the binding that decoded it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointMessage<'a> {
    /// Stamp of the angles.
    pub stamp: Stamp,
    /// `[joints]`.
    pub names: &'a [String],
    /// `[joints]`, in the source's unit.
    pub positions: &'a [f64],
}

/// Compiled [`JointFields`]. Decodes each message into buffers that are reused.
#[derive(Debug, Clone)]
pub struct JointBinding {
    type_name: String,
    only: OnlyPlan,
    stamp: StampPlan,
    source: AngleSource,
    joint_names: Vec<String>,
    angles: Vec<f64>,
}

/// Compiled source of the angles.
#[derive(Debug, Clone)]
enum AngleSource {
    Sent { positions: Box<FieldPlan>, names: Option<Box<FieldPlan>> }, // names: None if they are constant
    Hand(Box<HandPlan>),
}

impl JointBinding {
    /// Compiles the fields against a type.
    ///
    /// # Errors
    /// [`BindingError`], which names the field that is missing or has the wrong type, or the missing stamp.
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

    /// Decodes a message that was received at `received`.
    ///
    /// # Errors
    /// [`SampleError`] if there are no angles, if their number differs from the number of names, or if the message is
    /// for another source.
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

    /// Number of times that the device's clock was set or restarted, if stamps come from its own clock.
    pub fn clock_restarts(&self) -> u64 {
        self.stamp.clock_restarts()
    }
}
