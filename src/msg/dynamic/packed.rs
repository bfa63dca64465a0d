//! Reads numbers that a message packs into bytes and describes in other fields: pixels of images, and points of a point
//! cloud.

use super::path::{self, Segment, Select};
use super::{FieldError, FieldPlan, ReadAs, ReadError};
use crate::msg::cdr::CdrError;
use crate::msg::definition::{Arity, BaseType, MessageDefinition, Primitive, TypeTree};

const POINT_CLOUD: &str = "sensor_msgs/msg/PointCloud2";

/// Kind of packed data, with the fields that describe it.
#[derive(Debug, Clone)]
pub(super) enum Packed {
    /// Pixels of a message like `sensor_msgs/msg/Image`, row by row, with the channels of a pixel side by side.
    Image(Box<Image>),
    /// One named field of all points of a `sensor_msgs/msg/PointCloud2`.
    Points(Box<Points>),
}

#[derive(Debug, Clone)]
pub(super) struct Image {
    height: FieldPlan,
    width: FieldPlan,
    step: FieldPlan,
    encoding: FieldPlan,
    is_bigendian: Option<FieldPlan>,
}

#[derive(Debug, Clone)]
pub(super) struct Points {
    height: FieldPlan,
    width: FieldPlan,
    point_step: FieldPlan,
    row_step: FieldPlan,
    is_bigendian: FieldPlan,
    names: FieldPlan,
    offsets: FieldPlan,
    datatypes: FieldPlan,
    counts: FieldPlan,
    name: String,
}

/// If the path leads to packed bytes: the plan of these bytes, and how they are packed.
pub(super) fn compile(tree: &TypeTree, text: &str) -> Result<Option<(FieldPlan, Packed)>, FieldError> {
    let segments = path::parse(text)?;
    let Some((last, before)) = segments.split_last() else { return Ok(None) };
    if let Some((data, above)) = before.split_last()
        && data.name == "data"
        && holder(tree, above).is_some_and(|message| message.type_name == POINT_CLOUD)
    {
        if data.select != Select::Every || last.select != Select::Whole {
            return Err(refused(tree, before, "write data[]. and the name of a field of a point"));
        }
        let at = |field: &str| beside(above, field);
        let count = |field: &str| FieldPlan::plain(tree, &at(field), ReadAs::Count);
        let numbers = |field: &str| FieldPlan::plain(tree, &at(field), ReadAs::Numbers);
        let points = Points {
            height: count("height")?,
            width: count("width")?,
            point_step: count("point_step")?,
            row_step: count("row_step")?,
            is_bigendian: count("is_bigendian")?,
            names: FieldPlan::plain(tree, &at("fields[].name"), ReadAs::Texts)?,
            offsets: numbers("fields[].offset")?,
            datatypes: numbers("fields[].datatype")?,
            counts: numbers("fields[].count")?,
            name: last.name.clone(),
        };
        return Ok(Some((numbers("data")?, Packed::Points(Box::new(points)))));
    }
    let Some(message) = holder(tree, before).filter(|_| last.name == "data") else { return Ok(None) };
    if message.type_name == POINT_CLOUD {
        return Err(refused(
            tree,
            &segments,
            "it packs points: write data[].z, or another field of a point in place of z",
        ));
    }
    if message.type_name.ends_with("/CompressedImage") {
        return Err(refused(tree, &segments, "it is compressed: use the topic of the image as it was taken"));
    }
    if !is_image(message) {
        return Ok(None);
    }
    if !matches!(last.select, Select::Whole | Select::Every) {
        return Err(refused(tree, &segments, "it packs pixels: leave the brackets out"));
    }
    let at = |field: &str| beside(before, field);
    let count = |field: &str| FieldPlan::plain(tree, &at(field), ReadAs::Count);
    let image = Image {
        height: count("height")?,
        width: count("width")?,
        step: count("step")?,
        encoding: FieldPlan::plain(tree, &at("encoding"), ReadAs::Texts)?,
        is_bigendian: message.field("is_bigendian").map(|_| count("is_bigendian")).transpose()?,
    };
    Ok(Some((FieldPlan::plain(tree, &at("data"), ReadAs::Numbers)?, Packed::Image(Box::new(image)))))
}

