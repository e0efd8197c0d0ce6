//! The command line: the arguments, and the glue from there to the libraries.

pub(crate) mod args;
mod claims;
mod compare;
mod convert;
mod datasets;
mod evaluate;
mod export;
mod grid;
mod inspect;
mod likelihood;
pub(crate) mod localize;
pub(crate) mod map;
mod output;
mod plan;
mod plot;
mod report;
mod run;
mod simulate;
mod status;

use std::ffi::OsString;
use std::process::ExitCode;

use anyhow::Context;
use clap::{CommandFactory, FromArgMatches};

use crate::progress::{error_message, tell};
use args::{Cli, Command, LocalizeArgs, StudyArgs, given};

/// How a command that did not fail ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Completed.
    Done,
    /// Finished, but records were skipped or trials lost (reported on stderr).
    Incomplete,
}

impl Outcome {
    /// [`Outcome::Incomplete`] if anything was lost.
    fn of(complete: bool) -> Self {
        if complete { Outcome::Done } else { Outcome::Incomplete }
    }
}

/// Runs the program on the process's arguments.
pub fn main() -> ExitCode {
    #[cfg(unix)]
    outlive_file_limits();
    ExitCode::from(main_of(std::env::args_os()))
}

/// A write beyond the limit on file sizes (`ulimit -f`) fails like one on a full disk, instead of ending the program
/// without a word.
#[cfg(unix)]
fn outlive_file_limits() {
    let caught = std::sync::Arc::default();
    // Where the signal cannot be caught, it ends the program as before.
    drop(signal_hook::flag::register(signal_hook::consts::SIGXFSZ, caught));
}

/// Runs the program on arguments, the first of which is its name, and returns its exit code. A usage error and an
/// interrupted study end the process.
pub fn main_of(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let result = match parse(arguments) {
        Ok(cli) => run_command(cli),
        // The text of --help and --version is a result like any other.
        Err(help) if !help.use_stderr() => output::print_styled(&help),
        Err(error) => error.exit(),
    };
    match result {
        Ok(Outcome::Done) => 0,
        Ok(Outcome::Incomplete) => 3,
        // The reader of our output has closed it.
        Err(error) if output::is_broken_pipe(&error) => 0,
        Err(error) => {
            if let Some(usage) = error.downcast_ref::<clap::Error>() {
                usage.exit();
            }
            tell!("error: {}", error_message(&error));
            1
        }
    }
}

fn parse(arguments: impl IntoIterator<Item = OsString>) -> Result<Cli, clap::Error> {
    // A negative number is a value that is refused with the range of its option, not an unknown option.
    let command = Cli::command().mut_subcommands(|command| {
        command.mut_args(|option| {
            match option.get_action().takes_values() && !option.is_positional() {
                true => option.allow_negative_numbers(true),
                false => option,
            }
        })
    });
    let matches = command.try_get_matches_from(arguments)?;
    let mut cli = Cli::from_arg_matches(&matches)?;
    match (&mut cli.command, matches.subcommand()) {
        (Command::Plan(plan), Some((_, of_plan))) => {
            plan.given = given::<StudyArgs>(of_plan, &["datasets", "output"]);
        }
        (Command::Localize(localize), Some((_, of_localize))) => {
            localize.given = given::<LocalizeArgs>(of_localize, &["output", "replay", "json"]);
        }
        _ => {}
    }
    Ok(cli)
}

fn run_command(cli: Cli) -> anyhow::Result<Outcome> {
    set_threads(cli.global.threads)?;
    match cli.command {
        Command::Inspect(args) => inspect::run(&args),
        Command::Map(args) => map::run(&args, &cli.global),
        Command::Likelihood(args) => likelihood::run(&args),
        Command::Localize(args) => localize::run(&args, &cli.global),
        Command::Evaluate(args) => evaluate::run(&args, &cli.global),
        Command::Run(args) => run::run(&args, &cli.global),
        Command::Export(args) => export::run(&args, &cli.global),
        Command::Plan(args) => plan::run(&args, &cli.global),
        Command::Status(args) => status::run(&args),
        Command::Plot(args) => plot::run(&args, &cli.global),
        Command::Compare(args) => compare::run(&args),
        Command::Claims(args) => claims::run(&args, &cli.global),
        Command::Report(args) => report::run(&args, &cli.global),
        Command::Convert(args) => convert::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Datasets(args) => datasets::run(&args, &cli.global),
    }
}

fn set_threads(threads: u16) -> anyhow::Result<()> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global();
    pool.with_context(|| format!("cannot start {threads} worker threads"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// clap does not wrap lines of usage: those of `map` and `evaluate` were longer.
    #[test]
    fn help_fits_a_narrow_terminal() {
        const WIDTH: usize = 60;
        let mut top = Cli::command();
        top.build();
        let mut commands = vec![top];
        let mut lines = 0;
        while let Some(command) = commands.pop() {
            commands.extend(command.get_subcommands().cloned());
            let help = command.term_width(WIDTH).render_long_help().to_string();
            for line in help.lines() {
                assert!(line.chars().count() <= WIDTH, "{line}");
                lines += 1;
            }
        }
        assert!(lines > 500, "{lines}");
    }
}
