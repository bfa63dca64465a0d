//! A region as markers, and its patch as a frame.

use nalgebra::{Isometry3, Point3};

use super::colour::{of_estimate, of_taxel, opaque};
use super::{Scene, ShownRegion};
use crate::config::TaxelLayout;
use crate::fusion::RegionConfig;
use crate::msg::{Duration, Header, Marker, Point, Pose, Quaternion, Transform, TransformStamped, Vector3};
use crate::units::Stamp;

/// An arrow that is shorter than this is not drawn, m: it would be only its head.
const SHORTEST: f64 = 1e-4;

/// The patches of the taxels, the arrow of the force, and the force and the flags as text.
pub(super) fn markers(
    scene: &Scene,
    shown: &ShownRegion,
    stamp: Stamp,
    arrow_m_per_n: f64,
    lifetime_ns: i64,
) -> [Marker; 3] {
    let (patch, layout, estimate) = (&scene.region.patch, &scene.layout, &shown.estimate);
    let (color, pitch) = (opaque(of_estimate(estimate)), layout.pitch);
    let marker = |id: i32, kind: i32| Marker {
        header: Header { stamp: stamp.into(), frame_id: patch.frame_id.clone() },
        ns: scene.region.name.clone(),
        id,
        r#type: kind,
        color,
        lifetime: Duration::from_nanos(lifetime_ns),
        frame_locked: true,
        ..Marker::default()
    };
    let taxels = Marker {
        pose: pose(&patch.frame_from_patch),
        scale: Vector3 { x: 0.85 * pitch, y: 0.85 * pitch, z: 0.3 * pitch },
        points: layout.centers.iter().map(point).collect(),
        colors: shown.corrected.iter().map(|value| opaque(of_taxel(*value, scene.range))).collect(),
        ..marker(0, Marker::CUBE_LIST)
    };
    let place = patch.frame_from_patch * Point3::origin();
    let outwards = patch.frame_from_patch * (-patch.normal_in_patch.into_inner());
    let force = estimate.force.map(|force| patch.wrench(force, estimate.tangential).force * arrow_m_per_n);
    let arrow = match force.filter(|arrow| arrow.norm() >= SHORTEST) {
        Some(arrow) => Marker {
            // It pushes on the patch, so it ends there.
            points: vec![point(&(place - arrow)), point(&place)],
            scale: Vector3 { x: 0.5 * pitch, y: 1.2 * pitch, z: 1.2 * pitch },
            ..marker(1, Marker::ARROW)
        },
        None => Marker { action: Marker::DELETE, ..marker(1, Marker::ARROW) },
    };
    let mut words = match estimate.force {
        Some(force) => format!("{} {:.2} N", scene.region.name, force.0),
        None => format!("{} no estimate", scene.region.name),
    };
    if !estimate.flags.is_empty() {
        words.push_str(&format!("\n{}", estimate.flags));
    }
    let text = Marker {
        pose: pose(&Isometry3::translation(
            place.x + 4.0 * pitch * outwards.x,
            place.y + 4.0 * pitch * outwards.y,
            place.z + 4.0 * pitch * outwards.z,
        )),
        scale: Vector3 { z: 2.0 * pitch, ..Vector3::default() },
        text: words,
        ..marker(2, Marker::TEXT_VIEW_FACING)
    };
    [taxels, arrow, text]
}

/// The pose of a patch in the frame of its region, as a frame that doesn't change.
pub(super) fn frame(region: &RegionConfig, layout: &TaxelLayout, stamp: Stamp) -> TransformStamped {
    let Pose { position, orientation } = pose(&region.patch.frame_from_patch);
    TransformStamped {
        header: Header { stamp: stamp.into(), frame_id: region.patch.frame_id.clone() },
        child_frame_id: layout.frame_id.clone(),
        transform: Transform {
            translation: Vector3 { x: position.x, y: position.y, z: position.z },
            rotation: orientation,
        },
    }
}

fn point(point: &Point3<f64>) -> Point {
    Point { x: point.x, y: point.y, z: point.z }
}

fn pose(isometry: &Isometry3<f64>) -> Pose {
    let rotation = isometry.rotation.into_inner().coords;
    Pose {
        position: point(&isometry.translation.vector.into()),
        orientation: Quaternion { x: rotation.x, y: rotation.y, z: rotation.z, w: rotation.w },
    }
}
