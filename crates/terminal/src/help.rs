//! Help texts in groups with an example for each command, manual pages, and shell completions.

use std::fmt::Write as _;
use std::io::{Write as _, stdout};
use std::path::Path;

use anyhow::Context as _;
use clap::Command;

use crate::Outcome;

/// A group of commands in the help text: the group's title, and pairs of a command's name and an example.
pub type Group = (&'static str, &'static [(&'static str, &'static str)]);

/// Adds help texts to a program's command line: a list of its commands by group, and an example for each command.
#[must_use]
pub fn grouped(command: Command, groups: &[Group]) -> Command {
    let mut list = String::new();
    for (title, commands) in groups {
        let _infallible = writeln!(list, "{title}:");
        for (name, example) in *commands {
            let about = command.find_subcommand(name).and_then(|found| found.get_about());
            let about = about.map(ToString::to_string).unwrap_or_default();
            let _infallible = writeln!(list, "  {name:<9} {about}\n              {example}");
        }
        list.push('\n');
    }
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{list}Options:\n{{options}}\n\n\
         '{} COMMAND --help' explains a command.\n",
        command.get_name()
    );
    let examples = groups.iter().flat_map(|(_, commands)| commands.iter());
    examples.fold(command.help_template(template), |command, (name, example)| {
        command.mut_subcommand(name, |found| found.after_help(format!("Example:\n  {example}")))
    })
}

/// Writes the manual pages into the folder `out`: one page for each command that the help shows.
///
/// # Errors
/// Fails if the folder or a page cannot be written.
pub fn manual(command: Command, out: &Path) -> anyhow::Result<Outcome> {
    std::fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
    clap_mangen::generate_to(command, out)
        .with_context(|| format!("the manual cannot be written to {}", out.display()))?;
    Ok(Outcome::Done)
}

/// Prints the completion script for a shell.
///
/// # Errors
/// Fails if the script cannot be printed.
pub fn completions(mut command: Command, shell: clap_complete::Shell) -> anyhow::Result<Outcome> {
    let name = command.get_name().to_owned();
    // The library panics where it cannot print, for example into a closed pipe.
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, name, &mut script);
    stdout().lock().write_all(&script)?;
    Ok(Outcome::Done)
}
