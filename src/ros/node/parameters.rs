//! The node's parameters as other nodes read and set them: every key of the table, with its range, unit and meaning.

use std::collections::{BTreeMap, BTreeSet};

use ros2_client::parameters::raw;
use serde::{Deserialize, Serialize};

use crate::config::keys::{ParamDefault, ParamKey, ParamKind, ParamRange};
use crate::config::{Config, Origin, ParamTree, ParamValue, QOS_OVERRIDES};
use crate::msg::{Time, WireType};

/// Maximum number of names, prefixes or values in one request; a node with every finger has some 300 parameters.
pub(super) const MAX_ENTRIES: usize = 1000;

/// Maximum number of bytes of names and values in one request.
pub(super) const MAX_BYTES: usize = 256 * 1024;

/// Maximum number of characters of an unknown name repeated in an answer.
const MAX_SHOWN: usize = 100;

/// The parameters of a node, and the configuration built from them.
#[derive(Debug, Clone)]
pub(super) struct Parameters {
    tree: ParamTree,
    cfg: Config,
    /// The set of parameters is fixed while the node runs; only values change.
    keys: BTreeMap<String, &'static ParamKey>,
}

/// A request that is refused as a whole, because answering it would take too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum TooLarge {
    #[error("{0} entries in one request: expected at most {MAX_ENTRIES}; ask several times")]
    Entries(usize),
    #[error("{0} bytes of names and values in one request: expected at most {MAX_BYTES}; ask several times")]
    Bytes(usize),
}

/// Checks a request with these names or prefixes against the limits.
///
/// # Errors
/// [`TooLarge`] by entries or bytes.
pub(super) fn check_names(names: &[String]) -> Result<(), TooLarge> {
    check(names.len(), names.iter().map(String::len))
}

/// Checks a request with these values against the limits.
///
/// # Errors
/// [`TooLarge`] by entries or bytes.
pub(super) fn check_values(changes: &[raw::Parameter]) -> Result<(), TooLarge> {
    check(changes.len(), changes.iter().map(|change| change.name.len() + size(&change.value)))
}

fn check(n_entries: usize, sizes: impl Iterator<Item = usize>) -> Result<(), TooLarge> {
    if n_entries > MAX_ENTRIES {
        return Err(TooLarge::Entries(n_entries));
    }
    match sizes.sum() {
        0..=MAX_BYTES => Ok(()),
        n_bytes => Err(TooLarge::Bytes(n_bytes)),
    }
}

/// Size of a value in bytes.
fn size(value: &raw::ParameterValue) -> usize {
    let strings: usize = value.string_array.iter().map(|text| text.len() + size_of::<String>()).sum();
    let numbers = 8 * (value.int_array.len() + value.double_array.len());
    value.string_value.len() + value.byte_array.len() + value.bool_array.len() + numbers + strings
}

/// `rcl_interfaces/msg/ParameterEvent`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct ParameterEvent {
    stamp: Time,
    node: String,
    new_parameters: Vec<raw::Parameter>,
    changed_parameters: Vec<raw::Parameter>,
    deleted_parameters: Vec<raw::Parameter>,
}

impl WireType for ParameterEvent {
    const TYPE_NAME: &'static str = "rcl_interfaces/msg/ParameterEvent";
}

impl ParameterEvent {
    pub(super) fn changed(stamp: Time, node: &str, changed_parameters: Vec<raw::Parameter>) -> Self {
        let (new_parameters, deleted_parameters) = (Vec::new(), Vec::new());
        ParameterEvent { stamp, node: node.to_owned(), new_parameters, changed_parameters, deleted_parameters }
    }
}

impl Parameters {
    pub(super) fn new(tree: ParamTree, cfg: Config) -> Self {
        let keys = cfg.keys();
        Parameters { tree, cfg, keys }
    }

    /// The configuration built from the parameters.
    pub(super) fn config(&self) -> &Config {
        &self.cfg
    }

