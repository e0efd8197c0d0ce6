//! Output on standard error: lines, and progress bars. No bars without a terminal, or with `--quiet`; without
//! a terminal a study reports a line a minute. Lines on a terminal are broken between words.

use std::fmt;
use std::io::{self, IsTerminal, Write};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use mcl_core::text::printable;
use terminal_size::terminal_size_of;

/// Reports a line on standard error, formatted as by `eprintln!`. A failure to write it (the reader of a pipe
/// is gone, the disk of a log is full) must not end a long run, as it would with `eprintln!`.
macro_rules! tell {
    ($($argument:tt)*) => {
        $crate::progress::print_line(format_args!($($argument)*))
    };
}
pub(crate) use tell;

/// See [`tell!`].
pub(crate) fn print_line(line: fmt::Arguments<'_>) {
    // Names from files and arguments may contain control sequences.
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

/// An error with its causes, except causes that the preceding message already contains.
pub fn error_message(error: &anyhow::Error) -> String {
    let mut text = String::new();
    let mut before = String::new();
    for cause in error.chain() {
        let message = cause.to_string();
        if !before.contains(&message) {
            text += if text.is_empty() { "" } else { ": " };
            text += &message;
            before = message;
        }
    }
    text
}

/// Text with lines no wider than a terminal, broken between words; what has no space in it, such as a path,
/// stays whole. Lines continue below their value (after two spaces), or below their first word.
pub(crate) fn wrapped(text: &str, width: usize) -> String {
    let mut lines = Vec::new();
    for line in text.lines() {
        let indent = indent_of(line, width);
        let mut rest = line.to_owned();
        while rest.chars().count() > width {
            // The last space with something before it.
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

/// Interval of progress reports without a terminal.
const EVERY: Duration = Duration::from_secs(60);

/// Progress of a study on a data set: a bar on a terminal, else a line a minute.
pub struct StudyProgress {
    bar: ProgressBar,
    state: Arc<Mutex<State>>,
    /// Ends the thread that reports lines, and its handle.
    reporter: Option<(Sender<()>, JoinHandle<()>)>,
}

struct State {
    ended: usize,
    all: usize,
    share: f64,
    /// When all will have ended, as far as known.
    end: Option<Instant>,
}

impl State {
    /// "45 %, 210 of 460 trials, about 40 s left".
    fn text(&self) -> String {
        let State { ended, all, share, .. } = self;
        format!("{:.0} %, {ended} of {all} trials{}", (100.0 * share).floor(), self.left())
    }

    fn left(&self) -> String {
        let left = self.end.map(|end| end.saturating_duration_since(Instant::now()));
        left.map_or(String::new(), |left| format!(", about {} left", span(left.as_secs_f64())))
    }
}

impl StudyProgress {
    /// The bar counts in parts of the whole, so that it follows the work and not the number of trials.
    const PARTS: f64 = 1e6;

    /// For a data set of this name.
    pub fn new(dataset: &str, quiet: bool) -> Self {
        let state = State { ended: 0, all: 0, share: 0.0, end: None };
        let state = Arc::new(Mutex::new(state));
        let shared = state.clone();
        let left = move |_: &ProgressState, text: &mut dyn fmt::Write| {
            // A bar that cannot be drawn is left out.
            let left = shared.lock().unwrap_or_else(PoisonError::into_inner).left();
            text.write_str(&left).unwrap_or_default();
        };
        let style = "{prefix} {wide_bar:.cyan/dim} {percent:>3} %  {msg}{left}";
        let style = template(style).with_key("left", left);
        let bar = shown(Some(Self::PARTS as u64), style, dataset, quiet);
        let is_reporting = !quiet && !io::stderr().is_terminal();
        let reporter =
            if is_reporting { report_every(EVERY, dataset, state.clone()) } else { None };
        StudyProgress { bar, state, reporter }
    }

    /// Trials are about to run, with an estimate of the time.
    pub fn begin(&self, trials: usize, expected: Duration) {
        self.set(0, trials, 0.0, expected);
    }

    /// This many trials have ended, with this share of the work, and an estimate of the time left.
    pub fn set(&self, ended: usize, all: usize, share: f64, left: Duration) {
        let end = Instant::now().checked_add(left);
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) =
            State { ended, all, share, end };
        self.bar.set_position((Self::PARTS * share) as u64);
        self.bar.set_message(format!("{ended}/{all} trials"));
    }

    /// Reports a line that the bar does not overwrite.
    pub fn print(&self, line: fmt::Arguments<'_>) {
        self.bar.suspend(|| print_line(line));
    }
}

impl Drop for StudyProgress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        if let Some((end, reporter)) = self.reporter.take() {
            drop(end);
            // The thread cannot fail.
            drop(reporter.join());
        }
    }
}

/// Reports progress at intervals until the sender is dropped; never, if no thread can be created.
fn report_every(
    every: Duration,
    dataset: &str,
    state: Arc<Mutex<State>>,
) -> Option<(Sender<()>, JoinHandle<()>)> {
    let (sender, receiver) = mpsc::channel();
    let dataset = dataset.to_owned();
    let print = move || {
        while receiver.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
            let state = state.lock().unwrap_or_else(PoisonError::into_inner);
            if state.all > 0 {
                tell!("{dataset}: {}", state.text());
            }
        }
    };
    let thread = std::thread::Builder::new().spawn(print).ok()?;
    Some((sender, thread))
}

