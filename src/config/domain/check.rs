//! Checks each key and value on its own.

use super::super::QOS_OVERRIDES;
use super::super::error::ConfigError;
use super::super::keys::{KEYS, ParamKind, find};
use super::super::param_file::ParamTree;
use super::super::scalar::ParamValue;
use super::super::text::{list, nearest, one_line};

/// Hint for an error about an unknown key.
pub(super) const EXPLAINED: &str = "params/example.yaml explains those that there are";

/// Refuses unknown keys, values of the wrong type, and values out of range. Unknown keys in a section that several
/// nodes share are assumed to be for other nodes, and returned, unless they are similar to one of our keys.
pub(super) fn keys_and_values(tree: &ParamTree) -> Result<Vec<&str>, ConfigError> {
    let mut of_others = Vec::new();
    // QoS overrides contain topic names. The live node knows the topics and checks them.
    for (key, param) in tree.iter().filter(|(key, _)| !key.starts_with(QOS_OVERRIDES)) {
        let origin = param.origin.to_string();
        let Some(known) = find(key) else {
            let meant = meant(key);
            if param.origin.is_shared() && meant.is_none() {
                of_others.push(key);
                continue;
            }
            let hint = meant.map_or(EXPLAINED.to_owned(), |meant| format!("did you mean {}?", one_line(&meant)));
            return Err(ConfigError::Unknown { origin, key: one_line(key), hint });
        };
        let (key, value) = (one_line(key), param.value.to_string());
        if !known.kind.fits(&param.value) {
            let expected = match (known.kind, &param.value) {
                (ParamKind::Str, ParamValue::EmptyArray) => "string".to_owned(),
                (ParamKind::Str, _) => "string: write it in quotes".to_owned(),
                (ParamKind::StrArray, ParamValue::Str(_)) => format!("string[]: write [{value}]"),
                (kind, _) => kind.to_string(),
            };
            return Err(ConfigError::WrongType { origin, key, value, got: param.value.type_name(), expected });
        }
        if !known.range.contains(&param.value) {
            let unit = if known.unit.is_empty() { String::new() } else { format!(" {}", known.unit) };
            let range = format!("{}{unit}", known.range);
            return Err(ConfigError::OutOfRange { origin, key, value: format!("{value}{unit}"), range });
        }
    }
    Ok(of_others)
}

/// The key that was probably meant by an unknown key.
fn meant(key: &str) -> Option<String> {
    // Our patterns with the names of the unknown key filled in, so that only our part of the key is compared.
    let tokens: Vec<&str> = key.split('.').collect();
    let candidates: Vec<String> = KEYS
        .iter()
        .map(|known| {
            let named = |(idx, token): (usize, &'static str)| {
                if token.starts_with('<') { tokens.get(idx).copied().unwrap_or(token) } else { token }
            };
            known.pattern.split('.').enumerate().map(named).collect::<Vec<_>>().join(".")
        })
        .collect();
    nearest(key, candidates.iter().map(String::as_str)).map(str::to_owned)
}

/// Refuses keys for a source, model or region that the lists don't name, and keys of `of_others` for one that they do
/// name.
///
/// `families`: the first token of the keys, the parameter that lists the names, and the names.
pub(super) fn names(
    tree: &ParamTree,
    of_others: &[&str],
    families: &[(&str, &str, &[String])],
) -> Result<(), ConfigError> {
    for (key, param) in tree.iter() {
        let Some((family, rest)) = key.split_once('.') else { continue };
        let Some((_, listed_in, names)) = families.iter().find(|(known, ..)| *known == family) else { continue };
        let name = rest.split('.').next().unwrap_or_default();
        let is_listed = names.iter().any(|known| known == name);
        if is_listed != of_others.contains(&key) {
            continue;
        }
        if is_listed {
            let hint = EXPLAINED.to_owned();
            return Err(ConfigError::Unknown { origin: param.origin.to_string(), key: one_line(key), hint });
        }
        let known = list(names.iter().map(String::as_str));
        let hint = format!("{listed_in} = [{known}] has no \"{}\"", one_line(name));
        return Err(ConfigError::Unknown { origin: param.origin.to_string(), key: one_line(key), hint });
    }
    Ok(())
}
