//! Reading plain CDR: a position in the bytes of a message that never leaves them.

use super::definition::Primitive;

/// Encapsulation header of little-endian plain CDR.
pub(super) const LITTLE_ENDIAN_HEADER: [u8; 4] = [0, 1, 0, 0];

/// What a zstd frame begins with; no encapsulation does.
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd]; // RFC 8878, 3.1.1

/// Why bytes can't be read as plain CDR.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CdrError {
    /// The bytes end within the encapsulation header.
    #[error("expected at least the 4 bytes of an encapsulation header, got {n_bytes}")]
    NoHeader {
        /// How many bytes came.
        n_bytes: usize,
    },
    /// The message is encoded in a way that ROS 2 does not use.
    #[error("expected plain CDR (encapsulation 0x0000 or 0x0001), got 0x{id:04x}")]
    Encapsulation {
        /// The identifier that came.
        id: u16,
    },
    /// The message is compressed by itself, as rosbag2 does in its compression mode `message`.
    #[error("expected plain CDR, got a zstd frame: decompress the bag first, as in 'ros2 bag convert'")]
    Compressed,
    /// The bytes end before the field does.
    #[error("expected {needed} more bytes at offset {at}, got {left}")]
    Truncated {
        /// Offset after the encapsulation header.
        at: usize,
        /// Bytes that the field takes there.
        needed: usize,
        /// Bytes that are left.
        left: usize,
    },
    /// An array is too short for the element asked for.
    #[error("expected an array with an element {index}, got {len} elements")]
    NoElement {
        /// The element asked for.
        index: usize,
        /// How many there are.
        len: usize,
    },
    /// No element of an array is the one that is wanted.
    #[error("expected an element with {condition}, got {got}")]
    NoMatch {
        /// `field=value`.
        condition: String,
        /// The values of that field that came.
        got: String,
    },
    /// Several elements are the one that is wanted.
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
        /// What came.
        value: i64,
    },
    /// A number of seconds is not finite.
    #[error("expected a finite number of seconds, got {value}")]
    NotASpan {
        /// What came.
        value: String,
    },
    /// A number that should be a point in time is not finite.
    #[error("expected a finite number as a stamp, got {value}")]
    NotAStamp {
        /// What came.
        value: String,
    },
    /// What describes packed bytes doesn't fit them, or says that they are no readings.
    #[error("{reason}")]
    Packed {
        /// What was expected, and what came.
        reason: String,
    },
    /// A wide string, whose encoding differs between ROS 2 releases.
    #[error("wstring is not supported: its encoding differs between ROS 2 releases")]
    WideText,
    /// The field was compiled to be read as something else.
    #[error("expected a field to read as {wanted}, got {found}")]
    Kind {
        /// What was asked for.
        wanted: &'static str,
        /// What the field is.
        found: String,
    },
}

/// A position in the body of a message. Alignment counts from the end of the encapsulation header.
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

    /// Bytes not read yet.
    pub(super) fn left(&self) -> usize {
        self.body.len() - self.at
    }

    /// Moves up to a multiple of `alignment`, a power of two.
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
        let rest = &self.body[self.at..]; // `at` only ever moves over bytes that are there
        match rest.get(..n_bytes) {
            Some(taken) => {
                self.at += n_bytes;
                Ok(taken)
            }
            None => Err(CdrError::Truncated { at: self.at, needed: n_bytes, left: rest.len() }),
        }
    }

    /// The bytes of `count` primitives; none, and no alignment either, when the count is 0.
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

    /// The length of a sequence. It says nothing about the bytes that are there: check before reserving.
    #[inline]
    pub(super) fn len(&mut self) -> Result<usize, CdrError> {
        self.u32().map(|len| len as usize)
    }

    /// The bytes of a string without its terminator, which some senders leave out of empty ones.
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
