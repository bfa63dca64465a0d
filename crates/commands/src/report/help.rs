//! `tpf --help`: the commands by what people want.

use std::fmt::Write as _;

/// Tasks of people, and the commands for each, in a few words.
const GROUPS: [(&str, &[(&str, &str)]); 5] = [
    (
        "See",
        &[
            ("demo", "run everything once, on a synthetic glove"),
            ("inspect", "show what is in a bag or a model"),
            ("view", "look at a bag or a running node in the browser"),
            ("monitor", "watch a running node in the terminal"),
            ("doctor", "find what is wrong with a graph, or what a node would lack"),
            ("characterize", "measure what a glove does when the hand moves"),
        ],
    ),
    (
        "Run",
        &[
            ("run", "run the live node: wrench and contact from taxels and joints"),
            ("call", "calibrate, tare, activate or set up a node that runs"),
            ("play", "publish the messages of a bag, to try a node without hardware"),
            ("replay", "compute wrench and contact of bags, into new bags"),
        ],
    ),
    (
        "Prepare a glove",
        &[
            ("init", "write a parameter file from what is in bags, or on a live graph"),
            ("calibrate", "measure the zero, from a bag or a glove that is worn now"),
            ("collect", "lead a person through the collection protocol, and record it"),
            ("train", "train a force model on recordings"),
            ("simulate", "write or publish sessions of synthetic gloves"),
        ],
    ),
    (
        "Judge",
        &[
            ("eval", "score force and contact against a force sensor"),
            ("merge", "put together what several processes evaluated or exported"),
            ("diff", "compare the estimates of two bags"),
        ],
    ),
    (
        "Give away",
        &[
            ("export", "write sessions as a LeRobot dataset, or every frame as a table"),
            ("completions", "write completions for a shell, or man pages"),
        ],
    ),
];

/// The command line with its commands by groups.
pub(crate) fn grouped(command: clap::Command) -> clap::Command {
    let mut text = String::new();
    for (want, commands) in GROUPS {
        let here = commands.iter().filter(|(name, _)| command.find_subcommand(name).is_some());
        let lines: Vec<String> = here.map(|(name, words)| format!("  {name:<13} {words}\n")).collect();
        if !lines.is_empty() {
            let _ = write!(text, "{want}:\n{}\n", lines.concat());
        }
    }
    command
        .help_template(format!("{{about}}\n\n{{usage-heading}} {{usage}}\n\n{text}Options:\n{{options}}{{after-help}}"))
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::commands::Cli;

    #[test]
    fn every_command_is_in_one_group_and_fits_a_terminal() {
        let command = grouped(Cli::command());
        let listed = GROUPS.iter().flat_map(|(_, commands)| commands.iter().map(|(name, _)| *name));
        let listed: Vec<&str> = listed.filter(|name| command.find_subcommand(name).is_some()).collect();
        let mut names: Vec<&str> = command.get_subcommands().map(clap::Command::get_name).collect();
        let mut sorted = listed.clone();
        sorted.sort_unstable();
        names.sort_unstable();
        assert_eq!(sorted, names);
        let help = grouped(Cli::command()).render_help().to_string();
        assert!(help.lines().all(|line| line.len() <= 80), "{help}");
        for name in listed {
            assert_eq!(
                help.lines().filter(|line| line.trim_start().starts_with(&format!("{name} "))).count(),
                1,
                "{name}"
            );
        }
    }
}
