//! Decodes messages with readings of a tactile array.

use super::sequence::SequencePlan;
use super::stamp::StampPlan;
use super::{BindingError, OnlyPlan, SampleError, StampFrom, plan};
use crate::msg::definition::{TypeTree, canonical_type_name};
use crate::msg::dynamic::{FieldPlan, ReadAs, ReadError};
use crate::units::Stamp;

/// Fields of a message with taxels.
#[derive(Debug, Clone, PartialEq)]
pub struct TaxelFields {
    /// Source of the stamp of the last row. `None` if the type has no stamp and the parameters don't name one.
    pub stamp: Option<StampFrom>,
    /// Paths of the readings, row-major, at least one. A sample has the readings of the first path, then those of the
    /// second.
    pub values: Vec<String>,
    /// Value that marks a taxel without a reading. It is read as NaN.
    pub no_reading: Option<f32>,
    /// Number of samples in a message.
    pub rows: CountFrom,
    /// Number of taxels in a sample. `None` derives it from the number of values and rows.
    pub cols: Option<CountFrom>,
    /// Time between the samples of a message.
    pub row_period: PeriodFrom,
    /// Path of a counter that grows by one per message and wraps at the width of its field.
    pub sequence: Option<String>,
    /// `field=value` that selects the messages of this source. Without it, all messages are for this source.
    pub only: Option<String>,
}

/// Source of a count.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CountFrom {
    /// Always one.
    One,
    /// A count from the parameters.
    Constant(usize),
    /// Path of an integer.
    Field(String),
    /// Path of a `std_msgs/MultiArrayLayout`. The count is the size of the first dimension, if there are two whose
    /// product is the number of values, otherwise 1.
    Layout(String),
}

/// Source of the time between the samples of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PeriodFrom {
    /// Not known. A message with several samples is then dropped.
    None,
    /// A time from the parameters, ns.
    Constant(i64),
    /// Path of a `builtin_interfaces/Duration`, or of a number of seconds.
    Field(String),
}

impl TaxelFields {
    /// Fields of a type that we know: `tactile_pose_fusion/msg/TaxelArray` or `std_msgs/msg/Float32MultiArray`.
    ///
    /// The latter has no stamp: `stamp` is `None`, and compiling fails until the caller sets it.
    pub fn for_type(type_name: &str) -> Option<Self> {
        match canonical_type_name(type_name).as_str() {
            "tactile_pose_fusion/msg/TaxelArray" => Some(TaxelFields {
                stamp: Some(StampFrom::Field("header.stamp".to_owned())),
                values: vec!["values".to_owned()],
                no_reading: None,
                rows: CountFrom::Field("rows".to_owned()),
                cols: None,
                row_period: PeriodFrom::Field("row_period".to_owned()),
                sequence: Some("sequence".to_owned()),
                only: None,
            }),
            "std_msgs/msg/Float32MultiArray" => Some(TaxelFields {
                stamp: None,
                values: vec!["data".to_owned()],
                no_reading: None,
                rows: CountFrom::Layout("layout".to_owned()),
                cols: None,
                row_period: PeriodFrom::None,
                sequence: None,
                only: None,
            }),
            _ => None,
        }
    }
}

/// Taxels of one message, borrowed from the binding that decoded it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaxelSamples<'a> {
    /// Stamp of the last row.
    pub stamp: Stamp,
    /// Number of samples, at least 1.
    pub rows: usize,
    /// Time between samples, 0 if there is only one.
    pub row_period_ns: i64,
    /// The sender's counter, if it has one.
    pub sequence: Option<u32>,
    /// `[rows, taxels]`, row-major, with at least one taxel per row.
    pub values: &'a [f32],
}

/// Compiled [`TaxelFields`]. Decodes each message into buffers that are reused.
#[derive(Debug, Clone)]
pub struct TaxelBinding {
    type_name: String,
    only: OnlyPlan,
    stamp: StampPlan,
    values: Vec<FieldPlan>,
    no_reading: Option<f32>,
    rows: CountPlan,
    cols: Option<CountPlan>,
    row_period: PeriodPlan,
    sequence: Option<SequencePlan>,
    readings: Vec<f32>,
    /// If there are several fields: their readings one after another, and the end of each.
    fields: Vec<f32>,
    ends: Vec<usize>,
    sizes: Vec<f64>,
}

impl TaxelBinding {
    /// Compiles the fields against a type.
    ///
    /// # Errors
    /// [`BindingError`], which names the field that is missing or has the wrong type, or the missing stamp.
    pub fn compile(fields: &TaxelFields, tree: &TypeTree) -> Result<Self, BindingError> {
        let sequence = fields.sequence.as_deref().map(|path| SequencePlan::compile(tree, path)).transpose()?;
        let role = if fields.values.len() > 1 { "fields" } else { "values" };
        let values: Result<Vec<FieldPlan>, BindingError> =
            fields.values.iter().map(|path| plan(role, tree, path, ReadAs::Numbers)).collect();
        Ok(TaxelBinding {
            type_name: tree.type_name().to_owned(),
            only: OnlyPlan::compile(fields.only.as_ref(), tree)?,
            stamp: StampPlan::compile(fields.stamp.as_ref(), tree)?,
            values: values?,
            no_reading: fields.no_reading,
            rows: CountPlan::compile("rows", &fields.rows, tree)?,
            cols: fields.cols.as_ref().map(|cols| CountPlan::compile("cols", cols, tree)).transpose()?,
            row_period: PeriodPlan::compile(&fields.row_period, tree)?,
            sequence,
            readings: vec![],
            fields: vec![],
            ends: vec![],
            sizes: vec![],
        })
    }