/// The message that has the field after these segments.
fn holder<'t>(tree: &'t TypeTree, segments: &[Segment]) -> Option<&'t MessageDefinition> {
    segments.iter().try_fold(tree.root(), |message, segment| match &message.field(&segment.name)?.ty.base {
        BaseType::Message(name) => Some(tree.message(name)),
        _ => None,
    })
}

fn beside(segments: &[Segment], field: &str) -> String {
    if segments.is_empty() { field.to_owned() } else { format!("{}.{field}", path::display(segments)) }
}

fn refused(tree: &TypeTree, segments: &[Segment], remedy: &str) -> FieldError {
    let (field, found) = (path::display(segments), "uint8[]".to_owned());
    FieldError::Shape { field, type_name: tree.type_name().to_owned(), found, remedy: remedy.to_owned() }
}

/// True if a message describes its bytes like an image: `sensor_msgs/msg/Image`, `foxglove_msgs/msg/RawImage`, ...
fn is_image(message: &MessageDefinition) -> bool {
    let is = |name: &str, wanted: fn(&BaseType) -> bool, many: bool| {
        message.field(name).is_some_and(|field| (field.ty.arity != Arity::One) == many && wanted(&field.ty.base))
    };
    let number: fn(&BaseType) -> bool = |base| matches!(base, BaseType::Primitive(_));
    let bytes: fn(&BaseType) -> bool = |base| matches!(base, BaseType::Primitive(primitive) if primitive.size() == 1);
    ["height", "width", "step"].iter().all(|name| is(name, number, false))
        && is("encoding", |base| matches!(base, BaseType::Text { .. }), false)
        && is("data", bytes, true)
}

impl Packed {
    /// Passes the numbers of a message to `tell` in blocks: their type, their bytes, and whether these are
    /// little-endian.
    pub(super) fn read(
        &self,
        data: &FieldPlan,
        cdr: &[u8],
        tell: &mut dyn FnMut(Primitive, &[u8], bool),
    ) -> Result<(), ReadError> {
        let refused = |reason: String| data.error(CdrError::Packed { reason });
        let bytes = data.bytes(cdr)?;
        match self {
            Packed::Image(image) => image.read(cdr, bytes, tell)?.map_err(refused),
            Packed::Points(points) => points.read(cdr, bytes, tell)?.map_err(refused),
        }
    }
}

type Told = Result<Result<(), String>, ReadError>;

impl Image {
    fn read(&self, cdr: &[u8], data: &[u8], tell: &mut dyn FnMut(Primitive, &[u8], bool)) -> Told {
        let [height, width, step] = [&self.height, &self.width, &self.step].map(|plan| plan.read_count(cdr));
        let (height, width, step) = (height?, width?, step?);
        let mut encoding = Vec::new();
        self.encoding.read_texts(cdr, &mut encoding)?;
        let encoding = encoding.first().map_or("", String::as_str);
        let is_little = match &self.is_bigendian {
            Some(plan) => plan.read_count(cdr)? == 0,
            None => true,
        };
        let Some((primitive, channels)) = pixel(encoding) else {
            return Ok(Err(format!(
                "an image of the encoding '{}' holds no readings; expected mono8, mono16, or numbers such as 8UC1, 16UC1, 16SC1, 32SC1, 32FC1, 64FC1",
                encoding.escape_default()
            )));
        };
        let row = width.saturating_mul(channels).saturating_mul(primitive.size() as u64);
        let n_bytes = data.len() as u64;
        if row > step || height.checked_mul(step) != Some(n_bytes) {
            return Ok(Err(format!(
                "an image of {height} x {width} in {encoding} with a step of {step} bytes holds {n_bytes} bytes; expected {}, and a step of at least {row}",
                height.saturating_mul(step)
            )));
        }
        if row > 0 {
            // A step is at most the number of bytes, so it fits a usize.
            data.chunks_exact(step as usize).for_each(|line| tell(primitive, &line[..row as usize], is_little));
        }
        Ok(Ok(()))
    }
}

