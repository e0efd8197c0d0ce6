//! Checks that views refer only to what exists.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Error, Result, anyhow};
use mcl_datasets::registry::is_plain_name;
use toml::de::{DeTable, DeValue};

use crate::measure::Measures;
use crate::study::plan::{ENTRIES, Plan};
use crate::study::settings::{PRESET, SIZE, Setting, settings, text_of};
use crate::study::views::{Chart, ChartKind, INITIALIZATIONS, Region, Views, made_of};
use crate::table::{Row, Table, Value};

/// Largest number of panels side by side that can be read.
const MOST_COLUMNS: usize = 4;

/// What views can refer to: everything in the plans of all data sets.
pub struct KnownNames<'a> {
    text: &'a str,
    plans: &'a [Plan],
    measured: Vec<String>,
    settings: Vec<Setting>,
    entries: BTreeSet<String>,
}

impl<'a> KnownNames<'a> {
    /// Collects it from the plans of all data sets; `text` is the study's file.
    ///
    /// # Errors
    /// When a recipe cannot be written as JSON.
    pub fn of(text: &'a str, plans: &'a [Plan], measures: &Measures) -> Result<Self> {
        let (mut measured, mut known) = (Vec::new(), Vec::<Setting>::new());
        let of_measures = measures.columns();
        for plan in plans {
            let columns = plan.columns(measures)?;
            for setting in settings(&columns, &of_measures, &[ENTRIES]) {
                if !known.iter().any(|other| other.name == setting.name) {
                    known.push(setting);
                }
            }
            for column in columns {
                if of_measures.contains(&column.as_str()) && !measured.contains(&column) {
                    measured.push(column);
                }
            }
        }
        let entries = plans.iter().flat_map(Plan::entry_names).map(str::to_owned).collect();
        Ok(KnownNames { text, plans, measured, settings: known, entries })
    }

    /// Values of a setting in all trials, as text.
    fn values(&self, setting: &str) -> Result<BTreeSet<String>> {
        let mut values = BTreeSet::new();
        let Some(setting) = self.settings.iter().find(|known| known.name == setting) else {
            return Ok(values);
        };
        for trial in self.plans.iter().flat_map(|plan| &plan.trials) {
            let mut rows = vec![trial.map.cells()];
            if !setting.of_map {
                rows = trial.runs.iter().map(|run| run.cells()).collect::<Result<_>>()?;
            }
            let table = Table::of_cells(rows);
            values.extend(table.rows().map(|row| text_of(&setting.values(&row))));
        }
        Ok(values)
    }

    /// The error at a path: keys and indices, outermost first, joined by dots, such as
    /// `views.charts.0.y.column`.
    fn mistake(&self, path: &str, message: &str) -> Error {
        anyhow!("line {}: {path}: {message}", line_of(self.text, path))
    }

    fn one_of<'n>(
        &self,
        path: &str,
        what: &str,
        name: &str,
        known: impl Iterator<Item = &'n str>,
    ) -> Result<()> {
        let known: Vec<&str> = known.collect();
        if known.contains(&name) {
            return Ok(());
        }
        let expected = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        let message = format!("there is no {what} {name:?}, expected one of: {expected}");
        Err(self.mistake(path, &message))
    }

    fn setting(&self, path: &str, name: &str) -> Result<()> {
        self.one_of(path, "setting", name, self.settings.iter().map(|setting| &*setting.name))
    }

    fn measured(&self, path: &str, name: &str, also: &[&str]) -> Result<()> {
        let known = self.measured.iter().map(String::as_str).chain(also.iter().copied());
        self.one_of(path, "measured column", name, known)
    }

    fn either(&self, path: &str, name: &str, also: &[&str]) -> Result<()> {
        let settings = self.settings.iter().map(|setting| &*setting.name);
        self.measured(path, name, &also.iter().copied().chain(settings).collect::<Vec<_>>())
    }

    fn entries(&self, path: &str, names: &[String]) -> Result<()> {
        let known = || self.entries.iter().map(String::as_str);
        let what = "entry of [[trials]] with the name";
        names.iter().try_for_each(|name| self.one_of(path, what, name, known()))
    }
}

