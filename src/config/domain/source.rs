//! Sources: streams of taxels, of joint angles and of the true force.

use std::collections::BTreeMap;

use super::super::error::ConfigError;
use super::super::scalar::ParamValue;
use super::super::text::one_line;
use super::fields::{RECEIPT, field_or, millis_to_ns, only, optional_field, stamp};
use super::hand::{is_hand, of_hand};
use super::reader::Reader;
use super::{TruthAxes, TruthSource};
use crate::fusion::{ForceUnit, FrameClock, JointSource, TactileSource};
use crate::msg::binding::{
    CountFrom, ForceFields, JointFields, NamesFrom, PeriodFrom, TaxelFields, Topic, TruthFields,
};
use crate::msg::dynamic::check_path;

/// Per source: the key of its type, its topic, and its type.
pub(super) type Named<'a> = [(String, &'a str, &'a str)];

/// Reads all sources of a list.
pub(super) fn all<S, T>(
    reader: &Reader<'_>,
    names: &[String],
    one: impl Fn(&Reader<'_>, &str) -> Result<(S, T), ConfigError>,
) -> Result<(Vec<S>, Vec<T>), ConfigError> {
    names.iter().map(|name| one(reader, name)).collect()
}

/// Reads a stream of taxels.
pub(super) fn tactile(reader: &Reader<'_>, name: &str) -> Result<(TactileSource, Topic<TaxelFields>), ConfigError> {
    let key = |tail: &str| format!("tactile.{name}.{tail}");
    let type_name = message_type(reader, &key("type"))?;
    let n_taxels = reader.count(&key("n_taxels"))?;
    let fields = taxel_fields(reader, &key, &type_name, n_taxels)?;
    let source = TactileSource {
        name: name.to_owned(),
        n_taxels,
        stamp_offset_ns: millis_to_ns(reader.double(&key("stamp_offset_ms"))?),
        inverted: reader.int(&key("sign"))? < 0,
        frame_clock: match reader.text(&key("frame_clock"))?.as_str() {
            "grid" => FrameClock::Grid,
            _ => FrameClock::Tactile,
        },
    };
    Ok((source, Topic { name: reader.topic(&key("topic"))?, type_name, fields }))
}

fn taxel_fields(
    reader: &Reader<'_>,
    key: &impl Fn(&str) -> String,
    type_name: &str,
    n_taxels: usize,
) -> Result<TaxelFields, ConfigError> {
    let known = TaxelFields::for_type(type_name);
    let said_rows = count(reader, &key("rows"))?;
    let cols_key = key("cols");
    let cols = count(reader, &cols_key)?;
    let cols_constant = match cols {
        Some(CountFrom::Constant(cols)) => Some(cols),
        Some(CountFrom::One) => Some(1),
        _ => None,
    };
    if cols_constant.is_some_and(|cols| cols != n_taxels) {
        return Err(reader.refused(&cols_key, format!("must equal {} = {n_taxels}", key("n_taxels"))));
    }
    let row_period = row_period(reader, key, known.as_ref())?;
    let rows = said_rows.or_else(|| known.as_ref().map(|known| known.rows.clone())).unwrap_or(CountFrom::One);
    // With a layout there is usually one row. A message with several rows but no period is dropped and counted.
    if !matches!(rows, CountFrom::One | CountFrom::Layout(_)) && row_period == PeriodFrom::None {
        let about = format!("with {} there may be several rows, whose times are not known without it", key("rows"));
        return Err(reader.missing_because(&format!("{} or {}", key("row_period"), key("row_period_ms")), &about));
    }
    let sequence = match optional_field(reader, &key("sequence"))? {
        None => known.as_ref().and_then(|known| known.sequence.clone()),
        Some(path) => path,
    };
    let stamp_key = key("stamp");
    let stamp = if known.as_ref().is_some_and(|known| known.stamp.is_none()) {
        let about = format!("{type_name} has no header, so its stamp can only be the time of receipt; write receipt");
        match reader.is_set(&stamp_key) {
            true if reader.text(&stamp_key)? == RECEIPT => stamp(reader, key)?,
            true => return Err(reader.refused(&stamp_key, format!("is not there: {about}"))),
            false => return Err(reader.missing_because(&stamp_key, &about)),
        }
    } else {
        stamp(reader, key)?
    };
    let values = values(reader, key, known.as_ref())?;
    let no_reading = match reader.is_set(&key("no_reading")) {
        true => Some(reader.double(&key("no_reading"))? as f32),
        false => None,
    };
    let only = only(reader, key)?;
    Ok(TaxelFields { stamp: Some(stamp), values, no_reading, rows, cols, row_period, sequence, only })
}

/// Paths of the readings: one, or several one after another.
fn values(
    reader: &Reader<'_>,
    key: &impl Fn(&str) -> String,
    known: Option<&TaxelFields>,
) -> Result<Vec<String>, ConfigError> {
    let (field, fields) = (key("field"), key("fields"));
    if !reader.is_set(&fields) {
        let known = known.and_then(|known| known.values.first());
        return Ok(vec![field_or(reader, &field, known.map(String::as_str))?]);
    }
    if reader.is_set(&field) {
        return Err(reader.refused(&fields, format!("and {field} exclude each other")));
    }
    let paths = reader.unique_texts(&fields)?;
    reader.refuse_empty(&fields, &paths)?;
    match paths.iter().find_map(|path| check_path(path).err()) {
        Some(error) => Err(reader.refused(&fields, format!("has what is no path of a field: {error}"))),
        None => Ok(paths),
    }
}

fn row_period(
    reader: &Reader<'_>,
    key: &impl Fn(&str) -> String,
    known: Option<&TaxelFields>,
) -> Result<PeriodFrom, ConfigError> {
    let (period_key, constant_key) = (key("row_period"), key("row_period_ms"));
    let period = optional_field(reader, &period_key)?;
    if reader.is_set(&constant_key) {
        if let Some(Some(path)) = period {
            return Err(reader.refused(&constant_key, format!("and {period_key} = \"{path}\" exclude each other")));
        }
        // The range in the table is above 0 ms. The result is at least 1 ns.
        return Ok(PeriodFrom::Constant(millis_to_ns(reader.double(&constant_key)?).max(1)));
    }
    Ok(match period {
        Some(Some(path)) => PeriodFrom::Field(path),
        None => known.map_or(PeriodFrom::None, |known| known.row_period.clone()),
        Some(None) => PeriodFrom::None,
    })
}

/// Reads a stream of joint angles.
pub(super) fn joint(reader: &Reader<'_>, name: &str) -> Result<(JointSource, Topic<JointFields>), ConfigError> {
    let key = |tail: &str| format!("joint.{name}.{tail}");
    let type_name = message_type(reader, &key("type"))?;
    if is_hand(reader, &key) {
        return of_hand(reader, name, type_name);
    }
    let known = JointFields::for_type(&type_name);
    let (names_field, names) = (key("names_field"), key("names"));
    let names = match (reader.is_set(&names_field), reader.is_set(&names)) {
        (_, true) if known.is_some() => {
            return Err(reader.refused(&names, format!("is for types without names, and {type_name} carries them")));
        }
        (true, true) => return Err(reader.refused(&names, format!("and {names_field} exclude each other"))),
        (false, true) => match reader.unique_texts(&names)? {
            constant if constant.is_empty() => return Err(reader.refused(&names, "must name at least one")),
            constant => NamesFrom::Constant(constant),
        },
        (true, false) => NamesFrom::Field(reader.field(&names_field)?),
        (false, false) => match &known {
            Some(known) => known.names.clone(),
            None => {
                let about = "joints are told apart by name, so say which field has the names, or what they are";
                return Err(reader.missing_because(&format!("{names_field} or {names}"), about));
            }
        },
    };
    let scale_key = key("scale");
    let unit = if reader.bool(&key("degrees"))? { std::f64::consts::PI / 180.0 } else { 1.0 };
    let scale = reader.double(&scale_key)? * unit;
    if !scale.is_normal() {
        return Err(reader.refused(&scale_key, "must not be 0, nor so small or large that angles vanish"));
    }
    let source = JointSource {
        name: name.to_owned(),
        stamp_offset_ns: millis_to_ns(reader.double(&key("stamp_offset_ms"))?),
        scale,
    };
    let fields = JointFields {
        stamp: Some(stamp(reader, &key)?),
        positions: field_or(reader, &key("field"), known.as_ref().map(|known| known.positions.as_str()))?,
        names,
        only: only(reader, &key)?,
    };
    Ok((source, Topic { name: reader.topic(&key("topic"))?, type_name, fields }))
}

/// Reads a force sensor that measures the true force.
pub(super) fn truth(reader: &Reader<'_>, name: &str) -> Result<(TruthSource, Topic<TruthFields>), ConfigError> {
    let key = |tail: &str| format!("truth.{name}.{tail}");
    let type_name = message_type(reader, &key("type"))?;
    let axes = truth_axes(reader, &key)?;
    let force = match &axes {
        Some((paths, _)) => ForceFields::Axes(paths.clone()),
        None => match TruthFields::for_type(&type_name) {
            Some(known) if !reader.is_set(&key("field")) => known.force,
            _ => ForceFields::Normal(reader.field(&key("field"))?),
        },
    };
    let source = TruthSource {
        name: name.to_owned(),
        stamp_offset_ns: millis_to_ns(reader.double(&key("stamp_offset_ms"))?),
        inverted: reader.int(&key("sign"))? < 0,
        unit: match reader.text(&key("unit"))?.as_str() {
            "gF" => ForceUnit::GramForce,
            "kgf" => ForceUnit::KilogramForce,
            "mN" => ForceUnit::Millinewton,
            _ => ForceUnit::Newton,
        },
        axes: axes.map(|(_, axes)| axes),
    };
    let fields = TruthFields { stamp: Some(stamp(reader, &key)?), force, only: only(reader, &key)? };
    Ok((source, Topic { name: reader.topic(&key("topic"))?, type_name, fields }))
}

/// The paths of the force along x, y and z of the patch, and their signs, where a force sensor tells all three.
fn truth_axes(
    reader: &Reader<'_>,
    key: &impl Fn(&str) -> String,
) -> Result<Option<([String; 3], TruthAxes)>, ConfigError> {
    let (fields_key, signs_key) = (key("fields"), key("signs"));
    let paths = reader.unique_texts(&fields_key)?;
    if paths.is_empty() {
        if reader.is_set(&signs_key) {
            return Err(reader.refused(&signs_key, format!("is for {fields_key}; set {} for one axis", key("sign"))));
        }
        return Ok(None);
    }
    let Ok(paths) = <[String; 3]>::try_from(paths) else {
        return Err(reader.refused(&fields_key, "must name three fields: the force along x, y and z of the patch"));
    };
    if let Some(path) = paths.iter().find(|path| check_path(path).is_err()) {
        let problem = format!("has \"{}\", which is not the path of a field, such as wrench.force.x", one_line(path));
        return Err(reader.refused(&fields_key, problem));
    }
    for (one, instead) in [("field", &fields_key), ("sign", &signs_key)] {
        if reader.is_set(&key(one)) {
            return Err(reader.refused(&key(one), format!("is for one axis; with {fields_key}, set {instead}")));
        }
    }
    let signs = match reader.value(&signs_key) {
        Some(ParamValue::IntArray(signs)) => signs,
        _ => vec![1; 3],
    };
    let Ok(signs) = <[i64; 3]>::try_from(signs) else {
        return Err(reader.refused(&signs_key, "must have three elements, 1 or -1: one for each of the fields"));
    };
    // The normal is that of the region it belongs to, which is not known yet.
    Ok(Some((paths, TruthAxes { inverted: signs.map(|sign| sign < 0), ..TruthAxes::default() })))
}

/// Where the types of a family of sources are set, for [`one_type_a_topic`].
pub(super) fn types<'t, F>(family: &str, names: &[String], topics: &'t [Topic<F>]) -> Vec<(String, &'t str, &'t str)> {
    let of_source = |(name, topic): (&String, &'t Topic<F>)| {
        (format!("{family}.{name}.type"), topic.name.as_str(), topic.type_name.as_str())
    };
    names.iter().zip(topics).map(of_source).collect()
}

