//! The true force over time: stored as measured, then tared and interpolated at the stamps of frames.

use std::time::Duration;

use crate::config::TruthSource;
use crate::eval::{TareBuilder, TareCurve, TruthError, ZeroLoad};
use crate::fusion::ForceUnit;
use crate::units::{GramForce, Newton, Stamp, nanos};

/// Counts of a force sensor's readings.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TruthCounters {
    /// Readings in use.
    pub used: u64,
    /// Readings that were dropped because they are not newer than the one before.
    pub late: u64,
    /// Readings in use that are NaN or infinite.
    pub non_finite: u64,
}

/// Readings of one force sensor.
#[derive(Debug, Clone)]
pub struct TruthTrack {
    source: TruthSource,
    stamps: Vec<Stamp>,
    forces: Vec<f64>,
    counters: TruthCounters,
}

impl TruthTrack {
    /// A track without readings.
    pub fn new(source: TruthSource) -> Self {
        TruthTrack { source, stamps: Vec::new(), forces: Vec::new(), counters: TruthCounters::default() }
    }

    /// Adds a reading in the source's unit.
    pub fn handle_reading(&mut self, stamp: Stamp, reading: f64) {
        let stamp = stamp.offset(self.source.stamp_offset_ns);
        if self.stamps.last().is_some_and(|newest| stamp <= *newest) {
            self.counters.late += 1;
            return;
        }
        let force = self.source.force(reading);
        self.counters.used += 1;
        self.counters.non_finite += u64::from(!force.0.is_finite());
        self.stamps.push(stamp);
        self.forces.push(force.0);
    }

    /// Counts of the readings.
    pub fn counters(&self) -> TruthCounters {
        self.counters
    }

    /// Name of the source in the parameters.
    pub fn name(&self) -> &str {
        &self.source.name
    }

    /// The readings in use, before taring.
    pub fn readings(&self) -> impl Iterator<Item = (Stamp, GramForce)> {
        self.stamps.iter().copied().zip(self.forces.iter().map(|force| GramForce(*force)))
    }

    /// Stamps of the first and the last reading.
    pub fn span(&self) -> Option<(Stamp, Stamp)> {
        Some((*self.stamps.first()?, *self.stamps.last()?))
    }

    /// The tare over time, from the spans without load.
    ///
    /// # Errors
    /// [`TruthError`] if spans overlap, or if none has a reading.
    pub fn tare(&self, zero_load: &[ZeroLoad]) -> Result<TareCurve, TruthError> {
        let mut builder = TareBuilder::new(zero_load)?;
        self.readings().for_each(|(stamp, force)| builder.handle_force(stamp, force));
        builder.finish()
    }

    /// The untared force at a stamp, interpolated between the readings around it. `None` if these are further apart
    /// than `max_gap`, before the first reading and after the last one.
    pub fn at(&self, stamp: Stamp, max_gap: Duration) -> Option<GramForce> {
        let after = self.stamps.partition_point(|known| *known <= stamp);
        let before = after.checked_sub(1)?;
        let (from, force) = (self.stamps[before], self.forces[before]);
        if from == stamp {
            return Some(GramForce(force));
        }
        let (to, next) = (*self.stamps.get(after)?, self.forces[after]);
        let span = to.nanos_since(from);
        if span > nanos(max_gap) {
            return None;
        }
        let share = stamp.nanos_since(from) as f64 / span as f64;
        Some(GramForce(force + (next - force) * share))
    }
}

/// A hand can't press with more tared force than this, gF: 300 N.
const MOST_PRESSED_GF: f64 = 30_000.0;
/// A recording with presses has more tared force than this, gF: 0.3 N.
const LEAST_PRESSED_GF: f64 = 30.0;
/// Drift and noise that a load cell may have without a doubt, gF, by the unit in the parameters. For gF and mN they are
/// small, because a cell that sends N then seems to have little noise.
const DRIFT_GF: [(ForceUnit, f64); 4] = [
    (ForceUnit::Newton, 15.0),
    (ForceUnit::KilogramForce, 15.0),
    (ForceUnit::GramForce, 0.5),
    (ForceUnit::Millinewton, 0.05),
];
/// Share of readings at either end of the range that is ignored.
const OUTLIERS: f64 = 0.002;
/// Minimum number of readings for these checks.
const FEW: usize = 100;

impl TruthTrack {
    /// Doubts about the readings: negative presses, or a unit in which no hand presses so strongly or so weakly. Each
    /// is one line that names the parameter.
    pub fn doubts(&self, tare: &TareCurve) -> Vec<String> {
        let tared = self.readings().map(|(stamp, force)| tare.tared(stamp, force).0);
        let mut forces: Vec<f64> = tared.filter(|force| force.is_finite()).collect();
        if forces.len() < FEW {
            return Vec::new();
        }
        forces.sort_by(f64::total_cmp);
        let outliers = (OUTLIERS * forces.len() as f64) as usize;
        let (low, high) = (forces[outliers], forces[forces.len() - 1 - outliers]);
        let TruthSource { name, unit, inverted, .. } = &self.source;
        let drift = DRIFT_GF.iter().find(|(of, _)| of == unit).map_or(0.0, |(_, drift)| *drift);
        let mut doubts = Vec::new();
        if low < -drift && -low > 3.0 * high {
            let sign = if *inverted { 1 } else { -1 };
            doubts.push(format!(
                "truth {name}: the force falls to {low:.1} gF and rises to {high:.1} gF at most: a press seems to be negative; set truth.{name}.sign to {sign}"
            ));
        }
        let most = high.max(-low);
        match unit {
            ForceUnit::Newton if most > MOST_PRESSED_GF => doubts.push(format!(
                "truth {name}: the force reaches {:.0} N, which no hand presses; set truth.{name}.unit to gF if that is what it sends, or have its driver send N",
                most / GramForce::from(Newton(1.0)).0
            )),
            ForceUnit::KilogramForce if most > MOST_PRESSED_GF => doubts.push(format!(
                "truth {name}: the force reaches {:.0} kgf, which no hand presses; set truth.{name}.unit to gF or N if that is what it sends",
                1e-3 * most
            )),
            ForceUnit::GramForce | ForceUnit::Millinewton if most > drift && most < LEAST_PRESSED_GF => doubts.push(format!(
                "truth {name}: the force never leaves {low:.2} to {high:.2} gF: that looks like N; set truth.{name}.unit to N"
            )),
            _ => {}
        }
        doubts
    }
}

