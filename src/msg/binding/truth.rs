//! Decodes messages of a force sensor that measures the true force.

use super::stamp::StampPlan;
use super::{BindingError, OnlyPlan, SampleError, StampFrom, plan};
use crate::msg::definition::{TypeTree, canonical_type_name};
use crate::msg::dynamic::{FieldPlan, ReadAs};
use crate::units::Stamp;

/// Fields of a message with the true force.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TruthFields {
    /// Source of the stamp. `None` if the type has no stamp and the parameters don't name one.
    pub stamp: Option<StampFrom>,
    /// Path of the force: one number. It is positive under pressure after the sign of the source is applied.
    pub force: String,
    /// `field=value` that selects the messages of this source. Without it, all messages are for this source.
    pub only: Option<String>,
}

impl TruthFields {
    /// Fields of a type that we know: the z axis of `geometry_msgs/msg/WrenchStamped`.
    pub fn for_type(type_name: &str) -> Option<Self> {
        (canonical_type_name(type_name) == "geometry_msgs/msg/WrenchStamped").then(|| TruthFields {
            stamp: Some(StampFrom::Field("header.stamp".to_owned())),
            force: "wrench.force.z".to_owned(),
            only: None,
        })
    }
}

/// Compiled [`TruthFields`].
#[derive(Debug, Clone)]
pub struct TruthBinding {
    type_name: String,
    only: OnlyPlan,
    stamp: StampPlan,
    force: FieldPlan,
    read: Vec<f64>,
}

impl TruthBinding {
    /// Compiles the fields against a type.
    ///
    /// # Errors
    /// [`BindingError`], which names the field that is missing or has the wrong type, or the missing stamp.
    pub fn compile(fields: &TruthFields, tree: &TypeTree) -> Result<Self, BindingError> {
        Ok(TruthBinding {
            type_name: tree.type_name().to_owned(),
            only: OnlyPlan::compile(fields.only.as_ref(), tree)?,
            stamp: StampPlan::compile(fields.stamp.as_ref(), tree)?,
            force: plan("field", tree, &fields.force, ReadAs::Numbers)?,
            read: vec![],
        })
    }

    /// Decodes a message that was received at `received`. Returns the stamp of the force, and the force in the source's
    /// unit.
    ///
    /// # Errors
    /// [`SampleError`] if the bytes don't match the definition, if the field doesn't have exactly one value, or if the
    /// message is for another source.
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

    /// Number of times that the device's clock was set or restarted, if stamps come from its own clock.
    pub fn clock_restarts(&self) -> u64 {
        self.stamp.clock_restarts()
    }
}