/// Refuses sources that read one topic as two different types.
pub(super) fn one_type_a_topic(reader: &Reader<'_>, sources: &Named<'_>) -> Result<(), ConfigError> {
    let mut known: BTreeMap<&str, (&str, &str)> = BTreeMap::new();
    for (key, topic, type_name) in sources {
        match known.get(topic) {
            Some((_, other)) if other == type_name => {}
            Some((other_key, other)) => {
                let is_own_truth = key.starts_with("truth.") && other_key.starts_with("tactile.");
                let advice = match is_own_truth {
                    true => "taxels can't be their own true force; name the topic of a force sensor",
                    false => "it has one type",
                };
                let problem = format!("but {other_key} is {other}, and both are on the topic {topic}: {advice}");
                return Err(reader.refused(key, problem));
            }
            None => {
                known.insert(topic, (key, type_name));
            }
        }
    }
    Ok(())
}

/// A count, given as a number or as the path of a field. `None` if it is empty or not set.
fn count(reader: &Reader<'_>, key: &str) -> Result<Option<CountFrom>, ConfigError> {
    if !reader.is_set(key) {
        return Ok(None);
    }
    match reader.value(key) {
        Some(ParamValue::Int(1)) => Ok(Some(CountFrom::One)),
        Some(ParamValue::Int(_)) => Ok(Some(CountFrom::Constant(reader.count(key)?))),
        _ => Ok(optional_field(reader, key)?.flatten().map(CountFrom::Field)),
    }
}

/// Full name of a message type.
fn message_type(reader: &Reader<'_>, key: &str) -> Result<String, ConfigError> {
    let type_name = reader.text(key)?;
    let is_word = |word: &str, first: fn(&char) -> bool| {
        word.starts_with(|character: char| first(&character))
            && word.chars().all(|character| character.is_ascii_alphanumeric() || character == '_')
    };
    match type_name.split('/').collect::<Vec<_>>().as_slice() {
        [package, "msg", name]
            if is_word(package, char::is_ascii_lowercase) && is_word(name, char::is_ascii_uppercase) =>
        {
            Ok(type_name)
        }
        [package, name] if is_word(package, char::is_ascii_lowercase) && is_word(name, char::is_ascii_uppercase) => {
            Err(reader.refused(key, format!("is not a message type: write {package}/msg/{name}")))
        }
        _ => Err(reader.refused(key, "is not a message type, such as sensor_msgs/msg/JointState")),
    }
}
