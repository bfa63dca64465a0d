//! ARCHITECTURE.md says who may use whom; this keeps it true.

mod circles;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::ROOT;

/// The packages of the workspace, by their folders: the library, and the programs, which use it.
const PACKAGES: [&str; 2] = [".", "crates/commands"];

/// Module -> the modules of ours, of either package, that it may use. A module not named here may use nothing of ours.
const MAY_USE: &[(&str, &[&str])] = &[
    ("units", &[]),
    ("histogram", &[]),
    ("hand", &[]),
    ("files", &["location"]),
    ("leave", &[]),
    ("location", &["leave", "observer"]),
    ("random", &[]),
    ("observer", &[]),
    ("page", &[]),
    ("columns", &["files", "location", "units"]),
    ("fusion", &["units"]),
    ("calibration", &["files", "fusion", "location", "units"]),
    ("characterize", &["eval", "fusion", "units"]),
    ("model", &["fusion", "location", "units"]),
    ("msg", &["fusion", "hand", "units"]),
    ("eval", &["fusion", "histogram", "units"]),
    ("protocol", &["random", "units"]),
    ("collect", &["protocol", "units"]),
    ("sim", &["protocol", "random", "units"]),
    ("train", &["eval", "files", "fusion", "model", "units"]),
    ("config", &["fusion", "hand", "location", "model", "msg", "units"]),
    ("bag", &["files", "fusion", "histogram", "location", "msg", "units"]),
    ("inspect", &["bag", "hand", "location", "model", "msg", "observer", "units"]),
    ("init", &["bag", "config", "files", "hand", "inspect", "location", "model"]),
    ("recording", &["bag", "config", "eval", "fusion", "msg", "protocol", "random", "units"]),
    ("zero", &["bag", "calibration", "config", "fusion", "recording", "units"]),
    ("glove", &["config", "fusion", "model", "observer", "zero"]),
    (
        "sessions",
        &[
            "bag",
            "config",
            "eval",
            "fusion",
            "glove",
            "location",
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
            "columns",
            "config",
            "eval",
            "fusion",
            "glove",
            "location",
            "model",
            "msg",
            "observer",
            "recording",
            "sessions",
            "units",
            "zero",
        ],
    ),
    (
        "training",
        &[
            "bag",
            "config",
            "eval",
            "evaluate",
            "files",
            "fusion",
            "location",
            "observer",
            "recording",
            "sessions",
            "train",
            "units",
            "zero",
        ],
    ),
    (
        "replay",
        &["bag", "config", "fusion", "glove", "location", "model", "msg", "observer", "recording", "units", "zero"],
    ),
    (
        "calibrate",
        &["bag", "calibration", "config", "fusion", "glove", "model", "observer", "recording", "sessions", "zero"],
    ),
    (
        "export",
        &[
            "bag",
            "columns",
            "config",
            "files",
            "fusion",
            "glove",
            "location",
            "model",
            "msg",
            "observer",
            "protocol",
            "recording",
            "sessions",
            "units",
            "zero",
        ],
    ),
    (
        "characterization",
        &[
            "bag",
            "characterize",
            "config",
            "eval",
            "fusion",
            "glove",
            "observer",
            "recording",
            "sessions",
            "units",
            "zero",
        ],
    ),
    ("synthetic", &["bag", "hand", "msg", "observer", "recording", "sim", "units"]),
    (
        "report",
        &[
            "bag",
            "characterization",
            "characterize",
            "collect",
            "columns",
            "eval",
            "evaluate",
            "fusion",
            "inspect",
            "leave",
            "model",
            "msg",
            "observer",
            "page",
            "protocol",
            "recording",
            "ros",
            "train",
            "training",
            "units",
        ],
    ),
    ("ros", &["config", "fusion", "leave", "location", "model", "msg", "sessions", "units", "zero"]),
    (
        "view",
        &[
            "bag",
            "config",
            "fusion",
            "init",
            "leave",
            "msg",
            "observer",
            "page",
            "recording",
            "replay",
            "ros",
            "sessions",
            "units",
            "zero",
        ],
    ),
    (
        "commands",
        &[
            "bag",
            "calibrate",
            "calibration",
            "characterization",
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
            "init",
            "inspect",
            "leave",
            "location",
            "model",
            "msg",
            "observer",
            "page",
            "protocol",
            "recording",
            "replay",
            "report",
            "ros",
            "sessions",
            "sim",
            "synthetic",
            "train",
            "training",
            "units",
            "view",
            "zero",
        ],
    ),
];

/// The folder of a package's code.
fn src_of(package: &str) -> PathBuf {
    Path::new(ROOT).join(package).join("src")
}

/// The files of a package, each with its path below `src`.
fn sources_of(package: &str) -> Vec<(PathBuf, PathBuf)> {
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
    let src = src_of(package);
    let mut found = Vec::new();
    walk(&src, &mut found);
    found.sort();
    let with_relative = |path: PathBuf| {
        let relative = path.strip_prefix(&src).unwrap().to_path_buf();
        (path, relative)
    };
    found.into_iter().map(with_relative).collect()
}

