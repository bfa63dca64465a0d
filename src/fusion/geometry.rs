//! Where a region's force acts: contact normal and frames.

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use crate::units::Newton;

/// A force and a torque about the origin of a named frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wrench {
    /// N.
    pub force: Vector3<f64>,
    /// N m.
    pub torque: Vector3<f64>,
}

/// A tactile patch in the frame of its wrench.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    /// The frame of the wrench, right-handed (REP-103).
    pub frame_id: String,
    /// Direction of the force on the hand by an object that presses straight on the patch, in the patch's own frame.
    pub normal_in_patch: Unit<Vector3<f64>>,
    /// Pose of the patch in `frame_id`, m. The identity when the patch's frame is `frame_id` itself.
    pub frame_from_patch: Isometry3<f64>,
}

impl Patch {
    /// The wrench on the hand by the object, about the origin of `frame_id`.
    ///
    /// The force acts at the origin of the patch, along its normal, and beside it where `tangential` (x, y, z in the
    /// patch's own frame) is known. The torque is what that lever makes of it, so zero for a patch that sits at the
    /// origin.
    pub fn wrench(&self, normal_force: Newton, tangential: Option<[Newton; 3]>) -> Wrench {
        let mut force_in_patch = self.normal_in_patch.into_inner() * normal_force.0;
        if let Some(tangential) = tangential {
            force_in_patch += Vector3::from(tangential.map(|force| force.0));
        }
        let force = self.frame_from_patch * force_in_patch;
        let lever = self.frame_from_patch * Point3::origin();
        Wrench { force, torque: lever.coords.cross(&force) }
    }

    /// The normal force, and the rest, of a force x, y, z on the hand by the object in the patch's own frame.
    ///
    /// The normal force is its component along the normal, so positive under pressure. The rest is tangential: x, y, z in
    /// the same frame, perpendicular to the normal.
    pub fn split(&self, force_in_patch: [Newton; 3]) -> (Newton, [Newton; 3]) {
        split(&self.normal_in_patch, force_in_patch)
    }

    /// The force x, y, z in the patch's own frame, of one in `frame_id`: of a wrench's.
    pub fn force_in_patch(&self, force: [f64; 3]) -> [Newton; 3] {
        let force = self.frame_from_patch.rotation.inverse_transform_vector(&Vector3::from(force));
        [Newton(force.x), Newton(force.y), Newton(force.z)]
    }
}

/// [`Patch::split`] by the normal alone.
pub fn split(normal: &Unit<Vector3<f64>>, force: [Newton; 3]) -> (Newton, [Newton; 3]) {
    let force = Vector3::from(force.map(|force| force.0));
    let along = normal.dot(&force);
    let rest = force - normal.into_inner() * along;
    (Newton(along), [Newton(rest.x), Newton(rest.y), Newton(rest.z)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};

    #[test]
    fn a_patch_at_the_origin_gives_a_pure_normal_force() {
        let patch = Patch {
            frame_id: "index_tip".into(),
            normal_in_patch: Unit::new_normalize(Vector3::new(0.0, 0.0, -2.0)),
            frame_from_patch: Isometry3::identity(),
        };
        let wrench = patch.wrench(Newton(3.0), None);
        assert_eq!(wrench.force, Vector3::new(0.0, 0.0, -3.0));
        assert_eq!(wrench.torque, Vector3::zeros());
    }

    #[test]
    fn a_patch_on_a_lever_turns_and_twists() {
        // A patch 20 mm out along x, turned by 90 degrees about x: its -z looks along the frame's +y.
        let patch = Patch {
            frame_id: "index_distal".into(),
            normal_in_patch: Unit::new_normalize(Vector3::new(0.0, 0.0, -1.0)),
            frame_from_patch: Isometry3::from_parts(
                Translation3::new(0.02, 0.0, 0.0),
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2),
            ),
        };
        let wrench = patch.wrench(Newton(1.0), None);
        assert!((wrench.force - Vector3::new(0.0, 1.0, 0.0)).norm() < 1e-12); // rounding of one rotation
        assert!((wrench.torque - Vector3::new(0.0, 0.0, 0.02)).norm() < 1e-12);
        // With a force of 2 N along the patch's y, which looks along the frame's +z.
        let tangential = [Newton(0.0), Newton(2.0), Newton(0.0)];
        let wrench = patch.wrench(Newton(1.0), Some(tangential));
        assert!((wrench.force - Vector3::new(0.0, 1.0, 2.0)).norm() < 1e-12);
        assert!((wrench.torque - Vector3::new(0.0, -0.04, 0.02)).norm() < 1e-12);
        let (normal, rest) = patch.split(patch.force_in_patch([0.0, 1.0, 2.0]));
        let off = |a: [Newton; 3], b: [Newton; 3]| a.iter().zip(b).map(|(a, b)| (a.0 - b.0).abs()).fold(0.0, f64::max);
        assert!((normal.0 - 1.0).abs() < 1e-12 && off(rest, tangential) < 1e-12);
    }

    #[test]
    fn a_force_is_split_along_a_normal_of_any_direction() {
        let normal = Unit::new_normalize(Vector3::new(1.0, 2.0, -2.0));
        let (along, rest) = split(&normal, [Newton(3.0), Newton(0.0), Newton(0.0)]);
        assert!((along.0 - 1.0).abs() < 1e-12);
        let rest = Vector3::from(rest.map(|force| force.0));
        assert!(rest.dot(&normal).abs() < 1e-12 && (rest.norm_squared() - 8.0).abs() < 1e-12);
        let (along, _) = split(&normal, [Newton(f64::NAN), Newton(0.0), Newton(0.0)]);
        assert!(along.0.is_nan());
    }
}
