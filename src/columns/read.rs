//! Reads tables that [`ColumnFile`](super::ColumnFile) wrote, group by group.

use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use parquet::basic::{ConvertedType, Type as Physical};
use parquet::column::page::PageReader;
use parquet::column::reader::{ColumnReader, get_typed_column_reader};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type};
use parquet::errors::{ParquetError, Result as ParquetResult};
use parquet::file::reader::{FileReader, RowGroupReader, SerializedFileReader};
use parquet::schema::types::Type;

use super::{Cells, ColumnsError, Kind, seal};
use crate::location::{self, LocalFile};
use crate::units::Stamp;

/// Maximum number of values of a column in a group: a list of a week at 100 Hz. The number in the file can't be
/// trusted, because a few bytes can stand for any number of equal values.
const MAX_VALUES: usize = 1 << 26;

/// Rows per read.
const BATCH: usize = 1024;

/// A table to read. Bytes that are not a table give an error and never end the process.
pub struct TableReader {
    path: PathBuf,
    /// Where its bytes are.
    local: LocalFile,
    columns: Vec<(String, Kind)>,
    reader: SerializedFileReader<File>,
}

impl TableReader {
    /// Opens a table.
    ///
    /// # Errors
    /// [`ColumnsError`] if it can't be read, is incomplete, or has columns of a type that [`Kind`] doesn't have.
    pub fn open(path: &Path) -> Result<Self, ColumnsError> {
        let failed = |error| ColumnsError::Io { path: path.to_path_buf(), error };
        let local = location::local_file(path).map_err(failed)?;
        let file = File::open(local.path()).map_err(failed)?;
        let reader = guarded(path, || SerializedFileReader::new(file))?;
        let fields = reader.metadata().file_metadata().schema().get_fields();
        let column = |field: &Type| match kind_of(field) {
            Some(kind) => Ok((field.name().to_owned(), kind)),
            None => Err(damaged(path, format!("column {} is of a kind that is not ours", field.name()))),
        };
        let columns = fields.iter().map(|field| column(field)).collect::<Result<_, _>>()?;
        Ok(TableReader { path: path.to_path_buf(), local, columns, reader })
    }

    /// Opens a table that was sealed with [`ColumnFile::seal`](super::ColumnFile::seal), and checks that it is
    /// unchanged.
    ///
    /// # Errors
    /// [`ColumnsError`] as for [`open`](Self::open), and if it was changed. A table without a seal is opened.
    pub fn open_sealed(path: &Path) -> Result<Self, ColumnsError> {
        let table = Self::open(path)?;
        let Some(noted) = table.note(seal::NOTE) else { return Ok(table) };
        let groups = table.reader.metadata().row_groups().iter();
        let found = seal::n_bytes(noted).map(|n_bytes| seal::of(table.local.path(), n_bytes, groups)).transpose();
        let found = found.map_err(|error| ColumnsError::Io { path: path.to_path_buf(), error })?;
        if found.as_deref() != Some(noted) {
            return Err(damaged(path, "it was changed after it was written".to_owned()));
        }
        Ok(table)
    }

    /// Its columns.
    pub fn columns(&self) -> &[(String, Kind)] {
        &self.columns
    }

    /// Checks that the table has exactly these columns.
    ///
    /// # Errors
    /// [`ColumnsError::OtherColumns`].
    pub fn expect(&self, columns: &[(&str, Kind)]) -> Result<(), ColumnsError> {
        let ours = self.columns.iter().map(|(name, kind)| (name.as_str(), *kind));
        if ours.clone().eq(columns.iter().copied()) {
            return Ok(());
        }
        let names = |of: Vec<(&str, Kind)>| of.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
        let (expected, got) = (names(columns.to_vec()), names(ours.collect()));
        Err(ColumnsError::OtherColumns { path: self.path.clone(), expected, got })
    }

    /// Note about the whole table with this name.
    pub fn note(&self, key: &str) -> Option<&str> {
        let notes = self.reader.metadata().file_metadata().key_value_metadata()?;
        notes.iter().find(|note| note.key == key)?.value.as_deref()
    }

    /// Number of groups of rows, as written.
    pub fn n_groups(&self) -> usize {
        self.reader.num_row_groups()
    }

