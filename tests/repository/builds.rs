//! What builds share, so that nothing is compiled twice.

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::ROOT;

/// Sections of crates that are built for themselves there, because they have other features.
const OWN: [&str; 2] =
    ["[profile.dev.package.tactile_pose_fusion]", "[profile.dev.package.tactile_pose_fusion_commands]"];

/// The development profile of a manifest: the settings of each of its sections.
fn dev_profile(manifest: &str) -> BTreeMap<String, Vec<String>> {
    let text = std::fs::read_to_string(Path::new(ROOT).join(manifest)).unwrap();
    let mut sections: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut section = String::new();
    for line in text.lines().map(|line| line.split(" #").next().unwrap_or_default().trim()) {
        if line.starts_with('[') {
            line.clone_into(&mut section);
        } else if section.starts_with("[profile.dev") && !line.is_empty() && !line.starts_with('#') {
            sections.entry(section.clone()).or_default().push(line.to_owned());
        }
    }
    sections
}

/// The Python package is a workspace of its own in the same target folder. A crate that its profile builds in another way is built twice, and
/// so is all that depends on it.
#[test]
fn the_python_package_builds_what_it_shares_in_the_same_way() {
    let shared = dev_profile("Cargo.toml");
    let mut python = dev_profile("python/Cargo.toml");
    assert!(shared.contains_key("[profile.dev]") && shared.contains_key("[profile.dev.package.\"*\"]"), "{shared:?}");
    for (section, settings) in shared.iter().filter(|(section, _)| !OWN.contains(&section.as_str())) {
        let expected = format!("expected the lines of Cargo.toml in {section} of python/Cargo.toml");
        assert_eq!(python.remove(section).as_ref(), Some(settings), "{expected}");
    }
    // What is left is of crates that it alone has.
    let lock = std::fs::read_to_string(Path::new(ROOT).join("Cargo.lock")).unwrap();
    for section in python.keys().filter(|section| !OWN.contains(&section.as_str())) {
        let name = section.trim_start_matches("[profile.dev.package.").trim_end_matches(']');
        assert!(!lock.contains(&format!("name = \"{name}\"\n")), "{section} of python/Cargo.toml builds {name} twice");
    }
}
