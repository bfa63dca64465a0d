//! A bag's report for a person, at most 80 columns wide where names allow.

use std::fmt::Write as _;

use tactile_pose_fusion::bag::GAP_FACTOR;
use tactile_pose_fusion::inspect::{
    Angle, BagReport, ForceCandidate, ForceRange, JointCandidate, Likelihood, TactileCandidate, TopicReport,
};

use super::format::{UNKNOWN, bytes, count, known, number, numbers, printable, range, seconds, shortened, under_names};

/// Unlikely candidates of one kind that are named; `--json` lists all.
const MAX_UNLIKELY: usize = 4;
/// Candidates of one kind that are told of in full.
const MAX_FULL: usize = 12;
const MAX_FILES: usize = 10;
const MAX_JOINTS: usize = 24;
/// Correlation from which on a force goes with taxels.
const FOLLOWS: f64 = 0.3;

/// Topics, timing, and what can feed the fusion, as a person reads it at a terminal.
pub fn text(bag: &BagReport) -> String {
    let mut text = format!("{}\n", printable(&bag.path));
    let stated = bag.n_messages_stated.filter(|&stated| stated != bag.n_messages);
    let of_stated = stated.map(|stated| format!(" of {}", count(stated))).unwrap_or_default();
    let duration = bag.duration_s.map_or_else(|| "no time".to_owned(), seconds);
    line(
        &mut text,
        2,
        &format!(
            "bag: {}{of_stated} messages on {} in {duration}, {}",
            count(bag.n_messages),
            plural(bag.topics.len() as u64, "topic", "topics"),
            bytes(bag.size_bytes)
        ),
    );
    if bag.files.len() > 1 || bag.files.first().is_some_and(|file| !bag.path.ends_with(file)) {
        let shown: Vec<String> = bag.files.iter().take(MAX_FILES).map(|file| printable(file)).collect();
        let more = bag.files.len().saturating_sub(MAX_FILES);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        line(&mut text, 2, &format!("files: {}{more}", shown.join(", ")));
    }
    if bag.n_more_topics > 0 {
        let words =
            format!("{} further topics are not told of, only their messages counted", count(bag.n_more_topics as u64));
        line(&mut text, 2, &words);
    }
    if !bag.losses.is_empty() {
        let n = plural(bag.losses.len() as u64, "loss", "losses");
        line(&mut text, 2, &format!("damaged: {n}, listed on stderr"));
    }
    if bag.topics.is_empty() {
        return text;
    }
    text += &topics(&bag.topics);
    text += &stamps(&bag.topics);
    text += &notes(&bag.topics);
    text += &candidates(bag);
    text
}

fn line(text: &mut String, indent: usize, words: &str) {
    let _ = writeln!(text, "{:indent$}{words}", ""); // a String takes every write
}

fn plural(n: u64, one: &str, several: &str) -> String {
    format!("{} {}", count(n), if n == 1 { one } else { several })
}

fn count_or_dash(n: u64, is_known: bool) -> String {
    if is_known { count(n) } else { UNKNOWN.to_owned() }
}

fn topics(topics: &[TopicReport]) -> String {
    let mut table = numbers(&["messages", "Hz", "p50", "p99", "max", "jitter", "gaps", "back"]);
    let mut names = Vec::new();
    for TopicReport { stats, .. } in topics {
        let type_name = if stats.type_name.is_empty() { "(no type)" } else { &stats.type_name };
        let is_timed = stats.interval_max_ms.is_some();
        names.push(format!("{}, {}", printable(&stats.topic), printable(type_name)));
        table.add_row(vec![
            count(stats.n_messages),
            known(stats.rate_hz),
            known(stats.interval_p50_ms),
            known(stats.interval_p99_ms),
            known(stats.interval_max_ms),
            known(stats.jitter_ms),
            count_or_dash(stats.n_gaps, is_timed),
            count_or_dash(stats.n_out_of_order, stats.n_messages > 1),
        ]);
    }
    format!(
        "\n  Topics by time of receipt: intervals (median p50, 99th percentile p99, max)\n  and their standard deviation \
         (jitter) in ms. gaps: intervals over {GAP_FACTOR} x p50.\n  back: messages received before one that stands in front \
         of them.\n\n{}",
        under_names(&names, &table)
    )
}

