//! Results as a person reads them at a terminal.

use std::fmt::Write as _;

use tactile_pose_fusion::characterization::{Characterized, RegionResult, SessionSummary};
use tactile_pose_fusion::characterize::{
    ArtifactSize, ClassCurve, LeftInAir, OWN_LAG_MS, RegionReport, Spread, Untold,
};

use crate::report::terminal;

/// Joints that the table shows: those that move most with the taxels, and all that are suggested.
const N_JOINTS: usize = 8;

/// All results, region by region.
pub fn text(result: &Characterized) -> String {
    let mut text = String::new();
    result.sessions.iter().for_each(|session| heading(&mut text, session));
    for missing in &result.missing {
        let _ = writeln!(text, "missing: {missing}");
    }
    for joint in &result.joints_left_out {
        let _ = writeln!(text, "joint left out: {joint}");
    }
    result.regions.iter().for_each(|region| self::region(&mut text, region));
    let _ = write!(text, "\nParameters\n\n{}", result.parameters);
    text
}

fn heading(text: &mut String, session: &SessionSummary) {
    let SessionSummary { name, glove, user, in_air, zero, .. } = session;
    let synthetic = if session.synthetic { "SYNTHETIC data: " } else { "" };
    let _ = writeln!(text, "{synthetic}{name}, glove {glove}, user {user}; in the air by {in_air}, zero by {zero}");
    for (kind, sources) in [("tactile", &session.tactile), ("joints", &session.joints)] {
        for source in sources {
            let Some(timing) = source.timing else { continue };
            let _ = writeln!(
                text,
                "  {kind} {}: {:.1} Hz, jitter {:.2} ms, longest interval {:.0} ms, {} gaps",
                source.source, timing.rate_hz, timing.jitter_ms, timing.interval_max_ms, timing.n_gaps
            );
        }
    }
}

fn region(text: &mut String, result: &RegionResult) {
    let report = &result.report;
    let minutes = |seconds: f64| seconds / 60.0;
    let in_air: f64 = report.sessions.iter().map(|session| session.in_air_s).sum();
    let all: f64 = report.sessions.iter().map(|session| session.seconds).sum();
    let _ = writeln!(
        text,
        "\nRegion {}: {} taxels, {} joints; {:.1} of {:.1} minutes in the air, {} loaded frames with a known force",
        result.region,
        report.n_taxels,
        report.joints.len(),
        minutes(in_air),
        minutes(all),
        report.sessions.iter().map(|session| session.n_loaded).sum::<usize>()
    );
    joints(text, report);
    response(text, report);
    artifact(text, report);
    following(text, report);
    rest(text, report);
    offset(text, report);
}

/// The artifact that is left, step by step, in words and numbers for a table.
pub(super) fn left_in_air(left: &LeftInAir) -> [(&'static str, f64); 6] {
    [
        ("as read, above the zero", left.as_read),
        ("less a map of pose, the same for all donnings", left.fixed_map),
        ("  and an offset of the donning", left.with_offset),
        ("less a map with the donning's own gains and offsets", left.with_gains),
        ("  as a calibration of 10 s finds them", left.calibrated),
        ("  and followed while the glove is worn", left.followed),
    ]
}

/// Advice to the user.
pub(super) fn advice(left: &LeftInAir) -> &'static str {
    let share = left.explained(left.followed);
    if share < 0.5 {
        "Following the artifact leaves most of it: look at the joints, their clock and their rate, before training --kind adaptive."
    } else if left.followed < 0.8 * left.fixed_map {
        "Following it leaves clearly less than a map that is the same for all donnings: train --kind adaptive."
    } else {
        "A fixed map of pose does nearly as well: --kind adaptive gains little on this glove."
    }
}

fn following(text: &mut String, report: &RegionReport) {
    let Some(left) = &report.following.all else {
        report.following.missing.iter().for_each(|missing| {
            let _ = writeln!(text, "\n{missing}");
        });
        return;
    };
    let _ = writeln!(
        text,
        "\nWhat is left of the artifact in the air, by {}; each donning by shapes of the others (root mean square, units of the sensor)\n",
        report.following.joints.join(", ")
    );
    let mut table = terminal::table(["Taxels", "Left", "Explained"]);
    for (what, value) in left_in_air(left) {
        let share = left.explained(value);
        table.add_row([what.to_owned(), format!("{value:.1}"), percent(Some(share))]);
    }
    let _ = writeln!(text, "{}\n{}", terminal::shown(&table, 1), advice(left));
}

