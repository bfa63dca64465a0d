//! The true force over time: stored as measured, then tared and interpolated at the stamps of frames.

use std::time::Duration;

use crate::config::TruthSource;
use crate::eval::{TareBuilder, TareCurve, TruthError, ZeroLoad};
use crate::fusion::{ForceUnit, split};
use crate::msg::binding::ForceReading;
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
    /// Normal forces, gF.
    forces: Vec<f64>,
    /// x y z in the frame of the patch, gF; empty for a sensor of one axis.
    vectors: Vec<[f64; 3]>,
    counters: TruthCounters,
}

/// The tares of the axes of a sensor with three: x y z in the frame of the patch.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisTares([TareCurve; 3]);

impl TruthTrack {
    /// A track without readings.
    pub fn new(source: TruthSource) -> Self {
        TruthTrack {
            source,
            stamps: Vec::new(),
            forces: Vec::new(),
            vectors: Vec::new(),
            counters: TruthCounters::default(),
        }
    }

    /// Takes a reading in the source's own unit.
    ///
    /// A force is finite if all of its axes are.
    pub fn handle_reading(&mut self, stamp: Stamp, reading: ForceReading) {
        let stamp = stamp.offset(self.source.stamp_offset_ns);
        if self.stamps.last().is_some_and(|newest| stamp <= *newest) {
            self.counters.late += 1;
            return;
        }
        let (force, vector) = self.source.force(reading);
        self.vectors.extend(vector.map(|vector| vector.map(|force| force.0)));
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

    /// The tares of the axes over time, from the stretches without load; `None` for a sensor of one axis.
    ///
    /// # Errors
    /// As [`TruthTrack::tare`].
    pub fn axis_tares(&self, zero_load: &[ZeroLoad]) -> Result<Option<AxisTares>, TruthError> {
        if self.vectors.is_empty() {
            return Ok(None);
        }
        let axis = |axis: usize| {
            let mut builder = TareBuilder::new(zero_load)?;
            let readings = self.stamps.iter().zip(&self.vectors);
            readings.for_each(|(stamp, force)| builder.handle_force(*stamp, GramForce(force[axis])));
            builder.finish()
        };
        Ok(Some(AxisTares([axis(0)?, axis(1)?, axis(2)?])))
    }

    /// The force at a stamp, untared, between the readings around it; `None` where they are further apart than
    /// `max_gap`, and before the first and after the last.
    pub fn at(&self, stamp: Stamp, max_gap: Duration) -> Option<GramForce> {
        self.between(stamp, max_gap, |idx| self.forces[idx]).map(GramForce)
    }

    /// The tangential force at a stamp, tared: x y z in the frame of the patch, perpendicular to its normal. `None` where
    /// [`TruthTrack::at`] has none, and for a sensor of one axis.
    pub fn tangential_at(&self, tares: &AxisTares, stamp: Stamp, max_gap: Duration) -> Option<[GramForce; 3]> {
        let normal = self.source.axes?.normal;
        let axis = |axis: usize| {
            let force = self.between(stamp, max_gap, |idx| self.vectors[idx][axis])?;
            // Newton only by name: a force is split alike in any unit.
            Some(Newton(tares.0[axis].tared(stamp, GramForce(force)).0))
        };
        let (_, tangential) = split(&normal, [axis(0)?, axis(1)?, axis(2)?]);
        Some(tangential.map(|force| GramForce(force.0)))
    }

    /// A value at a stamp, between those of the readings around it.
    fn between(&self, stamp: Stamp, max_gap: Duration, value: impl Fn(usize) -> f64) -> Option<f64> {
        let after = self.stamps.partition_point(|known| *known <= stamp);
        let before = after.checked_sub(1)?;
        let from = self.stamps[before];
        if from == stamp {
            return Some(value(before));
        }
        let to = *self.stamps.get(after)?;
        let span = to.nanos_since(from);
        if span > nanos(max_gap) {
            return None;
        }
        let share = stamp.nanos_since(from) as f64 / span as f64;
        Some(value(before) + (value(after) - value(before)) * share)
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
    use crate::config::TruthAxes;

    const GAP: Duration = Duration::from_nanos(50);

    fn track(readings: &[(i64, f64)], inverted: bool) -> TruthTrack {
        let source =
            TruthSource { name: "cell".into(), stamp_offset_ns: 5, inverted, unit: ForceUnit::GramForce, axes: None };
        let mut track = TruthTrack::new(source);
        readings.iter().for_each(|(stamp, force)| track.handle_reading(Stamp(*stamp), ForceReading::Normal(*force)));
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
            let source = TruthSource { name: "cell".into(), stamp_offset_ns: 0, inverted, unit, axes: None };
            let mut track = TruthTrack::new(source);
            let reading = |k: i64| if k >= 200 && k % 100 < 50 { press } else { 0.02 * (k % 3) as f64 };
            (0..1000).for_each(|k| track.handle_reading(Stamp(k), ForceReading::Normal(7.0 + reading(k))));
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

    #[test]
    fn three_axes_are_turned_to_the_hand_tared_each_and_split_at_the_normal() {
        // A cell of which x is the other way, under a patch that is pressed along -y.
        let normal = nalgebra::Unit::new_normalize(nalgebra::Vector3::new(0.0, -2.0, 0.0));
        let axes = Some(TruthAxes { inverted: [true, false, false], normal });
        let source =
            TruthSource { name: "cell".into(), stamp_offset_ns: 0, inverted: false, unit: ForceUnit::GramForce, axes };
        let mut track = TruthTrack::new(source);
        let zero = [7.0, 8.0, 9.0];
        let reading = |of: [f64; 3]| ForceReading::Axes(std::array::from_fn(|axis| zero[axis] + of[axis]));
        for (stamp, force) in [(0, [0.0; 3]), (10, [0.0; 3]), (20, [-3.0, -50.0, 4.0]), (40, [-5.0, -70.0, 8.0])] {
            track.handle_reading(Stamp(stamp), reading(force));
        }
        let zero_load = [ZeroLoad { from: Stamp(0), to: Stamp(15) }];
        let (tare, tares) = (track.tare(&zero_load).unwrap(), track.axis_tares(&zero_load).unwrap().unwrap());
        let forces = aligned(&track, &tare, &[Stamp(20), Stamp(30)], GAP);
        assert_eq!(forces, [Some(GramForce(50.0)), Some(GramForce(60.0))]);
        let across = |stamp| track.tangential_at(&tares, Stamp(stamp), GAP).map(|force| force.map(|force| force.0));
        assert_eq!([20, 30].map(across), [Some([3.0, 0.0, 4.0]), Some([4.0, 0.0, 6.0])]);
        assert_eq!(across(41), None);
        // One axis that is no number is no force.
        track.handle_reading(Stamp(50), reading([f64::NAN, 0.0, 0.0]));
        assert!(track.at(Stamp(50), GAP).unwrap().0.is_nan() && track.counters().non_finite == 1);
    }
}
