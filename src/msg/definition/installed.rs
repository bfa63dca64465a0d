//! Definitions of message types without a struct here: `.msg` files of installed packages or of a folder.

use std::path::{Path, PathBuf};

use super::{DefinitionError, TypeTree};
use crate::msg::standard_text;

/// Folders to search for `.msg` files.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Definitions {
    folders: Vec<PathBuf>,
}

/// A definition that can't be found or used. Each message is one line.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the texts say it
pub enum LookupError {
    #[error(
        "{type_name}: no {file} in {looked_in}; source the package's setup file (AMENT_PREFIX_PATH), or name a folder with it as message_definitions"
    )]
    NotFound { type_name: String, file: String, looked_in: String },
    #[error("{type_name}: {error}")]
    Definition { type_name: String, error: Box<DefinitionError> },
}

impl Definitions {
    /// Searches a folder first, then the prefixes of `AMENT_PREFIX_PATH`.
    ///
    /// In the folder, a type is searched as `package/msg/Name.msg` and as `Name.msg`.
    pub fn new(folder: Option<&Path>, prefixes: &[PathBuf]) -> Self {
        let shares = prefixes.iter().map(|prefix| prefix.join("share"));
        Definitions { folders: folder.map(Path::to_path_buf).into_iter().chain(shares).collect() }
    }

    /// Like [`new`](Self::new), with the `AMENT_PREFIX_PATH` of this process.
    pub fn of_this_machine(folder: Option<&Path>) -> Self {
        let prefixes = std::env::var_os("AMENT_PREFIX_PATH").filter(|paths| !paths.is_empty());
        let prefixes: Vec<PathBuf> = prefixes.map(|paths| std::env::split_paths(&paths).collect()).unwrap_or_default();
        Self::new(folder, &prefixes)
    }

    /// Definition of a type with all types that it contains.
    ///
    /// # Errors
    /// [`LookupError`], which names the missing file or the error in it.
    pub fn tree(&self, type_name: &str) -> Result<TypeTree, LookupError> {
        let not_found = || LookupError::NotFound {
            type_name: type_name.to_owned(),
            file: format!("{type_name}.msg"),
            looked_in: match self.folders.is_empty() {
                true => "any folder: none is named".to_owned(),
                false => self.folders.iter().map(|folder| folder.display().to_string()).collect::<Vec<_>>().join(", "),
            },
        };
        let text = self.text(type_name).ok_or_else(not_found)?;
        TypeTree::resolve(type_name, &text, &mut |name| self.text(name))
            .map_err(|error| LookupError::Definition { type_name: type_name.to_owned(), error: Box::new(error) })
    }

    /// Schema of a type as in a bag: its text, then the text of each type that it contains.
    ///
    /// # Errors
    /// As [`tree`](Self::tree).
    pub fn schema_text(&self, type_name: &str) -> Result<String, LookupError> {
        let tree = self.tree(type_name)?;
        let mut schema = self.text(type_name).unwrap_or_default();
        for inner in tree.dependencies() {
            let short = inner.type_name.replacen("/msg/", "/", 1);
            let text = self.text(&inner.type_name).unwrap_or_default();
            schema.push_str(&format!("\n{}\nMSG: {short}\n{text}", "=".repeat(80)));
        }
        Ok(schema)
    }

    /// Text of one type. Compiled-in texts come first, because our wire structs match them.
    fn text(&self, type_name: &str) -> Option<String> {
        if let Some(text) = standard_text(type_name) {
            return Some(text.to_owned());
        }
        let mut parts = type_name.split('/');
        let (Some(package), Some("msg"), Some(name), None) = (parts.next(), parts.next(), parts.next(), parts.next())
        else {
            return None;
        };
        let is_word = |word: &str| word.chars().all(|character| character.is_ascii_alphanumeric() || character == '_');
        if !is_word(package) || !is_word(name) {
            return None;
        }
        let file = format!("{name}.msg");
        self.folders.iter().find_map(|folder| {
            let of_package = std::fs::read_to_string(folder.join(package).join("msg").join(&file));
            of_package.or_else(|_| std::fs::read_to_string(folder.join(&file))).ok()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_type_is_found_on_the_prefix_path_with_what_it_is_made_of() {
        let prefix = tempfile::tempdir().unwrap();
        let package = prefix.path().join("share/glove_msgs/msg");
        std::fs::create_dir_all(&package).unwrap();
        std::fs::write(package.join("Raw.msg"), "std_msgs/Header header\nPatch[] patches\n").unwrap();
        std::fs::write(package.join("Patch.msg"), "int16[3] counts\n").unwrap();
        let definitions = Definitions::new(None, &[prefix.path().to_owned()]);
        let tree = definitions.tree("glove_msgs/msg/Raw").unwrap();
        assert!(tree.definition("glove_msgs/msg/Patch").is_some());
        let schema = definitions.schema_text("glove_msgs/msg/Raw").unwrap();
        assert_eq!(TypeTree::from_schema("glove_msgs/msg/Raw", &schema).unwrap(), tree);
    }

    #[test]
    fn a_type_in_a_plain_folder_is_found_too() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("Raw.msg"), "float32[] data\n").unwrap();
        let definitions = Definitions::new(Some(folder.path()), &[]);
        assert_eq!(definitions.tree("glove_msgs/msg/Raw").unwrap().root().fields.len(), 1);
    }

    #[test]
    fn a_type_that_is_nowhere_is_refused_with_where_it_was_looked_for() {
        let error = Definitions::default().tree("glove_msgs/msg/Raw").unwrap_err().to_string();
        assert!(
            error.starts_with("glove_msgs/msg/Raw: no glove_msgs/msg/Raw.msg in any folder: none is named; "),
            "{error}"
        );
        let error = Definitions::new(Some(Path::new("/nowhere")), &[]).tree("a/msg/../../b").unwrap_err().to_string();
        assert!(error.contains("in /nowhere/share; ") || error.contains("in /nowhere; "), "{error}");
    }
}
