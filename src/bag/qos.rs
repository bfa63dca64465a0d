//! The QoS that recorders note beside a topic, so that playing the bag back offers the same.

use std::fmt::Write as _;

use serde::Deserialize;

/// Best effort, the last 10, volatile: the QoS of what this package publishes, as rosbag2 notes it with a channel.
pub const BEST_EFFORT_QOS: &str = "- history: keep_last
  depth: 10
  reliability: best_effort
  durability: volatile
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false";

/// The numbers that recorders up to Iron wrote, from `rmw/types.h`.
const HISTORY: [&str; 4] = ["system_default", "keep_last", "keep_all", "unknown"];
const RELIABILITY: [&str; 5] = ["system_default", "reliable", "best_effort", "unknown", "best_available"];
const DURABILITY: [&str; 5] = ["system_default", "transient_local", "volatile", "unknown", "best_available"];
const LIVELINESS: [&str; 6] =
    ["system_default", "automatic", "manual_by_node", "manual_by_topic", "unknown", "best_available"];

/// A policy by name, or by number as recorders up to Iron wrote it.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
enum Policy {
    Number(u8),
    Name(String),
}

impl Policy {
    fn named(&self, names: &'static [&'static str]) -> &'static str {
        match self {
            Policy::Number(number) => names.get(usize::from(*number)).copied().unwrap_or("unknown"),
            Policy::Name(name) => names.iter().copied().find(|known| known == name).unwrap_or("unknown"),
        }
    }
}

#[derive(Debug, Clone, Copy, Deserialize, PartialEq, Eq)]
struct QosTime {
    sec: u64,
    nsec: u64,
}

#[derive(Debug, Deserialize)]
struct WrittenProfile {
    history: Policy,
    depth: u64,
    reliability: Policy,
    durability: Policy,
    deadline: QosTime,
    lifespan: QosTime,
    liveliness: Policy,
    liveliness_lease_duration: QosTime,
    avoid_ros_namespace_conventions: bool,
}

/// The QoS that one publisher of a topic offered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct QosProfile {
    history: &'static str,
    depth: u64,
    reliability: &'static str,
    durability: &'static str,
    deadline: QosTime,
    lifespan: QosTime,
    liveliness: &'static str,
    liveliness_lease_duration: QosTime,
    avoid_ros_namespace_conventions: bool,
}

/// The profiles that `yaml` lists, by name whichever way it writes them; `None` where it is no such list.
pub(super) fn from_yaml(yaml: &str) -> Option<Vec<QosProfile>> {
    if yaml.trim().is_empty() {
        return Some(Vec::new());
    }
    let written: Vec<WrittenProfile> = serde_saphyr::from_str(yaml).ok()?;
    let profile = |written: WrittenProfile| QosProfile {
        history: written.history.named(&HISTORY),
        depth: written.depth,
        reliability: written.reliability.named(&RELIABILITY),
        durability: written.durability.named(&DURABILITY),
        deadline: written.deadline,
        lifespan: written.lifespan,
        liveliness: written.liveliness.named(&LIVELINESS),
        liveliness_lease_duration: written.liveliness_lease_duration,
        avoid_ros_namespace_conventions: written.avoid_ros_namespace_conventions,
    };
    Some(written.into_iter().map(profile).collect())
}

/// `profiles` as Jazzy writes them, with no line end behind the last line.
pub(super) fn to_yaml(profiles: &[QosProfile]) -> String {
    let mut text = String::new();
    for profile in profiles {
        // Writing to a string can't fail.
        let _ = write!(
            text,
            "- history: {}\n  depth: {}\n  reliability: {}\n  durability: {}\n",
            profile.history, profile.depth, profile.reliability, profile.durability
        );
        let times = [("deadline", profile.deadline), ("lifespan", profile.lifespan)];
        for (name, QosTime { sec, nsec }) in times {
            let _ = write!(text, "  {name}:\n    sec: {sec}\n    nsec: {nsec}\n");
        }
        let QosTime { sec, nsec } = profile.liveliness_lease_duration;
        let _ = write!(
            text,
            "  liveliness: {}\n  liveliness_lease_duration:\n    sec: {sec}\n    nsec: {nsec}\n  \
             avoid_ros_namespace_conventions: {}\n",
            profile.liveliness, profile.avoid_ros_namespace_conventions
        );
    }
    text.truncate(text.trim_end().len());
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn profiles_written_by_name_read_back_as_they_were() {
        assert_eq!(to_yaml(&from_yaml(BEST_EFFORT_QOS).unwrap()), BEST_EFFORT_QOS);
    }

    #[test]
    fn profiles_written_by_number_are_named() {
        let numbered = BEST_EFFORT_QOS
            .replace("keep_last", "1")
            .replace("best_effort", "2")
            .replace("durability: volatile", "durability: 2")
            .replace("automatic", "1");
        assert_eq!(to_yaml(&from_yaml(&numbered).unwrap()), BEST_EFFORT_QOS);
    }

    #[test]
    fn what_is_no_list_of_profiles_is_told_apart_from_an_empty_one() {
        assert_eq!(from_yaml(""), Some(Vec::new()));
        assert_eq!(from_yaml("reliable"), None);
    }
}
