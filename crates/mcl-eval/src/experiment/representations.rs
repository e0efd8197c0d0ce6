use std::fmt;

use anyhow::{Context, Result, bail};
use mcl_filter::{FilterSettings, OdometryNoise};
use mcl_maps::FkmSettings;
use serde::{Deserialize, Serialize};

use super::definition::{Definition, check_distinct, check_name, check_percent, check_rows};
use super::localization::map_seed;
use super::scheduler::Trial;
use super::{Builder, Kind, LocalizationDataset, Split};

/// Settings of an experiment on kinds of maps: the localization error against what the map takes in bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RepresentationsExperiment {
    /// [`Kind::Representations`].
    pub kind: Kind,
    /// Root of every seed of the experiment.
    pub seed: u64,
    /// Runs of the filter per map and parameter.
    pub runs: u32,
    /// Point maps per builder and size: run r is on map r mod `maps`. The other kinds of maps hang on the
    /// data alone.
    pub maps: u32,
    /// Which scans build the map, and which are localized.
    pub splits: Vec<Split>,
    /// Gaussian noise added to the odometry of each run, the same for every map.
    pub odometry_noise: OdometryNoise,
    /// σ of the mixture in metres, for fuzzy k-means and what is beyond it.
    pub sigma: f64,
    /// Fuzzy k-means stops when an update gains less than this (nats per point).
    pub tolerance: f64,
    /// Fuzzy k-means stops after this many updates.
    pub max_iterations: usize,
    /// The point maps; all points are always run as well.
    pub points: PointMaps,
    /// Edges of the cells of occupancy grids (m).
    pub grids: Vec<f64>,
    /// Edges of the cells of NDT maps (m).
    pub ndt: Vec<f64>,
    /// Tolerances of maps of line segments (m): how far points may be from their line.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub segments: Vec<f64>,
    /// The particle filter; what is not given is the default of `mcl-eval localize`. Its `max_range` is
    /// the data set's.
    #[serde(default)]
    pub filter: FilterSettings,
    /// The data sets to run on, as far as they are at hand; `sizes` are those of their point maps.
    #[serde(rename = "dataset", default)]
    pub datasets: Vec<LocalizationDataset>,
}

/// Which point maps: every builder at every size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointMaps {
    /// Builders: `rnd`, `gbs`, `rnd+f-km`, `gbs+f-km`, `gbs+best`.
    pub builders: Vec<Representation>,
    /// Sizes in percent of the points that build the map.
    pub sizes: Vec<f64>,
}

/// A kind of map, and of point maps who chose the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Representation {
    /// Points chosen at random.
    #[serde(rename = "rnd")]
    Random,
    /// The same, improved by fuzzy k-means.
    #[serde(rename = "rnd+f-km")]
    RandomImproved,
    /// Points chosen by a grid.
    #[serde(rename = "gbs")]
    Grid,
    /// The same, improved by fuzzy k-means.
    #[serde(rename = "gbs+f-km")]
    GridImproved,
    /// The same, improved by [`mcl_maps::Refinement::BEST`].
    #[serde(rename = "gbs+best")]
    GridBest,
    /// Every point.
    #[serde(rename = "all")]
    All,
    /// Occupancy grid with a likelihood field of one distance per cell.
    #[serde(rename = "occupancy")]
    Occupancy,
    /// NDT map, its Gaussians as they are.
    #[serde(rename = "ndt")]
    Ndt,
    /// NDT map, σ_hit² added to each variance.
    #[serde(rename = "ndt+sigma")]
    NdtWide,
    /// Line segments.
    #[serde(rename = "segments")]
    Segments,
}

impl Representation {
    /// All kinds, in the order of figures and tables.
    pub const ALL: [Representation; 10] = [
        Representation::Random,
        Representation::RandomImproved,
        Representation::Grid,
        Representation::GridImproved,
        Representation::GridBest,
        Representation::All,
        Representation::Occupancy,
        Representation::Ndt,
        Representation::NdtWide,
        Representation::Segments,
    ];

    /// The name in files and figures.
    pub fn label(self) -> &'static str {
        match self {
            Representation::Random => "rnd",
            Representation::RandomImproved => "rnd+f-km",
            Representation::Grid => "gbs",
            Representation::GridImproved => "gbs+f-km",
            Representation::GridBest => "gbs+best",
            Representation::All => "all",
            Representation::Occupancy => "occupancy",
            Representation::Ndt => "ndt",
            Representation::NdtWide => "ndt+sigma",
            Representation::Segments => "segments",
        }
    }

    /// Who chose the initial points of a point map of a given size.
    pub fn builder(self) -> Option<Builder> {
        match self {
            Representation::Random | Representation::RandomImproved => Some(Builder::Random),
            Representation::Grid | Representation::GridImproved | Representation::GridBest => {
                Some(Builder::Grid)
            }
            _ => None,
        }
    }

    /// Unit of the parameter: of a point map its size, of others the edge of a cell or the tolerance.
    pub fn unit(self) -> &'static str {
        match self {
            Representation::Occupancy
            | Representation::Ndt
            | Representation::NdtWide
            | Representation::Segments => "m",
            _ => "%",
        }
    }
}

