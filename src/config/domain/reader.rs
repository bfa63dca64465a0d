//! Typed access to parameters. Missing ones have the defaults of the table.

use std::borrow::Cow;
use std::path::PathBuf;

use super::super::error::ConfigError;
use super::super::keys::find;
use super::super::names::NodeName;
use super::super::param_file::ParamTree;
use super::super::scalar::ParamValue;
use super::super::text::one_line;
use super::folder;
use crate::location;
use crate::msg::dynamic::check_path;

/// Reads a tree with known keys and with values of the right type and range.
pub(super) struct Reader<'a> {
    pub(super) tree: &'a ParamTree,
    pub(super) node: &'a NodeName,
}

impl Reader<'_> {
    /// The value, or the default.
    pub(super) fn value(&self, key: &str) -> Option<ParamValue> {
        match self.tree.get(key) {
            Some(param) => Some(param.value.clone()),
            None => find(key)?.default.value(),
        }
    }

    pub(super) fn is_set(&self, key: &str) -> bool {
        self.tree.get(key).is_some()
    }

    pub(super) fn missing(&self, key: &str) -> ConfigError {
        let about = find(key).map_or("", |known| known.about);
        self.missing_because(key, about)
    }

    pub(super) fn missing_because(&self, key: &str, about: &str) -> ConfigError {
        ConfigError::Missing { files: self.tree.files().to_owned(), key: key.to_owned(), about: about.to_owned() }
    }

    /// Error for the value of a key. If the problem begins with the unit, the message reads `key = 5.0 N must ...`.
    pub(super) fn refused(&self, key: &str, problem: impl Into<String>) -> ConfigError {
        let value = self.value(key).map_or_else(|| "unset".to_owned(), |value| value.to_string());
        let (origin, value) = match self.tree.get(key) {
            Some(param) => (param.origin.to_string(), value),
            None => (self.tree.files().to_owned(), value),
        };
        ConfigError::Refused { origin, key: key.to_owned(), value, problem: problem.into() }
    }

    /// Error for `key` in conflict with `other`. Its location is that of whichever was set.
    pub(super) fn refused_either(&self, key: &str, other: &str, problem: &str) -> ConfigError {
        let mut error = self.refused(key, problem);
        if let (ConfigError::Refused { origin, problem, .. }, None) = (&mut error, self.tree.get(key)) {
            problem.push_str(&format!("; {key} is the default, set it too"));
            if let Some(other) = self.tree.get(other) {
                *origin = other.origin.to_string();
            }
        }
        error
    }

    pub(super) fn bool(&self, key: &str) -> Result<bool, ConfigError> {
        match self.value(key) {
            Some(ParamValue::Bool(value)) => Ok(value),
            _ => Err(self.missing(key)),
        }
    }

    pub(super) fn int(&self, key: &str) -> Result<i64, ConfigError> {
        match self.value(key) {
            Some(ParamValue::Int(value)) => Ok(value),
            _ => Err(self.missing(key)),
        }
    }

    /// A non-negative int. The table limits its range.
    pub(super) fn count(&self, key: &str) -> Result<usize, ConfigError> {
        usize::try_from(self.int(key)?).map_err(|_| self.refused(key, "must not be negative"))
    }

    pub(super) fn double(&self, key: &str) -> Result<f64, ConfigError> {
        match self.value(key) {
            Some(ParamValue::Double(value)) => Ok(value),
            Some(ParamValue::Int(value)) => Ok(value as f64),
            _ => Err(self.missing(key)),
        }
    }

    pub(super) fn all_doubles(&self, key: &str) -> Result<Vec<f64>, ConfigError> {
        match self.value(key) {
            Some(ParamValue::DoubleArray(values)) => Ok(values),
            Some(ParamValue::IntArray(values)) => Ok(values.into_iter().map(|value| value as f64).collect()),
            Some(ParamValue::EmptyArray) => Ok(Vec::new()),
            _ => Err(self.missing(key)),
        }
    }

    pub(super) fn doubles<const LEN: usize>(&self, key: &str) -> Result<[f64; LEN], ConfigError> {
        let values = self.all_doubles(key)?;
        values.try_into().map_err(|_| self.refused(key, format!("must have {LEN} elements")))
    }

    pub(super) fn text(&self, key: &str) -> Result<String, ConfigError> {
        match self.value(key) {
            Some(ParamValue::Str(value)) => Ok(value),
            _ => Err(self.missing(key)),
        }
    }

    pub(super) fn required_text(&self, key: &str) -> Result<String, ConfigError> {
        let text = self.text(key)?;
        if text.trim().is_empty() { Err(self.refused(key, "must not be empty")) } else { Ok(text) }
    }

    pub(super) fn non_empty(&self, key: &str) -> Result<Option<String>, ConfigError> {
        Ok(Some(self.text(key)?).filter(|text| !text.is_empty()))
    }

    pub(super) fn texts(&self, key: &str) -> Result<Vec<String>, ConfigError> {
        match self.value(key) {
            Some(ParamValue::StrArray(values)) => Ok(values),
            Some(ParamValue::EmptyArray) => Ok(Vec::new()),
            _ => Err(self.missing(key)),
        }
    }

    /// Strings that are not empty and all different.
    pub(super) fn unique_texts(&self, key: &str) -> Result<Vec<String>, ConfigError> {
        let texts = self.texts(key)?;
        for (idx, text) in texts.iter().enumerate() {
            if text.is_empty() {
                return Err(self.refused(key, "has an empty element"));
            }
            if texts[..idx].contains(text) {
                return Err(self.refused(key, format!("has \"{}\" twice", one_line(text))));
            }
        }
        Ok(texts)
    }

    /// Names that are used as parts of keys and topics.
    pub(super) fn names(&self, key: &str) -> Result<Vec<String>, ConfigError> {
        let names = self.unique_texts(key)?;
        match names.iter().find(|name| !is_name(name)) {
            Some(name) => Err(self.refused(key, format!("has \"{}\", which {NAME_RULE}", one_line(name)))),
            None => Ok(names),
        }
    }

    pub(super) fn refuse_empty(&self, key: &str, names: &[String]) -> Result<(), ConfigError> {
        if names.is_empty() { Err(self.refused(key, "must name at least one")) } else { Ok(()) }
    }

    /// Absolute name of a topic.
    pub(super) fn topic(&self, key: &str) -> Result<String, ConfigError> {
        let name = self.text(key)?;
        let refused = |reason: &str| self.refused(key, format!("is not a valid topic name: {reason}"));
        self.node.resolve(&name).map_err(|e| refused(e.reason()))
    }

    /// Path of a file, relative to the folder of the parameter file. `None` for an empty path.
    pub(super) fn path(&self, key: &str) -> Result<Option<PathBuf>, ConfigError> {
        // Messages show it, and must show no password of a URI.
        let Some(path) = self.non_empty(key)?.map(|text| PathBuf::from(location::in_word(text.into()))) else {
            return Ok(None);
        };
        if path.to_string_lossy().contains('\0') {
            return Err(self.refused(key, "must not hold a null character"));
        }
        let Some(path) = location::local(&path).map(Cow::into_owned) else { return Ok(Some(path)) };
        Ok(Some(match self.tree.get(key).and_then(|param| folder(&param.origin)) {
            Some(folder) => folder.join(path),
            None => path,
        }))
    }

    /// Path of a folder that must be on this machine, as [`path`](Self::path).
    pub(super) fn path_here(&self, key: &str) -> Result<Option<PathBuf>, ConfigError> {
        let path = self.path(key)?;
        let refused = |path: &PathBuf| location::only_read_here(path).err();
        match path.as_ref().and_then(refused) {
            Some(error) => Err(self.refused(key, error.to_string())),
            None => Ok(path),
        }
    }

    /// Field path in a message: `header.stamp`, `layout.dim[0].size`, `sensors[].z`.
    pub(super) fn field(&self, key: &str) -> Result<String, ConfigError> {
        let path = self.text(key)?;
        match check_path(&path) {
            Ok(()) => Ok(path),
            Err(_) => Err(self.refused(
                key,
                "is not the path of a field, such as header.stamp, layout.dim[0].size or sensors[].taxels[].z",
            )),
        }
    }
}

const NAME_RULE: &str = "must start with a small letter and hold only small letters, digits and '_'";

/// `[a-z][a-z0-9_]*`
fn is_name(name: &str) -> bool {
    name.starts_with(|first: char| first.is_ascii_lowercase())
        && name
            .chars()
            .all(|character| character.is_ascii_lowercase() || character.is_ascii_digit() || character == '_')
}

impl Reader<'_> {
    /// A name that is used as a part of keys.
    pub(super) fn name(&self, key: &str) -> Result<String, ConfigError> {
        let name = self.text(key)?;
        if is_name(&name) { Ok(name) } else { Err(self.refused(key, NAME_RULE)) }
    }
}
