//! Parameters of pictures: where taxels are, and the markers and images of the live node.

use nalgebra::{Point3, Vector3};

use super::super::error::ConfigError;
use super::reader::Reader;
use crate::fusion::{Patch, RegionConfig};

/// Where the taxels of a region are, for pictures. The force doesn't depend on it.
#[derive(Debug, Clone, PartialEq)]
pub struct TaxelLayout {
    /// Name of the patch's own frame, which the node publishes on `/tf_static` if it is asked to.
    pub frame_id: String,
    /// Columns of the grid, whose rows hold the taxels in order. The last row may have fewer.
    pub columns: usize,
    /// True if the parameters give the grid; otherwise it is as square as possible.
    pub is_told: bool,
    /// Distance between the centers of neighbouring taxels, m.
    pub pitch: f64,
    /// `[taxels]`: centers in the patch's own frame, m; from the parameters, or of the grid.
    pub centers: Vec<Point3<f64>>,
}

/// Markers, images and frames of the node.
#[derive(Debug, Clone, PartialEq)]
pub struct VisualsConfig {
    /// When markers and images are published.
    pub publishing: Publishing,
    /// Most of them in a second, for each tactile source.
    pub rate_hz: f64,
    /// Length of a force arrow, m for each N.
    pub arrow_m_per_n: f64,
    /// Reading above the zero that has the strongest colour; `None`: the largest of the last seconds.
    pub taxel_range: Option<f64>,
    /// True if the poses of patches are published on `/tf_static`.
    pub tf: bool,
}

/// When markers and images are published.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Publishing {
    /// While somebody subscribes.
    Auto,
    /// Always.
    Always,
    /// Never: their topics don't exist.
    Never,
}

/// Reads the parameters of pictures.
pub(super) fn visuals(reader: &Reader<'_>) -> Result<VisualsConfig, ConfigError> {
    let publishing = match reader.text("visualization.publish")?.as_str() {
        "always" => Publishing::Always,
        "never" => Publishing::Never,
        _ => Publishing::Auto,
    };
    Ok(VisualsConfig {
        publishing,
        rate_hz: reader.double("visualization.rate_hz")?,
        arrow_m_per_n: reader.double("visualization.arrow_m_per_n")?,
        taxel_range: Some(reader.double("visualization.taxel_range")?).filter(|range| *range > 0.0),
        tf: reader.bool("visualization.tf")?,
    })
}

/// The layout of each region.
pub(super) fn layouts(reader: &Reader<'_>, regions: &[RegionConfig]) -> Result<Vec<TaxelLayout>, ConfigError> {
    regions.iter().map(|region| layout(reader, region)).collect()
}

fn layout(reader: &Reader<'_>, region: &RegionConfig) -> Result<TaxelLayout, ConfigError> {
    let key = |tail: &str| format!("region.{}.layout.{tail}", region.name);
    let n_taxels = region.taxels.len();
    let shape = key("shape");
    let is_told = reader.is_set(&shape);
    let columns = if is_told { columns(reader, &shape, n_taxels)? } else { n_taxels.isqrt().max(1) };
    let columns = if is_told || columns * columns >= n_taxels { columns } else { columns + 1 };
    let pitch = reader.double(&key("pitch"))?;
    let positions = key("positions");
    let numbers = reader.all_doubles(&positions)?;
    let centers = match numbers.len() {
        0 => grid(&region.patch, n_taxels, columns, pitch),
        len if len == 3 * n_taxels => numbers.chunks_exact(3).map(Point3::from_slice).collect(),
        len => {
            let expected = 3 * n_taxels;
            let problem = format!("has {len} numbers: {n_taxels} taxels need x, y and z of each, {expected} in all");
            return Err(reader.refused(&positions, problem));
        }
    };
    let frame_id = format!("{}_patch", region.name);
    if frame_id == region.patch.frame_id && reader.bool("visualization.tf")? {
        let problem = "is the frame of the patch itself, which visualization.tf publishes; choose another frame";
        return Err(reader.refused(&format!("region.{}.frame_id", region.name), problem));
    }
    Ok(TaxelLayout { frame_id, columns, is_told, pitch, centers })
}

fn columns(reader: &Reader<'_>, key: &str, n_taxels: usize) -> Result<usize, ConfigError> {
    let counts = reader.all_doubles(key)?; // the table says that they are ints of at least 1
    let &[rows, columns] = counts.as_slice() else {
        return Err(reader.refused(key, "must be two numbers: rows and columns"));
    };
    if rows * columns < n_taxels as f64 {
        let problem = format!("has {} places, but the region has {n_taxels} taxels", rows * columns);
        return Err(reader.refused(key, problem));
    }
    Ok(columns as usize)
}

/// A grid around the origin of the patch, perpendicular to its normal. Columns are along x as far as the normal allows
/// it, and the first row is at the top of y.
fn grid(patch: &Patch, n_taxels: usize, columns: usize, pitch: f64) -> Vec<Point3<f64>> {
    let normal = patch.normal_in_patch.into_inner();
    let along = if normal.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() }; // far enough from the normal
    let right = (along - normal * normal.dot(&along)).normalize();
    let up = normal.cross(&right);
    let rows = n_taxels.div_ceil(columns);
    let middle = |count: usize| (count as f64 - 1.0) / 2.0;
    let center = |taxel: usize| {
        let (row, column) = ((taxel / columns) as f64, (taxel % columns) as f64);
        Point3::from(right * (pitch * (column - middle(columns))) + up * (pitch * (middle(rows) - row)))
    };
    (0..n_taxels).map(center).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Unit};

    use super::*;

    fn patch(normal: Vector3<f64>) -> Patch {
        Patch {
            frame_id: "tip".into(),
            normal_in_patch: Unit::new_normalize(normal),
            frame_from_patch: Isometry3::identity(),
        }
    }

    #[test]
    fn a_grid_is_around_the_origin_and_perpendicular_to_any_normal() {
        for normal in [Vector3::z(), -Vector3::z(), Vector3::x(), -Vector3::y(), Vector3::new(1.0, 2.0, 3.0)] {
            let patch = patch(normal);
            let centers = grid(&patch, 6, 3, 0.01);
            let middle: Vector3<f64> = centers.iter().map(|center| center.coords).sum();
            assert!(middle.norm() < 1e-15, "{normal}");
            for center in &centers {
                assert!(center.coords.dot(&patch.normal_in_patch).abs() < 1e-15, "{normal}");
            }
            assert!(((centers[1] - centers[0]).norm() - 0.01).abs() < 1e-15);
            assert!(((centers[3] - centers[0]).norm() - 0.01).abs() < 1e-15);
        }
        let centers = grid(&patch(Vector3::z()), 4, 2, 0.01);
        assert_eq!(centers[0], Point3::new(-0.005, 0.005, 0.0));
        assert_eq!(centers[3], Point3::new(0.005, -0.005, 0.0));
    }
}
