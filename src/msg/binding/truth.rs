//! Messages of a force sensor that tells the true force.

use super::stamp::StampPlan;
use super::{BindingError, OnlyPlan, SampleError, StampFrom, plan};
use crate::msg::definition::{TypeTree, canonical_type_name};
use crate::msg::dynamic::{FieldPlan, ReadAs};
use crate::units::Stamp;

/// Which field of a message holds the true force.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TruthFields {
    /// Where the stamp comes from; `None` where the type has none and nobody has said.
    pub stamp: Option<StampFrom>,
    /// Path of the force: one number, positive under pressure once the sign of the source is applied.
    pub force: String,
    /// `field=value` that a message must have to be for this source; all messages are where there is none.
    pub only: Option<String>,
}

impl TruthFields {
    /// The fields of a type that is known here: the z axis of `geometry_msgs/msg/WrenchStamped`.
    pub fn for_type(type_name: &str) -> Option<Self> {
        (canonical_type_name(type_name) == "geometry_msgs/msg/WrenchStamped").then(|| TruthFields {
            stamp: Some(StampFrom::Field("header.stamp".to_owned())),
            force: "wrench.force.z".to_owned(),
            only: None,
        })
    }
}

/// The field of a message type, compiled.
#[derive(Debug, Clone)]
pub struct TruthBinding {
    type_name: String,
    only: OnlyPlan,
    stamp: StampPlan,
    force: FieldPlan,
    read: Vec<f64>,
}

impl TruthBinding {
    /// Compiles the field against a type.
    ///
    /// # Errors
    /// [`BindingError`] naming the field that is not there or of the wrong kind, or the stamp that is missing.
    pub fn compile(fields: &TruthFields, tree: &TypeTree) -> Result<Self, BindingError> {
        Ok(TruthBinding {
            type_name: tree.type_name().to_owned(),
            only: OnlyPlan::compile(fields.only.as_ref(), tree)?,
            stamp: StampPlan::compile(fields.stamp.as_ref(), tree)?,
            force: plan("field", tree, &fields.force, ReadAs::Numbers)?,
            read: vec![],
        })
    }

    /// Decodes a message that arrived at `received`: when the force was measured, and the force in the source's unit.
    ///
    /// # Errors
    /// [`SampleError`] when the bytes are not what the definition says, or the field holds another number of values
    /// than one, or the message is for another source.
    pub fn decode(&mut self, cdr: &[u8], received: Stamp) -> Result<(Stamp, f64), SampleError> {
        self.only.admit(cdr)?;
        self.read.clear();
        self.force.read_f64(cdr, &mut self.read)?;
        match self.read.as_slice() {
            [force] => Ok((self.stamp.read(cdr, received)?, *force)),
            values => {
                let (type_name, n_values) = (self.type_name.clone(), values.len());
                Err(SampleError::NotOneForce { type_name, n_values })
            }
        }
    }

    /// How often the device's clock was set or started anew, where stamps are those of its own clock.
    pub fn clock_restarts(&self) -> u64 {
        self.stamp.clock_restarts()
    }
}
