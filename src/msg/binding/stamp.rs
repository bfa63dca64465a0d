//! Sources for the stamp of a message.

use super::clock::{DeviceClock, LEAST_SPAN_NS};
use super::{BindingError, plan};
use crate::msg::definition::{Primitive, TypeTree};
use crate::msg::dynamic::{ElementKind, FieldPlan, ReadAs, ReadError};
use crate::units::Stamp;

/// Source of a message's stamp.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StampFrom {
    /// A `builtin_interfaces/Time` field.
    Field(String),
    /// A number field.
    Number {
        /// Path of the number.
        path: String,
        /// Its unit.
        unit: StampUnit,
        /// The time that it counts from.
        since: Since,
    },
    /// A `builtin_interfaces/Time` field that counts from the start of the device.
    SinceBoot(String),
    /// The time when the message was received: `log_time` in a bag. For types without a stamp, and only if the
    /// parameters ask for it.
    Receipt,
}

/// Unit of a stamp that is a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StampUnit {
    /// Seconds.
    Seconds,
    /// Milliseconds.
    Millis,
    /// Microseconds.
    Micros,
    /// Nanoseconds.
    Nanos,
}

/// The time that a device counts from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Since {
    /// 1970, like the clock of the receiver.
    Epoch,
    /// The start of the device. Mapped to the receiver's clock with the times of receipt.
    Boot,
}

impl StampUnit {
    fn nanos(self) -> i64 {
        match self {
            StampUnit::Seconds => 1_000_000_000,
            StampUnit::Millis => 1_000_000,
            StampUnit::Micros => 1_000,
            StampUnit::Nanos => 1,
        }
    }
}

/// Compiled [`StampFrom`].
#[derive(Debug, Clone)]
pub(super) enum StampPlan {
    Field(FieldPlan),
    Number { plan: FieldPlan, unit_ns: i64, clock: Option<Box<DeviceClock>> },
    SinceBoot(FieldPlan, Box<DeviceClock>),
    Receipt,
}

impl StampPlan {
    pub(super) fn compile(from: Option<&StampFrom>, tree: &TypeTree) -> Result<Self, BindingError> {
        match from {
            Some(StampFrom::Field(path)) => time(tree, path).map(StampPlan::Field),
            Some(StampFrom::SinceBoot(path)) => {
                Ok(StampPlan::SinceBoot(time(tree, path)?, Box::new(DeviceClock::new(None))))
            }
            Some(StampFrom::Number { path, unit, since }) => number(tree, path, *unit, *since),
            Some(StampFrom::Receipt) => Ok(StampPlan::Receipt),
            None => Err(BindingError::NoStamp { type_name: tree.type_name().to_owned() }),
        }
    }

    /// Stamp of a message that was received at `received`.
    pub(super) fn read(&mut self, cdr: &[u8], received: Stamp) -> Result<Stamp, ReadError> {
        match self {
            StampPlan::Field(plan) => plan.read_stamp(cdr),
            StampPlan::SinceBoot(plan, clock) => Ok(clock.stamp(plan.read_stamp(cdr)?.0.into(), received)),
            StampPlan::Number { plan, unit_ns, clock } => {
                let nanos = plan.read_nanos(cdr, *unit_ns)?;
                Ok(match clock {
                    Some(clock) => clock.stamp(nanos, received),
                    None => Stamp(nanos.clamp(i64::MIN.into(), i64::MAX.into()) as i64),
                })
            }
            StampPlan::Receipt => Ok(received),
        }
    }

    /// Number of times that the device's clock was set or restarted.
    pub(super) fn clock_restarts(&self) -> u64 {
        match self {
            StampPlan::SinceBoot(_, clock) | StampPlan::Number { clock: Some(clock), .. } => clock.restarts(),
            _ => 0,
        }
    }
}

/// Compiles the path of a time field.
fn time(tree: &TypeTree, path: &str) -> Result<FieldPlan, BindingError> {
    let refused = |error| match plan("stamp", tree, path, ReadAs::Nanos) {
        Ok(number) => stamp_error(tree, &number, "a number: set stamp_unit to s, ms, us or ns, or name another field"),
        Err(_) => error,
    };
    plan("stamp", tree, path, ReadAs::Stamp).map_err(refused)
}

/// Compiles the path of a number field.
fn number(tree: &TypeTree, path: &str, unit: StampUnit, since: Since) -> Result<StampPlan, BindingError> {
    if let Ok(time) = plan("stamp", tree, path, ReadAs::Stamp) {
        return Err(stamp_error(tree, &time, "no number: leave stamp_unit out"));
    }
    let plan = plan("stamp", tree, path, ReadAs::Nanos)?;
    let ElementKind::Number(primitive) = plan.kind().element else {
        return Err(stamp_error(tree, &plan, "no number"));
    };
    let unit_ns = unit.nanos();
    if since == Since::Epoch {
        // 32 bits can hold the seconds since 1970, but not in a finer unit. A float32 holds them only to within two
        // minutes.
        let is_narrow = primitive.size() < 4 || primitive.size() == 4 && unit != StampUnit::Seconds;
        return match is_narrow || primitive == Primitive::Float32 {
            true => Err(stamp_error(tree, &plan, "too small for the time since 1970: is stamp_since boot?")),
            false => Ok(StampPlan::Number { plan, unit_ns, clock: None }),
        };
    }
    let is_float = matches!(primitive, Primitive::Float32 | Primitive::Float64);
    let span_ns = (!is_float && primitive.size() < 8).then(|| i128::from(unit_ns) << (8 * primitive.size()));
    if span_ns.is_some_and(|span| span < LEAST_SPAN_NS) {
        return Err(stamp_error(tree, &plan, "begins at 0 again within 4 s in this unit; write receipt"));
    }
    Ok(StampPlan::Number { plan, unit_ns, clock: Some(Box::new(DeviceClock::new(span_ns))) })
}

fn stamp_error(tree: &TypeTree, plan: &FieldPlan, problem: &'static str) -> BindingError {
    let (path, type_name) = (plan.path().to_owned(), tree.type_name().to_owned());
    BindingError::Stamp { path, type_name, found: plan.kind().to_string(), problem }
}
