//! Text for a page: names from files, sizes, dates.

use std::time::{SystemTime, UNIX_EPOCH};

use mcl_core::text::{printable, thousands};

/// Length limit of a shown name, in characters.
const MOST: usize = 200;

/// Text from files, for display: control characters are escaped, and long text is truncated, with its length.
/// Markup is escaped by the templates.
pub fn shown(text: &str) -> String {
    match text.char_indices().nth(MOST) {
        None => printable(text).into_owned(),
        Some((end, _)) => {
            let count = thousands(text.chars().count());
            format!("{}… ({count} characters)", printable(&text[..end]))
        }
    }
}

/// As [`shown`], for sentences, which are longer than names.
pub fn shown_long(text: &str) -> String {
    match text.char_indices().nth(3 * MOST) {
        None => printable(text).into_owned(),
        Some((end, _)) => format!("{} …", printable(&text[..end])),
    }
}

/// A file's text: as [`shown`], but of any length, and with its line breaks.
pub fn shown_lines(text: &str) -> String {
    let lines: Vec<_> = text.lines().map(|line| printable(line).replace(r"\u{9}", "\t")).collect();
    lines.join("\n")
}

/// "5.8 MB".
pub fn bytes(number: usize) -> String {
    match number {
        0..1_000 => format!("{number} bytes"),
        1_000..1_000_000 => format!("{:.0} kB", number as f64 / 1e3),
        _ => format!("{:.1} MB", number as f64 / 1e6),
    }
}

/// "4.2 s", "12 minutes", "3.1 hours".
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 1.0 => format!("{s:.2} s"),
        s if s < 120.0 => format!("{s:.1} s"),
        s if s < 7200.0 => format!("{:.0} minutes", s / 60.0),
        s => format!("{:.1} hours", s / 3600.0),
    }
}

/// "2026-11-27 18:05 UTC".
pub fn date(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let (days, minutes) = (seconds / 86_400, seconds % 86_400 / 60);
    let [year, month, day] = civil(days);
    format!("{year:04}-{month:02}-{day:02} {:02}:{:02} UTC", minutes / 60, minutes % 60)
}

/// Year, month and day for a day since 1970, in the Gregorian calendar. Years begin in March here, so that
/// leap days come last.
fn civil(days: u64) -> [u64; 3] {
    let days = days + 719_468;
    let (era, of_era) = (days / 146_097, days % 146_097);
    let year = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let (month, carry) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    [era * 400 + year + carry, month, day]
}

/// An argument of a command, quoted for a shell.
pub fn argument(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./+=:@%".contains(c);
    match !text.is_empty() && text.chars().all(is_plain) {
        true => text.to_owned(),
        false => format!("'{}'", text.replace('\'', r"'\''")),
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn long_names_are_cut_and_say_so() {
        assert_eq!(shown("a\u{202e}b"), r"a\u{202e}b");
        let long = shown(&"x".repeat(10_000));
        assert!(long.ends_with("x… (10,000 characters)") && long.len() < 250, "{long}");
        assert_eq!(shown_long(&"x".repeat(10_000)), "x".repeat(600) + " …");
        assert_eq!(shown_lines("a\tb\n\u{1b}[1m\n"), "a\tb\n\\u{1b}[1m");
    }

    #[test]
    fn dates_are_those_of_the_calendar() {
        let of = |seconds| date(UNIX_EPOCH + Duration::from_secs(seconds));
        assert_eq!(of(0), "1970-01-01 00:00 UTC");
        assert_eq!(of(951_782_399), "2000-02-28 23:59 UTC");
        assert_eq!(of(951_782_400), "2000-02-29 00:00 UTC");
        assert_eq!(of(1_795_802_700), "2026-11-27 18:05 UTC");
        assert_eq!(of(4_107_542_400), "2100-03-01 00:00 UTC");
    }

    #[test]
    fn arguments_are_one_word_of_a_shell() {
        let cases =
            [("intel-lab", "intel-lab"), ("a b", "'a b'"), ("$(x)'", r"'$(x)'\'''"), ("", "''")];
        for (text, expected) in cases {
            assert_eq!(argument(text), expected);
        }
    }
}
