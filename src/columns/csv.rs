//! Tables as CSV, which spreadsheets read.

use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use super::{Cells, ColumnsError, Kind, check};
use crate::files;

/// A table as CSV on its way to the disk; under its name only once it is whole. A cell without a value is empty.
pub struct CsvFile {
    path: PathBuf,
    columns: Vec<(String, Kind)>,
    writer: csv::Writer<NamedTempFile>,
}

impl CsvFile {
    /// A table of these columns, whose names are its first line.
    ///
    /// # Errors
    /// [`ColumnsError`] when the file can't be made beside `path`.
    pub fn create(path: &Path, columns: &[(&str, Kind)]) -> Result<Self, ColumnsError> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let file = files::temporary_in(folder, ".tpf-");
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
    /// [`ColumnsError`] when columns are of other kinds or lengths than they must be, or the disk refuses.
    pub fn write(&mut self, cells: &[Cells]) -> Result<(), ColumnsError> {
        check(&self.path, &self.columns, cells)?;
        for row in 0..cells.first().map_or(0, Cells::n_rows) {
            let written = self.writer.write_record(cells.iter().map(|cells| text(cells, row)));
            written.map_err(|error| self.failed(error))?;
        }
        Ok(())
    }

    /// Gives the table its name, in place of what is there.
    ///
    /// # Errors
    /// [`ColumnsError`] when the disk refuses; what was there is then as it was.
    pub fn finish(self) -> Result<(), ColumnsError> {
        let CsvFile { path, mut writer, .. } = self;
        let flushed = writer.flush();
        let inner = writer.into_inner().map_err(|failed| std::io::Error::other(failed.to_string()));
        let written = flushed.and(inner).and_then(|file| {
            file.as_file().sync_all()?;
            file.persist(&path).map(|_| ()).map_err(|failed| failed.error)
        });
        written.map_err(|error| ColumnsError::Io { path, error })
    }

    fn failed(&self, error: csv::Error) -> ColumnsError {
        ColumnsError::Csv { path: self.path.clone(), error }
    }
}

/// A text that no spreadsheet takes for a formula: with an apostrophe in front where it begins like one. A number is none.
fn harmless(text: String) -> String {
    let begins = text.starts_with(['=', '+', '-', '@', '\t', '\r']);
    if begins && text.parse::<f64>().is_err() { format!("'{text}") } else { text }
}

/// A cell as text. Numbers are written in as few digits as give them back; a list has spaces between its elements.
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
