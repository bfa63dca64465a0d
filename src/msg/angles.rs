//! Whether joint angles are in the unit that the parameters say.

use std::collections::BTreeMap;
use std::f64::consts::PI;

/// No joint of a hand bends further, rad.
const MOST_BENT: f64 = 3.3;

/// A joint that is used moves further, rad.
const LEAST_MOTION: f64 = 0.3;

/// Share of messages with an angle that no joint has, from which on it isn't a faulty one now and then.
const LEAST_BEYOND: f64 = 0.2;

/// Most joints that are watched; two hands have 50.
const MAX_JOINTS: usize = 128;

/// What the angles of one source were like: for bags and for live inputs.
#[derive(Debug, Clone)]
pub struct AngleWatch {
    /// Radians per unit of the source, by the parameters.
    scale: f64,
    n_messages: u64,
    /// Messages with an angle that no joint has.
    n_beyond: u64,
    /// The greatest amount of an angle, in the unit of the source.
    most: f64,
    /// The least and the greatest angle of each joint, in the unit of the source.
    ranges: BTreeMap<String, [f64; 2]>,
}

impl AngleWatch {
    /// Watches a source of so many radians per unit, by the parameters.
    pub fn new(scale: f64) -> Self {
        AngleWatch { scale, n_messages: 0, n_beyond: 0, most: 0.0, ranges: BTreeMap::new() }
    }

    /// Takes note of a message: the joints that count, with their angles in the unit of the source.
    pub fn handle<'n>(&mut self, angles: impl Iterator<Item = (&'n str, f64)>) {
        let mut most = 0.0_f64;
        for (name, angle) in angles.filter(|(_, angle)| angle.is_finite()) {
            most = most.max(angle.abs());
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

    /// What nobody can mean, in one line that names a parameter of the source `key`: `joint.hand`.
    ///
    /// Degrees where the parameters say radians are told by angles that no joint has; radians where they say degrees, by
    /// joints that move and never get far.
    pub fn doubt(&self, key: &str) -> Option<String> {
        let Self { scale, n_messages, n_beyond, most, .. } = self;
        let is_degrees = (scale - PI / 180.0).abs() < 1e-12;
        if *n_beyond as f64 > LEAST_BEYOND * *n_messages as f64 {
            let reach = scale.abs() * most;
            return Some(match (*scale == 1.0, is_degrees) {
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

    /// Begins to count messages anew; how far joints went is kept.
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
