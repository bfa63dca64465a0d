//! The book: its pages hang together, what is generated is of this code, and its commands run.

use crate::common;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use clap::Parser;
use common::ROOT;
use tactile_pose_fusion::config::{self, keys};
use tactile_pose_fusion_commands::Cli;

fn root() -> &'static Path {
    Path::new(ROOT)
}

fn book() -> PathBuf {
    root().join("docs/src")
}

/// Every page but the summary, by its path below `docs/src`.
fn pages() -> BTreeSet<PathBuf> {
    let mut pages = BTreeSet::new();
    for folder in ["", "how-to", "reference", "explanation"] {
        for entry in fs::read_dir(book().join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "md") && !path.ends_with("SUMMARY.md") {
                pages.insert(path.strip_prefix(book()).unwrap().to_path_buf());
            }
        }
    }
    pages
}

/// Targets of links in Markdown that are no addresses.
fn links(text: &str) -> Vec<String> {
    let after = text.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
    let targets = after.map(|(target, _)| target.split('#').next().unwrap().to_owned());
    targets.filter(|target| !target.is_empty() && !target.contains("://")).collect()
}

/// Lines of the shell blocks of a page, with what stands behind `sh` in their fences.
fn commands(text: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut fence: Option<String> = None;
    let mut line_so_far = String::new();
    for line in text.lines() {
        match (&fence, line.strip_prefix("```")) {
            (None, Some(info)) => fence = Some(info.trim().to_owned()),
            (Some(_), Some(_)) => fence = None,
            (Some(info), None) if info.split(' ').next() == Some("sh") => {
                let line = line.split("  #").next().unwrap().trim_end(); // what it does, for people
                match line.strip_suffix('\\') {
                    Some(part) => line_so_far += part,
                    None => {
                        let whole = std::mem::take(&mut line_so_far) + line;
                        if !whole.trim().is_empty() {
                            found.push((info.trim_start_matches("sh").trim().to_owned(), whole.trim().to_owned()));
                        }
                    }
                }
            }
            _ => {}
        }
    }
    found
}

/// Words of a shell line without variables but those of array jobs, quotes taken off.
fn words(line: &str) -> Vec<String> {
    let line = line.replace("$SLURM_ARRAY_TASK_ID", "0").replace("$SLURM_ARRAY_TASK_COUNT", "3");
    let line = line.split(" > ").next().unwrap_or_default();
    let mut words = vec![String::new()];
    let mut quote = None;
    for letter in line.chars() {
        match (quote, letter) {
            (None, '"' | '\'') => quote = Some(letter),
            (Some(open), _) if letter == open => quote = None,
            (None, ' ') => words.push(String::new()),
            _ => words.last_mut().unwrap().push(letter),
        }
    }
    words.into_iter().filter(|word| !word.is_empty()).collect()
}

/// Holds a generated page against what this code makes of it, or writes it where `TPF_UPDATE_DOCS` is set.
fn holds(page: &str, expected: &str) {
    let path = book().join(page);
    if std::env::var_os("TPF_UPDATE_DOCS").is_some() {
        fs::write(&path, expected).unwrap();
    }
    let is = fs::read_to_string(&path).unwrap();
    assert!(
        is == expected,
        "{page} is not what the code says; write it anew by TPF_UPDATE_DOCS=1 cargo test --test repository docs"
    );
}

#[test]
fn every_page_is_in_the_summary_and_every_link_leads_somewhere() {
    let summary = fs::read_to_string(book().join("SUMMARY.md")).unwrap();
    let listed: BTreeSet<PathBuf> = links(&summary).into_iter().map(PathBuf::from).collect();
    assert_eq!(listed, pages());
    let beside = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "SECURITY.md", "models/README.md"];
    let beside = beside.map(|name| root().join(name));
    for page in pages().into_iter().map(|page| book().join(page)).chain(beside) {
        let text = fs::read_to_string(&page).unwrap();
        for link in links(&text) {
            let target = page.parent().unwrap().join(&link);
            assert!(target.exists(), "{}: {link} leads nowhere", page.display());
        }
    }
}

