//! Messages as their bytes on the wire, so that live node, replay and recordings read and write the same.

use std::any::type_name;
use std::fmt;

use byteorder::{BigEndian, LittleEndian};
use cdr_encoding::CdrDeserializer;
use serde::de::{DeserializeSeed, Deserializer, Error as _, SeqAccess, Visitor};
use serde::ser::{SerializeTuple, Serializer};

/// A message in CDR, after its encapsulation header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct CdrBytes(pub(super) Vec<u8>);

/// Bytes of the encapsulation header.
const HEADER: usize = 4;

/// Maximum number of bytes read from one message; DDS itself can't carry more.
const MAX_BYTES: usize = 1 << 31;

impl serde::Serialize for CdrBytes {
    /// Writes the bytes after the header; the middleware writes its own header, little-endian.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let body = self.0.get(HEADER..).unwrap_or_default();
        let mut tuple = serializer.serialize_tuple(body.len())?;
        for byte in body {
            tuple.serialize_element(byte)?;
        }
        tuple.end()
    }
}

/// Reads a message of any type as received.
#[derive(Debug, Clone, Copy)]
pub(super) struct AsCdr;

impl<'de> DeserializeSeed<'de> for AsCdr {
    type Value = CdrBytes;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<CdrBytes, D::Error> {
        // The middleware has removed the header and gives the byte order only by the type of its deserializer.
        let given = type_name::<D>();
        let second = if given == type_name::<&mut CdrDeserializer<'_, LittleEndian>>() {
            1
        } else if given == type_name::<&mut CdrDeserializer<'_, BigEndian>>() {
            0
        } else {
            return Err(D::Error::custom(format!("byte order unknown: read by {given}")));
        };
        deserializer.deserialize_tuple(MAX_BYTES, Bytes(vec![0, second, 0, 0]))
    }
}

/// Reads bytes until the end.
struct Bytes(Vec<u8>);

impl<'de> Visitor<'de> for Bytes {
    type Value = CdrBytes;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("bytes")
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut sequence: A) -> Result<CdrBytes, A::Error> {
        // Every byte is a u8, so the only error is the end.
        while let Ok(Some(byte)) = sequence.next_element() {
            self.0.push(byte);
        }
        Ok(CdrBytes(self.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::{Header, JointState, Time, to_cdr};

    #[test]
    fn a_message_goes_through_as_it_is() {
        let message = JointState {
            header: Header { stamp: Time { sec: 5, nanosec: 7 }, frame_id: "a".into() },
            name: vec!["dip".into()],
            position: vec![0.25],
            ..JointState::default()
        };
        let cdr = to_cdr(&message);
        let body = cdr_encoding::to_vec::<_, LittleEndian>(&CdrBytes(cdr.clone())).unwrap();
        assert_eq!(body, cdr[HEADER..]);
        let mut little = CdrDeserializer::<LittleEndian>::new(&body);
        assert_eq!(AsCdr.deserialize(&mut little).unwrap(), CdrBytes(cdr));
        let mut big = CdrDeserializer::<BigEndian>::new(&[1, 2, 3]);
        assert_eq!(AsCdr.deserialize(&mut big).unwrap(), CdrBytes(vec![0, 0, 0, 0, 1, 2, 3]));
        let mut empty = CdrDeserializer::<LittleEndian>::new(&[]);
        assert_eq!(AsCdr.deserialize(&mut empty).unwrap(), CdrBytes(vec![0, 1, 0, 0]));
    }
}
