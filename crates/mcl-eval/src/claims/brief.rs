//! A brief summary of the decided claims and their effects.

use std::path::Path;

use mcl_core::text::{list, numbers as with_distinct_digits};
use mcl_study::store::results::{FIGURES, Results};

use crate::claims::claim::{Claim, Conditions, DatasetClaims, Evidence, Verdict};
use crate::claims::numbers::{Numbers, numbers, preference};
use crate::claims::render::{columns, interval, shown};
use crate::claims::{compared, short};

/// Widths of the verdict and of the statement, in columns.
const VERDICT: usize = 5;
const STATEMENT: usize = 38;
/// Gap between columns; long lines continue below the second column.
const GAP: &str = "  ";

/// What the names of maps mean; shown with the first of them.
const NAMES: &str = "gbs is grid-based, rnd random sampling, f-km fuzzy k-means";

/// A line per decided claim, on one data set with its effect, on several with the number of those on which it
/// holds; the others are counted. Then the folders that lack trials, the most important numbers, where the
/// figures are, and what to do next. Control characters in names from data are shown as escapes.
pub fn text(
    datasets: &[DatasetClaims],
    without_results: &[String],
    results: &[Results],
    root: &Path,
    width: u16,
) -> String {
    let names: Vec<&str> = datasets.iter().map(|dataset| dataset.name.as_str()).collect();
    let all: Vec<&Claim> = datasets.iter().flat_map(|dataset| &dataset.claims).collect();
    let counted = if datasets.len() > 1 { "; first, on how many data sets each holds" } else { "" };
    let mut lines = vec![format!("The paper's claims on {} ({NAMES}{counted}):", list(&names))];
    let mut ids: Vec<&'static str> = Vec::new();
    for claim in &all {
        if !ids.contains(&claim.id) {
            ids.push(claim.id);
        }
    }
    let (mut first, mut open) = (Vec::new(), 0);
    for id in ids {
        let of_papers: Vec<&Claim> =
            datasets.iter().filter_map(|dataset| of_paper(dataset, id)).collect();
        let decided: Vec<&Claim> = of_papers
            .iter()
            .copied()
            .filter(|claim| claim.verdict != Verdict::NotTestable)
            .collect();
        match decided.is_empty() {
            true => open += 1,
            false => lines.push(line(&decided, datasets.len() > 1, columns(width))),
        }
        first.extend(of_papers);
    }
    lines.extend(rest(&all, &first, open, root));
    for results in compared(results, datasets) {
        lines.extend(results.missing().map(|found| {
            format!(
                "Incomplete: {}, {found} are there; no verdicts on it, and its numbers will change",
                results.folder.display()
            )
        }));
    }
    lines.extend(number_lines(&numbers(results)));
    let drawn = || results.iter().filter(|results| results.folder.join(FIGURES).is_dir());
    if let Some(first) = drawn().next() {
        let of_one = drawn().all(|results| results.facts.name == first.facts.name);
        let dataset = if of_one { first.facts.name.as_str() } else { "*" };
        let folder = root.join("*").join(dataset).join(FIGURES);
        lines.push(format!("Figures: {}", folder.display()));
    }
    lines.push(match without_results {
        [] => "Next: `make beyond` for better maps, sizes by the data, robots that are lost"
            .to_owned(),
        names => {
            format!("Next: `make datasets`; without results of these studies: {}", list(names))
        }
    });
    shown(&lines, width)
}

/// The claim with this name on a data set, under the paper's conditions.
fn of_paper<'d>(dataset: &'d DatasetClaims, id: &str) -> Option<&'d Claim> {
    let alike = dataset.claims.iter().filter(|claim| claim.id == id);
    alike.min_by_key(|claim| preference(&claim.place))
}

/// "yes   f-km lowers the localization error  error ratio gbs+f-km over gbs: 0.645 (0.584 to 0.713)".
fn line(decided: &[&Claim], of_several: bool, width: usize) -> String {
    let Some(claim) = decided.first() else { return String::new() };
    let holds: Vec<&&Claim> =
        decided.iter().filter(|claim| claim.verdict == Verdict::Reproduced).collect();
    let verdict = match (of_several, holds.len()) {
        (false, 0) => "no".to_owned(),
        (false, _) => "yes".to_owned(),
        (true, holds) => format!("{holds}/{}", decided.len()),
    };
    let statement = short(claim.id).unwrap_or(claim.id);
    let begin = format!("{verdict:<VERDICT$}{statement:<STATEMENT$}{GAP}");
    let room = width.saturating_sub(begin.chars().count());
    let found = match decided {
        [only] => of_one(only),
        _ => of_all(decided, &holds),
    };
    // The longest that fits; if none does, the shortest.
    let fits = found.iter().find(|text| text.chars().count() <= room);
    let found = fits.or(found.last()).map_or("", String::as_str);
    format!("{begin}{}", cut(found, room)).trim_end().to_owned()
}

