//! Claims as tables: for the terminal and as Markdown.

use comfy_table::presets::{NOTHING, UTF8_HORIZONTAL_ONLY};
use comfy_table::{ColumnConstraint, ContentArrangement, Table, Width};

use super::{ALPHA, Claim, DatasetClaims, Verdict};
use crate::experiment::Split;
use mcl_core::text::p_value;

/// Four columns of sentences need this much; below, there are two.
const WIDE: u16 = 80;
/// Lines longer than this are hard to follow; below the least, words would be broken.
const WIDTHS: (u16, u16) = (40, 160);

/// "reproduced" fits, "not reproduced" has two lines.
const VERDICT: u16 = 10;
/// From one column's content to the next: a space of padding each, and the place of a line.
const BETWEEN: u16 = 3;

/// In place of spaces at which no line may end, until lines are made.
const GLUE: &str = "\u{a0}";

/// A table per data set, `width` columns wide, and a line that sums it up.
pub fn text(datasets: &[DatasetClaims], width: u16) -> String {
    let width = width.clamp(WIDTHS.0, WIDTHS.1);
    let mut text = String::new();
    for dataset in datasets {
        let table = if width >= WIDE { wide(dataset, width) } else { narrow(dataset, width) };
        let heading = wrapped(&[heading(dataset)], width);
        let summary = wrapped(&summary(dataset), width);
        text += &format!("{heading}\n{}\n{summary}\n\n", table.trim_fmt());
    }
    text.replace(GLUE, " ")
}

/// The same as a Markdown document, with the claims' names.
pub fn markdown(datasets: &[DatasetClaims]) -> String {
    let mut text = format!(
        "# The paper's claims beside what was measured\n\nα = {ALPHA}; how each claim is decided stands \
         in docs/claims.md of the program.\n"
    );
    for dataset in datasets {
        text += &format!("\n## {}\n\n", heading(dataset));
        text += "| section | claim | statement | measured | test | p | verdict |\n";
        text += "|---|---|---|---|---|---|---|\n";
        for claim in &dataset.claims {
            let columns = [
                place(claim, dataset),
                format!("`{}`", claim.statement.id),
                claim.statement.text.to_owned(),
                claim.measured.clone(),
                claim.statement.test.to_owned(),
                claim.p.map_or(String::new(), |p| p_value(p).replace("p = ", "").replace("p ", "")),
                claim.verdict.name().to_owned(),
            ];
            // A bar would end the column.
            text += &format!("| {} |\n", columns.map(|text| text.replace('|', "\\|")).join(" | "));
        }
        text.push('\n');
        for line in summary(dataset) {
            text += &format!("{line}  \n");
        }
    }
    text
}

fn wide(dataset: &DatasetClaims, width: u16) -> Table {
    let mut table = empty(width);
    table.set_header(["statement", "measured", "test", "verdict"]);
    for claim in &dataset.claims {
        table.add_row([
            glued(&format!("{}: {}", place(claim, dataset), claim.statement.text)),
            glued(&claim.measured),
            glued(&test(claim)),
            claim.verdict.name().to_owned(),
        ]);
    }
    let verdict = VERDICT;
    let rest = width - verdict - 3 * BETWEEN - 2;
    let (statement, tested) = (rest * 30 / 100, rest * 32 / 100);
    set_widths(&mut table, &[statement, rest - statement - tested, tested, verdict]);
    table
}

/// Verdicts beside all else.
fn narrow(dataset: &DatasetClaims, width: u16) -> Table {
    let mut table = empty(width);
    table.set_header(["verdict", "statement, measured, test"]);
    for claim in &dataset.claims {
        let statement = format!("{}: {}", place(claim, dataset), claim.statement.text);
        table.add_row([
            claim.verdict.name().to_owned(),
            glued(&format!("{statement}\nMeasured: {}\nTest: {}", claim.measured, test(claim))),
        ]);
    }
    set_widths(&mut table, &[VERDICT, width - VERDICT - BETWEEN - 2]);
    table
}

fn empty(width: u16) -> Table {
    let mut table = Table::new();
    table
        .load_style(UTF8_HORIZONTAL_ONLY)
        .set_content_arrangement(ContentArrangement::Dynamic)
        .set_width(width);
    table
}

/// Widths of the columns' contents; one space on either side comes on top.
fn set_widths(table: &mut Table, widths: &[u16]) {
    for (column, &width) in table.column_iter_mut().zip(widths) {
        column.set_constraint(ColumnConstraint::Absolute(Width::Fixed(width + 2)));
    }
}

/// Text whose numbers keep their percent signs and equations stay whole.
fn glued(text: &str) -> String {
    let [percent, equals] = [format!("{GLUE}%"), format!("{GLUE}={GLUE}")];
    text.replace(" %", &percent).replace(" = ", &equals)
}

