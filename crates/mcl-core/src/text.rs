//! Formatting of numbers, lists and external text for tables, captions and messages.

use std::borrow::Cow;

/// Makes text from files or arguments safe to print: invisible control characters become escapes such as `\u{1b}`,
/// all other characters are unchanged.
///
/// Escaped are control characters (including newlines and tabs), line and paragraph separators,
/// text direction controls, which can disguise a name as another, and the noncharacters U+FFFE
/// and U+FFFF.
pub fn printable(text: &str) -> Cow<'_, str> {
    let acts = |c: char| {
        c.is_control()
            || matches!(c,
                '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}'
                | '\u{2066}'..='\u{206f}' | '\u{fffe}' | '\u{ffff}')
    };
    if !text.contains(acts) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        match acts(c) {
            true => shown.extend(c.escape_unicode()),
            false => shown.push(c),
        }
    }
    Cow::Owned(shown)
}

/// What a spreadsheet reads as the start of a formula.
const FORMULA: [char; 6] = ['=', '+', '-', '@', '\t', '\r'];

/// Makes text from files or arguments safe as a cell of a CSV file: what a spreadsheet would compute as a formula, such
/// as the name `=1+1.log`, begins with an apostrophe. Numbers are written without.
pub fn as_cell(text: &str) -> Cow<'_, str> {
    match text.starts_with(FORMULA) {
        true => Cow::Owned(format!("'{text}")),
        false => Cow::Borrowed(text),
    }
}

/// The text of a cell that [`as_cell`] made.
pub fn of_cell(cell: &str) -> &str {
    cell.strip_prefix('\'').filter(|text| text.starts_with(FORMULA)).unwrap_or(cell)
}

/// Formats a p value: "p = 0.012", "p = 3.1e-5", and "p < 1e-300" below that.
pub fn p_value(p: f64) -> String {
    match p {
        p if p >= 0.001 => format!("p = {p:.3}"),
        p if p >= 1e-300 => format!("p = {p:.1e}"),
        _ => "p < 1e-300".to_owned(),
    }
}

/// Formats a number with at least two significant digits and a true minus sign: "31.52", "0.088", "−0.0063".
pub fn number(value: f64) -> String {
    let decimals = match value.abs() {
        magnitude if magnitude >= 100.0 || magnitude == 0.0 => 0,
        magnitude if magnitude >= 1.0 => 2,
        magnitude if magnitude >= 0.01 => 3,
        magnitude if magnitude >= 1e-4 => 5,
        _ => return format!("{value:.1e}").replace('-', "−"),
    };
    format!("{value:.decimals$}").replace('-', "−")
}

/// Values that are compared with each other, as [`number`] shows them, with the decimals that tell the smallest from the
/// largest: "0.02817", "0.02795", "0.02839", where each alone were "0.028".
pub fn numbers(values: &[f64]) -> Vec<String> {
    /// Of a difference below this share of the values nobody needs to know.
    const SAME: f64 = 1e-6;
    let (low, high) = values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)));
    let largest = low.abs().max(high.abs());
    let alone: Vec<String> = values.iter().map(|&value| number(value)).collect();
    let is_plain = |text: &String| !text.contains('e');
    let differ = high - low > SAME * largest && largest.is_finite();
    if !differ || !alone.iter().all(is_plain) {
        return alone;
    }
    // Two digits of what they differ by.
    let (mut needed, mut step) = (0, 1.0);
    while step > 0.1 * (high - low) {
        step *= 0.1;
        needed += 1;
    }
    let own = |text: &str| text.split_once('.').map_or(0, |(_, digits)| digits.len());
    let most = alone.iter().map(|text| own(text)).max().unwrap_or(0);
    let decimals = own(&number(largest)).max(most.min(needed + 1)).max(needed);
    values.iter().map(|value| format!("{value:.decimals$}").replace('-', "−")).collect()
}

/// Joins names, at most four of them: "gbs 1 %, rnd 1 % and 3 more".
pub fn list<S: AsRef<str>>(names: &[S]) -> String {
    const SHOWN: usize = 4;
    let shown: Vec<&str> = names.iter().take(SHOWN).map(AsRef::as_ref).collect();
    let mut text = shown.join(", ");
    if names.len() > SHOWN {
        text += &format!(" and {} more", names.len() - SHOWN);
    }
    text
}

