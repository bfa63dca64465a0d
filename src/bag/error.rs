//! Everything that stops a bag from being read or written, each with what to do about it.

use std::io;
use std::path::{Path, PathBuf};

use crate::units::Stamp;

/// Why a bag could not be read or written.
///
/// Damage inside of a readable file is none of these: it is a [`Loss`](super::Loss), and what can be read is read.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// There is nothing at the path.
    #[error("{}: not found: expected a .mcap or .db3 file or a folder that `ros2 bag record` wrote", .path.display())]
    NotFound {
        /// The path as it was given.
        path: PathBuf,
    },
    /// The operating system refused.
    #[error("{}: can't {action}: {source}", .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The action that failed, as in "can't ...".
        action: &'static str,
        /// The system's word on it.
        source: io::Error,
    },
    /// There is something at the path, but no bag.
    #[error("{}: not a bag: {why}", .path.display())]
    NotABag {
        /// The path as it was given, or a file of the folder.
        path: PathBuf,
        /// The reason: what the path looks like, and what to do.
        why: String,
    },
    /// The `metadata.yaml` of a bag folder doesn't lead to its files.
    #[error("{}: {why}", .path.display())]
    Metadata {
        /// The `metadata.yaml`.
        path: PathBuf,
        /// The reason: what is wrong with it, and what to do.
        why: String,
    },
    /// A folder holds several recordings where one is wanted.
    #[error(
        "{}: holds {} recordings, {}: name the one that is meant, or the files of a split one, each with its folder", .path.display(), .names.len(), list(.names)
    )]
    Several {
        /// The folder.
        path: PathBuf,
        /// Names of the files, in order.
        names: Vec<String>,
    },
    /// The recording is not of ROS 2.
    #[error("{}: has the MCAP profile {profile:?}, expected \"ros2\": convert it with rosbags-convert (pip install rosbags)", .path.display())]
    Profile {
        /// The file.
        path: PathBuf,
        /// The profile that its header names.
        profile: String,
    },
    /// Chunks are packed in a way that can't be unpacked.
    #[error("{}: has chunks with compression {got:?}, expected none, lz4 or zstd: rewrite it with `mcap compress`", .path.display())]
    Compression {
        /// The file.
        path: PathBuf,
        /// The compression that a chunk names.
        got: String,
    },
    /// One file was given twice, which would double every message.
    #[error("{}: given twice: name each recording once", .path.display())]
    DuplicateInput {
        /// The file.
        path: PathBuf,
    },
    /// A topic that is needed was not recorded.
    #[error("topic {topic} is not in the bag; there are: {}{}", list(.there), only_estimates(.there))]
    MissingTopic {
        /// The topic that is needed.
        topic: String,
        /// `topic [type]` of each that is there, in order of name.
        there: Vec<String>,
    },
    /// A topic that is needed is not serialized as ROS 2 does by default.
    #[error(
        "topic {topic} has the message encoding {got:?}, expected \"cdr\": record it with the default serialization format"
    )]
    Encoding {
        /// The topic that is needed.
        topic: String,
        /// The encoding that its channel names.
        got: String,
    },
    /// The output is there already.
    #[error("{}: is there already: remove it, or choose another name", .path.display())]
    Exists {
        /// The output.
        path: PathBuf,
    },
    /// The output is what can't be replaced even where overwriting is allowed.
    #[error("{}: is not a bag and is not replaced: choose another name", .path.display())]
    NotReplaceable {
        /// The output.
        path: PathBuf,
    },
    /// The name of the output is that of another kind of file.
    #[error(
        "{}: a bag is written, to a file NAME.mcap or a folder; tpf export makes tables and datasets of one", .path.display()
    )]
    NotABagName {
        /// The output.
        path: PathBuf,
    },
    /// The output is one of the inputs, or holds one.
    #[error("{}: is also an input, and an input is never changed: choose another output", .path.display())]
    OutputIsInput {
        /// The output.
        path: PathBuf,
    },
    /// The folder that would hold the output is not there.
    #[error("{}: the folder {} is not there: create it first", .path.display(), .parent.display())]
    NoParent {
        /// The output.
        path: PathBuf,
        /// The folder that is missing.
        parent: PathBuf,
    },
    /// The disk, or the user's share of it, is full.
    #[error("{}: the disk is full: nothing is left behind; free some space and run again", .path.display())]
    DiskFull {
        /// The output.
        path: PathBuf,
    },
    /// A time that MCAP can't hold.
    #[error(
        "topic {topic}: a message at {stamp} lies before 1970, and MCAP holds no negative time: correct the clock offset"
    )]
    NegativeTime {
        /// The topic of the message.
        topic: String,
        /// The time that was to be written.
        stamp: Stamp,
    },
    /// The MCAP writer refused, for example more channels than the format can number.
    #[error("{}: can't write: {why}", .path.display())]
    Format {
        /// The output.
        path: PathBuf,
        /// The words of the MCAP writer.
        why: String,
    },
}