    /// Sets parameters, all or none of them.
    ///
    /// # Errors
    /// The reason for the refusal, in one line; nothing has changed.
    pub(super) fn set(&mut self, changes: &[raw::Parameter]) -> Result<(), String> {
        check_values(changes).map_err(|error| error.to_string())?;
        for change in changes {
            let name = &change.name;
            let refuse = |why: &str| Err(format!("{} {why}", shown(name)));
            match self.keys.get(name.as_str()) {
                Some(key) if key.at_run_time => {}
                Some(_) => return refuse("is read at start; change the parameter file and restart the node"),
                None if name.starts_with(QOS_OVERRIDES) => {
                    return refuse("is read at start; change the parameter file and restart the node");
                }
                None => return refuse("is not a parameter of this node; list its parameters to see those that are"),
            }
            if from_raw(&change.value).is_none() {
                return refuse("can't be deleted; set it to a value");
            }
        }
        let mut tree = self.tree.clone();
        for change in changes {
            if let Some(value) = from_raw(&change.value) {
                tree.set(&change.name, value, Origin::Request);
            }
        }
        self.cfg = Config::from_tree(&tree).map_err(|error| error.to_string())?;
        self.tree = tree;
        Ok(())
    }

    /// A value, or the default if it is not set; "not set" if there is neither or the name is unknown.
    pub(super) fn get(&self, name: &str) -> raw::ParameterValue {
        let key = self.keys.get(name).copied();
        let default = || key.and_then(|key| key.default.value());
        let value = self.tree.get(name).map(|param| param.value.clone()).or_else(default);
        to_raw(value.as_ref(), key.map(|key| key.kind))
    }

    /// The parameters that have been set, each once, with its current type: an integer set on a double is a double.
    pub(super) fn now(&self, changes: &[raw::Parameter]) -> Vec<raw::Parameter> {
        let names: BTreeSet<&String> = changes.iter().map(|change| &change.name).collect();
        names.into_iter().map(|name| raw::Parameter { name: name.clone(), value: self.get(name) }).collect()
    }

    /// Names below any of the prefixes, at most `depth` parts below it; 0 is any depth.
    pub(super) fn list(&self, prefixes: &[String], depth: u64) -> (Vec<String>, Vec<String>) {
        let within = |rest: &str| depth == 0 || (rest.split('.').count() as u64) <= depth;
        let listed = |name: &str| {
            let below = |prefix: &String| match name.strip_prefix(prefix.as_str()) {
                Some("") => true,
                Some(rest) => rest.strip_prefix('.').is_some_and(within),
                None => false,
            };
            if prefixes.is_empty() { within(name) } else { prefixes.iter().any(below) }
        };
        let names: Vec<String> = self.names().into_iter().filter(|name| listed(name)).collect();
        let mut above: Vec<String> =
            names.iter().filter_map(|name| name.rsplit_once('.')).map(|(above, _)| above.to_owned()).collect();
        above.sort();
        above.dedup();
        (names, above)
    }

    /// Description and limits of a parameter.
    pub(super) fn describe(&self, name: &str) -> raw::ParameterDescriptor {
        let Some(key) = self.keys.get(name) else {
            let known = self.tree.get(name).is_some();
            return raw::ParameterDescriptor {
                name: name.to_owned(),
                r#type: self.get(name).ptype,
                description: if known { "QoS of a topic" } else { "" }.to_owned(),
                additional_constraints: String::new(),
                read_only: known,
                dynamic_typing: false,
                floating_point_range: Vec::new(),
                integer_range: Vec::new(),
            };
        };
        described(name, key)
    }

    fn names(&self) -> Vec<String> {
        let overrides = self.tree.iter().map(|(name, _)| name).filter(|name| name.starts_with(QOS_OVERRIDES));
        self.keys.keys().map(String::as_str).chain(overrides).map(str::to_owned).collect()
    }
}

