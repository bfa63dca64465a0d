//! Parameter values. Resolves YAML scalars as rcl does.

use std::fmt;

use super::text::one_line;

/// Value of a parameter, of the types that ROS 2 has.
#[derive(Debug, Clone, PartialEq)]
pub enum ParamValue {
    /// `true`, `yes`, `on` and their opposites.
    Bool(bool),
    /// A 64 bit integer.
    Int(i64),
    /// A 64 bit float.
    Double(f64),
    /// A string.
    Str(String),
    /// `[true, false]`.
    BoolArray(Vec<bool>),
    /// `[1, 2]`.
    IntArray(Vec<i64>),
    /// `[1.0, 2.0]`.
    DoubleArray(Vec<f64>),
    /// `[a, b]`.
    StrArray(Vec<String>),
    /// `[]`, which fits an array of any type.
    EmptyArray,
}

impl ParamValue {
    /// The type's name in ROS 2 tools.
    pub fn type_name(&self) -> &'static str {
        match self {
            ParamValue::Bool(_) => "bool",
            ParamValue::Int(_) => "int",
            ParamValue::Double(_) => "double",
            ParamValue::Str(_) => "string",
            ParamValue::BoolArray(_) => "bool[]",
            ParamValue::IntArray(_) => "int[]",
            ParamValue::DoubleArray(_) => "double[]",
            ParamValue::StrArray(_) => "string[]",
            ParamValue::EmptyArray => "empty array",
        }
    }

    /// Builds an array of scalars. If a scalar has another type than the first one, the error names it.
    pub(super) fn array(items: Vec<ParamValue>) -> Result<ParamValue, MixedArray> {
        let Some(first) = items.first() else { return Ok(ParamValue::EmptyArray) };
        let first_type = first.type_name();
        if let Some((idx, other)) = items.iter().enumerate().find(|(_, item)| item.type_name() != first_type) {
            return Err(MixedArray { idx, first: first_type, other: other.type_name() });
        }
        let mut array = match first {
            ParamValue::Bool(_) => ParamValue::BoolArray(Vec::with_capacity(items.len())),
            ParamValue::Int(_) => ParamValue::IntArray(Vec::with_capacity(items.len())),
            ParamValue::Double(_) => ParamValue::DoubleArray(Vec::with_capacity(items.len())),
            _ => ParamValue::StrArray(Vec::with_capacity(items.len())),
        };
        for item in items {
            match (&mut array, item) {
                (ParamValue::BoolArray(array), ParamValue::Bool(item)) => array.push(item),
                (ParamValue::IntArray(array), ParamValue::Int(item)) => array.push(item),
                (ParamValue::DoubleArray(array), ParamValue::Double(item)) => array.push(item),
                (ParamValue::StrArray(array), ParamValue::Str(item)) => array.push(item),
                _ => {} // arrays in arrays, which no caller builds
            }
        }
        Ok(array)
    }
}

/// An array with elements of different types: index and type of the first element that differs, and the type of element
/// 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MixedArray {
    pub(super) idx: usize,
    pub(super) first: &'static str,
    pub(super) other: &'static str,
}

impl fmt::Display for ParamValue {
    /// As in a parameter file, but on one line and shortened, for messages.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fn list<T>(f: &mut fmt::Formatter<'_>, items: &[T], text: impl Fn(&T) -> String) -> fmt::Result {
            const SHOWN: usize = 12;
            let mut shown: Vec<String> = items.iter().take(SHOWN).map(text).collect();
            if items.len() > SHOWN {
                shown.push(format!("... ({} in all)", items.len()));
            }
            write!(f, "[{}]", shown.join(", "))
        }
        match self {
            ParamValue::Bool(value) => write!(f, "{value}"),
            ParamValue::Int(value) => write!(f, "{value}"),
            ParamValue::Double(value) => f.write_str(&double_text(*value)),
            ParamValue::Str(value) => write!(f, "\"{}\"", one_line(value)),
            ParamValue::BoolArray(values) => list(f, values, |value| value.to_string()),
            ParamValue::IntArray(values) => list(f, values, |value| value.to_string()),
            ParamValue::DoubleArray(values) => list(f, values, |value| double_text(*value)),
            ParamValue::StrArray(values) => list(f, values, |value| one_line(value)),
            ParamValue::EmptyArray => f.write_str("[]"),
        }
    }
}

/// A double in YAML syntax that is read as a double again.
fn double_text(value: f64) -> String {
    match value {
        _ if value.is_nan() => ".nan".into(),
        f64::INFINITY => ".inf".into(),
        f64::NEG_INFINITY => "-.inf".into(),
        _ => format!("{value:?}"),
    }
}

