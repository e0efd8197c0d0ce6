//! Claims as text: for the terminal and as Markdown.

use mcl_core::text::{counted, numbers, p_value, printable};
use mcl_study::recipe::split::Split;

use crate::claims::claim::{ALPHA, Claim, Conditions, DatasetClaims, Evidence, Verdict};
use crate::progress::wrapped;

/// Width limits in columns: longer lines are hard to follow, and shorter ones would not fit some words.
const WIDTHS: (u16, u16) = (40, 120);

/// Stands for spaces at which no line may end, until lines are broken.
const GLUE: &str = "\u{a0}";

/// The claims of each data set, in lines of `width` columns, and a summary line; then the names of data sets
/// without results. Control characters in names from data are shown as escapes.
pub fn text(datasets: &[DatasetClaims], without_results: &[String], width: u16) -> String {
    let all = all(datasets);
    let mut lines = Vec::new();
    for dataset in datasets {
        lines.extend([heading(dataset), String::new()]);
        for claim in &dataset.claims {
            let p = claim.evidence.p.map(|p| format!("; {}", p_value(p))).unwrap_or_default();
            let texts = [
                format!("{}: {}", place(claim, &all), claim.statement),
                format!("Measured: {}", claim.measured),
                format!("Test: {}{p}", claim.test),
            ];
            let effect = effect(claim).map(|effect| format!("Effect: {effect}"));
            let verdicts = [claim.verdict.into(), "", "", ""];
            let lines_of = verdicts.into_iter().zip(texts.into_iter().chain(effect));
            lines.extend(lines_of.map(|(verdict, text)| format!("  {verdict:<14}  {text}")));
        }
        lines.push(String::new());
        lines.extend(summary(dataset, &all));
        lines.push(String::new());
    }
    let counts = Counts::of(&all);
    for (at, (id, cells)) in counts.claims.iter().enumerate() {
        if at == 0 {
            lines.push(Counts::HEADING.to_owned());
        }
        let cells = counts.filters.iter().zip(cells).filter(|(_, cell)| !cell.is_empty());
        let cells = cells.map(|(filter, cell)| format!("{filter} {cell}").trim_start().to_owned());
        lines.push(format!("  {id:<28}  {}", cells.collect::<Vec<_>>().join("; ")));
    }
    if !counts.claims.is_empty() {
        lines.push(String::new());
    }
    if !without_results.is_empty() {
        lines.push(missing(without_results));
    }
    shown(&lines, width)
}

/// Lines for a terminal: escapes for control characters, broken between words, but not before percent signs
/// nor in equations.
pub(super) fn shown(lines: &[String], width: u16) -> String {
    let [percent, equals] = [format!("{GLUE}%"), format!("{GLUE}={GLUE}")];
    let glued = |line: &String| printable(line).replace(" %", &percent).replace(" = ", &equals);
    let text = lines.iter().map(glued).collect::<Vec<String>>().join("\n");
    wrapped(&text, columns(width)).replace(GLUE, " ")
}

/// The number of columns used.
pub(super) fn columns(width: u16) -> usize {
    width.clamp(WIDTHS.0, WIDTHS.1).into()
}

/// The same as a Markdown document, with the claims' names. Names from data are shown as text, whatever they
/// contain: neither markup nor links.
pub fn markdown(datasets: &[DatasetClaims], without_results: &[String]) -> String {
    let mut text = format!(
        "# The paper's claims beside what was measured\n\nα = {ALPHA}; how each claim is decided stands \
         in docs/claims.md of the program.\n"
    );
    let all = all(datasets);
    for dataset in datasets {
        text += &format!("\n## {}\n\n", escaped(&heading(dataset)));
        text += "| section | claim | statement | measured | test | p | effect (95 %) | verdict |\n";
        text += "|---|---|---|---|---|---|---|---|\n";
        for claim in &dataset.claims {
            let p = claim.evidence.p.map_or(String::new(), p_value);
            let columns = [
                place(claim, &all),
                claim.statement.to_owned(),
                claim.measured.clone(),
                claim.test.to_owned(),
                p.replace("p = ", "").replace("p ", ""),
                effect(claim).unwrap_or_default(),
                <&str>::from(claim.verdict).to_owned(),
            ];
            let [place, rest @ ..] = columns.map(|column| escaped(&column));
            text += &format!("| {place} | `{}` | {} |\n", claim.id, rest.join(" | "));
        }
        text.push('\n');
        for line in summary(dataset, &all) {
            // Not at the start of a line, where a name could begin a list or a heading.
            text += &format!("Summary of {}  \n", escaped(&line));
        }
    }
    let counts = Counts::of(&all);
    if !counts.claims.is_empty() {
        let names = counts.filters.iter().map(|filter| match filter.is_empty() {
            true => "any filter",
            false => filter,
        });
        let names: Vec<String> = names.map(escaped).collect();
        text += &format!("\n## {}\n\n| claim | {} |\n", Counts::HEADING, names.join(" | "));
        text += &format!("|---{}|\n", "|---".repeat(names.len()));
        for (id, cells) in &counts.claims {
            let cells: Vec<String> = cells.iter().map(|cell| escaped(cell)).collect();
            text += &format!("| `{id}` | {} |\n", cells.join(" | "));
        }
    }
    if !without_results.is_empty() {
        text += &format!("\n{}\n", escaped(&missing(without_results)));
    }
    text
}