/// Checks that columns, values and entries of `[[trials]]` named in views exist, and that file names are
/// valid.
///
/// # Errors
/// The first mistake, with its line; or when a recipe cannot be written as JSON.
pub fn check(views: &Views, known: &KnownNames<'_>) -> Result<()> {
    for (key, columns) in [("columns", &views.summary.columns), ("kept", &views.summary.kept)] {
        let path = format!("views.summary.{key}");
        columns.iter().try_for_each(|name| known.measured(&path, name, &[]))?;
    }
    for (place, factor) in views.factors.iter().enumerate() {
        let path = |key: &str| format!("views.factors.{place}.{key}");
        known.measured(&path("x"), &factor.x, &[])?;
        known.measured(&path("y"), &factor.y, &[])?;
        let maps = known.values("map")?;
        known.one_of(&path("than"), "map", &factor.than, maps.iter().map(String::as_str))?;
        let name = &factor.name;
        let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
        if name.is_empty() || !name.chars().all(is_word) || known.either("", name, &[]).is_ok() {
            let message = format!("{name:?}, expected a new name of letters, digits and _");
            return Err(known.mistake(&path("name"), &message));
        }
    }
    let factors: Vec<&str> = views.factors.iter().map(|factor| factor.name.as_str()).collect();
    for (place, test) in views.tests.iter().enumerate() {
        let path = |key: &str| format!("views.tests.{place}.{key}");
        known.entries(&path("of"), &test.of)?;
        known.measured(&path("y"), &test.y, &[])?;
        known.setting(&path("column"), &test.column)?;
        if !test.pairs.is_empty() {
            let (values, what) =
                (known.values(&test.column)?, format!("value of {} that is", test.column));
            for value in test.pairs.iter().flatten() {
                let values = values.iter().map(String::as_str);
                known.one_of(&path("pairs"), &what, value, values)?;
            }
        }
    }
    let mut files = BTreeSet::new();
    let mut file = |path: &str, name: &str, shown: &str| {
        if !is_plain_name(shown) {
            return Err(known.mistake(path, &format!("{name:?} is not a file name")));
        }
        match files.insert(name.to_owned()) {
            true => Ok(()),
            false => Err(known.mistake(path, &format!("{name:?} is used twice"))),
        }
    };
    for (place, chart) in views.charts.iter().enumerate() {
        let path = |key: &str| format!("views.charts.{place}.{key}");
        let (columns, shown) = placeholders(&chart.name);
        columns.iter().try_for_each(|name| known.setting(&path("name"), name))?;
        file(&path("name"), &chart.name, &shown)?;
        check_chart(chart, &path, &factors, known)?;
    }
    let mut tables: Vec<Table> = Vec::new();
    for (place, region) in views.regions.iter().enumerate() {
        let path = |key: &str| format!("views.regions.{place}.{key}");
        file(&path("name"), &region.name, &region.name)?;
        known.entries(&path("of"), std::slice::from_ref(&region.of))?;
        for (key, name) in [("x", &region.x), ("y", &region.y)] {
            known.setting(&path(key), name)?;
            if name == "map" || name == "offset" || SIZE.contains(&name.as_str()) {
                let message = format!("{name:?}, expected a setting that maps of all kinds have");
                return Err(known.mistake(&path(key), &message));
            }
        }
        if region.x == region.y {
            return Err(known.mistake(&path("y"), "expected another setting than x"));
        }
        if tables.is_empty() {
            tables = known.plans.iter().map(Plan::recipes).collect::<Result<_>>()?;
        }
        for table in &tables {
            check_trials(region, table, known)
                .map_err(|message| known.mistake(&path("of"), &message))?;
        }
    }
    for (place, picture) in views.pictures.iter().enumerate() {
        file(&format!("views.pictures.{place}.name"), &picture.name, &picture.name)?;
    }
    if let Some(ranking) = &views.ranking {
        known.measured("views.ranking.y", &ranking.y, &[])?;
        known.entries("views.ranking.of", &ranking.of)?;
    }
    Ok(())
}