/// A foreign name for an answer or a log line: on one line, with limited length.
pub(super) fn shown(name: &str) -> String {
    let mut text: String = name.chars().take(MAX_SHOWN).flat_map(char::escape_debug).collect();
    if name.chars().nth(MAX_SHOWN).is_some() {
        text.push_str("...");
    }
    text
}

fn described(name: &str, key: &ParamKey) -> raw::ParameterDescriptor {
    let range = |from_value, to_value| raw::FloatingPointRange { from_value, to_value, step: 0.0 };
    let unit = if key.unit.is_empty() { String::new() } else { format!(" ({})", key.unit) };
    // A ROS range includes both ends; a range that doesn't is described in words.
    let (floats, ints, constraints) = match key.range {
        ParamRange::Closed { min, max } => (vec![range(min, max)], vec![], String::new()),
        ParamRange::Above { min, max } => (vec![range(min, max)], vec![], format!("more than {min}")),
        ParamRange::Int { min, max } if key.kind == ParamKind::Int => {
            (vec![], vec![raw::IntegerRange { from_value: min, to_value: max, step: 1 }], String::new())
        }
        ParamRange::Any => (vec![], vec![], String::new()),
        other => (vec![], vec![], other.to_string()),
    };
    raw::ParameterDescriptor {
        name: name.to_owned(),
        r#type: type_of(key.kind),
        description: format!("{}{unit}", key.about),
        additional_constraints: match key.default {
            ParamDefault::Depends(words) if constraints.is_empty() => format!("default: {words}"),
            ParamDefault::Depends(words) => format!("{constraints}; default: {words}"),
            _ => constraints,
        },
        read_only: !key.at_run_time,
        dynamic_typing: key.kind == ParamKind::IntOrField,
        floating_point_range: floats,
        integer_range: ints,
    }
}

fn type_of(kind: ParamKind) -> u8 {
    match kind {
        ParamKind::Bool => raw::ParameterType::BOOL,
        ParamKind::Int => raw::ParameterType::INTEGER,
        ParamKind::Double => raw::ParameterType::DOUBLE,
        ParamKind::Str | ParamKind::IntOrField => raw::ParameterType::STRING,
        ParamKind::IntArray => raw::ParameterType::INTEGER_ARRAY,
        ParamKind::DoubleArray(_) | ParamKind::Doubles => raw::ParameterType::DOUBLE_ARRAY,
        ParamKind::StrArray => raw::ParameterType::STRING_ARRAY,
    }
}

/// A value on the wire. If the file has an int or an empty array for a parameter of another type, it gets that type.
pub(in crate::ros) fn to_raw(value: Option<&ParamValue>, kind: Option<ParamKind>) -> raw::ParameterValue {
    let mut on_wire = raw::ParameterValue {
        ptype: raw::ParameterType::NOT_SET,
        boolean_value: false,
        int_value: 0,
        double_value: 0.0,
        string_value: String::new(),
        byte_array: Vec::new(),
        bool_array: Vec::new(),
        int_array: Vec::new(),
        double_array: Vec::new(),
        string_array: Vec::new(),
    };
    let Some(value) = value else { return on_wire };
    on_wire.ptype = match (value, kind) {
        (ParamValue::Int(value), Some(ParamKind::Double)) => {
            on_wire.double_value = *value as f64;
            raw::ParameterType::DOUBLE
        }
        (ParamValue::IntArray(values), Some(ParamKind::DoubleArray(_))) => {
            on_wire.double_array = values.iter().map(|value| *value as f64).collect();
            raw::ParameterType::DOUBLE_ARRAY
        }
        (ParamValue::EmptyArray, Some(kind)) => type_of(kind),
        (ParamValue::EmptyArray, None) => raw::ParameterType::STRING_ARRAY,
        (ParamValue::Bool(value), _) => {
            on_wire.boolean_value = *value;
            raw::ParameterType::BOOL
        }
        (ParamValue::Int(value), _) => {
            on_wire.int_value = *value;
            raw::ParameterType::INTEGER
        }
        (ParamValue::Double(value), _) => {
            on_wire.double_value = *value;
            raw::ParameterType::DOUBLE
        }
        (ParamValue::Str(value), _) => {
            on_wire.string_value.clone_from(value);
            raw::ParameterType::STRING
        }
        (ParamValue::BoolArray(values), _) => {
            on_wire.bool_array.clone_from(values);
            raw::ParameterType::BOOL_ARRAY
        }
        (ParamValue::IntArray(values), _) => {
            on_wire.int_array.clone_from(values);
            raw::ParameterType::INTEGER_ARRAY
        }
        (ParamValue::DoubleArray(values), _) => {
            on_wire.double_array.clone_from(values);
            raw::ParameterType::DOUBLE_ARRAY
        }
        (ParamValue::StrArray(values), _) => {
            on_wire.string_array.clone_from(values);
            raw::ParameterType::STRING_ARRAY
        }
    };
    on_wire
}