/// A time in seconds: "40 s", "4 min", "2.5 h".
pub fn span(seconds: f64) -> String {
    match seconds {
        s if s < 100.0 => format!("{:.0} s", s.max(1.0)),
        s if s < 600.0 => format!("{:.1} min", s / 60.0),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// A bar over work of `length` units with the time left.
pub fn bar(length: u64, what: &str, quiet: bool) -> ProgressBar {
    let style = "{prefix} {wide_bar:.cyan/dim} {percent:>3} %  {msg}  {eta} left";
    shown(Some(length), template(style), what, quiet)
}

/// A line for work of unknown length.
pub fn spinner(what: &str, quiet: bool) -> ProgressBar {
    shown(None, template("{spinner} {prefix}: {wide_msg} {elapsed}"), what, quiet)
}

/// A bar over bytes of a download; the total may become known later.
pub fn bytes(what: &str, quiet: bool) -> ProgressBar {
    let style = "{prefix} {wide_bar:.cyan/dim} {bytes}/{total_bytes}  {bytes_per_sec}  {eta} left";
    shown(None, template(style), what, quiet)
}

fn template(text: &str) -> ProgressStyle {
    ProgressStyle::with_template(text).expect("the template is valid")
}

fn shown(length: Option<u64>, style: ProgressStyle, what: &str, quiet: bool) -> ProgressBar {
    let target =
        if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr_with_hz(8) };
    let bar = ProgressBar::with_draw_target(length, target);
    bar.set_style(style);
    bar.set_prefix(printable(what).into_owned());
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_causes_are_left_out() {
        let error = anyhow::anyhow!("no such file")
            .context("cannot read a.csv: no such file")
            .context("in the map");
        assert_eq!(error_message(&error), "in the map: cannot read a.csv: no such file");
    }

    /// Fault: without a terminal nothing was reported until the last trial had ended.
    #[test]
    fn progress_is_one_line() {
        let mut state = State { ended: 210, all: 460, share: 0.4599, end: None };
        assert_eq!(state.text(), "45 %, 210 of 460 trials");
        state.end = Some(Instant::now() + Duration::from_millis(40_400));
        assert_eq!(state.text(), "45 %, 210 of 460 trials, about 40 s left");
        assert_eq!(
            [0.2, 99.0, 252.0, 1500.0, 9000.0].map(span),
            ["1 s", "99 s", "4.2 min", "25 min", "2.5 h"]
        );
    }

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