/// Lines of text, broken between words.
fn wrapped(lines: &[String], width: u16) -> String {
    let mut table = empty(width);
    table.load_style(NOTHING).add_row([lines.join("\n")]);
    for column in table.column_iter_mut() {
        column.set_padding((0, 0));
    }
    table.trim_fmt()
}

fn test(claim: &Claim) -> String {
    match claim.p {
        Some(p) => format!("{}\n{}", claim.statement.test, p_value(p)),
        None => claim.statement.test.to_owned(),
    }
}

/// "V-B, held-out"; with the experiment's name where the data set has several of a kind.
fn place(claim: &Claim, dataset: &DatasetClaims) -> String {
    let mut place = claim.statement.section.number().to_owned();
    let experiment = &claim.place.experiment;
    let of_another = |other: &&Claim| {
        other.statement.id == claim.statement.id && other.place.experiment != *experiment
    };
    if let (Some(name), Some(_)) = (experiment, dataset.claims.iter().find(of_another)) {
        place += &format!(", {name}");
    }
    if claim.place.split == Some(Split::HeldOut) {
        place += ", held-out";
    }
    place
}

/// "intel-lab – Intel Research Lab, Seattle: 910 scans, …"
fn heading(dataset: &DatasetClaims) -> String {
    format!("{} – {}", dataset.name, dataset.description)
}

/// How many claims came out how: the paper's, and those of the split that the paper does not have.
fn summary(dataset: &DatasetClaims) -> Vec<String> {
    let counts = |of_held_out: bool| {
        let count = |verdict| {
            let of_split = dataset
                .claims
                .iter()
                .filter(|claim| (claim.place.split == Some(Split::HeldOut)) == of_held_out);
            of_split.filter(|claim| claim.verdict == verdict).count()
        };
        [Verdict::Reproduced, Verdict::NotReproduced, Verdict::NotTestable].map(count)
    };
    let told = |[reproduced, not_reproduced, not_testable]: [usize; 3]| {
        format!(
            "{reproduced} reproduced, {not_reproduced} not reproduced, {not_testable} not testable"
        )
    };
    let name = &dataset.name;
    let mut lines = vec![format!("{name}: {}", told(counts(false)))];
    if counts(true).iter().sum::<usize>() > 0 {
        lines.push(format!("{name}, held-out scans: {}", told(counts(true))));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::super::{Place, Section, Statement};
    use super::*;

    fn claim(id: &'static str, split: Option<Split>, verdict: Verdict) -> Claim {
        let place =
            Place { dataset: "office".into(), experiment: Some("localization".into()), split };
        let statement = Statement {
            id,
            section: Section::Localization,
            text: "Improved maps gain most where maps are small, whatever the initialization",
            test: "paired t test over maps of ln(improved error / initial error)",
        };
        let measured = "gbs 0.87 | rnd 0.42; the mean is lower in 15 of 18 cells".to_owned();
        Claim { place, statement, measured, p: Some(3.1e-5), verdict }
    }

    fn datasets() -> Vec<DatasetClaims> {
        vec![DatasetClaims {
            name: "office".into(),
            description: "Simulated office: 916 scans, 157,537 points with 0 < r ≤ 10 m, and so on"
                .into(),
            claims: vec![
                claim("a", Some(Split::Same), Verdict::Reproduced),
                claim("b", Some(Split::Same), Verdict::NotReproduced),
                claim("a", Some(Split::HeldOut), Verdict::NotTestable),
            ],
        }]
    }

    #[test]
    fn tables_keep_to_the_width_and_break_no_words() {
        let words: Vec<&str> =
            "initialization reproduced testable p = 3.1e-5 initial cells".split(' ').collect();
        for width in [60, 79, 80, 100, 140] {
            let text = text(&datasets(), width);
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
        let text = text(&datasets(), 100);
        assert!(
            text.contains("office: 1 reproduced, 1 not reproduced, 0 not testable\n"),
            "{text}"
        );
        assert!(
            text.contains("office, held-out scans: 0 reproduced, 0 not reproduced, 1 not testable")
        );
        assert!(text.contains("V-B, held-out: Improved"), "{text}");
    }

    #[test]
    fn markdown_has_a_row_per_claim() {
        let text = markdown(&datasets());
        let rows: Vec<&str> = text.lines().filter(|line| line.contains("| `")).collect();
        assert_eq!(rows.len(), 3);
        assert!(rows[0].contains(r"gbs 0.87 \| rnd 0.42"), "{}", rows[0]);
        assert!(rows[0].ends_with("| 3.1e-5 | reproduced |"), "{}", rows[0]);
    }

    #[test]
    fn several_experiments_of_a_kind_are_named() {
        let mut datasets = datasets();
        datasets[0].claims[1].statement.id = "a";
        datasets[0].claims[1].place.experiment = Some("short".into());
        let text = text(&datasets, 100);
        assert!(text.contains("V-B, short"), "{text}");
        assert!(text.contains("V-B, localization"), "{text}");
    }
}