fn stamps(topics: &[TopicReport]) -> String {
    let header = ["Hz", "p50", "p99", "max", "jitter", "gaps", "back", "same", "delay", "max"];
    let (mut table, mut names) = (numbers(&header), Vec::new());
    let (mut unset, mut far_off) = (String::new(), Vec::new());
    for TopicReport { stats, stamps, .. } in topics {
        let Some(stamps) = stamps else { continue };
        let topic = printable(&stats.topic);
        if stamps.n_unset > 0 {
            line(&mut unset, 2, &format!("{topic}: {} stamps are zero, left out", count(stamps.n_unset)));
        }
        if stamps.delay_mean_ms.is_some_and(|ms| ms.abs() >= CLOCKS_DIFFER_MS) {
            far_off.push(topic.clone());
        }
        let field = if stamps.field == "header.stamp" { String::new() } else { format!(", {}", stamps.field) };
        names.push(format!("{topic}{field}"));
        table.add_row(vec![
            known(stamps.rate_hz),
            known(stamps.interval_p50_ms),
            known(stamps.interval_p99_ms),
            known(stamps.interval_max_ms),
            known(stamps.jitter_ms),
            count_or_dash(stamps.n_gaps, stamps.interval_max_ms.is_some()),
            count_or_dash(stamps.n_backward, stamps.n_stamps > 1),
            count_or_dash(stamps.n_repeated, stamps.n_stamps > 1),
            delay(stamps.delay_mean_ms),
            delay(stamps.delay_max_ms),
        ]);
    }
    if table.row_count() == 0 {
        return String::new();
    }
    if !far_off.is_empty() {
        let which = if far_off.len() == table.row_count() { "all topics".to_owned() } else { far_off.join(", ") };
        let words = "stamps are far from the time of receipt: the clock of the sender was not set, or the bag is a copy; samples of two topics fit each other only if their stamps are of the same clock";
        line(&mut unset, 2, &format!("{which}: {words}"));
    }
    format!(
        "\n  Topics by their own stamps, which decide the time of each sample: columns as above, in ms.\n  back, same: stamps before or at the \
         one in front of them.\n  delay: time of receipt less stamp, mean and max.\n\n{}{unset}",
        under_names(&names, &table)
    )
}

/// A mean delay from which on clocks must differ, ms.
const CLOCKS_DIFFER_MS: f64 = 60e3;

/// A delay in ms; with its unit where it is so long that the clocks must differ.
fn delay(ms: Option<f64>) -> String {
    match ms {
        Some(ms) if ms.abs() >= 86.4e6 => format!("{} d", number(ms / 86.4e6)),
        Some(ms) if ms.abs() >= 1e5 => format!("{} s", number(ms / 1e3)),
        ms => known(ms),
    }
}

fn notes(topics: &[TopicReport]) -> String {
    let mut text = String::new();
    for TopicReport { stats, notes, .. } in topics {
        for note in notes {
            line(&mut text, 2, &format!("{}: {}", printable(&stats.topic), printable(note)));
        }
    }
    if text.is_empty() { text } else { format!("\n{text}") }
}

fn candidates(bag: &BagReport) -> String {
    let found = &bag.candidates;
    let is_whole = bag.topics.iter().all(|topic| topic.unread.is_none());
    let read = if is_whole { "" } else { " in the topics that could be looked into" };
    let mut text = String::new();
    let tactile = found.tactile.iter().map(|one| {
        let rather = if found.is_rather_a_force(one) { ", more likely a force sensor" } else { "" };
        (one.likelihood, head(&one.topic, &one.field), tactile(one, rather))
    });
    section(&mut text, "Taxels", &format!("no array of numbers{read}"), tactile.collect());
    let joints = found.joints.iter().map(|one| (one.likelihood, head(&one.topic, &one.field), joints(one)));
    section(
        &mut text,
        "Joint angles",
        &format!("no JointState, and no array named as angles are{read}"),
        joints.collect(),
    );
    let force = found.force.iter().map(|one| (one.likelihood, printable(&one.topic), force(one)));
    section(
        &mut text,
        "Measured force, to hold estimates against",
        &format!("no wrench, nothing named force or load{read}"),
        force.collect(),
    );
    text += "\n  Stage annotations\n";
    for stage in &found.stages {
        let (n, n_zero_load) = (count(stage.n_messages), count(stage.n_zero_load));
        line(&mut text, 4, &format!("{}: {n}, of which {n_zero_load} say zero load", printable(&stage.topic)));
        paste(&mut text, &stage.parameters);
    }
    if found.stages.is_empty() {
        line(&mut text, 4, "none");
    }
    text
}

fn head(topic: &str, field: &str) -> String {
    format!("{} ({})", printable(topic), printable(field))
}

