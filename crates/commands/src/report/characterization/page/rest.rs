//! Lag of the taxels, and the sensor at rest.

use tactile_pose_fusion::characterization::RegionResult;

use super::header;
use crate::page::{Cell, Figure, Page, Style, Table};

pub(super) fn lag(page: &mut Page, result: &RegionResult) {
    let RegionResult { region, report, .. } = result;
    let (hysteresis, offset) = (&report.hysteresis, &report.offset);
    let section = page.section(&format!("{region}-lag"), &format!("Region {region}: hysteresis and clocks"));
    section.text(
        "Whatever delays the taxels widens the loop of the artifact and moves the peak of the lag: friction, creep, the \
         sensor's filter, and clocks that are apart. A lag of some 10 ms is most often the sensor's own.",
    );
    let mut sweep = Figure::new(
        &format!("{region}-loop"),
        "Mean reading in the air over the bend score, while it rises and while it falls.",
        "bend score",
        "reading, sensor's unit",
    );
    for (direction, name) in [(1, "bending"), (2, "straightening")] {
        let of = |column: usize| hysteresis.artifact_loop.iter().map(|point| point[column]).collect();
        sweep.line(name, of(0), of(direction), Style::of(direction - 1).marked());
    }
    section.figure(&sweep);
    let mut lags = Figure::new(
        &format!("{region}-lags"),
        "Correlation of the change of readings with what the motion of joints some time before makes of it.",
        "lag of the taxels, ms",
        "correlation",
    );
    for (idx, session) in offset.by_session.iter().enumerate() {
        let lag = session.curve.iter().map(|point| point.lag_ms).collect();
        lags.line(&session.session, lag, session.curve.iter().map(|point| point.correlation).collect(), Style::of(idx));
    }
    section.figure(&lags);
    let rows = hysteresis.by_session.iter().zip(&offset.by_session).map(|(hysteresis, offset)| {
        let percent = |share: Option<f64>| Cell::maybe(share.map(|share| 100.0 * share), 1);
        vec![
            hysteresis.session.as_str().into(),
            percent(hysteresis.artifact),
            Cell::count(hysteresis.n_sweeps.iter().sum::<usize>() as u64),
            percent(hysteresis.touch),
            Cell::maybe(offset.lag_ms, 1),
            match (offset.interval_ms, offset.untold) {
                (Some([low, high]), _) => format!("{low:.0} to {high:.0}").into(),
                (None, why) => why.map_or_else(String::new, |why| why.to_string()).into(),
            },
            Cell::maybe(offset.peak, 2),
        ]
    });
    section.table(&Table {
        id: format!("{region}-lag-table"),
        caption: "By session; a lag is told where its peak is high, sharp and single".to_owned(),
        header: header([
            "Session",
            "Artifact's loop, % of range",
            "Sweeps",
            "Unloading over loading, %",
            "Lag ms",
            "95 % within, ms",
            "Correlation",
        ]),
        rows: rows.collect(),
    });
}

pub(super) fn at_rest(page: &mut Page, result: &RegionResult) {
    let RegionResult { region, taxels, report, .. } = result;
    let (drift, noise) = (&report.drift, &report.noise);
    let section = page.section(&format!("{region}-rest"), &format!("Region {region}: drift and noise"));
    section.text(&format!(
        "Drift is the reading of all taxels while no chosen joint turns faster than {} rad/s in the air, less what the pose \
         explains. Noise is that of neighbouring frames at rest.",
        drift.rest_rad_s
    ));
    let mut wander = Figure::new(
        &format!("{region}-drift"),
        "Reading at rest over each session.",
        "time, min",
        "reading, sensor's unit",
    );
    for (idx, session) in drift.by_session.iter().enumerate() {
        let minutes: Vec<f64> = session.at_rest.iter().map(|(at_s, _)| at_s / 60.0).collect();
        let readings: Vec<f64> = session.at_rest.iter().map(|(_, reading)| *reading).collect();
        wander.time_line(&session.session, &minutes, &readings, Style::of(idx).marked());
    }
    section.figure(&wander);
    let rows = drift.by_session.iter().map(|session| {
        let figures =
            [(session.per_min, 1), (session.largest, 0), (session.largest_gf, 1), (session.truth_range_gf, 1)];
        let cells = figures.map(|(figure, digits)| Cell::maybe(figure, digits));
        [Cell::from(session.session.as_str())].into_iter().chain(cells).collect()
    });
    section.table(&Table {
        id: format!("{region}-drift-table"),
        caption: "Drift by session".to_owned(),
        header: header(["Session", "A minute", "Largest", "Largest as a tap, gF", "Tare of the force sensor, gF"]),
        rows: rows.collect(),
    });
    let rows = noise.by_taxel.iter().map(|taxel| {
        vec![
            format!("taxel {}", taxels[taxel.taxel]).into(),
            Cell::maybe(taxel.sd.map(|sd| sd.median), 2),
            Cell::count(taxel.n_dead as u64),
            Cell { text: format!("{:.1} %", 100.0 * taxel.saturated_share), value: Some(taxel.saturated_share) },
        ]
    });
    section.table(&Table {
        id: format!("{region}-noise-table"),
        caption: "Noise by taxel".to_owned(),
        header: header([
            "Taxel",
            "Standard deviation",
            "Sessions in which it never changed",
            "Time at the end of its range",
        ]),
        rows: rows.collect(),
    });
}
