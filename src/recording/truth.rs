//! The true force over time: kept as it was measured, then tared and read at the stamps of frames.

use std::time::Duration;

use crate::config::TruthSource;
use crate::eval::{TareBuilder, TareCurve, TruthError, ZeroLoad};
use crate::units::{GramForce, Stamp, nanos};

/// What became of the readings of a force sensor.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TruthCounters {
    /// Readings that are used.
    pub used: u64,
    /// Readings dropped for being older than the one before.
    pub late: u64,
    /// Of those that are used, readings that are NaN or infinite.
    pub non_finite: u64,
}

/// The readings of one force sensor.
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

    /// Takes a reading in the source's own unit.
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

    /// What became of the readings.
    pub fn counters(&self) -> TruthCounters {
        self.counters
    }

    /// Name of the source in the parameters.
    pub fn name(&self) -> &str {
        &self.source.name
    }

    /// The readings that are used, untared.
    pub fn readings(&self) -> impl Iterator<Item = (Stamp, GramForce)> {
        self.stamps.iter().copied().zip(self.forces.iter().map(|force| GramForce(*force)))
    }

    /// Stamps of the first and the last reading.
    pub fn span(&self) -> Option<(Stamp, Stamp)> {
        Some((*self.stamps.first()?, *self.stamps.last()?))
    }

    /// The tare over time, from the stretches without load.
    ///
    /// # Errors
    /// [`TruthError`] when stretches overlap, or none holds a reading.
    pub fn tare(&self, zero_load: &[ZeroLoad]) -> Result<TareCurve, TruthError> {
        let mut builder = TareBuilder::new(zero_load)?;
        self.readings().for_each(|(stamp, force)| builder.handle_force(stamp, force));
        builder.finish()
    }

    /// The force at a stamp, untared, between the readings around it; `None` where they are further apart than
    /// `max_gap`, and before the first and after the last.
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

/// The tared true force at each stamp; `None` where none was measured close enough, NaN where what was measured is.
pub fn aligned(track: &TruthTrack, tare: &TareCurve, stamps: &[Stamp], max_gap: Duration) -> Vec<Option<GramForce>> {
    stamps.iter().map(|stamp| track.at(*stamp, max_gap).map(|force| tare.tared(*stamp, force))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fusion::ForceUnit;

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
    fn taring_takes_the_drift_out() {
        let track = track(&[(0, 5.0), (10, 5.0), (20, 106.0), (30, 7.0), (40, 7.0)], false);
        let at = |from, to| ZeroLoad { from: Stamp(from), to: Stamp(to) };
        let tare = track.tare(&[at(0, 20), at(30, 50)]).unwrap();
        let forces = aligned(&track, &tare, &[Stamp(10), Stamp(25), Stamp(40)], GAP);
        assert_eq!(forces, [Some(GramForce(0.0)), Some(GramForce(100.0)), Some(GramForce(0.0))]);
    }
}
