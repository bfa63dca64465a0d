//! Reads plain CDR with a position that never leaves the bytes of the message.

use super::definition::Primitive;

/// Encapsulation header of little-endian plain CDR.
pub(super) const LITTLE_ENDIAN_HEADER: [u8; 4] = [0, 1, 0, 0];

/// First bytes of a zstd frame. No encapsulation header begins with them.
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd]; // RFC 8878, 3.1.1

/// Bytes that can't be read as plain CDR.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CdrError {
    /// The bytes end within the encapsulation header.
    #[error("expected at least the 4 bytes of an encapsulation header, got {n_bytes}")]
    NoHeader {
        /// Number of bytes.
        n_bytes: usize,
    },
    /// The message has an encoding that ROS 2 doesn't use.
    #[error("expected plain CDR (encapsulation 0x0000 or 0x0001), got 0x{id:04x}")]
    Encapsulation {
        /// The encapsulation identifier.
        id: u16,
    },
    /// Each message is compressed separately, as in rosbag2's compression mode `message`.
    #[error("expected plain CDR, got a zstd frame: decompress the bag first, as in 'ros2 bag convert'")]
    Compressed,
    /// The bytes end before the field does.
    #[error("expected {needed} more bytes at offset {at}, got {left}")]
    Truncated {
        /// Offset after the encapsulation header.
        at: usize,
        /// Number of bytes of the field.
        needed: usize,
        /// Number of remaining bytes.
        left: usize,
    },
    /// An array is too short for the requested element.
    #[error("expected an array with an element {index}, got {len} elements")]
    NoElement {
        /// The requested element.
        index: usize,
        /// Number of elements.
        len: usize,
    },
    /// No element of an array has the requested value.
    #[error("expected an element with {condition}, got {got}")]
    NoMatch {
        /// `field=value`.
        condition: String,
        /// The values of that field.
        got: String,
    },
    /// Several elements have the requested value.
    #[error("expected one element with this value, got several")]
    SeveralMatch,
    /// A string is not UTF-8.
    #[error("expected UTF-8 text at offset {at}")]
    NotUtf8 {
        /// Offset after the encapsulation header.
        at: usize,
    },
    /// A count is negative.
    #[error("expected a whole number that is not negative, got {value}")]
    NotACount {
        /// The value found.
        value: i64,
    },
    /// A number of seconds is not finite.
    #[error("expected a finite number of seconds, got {value}")]
    NotASpan {
        /// The value found.
        value: String,
    },
    /// A stamp is not finite.
    #[error("expected a finite number as a stamp, got {value}")]
    NotAStamp {
        /// The value found.
        value: String,
    },
    /// The description of packed bytes doesn't fit them, or says that they are not numbers.
    #[error("{reason}")]
    Packed {
        /// The expected and the found value.
        reason: String,
    },
    /// A wide string, whose encoding differs between ROS 2 releases.
    #[error("wstring is not supported: its encoding differs between ROS 2 releases")]
    WideText,
    /// The field was compiled for reading as another type.
    #[error("expected a field to read as {wanted}, got {found}")]
    Kind {
        /// The requested type.
        wanted: &'static str,
        /// The type of the field.
        found: String,
    },
}

/// A position in the body of a message. Alignment is relative to the end of the encapsulation header.
#[derive(Debug, Clone)]
pub(super) struct CdrReader<'a> {
    body: &'a [u8],
    at: usize,
    little_endian: bool,
}

impl<'a> CdrReader<'a> {
    /// Starts after the encapsulation header.
    #[inline]
    pub(super) fn new(cdr: &'a [u8]) -> Result<Self, CdrError> {
        let Some((header, body)) = cdr.split_first_chunk::<4>() else {
            return Err(CdrError::NoHeader { n_bytes: cdr.len() });
        };
        match u16::from_be_bytes([header[0], header[1]]) {
            id @ (0 | 1) => Ok(CdrReader { body, at: 0, little_endian: id == 1 }),
            _ if *header == ZSTD_MAGIC => Err(CdrError::Compressed),
            id => Err(CdrError::Encapsulation { id }),
        }
    }

    pub(super) fn is_little_endian(&self) -> bool {
        self.little_endian
    }

    /// All bytes after the encapsulation header.
    pub(super) fn body(&self) -> &'a [u8] {
        self.body
    }

    /// Number of bytes that are not read yet.
    pub(super) fn left(&self) -> usize {
        self.body.len() - self.at
    }

    /// Advances to a multiple of `alignment`, which is a power of two.
    #[inline]
    pub(super) fn align(&mut self, alignment: usize) -> Result<(), CdrError> {
        self.skip(self.at.wrapping_neg() & (alignment - 1))
    }

    #[inline]
    pub(super) fn skip(&mut self, n_bytes: usize) -> Result<(), CdrError> {
        self.take(n_bytes).map(|_| ())
    }

    #[inline]
    pub(super) fn take(&mut self, n_bytes: usize) -> Result<&'a [u8], CdrError> {
        let rest = &self.body[self.at..]; // `at` never exceeds the length of the body
        match rest.get(..n_bytes) {
            Some(taken) => {
                self.at += n_bytes;
                Ok(taken)
            }
            None => Err(CdrError::Truncated { at: self.at, needed: n_bytes, left: rest.len() }),
        }
    }

    /// The bytes of `count` primitives. If `count` is 0, nothing is read and nothing is aligned.
    #[inline]
    pub(super) fn primitives(&mut self, primitive: Primitive, count: usize) -> Result<&'a [u8], CdrError> {
        if count == 0 {
            return Ok(&[]);
        }
        self.align(primitive.size())?;
        self.take(count.saturating_mul(primitive.size()))
    }

    #[inline]
    pub(super) fn u32(&mut self) -> Result<u32, CdrError> {
        self.align(4)?;
        let bytes = self.take(4)?;
        let bytes = [bytes[0], bytes[1], bytes[2], bytes[3]];
        Ok(if self.little_endian { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    /// Reads the length of a sequence. It may exceed the remaining bytes: check it before reserving memory.
    #[inline]
    pub(super) fn len(&mut self) -> Result<usize, CdrError> {
        self.u32().map(|len| len as usize)
    }

    /// The bytes of a string without its terminator, which some senders omit for an empty string.
    #[inline]
    pub(super) fn text(&mut self) -> Result<&'a [u8], CdrError> {
        let len = self.len()?;
        let bytes = self.take(len)?;
        Ok(bytes.strip_suffix(&[0]).unwrap_or(bytes))
    }

    pub(super) fn utf8(&mut self) -> Result<&'a str, CdrError> {
        let at = self.at;
        std::str::from_utf8(self.text()?).map_err(|_| CdrError::NotUtf8 { at })
    }
}
