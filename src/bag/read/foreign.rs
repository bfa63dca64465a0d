//! Files that are no bag: what they look like instead.

use std::path::Path;

use mcap::MAGIC;

use super::BagError;
use super::source::Source;
use super::unpacked::SQLITE_MAGIC;
use crate::bag::error::{one_line, quoted};
use crate::bag::layout::METADATA_FILE;

const ROS1_MAGIC: &[u8] = b"#ROSBAG V";

/// The error for a file that doesn't begin as MCAP does: it says what the file looks like.
pub(super) fn not_mcap(path: &Path, source: &mut Source) -> BagError {
    let mut start = Vec::new();
    if let Err(error) = source.seek_to(0).and_then(|()| source.read_up_to(64, &mut start)) {
        return error;
    }
    let is_listing = path.file_name().is_some_and(|name| name == METADATA_FILE);
    let why = if start.is_empty() {
        "it is empty".to_owned()
    } else if is_listing {
        "it describes a bag: give the folder that it lies in".to_owned()
    } else if start.starts_with(ROS1_MAGIC) {
        ros1_advice(path)
    } else if SQLITE_MAGIC.starts_with(&start) {
        format!("it is a sqlite3 (.db3) bag, cut off after {} bytes", start.len())
    } else if MAGIC.starts_with(&start) {
        format!("it is cut off after {} bytes", start.len())
    } else if start.iter().all(|&byte| byte == 0) {
        "it begins with zeros, as files do after a power failure".to_owned()
    } else if is_text(&start) {
        "it looks like text, expected a .mcap or .db3 file".to_owned()
    } else {
        let shown: Vec<String> = start.iter().take(MAGIC.len()).map(|byte| format!("{byte:02x}")).collect();
        format!("it begins with the bytes {}, expected those of MCAP or sqlite3", shown.join(" "))
    };
    not_a_bag(path, why)
}

/// The commands that make an MCAP bag of one of ROS 1, for a shell.
fn ros1_advice(path: &Path) -> String {
    let quoted = |path: &Path| quoted(&one_line(&path.to_string_lossy()));
    format!(
        "it is a ROS 1 bag: `pip install rosbags`, then `rosbags-convert --src {} --dst {} --dst-storage mcap` makes an MCAP bag of it",
        quoted(path),
        quoted(&path.with_extension(""))
    )
}

/// Whether these first bytes of a file are text; the last character may be cut in two.
fn is_text(start: &[u8]) -> bool {
    let valid = match std::str::from_utf8(start) {
        Ok(text) => text,
        Err(error) if error.error_len().is_none() => {
            std::str::from_utf8(&start[..error.valid_up_to()]).unwrap_or_default()
        }
        Err(_) => return false,
    };
    !valid.is_empty() && valid.chars().all(|c| !c.is_control() || c.is_whitespace())
}

pub(super) fn not_a_bag(path: &Path, why: String) -> BagError {
    BagError::NotABag { path: path.to_path_buf(), why }
}
