//! The taxels of a region as an image.

use super::colour::{PAPER, Rgb, of_taxel};
use super::{Scene, ShownRegion};
use crate::fusion::Adaptation;
use crate::msg::{Header, Image};
use crate::units::Stamp;

/// Largest width of a panel, and of a taxel, in pixels.
const PANEL: usize = 480;
const CELL: usize = 24;

/// Pixels between the two panels.
const GAP: usize = 12;

pub(super) fn image(scene: &Scene, region: &ShownRegion, stamp: Stamp) -> Image {
    let columns = scene.layout.columns;
    let rows = region.raw.len().div_ceil(columns);
    let cell = (PANEL / columns.max(rows)).clamp(2, CELL);
    let panels: &[&[f32]] = match region.estimate.adaptation {
        Adaptation::Off => &[&region.raw], // a model without artifacts gets the taxels as they are
        _ => &[&region.raw, &region.corrected],
    };
    let width = panels.len() * columns * cell + (panels.len() - 1) * GAP;
    let mut canvas = Canvas { width, pixels: vec![PAPER; width * rows * cell] };
    for (panel, values) in panels.iter().enumerate() {
        let left = panel * (columns * cell + GAP);
        for (taxel, value) in values.iter().enumerate() {
            let (x, y) = (left + taxel % columns * cell, taxel / columns * cell);
            canvas.square(x, y, cell, of_taxel(*value, scene.range));
        }
    }
    Image {
        header: Header { stamp: stamp.into(), frame_id: scene.region.patch.frame_id.clone() },
        height: (rows * cell) as u32,
        width: width as u32,
        encoding: "rgb8".to_owned(),
        is_bigendian: 0,
        step: 3 * width as u32,
        data: canvas.pixels.concat(),
    }
}

struct Canvas {
    width: usize,
    pixels: Vec<Rgb>,
}

impl Canvas {
    /// A square with a line of paper at its right and lower edge.
    fn square(&mut self, x: usize, y: usize, size: usize, colour: Rgb) {
        for row in y..y + size - 1 {
            self.pixels[row * self.width + x..][..size - 1].fill(colour);
        }
    }
}
