//! Numbers and foreign names as a person reads them.

use comfy_table::{CellAlignment, Table, presets};

pub(super) use tactile_pose_fusion::bag::printable;
pub(super) use tactile_pose_fusion::inspect::{count, number, range};

/// Stands where a number is not known.
pub(super) const UNKNOWN: &str = "-";

/// As [`number`], with a dash where it is not known.
pub(super) fn known(value: Option<f64>) -> String {
    value.map_or_else(|| UNKNOWN.to_owned(), number)
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

/// An empty table of numbers; its rows have names.
pub(super) fn numbers(header: &[&str]) -> Table {
    let mut table = table(header);
    table.column_iter_mut().for_each(|column| column.set_cell_alignment(CellAlignment::Right));
    table
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

/// A table whose rows stand below their names, which may be long.
pub(super) fn under_names(names: &[String], table: &Table) -> String {
    let mut lines = table.lines();
    let mut text = lines.next().map_or_else(String::new, |header| header.trim_end().to_owned() + "\n");
    for (name, line) in names.iter().zip(lines) {
        text += &format!("  {name}\n{}\n", line.trim_end());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_times_have_three_digits_that_count() {
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
