//! Forces as people write them on the command line.

use tactile_pose_fusion::fusion::ForceUnit;
use tactile_pose_fusion::units::Newton;

/// The units, longest name first, because one ends with another.
const UNITS: [(&str, ForceUnit); 4] = [
    ("kgf", ForceUnit::KilogramForce),
    ("gF", ForceUnit::GramForce),
    ("mN", ForceUnit::Millinewton),
    ("N", ForceUnit::Newton),
];

/// A force with its unit, such as `0.05N` or `200gF`; `None` for anything else.
pub(super) fn force(text: &str) -> Option<Newton> {
    let with_unit = |(name, unit): &(&str, ForceUnit)| Some((text.trim().strip_suffix(name)?, *unit));
    let (value, unit) = UNITS.iter().find_map(with_unit)?;
    Some(unit.to_newton(number(value)?))
}

/// A finite number that is not negative.
pub(super) fn number(text: &str) -> Option<f64> {
    text.trim().parse::<f64>().ok().filter(|number| number.is_finite() && *number >= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_force_has_a_unit() {
        for (text, newton) in [("0.05N", 0.05), ("50 mN", 0.05), ("5gF", 0.049_033_25), ("0.005kgf", 0.049_033_25)] {
            assert!((force(text).unwrap().0 - newton).abs() < 1e-12, "{text}");
        }
        for wrong in ["", "5", "N", "-1N", "nanN", "infN", "5lbf", "5 g F", "5kN"] {
            assert_eq!(force(wrong), None, "{wrong}");
        }
    }
}