/// Whether the statements can be decided from the trials of a region: there are runs on all kinds of map, and
/// nothing else varies. The error is a message.
fn check_trials(region: &Region, table: &Table, known: &KnownNames<'_>) -> Result<(), String> {
    let Region { of, x, y, .. } = region;
    let is_own = |row: &Row<'_>| row.text(ENTRIES).split(' ').any(|name| name == of);
    let rows: Vec<Row<'_>> = table.rows().filter(is_own).collect();
    let mut kinds = INITIALIZATIONS.into_iter().flatten();
    let is_run_on = |row: &&Row<'_>, kind: &str| {
        let has_numbers = ["size_percent", "run"].iter().all(|of| row.number(of).is_some());
        row.text("map") == kind && has_numbers
    };
    let is_missing = |kind: &&str| !rows.iter().any(|row| is_run_on(&row, kind));
    if !rows.is_empty()
        && let Some(kind) = kinds.find(is_missing)
    {
        let kinds = INITIALIZATIONS.as_flattened().join(", ");
        return Err(format!(
            "the trials {of:?} have no runs on maps {kind} of sizes in percent, expected them on {kinds}"
        ));
    }
    let by_preset = [x, y].iter().any(|name| *name == PRESET);
    let may_vary = |name: &str| name == x || name == y || name == "map" || SIZE.contains(&name);
    for setting in known.settings.iter().filter(|setting| !may_vary(&setting.name)) {
        let mut found: BTreeMap<&str, String> = BTreeMap::new();
        for row in &rows {
            let values = setting.values(row);
            if values.iter().all(Value::is_empty) {
                continue;
            }
            let of = if by_preset && setting.is_of_filter() { row.text(PRESET) } else { "" };
            let (text, name) = (text_of(&values), &setting.name);
            let first = found.entry(of).or_insert_with(|| text.clone());
            if *first != text {
                return Err(format!(
                    "its trials vary {name}, too ({first} and {text}), expected only {x}, {y}, map and \
                     size; give each of its values an entry and a region"
                ));
            }
        }
    }
    Ok(())
}

fn check_chart(
    chart: &Chart,
    path: &impl Fn(&str) -> String,
    factors: &[&str],
    known: &KnownNames<'_>,
) -> Result<()> {
    known.entries(&path("of"), &chart.of)?;
    for (key, axis) in [("x.column", chart.x.as_ref()), ("y.column", Some(&chart.y))] {
        if axis.is_some_and(|axis| axis.column.is_empty()) {
            let message = "there is no column, expected at least one";
            return Err(known.mistake(&path(key), message));
        }
    }
    if let Some(x) = &chart.x {
        x.column.iter().try_for_each(|name| known.either(&path("x.column"), name, factors))?;
        if x.relative.is_some() {
            return Err(known.mistake(&path("x.relative"), "expected it of y only"));
        }
        match (chart.kind, &x.column[..]) {
            (ChartKind::Curves, _) => {}
            (ChartKind::Heat, [one]) => known.setting(&path("x.column"), one)?,
            (ChartKind::Heat, _) => {
                return Err(known.mistake(&path("x.column"), "expected one column of cells"));
            }
        }
    }
    chart.y.column.iter().try_for_each(|name| known.measured(&path("y.column"), name, factors))?;
    let curves = chart.curves.iter().flatten().map(|name| ("curves", name));
    for (key, name) in curves.chain(chart.panels.iter().map(|name| ("panels", name))) {
        known.setting(&path(key), name)?;
    }
    if chart.columns.is_some_and(|columns| !(1..=MOST_COLUMNS).contains(&columns)) {
        let message = format!("expected 1 to {MOST_COLUMNS} panels side by side");
        return Err(known.mistake(&path("columns"), &message));
    }
    chart.marks.iter().try_for_each(|name| known.either(&path("marks"), name, &[]))?;
    for (place, part) in chart.parts.iter().enumerate() {
        if let Some(column) = &part.column {
            let path = path(&format!("parts.{place}.column"));
            let made_of = made_of(column).unwrap_or_else(|| vec![column]);
            made_of.iter().try_for_each(|name| known.measured(&path, name, factors))?;
        }
        if part.sizes.is_some_and(|[low, high]| low.partial_cmp(&high) != Some(Ordering::Less)) {
            let path = path(&format!("parts.{place}.sizes"));
            return Err(known.mistake(&path, "expected two sizes (%), the smaller first"));
        }
    }
    Ok(())
}

/// The columns in braces in the name of a chart, and the name with a letter in their place.
pub fn placeholders(name: &str) -> (Vec<&str>, String) {
    let (mut columns, mut shown) = (Vec::new(), String::new());
    let mut rest = name;
    while let Some((before, after)) = rest.split_once('{') {
        let Some((column, after)) = after.split_once('}') else { break };
        columns.push(column);
        shown.push_str(before);
        shown.push('x');
        rest = after;
    }
    shown.push_str(rest);
    (columns, shown)
}

