//! The result folders that claims are decided from.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::claim::{Place, Untestable};
use super::paired::Sampled;
use crate::experiment::{
    DatasetFacts, LikelihoodExperiment, LikelihoodRow, LocalizationExperiment, LocalizationRow,
    Manifest, Split, read_rows,
};
use crate::results::{ComparisonMaps, MANIFEST, TRIALS};

/// What experiments left of a data set.
pub(super) struct Dataset {
    pub facts: DatasetFacts,
    /// One entry per experiment, or one that says why there is none.
    pub likelihood: Vec<LikelihoodResults>,
    /// One entry per experiment and split, or one that says why there is none.
    pub localization: Vec<LocalizationResults>,
}

/// A likelihood experiment on a data set.
pub(super) struct LikelihoodResults {
    pub place: Place,
    /// Sizes of the experiment's definition in percent, whether they have rows yet or not.
    pub planned_sizes: Vec<f64>,
    /// At least one.
    pub rows: Result<Vec<LikelihoodRow>, Untestable>,
    /// The maps of figure 2.
    pub maps: Result<ComparisonMaps, Untestable>,
}

/// A localization experiment on a data set, one split.
pub(super) struct LocalizationResults {
    pub place: Place,
    /// Sizes of the experiment's definition in percent, whether they have rows yet or not.
    pub planned_sizes: Vec<f64>,
    /// At least one.
    pub rows: Result<Vec<LocalizationRow>, Untestable>,
}

/// The kinds of experiments that claims are about.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Kind {
    Likelihood,
    Localization,
    #[serde(other)]
    Other,
}

/// Reads the result folders, by data set.
pub(super) fn read(folders: &[PathBuf]) -> Result<Vec<Dataset>> {
    // Results of another log of the same name, or of other points of it, are another data set's.
    let mut datasets: BTreeMap<(String, String, usize), Dataset> = BTreeMap::new();
    for folder in folders {
        let kind = kind_of(&folder.join(MANIFEST))?;
        if matches!(kind, Kind::Other) {
            continue;
        }
        let manifest = Manifest::read(&folder.join(MANIFEST))?;
        let facts = &manifest.dataset;
        // The paper's maps are planar.
        if facts.dimensions != 2 {
            continue;
        }
        let data = (facts.name.clone(), facts.sha256.clone(), facts.points);
        let dataset = datasets.entry(data).or_insert_with(|| Dataset {
            facts: facts.clone(),
            likelihood: Vec::new(),
            localization: Vec::new(),
        });
        match kind {
            Kind::Likelihood => dataset.likelihood.push(read_likelihood(folder, &manifest)?),
            Kind::Localization => {
                dataset.localization.extend(read_localization(folder, &manifest)?);
            }
            Kind::Other => {}
        }
    }
    let mut datasets: Vec<Dataset> = datasets.into_values().collect();
    for dataset in &mut datasets {
        let name = &dataset.facts.name;
        if dataset.likelihood.is_empty() {
            dataset.likelihood.push(LikelihoodResults::missing(name));
        }
        if dataset.localization.is_empty() {
            dataset.localization.push(LocalizationResults::missing(name));
        }
    }
    Ok(datasets)
}

/// The kind alone: manifests of other kinds need not be understood.
fn kind_of(manifest: &Path) -> Result<Kind> {
    #[derive(Deserialize)]
    struct Head {
        kind: Kind,
    }
    let text = std::fs::read_to_string(manifest)
        .with_context(|| format!("cannot read {}", manifest.display()))?;
    let head: Head =
        serde_json::from_str(&text).with_context(|| format!("in {}", manifest.display()))?;
    Ok(head.kind)
}

fn place(manifest: &Manifest, split: Option<Split>) -> Place {
    let experiment = Some(manifest.experiment.clone());
    Place { dataset: manifest.dataset.name.clone(), experiment, split }
}