    /// Decodes a message that was received at `received`.
    ///
    /// # Errors
    /// [`SampleError`] if it has no samples, not the number that it states, or samples of another source.
    pub fn decode(&mut self, cdr: &[u8], received: Stamp) -> Result<TaxelSamples<'_>, SampleError> {
        self.only.admit(cdr)?;
        self.read_fields(cdr)?;
        let n_values = self.fields.len();
        let stamp = self.stamp.read(cdr, received)?;
        let rows = self.rows.read(cdr, n_values, &mut self.sizes)?;
        let type_name = || self.type_name.clone();
        if rows == 0 || n_values == 0 {
            return Err(SampleError::Empty { type_name: type_name(), rows, n_values });
        }
        if let Some(cols) = &self.cols {
            let cols = cols.read(cdr, n_values, &mut self.sizes)?;
            if rows.checked_mul(cols) != Some(n_values as u64) {
                return Err(SampleError::Shape { type_name: type_name(), rows, cols, n_values });
            }
        }
        // Each row has at least one value of each field, so the number of rows can't exceed the number of values.
        let mut begin = 0;
        for end in &self.ends {
            if !((end - begin) as u64).is_multiple_of(rows) {
                return Err(SampleError::Uneven { type_name: type_name(), rows, n_values: end - begin });
            }
            begin = *end;
        }
        let row_period_ns = if rows == 1 { 0 } else { self.row_period.read(cdr)? };
        if rows > 1 && row_period_ns <= 0 {
            return Err(SampleError::RowPeriod { type_name: type_name(), rows, row_period_ns });
        }
        let sequence = self.sequence.as_mut().map(|plan| plan.read(cdr)).transpose()?;
        let rows = rows as usize;
        if rows > 1 && self.ends.len() > 1 {
            self.join_rows(rows);
        } else {
            std::mem::swap(&mut self.fields, &mut self.readings);
        }
        if let Some(none) = self.no_reading {
            self.readings.iter_mut().filter(|reading| **reading == none).for_each(|reading| *reading = f32::NAN);
        }
        Ok(TaxelSamples { stamp, rows, row_period_ns, sequence, values: &self.readings })
    }

    /// Number of times that the device's clock was set or restarted, if stamps come from its own clock.
    pub fn clock_restarts(&self) -> u64 {
        self.stamp.clock_restarts()
    }

    /// Reads all values, field by field.
    fn read_fields(&mut self, cdr: &[u8]) -> Result<(), SampleError> {
        self.fields.clear();
        self.ends.clear();
        for plan in &self.values {
            plan.read_f32(cdr, &mut self.fields)?;
            self.ends.push(self.fields.len());
        }
        Ok(())
    }

    /// Reorders the values by sample: for each sample the readings of the first field, then those of the second.
    fn join_rows(&mut self, rows: usize) {
        self.readings.clear();
        for row in 0..rows {
            let mut begin = 0;
            for end in &self.ends {
                let n = (end - begin) / rows;
                self.readings.extend_from_slice(&self.fields[begin + row * n..begin + (row + 1) * n]);
                begin = *end;
            }
        }
    }
}

/// Compiled [`CountFrom`].
#[derive(Debug, Clone)]
enum CountPlan {
    Constant(u64),
    Field(FieldPlan),
    Layout(FieldPlan),
}

impl CountPlan {
    fn compile(role: &'static str, from: &CountFrom, tree: &TypeTree) -> Result<Self, BindingError> {
        Ok(match from {
            CountFrom::One => CountPlan::Constant(1),
            CountFrom::Constant(0) => {
                return Err(BindingError::Constant { role, expected: "at least 1", got: "0".to_owned() });
            }
            CountFrom::Constant(count) => CountPlan::Constant(*count as u64),
            CountFrom::Field(path) => CountPlan::Field(plan(role, tree, path, ReadAs::Count)?),
            CountFrom::Layout(path) => {
                CountPlan::Layout(plan(role, tree, &format!("{path}.dim[].size"), ReadAs::Numbers)?)
            }
        })
    }

    fn read(&self, cdr: &[u8], n_values: usize, sizes: &mut Vec<f64>) -> Result<u64, ReadError> {
        match self {
            CountPlan::Constant(count) => Ok(*count),
            CountPlan::Field(plan) => plan.read_count(cdr),
            CountPlan::Layout(plan) => {
                sizes.clear();
                plan.read_f64(cdr, sizes)?;
                // Sizes are uint32 and their product is below 2^64. A product large enough for rounding can't be an
                // array's length.
                Ok(match sizes[..] {
                    [rows, cols] if rows * cols == n_values as f64 => rows as u64,
                    _ => 1,
                })
            }
        }
    }
}

/// Compiled [`PeriodFrom`].
#[derive(Debug, Clone)]
enum PeriodPlan {
    Constant(i64),
    Field(FieldPlan),
}

impl PeriodPlan {
    fn compile(from: &PeriodFrom, tree: &TypeTree) -> Result<Self, BindingError> {
        Ok(match from {
            PeriodFrom::None => PeriodPlan::Constant(0),
            PeriodFrom::Constant(nanos) if *nanos <= 0 => {
                let (role, got) = ("row_period", format!("{nanos} ns"));
                return Err(BindingError::Constant { role, expected: "more than 0 ns", got });
            }
            PeriodFrom::Constant(nanos) => PeriodPlan::Constant(*nanos),
            PeriodFrom::Field(path) => PeriodPlan::Field(plan("row_period", tree, path, ReadAs::Period)?),
        })
    }

    fn read(&self, cdr: &[u8]) -> Result<i64, ReadError> {
        match self {
            PeriodPlan::Constant(nanos) => Ok(*nanos),
            PeriodPlan::Field(plan) => plan.read_period(cdr),
        }
    }
}
