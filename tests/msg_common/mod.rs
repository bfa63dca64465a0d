//! What the tests of messages share.
#![allow(dead_code, missing_docs, unreachable_pub, unused_imports)]

use std::path::{Path, PathBuf};

pub use crate::common::skip::shared;
use tactile_pose_fusion::msg::binding::{JointBinding, JointFields, StampFrom, TaxelBinding, TaxelFields};
use tactile_pose_fusion::msg::definition::TypeTree;
use tactile_pose_fusion::msg::dynamic::{FieldPlan, ReadAs, Value, numeric_paths, read_value};
use tactile_pose_fusion::msg::{CdrError, ContactArray, Float32MultiArray, JointState, Stage, TaxelArray, from_cdr};
use tactile_pose_fusion::units::Stamp;

/// Every `.mcap` file below `folder`, in the order of their paths.
pub fn mcap_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = vec![];
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder of data can be listed") {
            let path = entry.expect("an entry can be read").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "mcap") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

/// Appends values as CDR does: each aligned to its own size, counted from the end of the encapsulation header.
pub struct CdrWriter {
    pub cdr: Vec<u8>,
    little_endian: bool,
}

impl CdrWriter {
    pub fn new(little_endian: bool) -> Self {
        CdrWriter { cdr: vec![0, u8::from(little_endian), 0, 0], little_endian }
    }

    pub fn bytes<const N: usize>(mut self, little_endian_bytes: [u8; N]) -> Self {
        while !(self.cdr.len() - 4).is_multiple_of(N) {
            self.cdr.push(0xee); // padding that would show if it were read
        }
        if self.little_endian {
            self.cdr.extend(little_endian_bytes);
        } else {
            self.cdr.extend(little_endian_bytes.iter().rev());
        }
        self
    }

    pub fn u8(self, value: u8) -> Self {
        self.bytes([value])
    }

    pub fn u16(self, value: u16) -> Self {
        self.bytes(value.to_le_bytes())
    }

    pub fn u32(self, value: u32) -> Self {
        self.bytes(value.to_le_bytes())
    }

    pub fn f32(self, value: f32) -> Self {
        self.bytes(value.to_le_bytes())
    }

    pub fn f64(self, value: f64) -> Self {
        self.bytes(value.to_le_bytes())
    }

    pub fn text(self, value: &str) -> Self {
        let mut writer = self.u32(value.len() as u32 + 1);
        writer.cdr.extend(value.as_bytes());
        writer.cdr.push(0);
        writer
    }
}

/// Values in a tree, each of which took a byte of the message at least, or is a message around those that did.
fn leaves(value: &Value<'_>) -> usize {
    match value {
        Value::Array(elements) => elements.iter().map(leaves).sum(),
        Value::Message(fields) => fields.iter().map(|(_, value)| leaves(value)).sum(),
        _ => 1,
    }
}

/// Reads `cdr` in every way there is; the number of values in it.
pub fn read_all_ways(tree: &TypeTree, cdr: &[u8]) -> Result<usize, CdrError> {
    let type_name = tree.type_name();
    let whole = read_value(tree, cdr).map(|(value, left)| (leaves(&value), left));
    if let Ok((n_leaves, left)) = whole {
        assert!(n_leaves + left <= cdr.len());
    }
    let paths = numeric_paths(tree);
    // Each is reached by way of all before it: of thousands a part will do.
    for field in paths.iter().step_by(1 + paths.len() / 128) {
        let plan = FieldPlan::compile(tree, &field.path, ReadAs::Numbers).expect("a listed path compiles");
        let mut numbers = vec![];
        let read = plan.read_f32(cdr, &mut numbers);
        assert!(numbers.capacity() <= 2 * cdr.len() + 8 && read.unwrap_or(0) == numbers.len());
    }
    let received = Stamp(0);
    if let Some(fields) = TaxelFields::for_type(type_name) {
        let stamp = fields.stamp.clone().or(Some(StampFrom::Receipt));
        let mut binding = TaxelBinding::compile(&TaxelFields { stamp, ..fields }, tree).expect("it compiles");
        if let Ok(message) = binding.decode(cdr, received) {
            assert!(message.rows >= 1 && message.values.len() % message.rows == 0);
        }
    }
    if let Some(fields) = JointFields::for_type(type_name) {
        let mut binding = JointBinding::compile(&fields, tree).expect("it compiles");
        if let Ok(message) = binding.decode(cdr, received) {
            assert_eq!(message.names.len(), message.positions.len());
        }
    }
    let _ = from_cdr::<TaxelArray>(cdr);
    let _ = from_cdr::<ContactArray>(cdr);
    let _ = from_cdr::<Stage>(cdr);
    let _ = from_cdr::<JointState>(cdr);
    let _ = from_cdr::<Float32MultiArray>(cdr);
    whole.map(|(n_leaves, _)| n_leaves)
}