fn read_likelihood(folder: &Path, manifest: &Manifest) -> Result<LikelihoodResults> {
    let definition: LikelihoodExperiment =
        manifest.definition().with_context(|| folder.display().to_string())?;
    let groups = definition.sizes_for(&manifest.dataset.name);
    let planned_sizes = groups.iter().flat_map(|group| group.percent.clone()).collect();
    let rows = read_trials(folder, |row: &LikelihoodRow| {
        [
            ("initial_log_likelihood", row.initial_log_likelihood),
            ("improved_log_likelihood", row.improved_log_likelihood),
        ]
    })?;
    let maps = ComparisonMaps::read(folder)?;
    let maps = maps.ok_or_else(|| Untestable("the maps of figure 2 are not saved".to_owned()));
    Ok(LikelihoodResults { place: place(manifest, None), planned_sizes, rows, maps })
}

fn read_localization(folder: &Path, manifest: &Manifest) -> Result<Vec<LocalizationResults>> {
    let definition: LocalizationExperiment =
        manifest.definition().with_context(|| folder.display().to_string())?;
    let rows = read_trials(folder, |row: &LocalizationRow| [("weighted", row.weighted)])?;
    let of_split = |split| {
        let rows = rows.clone().and_then(|rows| {
            let rows: Vec<LocalizationRow> =
                rows.into_iter().filter(|row| row.split == split).collect();
            match rows.is_empty() {
                true => Err(Untestable(format!("no run of the split \"{}\"", split.name()))),
                false => Ok(rows),
            }
        });
        let planned_sizes = definition.sizes_for(&manifest.dataset.name).to_vec();
        LocalizationResults { place: place(manifest, Some(split)), planned_sizes, rows }
    };
    // The paper's split always has its rows, if only to say that nothing was measured.
    let mut splits = vec![of_split(Split::Same)];
    let held_out = of_split(Split::HeldOut);
    if held_out.rows.is_ok() || definition.splits.contains(&Split::HeldOut) {
        splits.push(held_out);
    }
    Ok(splits)
}

/// The rows of finished trials, with all `values` finite.
fn read_trials<R: DeserializeOwned, const N: usize>(
    folder: &Path,
    values: impl Fn(&R) -> [(&'static str, f64); N],
) -> Result<Result<Vec<R>, Untestable>> {
    let path = folder.join(TRIALS);
    if !path.exists() {
        return Ok(Err(Untestable(format!("{} is missing", path.display()))));
    }
    let rows: Vec<R> = read_rows(&path)?;
    for (index, row) in rows.iter().enumerate() {
        for (name, value) in values(row) {
            if !value.is_finite() {
                // After the header, lines count from 2.
                let line = index + 2;
                bail!(
                    "{}: line {line}: {name} is {value}, expected a finite number",
                    path.display()
                );
            }
        }
    }
    match rows.is_empty() {
        true => Ok(Err(Untestable(format!("{} has no rows yet", path.display())))),
        false => Ok(Ok(rows)),
    }
}

impl LikelihoodResults {
    fn missing(dataset: &str) -> Self {
        let reason = Untestable("no likelihood experiment was run on this data set".to_owned());
        LikelihoodResults {
            place: Place { dataset: dataset.to_owned(), experiment: None, split: None },
            planned_sizes: Vec::new(),
            rows: Err(reason.clone()),
            maps: Err(reason),
        }
    }

    pub fn rows(&self) -> Result<&[LikelihoodRow], Untestable> {
        self.rows.as_deref().map_err(Untestable::clone)
    }
}

impl LocalizationResults {
    fn missing(dataset: &str) -> Self {
        let reason = "no localization experiment was run on this data set";
        let place =
            Place { dataset: dataset.to_owned(), experiment: None, split: Some(Split::Same) };
        LocalizationResults {
            place,
            planned_sizes: Vec::new(),
            rows: Err(Untestable(reason.to_owned())),
        }
    }

    /// The runs on maps of the paper's four strategies, and their sizes.
    pub fn sampled(&self) -> Result<Sampled<'_>, Untestable> {
        let rows = self.rows.as_deref().map_err(Untestable::clone)?;
        Ok(Sampled::new(rows, &self.planned_sizes))
    }
}
