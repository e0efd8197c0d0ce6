//! The decisions in sentences: every number in them is one of `tests.csv`.

use std::collections::BTreeMap;

use mcl_core::text::{counted, number, p_value};
use mcl_study::recipe::localizer::LOCALIZER;
use mcl_study::study::settings::PRESET;
use mcl_study::table::{Row, Value};
use mcl_study::view::labels::name_and_unit;
use serde::Serialize;

use crate::claims::claim::ALPHA;
use crate::report::folder::Folder;
use crate::report::text::shown;

/// Columns of which more is better, and of which less is; of others, only the difference is reported.
const MORE: [&str; 7] = [
    "log_likelihood",
    "held_out_log_likelihood",
    "found",
    "found_within_30",
    "found_again",
    "found_again_within_50",
    "explained_beams",
];
const LESS: [&str; 11] = [
    "weighted",
    "translation",
    "heading",
    "translation_max",
    "diverged",
    "lost_share",
    "lost_episodes",
    "scans_until_found",
    "scans_until_found_again",
    "found_after_scans",
    "kilobytes",
];

/// The first column of a test that describes comparison and result; those before are settings.
const FIRST_OF_TEST: &str = "y";
/// The setting for the columns of a comparison's table.
const SIZE: &str = "size_percent";
/// Settings of a test that are positions in the table.
const PLACES: [&str; 2] = ["dataset", SIZE];

/// Which of the two a test shows to be better. Serialized as the name of its style on the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Winner {
    /// The first, or it is larger for measures without a better direction.
    First,
    /// The second.
    Second,
    /// Neither: not significant.
    Open,
}

/// One test.
#[derive(Debug, Clone, Serialize)]
pub struct Cell {
    /// "0.65 times (0.60 to 0.71)" or "+3.2 (3.1 to 3.3)".
    pub effect: String,
    /// Blocks and p value; or why there was no test.
    pub detail: String,
    /// Which of the two is better; `None` where nothing could be tested.
    pub winner: Option<Winner>,
    /// Size of the effect, to find the largest: |difference| or |ln ratio|.
    #[serde(skip)]
    strength: f64,
}

