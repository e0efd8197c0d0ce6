//! Reads a study's file.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Error, Result, anyhow, bail};
use mcl_core::{files::open, math};
use mcl_datasets::registry::is_plain_name;
use mcl_maps::Refinement;
use serde::Deserialize;
use serde_json::Value as Json;
use sha2::{Digest, Sha256};
use toml::Spanned;

use crate::measure::Measures;
use crate::measure::program::PROGRAM;
use crate::recipe::localizer::{LOCALIZER, OWN, Program, ProgramTable};
use crate::recipe::map::MapRecipe;
use crate::recipe::run::RunRecipe;
use crate::recipe::split::Split;
use crate::study::check::{KnownNames, check, line_at, line_of};
use crate::study::factors::{Definitions, Draft, is_factor, is_list};
use crate::study::plan::Plan;
use crate::study::views::Views;
use crate::trial::run::Trial;

/// Size limit of a study's file (bytes): more than anybody writes by hand.
const MAX_BYTES: u64 = 1 << 20;
/// Limit on the rows of a data set, which are listed before the first trial is run.
const MAX_ROWS: usize = 1_000_000;
/// Length limit of a message, in characters.
const LONGEST_MESSAGE: usize = 1000;
/// Limit on the values of a range.
const MAX_STEPS: f64 = 1000.0;

/// What a study compares, on which data, and how it is shown. Created by [`Study::parse`] only, so that every
/// value has been checked.
#[derive(Clone)]
pub struct Study {
    /// The text of its file.
    pub text: String,
    /// Root of every seed.
    pub seed: u64,
    /// What is measured.
    pub measures: Measures,
    /// The tables and figures made from the rows.
    pub views: Views,
    /// The data sets to run on, as far as they are available.
    pub datasets: Vec<ListedDataset>,
    /// Folder of its file, where it was read from one; files read by programs are relative to it.
    pub folder: Option<PathBuf>,
    base: Factors,
    defined: Definitions,
    entries: Vec<Entry>,
}

/// A data set that a study lists.
#[derive(Clone)]
pub struct ListedDataset {
    /// Name in the registry.
    pub name: String,
    /// Only this many scans, from the first.
    pub scans: Option<usize>,
    /// Figures leave out points above this height (m), such as a ceiling that hides the rest.
    pub hide_above: Option<f64>,
    base: Factors,
    entries: Vec<Entry>,
}

/// Values of factors, with their position in the file.
type Factors = BTreeMap<String, (Vec<Json>, usize)>;

/// An entry of `[[trials]]`: all combinations of its values.
#[derive(Clone)]
struct Entry {
    name: Option<String>,
    /// Only on these data sets; on all when empty.
    datasets: Vec<String>,
    draws: u32,
    runs: u32,
    factors: Factors,
    line: usize,
}

/// The file as written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    seed: u64,
    measures: Option<Spanned<Vec<String>>>,
    #[serde(default)]
    base: Keys,
    #[serde(default)]
    refinement: BTreeMap<String, Refinement>,
    #[serde(default)]
    localizer: BTreeMap<Spanned<String>, ProgramTable>,
    /// SHA-256 of the files that programs read.
    #[serde(default)]
    digests: BTreeMap<String, String>,
    #[serde(default)]
    trials: Vec<Keys>,
    #[serde(default)]
    views: Views,
    #[serde(default, rename = "dataset")]
    datasets: Vec<Spanned<DatasetFile>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DatasetFile {
    name: String,
    scans: Option<usize>,
    hide_above: Option<f64>,
    #[serde(default)]
    base: Keys,
    #[serde(default)]
    trials: Vec<Keys>,
}

impl Study {
    /// Reads and checks a study.
    ///
    /// # Errors
    /// When the file cannot be read, is not TOML, has unknown keys, or values out of range; the message names
    /// file, line and key.
    pub fn read(path: &Path) -> Result<Self> {
        let read = || -> Result<String> {
            let mut text = Vec::new();
            open(path)?.take(MAX_BYTES + 1).read_to_end(&mut text)?;
            if text.len() as u64 > MAX_BYTES {
                bail!("it is larger than {MAX_BYTES} bytes");
            }
            Ok(String::from_utf8(text)?)
        };
        let text = read().with_context(|| format!("cannot read study {}", path.display()))?;
        let here = || format!("in study {}", path.display());
        let study = Self::parse(&text).with_context(here)?;
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        let folder = std::path::absolute(folder).with_context(here)?;
        let pinned = study.pinned(&folder).with_context(here)?;
        Ok(Study { folder: Some(folder), ..pinned })
    }