/// Resolves a scalar as `rcl_yaml_param_parser` does: a quoted scalar is a string. Otherwise it tries bool, int (also
/// `0x1F` and octal `017`) and double, and else takes a string.
///
/// Where C's `strtod` accepts more than YAML, `inf` and `nan` are accepted too, but not hexadecimal floats.
pub(super) fn resolve(text: &str, quoted: bool) -> ParamValue {
    if quoted {
        return ParamValue::Str(text.to_owned());
    }
    match text {
        "Y" | "y" | "yes" | "Yes" | "YES" | "true" | "True" | "TRUE" | "on" | "On" | "ON" => {
            return ParamValue::Bool(true);
        }
        "N" | "n" | "no" | "No" | "NO" | "false" | "False" | "FALSE" | "off" | "Off" | "OFF" => {
            return ParamValue::Bool(false);
        }
        _ => {}
    }
    if let Some(value) = int(text) {
        ParamValue::Int(value)
    } else if let Some(value) = double(text) {
        ParamValue::Double(value)
    } else {
        ParamValue::Str(text.to_owned())
    }
}

fn split_sign(text: &str) -> (bool, &str) {
    match text.as_bytes().first() {
        Some(b'-') => (true, &text[1..]),
        Some(b'+') => (false, &text[1..]),
        _ => (false, text),
    }
}

/// Like `strtol` with base 0. `None` also if the number needs more than 64 bits.
fn int(text: &str) -> Option<i64> {
    let (negative, digits) = split_sign(text);
    let (radix, digits) = if let Some(hex) = digits.strip_prefix("0x").or_else(|| digits.strip_prefix("0X")) {
        (16, hex)
    } else if digits.len() > 1 && digits.starts_with('0') {
        (8, &digits[1..])
    } else {
        (10, digits)
    };
    // from_str_radix accepts a sign, but one was already taken.
    if !digits.chars().next()?.is_ascii_hexdigit() {
        return None;
    }
    let magnitude = i128::from_str_radix(digits, radix).ok()?;
    i64::try_from(if negative { -magnitude } else { magnitude }).ok()
}

/// Like `strtod` without hexadecimal floats. `None` if the value overflows or underflows, as in rcl.
fn double(text: &str) -> Option<f64> {
    let (negative, digits) = split_sign(text);
    let magnitude = match digits {
        ".nan" | ".NaN" | ".NAN" if digits.len() == text.len() => f64::NAN,
        ".inf" | ".Inf" | ".INF" => f64::INFINITY,
        _ if digits.eq_ignore_ascii_case("nan") => f64::NAN,
        _ if digits.eq_ignore_ascii_case("inf") || digits.eq_ignore_ascii_case("infinity") => f64::INFINITY,
        _ => {
            if !digits.starts_with(|first: char| first.is_ascii_digit() || first == '.') {
                return None;
            }
            let value: f64 = digits.parse().ok()?;
            let mantissa = digits.split(['e', 'E']).next().unwrap_or_default();
            let underflow =
                value.is_subnormal() || (value == 0.0 && mantissa.contains(|digit| matches!(digit, '1'..='9')));
            if value.is_infinite() || underflow {
                return None;
            }
            value
        }
    };
    Some(if negative { -magnitude } else { magnitude })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each pair was read with rcl 10.1 (Kilted) from a parameter file through rclpy.
    #[test]
    fn scalars_are_read_as_rcl_reads_them() {
        use ParamValue::{Bool, Double, Int, Str};
        let text = |text: &str| Str(text.to_owned());
        let table = [
            ("yes", Bool(true)),
            ("Yes", Bool(true)),
            ("yEs", text("yEs")),
            ("y", Bool(true)),
            ("on", Bool(true)),
            ("off", Bool(false)),
            ("N", Bool(false)),
            ("0x1F", Int(31)),
            ("0X1f", Int(31)),
            ("-0x10", Int(-16)),
            ("010", Int(8)),
            ("0", Int(0)),
            ("08", Double(8.0)),
            ("0x", text("0x")),
            ("0o10", text("0o10")),
            ("0b11", text("0b11")),
            ("+5", Int(5)),
            ("-3", Int(-3)),
            ("1_000", text("1_000")),
            ("1e3", Double(1000.0)),
            (".5", Double(0.5)),
            ("5.", Double(5.0)),
            ("inf", Double(f64::INFINITY)),
            ("infinity", Double(f64::INFINITY)),
            (".inf", Double(f64::INFINITY)),
            ("-.inf", Double(f64::NEG_INFINITY)),
            ("+.Inf", Double(f64::INFINITY)),
            ("1e400", text("1e400")),
            ("1e-400", text("1e-400")),
            ("9223372036854775808", Double(9_223_372_036_854_775_808.0)),
            ("-9223372036854775809", Double(-9_223_372_036_854_775_809.0)),
            ("-9223372036854775808", Int(i64::MIN)),
            ("hello world", text("hello world")),
            ("1 2", text("1 2")),
            ("12:30:00", text("12:30:00")),
            ("2024-01-01", text("2024-01-01")),
            ("+-5", text("+-5")),
            ("0x-5", text("0x-5")),
            ("-", text("-")),
            (".", text(".")),
        ];
        for (written, read) in table {
            assert_eq!(resolve(written, false), read, "{written}");
        }
        assert!(matches!(resolve(".nan", false), Double(value) if value.is_nan()));
        assert_eq!(resolve("5", true), text("5"));
        assert_eq!(resolve("true", true), text("true"));
    }
}
