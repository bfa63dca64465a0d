//! Messages that hold readings of a tactile array.

use super::sequence::SequencePlan;
use super::stamp::StampPlan;
use super::{BindingError, OnlyPlan, SampleError, StampFrom, plan};
use crate::msg::definition::{TypeTree, canonical_type_name};
use crate::msg::dynamic::{FieldPlan, ReadAs, ReadError};
use crate::units::Stamp;

/// Which fields of a message hold taxels.
#[derive(Debug, Clone, PartialEq)]
pub struct TaxelFields {
    /// Where the stamp of the last row comes from; `None` where the type has none and nobody has said.
    pub stamp: Option<StampFrom>,
    /// Paths of the readings, row-major, at least one. A sample holds the readings of the first, then those of the second.
    pub values: Vec<String>,
    /// A reading that stands for a taxel that does not exist; it is read as NaN.
    pub no_reading: Option<f32>,
    /// How many samples a message holds.
    pub rows: CountFrom,
    /// How many taxels a sample holds; `None` takes what the rows leave.
    pub cols: Option<CountFrom>,
    /// Time between samples of one message.
    pub row_period: PeriodFrom,
    /// Path of a counter, one up a message and wrapping at the width of its field.
    pub sequence: Option<String>,
    /// `field=value` that a message must have to be for this source; all messages are where there is none.
    pub only: Option<String>,
}

/// Where a count comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CountFrom {
    /// There is one.
    One,
    /// The parameters say.
    Constant(usize),
    /// Path of a whole number.
    Field(String),
    /// Path of a `std_msgs/MultiArrayLayout`: the size of the first of two dimensions when they make up the values,
    /// 1 otherwise.
    Layout(String),
}

/// Where the time between samples of one message comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PeriodFrom {
    /// Nothing says, so that a message of several samples is dropped.
    None,
    /// The parameters say, ns.
    Constant(i64),
    /// Path of a `builtin_interfaces/Duration`, or of a number of seconds.
    Field(String),
}

impl TaxelFields {
    /// The fields of a type that is known here: `tactile_pose_fusion/msg/TaxelArray` or
    /// `std_msgs/msg/Float32MultiArray`.
    ///
    /// The latter has no stamp: `stamp` is `None`, and compiling is refused until somebody has set it.
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

/// One message of taxels, borrowed from the binding that decoded it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TaxelMessage<'a> {
    /// Stamp of the last row.
    pub stamp: Stamp,
    /// Number of samples, at least 1.
    pub rows: usize,
    /// Time between samples; 0 where there is one.
    pub row_period_ns: i64,
    /// The sender's counter, where it has one.
    pub sequence: Option<u32>,
    /// `[rows, taxels]`, row-major, at least one a row.
    pub values: &'a [f32],
}

/// Fields of a message type, compiled: decodes one message after another into buffers that it keeps.
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
    /// Readings field by field, and where each field ends in them, where there are several.
    fields: Vec<f32>,
    ends: Vec<usize>,
    sizes: Vec<f64>,
}

impl TaxelBinding {
    /// Compiles the fields against a type.
    ///
    /// # Errors
    /// [`BindingError`] naming the field that is not there or of the wrong kind, or the stamp that is missing.
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

    /// Decodes a message that arrived at `received`.
    ///
    /// # Errors
    /// [`SampleError`] when it holds no samples, not the ones that it says, or those of another source.
    pub fn decode(&mut self, cdr: &[u8], received: Stamp) -> Result<TaxelMessage<'_>, SampleError> {
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
        // Each row holds a value of each field at least, so rows fit where the values do.
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
        Ok(TaxelMessage { stamp, rows, row_period_ns, sequence, values: &self.readings })
    }

    /// How often the device's clock was set or started anew, where stamps are those of its own clock.
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

    /// Puts the values sample by sample: of each the first field, then the second.
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
                // Sizes are uint32 and their product below 2^64; where rounding could matter it is no array's length.
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
