//! The findings of `tpf doctor` as text.

use comfy_table::{ContentArrangement, Table, presets};
use tactile_pose_fusion::ros::{Examination, Level};

/// Lines of a small terminal.
const SCREEN_LINES: usize = 22;

/// The verdict, then one finding a row, the worst marked in words; the topics if asked for.
pub fn text(found: &Examination, with_topics: bool) -> String {
    let counted = |level, what: &str| match found.count(level) {
        1 => format!("1 {what}"),
        n => format!("{n} {what}s"),
    };
    let (problems, warnings) = (counted(Level::Problem, "problem"), counted(Level::Warning, "warning"));
    let mut text = format!("{problems}, {warnings}\n\n");
    let mut table = table();
    for finding in &found.findings {
        table.add_row([word(finding.level), finding.part.as_str(), finding.text.as_str()]);
    }
    text += &lines(&table);
    if with_topics {
        let mut table = self::table();
        table.set_header(["topic", "type", "publishers", "subscriptions"]);
        for topic in &found.topics {
            let sides = [&topic.publishers, &topic.subscriptions].map(|side| side.join("\n"));
            let [publishers, subscriptions] = sides;
            table.add_row([topic.name.clone(), topic.types.join("\n"), publishers, subscriptions]);
        }
        text += &format!("\n{}", lines(&table));
    }
    if text.lines().count() > SCREEN_LINES {
        text += &format!("\n{problems}, {warnings}\n"); // the first line is out of sight
    }
    text
}

fn word(level: Level) -> &'static str {
    match level {
        Level::Ok => "OK",
        Level::Warning => "WARNING",
        Level::Problem => "PROBLEM",
    }
}

/// As wide as the terminal, where there is one.
fn table() -> Table {
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_content_arrangement(ContentArrangement::Dynamic);
    table
}

/// The rows without the spaces around them.
fn lines(table: &Table) -> String {
    table.lines().map(|line| format!("{}\n", line.strip_prefix(' ').unwrap_or(&line).trim_end())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_pose_fusion::ros::{Finding, Topic};

    #[test]
    fn the_verdict_comes_first_and_every_finding_has_its_word() {
        let finding = |level, text: &str| Finding { part: "input".to_owned(), level, text: text.to_owned() };
        let found = Examination {
            findings: vec![finding(Level::Ok, "fine"), finding(Level::Problem, "absent: start it")],
            nodes: vec!["/driver".to_owned()],
            topics: vec![Topic {
                name: "/taxels".to_owned(),
                types: vec!["a/msg/T".to_owned()],
                publishers: vec!["reliable, volatile, keep last 10".to_owned()],
                subscriptions: Vec::new(),
            }],
        };
        let all = text(&found, false);
        assert!(all.starts_with("1 problem, 0 warnings\n\n"), "{all}");
        assert!(all.lines().any(|line| line.starts_with("PROBLEM") && line.ends_with("absent: start it")), "{all}");
        assert_eq!(all.matches("1 problem, 0 warnings").count(), 1);
        let long = Examination { findings: (0..30).map(|_| finding(Level::Ok, "fine")).collect(), ..found.clone() };
        assert!(text(&long, false).ends_with("\n\n0 problems, 0 warnings\n"), "what scrolled away is said again");
        assert!(!all.contains("/taxels") && text(&found, true).contains("reliable, volatile, keep last 10"));
    }
}
