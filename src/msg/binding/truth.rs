//! Decodes messages of a force sensor that measures the true force.

use super::stamp::StampPlan;
use super::{BindingError, OnlyPlan, SampleError, StampFrom, plan};
use crate::msg::definition::{TypeTree, canonical_type_name};
use crate::msg::dynamic::{FieldPlan, ReadAs};
use crate::units::Stamp;

/// Where a message holds the true force. Paths lead to one number each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ForceFields {
    /// The normal force, positive under pressure once the sign of the source is applied.
    Normal(String),
    /// x, y and z of the force in the frame of the patch, once the signs of the source are applied.
    Axes([String; 3]),
}

/// The force that a message gives, in the unit and with the signs of the source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ForceReading {
    /// The normal force.
    Normal(f64),
    /// x, y and z.
    Axes([f64; 3]),
}

/// Which fields of a message hold the true force.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TruthFields {
    /// Source of the stamp. `None` if the type has no stamp and the parameters don't name one.
    pub stamp: Option<StampFrom>,
    /// The force.
    pub force: ForceFields,
    /// `field=value` that a message must have to be for this source; all messages are where there is none.
    pub only: Option<String>,
}

impl TruthFields {
    /// Fields of a type that we know: the z axis of `geometry_msgs/msg/WrenchStamped`.
    pub fn for_type(type_name: &str) -> Option<Self> {
        (canonical_type_name(type_name) == "geometry_msgs/msg/WrenchStamped").then(|| TruthFields {
            stamp: Some(StampFrom::Field("header.stamp".to_owned())),
            force: ForceFields::Normal("wrench.force.z".to_owned()),
            only: None,
        })
    }
}

#[derive(Debug, Clone)]
enum ForcePlan {
    Normal(FieldPlan),
    Axes(Box<[FieldPlan; 3]>),
}

/// The fields of a message type, compiled.
#[derive(Debug, Clone)]
pub struct TruthBinding {
    type_name: String,
    only: OnlyPlan,
    stamp: StampPlan,
    force: ForcePlan,
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
            force: match &fields.force {
                ForceFields::Normal(path) => ForcePlan::Normal(plan("field", tree, path, ReadAs::Numbers)?),
                ForceFields::Axes([x, y, z]) => {
                    let axis = |path: &String| plan("fields", tree, path, ReadAs::Numbers);
                    ForcePlan::Axes(Box::new([axis(x)?, axis(y)?, axis(z)?]))
                }
            },
            read: vec![],
        })
    }

    /// Decodes a message that was received at `received`. Returns the stamp of the force, and the force in the source's
    /// unit.
    ///
    /// # Errors
    /// [`SampleError`] when the bytes are not what the definition says, or a field holds another number of values
    /// than one, or the message is for another source.
    pub fn decode(&mut self, cdr: &[u8], received: Stamp) -> Result<(Stamp, ForceReading), SampleError> {
        self.only.admit(cdr)?;
        let Self { type_name, force, read, stamp, .. } = self;
        let mut one = |plan: &FieldPlan| {
            read.clear();
            plan.read_f64(cdr, read)?;
            match read.as_slice() {
                [force] => Ok(*force),
                values => Err(SampleError::NotOneForce { type_name: type_name.clone(), n_values: values.len() }),
            }
        };
        let force = match force {
            ForcePlan::Normal(plan) => ForceReading::Normal(one(plan)?),
            ForcePlan::Axes(plans) => {
                let [x, y, z] = plans.as_ref();
                ForceReading::Axes([one(x)?, one(y)?, one(z)?])
            }
        };
        Ok((stamp.read(cdr, received)?, force))
    }

    /// Number of times that the device's clock was set or restarted, if stamps come from its own clock.
    pub fn clock_restarts(&self) -> u64 {
        self.stamp.clock_restarts()
    }
}