/// A comparison of two values of a setting by one measure, over data sets, sizes and other settings. Serialized are
/// the words and the table, which the page's script shows when it is opened.
#[derive(Debug, Serialize)]
pub struct Comparison {
    /// "gbs+f-km against gbs".
    #[serde(skip)]
    pub title: String,
    /// "log-likelihood \[nats per point\]".
    #[serde(skip)]
    pub measure: String,
    /// The result, in a sentence or two.
    #[serde(skip)]
    pub sentence: String,
    /// Names of the columns of the table: sizes, or one without name.
    pub sizes: Vec<String>,
    /// Rows of the table.
    pub rows: Vec<ComparisonRow>,
    /// "better" and "worse", or "higher" and "lower".
    pub words: [&'static str; 2],
    /// The setting whose values are compared.
    #[serde(skip)]
    column: String,
    /// Its two values.
    #[serde(skip)]
    sides: [String; 2],
    /// The sizes, to sort by.
    #[serde(skip)]
    values: Vec<Value>,
}

/// Which map builders, or localizers, are not shown by any test to be worse than another one, by size.
#[derive(Debug)]
pub struct Unbeaten {
    /// The measure.
    pub measure: String,
    /// Columns of the table.
    pub sizes: Vec<String>,
    /// A row per builder, by size.
    pub rows: Vec<(String, Vec<Share>)>,
}

/// In how many of how many rows of the comparisons; `None` where nothing was tested.
pub type Share = Option<[usize; 2]>;

/// A row of a comparison's table.
#[derive(Debug, Serialize)]
pub struct ComparisonRow {
    /// The data set and, where they vary, other settings.
    pub place: String,
    /// By size.
    pub cells: Vec<Option<Cell>>,
}

impl Cell {
    fn of(row: &Row<'_>) -> Self {
        let is_ratio = row.text("kind") == "ratio";
        let numbers =
            ["effect", "effect_low", "effect_high", "p_holm"].map(|name| row.number(name));
        let [Some(effect), Some(low), Some(high), Some(p)] = numbers else {
            let note = row.text("note").to_owned();
            return Cell { effect: "–".to_owned(), detail: note, winner: None, strength: 0.0 };
        };
        let is_more = if is_ratio { effect > 1.0 } else { effect > 0.0 };
        let is_less_better = LESS.contains(&row.text("y"));
        let winner = match (p < ALPHA, is_more != is_less_better) {
            (false, _) => Winner::Open,
            (true, true) => Winner::First,
            (true, false) => Winner::Second,
        };
        let blocks = row.number("blocks").unwrap_or(0.0) as usize;
        let interval = format!("{} to {}", number(low), number(high));
        let shown_effect = match is_ratio {
            true => format!("{}× ({interval})", number(effect)),
            false if effect > 0.0 => format!("+{} ({interval})", number(effect)),
            false => format!("{} ({interval})", number(effect)),
        };
        let note = Some(row.text("note")).filter(|note| !note.is_empty());
        let note = note.map_or(String::new(), |note| format!("; {note}"));
        Cell {
            effect: shown_effect,
            detail: format!("{}, {} after Holm{note}", counted(blocks, "block"), p_value(p)),
            winner: Some(winner),
            strength: if is_ratio { mcl_core::math::ln(effect).abs() } else { effect.abs() },
        }
    }
}

/// What a test compares, and by which measure.
type Key<'a> = (&'a str, &'a str, String, String);

/// The comparisons of a study over its data sets, in the order of their tables.
pub fn comparisons(folders: &[Folder]) -> Vec<Comparison> {
    let mut keys: Vec<Key<'_>> = Vec::new();
    let mut tests: BTreeMap<usize, Vec<(&Folder, Row<'_>)>> = BTreeMap::new();
    for folder in folders {
        for row in folder.tests.rows() {
            let [a, b] = ["a", "b"].map(|side| row.get(side).to_string());
            // Tables of another version of the program have other columns.
            if row.text("y").is_empty() || a.is_empty() || b.is_empty() {
                continue;
            }
            let key = (row.text("y"), row.text("column"), a, b);
            let place = keys.iter().position(|known| *known == key).unwrap_or_else(|| {
                keys.push(key);
                keys.len() - 1
            });
            tests.entry(place).or_default().push((folder, row));
        }
    }
    keys.into_iter().zip(tests.into_values()).map(|(key, tests)| comparison(key, &tests)).collect()
}

fn comparison((y, column, a, b): Key<'_>, tests: &[(&Folder, Row<'_>)]) -> Comparison {
    let words = match (MORE.contains(&y) || LESS.contains(&y), y) {
        (true, _) => ["better", "worse"],
        (false, _) => ["higher", "lower"],
    };
    let varying = varying(tests);
    let mut sizes: Vec<Value> = Vec::new();
    for (_, row) in tests {
        if !sizes.contains(row.get(SIZE)) {
            sizes.push(row.get(SIZE).clone());
        }
    }
    sizes.sort_by(Value::order);
    let mut rows: Vec<ComparisonRow> = Vec::new();
    for (folder, row) in tests {
        let context = varying.iter().filter(|name| !row.get(name).is_empty());
        let context = context.map(|name| setting(name, row.get(name)));
        let place =
            [shown(folder.title())].into_iter().chain(context).collect::<Vec<_>>().join(", ");
        let at = rows.iter().position(|known| known.place == place).unwrap_or_else(|| {
            rows.push(ComparisonRow { place, cells: vec![None; sizes.len()] });
            rows.len() - 1
        });
        let size = sizes.iter().position(|size| size == row.get(SIZE));
        rows[at].cells[size.expect("sizes are those of all rows")] = Some(Cell::of(row));
    }
    let (name, unit) = name_and_unit(y);
    let [a, b] = [&a, &b].map(|value| match column {
        "map" | "localizer" => shown(value),
        _ => setting(column, &Value::from(value.as_str())),
    });
    let (values, sizes): (Vec<Value>, Vec<String>) =
        sizes.into_iter().map(|size| (size.clone(), percent(&size))).unzip();
    let measure = if matches!(unit, "" | "–") { name } else { format!("{name} [{unit}]") };
    let mut sentence = sentence(&sizes, &rows, words);
    if varying.contains(&PRESET) {
        sentence += &by_preset(tests, words);
    }
    let title = format!("{a} against {b}");
    let (measure, column) = (shown(&measure), column.to_owned());
    Comparison { title, measure, sentence, sizes, rows, words, column, sides: [a, b], values }
}

