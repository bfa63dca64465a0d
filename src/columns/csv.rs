//! Writes tables as CSV, for spreadsheets.

use std::path::{Path, PathBuf};

use super::{Cells, ColumnsError, Kind, check};
use crate::files::NewFile;

/// A CSV file that is being written. It gets its name only when it is complete. A cell without a value is empty.
pub struct CsvFile {
    path: PathBuf,
    columns: Vec<(String, Kind)>,
    writer: csv::Writer<NewFile>,
}

impl CsvFile {
    /// Creates a table with these columns. Their names are the first line.
    ///
    /// # Errors
    /// [`ColumnsError`] if the file can't be created in the folder of `path`.
    pub fn create(path: &Path, columns: &[(&str, Kind)], overwrite: bool) -> Result<Self, ColumnsError> {
        let file = NewFile::create(path, overwrite);
        let file = file.map_err(|error| ColumnsError::Io { path: path.to_path_buf(), error })?;
        let columns = columns.iter().map(|(name, kind)| ((*name).to_owned(), *kind)).collect();
        let mut table = CsvFile { path: path.to_path_buf(), columns, writer: csv::Writer::from_writer(file) };
        let written = table.writer.write_record(table.columns.iter().map(|(name, _)| name));
        written.map_err(|error| table.failed(error))?;
        Ok(table)
    }

    /// Adds rows.
    ///
    /// # Errors
    /// [`ColumnsError`] if cells have the wrong kind or length, or if a write fails.
    pub fn write(&mut self, cells: &[Cells]) -> Result<(), ColumnsError> {
        check(&self.path, &self.columns, cells)?;
        for row in 0..cells.first().map_or(0, Cells::n_rows) {
            let written = self.writer.write_record(cells.iter().map(|cells| text(cells, row)));
            written.map_err(|error| self.failed(error))?;
        }
        Ok(())
    }

    /// Completes the table and gives it its name. An existing file is replaced.
    ///
    /// # Errors
    /// [`ColumnsError`] if a write fails. An existing file is then unchanged.
    pub fn finish(self) -> Result<(), ColumnsError> {
        let CsvFile { path, mut writer, .. } = self;
        let flushed = writer.flush();
        let inner = writer.into_inner().map_err(|failed| std::io::Error::other(failed.to_string()));
        let written = flushed.and(inner).and_then(NewFile::put_in_place);
        written.map_err(|error| ColumnsError::Io { path, error })
    }

    fn failed(&self, error: csv::Error) -> ColumnsError {
        ColumnsError::Csv { path: self.path.clone(), error }
    }
}

/// Puts an apostrophe before a text that a spreadsheet could read as a formula. Numbers stay unchanged.
fn harmless(text: String) -> String {
    let begins = text.starts_with(['=', '+', '-', '@', '\t', '\r']);
    if begins && text.parse::<f64>().is_err() { format!("'{text}") } else { text }
}

/// A cell as text. A number has as few digits as possible without loss. The elements of a list are separated by spaces.
fn text(cells: &Cells, row: usize) -> String {
    fn shown<T: ToString>(value: Option<T>) -> String {
        value.map_or_else(String::new, |value| value.to_string())
    }
    fn list<T: ToString>(values: &[T]) -> String {
        values.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
    }
    match cells {
        Cells::Text(cells) => harmless(cells[row].clone().unwrap_or_default()),
        Cells::Number(cells) => shown(cells[row]),
        Cells::Single(cells) => shown(Some(cells[row])),
        Cells::Whole(cells) => shown(cells[row]),
        Cells::Flag(cells) => shown(cells[row]),
        Cells::Stamp(cells) => shown(cells[row].map(|stamp| stamp.0)),
        Cells::Texts(cells) => list(cells[row].as_deref().unwrap_or_default()),
        Cells::Numbers(cells) => list(cells[row].as_deref().unwrap_or_default()),
        Cells::Wholes(cells) => list(cells[row].as_deref().unwrap_or_default()),
        Cells::Vector { len, values } => list(&values[row * len..(row + 1) * len]),
        Cells::Matrix { n_rows, n_columns, values } => {
            let len = n_rows * n_columns;
            list(&values[row * len..(row + 1) * len])
        }
    }
}