/// A trial: a map and the runs of the filter on it.
#[derive(Debug, Clone, PartialEq)]
pub struct RepresentationTrial {
    /// How scans are divided.
    pub split: Split,
    /// The kind of map.
    pub representation: Representation,
    /// Size in percent, or edge of a cell or tolerance in metres.
    pub parameter: f64,
    /// Number of the map, from 0.
    pub map: u32,
    /// Seed of what is drawn for the map; `None` where it hangs on the data alone.
    pub map_seed: Option<u64>,
    /// Numbers of the runs.
    pub runs: Vec<u32>,
}

/// What tells a row from the others on its data set; the parameter by its bits.
pub type RepresentationKey = (Split, Representation, u64, u32);

impl RepresentationTrial {
    /// Keys of the rows of this trial.
    pub fn keys(&self) -> Vec<RepresentationKey> {
        let parameter = self.parameter.to_bits();
        let key = |&run: &u32| (self.split, self.representation, parameter, run);
        self.runs.iter().map(key).collect()
    }
}

/// In runs on a point map, as seen; the other kinds of maps have no fast path.
impl Trial for RepresentationTrial {
    fn cost(&self) -> f64 {
        let (map, run) = match self.representation {
            Representation::GridBest => (2.0 + 2.0 * self.parameter, 1.0),
            Representation::RandomImproved | Representation::GridImproved => (1.0, 1.0),
            Representation::Occupancy => (1.0, 6.0),
            Representation::Ndt | Representation::NdtWide => (0.0, 12.0),
            Representation::Segments => (0.5, 12.0),
            _ => (0.0, 1.0),
        };
        map + run * self.runs.len() as f64
    }
}

/// "held-out occupancy 0.05 m #3".
impl fmt::Display for RepresentationTrial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { split, representation, parameter, map, .. } = self;
        let (split, label, unit) = (split.name(), representation.label(), representation.unit());
        write!(f, "{split} {label} {parameter} {unit} #{map}")
    }
}

impl RepresentationsExperiment {
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

    /// Runs per map and parameter for a data set: its own, or the experiment's.
    pub fn runs_for(&self, dataset: &str) -> u32 {
        self.of_dataset(dataset).and_then(|dataset| dataset.runs).unwrap_or(self.runs)
    }

    /// Sizes of point maps for a data set: its own, or the experiment's.
    fn sizes_for(&self, dataset: &str) -> &[f64] {
        self.of_dataset(dataset)
            .map(|dataset| &dataset.sizes)
            .filter(|sizes| !sizes.is_empty())
            .unwrap_or(&self.points.sizes)
    }

    /// Every kind of map with every parameter, for a data set.
    pub fn representations(&self, dataset: &str) -> Vec<(Representation, f64)> {
        let sizes = self.sizes_for(dataset);
        let with = |representation, parameters: &[f64]| {
            parameters.iter().map(move |&parameter| (representation, parameter)).collect::<Vec<_>>()
        };
        let mut all: Vec<_> =
            self.points.builders.iter().flat_map(|&builder| with(builder, sizes)).collect();
        all.push((Representation::All, 100.0));
        all.extend(with(Representation::Occupancy, &self.grids));
        all.extend(with(Representation::Ndt, &self.ndt));
        all.extend(with(Representation::NdtWide, &self.ndt));
        all.extend(with(Representation::Segments, &self.segments));
        all
    }

    /// All trials of the experiment on a data set.
    pub fn trials(&self, dataset: &str) -> Vec<RepresentationTrial> {
        let all = 0..self.runs_for(dataset);
        let mut trials = Vec::new();
        for &split in &self.splits {
            for (representation, parameter) in self.representations(dataset) {
                for map in 0..self.maps {
                    let seed = |builder: Builder| {
                        map_seed(self.seed, dataset, split, Some(builder), parameter, map)
                    };
                    trials.push(RepresentationTrial {
                        split,
                        representation,
                        parameter,
                        map,
                        map_seed: representation.builder().map(seed),
                        runs: (map..all.end).step_by(self.maps as usize).collect(),
                    });
                }
            }
        }
        trials
    }
}