/// The value of a request; `None` if it is not set. Bytes, which no parameter here takes, become ints.
pub(in crate::ros) fn from_raw(value: &raw::ParameterValue) -> Option<ParamValue> {
    Some(match value.ptype {
        raw::ParameterType::BOOL => ParamValue::Bool(value.boolean_value),
        raw::ParameterType::INTEGER => ParamValue::Int(value.int_value),
        raw::ParameterType::DOUBLE => ParamValue::Double(value.double_value),
        raw::ParameterType::STRING => ParamValue::Str(value.string_value.clone()),
        raw::ParameterType::BYTE_ARRAY => {
            ParamValue::IntArray(value.byte_array.iter().map(|b| i64::from(*b)).collect())
        }
        raw::ParameterType::BOOL_ARRAY => ParamValue::BoolArray(value.bool_array.clone()),
        raw::ParameterType::INTEGER_ARRAY => ParamValue::IntArray(value.int_array.clone()),
        raw::ParameterType::DOUBLE_ARRAY => ParamValue::DoubleArray(value.double_array.clone()),
        raw::ParameterType::STRING_ARRAY => ParamValue::StrArray(value.string_array.clone()),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{DEFAULT_NODE, parse_param_file};

    fn parameters() -> Parameters {
        let tree = parse_param_file(include_str!("../../../params/example.yaml"), "p.yaml", DEFAULT_NODE).unwrap();
        let cfg = Config::from_tree(&tree).unwrap();
        Parameters::new(tree, cfg)
    }

    fn change(name: &str, value: ParamValue) -> raw::Parameter {
        raw::Parameter { name: name.to_owned(), value: to_raw(Some(&value), None) }
    }

    #[test]
    fn thresholds_change_at_run_time_and_the_rest_is_read_only() {
        let mut parameters = parameters();
        parameters.set(&[change("contact.on_frames", ParamValue::Int(7))]).unwrap();
        assert_eq!(parameters.get("contact.on_frames").int_value, 7);
        assert_eq!(parameters.config().fusion().regions()[0].contact.on_frames.get(), 7);
        let refused = |parameters: &mut Parameters, name, value| parameters.set(&[change(name, value)]).unwrap_err();
        assert_eq!(
            refused(&mut parameters, "timing.max_gap_ms", ParamValue::Double(1.0)),
            "timing.max_gap_ms is read at start; change the parameter file and restart the node"
        );
        let pair = refused(&mut parameters, "contact.force_on", ParamValue::Double(0.001));
        let told = "contact.force_off = 0.014709975 N must be below contact.force_on = 0.001 N";
        assert!(pair.starts_with("p.yaml:") && pair.ends_with(told), "{pair}");
        assert!(refused(&mut parameters, "contact.force_on", ParamValue::Bool(true)).contains("is of type bool"));
        assert!(refused(&mut parameters, "contact.forc_on", ParamValue::Int(1)).contains("is not a parameter"));
        assert_eq!(parameters.config().fusion().regions()[0].contact.on_frames.get(), 7);
    }

    #[test]
    fn several_are_set_together_or_not_at_all() {
        let mut parameters = parameters();
        let pair =
            [change("contact.force_on", ParamValue::Double(2.0)), change("contact.force_off", ParamValue::Int(1))];
        parameters.set(&pair).unwrap();
        assert_eq!(parameters.get("contact.force_off").double_value, 1.0);
        let half =
            [change("contact.on_frames", ParamValue::Int(5)), change("contact.force_off", ParamValue::Double(3.0))];
        assert!(parameters.set(&half).is_err());
        assert_eq!(parameters.get("contact.on_frames").int_value, 2);
    }

    #[test]
    fn an_integer_set_on_a_double_is_told_as_the_double_that_it_is() {
        let mut parameters = parameters();
        let set = [change("contact.force_on", ParamValue::Int(2)), change("contact.force_on", ParamValue::Int(3))];
        parameters.set(&set).unwrap();
        let told = parameters.now(&set);
        assert_eq!(told.len(), 1, "each once");
        assert_eq!(told[0].name, "contact.force_on");
        assert_eq!((told[0].value.ptype, told[0].value.double_value), (raw::ParameterType::DOUBLE, 3.0));
    }

    #[test]
    fn requests_have_a_size_that_is_refused_in_one_short_line() {
        let mut parameters = parameters();
        let many = vec![change("contact.on_frames", ParamValue::Int(7)); 60_000];
        let refused = parameters.set(&many).unwrap_err();
        assert_eq!(refused, "60000 entries in one request: expected at most 1000; ask several times");
        let long = change("contact.on_frames", ParamValue::Str("x".repeat(5_000_000)));
        let refused = parameters.set(&[long]).unwrap_err();
        assert!(refused.contains("5000017 bytes of names and values") && refused.len() < 150, "{refused}");
        let lists = change("regions", ParamValue::StrArray(vec![String::new(); 60_000]));
        assert!(parameters.set(&[lists]).unwrap_err().contains("bytes of names and values"));
        let name = change(&"\u{1b}[2J".repeat(1000), ParamValue::Int(7));
        let refused = parameters.set(&[name]).unwrap_err();
        assert!(refused.len() < 1000 && !refused.contains('\u{1b}'), "{refused}");
        assert_eq!(parameters.get("contact.on_frames").int_value, 2);
        assert_eq!(check_names(&vec![String::new(); 60_000]), Err(TooLarge::Entries(60_000)));
        assert_eq!(check_names(&["x".repeat(MAX_BYTES + 1)]), Err(TooLarge::Bytes(MAX_BYTES + 1)));
        assert_eq!(check_names(&vec!["x".repeat(100); 1000]), Ok(()));
    }

    #[test]
    fn each_is_described_with_range_unit_and_whether_it_can_be_set() {
        let parameters = parameters();
        let on = parameters.describe("contact.force_on");
        assert!(on.description.ends_with("(N)") && !on.read_only, "{on:?}");
        assert_eq!((on.r#type, on.floating_point_range[0].to_value), (raw::ParameterType::DOUBLE, 1000.0));
        assert!(parameters.describe("glove").read_only);
        assert_eq!(parameters.describe("nothing").r#type, raw::ParameterType::NOT_SET);
    }

    #[test]
    fn names_are_listed_below_prefixes_and_down_to_a_depth() {
        let parameters = parameters();
        let (all, _) = parameters.list(&[], 0);
        assert!(all.len() > 50 && all.contains(&"region.index.contact.force_on".to_owned()));
        let (top, above) = parameters.list(&[], 1);
        assert!(top.contains(&"regions".to_owned()) && !top.iter().any(|name| name.contains('.')) && above.is_empty());
        let (contact, above) = parameters.list(&["contact".to_owned()], 1);
        let names =
            ["by", "force_off", "force_on", "off_frames", "on_frames", "touch_evidence", "touch_off", "touch_on"];
        assert_eq!(contact, names.map(|name| format!("contact.{name}")));
        assert_eq!(above, ["contact"]);
    }
}