#[test]
fn the_page_of_parameters_is_made_of_their_table() {
    let head = "# Parameters\n\nAll of them, as `config` knows them. `params/example.yaml` shows them in a file. A parameter that is \
                not here is refused.\n\n";
    holds("reference/parameters.md", &format!("{head}{}", keys::markdown()));
}

#[test]
fn the_page_of_messages_is_made_of_their_files() {
    let mut text = String::from("# Messages\n\nThe files in `msg/` and `action/`, as they are.\n");
    for (folder, name) in [
        ("msg", "ContactState.msg"),
        ("msg", "ContactArray.msg"),
        ("msg", "TaxelArray.msg"),
        ("msg", "Stage.msg"),
        ("action", "Calibrate.action"),
    ] {
        let definition = fs::read_to_string(root().join(folder).join(name)).unwrap();
        let type_name = name.split('.').next().unwrap();
        text += &format!("\n## tactile_pose_fusion/{folder}/{type_name}\n\n```text\n{}\n```\n", definition.trim_end());
    }
    holds("reference/messages.md", &text);
}

#[test]
fn every_command_that_is_shown_is_one_that_tpf_takes() {
    let mut n_commands = 0;
    let pages = pages().into_iter().map(|page| book().join(page));
    for page in pages.chain([root().join("README.md"), root().join("models/README.md")]) {
        for (_, line) in commands(&fs::read_to_string(&page).unwrap()) {
            let mut words = words(&line);
            // Variables of the environment before it, and a subshell around it.
            words.retain(|word| !word.contains('=') || word.starts_with('-') || word.contains(":="));
            if words.first().is_none_or(|first| first != "tpf") || cfg!(not(all(feature = "ros", feature = "train"))) {
                continue;
            }
            n_commands += 1;
            if let Err(error) = Cli::try_parse_from(&words) {
                panic!("{}: {line}: {error}", page.display());
            }
        }
    }
    assert!(n_commands > 25 || cfg!(not(all(feature = "ros", feature = "train"))), "{n_commands} commands");
}

/// A folder with what the repository has.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for shown in ["params", "models", "docs"] {
        std::os::unix::fs::symlink(root().join(shown), folder.path().join(shown)).unwrap();
    }
    folder
}

/// Runs lines of a shell, with the `tpf` of these tests.
fn run(of: &str, lines: &[&str], folder: &Path) {
    let bin = Path::new(env!("CARGO_BIN_EXE_tpf")).parent().unwrap();
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    for line in lines {
        let ran = Command::new("bash").args(["-euc", line]).current_dir(folder).env("PATH", &path).output().unwrap();
        assert!(ran.status.success(), "{of}: {line}: {}", String::from_utf8_lossy(&ran.stderr));
    }
}

/// Lines of a page whose blocks are called so; those without a name are neither live nor an installation.
fn lines_of<'c>(commands: &'c [(String, String)], kind: &str) -> Vec<&'c str> {
    commands.iter().filter(|(info, _)| info == kind).map(|(_, line)| line.as_str()).collect()
}

/// Runs what a page shows.
fn run_page(page: &str) -> tempfile::TempDir {
    let folder = workplace();
    let shown = commands(&fs::read_to_string(book().join(page)).unwrap());
    let lines = lines_of(&shown, "");
    assert!(lines.len() > 3, "{page}: {} commands", lines.len());
    run(page, &lines, folder.path());
    folder
}

#[test]
fn what_the_readme_does_with_a_bag_runs_as_it_is_written() {
    let folder = workplace();
    let simulate = "tpf simulate --glove 1 --users 1 --sessions 1 --minutes 1.7 --seed 5 -o sessions";
    let yours =
        ["cp sessions/glove1_user01_session1/*.mcap recording.mcap", "cp models/glove1_adaptive.onnx model.onnx"];
    run("preparation", &[simulate, yours[0], yours[1]], folder.path());
    let shown = commands(&fs::read_to_string(root().join("README.md")).unwrap());
    let lines = lines_of(&shown, "yours");
    assert!(lines.len() >= 3, "{lines:?}");
    run("README.md", &lines, folder.path());
    assert!(folder.path().join("forces.csv").exists());
}

