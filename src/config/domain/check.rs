//! What can be said of each key and value by itself.

use super::super::QOS_OVERRIDES;
use super::super::error::ConfigError;
use super::super::keys::{KEYS, ParamKind, find};
use super::super::param_file::ParamTree;
use super::super::scalar::ParamValue;
use super::super::text::{list, nearest, one_line};

/// Refuses keys that are in no pattern, values of another type, and values out of range.
pub(super) fn keys_and_values(tree: &ParamTree) -> Result<(), ConfigError> {
    // QoS overrides are named by topics, which the live node knows and checks.
    for (key, param) in tree.iter().filter(|(key, _)| !key.starts_with(QOS_OVERRIDES)) {
        let origin = param.origin.to_string();
        let Some(known) = find(key) else {
            return Err(ConfigError::Unknown { origin, key: one_line(key), hint: hint(key) });
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
    Ok(())
}

/// What someone who wrote an unknown key may have meant.
fn hint(key: &str) -> String {
    // Patterns with the key's own names in them, so that only what is ours is compared.
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
    match nearest(key, candidates.iter().map(String::as_str)) {
        Some(meant) => format!("did you mean {}?", one_line(meant)),
        None => "params/example.yaml explains those that there are".to_owned(),
    }
}

/// Refuses keys for a source, model or region that the lists don't name.
///
/// Of each family of keys: its first token, where its names are listed, and the names.
pub(super) fn names(tree: &ParamTree, families: &[(&str, &str, &[String])]) -> Result<(), ConfigError> {
    for (key, param) in tree.iter() {
        let Some((family, rest)) = key.split_once('.') else { continue };
        let Some((_, listed_in, names)) = families.iter().find(|(known, ..)| *known == family) else { continue };
        let name = rest.split('.').next().unwrap_or_default();
        if names.iter().any(|known| known == name) {
            continue;
        }
        let known = list(names.iter().map(String::as_str));
        let hint = format!("{listed_in} = [{known}] has no \"{}\"", one_line(name));
        return Err(ConfigError::Unknown { origin: param.origin.to_string(), key: one_line(key), hint });
    }
    Ok(())
}