    /// The cells of a group, column by column.
    ///
    /// # Errors
    /// [`ColumnsError`] if the file is damaged.
    pub fn group(&self, idx: usize) -> Result<Vec<Cells>, ColumnsError> {
        guarded(&self.path, || {
            let group = self.reader.get_row_group(idx)?;
            let n_rows = usize::try_from(group.metadata().num_rows()).unwrap_or(usize::MAX);
            if n_rows > MAX_VALUES {
                return Err(ParquetError::General(format!("a group of {n_rows} rows")));
            }
            let columns = self.columns.iter().enumerate();
            columns.map(|(column, (_, kind))| read(&*group, column, *kind, n_rows)).collect()
        })
    }
}

fn damaged(path: &Path, reason: String) -> ColumnsError {
    ColumnsError::Damaged { path: path.to_path_buf(), reason }
}

/// Turns a panic of the reader into an error. The reader may panic on damaged bytes.
fn guarded<T>(path: &Path, read: impl FnOnce() -> ParquetResult<T>) -> Result<T, ColumnsError> {
    match catch_unwind(AssertUnwindSafe(read)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(damaged(path, error.to_string().lines().next().unwrap_or_default().to_owned())),
        Err(_) => Err(damaged(path, "its pages contradict themselves".to_owned())),
    }
}

/// Kind of a column in a schema.
fn kind_of(field: &Type) -> Option<Kind> {
    let primitive = |field: &Type, of_list: bool| {
        let is_stamp = || field.get_basic_info().logical_type_ref().is_some();
        Some(match (field.get_physical_type(), of_list) {
            (Physical::BYTE_ARRAY, false) => Kind::Text,
            (Physical::DOUBLE, false) => Kind::Number,
            (Physical::FLOAT, false) => Kind::Single,
            (Physical::BOOLEAN, false) => Kind::Flag,
            (Physical::INT64, false) if is_stamp() => Kind::Stamp,
            (Physical::INT64, false) => Kind::Whole,
            (Physical::BYTE_ARRAY, true) => Kind::Texts,
            (Physical::DOUBLE, true) => Kind::Numbers,
            (Physical::INT64, true) => Kind::Wholes,
            (Physical::FLOAT, true) => Kind::Vector,
            _ => return None,
        })
    };
    let element = |list: &Type| match list.get_fields() {
        [repeated] if list.get_basic_info().converted_type() == ConvertedType::LIST && repeated.is_group() => {
            repeated.get_fields().first().cloned()
        }
        _ => None,
    };
    let kind = if field.is_primitive() {
        primitive(field, false)?
    } else {
        let inner = element(field)?;
        if inner.is_primitive() { primitive(&inner, true)? } else { Kind::Matrix }
    };
    (kind.field(field.name()).ok()? == *field).then_some(kind)
}

/// Values that are not null, and the levels that give their positions.
struct Levels<T> {
    values: Vec<T>,
    definition: Vec<i16>,
    repetition: Vec<i16>,
}

fn read(group: &dyn RowGroupReader, column: usize, kind: Kind, n_rows: usize) -> ParquetResult<Cells> {
    let mut pages = group.get_column_page_reader(column)?;
    refuse_too_many(&mut *pages)?;
    let reader = group.get_column_reader(column)?;
    let text =
        |text: ByteArray| Ok(std::str::from_utf8(text.data()).map_err(|_| other("text is not UTF-8"))?.to_owned());
    Ok(match kind {
        Kind::Text => Cells::Text(optional(levels::<ByteArrayType>(reader, n_rows)?, text)?),
        Kind::Number => Cells::Number(optional(levels::<DoubleType>(reader, n_rows)?, Ok)?),
        Kind::Single => Cells::Single(all(levels::<FloatType>(reader, n_rows)?, n_rows, 1)?.1),
        Kind::Whole => Cells::Whole(optional(levels::<Int64Type>(reader, n_rows)?, Ok)?),
        Kind::Flag => Cells::Flag(optional(levels::<BoolType>(reader, n_rows)?, Ok)?),
        Kind::Stamp => Cells::Stamp(optional(levels::<Int64Type>(reader, n_rows)?, |nanos| Ok(Stamp(nanos)))?),
        Kind::Texts => Cells::Texts(lists(levels::<ByteArrayType>(reader, n_rows)?, text)?),
        Kind::Numbers => Cells::Numbers(lists(levels::<DoubleType>(reader, n_rows)?, Ok)?),
        Kind::Wholes => Cells::Wholes(lists(levels::<Int64Type>(reader, n_rows)?, Ok)?),
        Kind::Vector => {
            let (len, values) = all(levels::<FloatType>(reader, n_rows)?, n_rows, 2)?;
            Cells::Vector { len, values }
        }
        Kind::Matrix => {
            let found = levels::<FloatType>(reader, n_rows)?;
            let n_all_rows = found.repetition.iter().filter(|level| **level < 2).count();
            let (len, values) = all(found, n_rows, 3)?;
            let rows_of_each = n_all_rows / n_rows.max(1);
            if rows_of_each == 0 || len % rows_of_each != 0 {
                return Err(other("a matrix whose rows differ in length"));
            }
            Cells::Matrix { n_rows: rows_of_each, n_columns: len / rows_of_each, values }
        }
    })
}