/// Type and number of the channels of a pixel. `None` for colours and other encodings that are not plain numbers.
fn pixel(encoding: &str) -> Option<(Primitive, u64)> {
    match encoding {
        "mono8" => return Some((Primitive::UInt8, 1)),
        "mono16" => return Some((Primitive::UInt16, 1)),
        _ => {}
    }
    let (number, channels) = encoding.split_once('C')?;
    let channels = channels.parse().ok().filter(|channels| (1..=64).contains(channels))?;
    let primitive = match number {
        "8U" => Primitive::UInt8,
        "8S" => Primitive::Int8,
        "16U" => Primitive::UInt16,
        "16S" => Primitive::Int16,
        "32S" => Primitive::Int32,
        "32F" => Primitive::Float32,
        "64F" => Primitive::Float64,
        _ => return None,
    };
    Some((primitive, channels))
}

impl Points {
    fn read(&self, cdr: &[u8], data: &[u8], tell: &mut dyn FnMut(Primitive, &[u8], bool)) -> Told {
        let (height, width) = (self.height.read_count(cdr)?, self.width.read_count(cdr)?);
        let (point_step, row_step) = (self.point_step.read_count(cdr)?, self.row_step.read_count(cdr)?);
        let is_little = self.is_bigendian.read_count(cdr)? == 0;
        let mut names = Vec::new();
        self.names.read_texts(cdr, &mut names)?;
        let Some(field) = names.iter().position(|name| *name == self.name) else {
            let names: Vec<String> = names.iter().map(|name| name.escape_default().to_string()).collect();
            return Ok(Err(format!("a point has no field '{}'; it has {}", self.name, names.join(", "))));
        };
        let of_field = |plan: &FieldPlan| -> Result<u64, ReadError> {
            let mut all = Vec::new();
            plan.read_f64(cdr, &mut all)?;
            Ok(all.get(field).copied().unwrap_or(0.0) as u64)
        };
        let (offset, datatype, count) =
            (of_field(&self.offsets)?, of_field(&self.datatypes)?, of_field(&self.counts)?.max(1));
        // Type numbers of sensor_msgs/msg/PointField.
        let primitive = match datatype {
            1 => Primitive::Int8,
            2 => Primitive::UInt8,
            3 => Primitive::Int16,
            4 => Primitive::UInt16,
            5 => Primitive::Int32,
            6 => Primitive::UInt32,
            7 => Primitive::Float32,
            8 => Primitive::Float64,
            other => {
                return Ok(Err(format!("the datatype of field '{}' is {other}; expected 1 to 8", self.name)));
            }
        };
        let end = offset.saturating_add(count.saturating_mul(primitive.size() as u64));
        let n_bytes = data.len() as u64;
        // Some drivers omit the step if there is only one row.
        let row_step = if height == 1 { n_bytes } else { row_step };
        let fits = end <= point_step
            && width.saturating_mul(point_step) <= row_step
            && height.checked_mul(row_step) == Some(n_bytes);
        if !fits {
            return Ok(Err(format!(
                "{height} x {width} points of {point_step} bytes in rows of {row_step} don't make up {n_bytes} bytes, or don't hold '{}' at {offset} to {end}",
                self.name
            )));
        }
        if n_bytes > 0 {
            // All of these are at most the number of bytes, so they fit a usize. A point has at least one byte.
            let (offset, end, row_bytes) = (offset as usize, end as usize, (width * point_step) as usize);
            for row in data.chunks_exact(row_step as usize) {
                let points = row[..row_bytes].chunks_exact(point_step as usize);
                points.for_each(|point| tell(primitive, &point[offset..end], is_little));
            }
        }
        Ok(Ok(()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::{Header, WireType, to_cdr};
    use serde::{Deserialize, Serialize};

    #[derive(Serialize, Deserialize)]
    struct Image {
        header: Header,
        height: u32,
        width: u32,
        encoding: String,
        is_bigendian: u8,
        step: u32,
        data: Vec<u8>,
    }

    impl WireType for Image {
        const TYPE_NAME: &'static str = "sensor_msgs/msg/Image";
    }

    #[derive(Serialize, Deserialize, Clone)]
    struct PointField {
        name: String,
        offset: u32,
        datatype: u8,
        count: u32,
    }

    #[derive(Serialize, Deserialize, Clone)]
    struct PointCloud2 {
        header: Header,
        height: u32,
        width: u32,
        fields: Vec<PointField>,
        is_bigendian: bool,
        point_step: u32,
        row_step: u32,
        data: Vec<u8>,
        is_dense: bool,
    }

    impl WireType for PointCloud2 {
        const TYPE_NAME: &'static str = POINT_CLOUD;
    }

    const RULE: &str = "================================================================================";

    fn tree(type_name: &str, fields: &str) -> TypeTree {
        let header = crate::msg::definition_text("std_msgs/msg/Header").unwrap();
        TypeTree::from_schema(
            type_name,
            &format!("std_msgs/Header header\n{fields}\n{RULE}\nMSG: std_msgs/Header\n{header}"),
        )
        .unwrap()
    }

    fn image_tree() -> TypeTree {
        tree(
            Image::TYPE_NAME,
            "uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data",
        )
    }

    fn cloud_tree() -> TypeTree {
        let point = "string name\nuint32 offset\nuint8 datatype\nuint32 count";
        tree(
            POINT_CLOUD,
            &format!(
                "uint32 height\nuint32 width\nPointField[] fields\nbool is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n{RULE}\nMSG: sensor_msgs/PointField\n{point}"
            ),
        )
    }

    fn read(tree: &TypeTree, path: &str, cdr: &[u8]) -> Result<Vec<f64>, String> {
        let plan = FieldPlan::compile(tree, path, ReadAs::Numbers).map_err(|error| error.to_string())?;
        let (mut double, mut single) = (vec![], vec![]);
        let read = plan.read_f64(cdr, &mut double).map_err(|error| error.to_string());
        assert_eq!(plan.read_f32(cdr, &mut single).map_err(|error| error.to_string()), read);
        assert!(double.iter().zip(&single).all(|(double, single)| *double as f32 == *single));
        read.map(|_| double)
    }

    fn image(encoding: &str, is_bigendian: u8, [height, width, step]: [u32; 3], data: Vec<u8>) -> Vec<u8> {
        let header = Header::default();
        to_cdr(&Image { header, height, width, encoding: encoding.into(), is_bigendian, step, data })
    }

    #[test]
    fn pixels_are_read_by_their_encoding_and_without_the_padding_of_rows() {
        let tree = image_tree();
        let values = |encoding: &str, big: u8, step: u32, data: &[&[u8]]| {
            read(&tree, "data", &image(encoding, big, [2, 2, step], data.concat())).unwrap()
        };
        assert_eq!(values("mono8", 0, 2, &[&[1, 2], &[3, 255]]), [1.0, 2.0, 3.0, 255.0]);
        assert_eq!(values("8SC1", 0, 3, &[&[1, 2, 9], &[3, 255, 9]]), [1.0, 2.0, 3.0, -1.0]);
        let words: [u16; 4] = [1, 2, 3, 65_535];
        let little: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let big: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
        for encoding in ["16UC1", "mono16"] {
            assert_eq!(values(encoding, 0, 4, &[&little]), [1.0, 2.0, 3.0, 65_535.0]);
            assert_eq!(values(encoding, 1, 4, &[&big]), [1.0, 2.0, 3.0, 65_535.0]);
        }
        assert_eq!(values("16SC1", 0, 6, &[&little[..4], &[7, 7], &little[4..], &[7, 7]]), [1.0, 2.0, 3.0, -1.0]);
        let floats: Vec<u8> = [0.5_f32, -1.5, f32::MAX, 4.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        assert_eq!(values("32FC1", 0, 8, &[&floats]), [0.5, -1.5, f64::from(f32::MAX), 4.0]);
        let doubles: Vec<u8> = [0.5_f64, -1.5, 2.0, 4.0].iter().flat_map(|value| value.to_be_bytes()).collect();
        assert_eq!(values("64FC1", 1, 16, &[&doubles]), [0.5, -1.5, 2.0, 4.0]);
        let ints: Vec<u8> = [-7_i32, 1, 2, 3].iter().flat_map(|value| value.to_le_bytes()).collect();
        assert_eq!(values("32SC1", 0, 8, &[&ints]), [-7.0, 1.0, 2.0, 3.0]);
        assert_eq!(values("8UC3", 0, 6, &[&[1, 2, 3, 4, 5, 6], &[7, 8, 9, 10, 11, 12]]).len(), 12);
        assert_eq!(read(&tree, "data", &image("mono8", 0, [0, 0, 0], vec![])), Ok(vec![]));
    }

    #[test]
    fn what_is_no_number_or_does_not_fit_is_refused_in_one_line() {
        let tree = image_tree();
        let refused = |encoding: &str, sizes, n_bytes: usize| {
            let error = read(&tree, "data", &image(encoding, 0, sizes, vec![0; n_bytes])).unwrap_err();
            assert_eq!(error.lines().count(), 1);
            error
        };
        for encoding in
            ["rgb8", "bgr8", "bayer_rggb8", "yuv422", "", "16UC0", "16UC", "17UC1", "16UC99999999999", "a\nb"]
        {
            let error = refused(encoding, [1, 2, 4], 4);
            assert!(
                error.contains(&encoding.escape_default().to_string()) && error.contains("expected mono8"),
                "{error}"
            );
        }
        assert!(
            refused("16UC1", [2, 2, 2], 4)
                .contains("2 x 2 in 16UC1 with a step of 2 bytes holds 4 bytes; expected 4, and a step of at least 4")
        );
        refused("16UC1", [2, 2, 4], 7);
        refused("mono8", [u32::MAX, u32::MAX, u32::MAX], 8);
        refused("mono8", [0, 5, 0], 0);
        assert!(read(&tree, "data[3]", &[]).unwrap_err().contains("it packs pixels: leave the brackets out"));
        assert!(read(&cloud_tree(), "data", &[]).unwrap_err().contains("it packs points: write data[].z"));
        let compressed = self::tree("sensor_msgs/msg/CompressedImage", "string format\nuint8[] data");
        assert!(read(&compressed, "data", &[]).unwrap_err().contains("it is compressed"));
    }

    #[test]
    fn a_field_of_points_is_read_by_its_name_datatype_and_offset() {
        let field = |name: &str, offset, datatype, count| PointField { name: name.into(), offset, datatype, count };
        let fields = vec![field("x", 0, 7, 1), field("z", 4, 3, 1), field("rows", 6, 2, 2)];
        let point = |x: f32, z: i16, rows: [u8; 2], little: bool| {
            let (x, z) = if little { (x.to_le_bytes(), z.to_le_bytes()) } else { (x.to_be_bytes(), z.to_be_bytes()) };
            [&x[..], &z[..], &rows[..], &[9, 9]].concat()
        };
        for is_bigendian in [false, true] {
            let points = [(0.5, -3, [1, 2]), (1.5, 300, [3, 4]), (2.5, 7, [5, 6]), (3.5, 8, [7, 8])];
            let points: Vec<Vec<u8>> = points.map(|(x, z, rows)| point(x, z, rows, !is_bigendian)).into();
            let padding = vec![8_u8; 3];
            let data = [points[..2].concat(), padding.clone(), points[2..].concat(), padding].concat();
            let header = Header::default();
            let cloud = PointCloud2 {
                header,
                height: 2,
                width: 2,
                fields: fields.clone(),
                is_bigendian,
                point_step: 10,
                row_step: 23,
                data,
                is_dense: true,
            };
            let tree = cloud_tree();
            let read = |path: &str, cloud: &PointCloud2| read(&tree, path, &to_cdr(cloud));
            assert_eq!(read("data[].x", &cloud), Ok(vec![0.5, 1.5, 2.5, 3.5]));
            assert_eq!(read("data[].z", &cloud), Ok(vec![-3.0, 300.0, 7.0, 8.0]));
            assert_eq!(read("data[].rows", &cloud), Ok((1..=8).map(f64::from).collect()));
            assert!(read("data[].y", &cloud).unwrap_err().contains("a point has no field 'y'; it has x, z, rows"));
            let broken = |change: &dyn Fn(&mut PointCloud2)| {
                let mut cloud = cloud.clone();
                change(&mut cloud);
                let error = read("data[].z", &cloud).unwrap_err();
                assert_eq!(error.lines().count(), 1, "{error}");
            };
            broken(&|cloud| cloud.width = 3);
            broken(&|cloud| cloud.height = u32::MAX);
            broken(&|cloud| cloud.point_step = 0);
            broken(&|cloud| cloud.row_step = 0);
            broken(&|cloud| cloud.fields[1].offset = u32::MAX);
            broken(&|cloud| cloud.fields[1].count = u32::MAX);
            broken(&|cloud| cloud.fields[1].datatype = 9);
            broken(&|cloud| cloud.data.truncate(40));
        }
    }
}