impl BagError {
    /// An error of the operating system while `action` was done to `path`; a full disk is told apart.
    pub(super) fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
        let path = path.to_path_buf();
        match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => BagError::DiskFull { path },
            _ => BagError::Io { path, action, source },
        }
    }

    /// An error of the MCAP writer.
    pub(super) fn mcap(path: &Path, error: mcap::McapError) -> Self {
        match error {
            mcap::McapError::Io(source) => Self::io(path, "write", source),
            other => BagError::Format { path: path.to_path_buf(), why: one_line(&other.to_string()) },
        }
    }
}

/// Whether a character steers a terminal, or the direction in which it writes, instead of standing in it.
pub fn steers(character: char) -> bool {
    character.is_control() || matches!(character, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Foreign text on one line, without characters that would steer a terminal.
pub fn printable(text: &str) -> String {
    text.chars().map(|character| if steers(character) { ' ' } else { character }).collect()
}

/// How a path is told in results: as it was given.
pub fn shown(path: &Path) -> String {
    printable(&path.display().to_string())
}

/// An argument as a shell takes it: in single quotes where it has anything but letters, digits and `_-./:=,+@%`.
pub fn quoted(argument: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"_-./:=,+@%".contains(&byte);
    match !argument.is_empty() && argument.bytes().all(is_plain) {
        true => argument.to_owned(),
        false => format!("'{}'", argument.replace('\'', r"'\''")),
    }
}

/// A path as a shell takes it.
pub fn quoted_path(path: &Path) -> String {
    quoted(&path.to_string_lossy())
}

/// `text` on one line, without control characters and not too long, for what others wrote.
pub(super) fn one_line(text: &str) -> String {
    const SHOWN: usize = 200;
    let mut line = String::new();
    for (idx, word) in text.split_whitespace().enumerate() {
        line.extend((idx > 0).then_some(' '));
        for character in word.chars() {
            if character.is_control() { line.extend(character.escape_default()) } else { line.push(character) }
        }
        if let Some((end, _)) = line.char_indices().nth(SHOWN) {
            line.truncate(end);
            return line + "...";
        }
    }
    line
}

/// What to do with a bag of estimates from which the inputs were left out.
fn only_estimates(there: &[String]) -> &'static str {
    let is_estimate = |topic: &String| topic.ends_with("ContactArray]") || topic.ends_with("WrenchStamped]");
    match there.iter().any(|topic| topic.ends_with("ContactArray]")) && there.iter().all(is_estimate) {
        true => "; these are estimates without their inputs: take the bag that was replayed, or replay it with --merge",
        false => "",
    }
}

fn list(there: &[String]) -> String {
    const SHOWN: usize = 60; // a robot's topics; a hostile bag may have 65535
    let more = match there.len().saturating_sub(SHOWN) {
        0 => String::new(),
        n_more => format!(" and {n_more} more"),
    };
    let shown: Vec<String> = there.iter().take(SHOWN).map(|topic| one_line(topic)).collect();
    if there.is_empty() { "none".to_owned() } else { shown.join(", ") + &more }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shell_takes_each_argument_as_it_is() {
        let told = ["a_b-c.d/e:=f", "", "my bag", "user:=o'hara"].map(quoted);
        assert_eq!(told, ["a_b-c.d/e:=f", "''", "'my bag'", r"'user:=o'\''hara'"]);
    }
}