/// One kind of candidates: those that anything speaks for in full, the others by name.
fn section(text: &mut String, title: &str, lacking: &str, candidates: Vec<(Likelihood, String, String)>) {
    let _ = write!(text, "\n  {title}\n");
    if candidates.is_empty() {
        line(text, 4, &format!("none: {lacking}"));
    }
    let is_full = |(likelihood, ..): &&(Likelihood, String, String)| *likelihood != Likelihood::Unlikely;
    let n_full = candidates.iter().filter(is_full).count();
    candidates.iter().take(n_full.min(MAX_FULL)).for_each(|(.., full)| text.push_str(full));
    let others = &candidates[n_full.min(MAX_FULL)..];
    let named: Vec<&str> = others.iter().take(MAX_UNLIKELY).map(|(_, head, _)| head.as_str()).collect();
    if !named.is_empty() {
        let more = others.len() - named.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let words = if n_full > MAX_FULL { "also" } else { "unlikely" };
        line(text, 4, &format!("{words}: {}{more}; --json tells of all", named.join(", ")));
    }
}

fn opening(likelihood: Likelihood, head: &str, rather: &str, reasons: &[String]) -> String {
    let word = if likelihood == Likelihood::Likely { "likely" } else { "possible" };
    let reasons: Vec<String> = reasons.iter().map(|reason| printable(reason)).collect();
    format!("    {head}: {word}{rather}\n      {}\n", reasons.join("; "))
}

/// `-1.20 to 3.40`, or `always 2`.
fn span([least, most]: [f32; 2]) -> String {
    if least == most {
        return format!("always {}", number(least.into()));
    }
    format!("{} to {}", number(least.into()), number(most.into()))
}

fn paste(text: &mut String, parameters: &str) {
    for parameter in parameters.lines() {
        line(text, 8, &printable(parameter));
    }
}

fn tactile(one: &TactileCandidate, rather: &str) -> String {
    let mut text = opening(one.likelihood, &head(&one.topic, &one.field), rather, &one.reasons);
    let values = one.values.map(|values| format!(", {}", span(values)));
    let rate = one.sample_rate_hz.map(|rate| format!(", {} samples/s", number(rate)));
    line(
        &mut text,
        6,
        &format!(
            "{} of {} values a message{}{}",
            one.element,
            range(one.n_values),
            values.unwrap_or_default(),
            rate.unwrap_or_default()
        ),
    );
    paste(&mut text, &one.parameters.to_string());
    text
}

fn joints(one: &JointCandidate) -> String {
    let mut text = opening(one.likelihood, &head(&one.topic, &one.field), "", &one.reasons);
    let angle = |(idx, angle): (usize, &Angle)| {
        let name = angle.name.as_ref().map_or_else(|| format!("[{idx}]"), |name| shortened(name, 40));
        let values = angle.values.map(|values| format!(" {}", span(values)));
        let degrees = if angle.beyond_a_turn && one.looks_like_degrees { " (degrees?)" } else { "" };
        format!("{name}{}{degrees}", values.unwrap_or_default())
    };
    let shown: Vec<String> = one.angles.iter().enumerate().take(MAX_JOINTS).map(angle).collect();
    let rate = one.rate_hz.map(|rate| format!(", {} Hz", number(rate))).unwrap_or_default();
    line(&mut text, 6, &format!("{} of {} values a message{rate}", one.element, range(one.n_values)));
    for part in shown.chunks(2) {
        line(&mut text, 6, &part.join("; "));
    }
    if one.angles.len() > MAX_JOINTS {
        line(&mut text, 6, &format!("and {} more", one.angles.len() - MAX_JOINTS));
    }
    paste(&mut text, &one.parameters.to_string());
    text
}

fn force(one: &ForceCandidate) -> String {
    let mut text = opening(one.likelihood, &printable(&one.topic), "", &one.reasons);
    let fields: Vec<String> = one.fields.iter().map(|field| printable(field)).collect();
    let rate = one.rate_hz.map(|rate| format!(", {} Hz", number(rate))).unwrap_or_default();
    line(&mut text, 6, &format!("{}{rate}", fields.join(", ")));
    for ForceRange { field, values: [least, most], with_taxels, taxels } in &one.ranges {
        let way = match (with_taxels, taxels) {
            (Some(with), Some(taxels)) if *with >= FOLLOWS => format!("; it rises with {taxels}"),
            (Some(with), Some(taxels)) if *with <= -FOLLOWS => {
                format!(
                    "; it falls where {taxels} rises, so one of the two needs sign: -1: the one that falls under a press"
                )
            }
            _ => String::new(),
        };
        line(&mut text, 6, &printable(&format!("{field}: {} to {}{way}", number(*least), number(*most))));
    }
    text
}
