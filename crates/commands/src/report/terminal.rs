//! Tables and lines that take the width of the terminal; where there is none, lines are as long as they are.

use std::sync::OnceLock;

use comfy_table::{Cell, ColumnConstraint, ContentArrangement, Row, Table, Width, presets};

/// How much further a line is indented where it goes on.
const HANGING: usize = 2;

/// How much is said besides results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Voice {
    /// Losses and doubts.
    Quiet,
    /// Notes and progress besides.
    Usual,
    /// How it is done besides.
    Verbose,
}

static VOICE: OnceLock<Voice> = OnceLock::new();

/// Decides how much is said, once: a process has one command line.
pub(crate) fn set_voice(is_quiet: bool, is_verbose: bool) {
    let _ = VOICE.set(match (is_quiet, is_verbose) {
        (true, _) => Voice::Quiet,
        (false, false) => Voice::Usual,
        (false, true) => Voice::Verbose,
    });
}

/// How much is said.
pub(crate) fn voice() -> Voice {
    VOICE.get().copied().unwrap_or(Voice::Usual)
}

/// A table, as wide as what is in it; [`shown`] makes it fit.
pub fn table<const N: usize>(header: [&str; N]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN).set_header(header);
    table
}

/// A table as the terminal has room for it: where its lines are too long, the first columns, which name a row, stand on a line
/// of their own above the others.
pub fn shown(table: &Table, n_names: usize) -> String {
    shown_at(table, n_names, stdout_columns())
}

fn shown_at(table: &Table, n_names: usize, columns: Option<usize>) -> String {
    let whole = table.to_string();
    let is_long = |columns: usize| whole.lines().any(|line| line.chars().count() > columns);
    let (Some(columns), Some(header)) = (columns.filter(|columns| is_long(*columns)), table.header()) else {
        return whole;
    };
    let cells = |row: &Row| row.cell_iter().map(Cell::content).collect::<Vec<String>>();
    let header = cells(header);
    let rows: Vec<Vec<String>> = table.row_iter().map(cells).collect();
    let mut numbers = Table::new();
    numbers.load_style(presets::ASCII_MARKDOWN).set_content_arrangement(ContentArrangement::Dynamic);
    numbers.set_width(u16::try_from(columns).unwrap_or(u16::MAX)).set_header(header.iter().skip(n_names));
    for row in &rows {
        numbers.add_row(row.iter().skip(n_names));
    }
    for (idx, column) in numbers.column_iter_mut().enumerate() {
        // Headers are wrapped, numbers are not.
        let longest = rows.iter().filter_map(|row| row.get(n_names + idx)).map(|cell| cell.chars().count()).max();
        let word = header[n_names + idx].split(' ').map(|word| word.chars().count()).max();
        let width = u16::try_from(longest.max(word).unwrap_or(0) + 2).unwrap_or(u16::MAX);
        column.set_constraint(ColumnConstraint::LowerBoundary(Width::Fixed(width)));
    }
    let lines: Vec<String> = numbers.lines().collect();
    let n_head = lines.len().saturating_sub(rows.len());
    let is_end_of_head = n_head > 0 && lines[n_head - 1].starts_with("|-");
    if !is_end_of_head || lines.iter().any(|line| line.chars().count() > columns) {
        let mut table = table.clone();
        table.set_content_arrangement(ContentArrangement::Dynamic);
        return table.set_width(u16::try_from(columns).unwrap_or(u16::MAX)).to_string();
    }
    let mut text = lines[..n_head].join("\n");
    for (row, line) in rows.iter().zip(&lines[n_head..]) {
        text += &format!("\n{}\n{line}", row[..n_names.min(row.len())].join(", "));
    }
    text
}

/// Columns of the terminal that stdout goes to; `None` where it goes elsewhere.
pub(crate) fn stdout_columns() -> Option<usize> {
    Table::new().width().map(usize::from)
}