fn joints(text: &mut String, report: &RegionReport) {
    let (correlation, selection) = (&report.correlation, &report.selection);
    let _ = writeln!(
        text,
        "\nWhich joints move the taxels in the air (absolute correlation r of changes over {} s; share of held-out changes that is explained)\n",
        correlation.span_s
    );
    let mut table =
        terminal::table(["Joint", "r, mean of taxels", "r by taxel", "Explains alone", "Chosen", "Adds", "Range rad"]);
    let ranked = correlation.ranked();
    let chosen = selection.chosen_idxs();
    let is_shown =
        |joint: &usize| ranked.iter().position(|idx| idx == joint) < Some(N_JOINTS) || chosen.contains(joint);
    for joint in ranked.iter().copied().filter(is_shown) {
        let by_taxel: Vec<String> = correlation.by_taxel[joint]
            .iter()
            .map(|r| r.map_or("-".to_owned(), |r| format!("{:.2}", r.abs())))
            .collect();
        let step = chosen.iter().position(|idx| *idx == joint);
        let range = report.pose_range.iter().find(|range| range.joint == report.joints[joint]);
        table.add_row([
            report.joints[joint].clone(),
            number(correlation.mean_abs[joint]),
            if by_taxel.len() <= N_JOINTS { by_taxel.join(" ") } else { "see --json".to_owned() },
            percent(selection.alone[joint]),
            step.map_or(String::new(), |step| (step + 1).to_string()),
            step.map_or(String::new(), |step| percent(Some(selection.chosen[step].gain))),
            range.map_or(String::new(), |range| format!("{:.2} to {:.2}", range.min, range.max)),
        ]);
    }
    let _ = writeln!(text, "{}", terminal::shown(&table, 1));
    match selection.chosen.last() {
        Some(last) => {
            let next = selection
                .next
                .as_ref()
                .map_or(String::new(), |next| format!("; {} next would add {}", next.joint, percent(Some(next.gain))));
            let _ = writeln!(
                text,
                "Chosen joints explain {} of the artifact, all joints {}{next}; one is chosen for at least {}",
                percent(Some(last.explained)),
                percent(selection.all),
                percent(Some(selection.min_gain))
            );
        }
        None => {
            let _ =
                writeln!(text, "No joint explains {} of what is read in the air", percent(Some(selection.min_gain)));
        }
    }
}

fn response(text: &mut String, report: &RegionReport) {
    let Some(response) = &report.response else { return };
    let _ = writeln!(
        text,
        "\nResponse to force: median reading of all taxels together, and what the touch adds to that of the pose. The bend score \
         is the mix of the chosen joints that moves the taxels most: low is the straight hand, high the bent one\n"
    );
    let mut table = terminal::table(["Force N", "All poses", "Bend score low", "middle", "high"]);
    for point in &response.all.points {
        let cell = |class: &ClassCurve| {
            let same = class.points.iter().find(|other| other.from_gf == point.from_gf);
            same.map_or("-".to_owned(), |same| format!("{:.0} ({:+.0})", same.sum, same.rise))
        };
        let mut row = vec![format!("{:.2}", point.force_n), cell(&response.all)];
        row.extend(response.by_bend.iter().map(cell));
        table.add_row(row);
    }
    let mut row = vec!["touches".to_owned(), response.all.n_touches.to_string()];
    row.extend(response.by_bend.iter().map(|class| class.n_touches.to_string()));
    table.add_row(row);
    let _ = writeln!(text, "{}", terminal::shown(&table, 1));
    let gain = response
        .gain
        .map_or("not known: too few touches, or forces in common".to_owned(), |gain| spread(Some(gain), "", 2));
    let slopes = Spread::of(response.gain_by_session.iter().map(|gain| gain.of_slopes));
    let slopes = slopes.map_or(String::new(), |slopes| format!("; ratio of slopes {}", spread(Some(slopes), "", 2)));
    let _ = writeln!(text, "What a touch adds at a high bend score over a low one, at equal force: {gain}{slopes}");
}

fn artifact(text: &mut String, report: &RegionReport) {
    let _ = writeln!(
        text,
        "\nArtifact: readings in the air away from the straight hand's, and the tap that reads as much\n"
    );
    let mut table = terminal::table(["Pose", "Time s", "Median", "p95", "Median N (gF)", "p95 N (gF)"]);
    let mut row = |pose: &str, seconds: f64, size: &ArtifactSize| {
        let force = |newtons: Option<Spread>, grams: Option<Spread>| match (newtons, grams) {
            (Some(newtons), Some(grams)) => format!("{:.2} ({:.0})", newtons.median, grams.median),
            _ if size.n_beyond > 0 => "above all taps".to_owned(),
            _ => "-".to_owned(),
        };
        table.add_row([
            pose.to_owned(),
            format!("{seconds:.0}"),
            size.median.map_or("-".to_owned(), |median| format!("{:.0}", median.median)),
            size.p95.map_or("-".to_owned(), |p95| format!("{:.0}", p95.median)),
            force(size.median_n, size.median_gf),
            force(size.p95_n, size.p95_gf),
        ]);
    };
    let movement = &report.artifact.movement;
    row("all movement in the air", report.sessions.iter().map(|session| session.in_air_s).sum(), movement);
    report.artifact.by_pose.iter().for_each(|pose| row(&pose.pose, pose.seconds, &pose.size));
    let _ = writeln!(text, "{}", terminal::shown(&table, 1));
    if movement.p95_n.is_some_and(|spread| spread.n_sessions > 1) {
        let _ = writeln!(text, "From session to session, p95 of all movement: {}", spread(movement.p95_n, " N", 2));
    }
}