/// The line of a study's text at which a path ends, or the part of it that exists.
pub fn line_of(text: &str, path: &str) -> usize {
    let Ok(parsed) = DeTable::parse(text) else { return 1 };
    let mut offset = 0;
    let mut at = DeValue::Table(parsed.into_inner());
    for step in path.split('.') {
        let next = match at {
            DeValue::Table(table) => {
                let found = table.into_iter().find(|(key, _)| key.get_ref() == step);
                found.map(|(key, value)| (key.span().start, value))
            }
            DeValue::Array(array) => {
                let place: Option<usize> = step.parse().ok();
                let found = place.and_then(|place| array.into_iter().nth(place));
                found.map(|value| (value.span().start, value))
            }
            _ => None,
        };
        let Some((start, value)) = next else { break };
        // Tables that exist only implicitly, through their subtables, have no position.
        if start > 0 {
            offset = start;
        }
        at = value.into_inner();
    }
    line_at(text, offset)
}

/// The line of a byte of a text.
pub fn line_at(text: &str, offset: usize) -> usize {
    1 + text.bytes().take(offset).filter(|&byte| byte == b'\n').count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::definition::Study;

    #[test]
    fn lines_of_keys() {
        let text = "seed = 1\n[views.summary]\ncolumns = []\n[[views.charts]]\nname = \"a\"\n\
                    [[views.charts]]\nname = \"b\"\ny = { column = \"c\" }\nparts = [\n{ sizes = [1, 2] },\n{ x = 1 },\n]\n";
        for (path, line) in [
            ("seed", 1),
            ("views.summary.columns", 3),
            ("views.charts.0.name", 5),
            ("views.charts.1.name", 7),
            ("views.charts.1.y.column", 8),
            ("views.charts.1.x.column", 6),
            ("views.charts.1.parts.1.x", 11),
        ] {
            assert_eq!(line_of(text, path), line, "{path}");
        }
    }

    #[test]
    fn columns_in_braces() {
        assert_eq!(placeholders("a-{split}-{map}.x"), (vec!["split", "map"], "a-x-x.x".to_owned()));
        assert_eq!(placeholders("a{b"), (vec![], "a{b".to_owned()));
    }

    /// Otherwise a mistake would be reported only after the last trial, days later.
    #[test]
    fn regions_are_of_trials_that_decide_statements() {
        let right = r#"seed = 1
[base]
preset = "carmen"
[[trials]]
name = "region"
map = ["all", "gbs", "gbs+f-km", "rnd", "rnd+f-km"]
size = [0.25, 1]
beam_floor = [0.1, 0.4]
sigma_hit = [0.2, 0.3]
draws = 2
runs = 1
[[views.regions]]
name = "floor"
of = "region"
x = "beam_floor"
y = "sigma_hit"
"#;
        let by_preset = right
            .replace("sigma_hit = [0.2, 0.3]", "preset = [\"book\", \"carmen\"]")
            .replace("\"sigma_hit\"", "\"preset\"");
        let named = |text: &str| Study::parse(text).err().map(|error| format!("{error:#}"));
        assert_eq!([named(right), named(&by_preset)], [None, None]);
        for (old, new, line, message) in [
            ("\"region\"\nx", "\"regoin\"\nx", 14, "no entry of [[trials]]"),
            ("\"beam_floor\"", "\"beam_flor\"", 15, "no setting \"beam_flor\""),
            ("\"beam_floor\"", "\"map\"", 15, "a setting that maps of all kinds have"),
            ("\"beam_floor\"", "\"sigma_hit\"", 16, "another setting than x"),
            ("\"floor\"", "\"a/b\"", 13, "not a file name"),
            ("draws", "max_distance = [1, 2]\ndraws", 15, "vary max_distance, too (1 and 2)"),
            ("draws", "split = [\"same\", \"alternate\"]\ndraws", 15, "vary split, too"),
            (", \"rnd\"", "", 14, "no runs on maps rnd of sizes in percent"),
            ("runs = 1", "runs = 0", 15, "setting \"beam_floor\""),
        ] {
            let text = right.replacen(old, new, 1);
            assert_ne!(text, right, "{new}");
            let found = named(&text).unwrap_or_else(|| panic!("accepted: {new}"));
            let is_named = found.starts_with(&format!("line {line}: views.regions.0."));
            assert!(is_named && found.contains(message), "{new}: {found}");
        }
        // A preset sets σ_hit, but not the noise that varies with it.
        let noisy = "odometry_noise = [{ xy = 0, theta = 0 }, { xy = 0.1, theta = 0.1 }]\ndraws";
        let found = named(&by_preset.replacen("draws", noisy, 1));
        assert!(found.is_some_and(|found| found.contains("vary noise, too")));
    }
}