/// The measurement of a claim, the longest version first.
fn of_one(claim: &Claim) -> Vec<String> {
    let Evidence { effect_of, .. } = &claim.evidence;
    match (interval(&claim.evidence), effect_of) {
        (Some(interval), Some(of)) => vec![format!("{of}: {interval}"), with_unit(of, &interval)],
        (Some(interval), None) => vec![interval],
        (None, _) => vec![claim.measured.clone()],
    }
}

/// An effect with as much of its name as fits.
fn with_unit(of: &str, effect: &str) -> String {
    let units = ["nats", "ratio", "share"];
    let unit = units.iter().find(|unit| of.split_whitespace().any(|word| word == **unit));
    unit.map_or(effect.to_owned(), |unit| format!("{unit} {effect}"))
}

/// The data sets on which a claim does not hold, and the range of its effects, where they are of the same
/// kind.
fn of_all(decided: &[&Claim], holds: &[&&Claim]) -> Vec<String> {
    let is_other = |claim: &&&Claim| !holds.iter().any(|held| std::ptr::eq(**held, **claim));
    let not: Vec<&str> =
        decided.iter().filter(is_other).map(|claim| claim.place.dataset.as_str()).collect();
    let not = match (holds.len(), not.len()) {
        (0, _) | (_, 0) => String::new(),
        _ => format!("not {}", list(&not)),
    };
    let effects: Vec<f64> = decided.iter().filter_map(|claim| claim.evidence.effect).collect();
    let of = decided.first().and_then(|claim| claim.evidence.effect_of.as_deref());
    let is_same = decided.iter().all(|claim| claim.evidence.effect_of.as_deref() == of);
    let ends = [
        effects.iter().copied().fold(f64::INFINITY, f64::min),
        effects.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    ];
    match of {
        Some(of) if is_same && effects.len() == decided.len() => {
            let mut range = with_distinct_digits(&ends);
            range.dedup();
            let range = range.join(" to ");
            let join = if not.is_empty() { "" } else { "; " };
            vec![
                format!("{of}: {range}{join}{not}"),
                format!("{}{join}{not}", with_unit(of, &range)),
                not,
            ]
        }
        _ => vec![not],
    }
}

/// Text truncated to this many columns.
fn cut(text: &str, room: usize) -> String {
    match text.chars().count() <= room || room < 2 {
        true => text.to_owned(),
        false => text.chars().take(room - 1).chain(['…']).collect(),
    }
}

/// The claims without a line of their own.
fn rest(all: &[&Claim], first: &[&Claim], open: usize, root: &Path) -> Vec<String> {
    let is_first = |claim: &&&Claim| first.iter().any(|of_paper| std::ptr::eq(*of_paper, **claim));
    let others: Vec<&&Claim> = all
        .iter()
        .filter(|claim| !is_first(claim) && claim.verdict != Verdict::NotTestable)
        .collect();
    let mut parts = Vec::new();
    if !others.is_empty() {
        let hold = others.iter().filter(|claim| claim.verdict == Verdict::Reproduced).count();
        let of_paper: Vec<&Conditions> = first.iter().map(|claim| &claim.place).collect();
        let places = places(&others, &of_paper);
        parts.push(format!("under {places} {hold} of {}", others.len()));
    }
    if open > 0 {
        parts.push(format!("{open} not testable"));
    }
    let rest = if parts.is_empty() { String::new() } else { format!("{}; ", parts.join("; ")) };
    let mut text = format!("{rest}tests: `mcl-eval claims {} --verbose`", root.display());
    if let Some(first) = text.get(..1) {
        text.replace_range(..1, &first.to_uppercase());
    }
    vec![text]
}

/// "book, default, alternate": how these places differ from the others.
fn places(claims: &[&&Claim], than: &[&Conditions]) -> String {
    let is_known = |name: &String| {
        let is_split = |place: &&Conditions| place.split.is_some_and(|split| split.name() == name);
        than.iter().any(|place| place.preset.as_ref() == Some(name) || is_split(place))
    };
    let mut names: Vec<String> = Vec::new();
    for claim in claims {
        let Conditions { preset, split, .. } = &claim.place;
        for name in preset.iter().cloned().chain(split.iter().map(|split| split.name().to_owned()))
        {
            if !names.contains(&name) && !is_known(&name) {
                names.push(name);
            }
        }
    }
    list(&names)
}