fn other(reason: &str) -> ParquetError {
    ParquetError::General(reason.to_owned())
}

/// Refuses a column whose pages claim more values than a table of ours has. Only the page headers are read.
fn refuse_too_many(pages: &mut dyn PageReader) -> ParquetResult<()> {
    let mut n_values = 0_usize;
    while let Some(page) = pages.peek_next_page()? {
        n_values = n_values.saturating_add(page.num_levels.or(page.num_rows).unwrap_or(0));
        if n_values > MAX_VALUES {
            return Err(other("a column stands for more values than any of ours has"));
        }
        pages.skip_next_page()?;
    }
    Ok(())
}

fn levels<T: DataType>(reader: ColumnReader, n_rows: usize) -> ParquetResult<Levels<T::T>> {
    let mut reader = get_typed_column_reader::<T>(reader);
    let mut found = Levels { values: Vec::new(), definition: Vec::new(), repetition: Vec::new() };
    let mut n_read = 0;
    while n_read < n_rows {
        let (definition, repetition) = (&mut found.definition, &mut found.repetition);
        let wanted = BATCH.min(n_rows - n_read);
        let (n, ..) = reader.read_records(wanted, Some(definition), Some(repetition), &mut found.values)?;
        if n == 0 {
            return Err(ParquetError::General(format!("a column has {n_read} rows, its group {n_rows}")));
        }
        n_read += n;
    }
    Ok(found)
}

/// Cells that may be null.
fn optional<T, C>(levels: Levels<T>, cell: impl Fn(T) -> ParquetResult<C>) -> ParquetResult<Vec<Option<C>>> {
    let mut values = levels.values.into_iter();
    let cells = levels.definition.iter().map(|level| match *level {
        0 => Ok(None),
        _ => cell(values.next().ok_or_else(|| other("fewer values than cells"))?).map(Some),
    });
    cells.collect()
}

/// Cells that are never null and all have the same number of values. Returns this number and the values.
fn all(levels: Levels<f32>, n_rows: usize, whole: i16) -> ParquetResult<(usize, Vec<f32>)> {
    let values = levels.values;
    let begins = levels.repetition.iter().enumerate().filter(|(_, level)| **level == 0).map(|(idx, _)| idx);
    let len = values.len() / n_rows.max(1);
    let is_regular = whole == 1 || begins.eq((0..n_rows).map(|row| row * len));
    if levels.definition.iter().any(|level| *level != whole) || len == 0 || len * n_rows != values.len() || !is_regular
    {
        return Err(other("cells that are null, or of different lengths"));
    }
    Ok((len, values))
}

/// Lists of any length, which may be null.
fn lists<T, C>(levels: Levels<T>, cell: impl Fn(T) -> ParquetResult<C>) -> ParquetResult<Vec<Option<Vec<C>>>> {
    let mut values = levels.values.into_iter();
    let mut cells: Vec<Option<Vec<C>>> = Vec::new();
    for (definition, repetition) in levels.definition.iter().zip(&levels.repetition) {
        if *repetition == 0 {
            cells.push((*definition > 0).then(Vec::new));
        }
        if *definition == 2 {
            let value = cell(values.next().ok_or_else(|| other("fewer values than elements"))?)?;
            let list = cells.last_mut().and_then(Option::as_mut).ok_or_else(|| other("an element of no list"))?;
            list.push(value);
        }
    }
    Ok(cells)
}
