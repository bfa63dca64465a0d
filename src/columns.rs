//! Writes and reads tables: Parquet files, which DuckDB, Polars and pandas read, and CSV.

mod cells;
mod csv;
mod read;
mod seal;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::basic::{Compression, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

pub use self::cells::{Cells, Kind};
pub use self::csv::CsvFile;
pub use self::read::TableReader;
use crate::files::NewFile;

/// A table that can't be written.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum ColumnsError {
    #[error("{path}: {error}")]
    Io { path: PathBuf, error: std::io::Error },
    #[error("{path}: {error}")]
    Csv { path: PathBuf, error: ::csv::Error },
    #[error("{path}: {error}")]
    Parquet { path: PathBuf, error: ParquetError },
    #[error("{path}: column {column} is {expected:?} and got {got:?} of {rows} rows, expected {n_rows} rows")]
    Cells { path: PathBuf, column: String, expected: Kind, got: Kind, rows: usize, n_rows: usize },
    #[error("{path}: is no whole Parquet file: {reason}")]
    Damaged { path: PathBuf, reason: String },
    #[error("{path}: its columns are {got}, expected {expected}")]
    OtherColumns { path: PathBuf, expected: String, got: String },
}

/// A Parquet file that is being written, one group of rows after another. It gets its name only when it is complete.
pub struct ColumnFile {
    path: PathBuf,
    columns: Vec<(String, Kind)>,
    writer: SerializedFileWriter<File>,
    file: NewFile,
}

impl ColumnFile {
    /// Creates a table with these columns, and with notes about the whole table.
    ///
    /// # Errors
    /// [`ColumnsError`] if the file can't be created in the folder of `path`, or if a name is not valid for a column.
    pub fn create(
        path: &Path,
        columns: &[(&str, Kind)],
        notes: &[(&str, String)],
        overwrite: bool,
    ) -> Result<Self, ColumnsError> {
        let in_file = |error: ParquetError| ColumnsError::Parquet { path: path.to_path_buf(), error };
        let failed = |error: std::io::Error| ColumnsError::Io { path: path.to_path_buf(), error };
        let fields = columns.iter().map(|(name, kind)| kind.field(name).map(Arc::new)).collect::<Result<_, _>>();
        let schema = Type::group_type_builder("table").with_fields(fields.map_err(in_file)?).build();
        let schema = Arc::new(schema.map_err(in_file)?);
        let notes = notes.iter().map(|(key, value)| KeyValue::new((*key).to_owned(), value.clone())).collect();
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_key_value_metadata(Some(notes))
            .build();
        let file = NewFile::create(path, overwrite).map_err(failed)?;
        let handle = file.as_file().try_clone().map_err(failed)?;
        let writer = SerializedFileWriter::new(handle, schema, Arc::new(properties)).map_err(in_file)?;
        let columns = columns.iter().map(|(name, kind)| ((*name).to_owned(), *kind)).collect();
        Ok(ColumnFile { path: path.to_path_buf(), columns, writer, file })
    }

    /// Adds a group of rows, such as a session. Readers can skip a group.
    ///
    /// # Errors
    /// [`ColumnsError`] if cells have the wrong kind or length, or if a write fails.
    pub fn write(&mut self, cells: &[Cells]) -> Result<(), ColumnsError> {
        let ColumnFile { path, columns, writer, .. } = self;
        let in_file = |error: ParquetError| ColumnsError::Parquet { path: path.clone(), error };
        let n_rows = cells.first().map_or(0, Cells::n_rows);
        if n_rows == 0 {
            return Ok(());
        }
        check(path, columns, cells)?;
        let mut group = writer.next_row_group().map_err(in_file)?;
        for cells in cells {
            let Some(mut column) = group.next_column().map_err(in_file)? else { break };
            cells.write(&mut column).map_err(in_file)?;
            column.close().map_err(in_file)?;
        }
        group.close().map(|_| ()).map_err(in_file)
    }

    /// Adds a note about the whole table that is known only at its end.
    pub fn note(&mut self, key: &str, value: String) {
        self.writer.append_key_value_metadata(KeyValue::new(key.to_owned(), value));
    }

