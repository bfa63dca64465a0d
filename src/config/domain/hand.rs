//! Joint angles that are computed from the keypoints of a hand.

use super::super::error::ConfigError;
use super::fields::{field_or, millis_to_ns, only, optional_field, stamp_or};
use super::reader::Reader;
use crate::fusion::JointSource;
use crate::hand::{JOINTS, Layout, NamedLayout, Side};
use crate::msg::binding::{HandFields, JointFields, NamesFrom, Topic, hand_paths, hand_stamp};
use crate::msg::dynamic::check_path;

/// True if a source sends keypoints instead of angles.
pub(super) fn is_hand(reader: &Reader<'_>, key: &impl Fn(&str) -> String) -> bool {
    reader.text(&key("hand.layout")).is_ok_and(|layout| !layout.is_empty()) || reader.is_set(&key("hand.points"))
}

/// Reads a source of keypoints.
pub(super) fn of_hand(
    reader: &Reader<'_>,
    name: &str,
    type_name: String,
) -> Result<(JointSource, Topic<JointFields>), ConfigError> {
    let key = |tail: &str| format!("joint.{name}.{tail}");
    let known = hand_paths(&type_name);
    let (points, layout) = points(reader, &key)?;
    let side = match reader.text(&key("hand.side"))?.as_str() {
        "left" => Side::Left,
        "right" => Side::Right,
        _ => {
            return Err(
                reader.missing_because(&key("hand.side"), "left or right: the points of a hand don't tell which")
            );
        }
    };
    for tail in ["degrees", "scale"] {
        if reader.is_set(&key(tail)) {
            return Err(
                reader.refused(&key(tail), "is for messages of angles: those of a hand's points come out in rad")
            );
        }
    }
    let names = match optional_field(reader, &key("names_field"))? {
        Some(path) => path.into_iter().collect(),
        None => known.map_or_else(Vec::new, |known| known.names.iter().map(|path| (*path).to_owned()).collect()),
    };
    if names.is_empty() && reader.text(&key("hand.layout"))? == "manus" {
        let about =
            "points of Manus gloves are told by name: write manus_ros2_msgs/msg/ManusGlove as the type, or the path";
        return Err(reader.missing_because(&key("names_field"), about));
    }
    let joints = match reader.is_set(&key("names")) {
        false => JOINTS.map(str::to_owned).to_vec(),
        true => reader.unique_texts(&key("names"))?,
    };
    if joints.len() != JOINTS.len() {
        let problem = format!("must name {} joints, in the order {}", JOINTS.len(), JOINTS.join(", "));
        return Err(reader.refused(&key("names"), problem));
    }
    let stamp_at = hand_stamp(&type_name, &points).unwrap_or_else(|| "header.stamp".to_owned());
    if !reader.is_set(&key("stamp")) && check_path(&stamp_at).is_err() {
        let problem = "ends with a name that a field path can't hold: set stamp, too";
        return Err(reader.refused(&key("hand.points"), problem));
    }
    let stamp = stamp_or(reader, &key, &stamp_at)?;
    let valid = match optional_field(reader, &key("hand.valid"))? {
        Some(path) => path,
        None => known.and_then(|known| known.valid).map(str::to_owned),
    };
    let hand = HandFields { layout, side, points, names, valid, first: reader.count(&key("hand.first"))?, joints };
    let fields = JointFields {
        stamp: Some(stamp),
        positions: field_or(reader, &key("field"), known.map(|known| known.positions))?,
        names: NamesFrom::Hand(Box::new(hand)),
        only: only(reader, &key)?,
    };
    let source = JointSource {
        name: name.to_owned(),
        stamp_offset_ns: millis_to_ns(reader.double(&key("stamp_offset_ms"))?),
        scale: 1.0,
    };
    Ok((source, Topic { name: reader.topic(&key("topic"))?, type_name, fields }))
}

/// Names of the points, and the positions of the keypoints among them.
fn points(reader: &Reader<'_>, key: &impl Fn(&str) -> String) -> Result<(Vec<String>, Layout), ConfigError> {
    let (layout_key, points_key) = (key("hand.layout"), key("hand.points"));
    let named = match reader.text(&layout_key)?.as_str() {
        "openxr" => Some(NamedLayout::OpenXr),
        "openxr25" => Some(NamedLayout::OpenXr25),
        "mano21" => Some(NamedLayout::Mano21),
        "manus" => Some(NamedLayout::Manus),
        _ => None,
    };
    match named {
        Some(_) if reader.is_set(&points_key) => {
            Err(reader.refused(&points_key, format!("and {layout_key} exclude each other")))
        }
        Some(named) => Ok((named.points(), named.layout())),
        None => {
            let points = reader.unique_texts(&points_key)?;
            let layout =
                Layout::of_count(points.len()).map_err(|error| reader.refused(&points_key, error.to_string()))?;
            Ok((points, layout))
        }
    }
}
