//! Converts force to reading and back.

/// Edges of the bins of true force, gF: narrow for light taps, and about a third of the force wide above.
pub(super) const EDGES_GF: [f64; 19] = [
    2.5, 10.0, 20.0, 35.0, 50.0, 75.0, 100.0, 150.0, 200.0, 275.0, 350.0, 450.0, 600.0, 800.0, 1000.0, 1400.0, 2000.0,
    3000.0, 5000.0,
];

/// Index of the bin of a force; `None` below the first and above the last.
pub(super) fn bin_of(force_gf: f64) -> Option<usize> {
    let after = EDGES_GF.partition_point(|edge| *edge <= force_gf);
    after.checked_sub(1).filter(|bin| bin + 1 < EDGES_GF.len())
}

/// Reading added by a force, as points by increasing force. It begins at zero force and zero reading.
#[derive(Debug, Clone, Default)]
pub(super) struct ForceCurve(Vec<(f64, f64)>);

impl ForceCurve {
    /// A curve through points (gF, reading) by increasing force; `None` for fewer than three.
    ///
    /// If a point lies below the one before it, because of noise or too few touches, the curve stays level.
    pub(super) fn through(points: impl IntoIterator<Item = (f64, f64)>) -> Option<Self> {
        let mut curve = vec![(0.0, 0.0)];
        for (force, reading) in points {
            let so_far = curve.last().map_or(0.0, |last: &(f64, f64)| last.1);
            curve.push((force, reading.max(so_far)));
        }
        (curve.len() > 3).then_some(ForceCurve(curve))
    }

    /// The force that adds this much to the reading, gF; `None` above the measured range.
    pub(super) fn force_gf(&self, reading: f64) -> Option<f64> {
        let after = self.0.partition_point(|point| point.1 < reading.max(0.0));
        let (force, at) = *self.0.get(after)?;
        let Some(&(from, below)) = after.checked_sub(1).and_then(|before| self.0.get(before)) else {
            return Some(force);
        };
        Some(from + (force - from) * (reading - below) / (at - below))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_force_is_found_between_points_and_none_above_them() {
        let curve = ForceCurve::through([(10.0, 100.0), (20.0, 90.0), (40.0, 300.0)]).unwrap();
        let forces = [-5.0, 0.0, 50.0, 100.0, 200.0, 300.0, 301.0].map(|reading| curve.force_gf(reading));
        assert_eq!(forces, [Some(0.0), Some(0.0), Some(5.0), Some(10.0), Some(30.0), Some(40.0), None]);
        assert!(ForceCurve::through([(10.0, 100.0), (20.0, 150.0)]).is_none());
    }

    #[test]
    fn bins_hold_their_lower_edge() {
        assert_eq!(
            [0.0, 2.5, 9.9, 10.0, 4999.0, 5000.0].map(bin_of),
            [None, Some(0), Some(0), Some(1), Some(17), None]
        );
    }
}
