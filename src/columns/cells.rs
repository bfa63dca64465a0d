//! Types and values of columns, and their nesting in Parquet.

use std::sync::Arc;

use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::writer::SerializedColumnWriter;
use parquet::schema::types::Type;

use crate::units::Stamp;

/// Type of a column. A cell without a value is null.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Strings.
    Text,
    /// Floats of 64 bits.
    Number,
    /// Floats of 32 bits.
    Single,
    /// Integers.
    Whole,
    /// Booleans.
    Flag,
    /// Stamps: nanoseconds since the epoch.
    Stamp,
    /// Lists of strings, of any length.
    Texts,
    /// Lists of floats of 64 bits, of any length.
    Numbers,
    /// Lists of integers, of any length.
    Wholes,
    /// Lists of floats of 32 bits, of the same length in every row.
    Vector,
    /// Matrices of floats of 32 bits, of the same shape in every row of the table.
    Matrix,
}

/// The cells of a column.
///
/// # Shapes
/// `[rows]`, the same in all columns of a group.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// Cells of [`Kind::Text`].
    Text(Vec<Option<String>>),
    /// Cells of [`Kind::Number`]. Values that are not finite are written unchanged.
    Number(Vec<Option<f64>>),
    /// Cells of [`Kind::Single`]. They are never null; a missing value is NaN.
    Single(Vec<f32>),
    /// Cells of [`Kind::Whole`].
    Whole(Vec<Option<i64>>),
    /// Cells of [`Kind::Flag`].
    Flag(Vec<Option<bool>>),
    /// Cells of [`Kind::Stamp`].
    Stamp(Vec<Option<Stamp>>),
    /// Cells of [`Kind::Texts`].
    Texts(Vec<Option<Vec<String>>>),
    /// Cells of [`Kind::Numbers`].
    Numbers(Vec<Option<Vec<f64>>>),
    /// Cells of [`Kind::Wholes`].
    Wholes(Vec<Option<Vec<i64>>>),
    /// Cells of [`Kind::Vector`]. They are never null; a missing value is NaN.
    Vector {
        /// Length of each, at least 1.
        len: usize,
        /// `[rows, len]`, row-major.
        values: Vec<f32>,
    },
    /// Cells of [`Kind::Matrix`]. They are never null; a missing value is NaN.
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
    /// Schema of a column of this kind.
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

/// Schema of a list in Parquet's logical types: three levels, of which the middle one is repeated.
fn list(name: &str, repetition: Repetition, element: Type) -> Result<Type, ParquetError> {
    let repeated = Type::group_type_builder("list").with_repetition(Repetition::REPEATED);
    let repeated = repeated.with_fields(vec![Arc::new(element)]).build()?;
    let group = Type::group_type_builder(name).with_repetition(repetition);
    group.with_logical_type(Some(LogicalType::List)).with_fields(vec![Arc::new(repeated)]).build()
}

impl Cells {
    /// Kind of the column.
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

    /// Number of rows.
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
                // 0 begins a cell, 1 begins a row of it, 2 continues that row.
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

/// Parquet's definition levels: 1 for a value, 0 for null.
fn levels<T>(cells: &[Option<T>]) -> Vec<i16> {
    cells.iter().map(|cell| i16::from(cell.is_some())).collect()
}

/// Writes lists of any length. Definition levels: 0 is null, 1 an empty list, 2 an element. Repetition levels: 0 begins
/// a list, 1 continues it.
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
