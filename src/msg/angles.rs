//! Checks that joint angles have the unit that the parameters give.

use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Larger than any angle of a hand's joint, rad.
const MOST_BENT: f64 = 3.3;

/// Beyond it, numbers are not degrees of a joint either.
const FULL_TURN_DEGREES: f64 = 360.0;

/// A joint that is used moves by more than this, rad.
const LEAST_MOTION: f64 = 0.3;

/// Share of messages with an impossible angle above which the cause is not an occasional faulty angle.
const LEAST_BEYOND: f64 = 0.2;

/// Maximum number of joints that are checked. Two hands have 50.
const MAX_JOINTS: usize = 128;

/// Statistics on the joint angles of a source, for bags and live inputs.
#[derive(Debug, Clone)]
pub struct AngleWatch {
    /// Radians per unit of the source, from the parameters.
    scale: f64,
    n_messages: u64,
    /// Number of messages with an impossible angle.
    n_beyond: u64,
    /// Largest absolute angle, in the unit of the source.
    most: f64,
    /// True if all angles so far are whole numbers.
    is_whole: bool,
    /// Smallest and largest angle of each joint, in the unit of the source.
    ranges: BTreeMap<String, [f64; 2]>,
}

impl AngleWatch {
    /// Statistics on a source with `scale` radians per unit.
    pub fn new(scale: f64) -> Self {
        AngleWatch { scale, n_messages: 0, n_beyond: 0, most: 0.0, is_whole: true, ranges: BTreeMap::new() }
    }

    /// Adds a message: its joints, with their angles in the unit of the source.
    pub fn handle<'n>(&mut self, angles: impl Iterator<Item = (&'n str, f64)>) {
        let mut most = 0.0_f64;
        for (name, angle) in angles.filter(|(_, angle)| angle.is_finite()) {
            most = most.max(angle.abs());
            self.is_whole &= angle.fract() == 0.0;
            if let Some([least, greatest]) = self.ranges.get_mut(name) {
                (*least, *greatest) = (least.min(angle), greatest.max(angle));
            } else if self.ranges.len() < MAX_JOINTS {
                self.ranges.insert(name.to_owned(), [angle, angle]);
            }
        }
        self.n_messages += 1;
        self.n_beyond += u64::from(most * self.scale.abs() > MOST_BENT);
        self.most = self.most.max(most);
    }

    /// A unit that can't be right, in one line that names a parameter of the source `key`, as in `joint.hand`.
    ///
    /// Angles that no joint can have show degrees where the parameters give radians. Joints that move, but never far,
    /// show radians where they give degrees.
    pub fn doubt(&self, key: &str) -> Option<String> {
        let Self { scale, n_messages, n_beyond, most, is_whole, .. } = self;
        let is_degrees = (scale - PI / 180.0).abs() < 1e-12;
        if *n_beyond as f64 > LEAST_BEYOND * *n_messages as f64 {
            let reach = scale.abs() * most;
            return Some(match (*scale == 1.0, is_degrees) {
                (true, _) if *is_whole && *most > FULL_TURN_DEGREES => format!(
                    "{key}: angles reach {most:.0}, all whole numbers, such as counts of an encoder; set {key}.scale to rad per count"
                ),
                (true, _) => format!(
                    "{key}: angles reach {reach:.1} rad, further than a joint bends: they look like degrees; set {key}.degrees to true"
                ),
                (_, true) => format!(
                    "{key}: angles reach {most:.0} degrees, further than a joint bends: correct the driver, or {key}.degrees"
                ),
                _ => format!(
                    "{key}: angles reach {reach:.1} rad by {key}.scale of {scale}, further than a joint bends: correct {key}.scale"
                ),
            });
        }
        let moves = self.ranges.values().any(|[least, greatest]| greatest - least > LEAST_MOTION);
        (is_degrees && moves && *most < MOST_BENT).then(|| {
            format!(
                "{key}: no angle is beyond {most:.1} degrees while joints move: they look like radians; set {key}.degrees to false"
            )
        })
    }

    /// Resets the counts of messages. The ranges of the joints are kept.
    pub fn begin_count(&mut self) {
        (self.n_messages, self.n_beyond) = (0, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn doubt(scale: f64, bend: impl Fn(f64) -> f64) -> Option<String> {
        let mut watch = AngleWatch::new(scale);
        (0..300).for_each(|k| watch.handle([("dip", bend(f64::from(k) * 0.05)), ("pip", f64::NAN)].into_iter()));
        watch.doubt("joint.hand")
    }

    #[test]
    fn a_unit_that_nobody_can_mean_is_told_by_its_parameter() {
        let degree = PI / 180.0;
        assert_eq!(doubt(1.0, |t| 0.8 + 0.8 * t.sin()), None);
        assert_eq!(doubt(degree, |t| 45.0 + 45.0 * t.sin()), None);
        assert_eq!(doubt(degree, |_| 0.5), None, "a hand at rest");
        assert_eq!(doubt(-2.0, |t| t.sin()), None);
        for (scale, bend, told) in [
            (1.0, 45.0, "they look like degrees; set joint.hand.degrees to true"),
            (degree, 0.8, "they look like radians; set joint.hand.degrees to false"),
            (degree, 2600.0, "correct the driver, or joint.hand.degrees"),
            (-60.0, 0.8, "correct joint.hand.scale"),
        ] {
            let text = doubt(scale, |t| bend + bend * t.sin()).unwrap_or_default();
            assert!(text.ends_with(told), "{scale} {bend}: {text}");
        }
    }

    #[test]
    fn a_faulty_angle_now_and_then_is_no_unit_and_joints_are_bounded() {
        let mut watch = AngleWatch::new(1.0);
        (0..100).for_each(|k| watch.handle([("dip", if k % 10 == 0 { 1e9 } else { 0.1 })].into_iter()));
        assert_eq!(watch.doubt("joint.hand"), None);
        let names: Vec<String> = (0..1000).map(|k| k.to_string()).collect();
        watch.handle(names.iter().map(|name| (name.as_str(), 0.1)));
        assert_eq!(watch.ranges.len(), MAX_JOINTS);
        watch.begin_count();
        watch.handle([("dip", 40.0)].into_iter());
        assert!(watch.doubt("joint.hand").is_some(), "only what came since counts");
    }
}