/// The tared true force at each stamp. `None` if no reading is close enough, NaN if the reading is NaN.
pub fn aligned(track: &TruthTrack, tare: &TareCurve, stamps: &[Stamp], max_gap: Duration) -> Vec<Option<GramForce>> {
    stamps.iter().map(|stamp| track.at(*stamp, max_gap).map(|force| tare.tared(*stamp, force))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAP: Duration = Duration::from_nanos(50);

    fn track(readings: &[(i64, f64)], inverted: bool) -> TruthTrack {
        let source = TruthSource { name: "cell".into(), stamp_offset_ns: 5, inverted, unit: ForceUnit::GramForce };
        let mut track = TruthTrack::new(source);
        readings.iter().for_each(|(stamp, force)| track.handle_reading(Stamp(*stamp), *force));
        track
    }

    #[test]
    fn between_readings_the_force_is_interpolated_and_across_a_gap_it_is_unknown() {
        let track = track(&[(0, 10.0), (20, 30.0), (100, 50.0), (120, f64::NAN)], false);
        let at = |stamp| track.at(Stamp(stamp), GAP).map(|force| force.0);
        assert_eq!([4, 5, 15, 25, 26, 105].map(at), [None, Some(10.0), Some(20.0), Some(30.0), None, Some(50.0)]);
        assert!(at(110).unwrap().is_nan());
        assert_eq!(at(126), None);
    }

    #[test]
    fn readings_out_of_order_are_dropped_and_counted() {
        let track = track(&[(0, 1.0), (20, 2.0), (10, 9.0), (20, 9.0), (30, f64::NAN)], true);
        assert_eq!(track.counters(), TruthCounters { used: 3, late: 2, non_finite: 1 });
        assert_eq!(track.at(Stamp(15), GAP), Some(GramForce(-1.5)), "a lower reading means more pressure");
    }

    #[test]
    fn a_press_that_is_negative_and_a_unit_nobody_presses_in_are_doubted_by_the_name_of_the_parameter() {
        let doubts = |unit: ForceUnit, inverted: bool, press: f64| {
            let source = TruthSource { name: "cell".into(), stamp_offset_ns: 0, inverted, unit };
            let mut track = TruthTrack::new(source);
            let reading = |k: i64| if k >= 200 && k % 100 < 50 { press } else { 0.02 * (k % 3) as f64 };
            (0..1000).for_each(|k| track.handle_reading(Stamp(k), 7.0 + reading(k)));
            let tare = track.tare(&[ZeroLoad { from: Stamp(0), to: Stamp(200) }]).unwrap();
            track.doubts(&tare)
        };
        let none: [String; 0] = [];
        assert_eq!(doubts(ForceUnit::Newton, false, 6.0), none);
        assert_eq!(doubts(ForceUnit::Newton, true, -6.0), none);
        assert_eq!(doubts(ForceUnit::GramForce, false, 600.0), none);
        assert_eq!(doubts(ForceUnit::Newton, false, 0.0), none, "nobody presses");
        assert!(doubts(ForceUnit::Newton, false, -6.0)[0].ends_with("set truth.cell.sign to -1"));
        assert!(doubts(ForceUnit::Newton, true, 6.0)[0].ends_with("set truth.cell.sign to 1"));
        assert!(doubts(ForceUnit::GramForce, false, 6.0)[0].ends_with("set truth.cell.unit to N"));
        assert!(doubts(ForceUnit::Newton, false, 600.0)[0].contains("set truth.cell.unit to gF"));
        assert_eq!(doubts(ForceUnit::KilogramForce, false, 0.6), none);
        assert_eq!(doubts(ForceUnit::Millinewton, false, 6000.0), none);
        assert!(doubts(ForceUnit::KilogramForce, false, 600.0)[0].contains("set truth.cell.unit to gF or N"));
        assert!(doubts(ForceUnit::Millinewton, false, 6.0)[0].ends_with("set truth.cell.unit to N"));
        let both = doubts(ForceUnit::GramForce, false, -6.0);
        assert!(both.len() == 2 && both[0].contains("sign to -1") && both[1].contains("unit to N"), "{both:?}");
    }

    #[test]
    fn taring_takes_the_drift_out() {
        let track = track(&[(0, 5.0), (10, 5.0), (20, 106.0), (30, 7.0), (40, 7.0)], false);
        let at = |from, to| ZeroLoad { from: Stamp(from), to: Stamp(to) };
        let tare = track.tare(&[at(0, 20), at(30, 50)]).unwrap();
        let forces = aligned(&track, &tare, &[Stamp(10), Stamp(25), Stamp(40)], GAP);
        assert_eq!(forces, [Some(GramForce(0.0)), Some(GramForce(100.0)), Some(GramForce(0.0))]);
    }
}
