//! Claims as text: for the terminal and as Markdown.

use mcl_core::text::{counted, number, p_value, printable};
use mcl_study::recipe::split::Split;

use crate::claims::claim::{ALPHA, Claim, DatasetClaims, Verdict};
use crate::progress::wrapped;

/// Lines longer than this are hard to follow; below the least, words would stand out.
const WIDTHS: (u16, u16) = (40, 120);

/// In place of spaces at which no line may end, until lines are made.
const GLUE: &str = "\u{a0}";

/// The claims of each data set, in lines of `width` columns, and a line that sums them up; then the names
/// of data sets without results. Names from data are shown as escapes where they act.
pub fn text(datasets: &[DatasetClaims], without_results: &[String], width: u16) -> String {
    let mut lines = Vec::new();
    for dataset in datasets {
        lines.extend([heading(dataset), String::new()]);
        for claim in &dataset.claims {
            let p = claim.evidence.p.map(|p| format!("; {}", p_value(p))).unwrap_or_default();
            let texts = [
                format!("{}: {}", place(claim, dataset), claim.statement),
                format!("Measured: {}", claim.measured),
                format!("Test: {}{p}", claim.test),
            ];
            let effect = effect(claim).map(|effect| format!("Effect: {effect}"));
            let verdicts = [claim.verdict.into(), "", "", ""];
            let lines_of = verdicts.into_iter().zip(texts.into_iter().chain(effect));
            lines.extend(lines_of.map(|(verdict, text)| format!("  {verdict:<14}  {text}")));
        }
        lines.push(String::new());
        lines.extend(summary(dataset));
        lines.push(String::new());
    }
    if !without_results.is_empty() {
        lines.push(missing(without_results));
    }
    // Numbers keep their percent signs, and equations stay whole.
    let [percent, equals] = [format!("{GLUE}%"), format!("{GLUE}={GLUE}")];
    let glued = |line: &String| printable(line).replace(" %", &percent).replace(" = ", &equals);
    let text = lines.iter().map(glued).collect::<Vec<String>>().join("\n");
    wrapped(&text, width.clamp(WIDTHS.0, WIDTHS.1).into()).replace(GLUE, " ")
}

/// The same as a Markdown document, with the claims' names. Names from data are text, whatever they
/// contain: neither markup nor links.
pub fn markdown(datasets: &[DatasetClaims], without_results: &[String]) -> String {
    let mut text = format!(
        "# The paper's claims beside what was measured\n\nα = {ALPHA}; how each claim is decided stands \
         in docs/claims.md of the program.\n"
    );
    for dataset in datasets {
        text += &format!("\n## {}\n\n", escaped(&heading(dataset)));
        text += "| section | claim | statement | measured | test | p | effect (95 %) | verdict |\n";
        text += "|---|---|---|---|---|---|---|---|\n";
        for claim in &dataset.claims {
            let p = claim.evidence.p.map_or(String::new(), p_value);
            let columns = [
                place(claim, dataset),
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
        for line in summary(dataset) {
            // Not at the start of a line, where a name could begin a list or a heading.
            text += &format!("Summary of {}  \n", escaped(&line));
        }
    }
    if !without_results.is_empty() {
        text += &format!("\n{}\n", escaped(&missing(without_results)));
    }
    text
}

/// Text that Markdown shows as it is: no markup, HTML, entities, columns, formulas or links, also not
/// those that GitHub makes of bare addresses.
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
    let [effect, low, high] = [evidence.effect?, evidence.low?, evidence.high?].map(number);
    let of = evidence.effect_of.as_deref()?;
    Some(format!("{of}: {effect} ({low} to {high}), {}", counted(evidence.blocks?, "block")))
}

/// "V-B, alternate"; with the study's name where the data set has several of a kind.
fn place(claim: &Claim, dataset: &DatasetClaims) -> String {
    let mut place = claim.section.to_owned();
    let experiment = &claim.place.experiment;
    let of_another = |other: &&Claim| other.id == claim.id && other.place.experiment != *experiment;
    if let (Some(name), Some(_)) = (experiment, dataset.claims.iter().find(of_another)) {
        place += &format!(", {name}");
    }
    if let Some(split) = other_split(claim) {
        place += &format!(", {split}");
    }
    place
}

/// The split of a claim, where it is none of the paper's.
fn other_split(claim: &Claim) -> Option<Split> {
    claim.place.split.filter(|&split| split != Split::Same)
}

/// "intel-lab – Intel Research Lab, Seattle: 910 scans, …"
fn heading(dataset: &DatasetClaims) -> String {
    format!("{} – {}", dataset.name, dataset.description)
}

/// How many claims came out how: the paper's, and those of splits that the paper does not have.
fn summary(dataset: &DatasetClaims) -> Vec<String> {
    let name = &dataset.name;
    let mut lines = Vec::new();
    for split in std::iter::once(None).chain(Split::ALL.map(Some)) {
        let of_split = || dataset.claims.iter().filter(move |claim| other_split(claim) == split);
        let counts = Verdict::ALL.map(|verdict| {
            let count = of_split().filter(|claim| claim.verdict == verdict).count();
            format!("{count} {}", <&str>::from(verdict))
        });
        if of_split().next().is_some() {
            let split = split.map_or(String::new(), |split| format!(", split {split}"));
            lines.push(format!("{name}{split}: {}", counts.join(", ")));
        }
    }
    lines.extend(dataset.notes.iter().map(|note| format!("{name}: {note}")));
    lines
}

/// One line on data sets without results.
fn missing(names: &[String]) -> String {
    format!("No results of {}, which the studies list as well.", names.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::claims::claim::{Evidence, Place};

    fn claim(id: &'static str, split: Option<Split>, verdict: Verdict) -> Claim {
        let place =
            Place { dataset: "office".into(), experiment: Some("localization".into()), split };
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
            description: "Simulated office: 916 scans, 157,537 points with 0 < r ≤ 10 m, and so on"
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
        assert!(
            text.contains(
                "office, split alternate: 0 reproduced, 0 not reproduced, 1 not testable"
            )
        );
        assert!(text.contains("not testable    V-B, alternate: Improved"), "{text}");
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

    /// Names of logs and studies once reached terminals and claims.md as they were.
    #[test]
    fn names_neither_act_nor_mark_up() {
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
        assert_eq!(markdown.matches(shown).count(), 2 + 3 + 1 + 2 + 1 + 1 + 1, "{markdown}");
        for line in markdown.lines().filter(|line| line.starts_with('|')) {
            let bars = line.replace(r"\|", "").matches('|').count();
            assert_eq!(bars, 9, "{line}");
        }
    }
}