    /// Parses and checks the text of a study.
    ///
    /// # Errors
    /// As [`Study::read`], without the file's name.
    pub fn parse(text: &str) -> Result<Self> {
        Self::checked(text).map_err(short)
    }

    fn checked(text: &str) -> Result<Self> {
        let file: File = toml::from_str(text).map_err(|error| toml_error(text, &error))?;
        let source = SourceText(text);
        let names = file.measures.as_ref();
        let measures = Measures::of(names.map_or(&[], |names| names.get_ref()));
        let start = names.map_or(0, |names| names.span().start);
        let mut measures =
            measures.map_err(|message| source.mistake(start, "measures", &message))?;
        let program = |(name, table): (Spanned<String>, ProgramTable)| {
            let place = |key: &str| format!("{LOCALIZER}.{}.{key}", name.get_ref());
            let checked = table.checked(&name, &file.digests);
            checked
                .map(Arc::new)
                .map_err(|(span, key, message)| source.mistake(span.start, &place(key), &message))
        };
        let programs = file.localizer.into_iter().map(program).collect::<Result<Vec<_>>>()?;
        if !programs.is_empty() {
            measures.of_runs.push(&PROGRAM);
        }
        let refinements = file.refinement.into_iter().collect();
        let defined = Definitions { refinements, programs };
        let mut datasets: Vec<ListedDataset> = Vec::new();
        for dataset in file.datasets {
            let line = source.line(dataset.span().start);
            let DatasetFile { name, scans, hide_above, base, trials } = dataset.into_inner();
            if !is_plain_name(&name) {
                bail!(
                    "line {line}: dataset.name is {name:?}, expected the name of a data set, without a path"
                );
            }
            if datasets.iter().any(|listed| listed.name == name) {
                bail!("line {line}: data set {name:?} is listed twice");
            }
            if scans.is_some_and(|scans| scans < 2) {
                bail!("line {line}: data set {name:?}: scans is below 2");
            }
            let base = source.base(base)?;
            let entries = source.entries(trials, "dataset.trials")?;
            datasets.push(ListedDataset { name, scans, hide_above, base, entries });
        }
        let entries = source.entries(file.trials, "trials")?;
        if entries.is_empty() && datasets.iter().all(|dataset| dataset.entries.is_empty()) {
            bail!("there are no [[trials]], expected at least one");
        }
        let base = source.base(file.base)?;
        let seed = file.seed;
        let (text, views) = (text.to_owned(), file.views);
        let folder = None;
        let study = Study { text, seed, measures, views, datasets, folder, base, defined, entries };
        let mut named = study.entries.iter().flat_map(|e| e.datasets.iter().map(move |d| (e, d)));
        if let Some((entry, name)) = named.find(|(_, name)| study.listed(name).is_none()) {
            let line = entry.line;
            bail!("line {line}: trials.datasets: {name:?} is not listed as a [[dataset]]");
        }
        // A data set that is not listed gets the study's own trials.
        let names: Vec<&str> = study.dataset_names().chain(["unlisted"]).collect();
        let plans = names.iter().map(|name| study.plan(name)).collect::<Result<Vec<_>>>()?;
        study.check_views(&names, &plans)?;
        Ok(study)
    }

    /// The programs that localize.
    pub fn programs(&self) -> &[Arc<Program>] {
        &self.defined.programs
    }

    /// The same study with the digests of the files that its programs read, relative to `folder`, appended to
    /// its text, so that the text contains everything the rows depend on. Digests that are there already are
    /// checked against the files.
    fn pinned(self, folder: &Path) -> Result<Self> {
        let mut missing = BTreeMap::new();
        for (file, known) in self.programs().iter().flat_map(|program| &program.files) {
            let path = folder.join(file);
            let found =
                sha256_of(&path).with_context(|| format!("cannot read {}", path.display()))?;
            if known.is_empty() {
                missing.insert(file, found);
            } else if *known != found {
                bail!(
                    "{} is not the file that [digests] names: its SHA-256 is {found}, expected {known}",
                    path.display()
                );
            }
        }
        if missing.is_empty() {
            return Ok(self);
        }
        let mut document = self.text.clone();
        if !document.ends_with('\n') {
            document.push('\n');
        }
        let has_some = toml::from_str::<toml::Table>(&document)?.contains_key("digests");
        if has_some {
            let names: Vec<&str> = missing.keys().map(|file| file.as_str()).collect();
            bail!("[digests] names some files of the programs, but not {}", names.join(", "));
        }
        document
            .push_str(&format!("\n{}", toml::to_string(&BTreeMap::from([("digests", missing)]))?));
        Self::parse(&document)
    }

