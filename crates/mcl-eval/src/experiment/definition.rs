use std::fmt;
use std::path::Path;

use anyhow::{Context, Result, bail};
use mcl_datasets::registry::is_plain_name;
use mcl_filter::{FilterSettings, OdometryNoise};
use mcl_maps::FkmSettings;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{
    Builder, ChoicesExperiment, MapStrategy, RefinementExperiment, RepresentationsExperiment,
    SensitivityExperiment,
};

/// An experiment as its TOML file defines it. Unknown keys are errors.
#[derive(Debug, Clone, PartialEq)]
pub enum Experiment {
    /// How likely the data is under maps of different sizes (paper, section V-A).
    Likelihood(LikelihoodExperiment),
    /// How well a robot localizes on maps of different sizes (paper, section V-B).
    Localization(LocalizationExperiment),
    /// How the localization error depends on the settings that the paper leaves open.
    Sensitivity(SensitivityExperiment),
    /// How likely the data is under maps of the same size that were refined in different ways.
    Refinement(RefinementExperiment),
    /// How the localization error depends on the kind of map and its bytes.
    Representations(RepresentationsExperiment),
    /// What size and σ the data chooses, by what.
    Choices(ChoicesExperiment),
}

/// What an experiment measures: the `kind` of its TOML file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// [`LikelihoodExperiment`].
    Likelihood,
    /// [`LocalizationExperiment`].
    Localization,
    /// [`SensitivityExperiment`].
    Sensitivity,
    /// [`RefinementExperiment`].
    Refinement,
    /// [`RepresentationsExperiment`].
    Representations,
    /// [`ChoicesExperiment`].
    Choices,
}

/// Settings of a likelihood experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LikelihoodExperiment {
    /// [`Kind::Likelihood`].
    pub kind: Kind,
    /// Root of every seed of the experiment.
    pub seed: u64,
    /// σ of the mixture in metres.
    pub sigma: f64,
    /// Fuzzy k-means stops when an update gains less than this (nats per point).
    pub tolerance: f64,
    /// Fuzzy k-means stops after this many updates.
    pub max_iterations: usize,
    /// Sizes for data sets that list none of their own.
    pub sizes: Vec<SizeGroup>,
    /// Map sizes of the figures that show maps.
    pub figures: FigureSizes,
    /// The data sets to run on, as far as they are at hand.
    #[serde(rename = "dataset", default)]
    pub datasets: Vec<ExperimentDataset>,
}

/// Settings of a localization experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LocalizationExperiment {
    /// [`Kind::Localization`].
    pub kind: Kind,
    /// Root of every seed of the experiment.
    pub seed: u64,
    /// Runs of the filter per strategy and size.
    pub runs: u32,
    /// Maps per strategy and size: run r is on map r mod `maps`.
    pub maps: u32,
    /// Which scans build the map, and which are localized.
    pub splits: Vec<Split>,
    /// Map sizes in percent of the points that build the map.
    pub sizes: Vec<f64>,
    /// Also localizes on what [`Refinement::BEST`](mcl_maps::Refinement::BEST) makes of the grid-based
    /// maps (*gbs+best*).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub best: bool,
    /// Gaussian noise added to the odometry of each run, the same for every map.
    pub odometry_noise: OdometryNoise,
    /// σ of the mixture in metres, for fuzzy k-means.
    pub sigma: f64,
    /// Fuzzy k-means stops when an update gains less than this (nats per point).
    pub tolerance: f64,
    /// Fuzzy k-means stops after this many updates.
    pub max_iterations: usize,
    /// The particle filter; what is not given is the default of `mcl-eval localize`. Its `max_range` is
    /// the data set's.
    #[serde(default)]
    pub filter: FilterSettings,
    /// What the trajectory figure shows.
    pub figures: TrajectoryFigure,
    /// The data sets to run on, as far as they are at hand.
    #[serde(rename = "dataset", default)]
    pub datasets: Vec<LocalizationDataset>,
}

/// Which scans build the map, and which are localized.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Split {
    /// All scans do both, as in the paper.
    Same,
    /// Even scans build the map, odd ones are localized: nothing is tested on what it was built from.
    HeldOut,
}

