//! Finds the times at which nothing touches the glove, from the true force.

use std::time::Duration;

use crate::eval::{TareCurve, ZeroLoad};
use crate::recording::TruthTrack;
use crate::units::{GramForce, NANOS_PER_SEC, Newton, Stamp, nanos};

/// The true force must also be low for this time before and after. The clocks of glove and force sensor differ, and
/// taxels respond slightly before the force crosses the threshold and recover after it. Contacts are matched within
/// 0.15 s.
pub const MARGIN: Duration = Duration::from_millis(250);

/// Shorter spans are noise around the threshold.
const SHORTEST_NS: i64 = NANOS_PER_SEC / 5;

/// Maximum number of iterations for the tare. A drift of one threshold per minute is followed for an hour.
const ROUNDS: usize = 100;

/// The spans in which all these sensors are below a limit, in order of time.
///
/// # Errors
/// One line, if a sensor has no readings, is never low, or is never low together with the others.
pub(super) fn below(tracks: &[TruthTrack], limit: Newton, max_gap_ns: i64) -> Result<Vec<ZeroLoad>, String> {
    let mut free: Option<Vec<ZeroLoad>> = None;
    for track in tracks {
        let own = of_track(track, limit, max_gap_ns)?;
        free = Some(free.map_or_else(|| own.clone(), |free| common(&free, &own)));
    }
    let free = free.unwrap_or_default();
    if free.is_empty() {
        return Err(format!("the force sensors are never below {limit} together; give --in-air FROM..TO"));
    }
    Ok(free)
}

/// The spans in which one sensor is low.
///
/// The sensor's zero is not known in advance. The first estimate is the level at which it stays longest. Readings
/// within the limit of this level give a tare over time, which classifies the readings again, until nothing changes. In
/// this way a slow drift is followed.
fn of_track(track: &TruthTrack, limit: Newton, max_gap_ns: i64) -> Result<Vec<ZeroLoad>, String> {
    let limit_gf = GramForce::from(limit).0;
    let readings: Vec<(Stamp, f64)> = track.readings().map(|(stamp, force)| (stamp, force.0)).collect();
    let finite: Vec<f64> = readings.iter().map(|(_, force)| *force).filter(|force| force.is_finite()).collect();
    let name = track.name();
    let level = rest_level(finite, limit_gf).ok_or_else(|| format!("truth {name} has no finite readings"))?;
    let mut free = low(&readings, max_gap_ns, |_, force| (force - level).abs() < limit_gf);
    for _ in 0..ROUNDS {
        // Spans that are left have readings and don't overlap, so taring succeeds.
        let Ok(tare) = track.tare(&pieces(&free)) else { break };
        let is_low = |stamp: Stamp, force: f64| tared(&tare, stamp, force).abs() < limit_gf;
        let next = low(&readings, max_gap_ns, is_low);
        if next == free || next.is_empty() {
            break;
        }
        free = next;
    }
    if free.is_empty() {
        let margin = MARGIN.as_secs_f64();
        return Err(format!(
            "truth {name} never stays below {limit} of its rest for {:.1} s; give a force beyond its noise, which tpf inspect shows, or --in-air FROM..TO",
            2.0 * margin + SHORTEST_NS as f64 * 1e-9
        ));
    }
    Ok(free)
}

fn tared(tare: &TareCurve, stamp: Stamp, force: f64) -> f64 {
    tare.tared(stamp, GramForce(force)).0
}

/// Splits spans into parts of at most 10 s, so that the tare follows a drift within them.
fn pieces(free: &[ZeroLoad]) -> Vec<ZeroLoad> {
    let cut = |stretch: &ZeroLoad| {
        let (from, span) = (stretch.from, stretch.to.nanos_since(stretch.from));
        let n = span / super::LONGEST_NS + 1;
        (0..n).map(move |k| ZeroLoad { from: from.offset(k * (span / n)), to: from.offset((k + 1) * (span / n)) })
    };
    free.iter().flat_map(cut).collect()
}

/// Level of a sensor at rest. Candidates are levels with many readings within twice the limit. The result is the lowest
/// one with at least half as many readings as the maximum, because a long press is above the level at rest.
fn rest_level(mut forces: Vec<f64>, limit_gf: f64) -> Option<f64> {
    forces.sort_by(f64::total_cmp);
    let mut to = 0;
    let mut counts = Vec::with_capacity(forces.len());
    for (from, force) in forces.iter().enumerate() {
        while to < forces.len() && forces[to] - force < 2.0 * limit_gf {
            to += 1;
        }
        counts.push(to - from);
    }
    let most = *counts.iter().max()?;
    let first = counts.iter().position(|count| 2 * count >= most)?;
    // The level with the most readings among those that overlap the first one.
    let reach = first + counts[first];
    let best = (first..reach).rev().max_by_key(|idx| counts[*idx])?;
    Some(forces[best + counts[best] / 2])
}

