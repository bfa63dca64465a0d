//! Message types on the wire: our own messages, the standard ones that we read and write, and any other type by its
//! definition.

pub mod binding;
pub mod definition;
pub mod dynamic;

mod angles;
mod calibrate;
mod cdr;
mod interfaces;
mod outgoing;
mod schema;
mod standard;
mod texts;
mod type_hash;
mod visual;

use byteorder::{BigEndian, LittleEndian};
use serde::Serialize;
use serde::de::DeserializeOwned;

pub use angles::AngleWatch;
pub use calibrate::{CalibrateFeedback, CalibrateGoal, CalibrateResult};
pub use cdr::CdrError;
pub use definition::canonical_type_name;
pub use interfaces::{ContactArray, ContactState, Stage, TaxelArray};
pub use outgoing::{EstimateTopics, Outgoing, Slot, adaptation_code};
pub use schema::definition_text;
pub use standard::{
    Duration, Float32MultiArray, Float64MultiArray, Header, JointState, MultiArrayDimension, MultiArrayLayout, Point,
    Pose, PoseArray, Quaternion, TFMessage, Text, Time, Transform, TransformStamped, Vector3, Wrench, WrenchStamped,
};
pub use texts::standard_text;
pub use type_hash::{rihs01, type_hash};
pub use visual::{ColorRGBA, CompressedImage, Image, Marker, MarkerArray, MeshFile, UVCoordinate};

/// A message with a struct of its own. Its fields have the order of the `.msg` text.
pub trait WireType: Serialize + DeserializeOwned {
    /// Canonical name of its ROS type, `package/msg/Name`.
    const TYPE_NAME: &'static str;
}

/// Bytes that are not a message of the expected type.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{n_bytes} bytes are not a {type_name}: {reason}")]
pub struct WireError {
    /// The expected type.
    pub type_name: &'static str,
    /// Number of bytes.
    pub n_bytes: usize,
    /// The error.
    pub reason: String,
}

/// Encodes a message in little-endian CDR, with the encapsulation header.
pub fn to_cdr<T: WireType>(message: &T) -> Vec<u8> {
    encode(message)
}

/// Like [`to_cdr`], into a buffer that is cleared first and whose memory is reused.
pub fn to_cdr_into<T: WireType>(message: &T, cdr: &mut Vec<u8>) {
    cdr.clear();
    encode_into(message, cdr);
}

/// Decodes a message in CDR of either byte order. Bytes after its last field count as padding.
///
/// # Errors
/// [`WireError`] if the bytes end early, or are not plain CDR of that type.
pub fn from_cdr<T: WireType>(cdr: &[u8]) -> Result<T, WireError> {
    decode(cdr).map_err(|reason| WireError { type_name: T::TYPE_NAME, n_bytes: cdr.len(), reason })
}

/// Like [`to_cdr`], for parts that are not messages: requests and responses.
pub(crate) fn encode<T: Serialize>(part: &T) -> Vec<u8> {
    let mut cdr = Vec::new();
    encode_into(part, &mut cdr);
    cdr
}

fn encode_into<T: Serialize>(part: &T, cdr: &mut Vec<u8>) {
    cdr.extend_from_slice(&cdr::LITTLE_ENDIAN_HEADER);
    cdr_encoding::to_writer::<T, LittleEndian, _>(cdr, part)
        .expect("the lengths of a wire struct are known, and a Vec takes every byte");
}

/// Like [`from_cdr`], for parts that are not messages. The error describes the bytes.
pub(crate) fn decode<T: DeserializeOwned>(cdr: &[u8]) -> Result<T, String> {
    let reader = cdr::CdrReader::new(cdr).map_err(|fault| fault.to_string())?;
    let decoded = if reader.is_little_endian() {
        cdr_encoding::from_bytes::<T, LittleEndian>(reader.body())
    } else {
        cdr_encoding::from_bytes::<T, BigEndian>(reader.body())
    };
    decoded.map(|(message, _)| message).map_err(|fault| fault.to_string())
}