    /// Adds a checksum of the table so far, for [`TableReader::open_sealed`]. No rows may follow.
    ///
    /// # Errors
    /// [`ColumnsError`] if a write fails.
    pub fn seal(&mut self) -> Result<(), ColumnsError> {
        let flushed = self.writer.flush();
        flushed.map_err(|error| ColumnsError::Io { path: self.path.clone(), error })?;
        let n_bytes = self.writer.bytes_written() as u64;
        let groups = self.writer.flushed_row_groups().iter();
        let seal = seal::of(self.file.path(), n_bytes, groups);
        let seal = seal.map_err(|error| ColumnsError::Io { path: self.path.clone(), error })?;
        self.note(seal::NOTE, seal);
        Ok(())
    }

    /// Number of bytes that are on the disk.
    pub fn bytes_written(&self) -> usize {
        self.writer.bytes_written()
    }

    /// Completes the table and gives it its name. An existing file is replaced.
    ///
    /// # Errors
    /// [`ColumnsError`] if a write fails. An existing file is then unchanged.
    pub fn finish(self) -> Result<(), ColumnsError> {
        let ColumnFile { path, writer, file, .. } = self;
        let closed = writer.close();
        closed.map_err(|error| ColumnsError::Parquet { path: path.clone(), error })?;
        file.put_in_place().map_err(|error| ColumnsError::Io { path, error })
    }
}

