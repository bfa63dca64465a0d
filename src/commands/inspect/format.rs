//! Numbers and foreign names as a person reads them.

use comfy_table::{CellAlignment, Table, presets};

pub(super) use crate::bag::printable;

/// What stands where a number is not known.
pub(super) const UNKNOWN: &str = "-";

/// A count with its thousands apart: `18,558`.
pub(super) fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (idx, digit) in digits.chars().enumerate() {
        if idx > 0 && (digits.len() - idx).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A number with about three digits that count: `0.012`, `1.95`, `12.3`, `301`, `18,558`, `1.2e12`.
pub(super) fn number(value: f64) -> String {
    let size = value.abs();
    // Each bound is where rounding would add a digit.
    match size {
        _ if value == 0.0 => "0".to_owned(),
        _ if !size.is_finite() => value.to_string(),
        _ if size < 0.0005 => format!("{value:.0e}"),
        _ if size < 0.0995 => format!("{value:.3}"),
        _ if size < 9.995 => format!("{value:.2}"),
        _ if size < 99.95 => format!("{value:.1}"),
        _ if size < 1e9 => format!("{}{}", if value < 0.0 { "-" } else { "" }, count(size.round() as u64)),
        _ => format!("{value:.1e}"),
    }
}

/// As [`number`], with a dash where it is not known.
pub(super) fn known(value: Option<f64>) -> String {
    value.map_or_else(|| UNKNOWN.to_owned(), number)
}

/// `5`, or `4 to 6`.
pub(super) fn range([least, most]: [u64; 2]) -> String {
    if least == most { count(least) } else { format!("{} to {}", count(least), count(most)) }
}

/// A size in bytes: `692 kB`.
pub(super) fn bytes(n: u64) -> String {
    const UNITS: [&str; 5] = ["B", "kB", "MB", "GB", "TB"];
    let mut size = n as f64;
    let mut unit = 0;
    while size >= 999.5 && unit + 1 < UNITS.len() {
        size /= 1000.0;
        unit += 1;
    }
    format!("{} {}", number(size), UNITS[unit])
}

/// A span of time: `12.98 s`, `2 min 03 s`, `1 h 05 min`.
pub(super) fn seconds(s: f64) -> String {
    let whole = s.round() as u64;
    match whole {
        0..=119 => format!("{s:.2} s"),
        120..=7199 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole % 3600 / 60),
    }
}

/// As [`printable`], cut off where it is longer than `most` characters.
pub(super) fn shortened(text: &str, most: usize) -> String {
    let text = printable(text);
    match text.char_indices().nth(most) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

/// An empty table whose first column is text and whose other columns are numbers.
pub(super) fn table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::NOTHING).force_no_tty().set_header(header.to_vec());
    for (idx, column) in table.column_iter_mut().enumerate() {
        column.set_padding((2, 0));
        column.set_cell_alignment(if idx == 0 { CellAlignment::Left } else { CellAlignment::Right });
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits_that_count() {
        let shown: Vec<String> =
            [0.0, 0.0123, 0.0996, 1.949, 9.996, 12.34, 99.96, 301.4, 18_558.2, -3.0].map(number).into();
        assert_eq!(shown, ["0", "0.012", "0.10", "1.95", "10.0", "12.3", "100", "301", "18,558", "-3.00"]);
        assert_eq!(bytes(999), "999 B");
        assert_eq!(bytes(2_547_895), "2.55 MB");
        assert_eq!(seconds(3725.0), "62 min 05 s");
    }

    #[test]
    fn foreign_text_steers_no_terminal() {
        assert_eq!(printable("a\u{1b}[31m\nb\u{202e}"), "a [31m b ");
        assert_eq!(shortened("abcdef", 3), "abc...");
    }
}