/// The same of stderr.
pub(crate) fn stderr_columns() -> Option<usize> {
    Table::new().use_stderr().width().map(usize::from)
}

/// A text with its long lines wrapped between words. What is to be copied stays whole: JSON, commands, comments in YAML; and so
/// do tables, which have their width already.
pub(crate) fn fitted(text: &str, columns: Option<usize>) -> String {
    let Some(columns) = columns.filter(|_| !text.starts_with(['{', '['])) else { return text.to_owned() };
    text.split('\n').map(|line| fitted_line(line, columns)).collect::<Vec<String>>().join("\n")
}

fn fitted_line(line: &str, columns: usize) -> String {
    let words = line.trim_start();
    let stays = ["|", "#", "tpf ", "next: tpf "].iter().any(|begin| words.starts_with(begin)) || words.contains(" # ");
    let indent = line.len() - words.len();
    let width = columns.saturating_sub(indent + HANGING);
    // A name that is longer than a line is not broken.
    let has_room = words.split(' ').all(|word| word.chars().count() <= width);
    if line.chars().count() <= columns || stays || !has_room {
        return line.to_owned();
    }
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_content_arrangement(ContentArrangement::Dynamic);
    table.set_width(u16::try_from(width).unwrap_or(u16::MAX)).add_row([words]);
    table.column_iter_mut().for_each(|column| {
        column.set_padding((0, 0));
    });
    let part = |(nth, part): (usize, String)| {
        let further = if nth > 0 { HANGING } else { 0 };
        format!("{:1$}{2}", "", indent + further, part.trim_end())
    };
    table.lines().enumerate().map(part).collect::<Vec<String>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_is_wrapped_between_words_under_its_indent() {
        let line = "  region index: 22903 estimates, 169 with a pose beyond the training data, 73 contacts; no estimate, 62 while the window fills";
        let fitted = fitted(&format!("short\n{line}\n"), Some(40));
        assert!(fitted.lines().all(|line| line.chars().count() <= 40), "{fitted}");
        assert!(
            fitted.starts_with("short\n  region") && fitted.contains("\n    ") && fitted.ends_with('\n'),
            "{fitted}"
        );
        assert_eq!(fitted.split_whitespace().skip(1).collect::<Vec<_>>(), line.split_whitespace().collect::<Vec<_>>());
    }

    #[test]
    fn a_table_that_is_too_wide_has_the_names_of_its_rows_above_their_numbers() {
        let mut table = table(["Glove", "Model", "Touches", "Onset ms p50 (p95)"]);
        table.add_row(["1", "a_model_with_a_long_name", "64", "31 (100)"]).add_row(["1", "another", "64", "30 (61)"]);
        let (wide, narrow) = (shown_at(&table, 2, Some(80)), shown_at(&table, 2, Some(30)));
        assert_eq!((&wide, wide.lines().count()), (&shown_at(&table, 2, None), 4));
        assert!(narrow.lines().all(|line| line.chars().count() <= 30), "{narrow}");
        let lines: Vec<&str> = narrow.lines().collect();
        let name = lines.iter().position(|line| *line == "1, a_model_with_a_long_name").unwrap();
        assert!(lines[name + 1].contains("| 64") && lines[name + 1].contains("31 (100)"), "{narrow}");
        assert_eq!((lines[name + 2], lines.len()), ("1, another", name + 4), "{narrow}");
    }

    #[test]
    fn what_is_copied_or_goes_elsewhere_stays_whole() {
        let long = "a ".repeat(60);
        let texts = [
            format!("{{\"a\": \"{long}\"}}"),
            format!("| {long}|"),
            format!("  tpf eval {long}"),
            format!("joints: [] # {long}"),
        ];
        for text in texts {
            assert_eq!(fitted(&text, Some(40)), text);
        }
        assert_eq!(fitted(&long, None), long);
        let path = format!("/{}", "a".repeat(90));
        assert_eq!(fitted(&path, Some(40)), path, "a name is not broken");
    }
}
