//! What stands in a column, and how Parquet nests it.

use std::sync::Arc;

use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::writer::SerializedColumnWriter;
use parquet::schema::types::Type;

use crate::units::Stamp;

/// What a column holds. A cell without a value is null.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Text.
    Text,
    /// A number.
    Number,
    /// A number of 32 bits.
    Single,
    /// A whole number.
    Whole,
    /// Yes or no.
    Flag,
    /// A stamp: nanoseconds since the epoch.
    Stamp,
    /// Texts, any number of them.
    Texts,
    /// Numbers, any number of them.
    Numbers,
    /// Whole numbers, any number of them.
    Wholes,
    /// Numbers of 32 bits, as many in every row.
    Vector,
    /// Rows of numbers of 32 bits, of the same shape in every row of the table.
    Matrix,
}

/// The cells of a column.
///
/// # Shapes
/// `[rows]`, the same in all columns of a group.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// Of [`Kind::Text`].
    Text(Vec<Option<String>>),
    /// Of [`Kind::Number`]; what isn't finite is written as it is.
    Number(Vec<Option<f64>>),
    /// Of [`Kind::Single`]: never null, NaN where there is no value.
    Single(Vec<f32>),
    /// Of [`Kind::Whole`].
    Whole(Vec<Option<i64>>),
    /// Of [`Kind::Flag`].
    Flag(Vec<Option<bool>>),
    /// Of [`Kind::Stamp`].
    Stamp(Vec<Option<Stamp>>),
    /// Of [`Kind::Texts`].
    Texts(Vec<Option<Vec<String>>>),
    /// Of [`Kind::Numbers`].
    Numbers(Vec<Option<Vec<f64>>>),
    /// Of [`Kind::Wholes`].
    Wholes(Vec<Option<Vec<i64>>>),
    /// Of [`Kind::Vector`]: never null, NaN where there is no value.
    Vector {
        /// Length of each, at least 1.
        len: usize,
        /// `[rows, len]`, row-major.
        values: Vec<f32>,
    },
    /// Of [`Kind::Matrix`]: never null, NaN where there is no value.
    Matrix {
        /// Rows of each, at least 1.
        n_rows: usize,
        /// Columns of each, at least 1.
        n_columns: usize,
        /// `[rows, n_rows, n_columns]`, row-major.
        values: Vec<f32>,
    },
}

impl Kind {
    /// The column of this kind in the schema of a file.
    pub(super) fn field(self, name: &str) -> Result<Type, ParquetError> {
        match self {
            Kind::Text => text(name, Repetition::OPTIONAL),
            Kind::Number => plain(name, Physical::DOUBLE, Repetition::OPTIONAL),
            Kind::Single => plain(name, Physical::FLOAT, Repetition::OPTIONAL),
            Kind::Whole => plain(name, Physical::INT64, Repetition::OPTIONAL),
            Kind::Flag => plain(name, Physical::BOOLEAN, Repetition::OPTIONAL),
            Kind::Stamp => {
                let stamp = LogicalType::timestamp(true, parquet::basic::TimeUnit::NANOS);
                let field = Type::primitive_type_builder(name, Physical::INT64);
                field.with_repetition(Repetition::OPTIONAL).with_logical_type(Some(stamp)).build()
            }
            Kind::Texts => list(name, Repetition::OPTIONAL, text("element", Repetition::REQUIRED)?),
            Kind::Numbers => list(name, Repetition::OPTIONAL, required(Physical::DOUBLE)?),
            Kind::Wholes => list(name, Repetition::OPTIONAL, required(Physical::INT64)?),
            Kind::Vector => list(name, Repetition::OPTIONAL, required(Physical::FLOAT)?),
            Kind::Matrix => {
                let row = list("element", Repetition::REQUIRED, required(Physical::FLOAT)?)?;
                list(name, Repetition::OPTIONAL, row)
            }
        }
    }
}

fn plain(name: &str, physical: Physical, repetition: Repetition) -> Result<Type, ParquetError> {
    Type::primitive_type_builder(name, physical).with_repetition(repetition).build()
}

fn text(name: &str, repetition: Repetition) -> Result<Type, ParquetError> {
    let field = Type::primitive_type_builder(name, Physical::BYTE_ARRAY).with_repetition(repetition);
    field.with_logical_type(Some(LogicalType::String)).build()
}

fn required(physical: Physical) -> Result<Type, ParquetError> {
    plain("element", physical, Repetition::REQUIRED)
}

/// A list as Parquet's logical types have it: three levels, the middle one repeated.
fn list(name: &str, repetition: Repetition, element: Type) -> Result<Type, ParquetError> {
    let repeated = Type::group_type_builder("list").with_repetition(Repetition::REPEATED);
    let repeated = repeated.with_fields(vec![Arc::new(element)]).build()?;
    let group = Type::group_type_builder(name).with_repetition(repetition);
    group.with_logical_type(Some(LogicalType::List)).with_fields(vec![Arc::new(repeated)]).build()
}