/// [`Unbeaten`] for each measure with several comparisons.
pub fn unbeaten(comparisons: &[Comparison]) -> Vec<Unbeaten> {
    let is_shown = |comparison: &&Comparison| {
        ["map", LOCALIZER].contains(&comparison.column.as_str()) && comparison.words[0] == "better"
    };
    let mut groups: Vec<Vec<&Comparison>> = Vec::new();
    for comparison in comparisons.iter().filter(is_shown) {
        let is_same = |of: &&mut Vec<&Comparison>| {
            (&of[0].measure, &of[0].column) == (&comparison.measure, &comparison.column)
        };
        match groups.iter_mut().find(is_same) {
            Some(of) => of.push(comparison),
            None => groups.push(vec![comparison]),
        }
    }
    groups.iter().filter(|of| of.len() > 1).map(|of| unbeaten_of(of)).collect()
}

fn unbeaten_of(comparisons: &[&Comparison]) -> Unbeaten {
    let mut sizes: Vec<&Value> = comparisons.iter().flat_map(|c| &c.values).collect();
    sizes.sort_by(|a, b| a.order(b));
    sizes.dedup();
    let mut names: Vec<&str> = Vec::new();
    // By builder, place and size: whether a test shows it to be worse.
    let mut beaten: BTreeMap<(usize, &str, usize), bool> = BTreeMap::new();
    for comparison in comparisons {
        for (row, (size, cell)) in comparison
            .rows
            .iter()
            .flat_map(|row| comparison.values.iter().zip(&row.cells).map(move |found| (row, found)))
        {
            let Some(winner) = cell.as_ref().and_then(|cell| cell.winner) else { continue };
            let size = sizes.iter().position(|known| *known == size);
            let size = size.expect("sizes are those of all comparisons");
            let losers = [Winner::Second, Winner::First];
            for (side, loses) in comparison.sides.iter().zip(losers) {
                let name = names.iter().position(|known| *known == side).unwrap_or_else(|| {
                    names.push(side);
                    names.len() - 1
                });
                *beaten.entry((name, &row.place, size)).or_default() |= winner == loses;
            }
        }
    }
    let row = |(at, name): (usize, &&str)| {
        let cell = |size: usize| {
            let of = || beaten.iter().filter(|((n, _, s), _)| (*n, *s) == (at, size));
            let count = of().count();
            (count > 0).then(|| [of().filter(|(_, beaten)| !**beaten).count(), count])
        };
        ((*name).to_owned(), (0..sizes.len()).map(cell).collect())
    };
    Unbeaten {
        measure: comparisons[0].measure.clone(),
        rows: names.iter().enumerate().map(row).collect(),
        sizes: sizes.into_iter().map(percent).collect(),
    }
}

impl Unbeaten {
    /// Name of the style of a cell.
    pub fn class(&self, cell: &Share) -> &'static str {
        match cell {
            None => "none",
            Some([unbeaten, of]) if unbeaten == of => "first",
            Some([0, _]) => "second",
            Some(_) => "open",
        }
    }
}

/// Settings that distinguish tests of the same comparison, except data set and size.
fn varying<'a>(tests: &[(&'a Folder, Row<'a>)]) -> Vec<&'a str> {
    let columns = tests.iter().flat_map(|(folder, _)| {
        folder.tests.columns().iter().take_while(|column| *column != FIRST_OF_TEST)
    });
    let mut names: Vec<&str> = Vec::new();
    for column in columns {
        if !PLACES.contains(&column.as_str()) && !names.contains(&column.as_str()) {
            names.push(column);
        }
    }
    names.retain(|name| tests.windows(2).any(|pair| pair[0].1.get(name) != pair[1].1.get(name)));
    names
}

/// "z_rand = 0.9", "carmen".
fn setting(name: &str, value: &Value) -> String {
    match name {
        "preset" | "split" | "map" | "localizer" => shown(&value.to_string()),
        _ => shown(&format!("{} = {value}", name_and_unit(name).0)),
    }
}

fn percent(size: &Value) -> String {
    if size.is_empty() { String::new() } else { shown(&format!("{size} %")) }
}

