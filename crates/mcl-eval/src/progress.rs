//! What is told on standard error: lines, and progress bars. No bars when it is no terminal, or when told
//! to be quiet. Lines on a terminal are broken between words.

use std::fmt;
use std::io::{self, Write};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use mcl_core::text::printable;
use terminal_size::terminal_size_of;

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
    // Names from files and arguments may hold what a terminal carries out.
    let line = line.to_string();
    let mut line = line.split('\n').map(printable).collect::<Vec<_>>().join("\n");
    let mut stderr = io::stderr().lock();
    if let Some((width, _)) = terminal_size_of(&stderr) {
        line = wrapped(&line, width.0.into());
    }
    line.push('\n');
    // One write per line, so that lines of several programs do not mix.
    drop(stderr.write_all(line.as_bytes()));
}

/// Text whose lines are no wider than a terminal, broken between words; what has no space in it, such as
/// a path, stays whole. Lines go on below their value (after two spaces), or below their first word.
pub(crate) fn wrapped(text: &str, width: usize) -> String {
    let mut lines = Vec::new();
    for line in text.lines() {
        let indent = indent_of(line, width);
        let mut rest = line.to_owned();
        while rest.chars().count() > width {
            // Where the last space is that leaves something before it.
            let cut =
                rest.char_indices().take(width + 1).filter(|&(at, c)| c == ' ' && at > indent);
            let next = rest.char_indices().find(|&(at, c)| c == ' ' && at > indent);
            let Some((at, _)) = cut.last().or(next) else { break };
            let after = rest.split_off(at);
            lines.push(rest);
            rest = " ".repeat(indent) + after.trim_start();
        }
        lines.push(rest);
    }
    lines.join("\n")
}

/// How far a line's further lines are indented, in spaces.
fn indent_of(line: &str, width: usize) -> usize {
    let first = line.len() - line.trim_start().len();
    let value = line[first..].find("  ").map(|gap| {
        let gap = first + gap;
        gap + line[gap..].len() - line[gap..].trim_start().len()
    });
    value.filter(|&value| line.is_char_boundary(value) && value <= width / 2).unwrap_or(first)
}

/// A bar over work of `length` units with the time left.
pub fn bar(length: u64, what: &str, quiet: bool) -> ProgressBar {
    let style = "{prefix} {wide_bar:.cyan/dim} {percent:>3} %  {msg}  {eta} left";
    shown(Some(length), style, what, quiet)
}

/// A line for work whose end nobody knows beforehand.
pub fn spinner(what: &str, quiet: bool) -> ProgressBar {
    shown(None, "{spinner} {prefix}: {wide_msg} {elapsed}", what, quiet)
}

/// A bar over bytes of a download; the total may become known later.
pub fn bytes(what: &str, quiet: bool) -> ProgressBar {
    let style = "{prefix} {wide_bar:.cyan/dim} {bytes}/{total_bytes}  {bytes_per_sec}  {eta} left";
    shown(None, style, what, quiet)
}

fn shown(length: Option<u64>, style: &str, what: &str, quiet: bool) -> ProgressBar {
    let target =
        if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(8) };
    let bar = ProgressBar::with_draw_target(length, target);
    bar.set_style(ProgressStyle::with_template(style).expect("the template is valid"));
    bar.set_prefix(what.to_owned());
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_fits_a_narrow_terminal() {
        let text =
            "office\n  kind        corrected log, raw odometry\n  points      7 with 0 < r ≤ 10 m";
        assert_eq!(wrapped(text, 80), text);
        let narrow = "office\n  kind        corrected log,\n              raw odometry\n  \
                      points      7 with 0 < r ≤\n              10 m";
        assert_eq!(wrapped(text, 28), narrow);
        let note = "error: no file \"nosuch\"; known are: aces, intel-lab";
        assert_eq!(wrapped(note, 24), "error: no file \"nosuch\";\nknown are: aces,\nintel-lab");
        // A path is not cut, and whatever the width, no word is lost.
        let path = "  /a/very/long/path/to/a.log: no known copy";
        assert_eq!(wrapped(path, 12), "  /a/very/long/path/to/a.log:\n  no known\n  copy");
        for width in 0..50 {
            let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
            assert_eq!(words(&wrapped(text, width)), words(text));
        }
    }
}