impl Definition for RepresentationsExperiment {
    fn check(&self) -> Result<()> {
        self.datasets.iter().try_for_each(|dataset| check_name(&dataset.name))?;
        self.fkm().check()?;
        self.filter.clone().check().context("filter")?;
        if self.maps == 0 {
            bail!("maps is 0, expected at least 1");
        }
        let runs = self.datasets.iter().filter_map(|dataset| dataset.runs).chain([self.runs]);
        let sizes = self.datasets.iter().map(|dataset| dataset.sizes.len());
        let most = sizes.chain([self.points.sizes.len()]).max().unwrap_or(0);
        for runs in runs {
            if runs < self.maps {
                bail!("runs is {runs}, expected at least one per map ({})", self.maps);
            }
            let kinds = self.points.builders.len() + 4;
            let others = [&self.grids, &self.ndt, &self.segments].map(Vec::len);
            let parameters = others.into_iter().fold(most, usize::max).max(1);
            let rows = [runs as usize, self.splits.len(), kinds, parameters];
            check_rows(&rows, &format!("runs = {runs}"))?;
        }
        if self.splits.is_empty() {
            bail!("splits is empty, expected \"same\", \"held-out\" or both");
        }
        if let Some(other) = self.points.builders.iter().find(|builder| builder.builder().is_none())
        {
            bail!(
                "points.builders: {:?} is no builder, expected rnd, gbs, rnd+f-km, gbs+f-km or gbs+best",
                other.label()
            );
        }
        let sizes = self.datasets.iter().map(|dataset| &dataset.sizes).chain([&self.points.sizes]);
        for sizes in sizes {
            for &size in sizes {
                check_percent(size, "points.sizes")?;
            }
            check_distinct(sizes, "points.sizes")?;
        }
        check_distinct(&self.points.builders, "points.builders")?;
        check_distinct(&self.splits, "splits")?;
        for (name, what, lengths) in [
            ("grids", "edge of a cell", &self.grids),
            ("ndt", "edge of a cell", &self.ndt),
            ("segments", "tolerance", &self.segments),
        ] {
            if let Some(length) = lengths.iter().find(|m| !(m.is_finite() && **m > 0.0)) {
                bail!("{name}: the {what} is {length} m, expected a positive number");
            }
            check_distinct(lengths, name)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::Experiment;
    use std::collections::HashSet;

    const SMALL: &str = r#"
        kind = "representations"
        seed = 1
        runs = 4
        maps = 2
        splits = ["same", "held-out"]
        odometry_noise = { xy = 0.01, theta = 0.01 }
        sigma = 0.05
        tolerance = 1e-4
        max_iterations = 100
        points = { builders = ["rnd", "gbs+best"], sizes = [1, 2] }
        grids = [0.05, 0.1]
        ndt = [0.5]
        segments = [0.1, 0.2]
        [[dataset]]
        name = "a"
        sizes = [5]
        runs = 2
    "#;

    fn parse(text: &str) -> Result<RepresentationsExperiment> {
        match Experiment::parse(text)? {
            Experiment::Representations(experiment) => Ok(experiment),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn every_map_has_all_runs_once() {
        let experiment = parse(SMALL).unwrap();
        for (dataset, maps, runs) in [("b", 4 + 1 + 2 + 2 + 2, 4), ("a", 2 + 1 + 2 + 2 + 2, 2)] {
            let trials = experiment.trials(dataset);
            assert_eq!(trials.len(), 2 * maps * 2);
            let keys: Vec<_> = trials.iter().flat_map(RepresentationTrial::keys).collect();
            assert_eq!(keys.len(), 2 * maps * runs);
            assert_eq!(keys.iter().collect::<HashSet<_>>().len(), keys.len());
            let names: HashSet<_> = trials.iter().map(ToString::to_string).collect();
            assert_eq!(names.len(), trials.len());
        }
        assert_eq!(experiment.trials("b")[0].to_string(), "same rnd 1 % #0");
    }

    /// Definitions without line segments are older than those.
    #[test]
    fn segments_need_not_be_given() {
        let [with, without] = ["segments = [0.1, 0.2]", ""]
            .map(|key| parse(&SMALL.replace("segments = [0.1, 0.2]", key)));
        let (with, without) = (with.unwrap(), without.unwrap());
        assert_eq!(without, RepresentationsExperiment { segments: Vec::new(), ..with.clone() });
        // Nothing is added to what they are kept as, and their trials are the same, in the same order.
        assert!(serde_json::to_value(&without).unwrap().get("segments").is_none());
        let mut others = with.trials("b");
        others.retain(|trial| trial.representation != Representation::Segments);
        assert_eq!(without.trials("b"), others);
    }

    #[test]
    fn mistakes_are_named() {
        for (right, wrong, named) in [
            ("\"gbs+best\"", "\"occupancy\"", "is no builder"),
            ("\"gbs+best\"", "\"rnd\"", "listed twice"),
            ("\"gbs+best\"", "\"best\"", "best"),
            ("[0.05, 0.1]", "[0.1, 0.1]", "grids"),
            ("[0.5]", "[-1]", "ndt: the edge"),
            ("[0.1, 0.2]", "[0.1, 0]", "segments: the tolerance is 0 m"),
            ("[0.1, 0.2]", "[0.2, 0.2]", "segments: 0.2 is listed twice"),
            ("[1, 2]", "[1, 200]", "200"),
            ("runs = 2", "runs = 1", "at least one per map"),
            ("seed = 1", "seed = 1\nsede = 2", "sede"),
        ] {
            let error = parse(&SMALL.replace(right, wrong)).unwrap_err();
            assert!(format!("{error:#}").contains(named), "{error:#}");
        }
    }
}