/// Refuses cells whose kind or length differs from the columns of a table.
fn check(path: &Path, columns: &[(String, Kind)], cells: &[Cells]) -> Result<(), ColumnsError> {
    let n_rows = cells.first().map_or(0, Cells::n_rows);
    for ((column, expected), cells) in columns.iter().zip(cells) {
        if cells.kind() != *expected || cells.n_rows() != n_rows {
            let (path, column) = (path.to_path_buf(), column.clone());
            let (expected, got, rows) = (*expected, cells.kind(), cells.n_rows());
            return Err(ColumnsError::Cells { path, column, expected, got, rows, n_rows });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::Field;

    use super::*;
    use crate::units::Stamp;

    #[test]
    fn what_was_written_is_read_back_group_by_group_with_its_nulls() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let columns = [("who", Kind::Text), ("force", Kind::Number), ("n", Kind::Whole), ("at", Kind::Stamp)];
        let mut file = ColumnFile::create(&path, &columns, &[("synthetic", "true".to_owned())], false).unwrap();
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
    fn lists_keep_their_shape_and_no_list_is_not_an_empty_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let columns = [("a/texts", Kind::Texts), ("b.vector", Kind::Vector), ("matrix", Kind::Matrix)];
        let mut file = ColumnFile::create(&path, &columns, &[], false).unwrap();
        let texts = Cells::Texts(vec![Some(vec!["x".to_owned(), "y".to_owned()]), None, Some(Vec::new())]);
        let values = |n: usize| (1..=n).map(|value| value as f32).collect();
        let matrix = Cells::Matrix { n_rows: 2, n_columns: 2, values: values(12) };
        file.write(&[texts, Cells::Vector { len: 2, values: values(6) }, matrix]).unwrap();
        file.finish().unwrap();
        let read = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
        let rows = read.get_row_iter(None).unwrap().map(|row| row.unwrap().to_string());
        assert_eq!(
            rows.collect::<Vec<_>>(),
            [
                "{a/texts: [\"x\", \"y\"], b.vector: [1.0, 2.0], matrix: [[1.0, 2.0], [3.0, 4.0]]}",
                "{a/texts: null, b.vector: [3.0, 4.0], matrix: [[5.0, 6.0], [7.0, 8.0]]}",
                "{a/texts: [], b.vector: [5.0, 6.0], matrix: [[9.0, 10.0], [11.0, 12.0]]}",
            ]
        );
    }

    #[test]
    fn what_is_read_back_as_cells_is_what_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let cells = [
            ("text", Cells::Text(vec![Some("a".to_owned()), None, Some(String::new())])),
            ("number", Cells::Number(vec![None, Some(0.1), Some(f64::NEG_INFINITY)])),
            ("single", Cells::Single(vec![1.5, -0.0, 3.0])),
            ("whole", Cells::Whole(vec![Some(i64::MIN), None, Some(3)])),
            ("flag", Cells::Flag(vec![None, Some(true), Some(false)])),
            ("stamp", Cells::Stamp(vec![Some(Stamp(7)), None, Some(Stamp(-1))])),
            ("texts", Cells::Texts(vec![Some(vec!["x".to_owned(), "y".to_owned()]), None, Some(Vec::new())])),
            ("numbers", Cells::Numbers(vec![Some(Vec::new()), Some(vec![1.0; 3000]), None])),
            ("wholes", Cells::Wholes(vec![None, Some(vec![1]), Some(vec![2, 3])])),
            ("vector", Cells::Vector { len: 2, values: (0..6).map(|value| value as f32).collect() }),
            ("matrix", Cells::Matrix { n_rows: 2, n_columns: 3, values: (0..18).map(|value| value as f32).collect() }),
        ];
        let columns: Vec<(&str, Kind)> = cells.iter().map(|(name, cells)| (*name, cells.kind())).collect();
        let written: Vec<Cells> = cells.iter().map(|(_, cells)| cells.clone()).collect();
        let mut file = ColumnFile::create(&path, &columns, &[], false).unwrap();
        file.write(&written).unwrap();
        file.write(&written).unwrap();
        file.note("late", "yes".to_owned());
        file.seal().unwrap();
        file.finish().unwrap();
        let read = TableReader::open_sealed(&path).unwrap();
        assert_eq!((read.n_groups(), read.note("late"), read.note("none")), (2, Some("yes"), None));
        assert_eq!(read.columns().iter().map(|(name, kind)| (name.as_str(), *kind)).collect::<Vec<_>>(), columns);
        assert_eq!(read.group(1).unwrap(), written);

        let bytes = std::fs::read(&path).unwrap();
        for cut in (0..bytes.len()).step_by(37) {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            let told = TableReader::open(&path).map(|_| ()).unwrap_err().to_string();
            assert!(told.contains("is no whole Parquet file"), "{told}");
        }
        for at in (0..bytes.len()).step_by(5) {
            let mut changed = bytes.clone();
            changed[at] ^= 0x55;
            std::fs::write(&path, &changed).unwrap();
            // Parts that no seal covers, such as notes, don't change the cells.
            if let Ok(read) = TableReader::open_sealed(&path) {
                let groups = (0..read.n_groups()).filter_map(|idx| read.group(idx).ok());
                groups.for_each(|cells| assert_eq!(cells, written, "byte {at}"));
            }
        }
    }

    #[test]
    fn csv_has_the_same_rows_with_what_needs_it_in_quotes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.csv");
        let mut file = CsvFile::create(&path, &[("who, what", Kind::Text), ("n", Kind::Number)], false).unwrap();
        let text = Cells::Text(vec![Some("say \"a\",\nb".to_owned()), None]);
        file.write(&[text, Cells::Number(vec![None, Some(0.1)])]).unwrap();
        assert!(!path.exists(), "not before it is whole");
        file.finish().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "\"who, what\",n\n\"say \"\"a\"\",\nb\",\n,0.1\n");
    }

    #[test]
    fn a_column_of_another_kind_or_length_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let mut file = ColumnFile::create(&path, &[("a", Kind::Number), ("b", Kind::Flag)], &[], false).unwrap();
        let number = || Cells::Number(vec![Some(1.0)]);
        let kind = file.write(&[number(), Cells::Whole(vec![Some(1)])]).unwrap_err().to_string();
        assert!(kind.contains("column b is Flag and got Whole"), "{kind}");
        let length = file.write(&[number(), Cells::Flag(vec![Some(true), None])]).unwrap_err().to_string();
        assert!(length.contains("of 2 rows, expected 1 rows"), "{length}");
        drop(file);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left of it");
    }
}
