//! Standard messages of pictures, which the live node writes: markers and images.

use serde::{Deserialize, Serialize};

use super::{Duration, Header, Point, Pose, Vector3, WireType};

/// A colour; each part from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ColorRGBA {
    /// Red.
    pub r: f32,
    /// Green.
    pub g: f32,
    /// Blue.
    pub b: f32,
    /// Opacity.
    pub a: f32,
}

/// An image, row by row from the top left.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Image {
    /// Time and frame.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// Meaning of the bytes of a pixel, such as `rgb8`.
    pub encoding: String,
    /// 1 if numbers of several bytes have the largest part first.
    pub is_bigendian: u8,
    /// Bytes of a row.
    pub step: u32,
    /// `[height x step]`
    pub data: Vec<u8>,
}

/// A compressed image, which a marker may have as its texture.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CompressedImage {
    /// Time and frame.
    pub header: Header,
    /// Such as `png`.
    pub format: String,
    /// The file.
    pub data: Vec<u8>,
}

/// A place in a texture.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct UVCoordinate {
    /// Share of the width.
    pub u: f32,
    /// Share of the height.
    pub v: f32,
}

/// The file of a mesh.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct MeshFile {
    /// Its name.
    pub filename: String,
    /// Its content.
    pub data: Vec<u8>,
}

/// Something to draw.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Marker {
    /// Time and frame.
    pub header: Header,
    /// First part of its name.
    pub ns: String,
    /// Second part of its name.
    pub id: i32,
    /// Kind of thing.
    pub r#type: i32,
    /// [`Marker::ADD`] or [`Marker::DELETE`].
    pub action: i32,
    /// Its pose in the frame.
    pub pose: Pose,
    /// Its size, whose meaning depends on the kind.
    pub scale: Vector3,
    /// Its colour.
    pub color: ColorRGBA,
    /// How long it stays without a newer one; 0 for ever.
    pub lifetime: Duration,
    /// True if it moves along with its frame.
    pub frame_locked: bool,
    /// Points of kinds that have some, m.
    pub points: Vec<Point>,
    /// `[points]`, or none.
    pub colors: Vec<ColorRGBA>,
    /// Unused.
    pub texture_resource: String,
    /// Unused.
    pub texture: CompressedImage,
    /// Unused.
    pub uv_coordinates: Vec<UVCoordinate>,
    /// Text of a text.
    pub text: String,
    /// Unused.
    pub mesh_resource: String,
    /// Unused.
    pub mesh_file: MeshFile,
    /// Unused.
    pub mesh_use_embedded_materials: bool,
}

impl Marker {
    /// An arrow from the first point to the second.
    pub const ARROW: i32 = 0;
    /// A cube at each point.
    pub const CUBE_LIST: i32 = 6;
    /// Text that faces the viewer.
    pub const TEXT_VIEW_FACING: i32 = 9;
    /// Draw it, or change it.
    pub const ADD: i32 = 0;
    /// Remove it.
    pub const DELETE: i32 = 2;
}

/// Things to draw.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct MarkerArray {
    /// The things.
    pub markers: Vec<Marker>,
}

impl WireType for ColorRGBA {
    const TYPE_NAME: &'static str = "std_msgs/msg/ColorRGBA";
}

impl WireType for Image {
    const TYPE_NAME: &'static str = "sensor_msgs/msg/Image";
}

impl WireType for CompressedImage {
    const TYPE_NAME: &'static str = "sensor_msgs/msg/CompressedImage";
}

impl WireType for UVCoordinate {
    const TYPE_NAME: &'static str = "visualization_msgs/msg/UVCoordinate";
}

impl WireType for MeshFile {
    const TYPE_NAME: &'static str = "visualization_msgs/msg/MeshFile";
}

impl WireType for Marker {
    const TYPE_NAME: &'static str = "visualization_msgs/msg/Marker";
}

impl WireType for MarkerArray {
    const TYPE_NAME: &'static str = "visualization_msgs/msg/MarkerArray";
}