fn rest(text: &mut String, report: &RegionReport) {
    let (hysteresis, drift, noise) = (&report.hysteresis, &report.drift, &report.noise);
    let of_100 = |share: Option<Spread>, unit: &str| {
        let spread = share.map(|s| Spread { median: 100.0 * s.median, min: 100.0 * s.min, max: 100.0 * s.max, ..s });
        self::spread(spread, unit, 1)
    };
    let _ = writeln!(text, "\nHysteresis and lag of the artifact: {}", of_100(hysteresis.artifact, " % of its range"));
    let touch = match hysteresis.touch {
        None => "not known: too few touches that rise and fall slowly".to_owned(),
        touch => format!("unloading reads {} more than loading", of_100(touch, " %")),
    };
    let _ = writeln!(text, "Hysteresis of touch: {touch}");
    let largest = drift.largest_n.map_or(String::new(), |n| format!(", as a tap of {}", spread(Some(n), " N", 2)));
    let _ = match drift.per_min {
        None => writeln!(text, "Drift at rest: not known, the hand was rarely still in the air"),
        per_min => writeln!(
            text,
            "Drift at rest: {}, at most {} from the median{largest}",
            spread(per_min, " a minute", 1),
            spread(drift.largest, "", 0)
        ),
    };
    let tare = Spread::of(drift.by_session.iter().map(|session| session.truth_range_gf));
    if tare.is_some() {
        let _ = writeln!(text, "Drift of the force sensor: {} over a session", spread(tare, " gF", 1));
    }
    let _ = writeln!(text, "Noise of a taxel: sd {}", spread(noise.sd, "", 2));
    let dead = noise.by_taxel.iter().filter(|taxel| taxel.n_dead > 0);
    let stuck = noise.by_taxel.iter().filter(|taxel| taxel.saturated_share > 0.0);
    let list = |taxels: Vec<usize>| match taxels.is_empty() {
        true => "none".to_owned(),
        false => taxels.iter().map(usize::to_string).collect::<Vec<_>>().join(", "),
    };
    let (dead, stuck) = (dead.map(|taxel| taxel.taxel).collect(), stuck.map(|taxel| taxel.taxel).collect());
    let _ = writeln!(text, "Dead taxels: {}; saturated taxels: {}", list(dead), list(stuck));
}

fn offset(text: &mut String, report: &RegionReport) {
    let peaks = Spread::of(report.offset.by_session.iter().map(|session| session.peak));
    let peak = spread(peaks, "", 2);
    let [own_low, own_high] = OWN_LAG_MS;
    let rounded = |interval: [f64; 2]| interval.map(|ms| ms.round() + 0.0); // no "-0"
    let _ = match (
        report.offset.lag_ms,
        report.offset.interval_ms.map(rounded),
        report.offset.clock_offset_ms.map(rounded),
    ) {
        (Some(lag), Some([low, high]), Some([clock_low, clock_high])) => {
            let advice = match clock_low <= 0.0 && clock_high >= 0.0 {
                true => "0 is in this range, so nothing needs to be corrected".to_owned(),
                false => format!(
                    "correct it by stamp_offset_ms of the tactile source, {:.0} to {:.0}",
                    -clock_high, -clock_low
                ),
            };
            writeln!(
                text,
                "Taxels lag the joints by {} (95 % interval {low:.0} to {high:.0} ms, correlation {peak}). The sensor itself \
             causes {own_low:.0} to {own_high:.0} ms of it, so stamps of the taxels are {clock_low:.0} to {clock_high:.0} ms late: {advice}",
                spread(Some(lag), " ms", 1)
            )
        }
        _ => {
            let why = report.offset.by_session.iter().find_map(|session| session.untold);
            let why = why.map_or_else(String::new, |why| format!("{why}; "));
            writeln!(
                text,
                "Clock offset of joints and taxels: these movements don't tell it: {why}to find it, {}",
                Untold::REMEDY
            )
        }
    };
}

fn number(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.2}"))
}

fn percent(share: Option<f64>) -> String {
    share.map_or("-".to_owned(), |share| format!("{:.1} %", 100.0 * share))
}

/// Median, and from where to where sessions differ.
fn spread(spread: Option<Spread>, unit: &str, decimals: usize) -> String {
    match spread {
        None => "not known".to_owned(),
        Some(Spread { median, n_sessions: 0 | 1, .. }) => format!("{median:.decimals$}{unit}"),
        Some(Spread { median, min, max, .. }) => {
            format!("{median:.decimals$}{unit} ({min:.decimals$} to {max:.decimals$})")
        }
    }
}
