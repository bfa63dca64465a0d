//! Colours that people who see colours differently tell apart, too.

use crate::fusion::Estimate;
use crate::msg::ColorRGBA;

/// A colour as red, green and blue, 0 to 255.
pub(super) type Rgb = [u8; 3];

pub(super) const PAPER: Rgb = [0xf4, 0xf4, 0xf4];
pub(super) const NONE: Rgb = [0x99, 0x99, 0x99];
const MORE: Rgb = [0x00, 0x72, 0xb2];
const LESS: Rgb = [0xd5, 0x5e, 0x00];
const CONTACT: Rgb = [0x00, 0x9e, 0x73];
const FREE: Rgb = [0x56, 0xb4, 0xe9];
const FLAGGED: Rgb = [0xe6, 0x9f, 0x00];

/// Emphasizes small readings: the power of their share of the range.
const GAMMA: f32 = 0.7;

/// The colour of a taxel: blue above the zero, orange below it, as strong as its share of the range. Gray without a value.
pub(super) fn of_taxel(value: f32, range: f32) -> Rgb {
    if !value.is_finite() {
        return NONE;
    }
    let share = if range > 0.0 { (value.abs() / range).min(1.0).powf(GAMMA) } else { 0.0 };
    let strong = if value < 0.0 { LESS } else { MORE };
    std::array::from_fn(|part| {
        let (from, to) = (f32::from(PAPER[part]), f32::from(strong[part]));
        (from + (to - from) * share).round() as u8
    })
}

/// The colour of an estimate: gray without a force, yellow with a flag, green in contact, blue in the air.
pub(super) fn of_estimate(estimate: &Estimate) -> Rgb {
    match estimate.force {
        None => NONE,
        Some(_) if !estimate.flags.is_empty() => FLAGGED,
        Some(_) if estimate.contact.state => CONTACT,
        Some(_) => FREE,
    }
}

/// As markers have it.
pub(super) fn opaque([r, g, b]: Rgb) -> ColorRGBA {
    let part = |part: u8| f32::from(part) / 255.0;
    ColorRGBA { r: part(r), g: part(g), b: part(b), a: 1.0 }
}