/// Formats a count with its noun: "1 run", "1,234 runs".
pub fn counted(number: usize, what: &str) -> String {
    format!("{} {what}{}", thousands(number), if number == 1 { "" } else { "s" })
}

/// Formats a number with digits in groups of three: 1234567 as `1,234,567`.
pub fn thousands(number: usize) -> String {
    let digits = number.to_string();
    let groups: Vec<&str> = digits
        .as_bytes()
        .rchunks(3)
        .rev()
        .map(|group| std::str::from_utf8(group).expect("digits are ASCII"))
        .collect();
    groups.join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fault: "1 % worse, with 0.017 against 0.017".
    #[test]
    fn different_values_are_shown_differently() {
        assert_eq!(numbers(&[0.01731, 0.01714]), ["0.01731", "0.01714"]);
        assert_eq!(numbers(&[0.02817, 0.02795, 0.02839]), ["0.02817", "0.02795", "0.02839"]);
        assert_eq!(numbers(&[-4.174, -4.171]), ["−4.1740", "−4.1710"]);
        assert_eq!(numbers(&[0.5, 1234.0]), ["0.5", "1234.0"]);
        assert_eq!(numbers(&[-8.38, -6.97, -17.85]), ["−8.38", "−6.97", "−17.85"]);
        assert_eq!(numbers(&[0.022, 0.0085, 0.036]), ["0.0220", "0.0085", "0.0360"]);
        assert_eq!(numbers(&[0.025, 0.025]), ["0.025"; 2]);
        assert_eq!(numbers(&[0.0, 1e-7]), ["0", "1.0e-7"].map(|text| text.replace('-', "−")));
        assert_eq!(numbers(&[]), Vec::<String>::new());
        assert_eq!(numbers(&[1.0, f64::INFINITY]).len(), 2);
    }

    #[test]
    fn text_that_acts_is_shown_as_escapes() {
        let cases = [
            ("\u{1b}[31mred", r"\u{1b}[31mred"),
            ("a\nb\tc\0\u{85}", r"a\u{a}b\u{9}c\u{0}\u{85}"),
            // Read from right to left after the override, it would pass for "map-exe.csv".
            ("map-\u{202e}vsc.exe", r"map-\u{202e}vsc.exe"),
            ("\u{2067}x\u{2069}\u{200f}\u{61c}", r"\u{2067}x\u{2069}\u{200f}\u{61c}"),
            ("one\u{2028}two\u{2029}", r"one\u{2028}two\u{2029}"),
            ("\u{fffe}", r"\u{fffe}"),
        ];
        for (text, shown) in cases {
            assert_eq!(printable(text), shown);
            assert!(matches!(printable(shown), Cow::Borrowed(_)), "{shown} stays as it is");
        }
    }

    #[test]
    fn ordinary_text_stays_as_it_is() {
        for text in ["", "Intel, σ = 0.05 m", r"a\b", "地図", "नक्शा", "مختبر", "👩\u{200d}🔬"]
        {
            assert!(matches!(printable(text), Cow::Borrowed(same) if same == text), "{text}");
        }
    }

    #[test]
    fn cells_are_not_formulas() {
        for text in ["=1+1.log", "+a", "-o", "@b", "\tc", "\rd"] {
            let cell = as_cell(text);
            assert_eq!((cell.strip_prefix('\''), of_cell(&cell)), (Some(text), text));
        }
        for text in ["", "a=b", "'a", "büro,\"x\""] {
            assert_eq!((as_cell(text).as_ref(), of_cell(text)), (text, text));
        }
    }

    #[test]
    fn numbers_keep_what_matters() {
        let values = [178.07, -31.5212, 0.0881, -0.00632, 0.0, 1.5e-7];
        let texts = ["178", "−31.52", "0.088", "−0.00632", "0", "1.5e−7"];
        assert_eq!(values.map(number), texts);
        assert_eq!([0.5, 3.14e-5, 0.0].map(p_value), ["p = 0.500", "p = 3.1e-5", "p < 1e-300"]);
    }

    #[test]
    fn long_lists_are_cut() {
        assert_eq!(list(&["a", "b"]), "a, b");
        assert_eq!(list(&["a", "b", "c", "d", "e", "f"]), "a, b, c, d and 2 more");
    }

    #[test]
    fn digits_in_groups_of_three() {
        let numbers = [0, 999, 1000, 155_648, 1_654_968];
        let texts = ["0", "999", "1,000", "155,648", "1,654,968"];
        assert_eq!(numbers.map(thousands), texts);
    }
}