/// "Better in 24 of 27 tests, worse in none, not decided in 3. Better on all data sets at 0.1 %, 0.25 %. Largest
/// effect at 0.1 % (Intel Research Lab): +3.2 (3.1 to 3.3)."
fn sentence(sizes: &[String], rows: &[ComparisonRow], [better, worse]: [&str; 2]) -> String {
    let cells = || rows.iter().flat_map(|row| row.cells.iter().enumerate().map(move |c| (row, c)));
    let count = |winner| {
        cells().filter(|(_, (_, c))| c.as_ref().and_then(|c| c.winner) == Some(winner)).count()
    };
    let [first, second, open] = [Winner::First, Winner::Second, Winner::Open].map(count);
    let tested = first + second + open;
    if tested == 0 {
        let untested = cells().find_map(|(_, (_, cell))| cell.as_ref());
        let why = untested.map_or(String::new(), |cell| format!(": {}", cell.detail));
        return format!("Nothing could be tested{why}.");
    }
    let of = counted(tested, "test");
    let mut text = match (first, second) {
        (0, 0) => format!("No difference could be shown in {of}"),
        (first, 0) if first == tested => format!("{} in all of {of}", capital(better)),
        (0, second) if second == tested => format!("{} in all of {of}", capital(worse)),
        (first, second) => {
            let parts = [(first, better), (second, worse), (open, "not decided")];
            let parts = parts.into_iter().filter(|(count, _)| *count > 0);
            let parts: Vec<String> =
                parts.map(|(count, word)| format!("{word} in {count}")).collect();
            format!("{} of {of}", capital(&parts.join(", ")))
        }
    };
    for (winner, word, total) in [(Winner::First, better, first), (Winner::Second, worse, second)] {
        let is_all = |place: &usize| {
            let mut of_size = rows.iter().filter_map(|row| row.cells[*place].as_ref()).peekable();
            of_size.peek().is_some() && of_size.all(|cell| cell.winner == Some(winner))
        };
        let agreed: Vec<usize> = (0..sizes.len()).filter(is_all).collect();
        if total < tested && rows.len() > 1 && !agreed.is_empty() && !sizes[0].is_empty() {
            text += &format!("; {word} in every row at {}", ranges(&agreed, sizes));
        }
    }
    let decided = cells().filter_map(|(row, (place, cell))| {
        let cell = cell
            .as_ref()
            .filter(|cell| matches!(cell.winner, Some(Winner::First | Winner::Second)))?;
        Some((row, place, cell))
    });
    let strongest = decided.max_by(|a, b| a.2.strength.total_cmp(&b.2.strength));
    if let Some((row, place, cell)) = strongest {
        let size =
            if sizes[place].is_empty() { String::new() } else { format!(" at {}", sizes[place]) };
        text += &format!(". Largest effect{size} on {}: {}", row.place, cell.effect);
    }
    text + "."
}

