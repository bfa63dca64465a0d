//! float32 values as hexadecimal text of their little-endian bytes: decimal text may round, and resuming must not.

use serde::{Deserialize, Deserializer, Serializer, de::Error};

pub(super) fn serialize<S: Serializer>(values: &[f32], serializer: S) -> Result<S::Ok, S::Error> {
    const DIGITS: &[u8; 16] = b"0123456789abcdef";
    let bytes = values.iter().flat_map(|value| value.to_le_bytes());
    let digits = bytes.flat_map(|byte| [byte >> 4, byte & 15].map(|half| char::from(DIGITS[usize::from(half)])));
    serializer.serialize_str(&digits.collect::<String>())
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f32>, D::Error> {
    let text = String::deserialize(deserializer)?;
    let (words, rest) = text.as_bytes().as_chunks::<8>();
    let half = |digit: u8| char::from(digit).to_digit(16).map(|half| half as u8);
    let word = |digits: &[u8; 8]| {
        let mut bytes = [0; 4];
        for (byte, [high, low]) in bytes.iter_mut().zip(digits.as_chunks::<2>().0) {
            *byte = half(*high)? << 4 | half(*low)?;
        }
        Some(f32::from_le_bytes(bytes))
    };
    let values: Option<Vec<f32>> = words.iter().map(word).collect();
    values.filter(|_| rest.is_empty()).ok_or_else(|| D::Error::custom("expected float32 values as hexadecimal text"))
}