/// Text that Markdown shows unchanged: no markup, HTML, entities, columns, formulas or links, including those
/// that GitHub makes of bare addresses.
fn escaped(text: &str) -> String {
    let mut shown = String::with_capacity(text.len() + 8);
    for c in printable(text).chars() {
        if "\\`*_[]<>&|~$@#".contains(c) {
            shown.push('\\');
        }
        shown.push(c);
    }
    shown.replace("://", "\\://").replace("www.", "www\\.")
}

/// "error ratio gbs+f-km over gbs: 0.87 (0.80 to 0.95), 10 blocks"
fn effect(claim: &Claim) -> Option<String> {
    let evidence = &claim.evidence;
    let of = evidence.effect_of.as_deref()?;
    Some(format!("{of}: {}, {}", interval(evidence)?, counted(evidence.blocks?, "block")))
}

/// "0.870 (0.800 to 0.950)"
pub(super) fn interval(evidence: &Evidence) -> Option<String> {
    let ends = [evidence.effect?, evidence.low?, evidence.high?];
    match &numbers(&ends)[..] {
        [effect, low, high] => Some(format!("{effect} ({low} to {high})")),
        _ => None,
    }
}

fn all(datasets: &[DatasetClaims]) -> Vec<&Claim> {
    datasets.iter().flat_map(|dataset| &dataset.claims).collect()
}

/// "V-B, carmen, alternate".
fn place(claim: &Claim, all: &[&Claim]) -> String {
    let filter = filter(claim, all);
    format!("{}{}{filter}", claim.section, if filter.is_empty() { "" } else { ", " })
}

/// "carmen, alternate": the study where a data set has several of a kind, the preset where there are several,
/// and the split where the paper does not use it.
fn filter(claim: &Claim, all: &[&Claim]) -> String {
    let alike =
        || all.iter().map(|other| (other.id, &other.place)).filter(|(id, _)| *id == claim.id);
    let is_another = |a: &Conditions| {
        let mut of_data = alike().filter(|(_, b)| a.dataset == b.dataset);
        of_data.any(|(_, b)| a.experiment != b.experiment)
    };
    let Conditions { experiment, preset, split, .. } = &claim.place;
    let experiment = experiment.as_deref().filter(|_| alike().any(|(_, place)| is_another(place)));
    let preset = preset.as_ref().filter(|_| alike().any(|(_, place)| place.preset != *preset));
    let split = split.filter(|&split| split != Split::Same).map(Split::name);
    let parts = [experiment, preset.map(String::as_str), split];
    parts.into_iter().flatten().collect::<Vec<&str>>().join(", ")
}

/// The number of data sets on which claims hold.
struct Counts {
    /// The conditions under which claims were decided.
    filters: Vec<String>,
    /// By claim: for each condition, "6 of 7 (not aces)", or nothing.
    claims: Vec<(&'static str, Vec<String>)>,
}

impl Counts {
    const HEADING: &str = "Data sets on which claims hold, of those that decide them";