    /// The study's entry for a data set, if it has one.
    pub fn listed(&self, dataset: &str) -> Option<&ListedDataset> {
        self.datasets.iter().find(|listed| listed.name == dataset)
    }

    /// Names of the data sets that the study lists.
    pub fn dataset_names(&self) -> impl Iterator<Item = &str> {
        self.datasets.iter().map(|listed| listed.name.as_str())
    }

    /// The names (of maps, splits, …) in the study's factors, in the order of the file, but the longest list
    /// first: shorter ones may select from it in another order.
    pub fn names_of_factors(&self) -> Vec<&str> {
        let own = self.datasets.iter().flat_map(|dataset| &dataset.entries);
        let factors = self.entries.iter().chain(own).flat_map(|entry| entry.factors.values());
        let mut lists: Vec<&[Json]> = factors.map(|(values, _)| &values[..]).collect();
        lists.sort_by_key(|values| Reverse(values.len()));
        lists.into_iter().flatten().filter_map(Json::as_str).collect()
    }

    /// Every trial of the study on a data set.
    ///
    /// # Errors
    /// When a value is out of range; the message names line and key.
    pub fn plan(&self, dataset: &str) -> Result<Plan> {
        let own = self.listed(dataset).map_or(&[][..], |listed| &listed.entries);
        let entries = if own.is_empty() { &self.entries } else { own };
        let mut plan = Plan::default();
        let covers = |entry: &&Entry| {
            entry.datasets.is_empty() || entry.datasets.iter().any(|name| name == dataset)
        };
        for entry in entries.iter().filter(covers) {
            let combinations = entry.factors.values().map(|(values, _)| values.len());
            let rows = combinations
                .chain([entry.draws as usize, entry.runs.max(1) as usize])
                .fold(1, usize::saturating_mul);
            if rows > MAX_ROWS {
                let line = entry.line;
                bail!(
                    "line {line}: trials: {rows} rows, expected at most {MAX_ROWS}; use fewer sizes, \
                     draws, runs or settings"
                );
            }
            let draft = self.draft(dataset)?;
            let factors: Vec<_> = entry.factors.iter().collect();
            self.combine(draft, &factors, &mut |draft| {
                let finished = draft.finish();
                let (map, run) = finished
                    .map_err(|message| anyhow!("line {}: trials: {message}", entry.line))?;
                entry.add(map, &run, &mut plan)
            })?;
        }
        Ok(plan)
    }

    /// The recipe of a data set with the values of `[base]`.
    fn draft(&self, dataset: &str) -> Result<Draft> {
        let mut draft = Draft::new(dataset, self.seed).map_err(Error::msg)?;
        draft.set(LOCALIZER, &OWN.into(), &self.defined).map_err(Error::msg)?;
        let own = self.listed(dataset).map(|listed| &listed.base);
        for (key, (values, line)) in self.base.iter().chain(own.into_iter().flatten()) {
            for value in values {
                self.set(&mut draft, key, value, *line)?;
            }
        }
        Ok(draft)
    }

    fn set(&self, draft: &mut Draft, key: &str, value: &Json, line: usize) -> Result<()> {
        draft
            .set(key, value, &self.defined)
            .map_err(|message| anyhow!("line {line}: {key}: {message}"))
    }

    /// Every combination of values of the factors.
    fn combine(
        &self,
        draft: Draft,
        factors: &[(&String, &(Vec<Json>, usize))],
        add: &mut dyn FnMut(Draft) -> Result<()>,
    ) -> Result<()> {
        let Some(((key, (values, line)), others)) = factors.split_first() else {
            return add(draft);
        };
        for value in values {
            let mut draft = draft.clone();
            self.set(&mut draft, key, value, *line)?;
            self.combine(draft, others, add)?;
        }
        Ok(())
    }