impl Split {
    /// The name in files and figures.
    pub fn name(self) -> &'static str {
        match self {
            Split::Same => "same",
            Split::HeldOut => "held-out",
        }
    }
}

/// The run that the trajectory figure shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryFigure {
    /// Size of its map (gbs+f-km) in percent.
    pub trajectory: f64,
}

/// A data set of a localization experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LocalizationDataset {
    /// Name in the registry.
    pub name: String,
    /// Sizes for this data set instead of the experiment's.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sizes: Vec<f64>,
    /// Runs for this data set instead of the experiment's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub runs: Option<u32>,
}

impl LocalizationExperiment {
    /// Settings of fuzzy k-means.
    pub fn fkm(&self) -> FkmSettings {
        FkmSettings {
            sigma: self.sigma,
            tolerance: self.tolerance,
            max_iterations: self.max_iterations,
        }
    }

    fn of_dataset(&self, name: &str) -> Option<&LocalizationDataset> {
        self.datasets.iter().find(|dataset| dataset.name == name)
    }

    /// Sizes for a data set: its own, or the experiment's.
    pub fn sizes_for(&self, name: &str) -> &[f64] {
        self.of_dataset(name)
            .map(|dataset| &dataset.sizes)
            .filter(|sizes| !sizes.is_empty())
            .unwrap_or(&self.sizes)
    }

    /// Runs per strategy and size for a data set: its own, or the experiment's.
    pub fn runs_for(&self, name: &str) -> u32 {
        self.of_dataset(name).and_then(|dataset| dataset.runs).unwrap_or(self.runs)
    }
}

impl Definition for LocalizationExperiment {
    fn check(&self) -> Result<()> {
        self.datasets.iter().try_for_each(|dataset| check_name(&dataset.name))?;
        self.fkm().check()?;
        self.filter.clone().check().context("filter")?;
        if self.maps == 0 {
            bail!("maps is 0, expected at least 1");
        }
        let runs = self.datasets.iter().filter_map(|dataset| dataset.runs).chain([self.runs]);
        let sizes =
            self.datasets.iter().map(|dataset| dataset.sizes.len()).chain([self.sizes.len()]);
        let maps = 1 + MapStrategy::DRAWN.len() * sizes.max().unwrap_or(0);
        for runs in runs {
            if runs < self.maps {
                bail!("runs is {runs}, expected at least one per map ({})", self.maps);
            }
            check_rows(&[runs as usize, self.splits.len(), maps], &format!("runs = {runs}"))?;
        }
        if self.splits.is_empty() {
            bail!("splits is empty, expected \"same\", \"held-out\" or both");
        }
        if self.sizes.is_empty() {
            bail!("sizes is empty, expected at least one");
        }
        for &size in self.datasets.iter().flat_map(|dataset| &dataset.sizes).chain(&self.sizes) {
            check_percent(size, "sizes")?;
        }
        check_percent(self.figures.trajectory, "figures.trajectory")
    }
}

/// Map sizes that are repeated equally often.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SizeGroup {
    /// Sizes in percent of the data set's points.
    pub percent: Vec<f64>,
    /// Maps per size and initialization.
    pub repeats: u32,
}

/// Map sizes of the figures that show maps, in percent of the data set's points.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FigureSizes {
    /// Figure 1: grid-based map before and after fuzzy k-means.
    pub overview: f64,
    /// Figure 2: random beside grid-based map.
    pub comparison: f64,
}

/// A data set of an experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExperimentDataset {
    /// Name in the registry.
    pub name: String,
    /// Sizes for this data set instead of the experiment's.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sizes: Vec<SizeGroup>,
    /// In three dimensions, figures leave out points above this height (m), such as a ceiling that hides the
    /// rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hide_above: Option<f64>,
}

