//! Tables as Parquet files, which DuckDB, Polars and pandas read.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::basic::{Compression, ZstdLevel};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedColumnWriter, SerializedFileWriter};
use parquet::schema::parser::parse_message_type;
use tempfile::NamedTempFile;

use crate::files;
use crate::units::Stamp;

/// What a column holds. A cell without a value is null.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Text.
    Text,
    /// A number.
    Number,
    /// A whole number.
    Whole,
    /// Yes or no.
    Flag,
    /// A stamp: nanoseconds since the epoch.
    Stamp,
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
    /// Of [`Kind::Whole`].
    Whole(Vec<Option<i64>>),
    /// Of [`Kind::Flag`].
    Flag(Vec<Option<bool>>),
    /// Of [`Kind::Stamp`].
    Stamp(Vec<Option<Stamp>>),
}

/// A table that can't be written.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum ColumnsError {
    #[error("{path}: {error}")]
    Io { path: PathBuf, error: std::io::Error },
    #[error("{path}: {error}")]
    Parquet { path: PathBuf, error: ParquetError },
    #[error("{path}: column {column} is {expected:?} and got {got:?} of {rows} rows, expected {n_rows} rows")]
    Cells { path: PathBuf, column: String, expected: Kind, got: Kind, rows: usize, n_rows: usize },
}

/// A table on its way to the disk, group of rows by group of rows; under its name only once it is whole.
pub struct ColumnFile {
    path: PathBuf,
    columns: Vec<(String, Kind)>,
    writer: SerializedFileWriter<File>,
    file: NamedTempFile,
}

impl ColumnFile {
    /// A table of these columns, with notes about the whole of it.
    ///
    /// # Errors
    /// [`ColumnsError`] when the file can't be made beside `path`, or a name can't be that of a column.
    pub fn create(path: &Path, columns: &[(&str, Kind)], notes: &[(&str, String)]) -> Result<Self, ColumnsError> {
        let in_file = |error: ParquetError| ColumnsError::Parquet { path: path.to_path_buf(), error };
        let failed = |error: std::io::Error| ColumnsError::Io { path: path.to_path_buf(), error };
        let fields: String = columns.iter().map(|(name, kind)| format!("optional {} ", kind.field(name))).collect();
        let schema = Arc::new(parse_message_type(&format!("message table {{ {fields} }}")).map_err(in_file)?);
        let notes = notes.iter().map(|(key, value)| KeyValue::new((*key).to_owned(), value.clone())).collect();
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_key_value_metadata(Some(notes))
            .build();
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let file = files::temporary_in(folder, ".tpf-").map_err(failed)?;
        let handle = file.as_file().try_clone().map_err(failed)?;
        let writer = SerializedFileWriter::new(handle, schema, Arc::new(properties)).map_err(in_file)?;
        let columns = columns.iter().map(|(name, kind)| ((*name).to_owned(), *kind)).collect();
        Ok(ColumnFile { path: path.to_path_buf(), columns, writer, file })
    }

    /// Adds rows, which readers may take or leave as a whole: a session, for example.
    ///
    /// # Errors
    /// [`ColumnsError`] when columns are of other kinds or lengths than they must be, or the disk refuses.
    pub fn write(&mut self, cells: &[Cells]) -> Result<(), ColumnsError> {
        let ColumnFile { path, columns, writer, .. } = self;
        let in_file = |error: ParquetError| ColumnsError::Parquet { path: path.clone(), error };
        let n_rows = cells.first().map_or(0, Cells::len);
        if n_rows == 0 {
            return Ok(());
        }
        for ((column, expected), cells) in columns.iter().zip(cells) {
            if cells.kind() != *expected || cells.len() != n_rows {
                let (path, column) = (path.clone(), column.clone());
                let (expected, got, rows) = (*expected, cells.kind(), cells.len());
                return Err(ColumnsError::Cells { path, column, expected, got, rows, n_rows });
            }
        }
        let mut group = writer.next_row_group().map_err(in_file)?;
        let mut of_column = cells.iter();
        while let (Some(mut column), Some(cells)) = (group.next_column().map_err(in_file)?, of_column.next()) {
            cells.write(&mut column).map_err(in_file)?;
            column.close().map_err(in_file)?;
        }
        group.close().map(|_| ()).map_err(in_file)
    }

    /// Gives the table its name, in place of what is there.
    ///
    /// # Errors
    /// [`ColumnsError`] when the disk refuses; what was there is then as it was.
    pub fn finish(self) -> Result<(), ColumnsError> {
        let ColumnFile { path, writer, file, .. } = self;
        let closed = writer.close();
        closed.map_err(|error| ColumnsError::Parquet { path: path.clone(), error })?;
        let persisted = file.as_file().sync_all().and_then(|()| file.persist(&path).map_err(|failed| failed.error));
        persisted.map(|_| ()).map_err(|error| ColumnsError::Io { path, error })
    }
}