/// " By preset: carmen better in 20, worse in 1 of 75; book …": results of several filters must not be pooled
/// unseen.
fn by_preset(tests: &[(&Folder, Row<'_>)], [better, worse]: [&str; 2]) -> String {
    let mut presets: Vec<(&str, [usize; 3])> = Vec::new();
    for (_, row) in tests {
        let Some(winner) = Cell::of(row).winner else { continue };
        let name = row.text(PRESET);
        let place = presets.iter().position(|(known, _)| *known == name).unwrap_or_else(|| {
            presets.push((name, [0; 3]));
            presets.len() - 1
        });
        presets[place].1[winner as usize] += 1;
    }
    let parts = presets.iter().map(|(name, counts)| {
        let of: usize = counts.iter().sum();
        format!("{} {better} in {}, {worse} in {} of {of}", shown(name), counts[0], counts[1])
    });
    format!(" By preset: {}.", parts.collect::<Vec<_>>().join("; "))
}

/// "0.1 % to 5 %, 20 %", for indices of sizes.
fn ranges(places: &[usize], sizes: &[String]) -> String {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for &place in places {
        match runs.last_mut() {
            Some([_, last]) if *last + 1 == place => *last = place,
            _ => runs.push([place, place]),
        }
    }
    let run = |&[from, to]: &[usize; 2]| match to - from {
        0 => sizes[from].clone(),
        _ => format!("{} to {}", sizes[from], sizes[to]),
    };
    runs.iter().map(run).collect::<Vec<_>>().join(", ")
}

fn capital(text: &str) -> String {
    let (first, rest) = text.split_at(1);
    first.to_ascii_uppercase() + rest
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use mcl_study::table::Table;

    use super::*;

    fn folder(dataset: &str, rows: &[(&str, f64, f64, f64)]) -> Folder {
        let mut folder =
            Folder::of_files(Path::new(&format!("absent/likelihood/{dataset}"))).unwrap();
        folder.tests = Table::of_cells(rows.iter().map(|&(kind, size, effect, p)| {
            vec![
                ("dataset".to_owned(), dataset.into()),
                ("split".to_owned(), "same".into()),
                ("size_percent".to_owned(), size.into()),
                (
                    "y".to_owned(),
                    (if kind == "ratio" { "weighted" } else { "log_likelihood" }).into(),
                ),
                ("column".to_owned(), "map".into()),
                ("a".to_owned(), "gbs+f-km".into()),
                ("b".to_owned(), "gbs".into()),
                ("kind".to_owned(), kind.into()),
                ("effect".to_owned(), effect.into()),
                ("effect_low".to_owned(), (effect - 0.1).into()),
                ("effect_high".to_owned(), (effect + 0.1).into()),
                ("blocks".to_owned(), 10u32.into()),
                ("p_holm".to_owned(), p.into()),
            ]
        }));
        folder
    }

    #[test]
    fn sentences_come_from_the_numbers() {
        let folders = [
            folder(
                "aces",
                &[
                    ("difference", 0.1, 3.2, 1e-6),
                    ("difference", 1.0, 0.5, 1e-4),
                    ("difference", 10.0, 0.05, 0.2),
                ],
            ),
            folder("intel", &[("difference", 0.1, 2.0, 1e-6), ("difference", 1.0, -0.3, 1e-4)]),
        ];
        let [found] = &comparisons(&folders)[..] else { panic!() };
        assert_eq!(found.title, "gbs+f-km against gbs");
        assert_eq!(found.measure, "log-likelihood [nats per point]");
        assert_eq!(found.sizes, ["0.1 %", "1 %", "10 %"]);
        assert_eq!(
            found.sentence,
            "Better in 3, worse in 1, not decided in 1 of 5 tests; better in every row at 0.1 %. \
             Largest effect at 0.1 % on aces: +3.20 (3.10 to 3.30)."
        );
        let winners = |row: &ComparisonRow| -> Vec<Option<Winner>> {
            row.cells.iter().map(|cell| cell.as_ref().and_then(|cell| cell.winner)).collect()
        };
        use Winner::{First, Open, Second};
        assert_eq!(winners(&found.rows[0]), [Some(First), Some(First), Some(Open)]);
        assert_eq!(winners(&found.rows[1]), [Some(First), Some(Second), None]);
        // A single pair says no more than its own table.
        assert!(unbeaten(std::slice::from_ref(found)).is_empty());
    }

    #[test]
    fn builders_are_unbeaten_where_no_test_shows_them_worse() {
        let mut folder =
            folder("aces", &[("difference", 0.1, 3.2, 1e-6), ("difference", 1.0, 0.1, 0.4)]);
        let mut rows: Vec<_> = folder.tests.rows().map(cells).collect();
        for (row, p) in [(0, 1e-6), (1, 1e-6)] {
            let mut other = rows[row].clone();
            for (name, value) in &mut other {
                match name.as_str() {
                    "a" => *value = "rnd+f-km".into(),
                    "b" => *value = "gbs+f-km".into(),
                    "effect" => *value = (-1.0).into(),
                    "p_holm" => *value = p.into(),
                    _ => {}
                }
            }
            rows.push(other);
        }
        folder.tests = Table::of_cells(rows);
        let found = unbeaten(&comparisons(&[folder]));
        let rows: Vec<(&str, &[Share])> =
            found[0].rows.iter().map(|(name, cells)| (name.as_str(), &cells[..])).collect();
        let expected: [(&str, &[Share]); 3] = [
            ("gbs+f-km", &[Some([1, 1]), Some([1, 1])]),
            ("gbs", &[Some([0, 1]), Some([1, 1])]),
            ("rnd+f-km", &[Some([0, 1]), Some([0, 1])]),
        ];
        assert_eq!(rows, expected);
    }

    fn cells(row: Row<'_>) -> mcl_study::table::Cells {
        let names = "dataset split size_percent y column a b kind effect effect_low effect_high blocks p_holm";
        names.split(' ').map(|name| (name.to_owned(), row.get(name).clone())).collect()
    }

    #[test]
    fn less_error_is_better() {
        let folders = [folder("aces", &[("ratio", 0.1, 0.5, 1e-6), ("ratio", 1.0, 0.9, 1e-4)])];
        let [found] = &comparisons(&folders)[..] else { panic!() };
        assert_eq!(
            found.sentence,
            "Better in all of 2 tests. Largest effect at 0.1 % on aces: 0.500× (0.400 to 0.600)."
        );
        let chance = [folder("aces", &[("ratio", 0.1, 0.5, 0.3)])];
        assert_eq!(comparisons(&chance)[0].sentence, "No difference could be shown in 1 test.");
    }
}
