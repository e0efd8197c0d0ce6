//! What is told on standard error: lines, and progress bars. No bars when it is no terminal, or when told
//! to be quiet.

use std::fmt;
use std::io::{self, Write};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Tells a line on standard error, formatted as by `eprintln!`. That nobody can be told (the reader of a
/// pipe went away, the disk of a log is full) must not end a long run, as it would with `eprintln!`.
macro_rules! tell {
    ($($argument:tt)*) => {
        $crate::progress::tell_line(format_args!($($argument)*))
    };
}
pub(crate) use tell;

/// See [`tell!`].
pub(crate) fn tell_line(line: fmt::Arguments<'_>) {
    // One write per line, so that lines of several programs do not mix.
    let line = format!("{line}\n");
    drop(io::stderr().write_all(line.as_bytes()));
}

/// A bar over work of `length` units with the time left.
pub fn bar(length: u64, what: &str, quiet: bool) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(length), target(quiet));
    bar.set_style(style("{prefix} {wide_bar:.cyan/dim} {percent:>3} %  {msg}  {eta} left"));
    bar.set_prefix(what.to_owned());
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}

/// A line for work whose end nobody knows beforehand.
pub fn spinner(what: &str, quiet: bool) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, target(quiet));
    bar.set_style(style("{spinner} {prefix}: {wide_msg} {elapsed}"));
    bar.set_prefix(what.to_owned());
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}

/// A bar over bytes of a download; the total may become known later.
pub fn bytes(what: &str, quiet: bool) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, target(quiet));
    bar.set_style(style(
        "{prefix} {wide_bar:.cyan/dim} {bytes}/{total_bytes}  {bytes_per_sec}  {eta} left",
    ));
    bar.set_prefix(what.to_owned());
    bar
}

fn target(quiet: bool) -> ProgressDrawTarget {
    if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(8) }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("the template is valid")
}
