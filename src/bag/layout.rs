//! `metadata.yaml`, which makes a folder of MCAP files a rosbag2 bag (layout version 9, as ROS 2 Jazzy writes it).

use std::fmt::Write as _;
use std::io::Read;
use std::path::Path;

use serde::Deserialize;

use super::error::{BagError, one_line};
use super::qos::{self, QosProfile};
use crate::location;

/// Name of the file within a bag folder.
pub(super) const METADATA_FILE: &str = "metadata.yaml";

/// The start that rosbag2 writes for a bag with no message.
const NO_START: i64 = i64::MAX;

/// Real ones stay under 1 MB.
const MAX_METADATA_BYTES: u64 = 16 << 20;

#[derive(Debug, Deserialize)]
struct Document {
    rosbag2_bagfile_information: Listing,
}

/// The part of a bag folder's `metadata.yaml` that is about its files.
#[derive(Debug, Deserialize)]
pub(super) struct Listing {
    #[serde(default)]
    pub(super) storage_identifier: String,
    #[serde(default)]
    pub(super) compression_mode: String,
    #[serde(default)]
    pub(super) compression_format: String,
    #[serde(default)]
    pub(super) relative_file_paths: Vec<String>,
}

impl Listing {
    /// Whether this very file is all that it lists.
    pub(super) fn lists_only(&self, file_name: &str) -> bool {
        self.relative_file_paths == [file_name]
    }
}

/// Read the `metadata.yaml` at `path`.
///
/// # Errors
/// [`BagError::Metadata`] when it is none.
pub(super) fn read(path: &Path) -> Result<Listing, BagError> {
    let metadata = |why: String| BagError::Metadata { path: path.to_path_buf(), why };
    let file = location::open(path).map_err(|error| BagError::io(path, "open", error))?;
    let mut text = Vec::new();
    file.take(MAX_METADATA_BYTES).read_to_end(&mut text).map_err(|error| BagError::io(path, "read", error))?;
    let text = String::from_utf8(text).map_err(|_| metadata("is not UTF-8 text".to_owned()))?;
    let document: Document = serde_saphyr::from_str(&text).map_err(|error| {
        let first = error.to_string().lines().next().map(one_line).unwrap_or_default();
        metadata(format!("is no rosbag2 metadata ({first}): remove it to read the folder's files in order of name"))
    })?;
    Ok(document.rosbag2_bagfile_information)
}

/// One topic as `metadata.yaml` lists it.
#[derive(Debug, Clone, Default)]
pub(super) struct TopicEntry {
    pub(super) name: String,
    pub(super) type_name: String,
    pub(super) serialization_format: String,
    pub(super) offered_qos_profiles: Vec<QosProfile>,
    pub(super) type_hash: String,
    pub(super) n_messages: u64,
}

/// Contents of a bag of one file.
#[derive(Debug, Clone)]
pub(super) struct Contents<'a> {
    pub(super) file_name: &'a str,
    /// First and last log time in ns, where there is a message.
    pub(super) span: Option<(i64, i64)>,
    pub(super) topics: &'a [TopicEntry],
    pub(super) ros_distro: &'a str,
}

impl Contents<'_> {
    /// The text of `metadata.yaml`.
    pub(super) fn document(&self) -> String {
        let body = self.information();
        let mut text = String::from("rosbag2_bagfile_information:\n");
        for line in body.lines() {
            text.push_str("  ");
            text.push_str(line);
            text.push('\n');
        }
        text
    }

    fn information(&self) -> String {
        let n_messages: u64 = self.topics.iter().map(|topic| topic.n_messages).sum();
        let (start, duration) = match self.span {
            Some((first, last)) => (first, last.saturating_sub(first)),
            None => (NO_START, 0),
        };
        let file_name = scalar(self.file_name);
        let mut text = String::new();
        // Writing to a string can't fail.
        let _ = write!(
            text,
            "version: 9\nstorage_identifier: mcap\nduration:\n  nanoseconds: {duration}\nstarting_time:\n  \
             nanoseconds_since_epoch: {start}\nmessage_count: {n_messages}\ntopics_with_message_count:\n"
        );
        if self.topics.is_empty() {
            text.push_str("  []\n");
        }
        for topic in self.topics {
            let _ = write!(
                text,
                "  - topic_metadata:\n      name: {}\n      type: {}\n      serialization_format: {}\n",
                scalar(&topic.name),
                scalar(&topic.type_name),
                scalar(&topic.serialization_format)
            );
            if topic.offered_qos_profiles.is_empty() {
                text.push_str("      offered_qos_profiles: []\n");
            } else {
                text.push_str("      offered_qos_profiles:\n");
                for line in qos::to_yaml(&topic.offered_qos_profiles).lines() {
                    let _ = writeln!(text, "        {line}");
                }
            }
            let _ = write!(
                text,
                "      type_description_hash: {}\n    message_count: {}\n",
                scalar(&topic.type_hash),
                topic.n_messages
            );
        }
        let _ = write!(
            text,
            "compression_format: \"\"\ncompression_mode: \"\"\nrelative_file_paths:\n  - {file_name}\nfiles:\n  - path: \
             {file_name}\n    starting_time:\n      nanoseconds_since_epoch: {start}\n    duration:\n      nanoseconds: \
             {duration}\n    message_count: {n_messages}\ncustom_data: ~\nros_distro: {}\n",
            scalar(self.ros_distro)
        );
        text
    }
}

/// `text` as a YAML scalar that reads back as this very string.
fn scalar(text: &str) -> String {
    let plain_start = text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '/');
    let plain = text.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '/' | '_' | '.' | '-'));
    let keyword = matches!(
        text.to_ascii_lowercase().as_str(),
        "null" | "true" | "false" | "yes" | "no" | "on" | "off" | "y" | "n"
    );
    if plain_start && plain && !keyword {
        text.to_owned()
    } else {
        // JSON's escapes are YAML's, in double quotes.
        serde_json::Value::from(text).to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_yaml_would_read_otherwise_are_quoted() {
        assert_eq!(scalar("/glove/index"), "/glove/index");
        assert_eq!(scalar("1.mcap"), "\"1.mcap\"");
        assert_eq!(scalar("a: b"), "\"a: b\"");
        assert_eq!(scalar("no"), "\"no\"");
        assert_eq!(scalar(""), "\"\"");
    }

    #[test]
    fn what_is_written_reads_back() {
        let topics =
            [TopicEntry { name: "/a".into(), type_name: "std_msgs/msg/Empty".into(), ..TopicEntry::default() }];
        for topics in [&topics[..], &[]] {
            let contents = Contents { file_name: "x y_0.mcap", span: None, topics, ros_distro: "jazzy" };
            let document: Document = serde_saphyr::from_str(&contents.document()).unwrap();
            assert_eq!(document.rosbag2_bagfile_information.relative_file_paths, ["x y_0.mcap"]);
            assert_eq!(document.rosbag2_bagfile_information.storage_identifier, "mcap");
        }
    }
}
