//! Converts the bytes of primitives to floating-point numbers and counts.

use crate::msg::cdr::CdrError;
use crate::msg::definition::Primitive;

macro_rules! append {
    ($name:ident, $float:ty) => {
        /// Appends all numbers in `bytes`, which has whole elements of `primitive`.
        pub(super) fn $name(primitive: Primitive, bytes: &[u8], little_endian: bool, out: &mut Vec<$float>) {
            macro_rules! extend {
                ($number:ty) => {{
                    let (elements, _) = bytes.as_chunks::<{ size_of::<$number>() }>();
                    if little_endian {
                        out.extend(elements.iter().map(|element| <$number>::from_le_bytes(*element) as $float));
                    } else {
                        out.extend(elements.iter().map(|element| <$number>::from_be_bytes(*element) as $float));
                    }
                }};
            }
            match primitive {
                Primitive::Bool => out.extend(bytes.iter().map(|byte| <$float>::from(u8::from(*byte != 0)))),
                Primitive::Byte | Primitive::Char | Primitive::UInt8 => extend!(u8),
                Primitive::Int8 => extend!(i8),
                Primitive::Int16 => extend!(i16),
                Primitive::UInt16 => extend!(u16),
                Primitive::Int32 => extend!(i32),
                Primitive::UInt32 => extend!(u32),
                Primitive::Int64 => extend!(i64),
                Primitive::UInt64 => extend!(u64),
                Primitive::Float32 => extend!(f32),
                Primitive::Float64 => extend!(f64),
            }
        }
    };
}

append!(append_f32, f32);
append!(append_f64, f64);

/// The bytes of one element in little-endian order. The caller passes as many bytes as the number has.
fn one<const N: usize>(bytes: &[u8], little_endian: bool) -> [u8; N] {
    let mut element: [u8; N] = bytes.first_chunk().copied().unwrap_or([0; N]);
    if !little_endian {
        element.reverse();
    }
    element
}

/// The first number in `bytes`. 64-bit integers are rounded to float precision.
pub(super) fn first(primitive: Primitive, bytes: &[u8], little_endian: bool) -> f64 {
    match primitive {
        Primitive::Float32 => f64::from(f32::from_le_bytes(one(bytes, little_endian))),
        Primitive::Float64 => f64::from_le_bytes(one(bytes, little_endian)),
        Primitive::UInt64 => u64::from_le_bytes(one(bytes, little_endian)) as f64,
        _ => signed(primitive, bytes, little_endian) as f64,
    }
}

/// The first integer in `bytes`, which must not be negative.
pub(super) fn count(primitive: Primitive, bytes: &[u8], little_endian: bool) -> Result<u64, CdrError> {
    if primitive == Primitive::UInt64 {
        return Ok(u64::from_le_bytes(one(bytes, little_endian)));
    }
    let value = signed(primitive, bytes, little_endian);
    u64::try_from(value).map_err(|_| CdrError::NotACount { value })
}

/// The first number in `bytes`, for primitives that fit an `i64`. Others are converted lossily.
pub(super) fn signed(primitive: Primitive, bytes: &[u8], little_endian: bool) -> i64 {
    match primitive {
        Primitive::Bool => i64::from(one::<1>(bytes, little_endian)[0] != 0),
        Primitive::Byte | Primitive::Char | Primitive::UInt8 => i64::from(one::<1>(bytes, little_endian)[0]),
        Primitive::Int8 => i64::from(i8::from_le_bytes(one(bytes, little_endian))),
        Primitive::Int16 => i64::from(i16::from_le_bytes(one(bytes, little_endian))),
        Primitive::UInt16 => i64::from(u16::from_le_bytes(one(bytes, little_endian))),
        Primitive::Int32 => i64::from(i32::from_le_bytes(one(bytes, little_endian))),
        Primitive::UInt32 => i64::from(u32::from_le_bytes(one(bytes, little_endian))),
        Primitive::Int64 => i64::from_le_bytes(one(bytes, little_endian)),
        Primitive::UInt64 => u64::from_le_bytes(one(bytes, little_endian)).cast_signed(),
        Primitive::Float32 => f32::from_le_bytes(one(bytes, little_endian)) as i64,
        Primitive::Float64 => f64::from_le_bytes(one(bytes, little_endian)) as i64,
    }
}

/// The first integer in `bytes`, of any width. The fraction of a float is cut off.
pub(super) fn whole(primitive: Primitive, bytes: &[u8], little_endian: bool) -> i128 {
    match primitive {
        Primitive::UInt64 => i128::from(u64::from_le_bytes(one(bytes, little_endian))),
        _ => i128::from(signed(primitive, bytes, little_endian)),
    }
}

/// Smallest and largest integer of a primitive. `None` for floating-point numbers.
pub(super) fn whole_range(primitive: Primitive) -> Option<[i128; 2]> {
    let unsigned = |bits: u32| [0, (1 << bits) - 1];
    let signed = |bits: u32| [-(1 << (bits - 1)), (1 << (bits - 1)) - 1];
    Some(match primitive {
        Primitive::Bool => [0, 1],
        Primitive::Byte | Primitive::Char | Primitive::UInt8 => unsigned(8),
        Primitive::UInt16 => unsigned(16),
        Primitive::UInt32 => unsigned(32),
        Primitive::UInt64 => unsigned(64),
        Primitive::Int8 => signed(8),
        Primitive::Int16 => signed(16),
        Primitive::Int32 => signed(32),
        Primitive::Int64 => signed(64),
        Primitive::Float32 | Primitive::Float64 => return None,
    })
}
