//! What `tpf` says of itself: help, completions, man pages.

use std::process::{Command, Stdio};

use crate::common;

use common::scored;
use common::tpf::tpf;

#[test]
fn the_help_lists_each_command_under_what_it_is_for() {
    let folder = tempfile::tempdir().unwrap();
    let help = tpf(folder.path(), &["--help"]).ok().stdout;
    let at = |text: &str| help.find(text).unwrap_or_else(|| panic!("{text}: {help}"));
    let order = ["See:", "\n  demo ", "Run:", "\n  replay ", "Prepare a glove:", "\n  init ", "Judge:", "\n  eval "];
    assert!(order.map(at).is_sorted(), "{help}");
    assert!(at("Give away:") < at("\n  export ") && help.contains("--version"), "{help}");
    assert_eq!(tpf(folder.path(), &["no-such-command"]).code, 2);
}

#[test]
fn a_shell_takes_its_completions_and_knows_every_command() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = tpf(folder.path(), &["completions", shell]).ok().stdout;
        for word in ["inspect", "--params-file"] {
            assert!(script.contains(word.trim_start_matches('-')), "{shell} {word}: {script}");
        }
    }
    let script = tpf(folder.path(), &["completions", "bash"]).ok().stdout;
    let asked = "COMP_WORDS=(tpf repl); COMP_CWORD=1; _tpf tpf repl tpf; echo \"${COMPREPLY[@]}\"";
    let bash = Command::new("bash")
        .args(["--norc", "-c", &format!("{script}\n{asked}")])
        .stderr(Stdio::inherit())
        .output()
        .unwrap();
    assert_eq!(String::from_utf8_lossy(&bash.stdout).trim(), "replay");
}

#[test]
fn there_is_a_man_page_for_each_command_and_a_place_that_is_none_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    tpf(folder.path(), &["completions", "--man", "man/man1"]).ok();
    let page = |name: &str| std::fs::read_to_string(folder.path().join(format!("man/man1/{name}.1"))).unwrap();
    assert!(page("tpf").contains("tpf\\-replay") || page("tpf").contains("tpf-replay"), "{}", page("tpf"));
    for name in ["tpf-replay", "tpf-inspect", "tpf-completions"] {
        assert!(page(name).contains(".SH OPTIONS") && page(name).starts_with(".ie"), "{name}: {}", page(name));
    }
    std::fs::write(folder.path().join("file"), "").unwrap();
    let refused = tpf(folder.path(), &["completions", "--man", "file/man1"]);
    assert!(refused.code == 1 && refused.stderr.lines().count() == 1, "{refused:?}");
    for args in [&["completions"][..], &["completions", "bash", "--man", "man"], &["completions", "tcsh"]] {
        assert_eq!(tpf(folder.path(), args).code, 2, "{args:?}");
    }
}

#[test]
fn quiet_leaves_only_results_and_doubts_and_verbose_tells_what_runs_each_model() {
    let folder = scored::folder();
    let eval = ["eval", "bags", "--params-file", "params.yaml", "--whole", "--model", "model.onnx", "--json"];
    let with = |more: &[&str]| tpf(folder.path(), &[&eval[..], more].concat()).ok();
    let (usual, quiet, verbose) = (with(&[]), with(&["-q", "--report", "r.html"]), with(&["--verbose"]));
    assert_eq!((&usual.stdout, &usual.stdout), (&quiet.stdout, &verbose.stdout), "results are the same");
    let runs =
        |text: &str| text.lines().filter(|line| line.starts_with("model tip: ") && line.contains(" in ")).count();
    assert_eq!((runs(&usual.stderr), runs(&verbose.stderr)), (0, 1), "{usual:?} {verbose:?}");
    assert!(quiet.stderr.lines().all(|line| line.contains("its zero is not reliable")), "{}", quiet.stderr);
    assert!(folder.path().join("r.html").exists());
    // What is in doubt is said all the same.
    let doubtful = with(&["--quiet", "-p", "truth.load_cell.sign:=-1"]);
    assert!(doubtful.stderr.contains("a press seems to be negative"), "{doubtful:?}");
    let both = tpf(folder.path(), &["eval", "-q", "-v", "bags", "--params-file", "params.yaml"]);
    assert!(both.code == 2 && both.stderr.contains("cannot be used with"), "{both:?}");
}