impl Experiment {
    /// Reads and checks a definition.
    ///
    /// # Errors
    /// When the file cannot be read, is no TOML, has unknown keys, or values out of range; the message
    /// names the file and the key.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path)
            .with_context(|| format!("cannot read experiment {}", path.display()))?;
        Self::parse(&text).with_context(|| format!("in experiment {}", path.display()))
    }

    /// Parses and checks the text of a definition.
    ///
    /// # Errors
    /// As [`Experiment::read`], without the file's name.
    pub fn parse(text: &str) -> Result<Self> {
        /// The kind decides which other keys there are, so it is read first.
        #[derive(Deserialize)]
        struct Head {
            kind: Kind,
        }
        let experiment = match toml::from_str::<Head>(text)?.kind {
            Kind::Likelihood => Experiment::Likelihood(toml::from_str(text)?),
            Kind::Localization => Experiment::Localization(toml::from_str(text)?),
            Kind::Sensitivity => Experiment::Sensitivity(toml::from_str(text)?),
            Kind::Refinement => Experiment::Refinement(toml::from_str(text)?),
            Kind::Choices => Experiment::Choices(toml::from_str(text)?),
            Kind::Representations => Experiment::Representations(toml::from_str(text)?),
        };
        match &experiment {
            Experiment::Likelihood(experiment) => experiment.check()?,
            Experiment::Localization(experiment) => experiment.check()?,
            Experiment::Sensitivity(experiment) => experiment.check()?,
            Experiment::Refinement(experiment) => experiment.check()?,
            Experiment::Choices(experiment) => experiment.check()?,
            Experiment::Representations(experiment) => experiment.check()?,
        }
        Ok(experiment)
    }

    /// Names of the data sets that the definition lists.
    pub fn dataset_names(&self) -> Vec<&str> {
        match self {
            Experiment::Likelihood(e) => e.datasets.iter().map(|d| d.name.as_str()).collect(),
            Experiment::Localization(e) => e.datasets.iter().map(|d| d.name.as_str()).collect(),
            Experiment::Sensitivity(e) => e.datasets.iter().map(|d| d.name.as_str()).collect(),
            Experiment::Refinement(e) => e.datasets.iter().map(|d| d.name.as_str()).collect(),
            Experiment::Choices(e) => e.datasets.iter().map(|d| d.name.as_str()).collect(),
            Experiment::Representations(e) => e.datasets.iter().map(|d| d.name.as_str()).collect(),
        }
    }
}

/// A definition of one kind, to be checked before use wherever it came from: an experiment's file, or
/// the manifest of a result folder.
pub trait Definition: DeserializeOwned {
    /// Checks every value.
    ///
    /// # Errors
    /// When one is out of range; the message names its key.
    fn check(&self) -> Result<()>;
}

impl LikelihoodExperiment {
    /// Settings of fuzzy k-means.
    pub fn fkm(&self) -> FkmSettings {
        FkmSettings {
            sigma: self.sigma,
            tolerance: self.tolerance,
            max_iterations: self.max_iterations,
        }
    }

    /// The height above which figures leave out points of a data set, in m.
    pub fn hide_above(&self, dataset: &str) -> Option<f64> {
        self.datasets.iter().find(|listed| listed.name == dataset)?.hide_above
    }

    /// Sizes and repeats for a data set: its own, or the experiment's.
    pub fn sizes_for(&self, dataset: &str) -> &[SizeGroup] {
        self.datasets
            .iter()
            .find(|listed| listed.name == dataset && !listed.sizes.is_empty())
            .map_or(&self.sizes, |listed| &listed.sizes)
    }
}

impl Definition for LikelihoodExperiment {
    fn check(&self) -> Result<()> {
        self.datasets.iter().try_for_each(|dataset| check_name(&dataset.name))?;
        self.fkm().check()?;
        let groups = self
            .datasets
            .iter()
            .map(|dataset| (format!("data set {}: ", dataset.name), &dataset.sizes))
            .chain([(String::new(), &self.sizes)]);
        for (place, groups) in groups {
            let mut seen: Vec<f64> = Vec::new();
            let trials =
                |group: &SizeGroup| group.percent.len().saturating_mul(group.repeats as usize);
            let trials = groups.iter().map(trials).fold(0, usize::saturating_add);
            check_rows(&[trials, Builder::ALL.len()], &format!("{place}sizes"))?;
            for group in groups {
                if group.repeats == 0 {
                    bail!("{place}sizes: repeats is 0, expected at least 1");
                }
                for &percent in &group.percent {
                    check_percent(percent, &format!("{place}sizes.percent"))?;
                    if seen.contains(&percent) {
                        bail!("{place}sizes: {percent} % is listed twice");
                    }
                    seen.push(percent);
                }
            }
        }
        if self.sizes.iter().all(|group| group.percent.is_empty()) {
            bail!("sizes: no size is listed, expected at least one");
        }
        check_percent(self.figures.overview, "figures.overview")?;
        check_percent(self.figures.comparison, "figures.comparison")
    }
}