impl Cells {
    /// What it holds.
    pub fn kind(&self) -> Kind {
        match self {
            Cells::Text(_) => Kind::Text,
            Cells::Number(_) => Kind::Number,
            Cells::Single(_) => Kind::Single,
            Cells::Whole(_) => Kind::Whole,
            Cells::Flag(_) => Kind::Flag,
            Cells::Stamp(_) => Kind::Stamp,
            Cells::Texts(_) => Kind::Texts,
            Cells::Numbers(_) => Kind::Numbers,
            Cells::Wholes(_) => Kind::Wholes,
            Cells::Vector { .. } => Kind::Vector,
            Cells::Matrix { .. } => Kind::Matrix,
        }
    }

    /// Rows of the column.
    pub fn n_rows(&self) -> usize {
        match self {
            Cells::Text(cells) => cells.len(),
            Cells::Number(cells) => cells.len(),
            Cells::Single(cells) => cells.len(),
            Cells::Whole(cells) => cells.len(),
            Cells::Flag(cells) => cells.len(),
            Cells::Stamp(cells) => cells.len(),
            Cells::Texts(cells) => cells.len(),
            Cells::Numbers(cells) => cells.len(),
            Cells::Wholes(cells) => cells.len(),
            Cells::Vector { len, values } => values.len() / (*len).max(1),
            Cells::Matrix { n_rows, n_columns, values } => values.len() / (n_rows * n_columns).max(1),
        }
    }

    pub(super) fn write(&self, column: &mut SerializedColumnWriter<'_>) -> Result<usize, ParquetError> {
        match self {
            Cells::Text(cells) => {
                let values: Vec<ByteArray> = cells.iter().flatten().map(|text| text.as_str().into()).collect();
                column.typed::<ByteArrayType>().write_batch(&values, Some(&levels(cells)), None)
            }
            Cells::Number(cells) => {
                let values: Vec<f64> = cells.iter().flatten().copied().collect();
                column.typed::<DoubleType>().write_batch(&values, Some(&levels(cells)), None)
            }
            Cells::Single(cells) => column.typed::<FloatType>().write_batch(cells, Some(&vec![1; cells.len()]), None),
            Cells::Whole(cells) => {
                let values: Vec<i64> = cells.iter().flatten().copied().collect();
                column.typed::<Int64Type>().write_batch(&values, Some(&levels(cells)), None)
            }
            Cells::Flag(cells) => {
                let values: Vec<bool> = cells.iter().flatten().copied().collect();
                column.typed::<BoolType>().write_batch(&values, Some(&levels(cells)), None)
            }
            Cells::Stamp(cells) => {
                let values: Vec<i64> = cells.iter().flatten().map(|stamp| stamp.0).collect();
                column.typed::<Int64Type>().write_batch(&values, Some(&levels(cells)), None)
            }
            Cells::Texts(cells) => write_lists::<ByteArrayType, _>(column, cells, |text| text.as_str().into()),
            Cells::Numbers(cells) => write_lists::<DoubleType, _>(column, cells, |number| *number),
            Cells::Wholes(cells) => write_lists::<Int64Type, _>(column, cells, |whole| *whole),
            Cells::Vector { len, values } => {
                let repetition: Vec<i16> = (0..values.len()).map(|idx| i16::from(idx % len != 0)).collect();
                column.typed::<FloatType>().write_batch(values, Some(&vec![2; values.len()]), Some(&repetition))
            }
            Cells::Matrix { n_rows, n_columns, values } => {
                // 0 begins a cell, 1 a row of it, 2 goes on in that row.
                let level = |idx: usize| match (idx % (n_rows * n_columns), idx % n_columns) {
                    (0, _) => 0,
                    (_, 0) => 1,
                    _ => 2,
                };
                let repetition: Vec<i16> = (0..values.len()).map(level).collect();
                column.typed::<FloatType>().write_batch(values, Some(&vec![3; values.len()]), Some(&repetition))
            }
        }
    }
}

/// 1 where there is a value, 0 where there is none: Parquet's definition levels.
fn levels<T>(cells: &[Option<T>]) -> Vec<i16> {
    cells.iter().map(|cell| i16::from(cell.is_some())).collect()
}

/// Lists of any length: a definition level of 0 is no list, 1 an empty one, 2 an element; a repetition level of 0 begins
/// a list and 1 goes on with it.
fn write_lists<T: DataType, C>(
    column: &mut SerializedColumnWriter<'_>,
    cells: &[Option<Vec<C>>],
    value: impl Fn(&C) -> T::T,
) -> Result<usize, ParquetError> {
    let (mut definition, mut repetition, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for cell in cells {
        let elements = cell.as_deref().unwrap_or_default();
        if elements.is_empty() {
            definition.push(i16::from(cell.is_some()));
            repetition.push(0);
        }
        for (idx, element) in elements.iter().enumerate() {
            definition.push(2);
            repetition.push(i16::from(idx > 0));
            values.push(value(element));
        }
    }
    column.typed::<T>().write_batch(&values, Some(&definition), Some(&repetition))
}
