//! ARCHITECTURE.md says who may use whom; this keeps it true.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Module -> the modules of ours that it may use. A module not named here may use nothing of ours.
const MAY_USE: &[(&str, &[&str])] = &[
    ("units", &[]),
    ("kernels", &[]),
    ("hand", &[]),
    ("files", &[]),
    ("leave", &[]),
    ("random", &[]),
    ("observer", &[]),
    ("page", &[]),
    ("columns", &["files", "units"]),
    ("fusion", &["units"]),
    ("calibration", &["files", "fusion", "units"]),
    ("characterize", &["eval", "fusion", "units"]),
    ("model", &["fusion", "kernels", "units"]),
    ("msg", &["fusion", "hand", "units"]),
    ("eval", &["fusion", "units"]),
    ("protocol", &["random", "units"]),
    ("collect", &["protocol", "units"]),
    ("sim", &["protocol", "random", "units"]),
    ("train", &["eval", "files", "fusion", "kernels", "model", "units"]),
    ("config", &["fusion", "hand", "model", "msg", "units"]),
    ("bag", &["files", "fusion", "msg", "units"]),
    ("recording", &["bag", "config", "eval", "fusion", "msg", "protocol", "random", "units"]),
    ("export", &["columns", "files", "fusion", "protocol", "recording", "units"]),
    ("zero", &["bag", "calibration", "config", "fusion", "recording", "units"]),
    ("glove", &["config", "fusion", "model", "zero"]),
    (
        "sessions",
        &[
            "bag",
            "config",
            "eval",
            "fusion",
            "glove",
            "model",
            "msg",
            "observer",
            "protocol",
            "recording",
            "units",
            "zero",
        ],
    ),
    (
        "evaluate",
        &[
            "bag",
            "config",
            "eval",
            "fusion",
            "glove",
            "model",
            "msg",
            "observer",
            "recording",
            "sessions",
            "units",
            "zero",
        ],
    ),
    ("replay", &["bag", "config", "fusion", "glove", "model", "msg", "observer", "recording", "units", "zero"]),
    ("synthetic", &["bag", "hand", "msg", "observer", "recording", "sim", "units"]),
    ("ros", &["config", "fusion", "leave", "model", "msg", "units", "zero"]),
    (
        "commands",
        &[
            "bag",
            "calibration",
            "characterize",
            "collect",
            "columns",
            "config",
            "eval",
            "evaluate",
            "export",
            "files",
            "fusion",
            "glove",
            "hand",
            "leave",
            "model",
            "msg",
            "observer",
            "page",
            "protocol",
            "recording",
            "replay",
            "ros",
            "sessions",
            "sim",
            "synthetic",
            "train",
            "units",
            "zero",
        ],
    ),
];

fn sources() -> Vec<PathBuf> {
    fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(&path, found);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    walk(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut found);
    found.sort();
    found
}

/// The top module that a file belongs to; `None` for the crate's roots.
fn module_of(path: &Path) -> Option<String> {
    let relative = path.strip_prefix(Path::new(env!("CARGO_MANIFEST_DIR")).join("src")).unwrap();
    let first = relative.components().next().unwrap().as_os_str().to_str().unwrap();
    let name = first.trim_end_matches(".rs").to_owned();
    (!["lib", "main", "bin"].contains(&name.as_str())).then_some(name)
}

/// The code of a file without its comments and its tests.
fn code_of(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    let code = text.split("#[cfg(test)]").next().unwrap();
    let lines = code.lines().map(|line| line.split("//").next().unwrap());
    lines.collect::<Vec<_>>().join("\n")
}

#[test]
fn modules_use_only_what_they_may() {
    let may_use: BTreeMap<&str, &[&str]> = MAY_USE.iter().copied().collect();
    let mut wrong = BTreeSet::new();
    for path in sources() {
        let Some(module) = module_of(&path) else { continue };
        if path.file_name().unwrap().to_str().unwrap().contains("tests") {
            continue;
        }
        let allowed = may_use.get(module.as_str()).copied().unwrap_or_else(|| panic!("{module} is not in the table"));
        for used in code_of(&path).split("crate::").skip(1) {
            let used: String = used.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
            if !used.is_empty() && used != module && !allowed.contains(&used.as_str()) {
                wrong.insert(format!("{} uses {used}", path.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_core_is_pure() {
    let forbidden = [
        "std::fs",
        "std::io",
        "std::env",
        "std::thread",
        "std::net",
        "std::process",
        "Mutex",
        "Atomic",
        "OnceLock",
        "Instant",
        "SystemTime",
        "tokio",
        "async ",
        "HashMap",
        "HashSet",
        "rand::",
        "println!",
        "eprintln!",
        "unsafe",
    ];
    for path in sources() {
        if module_of(&path)
            .is_none_or(|module| !["fusion", "units", "eval", "characterize", "sim"].contains(&module.as_str()))
        {
            continue;
        }
        let code = code_of(&path);
        for word in forbidden {
            assert!(!code.contains(word), "{} contains {word:?}", path.display());
        }
    }
}

#[test]
fn the_table_is_that_of_architecture_md() {
    let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("ARCHITECTURE.md")).unwrap();
    for (module, allowed) in MAY_USE {
        let row = text.lines().find(|line| line.starts_with(&format!("| `src/{module}.rs`")));
        let row = row.unwrap_or_else(|| panic!("ARCHITECTURE.md has no row for {module}"));
        let cell = row.trim_end_matches(" |").rsplit(" | ").next().unwrap().trim();
        let expected = match *module {
            "commands" => "everything".to_owned(),
            _ if allowed.is_empty() => "nothing".to_owned(),
            _ => allowed.join(", "),
        };
        assert_eq!(cell, expected, "row of {module}");
    }
}

#[test]
fn every_test_that_architecture_md_names_is_there() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = fs::read_to_string(root.join("ARCHITECTURE.md")).unwrap();
    let invariants = text.split("## Invariants").nth(1).unwrap().split("\n## ").next().unwrap();
    let mut n_named = 0;
    for row in invariants.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| invariant")) {
        let kept_by = row.trim_end_matches(" |").rsplit(" | ").next().unwrap();
        for name in kept_by.split('`').skip(1).step_by(2) {
            n_named += 1;
            let (file, test) = name.split_once("::").unwrap_or((name, ""));
            let code = fs::read_to_string(root.join(format!("tests/{file}.rs")))
                .or_else(|_| fs::read_to_string(root.join(format!("tests/{file}/main.rs"))));
            let code = code.unwrap_or_else(|error| panic!("ARCHITECTURE.md names {name}: {error}"));
            assert!(test.is_empty() || code.contains(&format!("fn {test}(")), "ARCHITECTURE.md names {name}");
        }
    }
    assert!(n_named > 8, "the table of invariants was not found");
}

/// `forbid` can't be taken back by any attribute, so what is left to escape is to be no target of this package.
#[test]
fn no_target_may_hold_unsafe_code() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let manifest = fs::read_to_string(root.join("Cargo.toml")).unwrap();
    let lints = manifest.split("[lints.rust]").nth(1).unwrap().split("\n[").next().unwrap();
    assert!(lints.lines().any(|line| line == "unsafe_code = \"forbid\""), "{lints}");
    assert!(!manifest.contains("[workspace"), "a member needs the lints too");
    assert!(!root.join("build.rs").exists() && !manifest.contains("build ="), "a build script is code too");
}