/// A data set's name is that of the folder of its results.
pub(super) fn check_name(name: &str) -> Result<()> {
    if is_plain_name(name) {
        return Ok(());
    }
    bail!("dataset.name is {name:?}, expected the name of a data set, without a path")
}

/// Rows that an experiment may ask for on a data set: some hundred times as many as the largest study here.
/// A count mistyped by some digits would otherwise fill the memory with trials before the first one ran.
const MAX_ROWS: usize = 1_000_000;

/// Checks a number of rows, given by its factors.
pub(super) fn check_rows(factors: &[usize], place: &str) -> Result<()> {
    let rows = factors.iter().fold(1_usize, |rows, &factor| rows.saturating_mul(factor));
    if rows <= MAX_ROWS {
        return Ok(());
    }
    bail!(
        "{place} asks for {rows} rows per data set, expected at most {MAX_ROWS}; ask for fewer sizes, repeats or runs"
    )
}

pub(super) fn check_percent(percent: f64, place: &str) -> Result<()> {
    if percent > 0.0 && percent <= 100.0 {
        return Ok(());
    }
    bail!("{place} is {percent}, expected a percentage above 0 and up to 100")
}

/// Refuses values that are listed twice.
pub(super) fn check_distinct<T: PartialEq + fmt::Debug>(values: &[T], name: &str) -> Result<()> {
    let repeated =
        values.iter().enumerate().find(|(index, value)| values[..*index].contains(value));
    match repeated {
        Some((_, value)) => bail!("{name}: {value:?} is listed twice"),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: &str = r#"
        kind = "likelihood"
        seed = 1
        sigma = 0.05
        tolerance = 1e-4
        max_iterations = 1000
        sizes = [{ percent = [1, 2], repeats = 3 }]
        figures = { overview = 0.8, comparison = 0.25 }
        [[dataset]]
        name = "a"
        sizes = [{ percent = [5], repeats = 1 }]
        [[dataset]]
        name = "b"
    "#;

    #[test]
    fn a_data_set_may_have_sizes_of_its_own() {
        let experiment = Experiment::parse(SMALL).unwrap();
        assert_eq!(experiment.dataset_names(), ["a", "b"]);
        let Experiment::Likelihood(experiment) = experiment else { panic!("of another kind") };
        assert_eq!(experiment.sizes_for("a")[0].percent, [5.0]);
        assert_eq!(experiment.sizes_for("b")[0].percent, [1.0, 2.0]);
        assert_eq!(experiment.sizes_for("elsewhere")[0].repeats, 3);
    }

    #[test]
    fn mistakes_are_named() {
        for (right, wrong, named) in [
            ("seed = 1", "seed = 1\nsede = 2", "sede"),
            ("sigma = 0.05", "sigma = -1", "sigma"),
            ("[1, 2]", "[1, 1]", "twice"),
            ("[1, 2]", "[1, 200]", "200"),
            ("repeats = 3", "repeats = 0", "repeats"),
            // Found while writing its fuzz target: eight billion trials were listed before the first one ran.
            ("repeats = 3", "repeats = 4294967295", "17179869180 rows"),
            ("\"likelihood\"", "\"likelyhood\"", "likelyhood"),
            ("overview = 0.8", "overview = 0", "figures.overview"),
            ("name = \"b\"", "name = \"../b\"", "dataset.name is \"../b\""),
            ("name = \"b\"", "name = \"/b\"", "dataset.name is \"/b\""),
            ("name = \"b\"", "name = \"C:b\"", "dataset.name is \"C:b\""),
            ("name = \"b\"", "name = \"..\"", "dataset.name is \"..\""),
        ] {
            let error = Experiment::parse(&SMALL.replace(right, wrong)).unwrap_err();
            assert!(format!("{error:#}").contains(named), "{error:#}");
        }
    }
}
