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
    /// Direction of the force on the hand by the object, in the patch's own frame.
    pub normal_in_patch: Unit<Vector3<f64>>,
    /// Pose of the patch in `frame_id`, m. The identity when the patch's frame is `frame_id` itself.
    pub frame_from_patch: Isometry3<f64>,
}

impl Patch {
    /// The wrench on the hand by the object, about the origin of `frame_id`.
    ///
    /// The force acts at the origin of the patch, along its normal: the models estimate normal force only. The torque
    /// is what that lever makes of it, so zero for a patch that sits at the origin.
    pub fn wrench(&self, normal_force: Newton) -> Wrench {
        let force = self.frame_from_patch * (self.normal_in_patch.into_inner() * normal_force.0);
        let lever = self.frame_from_patch * Point3::origin();
        Wrench { force, torque: lever.coords.cross(&force) }
    }
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
        let wrench = patch.wrench(Newton(3.0));
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
        let wrench = patch.wrench(Newton(1.0));
        assert!((wrench.force - Vector3::new(0.0, 1.0, 0.0)).norm() < 1e-12); // rounding of one rotation
        assert!((wrench.torque - Vector3::new(0.0, 0.0, 0.02)).norm() < 1e-12);
    }
}
