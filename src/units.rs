//! Physical quantities that cross module boundaries. Each is a newtype, so that grams-force can't be mistaken for
//! newtons.

use std::fmt;
use std::time::Duration;

/// Standard gravity, to convert grams-force to newtons.
pub const STANDARD_GRAVITY: f64 = 9.80665; // m/s^2, 3rd CGPM 1901

/// Nanoseconds in a second.
pub const NANOS_PER_SEC: i64 = 1_000_000_000;

/// A force in newtons.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default)]
pub struct Newton(pub f64);

/// A force in grams-force, the unit of the paper's models and metrics.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default)]
pub struct GramForce(pub f64);

impl From<GramForce> for Newton {
    fn from(force: GramForce) -> Self {
        Newton(force.0 * 1e-3 * STANDARD_GRAVITY)
    }
}

impl From<Newton> for GramForce {
    fn from(force: Newton) -> Self {
        GramForce(force.0 / (1e-3 * STANDARD_GRAVITY))
    }
}

impl fmt::Display for Newton {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} N", self.0)
    }
}

impl fmt::Display for GramForce {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} gF", self.0)
    }
}

/// A point in time: nanoseconds since the epoch of the clock that stamped it (ROS time, or a sensor's own).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Stamp(pub i64);

impl Stamp {
    /// The stamp of `builtin_interfaces/msg/Time`.
    pub fn from_sec_nanosec(sec: i32, nanosec: u32) -> Self {
        Stamp(i64::from(sec) * NANOS_PER_SEC + i64::from(nanosec))
    }

    /// The fields of `builtin_interfaces/msg/Time`.
    ///
    /// A stamp outside the range of the `int32` seconds saturates.
    pub fn to_sec_nanosec(self) -> (i32, u32) {
        let sec = self.0.div_euclid(NANOS_PER_SEC);
        match i32::try_from(sec) {
            Ok(sec) => (sec, self.0.rem_euclid(NANOS_PER_SEC) as u32),
            Err(_) if sec < 0 => (i32::MIN, 0),
            Err(_) => (i32::MAX, 999_999_999),
        }
    }

    /// This stamp moved by `nanos`, which may be negative.
    pub fn offset(self, nanos: i64) -> Self {
        Stamp(self.0.saturating_add(nanos))
    }

    /// Time from `earlier` to this stamp, in nanoseconds. Negative if this stamp is before it.
    pub fn nanos_since(self, earlier: Stamp) -> i64 {
        self.0.saturating_sub(earlier.0)
    }
}

impl fmt::Display for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let nanos = self.0.unsigned_abs();
        write!(f, "{sign}{}.{:09} s", nanos / NANOS_PER_SEC as u64, nanos % NANOS_PER_SEC as u64)
    }
}

/// A duration in signed nanoseconds, for comparison with stamps. It saturates.
pub fn nanos(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
}

/// Converts milliseconds to a duration.
///
/// Parameters are in milliseconds. Negative and non-finite values were refused before.
pub fn from_millis(ms: f64) -> Duration {
    Duration::from_nanos((ms * 1e6).round() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_newton_is_about_102_grams_force() {
        let force = GramForce::from(Newton(1.0));
        assert!((force.0 - 101.971_621_297_792_8).abs() < 1e-9); // 1 / 9.80665e-3, exact to f64
        assert!((Newton::from(force).0 - 1.0).abs() < 1e-15);
    }

    #[test]
    fn stamps_before_the_epoch_split_as_ros_time_does() {
        assert_eq!(Stamp(-1_700_000_000).to_sec_nanosec(), (-2, 300_000_000));
        assert_eq!(Stamp::from_sec_nanosec(-2, 300_000_000), Stamp(-1_700_000_000));
        assert_eq!(Stamp(i64::MAX).to_sec_nanosec(), (i32::MAX, 999_999_999));
    }
}
