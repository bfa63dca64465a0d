//! The parameter file on the disk.

use std::path::Path;

use super::ask::Ask;
use super::document::{Document, document};
use super::error::InitFileError;
use super::model_file::{self, relative};
use crate::bag::printable;
use crate::config::{Config, DEFAULT_NODE, parse_param_files};
use crate::files;
use crate::inspect::{BagReport, yaml_text};
use crate::location;

/// A parameter file to write.
#[derive(Debug, Clone, Copy)]
pub struct Request<'a> {
    /// The file.
    pub output: &'a Path,
    /// The model to use; without it, the only model beside the file that takes as many taxels.
    pub model: Option<&'a Path>,
    /// Folder with the `.msg` files of types that the bags don't define.
    pub message_definitions: Option<&'a Path>,
    /// Comments for the end of the file, a line each.
    pub remarks: &'a [String],
    /// Whether to replace a file that is already there.
    pub overwrite: bool,
}

impl<'a> Request<'a> {
    /// A new file, for no model in particular.
    pub fn new(output: &'a Path) -> Self {
        Request { output, model: None, message_definitions: None, remarks: &[], overwrite: false }
    }

    /// Checks that nothing is in the way of the file: before bags are read, not after.
    ///
    /// # Errors
    /// [`InitFileError::Exists`], and [`InitFileError::Path`] where a URI can't be used.
    pub fn check(&self) -> Result<(), InitFileError> {
        let path = || self.output.to_path_buf();
        if let Some(folder) = self.message_definitions {
            let refuse = |error: std::io::Error| InitFileError::Path { path: folder.into(), reason: error.to_string() };
            location::only_folder_here(folder).map_err(refuse)?;
        }
        match location::check_output(self.output, self.overwrite) {
            Ok(_) => Ok(()),
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {
                Err(InitFileError::Exists { path: path() })
            }
            Err(error) => Err(InitFileError::Path { path: path(), reason: format!("cannot write: {error}") }),
        }
    }

    fn folder(&self) -> &'a Path {
        self.output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
    }
}

/// A parameter file that was written.
#[derive(Debug, Clone)]
pub struct Written {
    /// Its contents.
    pub document: Document,
    /// Whether it names a model.
    pub has_model: bool,
    /// Guesses, and notes for a person, a line each.
    pub notes: Vec<String>,
}

/// Writes the parameter file for what is in `bags`. It loads: this is checked before it is written.
///
/// # Errors
/// [`InitFileError`]; nothing is written then.
pub fn write(bags: &[BagReport], request: &Request<'_>, ask: &mut dyn Ask) -> Result<Written, InitFileError> {
    request.check()?;
    let folder = request.folder();
    let mut notes = Vec::new();
    let model = model_file::of(request.model, folder, bags, &mut notes)?;
    let mut made = document(bags, model.as_ref(), ask)?;
    if let Some(definitions) = request.message_definitions {
        let path = relative(definitions, folder)?;
        made.text += &format!("\n    message_definitions: {}\n", yaml_text(&path));
    }
    if !request.remarks.is_empty() {
        made.text += "\n";
        request.remarks.iter().for_each(|line| made.text += &format!("# {line}\n"));
    }
    refuse_what_would_not_load(&made, request.output)?;
    notes.extend(made.guesses.iter().map(|guess| format!("guessed: {}", printable(guess))));
    put(request, made.text.as_bytes())?;
    Ok(Written { document: made, has_model: model.is_some(), notes })
}

fn refuse_what_would_not_load(made: &Document, output: &Path) -> Result<(), InitFileError> {
    let label = output.to_string_lossy();
    let refuse = |error: String| InitFileError::DoesNotLoad { reason: error };
    let tree = parse_param_files(&[(made.text.as_str(), label.as_ref())], DEFAULT_NODE);
    let tree = tree.map_err(|error| refuse(error.to_string()))?;
    Config::from_tree(&tree).map_err(|error| refuse(error.to_string()))?;
    Ok(())
}

fn put(request: &Request<'_>, text: &[u8]) -> Result<(), InitFileError> {
    let path = request.output;
    let cannot = |error: std::io::Error| InitFileError::Path {
        path: path.to_path_buf(),
        reason: format!("cannot write: {error}"),
    };
    files::write(path, text, request.overwrite).map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => InitFileError::Exists { path: path.to_path_buf() },
        _ => cannot(error),
    })
}