    /// Of all claims; empty for a single data set.
    fn of(all: &[&Claim]) -> Self {
        let mut counts = Counts { filters: Vec::new(), claims: Vec::new() };
        if all.iter().all(|claim| claim.place.dataset == all[0].place.dataset) {
            return counts;
        }
        let filters: Vec<String> = all.iter().map(|claim| filter(claim, all)).collect();
        for name in &filters {
            if !counts.filters.contains(name) {
                counts.filters.push(name.clone());
            }
        }
        for id in all.iter().map(|claim| claim.id) {
            if counts.claims.iter().any(|(known, _)| *known == id) {
                continue;
            }
            let cell = |name: &String| {
                let of_filter =
                    all.iter().zip(&filters).filter(|(claim, of)| claim.id == id && *of == name);
                let names = |verdict: Verdict| -> Vec<&str> {
                    let of_verdict =
                        of_filter.clone().filter(|(claim, _)| claim.verdict == verdict);
                    of_verdict.map(|(claim, _)| claim.place.dataset.as_str()).collect()
                };
                let (holds, fails) = (names(Verdict::Reproduced), names(Verdict::NotReproduced));
                match (of_filter.clone().next(), holds.len(), fails.len()) {
                    (None, ..) => String::new(),
                    (_, 0, 0) => "not testable".to_owned(),
                    (_, holds, 0) => format!("{holds} of {holds}"),
                    (_, 0, of) => format!("0 of {of}"),
                    (_, holds, not) => {
                        format!("{holds} of {} (not {})", holds + not, fails.join(", "))
                    }
                }
            };
            counts.claims.push((id, counts.filters.iter().map(cell).collect()));
        }
        counts
    }
}

/// "intel-lab – Intel Research Lab, Seattle: 910 scans, …"
fn heading(dataset: &DatasetClaims) -> String {
    format!("{} – {}", dataset.name, dataset.description)
}

/// The number of claims by verdict, per condition and split; and notes.
fn summary(dataset: &DatasetClaims, all: &[&Claim]) -> Vec<String> {
    let name = &dataset.name;
    let mut counts: Vec<(String, [usize; 3])> = Vec::new();
    for claim in &dataset.claims {
        let filter = filter(claim, all);
        let place = counts.iter().position(|(known, _)| *known == filter);
        let place = place.unwrap_or_else(|| {
            counts.push((filter, [0; 3]));
            counts.len() - 1
        });
        counts[place].1[claim.verdict as usize] += 1;
    }
    let line = |(filter, counts): (String, [usize; 3])| {
        let verdicts = Verdict::ALL.map(<&str>::from).into_iter().zip(counts);
        let counts: Vec<String> = verdicts.map(|(name, count)| format!("{count} {name}")).collect();
        let comma = if filter.is_empty() { "" } else { ", " };
        format!("{name}{comma}{filter}: {}", counts.join(", "))
    };
    let notes = dataset.notes.iter().map(|note| format!("{name}: {note}"));
    counts.into_iter().map(line).chain(notes).collect()
}

/// One line on data sets without results.
fn missing(names: &[String]) -> String {
    format!("No results of {}, which the studies list as well.", names.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn claim(id: &'static str, split: Option<Split>, verdict: Verdict) -> Claim {
        let place = Conditions {
            dataset: "office".into(),
            experiment: Some("localization".into()),
            split,
            preset: Some("default".into()),
        };
        let measured = "gbs 0.87 | rnd 0.42; the mean is lower in 15 of 18 cells".to_owned();
        let evidence = Evidence {
            p: Some(3.1e-5),
            effect: Some(0.87),
            low: Some(0.8),
            high: Some(0.95),
            blocks: Some(10),
            effect_of: Some("error ratio".to_owned()),
        };
        Claim {
            place,
            id,
            section: "V-B",
            statement: "Improved maps gain most where maps are small, whatever the initialization",
            test: "paired t test over draws of ln(improved error / initial error)",
            measured,
            evidence,
            verdict,
        }
    }

    fn datasets() -> Vec<DatasetClaims> {
        vec![DatasetClaims {
            name: "office".into(),
            description: "Simulated office: 916 scans, 157,426 points with 0 < r ≤ 10 m, and so on"
                .into(),
            claims: vec![
                claim("a", Some(Split::Same), Verdict::Reproduced),
                claim("b", Some(Split::Same), Verdict::NotReproduced),
                claim("a", Some(Split::Alternate), Verdict::NotTestable),
            ],
            notes: vec!["No study says anything on the likelihood.".into()],
        }]
    }

    #[test]
    fn tables_keep_to_the_width_and_break_no_words() {
        let words: Vec<&str> =
            "initialization reproduced testable p = 3.1e-5 initial cells".split(' ').collect();
        for width in [60, 79, 80, 100, 140] {
            let text = text(&datasets(), &[], width);
            for line in text.lines() {
                assert!(line.chars().count() <= usize::from(width), "{width}: {line}");
                assert!(!line.trim_start().starts_with('%'), "{width}: {line}");
            }
            for word in &words {
                assert!(text.contains(word), "{width}: {word}\n{text}");
            }
        }
    }

    #[test]
    fn verdicts_are_counted_per_split() {
        let text = text(&datasets(), &[], 100);
        assert!(text.contains("office: 1 reproduced, 1 not reproduced, 0 not testable"), "{text}");
        assert!(text.contains("office, alternate: 0 reproduced, 0 not reproduced, 1 not testable"));
        assert!(text.contains("not testable    V-B, alternate: Improved"), "{text}");
    }

    /// The lines of a claim in several data sets and under several filters.
    #[test]
    fn claims_are_counted_over_data_sets_and_filters() {
        let of = |name: &str, verdicts: &[(&str, Verdict)]| {
            let mut dataset = datasets().remove(0);
            dataset.name = name.into();
            let claims = verdicts.iter().map(|&(preset, verdict)| {
                let mut claim = claim("recovers", Some(Split::Same), verdict);
                claim.place.dataset = name.into();
                claim.place.preset = Some(preset.into());
                claim
            });
            dataset.claims = claims.collect();
            let place = Conditions { preset: None, ..dataset.claims[0].place.clone() };
            dataset.claims.push(Claim { place, ..claim("spread", None, Verdict::NotReproduced) });
            dataset
        };
        use Verdict::{NotReproduced as No, NotTestable as Open, Reproduced as Yes};
        let datasets = [
            of("aces", &[("carmen", No), ("book", No)]),
            of("intel", &[("carmen", Yes), ("book", No)]),
            of("office", &[("carmen", Yes), ("book", Open)]),
        ];
        let shown = text(&datasets, &[], 100);
        let line = "  recovers                      carmen 2 of 3 (not aces); book 0 of 2\n";
        assert!(shown.contains(line), "{shown}");
        assert!(shown.contains("  spread                        0 of 3"), "{shown}");
        for line in ["V-B, carmen: Improved", "aces, carmen: 0 reproduced, 1 not reproduced"] {
            assert!(shown.contains(line), "{line}\n{shown}");
        }
        let shown = markdown(&datasets, &[]);
        let rows = "| claim | carmen | book | any filter |\n|---|---|---|---|\n\
                    | `recovers` | 2 of 3 (not aces) | 0 of 2 |  |\n| `spread` |  |  | 0 of 3 |\n";
        assert!(shown.contains(rows), "{shown}");
        // For one data set, the counts of verdicts are enough.
        assert!(!text(&datasets[..1], &[], 100).contains(Counts::HEADING));
    }

    #[test]
    fn markdown_has_a_row_per_claim() {
        let text = markdown(&datasets(), &[]);
        let rows: Vec<&str> = text.lines().filter(|line| line.contains("| `")).collect();
        assert_eq!(rows.len(), 3);
        assert!(rows[0].contains(r"gbs 0.87 \| rnd 0.42"), "{}", rows[0]);
        let end = "| 3.1e-5 | error ratio: 0.870 (0.800 to 0.950), 10 blocks | reproduced |";
        assert!(rows[0].ends_with(end), "{}", rows[0]);
    }

    #[test]
    fn several_experiments_of_a_kind_are_named() {
        let mut datasets = datasets();
        datasets[0].claims[1].id = "a";
        datasets[0].claims[1].place.experiment = Some("short".into());
        let text = text(&datasets, &[], 100);
        assert!(text.contains("V-B, short"), "{text}");
        assert!(text.contains("V-B, localization"), "{text}");
    }

    /// Fault: names of logs and studies reached terminals and claims.md unescaped.
    #[test]
    fn names_are_escaped_in_markdown() {
        let hostile = "<script>alert(1)</script> [x](http://y.z) www.y.z a@y.z `c` *b* _i_ | & $m$\n# \
                       t \u{1b}[31mred \u{202e}gpj.exe";
        let mut datasets = datasets();
        datasets[0].name = hostile.into();
        datasets[0].description = hostile.into();
        datasets[0].notes = vec![hostile.into()];
        for claim in &mut datasets[0].claims {
            claim.measured = hostile.into();
        }
        datasets[0].claims[2].id = "b";
        datasets[0].claims[2].place.experiment = Some(hostile.into());
        let missing = [hostile.to_owned()];
        for text in [60, 100]
            .map(|width| text(&datasets, &missing, width))
            .iter()
            .chain([&markdown(&datasets, &missing)])
        {
            let acts = |c: char| c != '\n' && (c.is_control() || c == '\u{202e}');
            assert!(!text.contains(acts), "{text}");
        }
        let markdown = markdown(&datasets, &missing);
        let shown = r"\<script\>alert(1)\</script\> \[x\](http\://y.z) www\.y.z a\@y.z \`c\` \*b\* \_i\_ \| \& \$m\$\\u{a}\# t \\u{1b}\[31mred \\u{202e}gpj.exe";
        // Heading, measured, place, counts of three filters, note, and what is missing.
        assert_eq!(markdown.matches(shown).count(), 2 + 3 + 1 + (3 + 1) + 2 + 1, "{markdown}");
        for line in markdown.lines().filter(|line| line.starts_with('|')) {
            let bars = line.replace(r"\|", "").matches('|').count();
            assert_eq!(bars, 9, "{line}");
        }
    }
}
