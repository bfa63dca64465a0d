//! `tpf completions`: what a shell completes, and man pages.

use std::path::PathBuf;

use clap_complete::Shell;
use tactile_pose_fusion::files;
use tactile_pose_fusion::location;

use super::{Failure, Outcome, command, print_as_it_is};

/// Writes what a shell completes to stdout, or man pages into a folder.
#[derive(Debug, clap::Args)]
#[group(required = true, multiple = false)]
pub(super) struct Args {
    /// Shell to write for: for bash, `tpf completions bash > ~/.local/share/bash-completion/completions/tpf`
    #[arg(value_enum)]
    shell: Option<Shell>,
    /// Write a man page for `tpf` and each of its commands into this folder
    #[arg(long, value_name = "FOLDER")]
    man: Option<PathBuf>,
}

pub(super) fn run(args: &Args) -> Result<Outcome, Failure> {
    if let Some(shell) = args.shell {
        let mut text = Vec::new();
        clap_complete::generate(shell, &mut command(), "tpf", &mut text);
        print_as_it_is(&String::from_utf8_lossy(&text))?;
    }
    if let Some(folder) = &args.man {
        let at = |error: std::io::Error| Failure(format!("{}: {error}", folder.display()));
        location::only_here(folder).map_err(at)?;
        std::fs::create_dir_all(folder).map_err(at)?;
        // As clap has it without groups: a man page lists commands in its own way.
        let mut whole = super::plain_command();
        whole.build();
        let commands = whole.get_subcommands().filter(|command| command.get_name() != "help").cloned();
        for command in std::iter::once(whole.clone()).chain(commands) {
            let name = command.get_display_name().unwrap_or("tpf").to_owned();
            let mut page = Vec::new();
            clap_mangen::Man::new(command).render(&mut page).map_err(at)?;
            files::replace(&folder.join(format!("{name}.1")), &page).map_err(at)?;
        }
    }
    Ok(Outcome::Done)
}