/// The files of all packages.
fn sources() -> Vec<(PathBuf, PathBuf)> {
    PACKAGES.into_iter().flat_map(sources_of).collect()
}

/// The top module that a file below `src` belongs to; `None` for the roots of crates.
fn module_of(relative: &Path) -> Option<String> {
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
    for (path, relative) in sources() {
        let Some(module) = module_of(&relative) else { continue };
        if path.file_name().unwrap().to_str().unwrap().contains("tests") {
            continue;
        }
        let allowed = may_use.get(module.as_str()).copied().unwrap_or_else(|| panic!("{module} is not in the table"));
        let paths = circles::paths_of(&code_of(&path));
        let is_ours =
            |path: &&Vec<String>| path.first().is_some_and(|root| root == "crate" || root == "tactile_pose_fusion");
        for used in paths.iter().filter(is_ours).filter_map(|path| path.get(1)) {
            if *used != module && !allowed.contains(&used.as_str()) {
                wrong.insert(format!("{} uses {used}", path.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn no_two_modules_use_each_other() {
    let is_test = |path: &Path| path.file_stem().is_some_and(|stem| stem.to_string_lossy().ends_with("tests"));
    let of_file = |(path, relative): (PathBuf, PathBuf)| {
        let module: circles::Module =
            relative.with_extension("").iter().map(|part| part.to_string_lossy().into_owned()).collect();
        let is_root = module == ["lib"];
        (if is_root { circles::Module::new() } else { module }, code_of(&path))
    };
    let is_program = |relative: &Path| relative == Path::new("main.rs") || relative.starts_with("bin");
    let mut n_files = 0;
    for package in PACKAGES {
        let files = sources_of(package).into_iter();
        let files = files.filter(|(path, relative)| !is_test(path) && !is_program(relative));
        let sources: circles::Sources = files.map(of_file).collect();
        assert!(sources.len() > 80, "the sources of {package} were not found");
        n_files += sources.len();
        let circles = circles::between_siblings(&sources);
        assert!(circles.is_empty(), "{package}: {circles:#?}");
    }
    assert!(n_files > 300, "the sources were not found");
}

/// Modules, and files of others, that know no clock, file, thread or environment.
const PURE: &[&str] = &[
    "characterize",
    "collect",
    "eval",
    "fusion",
    "hand",
    "histogram",
    "protocol",
    "random",
    "sim",
    "units",
    "ros/node/calibrator",
    "ros/node/diagnostics",
    "ros/node/health",
    "ros/node/lifecycle",
    "ros/node/parameters",
    "ros/node/visuals",
    "ros/node/watchdog",
    "ros/wire/args",
    "ros/wire/environment",
    "ros/wire/graph",
    "ros/wire/qos",
    "ros/wire/remap",
];

#[test]
fn the_core_is_pure() {
    let forbidden = [
        "std::fs",
        "std::io",
        "std::env",
        "std::thread",
        "std::net",
        "std::process",
        "std::time::Instant",
        "std::time::SystemTime",
        "std::collections::HashMap",
        "std::collections::HashSet",
        "std::sync::Mutex",
        "std::sync::RwLock",
        "std::sync::OnceLock",
        "std::sync::LazyLock",
        "std::sync::atomic",
        "tokio",
        "rand",
    ];
    let words = ["async ", "println!", "eprintln!", "unsafe", "thread_local!", "static mut"];
    let mut n_files = [0; PURE.len()];
    for (path, relative) in sources() {
        let relative = relative.with_extension("");
        let Some(module) = PURE.iter().position(|module| relative.starts_with(module)) else { continue };
        if relative == Path::new("protocol/file") {
            continue; // reads a protocol that a person wrote
        }
        n_files[module] += 1;
        let code = code_of(&path);
        for used in circles::paths_of(&code) {
            let used = used.join("::");
            if used == "std::env::split_paths" {
                continue; // a function of its text
            }
            for word in forbidden {
                let is_it = used.strip_prefix(word).is_some_and(|rest| rest.is_empty() || rest.starts_with("::"));
                assert!(!is_it, "{} uses {used}", path.display());
            }
        }
        for word in words {
            assert!(!code.contains(word), "{} contains {word:?}", path.display());
        }
    }
    for (module, n_files) in PURE.iter().zip(n_files) {
        assert!(n_files > 0, "there is no {module}");
    }
    for (module, allowed) in MAY_USE.iter().filter(|(module, _)| PURE.contains(module)) {
        let impure: Vec<_> = allowed.iter().filter(|used| !PURE.contains(used)).collect();
        assert!(impure.is_empty(), "{module} is pure and may use {impure:?}");
    }
}

/// The library without the feature `ros` can't depend on it by accident.
#[test]
fn only_ros_uses_its_crates() {
    let crates = ["ros2_client", "rustdds", "zenoh"];
    let mut n_uses = 0;
    for (path, relative) in sources() {
        for used in circles::paths_of(&code_of(&path)) {
            let is_of_ros = used.first().is_some_and(|first| crates.contains(&first.as_str()));
            n_uses += usize::from(is_of_ros);
            assert!(
                !is_of_ros || module_of(&relative).as_deref() == Some("ros"),
                "{} uses {}",
                path.display(),
                used.join("::")
            );
        }
    }
    assert!(n_uses > 50, "{n_uses} uses were found");
}

/// What ARCHITECTURE.md calls pure is what the test above looks at.
#[test]
fn what_architecture_md_calls_pure_is_checked() {
    let text = fs::read_to_string(Path::new(ROOT).join("ARCHITECTURE.md")).unwrap();
    let is_of_code = |line: &&str| line.starts_with("| `src/") || line.starts_with("| `crates/");
    let rows = text.lines().filter(is_of_code).filter(|line| line.to_lowercase().contains("pure"));
    let mut n_rows = 0;
    for row in rows {
        n_rows += 1;
        let module = row.split("src/").nth(1).unwrap().split(".rs`").next().unwrap();
        if module == "ros" {
            for file in row.split("Pure:").nth(1).unwrap().split(" | ").next().unwrap().split('`').skip(1).step_by(2) {
                assert!(PURE.iter().any(|pure| pure.ends_with(&format!("/{file}"))), "{file} of ros");
            }
        } else {
            assert!(PURE.contains(&module), "{module} is called pure");
        }
    }
    assert!(n_rows > 5, "the table was not found");
}

#[test]
fn the_table_is_that_of_architecture_md() {
    let text = fs::read_to_string(Path::new(ROOT).join("ARCHITECTURE.md")).unwrap();
    for (module, allowed) in MAY_USE {
        let is_in = |package: &&&str| src_of(package).join(format!("{module}.rs")).exists();
        let package = PACKAGES.iter().find(is_in).unwrap_or_else(|| panic!("no package has {module}"));
        let begins = format!("| `{}src/{module}.rs`", if *package == "." { "" } else { "crates/commands/" });
        let row = text.lines().find(|line| line.starts_with(&begins));
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
    let root = Path::new(ROOT);
    let text = fs::read_to_string(root.join("ARCHITECTURE.md")).unwrap();
    let invariants = text.split("## Invariants").nth(1).unwrap().split("\n## ").next().unwrap();
    let mut n_named = 0;
    for row in invariants.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| invariant")) {
        let kept_by = row.trim_end_matches(" |").rsplit(" | ").next().unwrap();
        for name in kept_by.split('`').skip(1).step_by(2) {
            n_named += 1;
            let (file, test) = name.split_once("::").unwrap_or((name, ""));
            let places = ["", "bags/", "commands/", "library/", "live/", "models/", "repository/"];
            let mut files = places.iter().map(|place| format!("tests/{place}{file}.rs"));
            let code = files.find_map(|path| fs::read_to_string(root.join(path)).ok());
            let code = code.or_else(|| fs::read_to_string(root.join(format!("tests/{file}/main.rs"))).ok());
            let code = code.unwrap_or_else(|| panic!("ARCHITECTURE.md names {name}, and no file is called {file}"));
            assert!(test.is_empty() || code.contains(&format!("fn {test}(")), "ARCHITECTURE.md names {name}");
        }
    }
    assert!(n_named > 8, "the table of invariants was not found");
}

/// `forbid` can't be taken back by any attribute, so what is left to escape is to be no target of these packages.
#[test]
fn no_target_may_hold_unsafe_code() {
    let root = Path::new(ROOT);
    let workspace = fs::read_to_string(root.join("Cargo.toml")).unwrap();
    let lints = workspace.split("[workspace.lints.rust]").nth(1).unwrap().split("\n[").next().unwrap();
    assert!(lints.lines().any(|line| line == "unsafe_code = \"forbid\""), "{lints}");
    let all = [PACKAGES[0], PACKAGES[1], "crates/kernels", "crates/unified"];
    for (key, packages) in [("members", &all[1..]), ("default-members", &all[..3])] {
        let line = workspace.lines().find(|line| line.starts_with(&format!("{key} = ")));
        assert!(line.is_some_and(|line| line.starts_with(&format!("{key} = {packages:?}"))), "{key}: {line:?}");
    }
    for package in all {
        let folder = root.join(package);
        let manifest = fs::read_to_string(folder.join("Cargo.toml")).unwrap();
        let lints: Vec<&str> = manifest.split("\n[lints").skip(1).collect();
        assert!(lints.len() == 1 && lints[0].starts_with("]\nworkspace = true\n"), "{package} has other lints");
        assert!(!folder.join("build.rs").exists() && !manifest.contains("build ="), "a build script is code too");
    }
}