    /// The trial of a map in a picture: draw 0, and a run where one is shown.
    ///
    /// # Errors
    /// When one of its factors does not exist, or a value is out of range.
    pub fn pictured(&self, dataset: &str, map: &toml::Table, run: Option<u32>) -> Result<Trial> {
        let mut draft = self.draft(dataset)?;
        for (key, value) in map {
            let value = serde_json::to_value(value)?;
            draft.set(key, &value, &self.defined).map_err(|m| anyhow!("{key}: {m}"))?;
        }
        let (mut map, recipe) = draft.finish().map_err(Error::msg)?;
        let runs = run.map(|run| RunRecipe { run, ..recipe });
        if runs.is_some() {
            map.split.get_or_insert(Split::Same);
        }
        Ok(Trial { map, runs: runs.into_iter().collect() })
    }

    fn check_views(&self, datasets: &[&str], plans: &[Plan]) -> Result<()> {
        check(&self.views, &KnownNames::of(&self.text, plans, &self.measures)?)?;
        for (place, picture) in self.views.pictures.iter().enumerate() {
            for (map, factors) in picture.maps.iter().enumerate() {
                let path = format!("views.pictures.{place}.maps.{map}");
                datasets
                    .iter()
                    .try_for_each(|dataset| self.pictured(dataset, factors, picture.run).map(drop))
                    .with_context(|| format!("line {}: {path}", line_of(&self.text, &path)))?;
            }
        }
        Ok(())
    }
}

impl Entry {
    /// Adds the trials of a combination: a map per draw, and the runs on each. Run `d + k·draws` uses the map
    /// of draw `d`.
    fn add(&self, mut map: MapRecipe, run: &RunRecipe, plan: &mut Plan) -> Result<()> {
        if self.runs > 0 {
            map.split.get_or_insert(Split::Same);
            if map.split == Some(Split::Blocks) {
                bail!(
                    "line {}: trials: split blocks holds out blocks of ten scans, between which a robot \
                     cannot be tracked; expected same or alternate, or no runs",
                    self.line
                );
            }
        }
        let differs = self.runs > 0 || map.draw_seed().is_some() || map.fold().is_some();
        let draws = if differs { self.draws } else { 1 };
        for draw in 0..draws {
            let map = MapRecipe { draw, ..map.clone() };
            let numbers = (0..self.runs).map(|k| draw + k * self.draws);
            let runs = numbers.map(|number| RunRecipe { run: number, ..run.clone() }).collect();
            plan.add(Trial { map, runs }, self.name.as_deref())?;
        }
        Ok(())
    }
}

/// SHA-256 of a file, in hexadecimal digits.
fn sha256_of(path: &Path) -> Result<String> {
    let mut digest = Sha256::new();
    let mut file = open(path)?;
    let mut bytes = vec![0; 1 << 16];
    loop {
        match file.read(&mut bytes)? {
            0 => break,
            count => digest.update(&bytes[..count]),
        }
    }
    Ok(digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The text of a file, to report positions in it.
struct SourceText<'a>(&'a str);

/// Keys as written in a file.
type Keys = BTreeMap<String, Spanned<toml::Value>>;

impl SourceText<'_> {
    fn line(&self, offset: usize) -> usize {
        line_at(self.0, offset)
    }

    fn mistake(&self, offset: usize, key: &str, message: &str) -> Error {
        anyhow!("line {}: {key}: {message}", self.line(offset))
    }

    /// Values of factors, one each.
    fn base(&self, table: Keys) -> Result<Factors> {
        let factors = self.factors(table, "base")?;
        for (key, (values, line)) in &factors {
            if values.len() > 1 {
                bail!(
                    "line {line}: base.{key} has {} values, expected one; [[trials]] lists several",
                    values.len()
                );
            }
        }
        Ok(factors)
    }

    fn factors(&self, table: Keys, place: &str) -> Result<Factors> {
        let mut factors = Factors::new();
        for (key, value) in table {
            let start = value.span().start;
            let values = match is_factor(&key) {
                true => listed(&key, value.into_inner()),
                // The error of setting it lists the valid keys.
                false => Draft::new("", 0)
                    .and_then(|mut draft| draft.set(&key, &Json::Null, &Definitions::default()))
                    .map(|()| Vec::new()),
            };
            let values = values
                .map_err(|message| self.mistake(start, &format!("{place}.{key}"), &message))?;
            factors.insert(key, (values, self.line(start)));
        }
        Ok(factors)
    }

    /// Applies `read` to a key that is not a factor, if it is present.
    fn own<T>(
        &self,
        table: &mut Keys,
        key: [&str; 2],
        expected: &str,
        read: impl Fn(&toml::Value) -> Option<T>,
    ) -> Result<Option<T>> {
        let Some(value) = table.remove(key[1]) else { return Ok(None) };
        let (found, line) = (value.get_ref(), self.line(value.span().start));
        let message = || format!("line {line}: {} is {found}, expected {expected}", key.join("."));
        read(found).map(Some).with_context(message)
    }

    fn entries(&self, tables: Vec<Keys>, place: &str) -> Result<Vec<Entry>> {
        let mut entries: Vec<Entry> = Vec::new();
        for mut table in tables {
            let starts = table.values().map(|value| value.span().start);
            let line = self.line(starts.min().unwrap_or(0));
            let mut count = |key: &str, least: usize| {
                let expected = format!("a whole number from {least} to {MAX_ROWS}");
                self.own(&mut table, [place, key], &expected, |value| {
                    let number = usize::try_from(value.as_integer()?).ok()?;
                    (least..=MAX_ROWS).contains(&number).then_some(number as u32)
                })
            };
            let (draws, runs) = (count("draws", 1)?.unwrap_or(1), count("runs", 0)?.unwrap_or(0));
            let expected = "letters, digits and hyphens in quotes";
            let name = self.own(&mut table, [place, "name"], expected, |value| {
                let is_word = |c: char| c.is_ascii_alphanumeric() || c == '-';
                let name = value.as_str().filter(|name| !name.is_empty())?;
                name.chars().all(is_word).then(|| name.to_owned())
            })?;
            if let Some(name) = &name
                && entries.iter().any(|entry| entry.name.as_ref() == Some(name))
            {
                bail!("line {line}: {place}: the name {name} is used twice");
            }
            let datasets =
                self.own(&mut table, [place, "datasets"], "a list of names", |value| {
                    value.clone().try_into().ok()
                })?;
            let factors = self.factors(table, place)?;
            let datasets = datasets.unwrap_or_default();
            entries.push(Entry { name, datasets, draws, runs, factors, line });
        }
        Ok(entries)
    }
}