impl Kind {
    fn field(self, name: &str) -> String {
        match self {
            Kind::Text => format!("binary {name} (UTF8);"),
            Kind::Number => format!("double {name};"),
            Kind::Whole => format!("int64 {name};"),
            Kind::Flag => format!("boolean {name};"),
            Kind::Stamp => format!("int64 {name} (TIMESTAMP(NANOS,true));"),
        }
    }
}

impl Cells {
    /// What it holds.
    pub fn kind(&self) -> Kind {
        match self {
            Cells::Text(_) => Kind::Text,
            Cells::Number(_) => Kind::Number,
            Cells::Whole(_) => Kind::Whole,
            Cells::Flag(_) => Kind::Flag,
            Cells::Stamp(_) => Kind::Stamp,
        }
    }

    fn len(&self) -> usize {
        match self {
            Cells::Text(cells) => cells.len(),
            Cells::Number(cells) => cells.len(),
            Cells::Whole(cells) => cells.len(),
            Cells::Flag(cells) => cells.len(),
            Cells::Stamp(cells) => cells.len(),
        }
    }

    fn write(&self, column: &mut SerializedColumnWriter<'_>) -> Result<usize, ParquetError> {
        match self {
            Cells::Text(cells) => {
                let values: Vec<ByteArray> = cells.iter().flatten().map(|text| text.as_str().into()).collect();
                column.typed::<ByteArrayType>().write_batch(&values, Some(&levels(cells)), None)
            }
            Cells::Number(cells) => {
                let values: Vec<f64> = cells.iter().flatten().copied().collect();
                column.typed::<DoubleType>().write_batch(&values, Some(&levels(cells)), None)
            }
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
        }
    }
}

/// 1 where there is a value, 0 where there is none: Parquet's definition levels.
fn levels<T>(cells: &[Option<T>]) -> Vec<i16> {
    cells.iter().map(|cell| i16::from(cell.is_some())).collect()
}

#[cfg(test)]
mod tests {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::Field;

    use super::*;

    #[test]
    fn what_was_written_is_read_back_group_by_group_with_its_nulls() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let columns = [("who", Kind::Text), ("force", Kind::Number), ("n", Kind::Whole), ("at", Kind::Stamp)];
        let mut file = ColumnFile::create(&path, &columns, &[("synthetic", "true".to_owned())]).unwrap();
        let group = |who: &str, force| {
            let stamp = Cells::Stamp(vec![Some(Stamp(7)), None]);
            let text = Cells::Text(vec![Some(who.to_owned()), None]);
            vec![text, Cells::Number(vec![force, None]), Cells::Whole(vec![Some(1), Some(2)]), stamp]
        };
        file.write(&group("a", Some(0.1))).unwrap();
        file.write(&[]).unwrap();
        file.write(&group("b", None)).unwrap();
        assert!(!path.exists(), "not before it is whole");
        file.finish().unwrap();
        let read = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
        assert_eq!(read.metadata().num_row_groups(), 2);
        let notes = read.metadata().file_metadata().key_value_metadata().unwrap();
        assert!(notes.iter().any(|note| note.key == "synthetic"));
        let rows: Vec<Vec<Field>> = read
            .get_row_iter(None)
            .unwrap()
            .map(|row| row.unwrap().get_column_iter().map(|(_, field)| field.clone()).collect())
            .collect();
        assert_eq!(rows.len(), 4);
        assert_eq!(rows[0][..2], [Field::Str("a".to_owned()), Field::Double(0.1)]);
        assert_eq!(rows[2][..3], [Field::Str("b".to_owned()), Field::Null, Field::Long(1)]);
        assert_eq!(rows[1][3], Field::Null);
    }

    #[test]
    fn a_column_of_another_kind_or_length_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let mut file = ColumnFile::create(&path, &[("a", Kind::Number), ("b", Kind::Flag)], &[]).unwrap();
        let number = || Cells::Number(vec![Some(1.0)]);
        let kind = file.write(&[number(), Cells::Whole(vec![Some(1)])]).unwrap_err().to_string();
        assert!(kind.contains("column b is Flag and got Whole"), "{kind}");
        let length = file.write(&[number(), Cells::Flag(vec![Some(true), None])]).unwrap_err().to_string();
        assert!(length.contains("of 2 rows, expected 1 rows"), "{length}");
        drop(file);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left of it");
    }
}
