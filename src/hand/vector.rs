//! Three numbers as a vector.

use super::Point;

pub(super) fn sub(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The unit vector; none of what has no length, or one that is not finite.
pub(super) fn direction(a: Point) -> Option<Point> {
    let length = dot(a, a).sqrt();
    (length.is_normal() && length > 1e-9).then(|| a.map(|component| component / length))
}