#[test]
fn the_array_of_many_bags_gives_what_one_process_gives() {
    let folder = workplace();
    let prepare = [
        "tpf simulate --glove 1 --users 2 --sessions 1 --minutes 1.7 --seed 5 -o bags",
        // With a model that runs faster than the paper's network, which the other pages run.
        "cp params/glove1.yaml glove.yaml && sed -i 's|../models/glove1_pose_aware.onnx|model.onnx|' glove.yaml",
        "cp models/glove1_adaptive.onnx model.onnx && mkdir partials",
    ];
    run("preparation", &prepare, folder.path());
    let page = "how-to/many-bags.md";
    let shown = commands(&fs::read_to_string(book().join(page)).unwrap());
    let workers = lines_of(&shown, "worker");
    let workers: Vec<&str> = workers.into_iter().filter(|line| line.starts_with("tpf ")).collect();
    assert_eq!(workers.len(), 3, "{workers:?}");
    for index in [1, 0] {
        let line = |line: &&str| format!("SLURM_ARRAY_TASK_ID={index} SLURM_ARRAY_TASK_COUNT=2; {line}");
        let lines: Vec<String> = workers.iter().map(line).collect();
        run(page, &lines.iter().map(String::as_str).collect::<Vec<_>>(), folder.path());
    }
    run(page, &lines_of(&shown, "merge"), folder.path());
    let whole = [
        "tpf eval bags --params-file glove.yaml --model model.onnx --whole --json > whole.json",
        "cmp whole.json scores.json",
        "tpf export bags --params-file glove.yaml --fps 30 --lerobot whole",
        "diff -r whole dataset",
        "tpf replay bags/glove1_user02_session1 --params-file glove.yaml -o one.mcap",
        "cmp one.mcap forces/glove1_user02_session1.mcap",
    ];
    run("one process", &whole, folder.path());
}

#[test]
fn the_robots_command_of_the_readme_takes_every_file_that_ships() {
    let shown = commands(&fs::read_to_string(root().join("README.md")).unwrap());
    let lines = lines_of(&shown, "robot");
    let [line] = lines.as_slice() else { panic!("{lines:?}") };
    assert!(line.ends_with("-r __ns:=/left"), "{line}");
    for entry in fs::read_dir(root().join("params")).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() || !fs::read_to_string(&path).unwrap().contains("ros__parameters") {
            continue; // devices, a protocol, or gates
        }
        let cfg = config::load(&path, "/left/tactile_pose_fusion").unwrap();
        assert_eq!((cfg.tactile()[0].name.as_str(), cfg.joints()[0].name.as_str()), LEFT, "{}", path.display());
        assert_eq!(cfg.of_others, Vec::<String>::new());
    }
}

/// Where the topics of the files that ship are for a node in `/left`.
const LEFT: (&str, &str) = ("/left/glove/taxels", "/left/hand/joint_states");

#[test]
fn the_gates_page_runs_as_it_is_written() {
    run_page("how-to/ci-gates.md");
}

#[test]
fn the_recipe_for_old_bags_runs_as_it_is_written() {
    let folder = run_page("how-to/old-bags.md");
    let [first, second] = ["dataset", "dataset_of_old_bags"].map(|name| common::files(&folder.path().join(name)));
    assert!(!first.is_empty() && first == second, "the page says that both are the same");
}

#[test]
fn the_image_copies_what_is_there() {
    let file = fs::read_to_string(root().join("Dockerfile")).unwrap();
    let copied: Vec<&str> = file.lines().filter_map(|line| line.strip_prefix("COPY --from=build ")).collect();
    assert_eq!(copied.len(), 3);
    let sources = copied.iter().flat_map(|line| line.split(' ').filter_map(|word| word.strip_prefix("/src/")));
    let (built, kept): (Vec<&str>, Vec<&str>) = sources.partition(|source| source.starts_with("target/"));
    assert_eq!(built, ["target/release/tpf", "target/release/tactile_pose_fusion_node"]);
    assert!(kept.iter().all(|source| root().join(source).is_dir()), "{kept:?}");
}