/// For one data set a line per measure, for several a line per data set.
fn number_lines(numbers: &[Numbers]) -> Vec<String> {
    let Some(first) = numbers.first() else { return Vec::new() };
    let of_one = numbers.iter().all(|other| other.dataset == first.dataset);
    // The error is what maps are made for.
    let has_runs = |name: &str| numbers.iter().any(|n| n.dataset == name && n.of_runs);
    let chosen = numbers.iter().filter(|n| of_one || n.of_runs || !has_runs(&n.dataset));
    let line = |n: &Numbers| {
        let of = if of_one { String::new() } else { format!("{}: ", n.dataset) };
        format!("{of}{} on maps of {} %: {}", n.what, n.percent, n.kinds.join(", "))
    };
    chosen.map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::claims::{decide, planted};

    fn results() -> Vec<Results> {
        let of_likelihood = planted::likelihood(&[1.0, 20.0], |_, size, scatter| {
            let initial = -60.0 / (size + 5.0) + 0.01 * scatter;
            (initial, if size == 1.0 { initial + 3.0 } else { initial })
        });
        let localized = planted::localization(&[0.1, 1.0, 2.0], |kind, size, run, _| {
            let lost = size == 0.1 && kind == "rnd" && run == 1;
            if lost { 4.0 } else { 0.03 + 0.001 * f64::from(run) }
        });
        vec![of_likelihood, localized]
    }

    /// Fault: 762 lines, most of them about what could not be tested.
    #[test]
    fn a_new_user_reads_what_was_decided_on_one_screen() {
        let results = results();
        let missing = ["aces".to_owned(), "intel-lab".to_owned()];
        for width in [80, 100, 120] {
            let text = text(&decide(&results), &missing, &results, Path::new("results"), width);
            let lines: Vec<&str> = text.lines().collect();
            assert!((10..=22).contains(&lines.len()), "{} lines:\n{text}", lines.len());
            assert!(lines.iter().all(|line| line.chars().count() <= width.into()), "{text}");
            assert!(!text.contains("not testable  "), "{text}");
            let claims: Vec<&&str> =
                lines.iter().filter(|l| l.starts_with("yes ") || l.starts_with("no ")).collect();
            assert!(claims.len() >= 8, "{text}");
            assert!(text.contains(" not testable; tests: `mcl-eval claims"), "{text}");
            assert!(text.contains("mean error d (diverged runs)"), "{text}");
            assert!(lines[lines.len() - 1].contains("aces, intel-lab"), "{text}");
            for meaning in ["grid-based", "random sampling", "fuzzy k-means"] {
                let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
                assert!(words.contains(meaning), "{meaning}\n{text}");
            }
        }
    }

    #[test]
    fn several_data_sets_have_one_line_per_claim() {
        let mut results = results();
        let mut elsewhere = results[1].clone();
        elsewhere.facts.name = "elsewhere".into();
        planted::edit(&mut elsewhere, |row| {
            row.set("dataset", "elsewhere");
            row.set("diverged", false);
            true
        });
        results.push(elsewhere);
        let text = text(&decide(&results), &[], &results, Path::new("r"), 100);
        let line = text.lines().find(|line| line.contains("below 0.25 % some runs diverge"));
        assert!(line.is_some_and(|line| line.starts_with("1/2 ")), "{text}");
        assert!(text.contains("elsewhere: mean error d"), "{text}");
        assert!(text.lines().count() < 30, "{text}");
    }

    /// Names of logs and folders are shown as text, whatever they contain.
    #[test]
    fn control_characters_in_names_are_escaped() {
        let hostile = "<script> \u{1b}[31mred\u{7} \u{202e}gpj.exe\r\nyes";
        let mut results = results();
        for results in &mut results {
            results.facts.name = hostile.into();
            planted::edit(results, |row| {
                row.set("dataset", hostile);
                true
            });
        }
        let missing = [hostile.to_owned()];
        let text = text(&decide(&results), &missing, &results, Path::new(hostile), 80);
        let acts = |c: char| c != '\n' && (c.is_control() || c == '\u{202e}');
        assert!(!text.contains(acts) && text.contains(r"\u{1b}[31mred"), "{text}");
    }
}