/// The values of a factor: one, a list, or a range `{ from, to, factor }` in equal ratios.
fn listed(key: &str, value: toml::Value) -> Result<Vec<Json>, String> {
    let json = serde_json::to_value(&value).map_err(|error| error.to_string())?;
    let values = match json {
        Json::Array(values) if !is_list(key) || values.iter().all(Json::is_array) => values,
        Json::Object(range) if range.contains_key("factor") => steps(&range)?,
        one => vec![one],
    };
    if values.is_empty() {
        return Err("the list is empty, expected at least one value".to_owned());
    }
    let repeated = values.iter().enumerate().find(|(at, value)| values[..*at].contains(value));
    match repeated {
        Some((_, value)) => Err(format!("{value} is listed twice")),
        None => Ok(values),
    }
}

fn steps(range: &serde_json::Map<String, Json>) -> Result<Vec<Json>, String> {
    let number = |key: &str| range.get(key).and_then(Json::as_f64).unwrap_or(f64::NAN);
    let (from, to, factor) = (number("from"), number("to"), number("factor"));
    if range.len() != 3 || !(from > 0.0 && to >= from && to.is_finite()) {
        return Err("expected { from, to, factor }: positive numbers, the smaller first".to_owned());
    }
    if !(factor > 1.0 && factor.is_finite() && math::ln(to / from) / math::ln(factor) < MAX_STEPS) {
        return Err(format!(
            "factor is {factor}, expected one above 1 that makes at most {MAX_STEPS} values"
        ));
    }
    // A last value lifted above the end by rounding counts.
    let end = to * (1.0 + 1e-9);
    let values = (0..).map(|step| from * math::powi(factor, step));
    Ok(values.take_while(|&value| value <= end).map(Json::from).collect())
}

/// Words of a file may be very long; messages that quote them are shortened.
fn short(error: Error) -> Error {
    let message = format!("{error:#}");
    match message.char_indices().nth(LONGEST_MESSAGE) {
        Some((end, _)) => anyhow!("{} …", &message[..end]),
        None => error,
    }
}

/// A TOML error with its line, without the line's text, which may be long.
fn toml_error(text: &str, error: &toml::de::Error) -> Error {
    let message = error.message();
    match error.span() {
        Some(span) => anyhow!("line {}: {message}", SourceText(text).line(span.start)),
        None => anyhow!("{message}"),
    }
}

#[cfg(test)]
mod tests;
