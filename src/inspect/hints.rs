//! Hints from the names of topics, types and fields.

/// Words of taxels.
pub(super) const TACTILE: &[&str] =
    &["tactile", "taxel", "touch", "skin", "uskin", "glove", "fsr", "fingertip", "pressure", "pillar"];
/// Words of joint angles.
pub(super) const JOINT: &[&str] = &["joint", "encoder", "position", "angle", "servo", "ergonomic"];
/// Words of forces.
pub(super) const FORCE: &[&str] = &["force", "load", "wrench"];
/// Most numbers that a force sensor sends at once: three axes of force and three of torque.
pub(super) const MOST_FORCES: u64 = 6;

/// Whether an array of so many numbers is that of a force sensor, by the name of its topic or type. The last word of a topic
/// knows best: `/fingertip/load_cell` is a load cell, `/load_cell/skin` is a skin.
pub(super) fn is_force_sensor(topic: &str, type_name: &str, n_values: u64) -> bool {
    let of_topic = || {
        let part = |part: &&str| found(part, FORCE).is_some() || found(part, TACTILE).is_some() || is_ft(part);
        let last = topic.rsplit('/').find(part)?;
        Some(found(last, FORCE).is_some() || is_ft(last))
    };
    let of_type = || found(short(type_name), FORCE).is_some();
    (1..=MOST_FORCES).contains(&n_values) && of_topic().unwrap_or_else(of_type)
}

/// `ft` and `fts` as people name force torque sensors.
pub(super) fn is_ft(name: &str) -> bool {
    words(name).iter().any(|word| matches!(word.as_str(), "ft" | "fts"))
}

/// Words of the number of consecutive samples in a message, or of rows.
pub(super) const ROWS: &[&str] = &["row", "sample", "height", "batch"];
/// Words of the number of values in a sample, or of columns.
pub(super) const COLS: &[&str] = &["col", "channel", "width", "taxel", "axes"];

/// Packages whose types everybody knows: their arrays are what they are called, and no taxels.
const STANDARD: &[&str] = &[
    "action_msgs",
    "actionlib_msgs",
    "builtin_interfaces",
    "composition_interfaces",
    "diagnostic_msgs",
    "foxglove_msgs",
    "geographic_msgs",
    "geometry_msgs",
    "gps_msgs",
    "lifecycle_msgs",
    "map_msgs",
    "nav_msgs",
    "pcl_msgs",
    "rcl_interfaces",
    "rosbag2_interfaces",
    "rosgraph_msgs",
    "sensor_msgs",
    "service_msgs",
    "shape_msgs",
    "statistics_msgs",
    "std_srvs",
    "stereo_msgs",
    "tf2_msgs",
    "trajectory_msgs",
    "type_description_interfaces",
    "unique_identifier_msgs",
    "vision_msgs",
    "visualization_msgs",
];

/// Whether a type is of a package that everybody knows; `std_msgs` carries anything, so it is none of them.
pub(super) fn is_standard(type_name: &str) -> bool {
    type_name.split('/').next().is_some_and(|package| STANDARD.contains(&package))
}

/// Whether a type is one of this package's.
pub(super) fn is_ours(type_name: &str) -> bool {
    type_name.starts_with("tactile_pose_fusion/")
}

/// Name of a type without its package.
pub(super) fn short(type_name: &str) -> &str {
    type_name.rsplit('/').next().unwrap_or(type_name)
}

/// The first word of `name` that begins as one of `hints` does: `forces` for `force`, `LoadCell` for `load`.
pub(super) fn found<'h>(name: &str, hints: &[&'h str]) -> Option<&'h str> {
    words(name).iter().find_map(|word| hints.iter().copied().find(|hint| word.starts_with(hint)))
}

/// Where a word of `hints` is found: `its topic says 'servo'`.
pub(super) fn told(topic: &str, type_name: &str, path: &str, hints: &[&str]) -> Option<String> {
    let places = [("topic", topic), ("type", short(type_name)), ("field", path)];
    places.iter().find_map(|(place, name)| Some(format!("its {place} says '{}'", found(name, hints)?)))
}

/// The words of a name in small letters: `LoadCell_data2` is `load`, `cell`, `data2`.
fn words(name: &str) -> Vec<String> {
    let mut words: Vec<String> = vec![String::new()];
    let mut after_small = false;
    for c in name.chars() {
        let begins = !c.is_alphanumeric() || (c.is_uppercase() && after_small);
        if begins {
            words.push(String::new());
        }
        if let (true, Some(word)) = (c.is_alphanumeric(), words.last_mut()) {
            word.extend(c.to_lowercase());
        }
        after_small = c.is_lowercase() || c.is_numeric();
    }
    words.retain(|word| !word.is_empty());
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_found_at_their_beginning_alone() {
        assert_eq!(found("LoadCell", FORCE), Some("load"));
        assert_eq!(found("/arm/jointStates", JOINT), Some("joint"));
        assert_eq!(found("/reinforced/download", FORCE), None);
        assert_eq!(words("/a__B-cDe9F"), ["a", "b", "c", "de9", "f"]);
    }
}