/// Runs of low readings, without a margin at either end. A run ends at a gap, because the force in a gap is unknown.
fn low(readings: &[(Stamp, f64)], max_gap_ns: i64, is_low: impl Fn(Stamp, f64) -> bool) -> Vec<ZeroLoad> {
    let margin = nanos(MARGIN);
    let mut free = Vec::new();
    let mut run: Option<(Stamp, Stamp)> = None;
    let mut close = |run: &mut Option<(Stamp, Stamp)>| {
        let Some((from, to)) = run.take() else { return };
        let stretch = ZeroLoad { from: from.offset(margin), to: to.offset(-margin) };
        if stretch.to.nanos_since(stretch.from) >= SHORTEST_NS {
            free.push(stretch);
        }
    };
    for (stamp, force) in readings {
        if run.is_some_and(|(_, last)| stamp.nanos_since(last) > max_gap_ns) {
            close(&mut run);
        }
        if is_low(*stamp, *force) {
            run = Some((run.map_or(*stamp, |(from, _)| from), *stamp));
        } else {
            close(&mut run);
        }
    }
    close(&mut run);
    free
}

/// Intersection of two lists of spans.
fn common(a: &[ZeroLoad], b: &[ZeroLoad]) -> Vec<ZeroLoad> {
    let mut both = Vec::new();
    let (mut i, mut k) = (0, 0);
    while let (Some(one), Some(other)) = (a.get(i), b.get(k)) {
        let (from, to) = (one.from.max(other.from), one.to.min(other.to));
        if from < to {
            both.push(ZeroLoad { from, to });
        }
        if one.to < other.to { i += 1 } else { k += 1 }
    }
    both
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::TruthSource;
    use crate::fusion::ForceUnit;
    use crate::msg::binding::ForceReading;

    const MS: i64 = 1_000_000;

    /// Readings at 100 Hz.
    fn track(seconds: i64, force: impl Fn(f64) -> f64) -> TruthTrack {
        let source = TruthSource {
            name: "cell".into(),
            stamp_offset_ns: 0,
            inverted: false,
            unit: ForceUnit::Newton,
            axes: None,
        };
        let mut track = TruthTrack::new(source);
        (0..seconds * 100)
            .for_each(|k| track.handle_reading(Stamp(k * 10 * MS), ForceReading::Normal(force(k as f64 / 100.0))));
        track
    }

    fn seconds(free: &[ZeroLoad]) -> Vec<(f64, f64)> {
        free.iter().map(|free| (free.from.0 as f64 * 1e-9, free.to.0 as f64 * 1e-9)).collect()
    }

    #[test]
    fn a_force_that_is_low_is_in_the_air_but_for_the_margin_whatever_its_zero() {
        let press = |t: f64| if (4.0..6.0).contains(&t) { 2.0 } else { 0.0 };
        for zero in [0.0, 3.0, -40.0] {
            let found = below(&[track(10, |t| zero + press(t))], Newton(0.05), 100 * MS).unwrap();
            assert_eq!(seconds(&found), [(0.25, 3.74), (6.25, 9.74)], "{zero}");
        }
    }

    #[test]
    fn a_press_that_is_held_longer_than_the_rest_is_still_a_press() {
        let press = |t: f64| if (4.0..9.0).contains(&t) { 2.0 } else { 0.0 };
        let found = below(&[track(10, |t| 5.0 + press(t))], Newton(0.05), 100 * MS).unwrap();
        assert_eq!(seconds(&found), [(0.25, 3.74), (9.25, 9.74)]);
    }

    #[test]
    fn a_drift_of_many_times_the_limit_is_followed() {
        let force = |t: f64| 1e-3 * t + if t % 20.0 > 15.0 { 1.5 } else { 0.0 };
        let found = below(&[track(600, force)], Newton(0.03), 100 * MS).unwrap();
        let total: f64 = seconds(&found).iter().map(|(from, to)| to - from).sum();
        assert!((total - 30.0 * 14.5).abs() < 3.0, "{total}");
        assert!(found.iter().all(|free| (free.to.0 as f64 * 1e-9) % 20.0 < 15.0));
    }

    #[test]
    fn a_gap_is_not_in_the_air_and_several_sensors_must_agree() {
        let source = |idle: std::ops::Range<i64>| {
            let all = track(10, |_| 1.0);
            let source = TruthSource {
                name: "b".into(),
                stamp_offset_ns: 0,
                inverted: false,
                unit: ForceUnit::Newton,
                axes: None,
            };
            let mut track = TruthTrack::new(source);
            all.readings()
                .filter(|(stamp, _)| !idle.contains(&(stamp.0 / MS)))
                .for_each(|(stamp, _)| track.handle_reading(stamp, ForceReading::Normal(1.0)));
            track
        };
        let found = below(&[source(3000..5000), source(8000..9000)], Newton(0.05), 100 * MS).unwrap();
        assert_eq!(seconds(&found), [(0.25, 2.74), (5.25, 7.74), (9.25, 9.74)]);
    }

    #[test]
    fn a_limit_within_the_noise_is_refused_by_the_name_of_the_sensor() {
        let noisy = track(10, |t| 1.0 + if (t * 100.0) as i64 % 2 == 0 { 0.3 } else { -0.3 });
        let error = below(&[noisy], Newton(0.01), 100 * MS).unwrap_err();
        assert!(error.starts_with("truth cell never stays below 0.01 N of its rest for 0.7 s"), "{error}");
        assert!(below(&[track(0, |_| 0.0)], Newton(0.01), 100 * MS).unwrap_err().contains("no finite readings"));
    }
}
