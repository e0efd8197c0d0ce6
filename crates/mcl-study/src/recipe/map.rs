//! The recipe of a map.

use std::fmt;

use mcl_core::Seed;
use mcl_maps::{FkmSettings, GridOffset, InitialMap, MapSize, RefineSettings};
use rand::RngExt;
use serde::Serialize;

use crate::recipe::criterion::Criterion;
use crate::recipe::kind::{Builder, MapKind, NamedKind};
use crate::recipe::split::{FOLDS, Split};
use crate::table::{Cells, Value};

/// How large a map is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Size {
    /// Percent of the points given to the builder.
    Percent(f64),
    /// A number of points.
    Points(usize),
    /// Edge of a cell, or largest distance of points from the segment of their wall (m).
    Resolution(f64),
    /// Chosen by the data by a criterion.
    Chosen(Criterion),
}

/// "1 %", "389 points", "0.1 m", "by bic".
impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Size::Percent(percent) => write!(f, "{percent} %"),
            Size::Points(points) => write!(f, "{points} points"),
            Size::Resolution(metres) => write!(f, "{metres} m"),
            Size::Chosen(criterion) => write!(f, "by {criterion}"),
        }
    }
}

/// σ of the mixture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sigma {
    /// In metres.
    Metres(f64),
    /// Chosen by the data by a criterion.
    Chosen(Criterion),
}

/// The position of the lines of a grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Offset {
    /// `u` cells from the origin, u uniform in [0, 1) per axis.
    Random,
    /// At the origin.
    Origin,
}

/// The recipe of a map: everything that it depends on, except the content of the data and the build of the
/// program.
#[derive(Debug, Clone, PartialEq)]
pub struct MapRecipe {
    /// Name of the data set.
    pub dataset: String,
    /// Which scans build the map; `None` where all do and nothing is held out or localized.
    pub split: Option<Split>,
    /// The kind of map.
    pub kind: NamedKind,
    /// How large it is; `None` for all points.
    pub size: Option<Size>,
    /// The position of the lines of a grid.
    pub offset: Offset,
    /// σ of the mixture, for refinements and likelihood.
    pub sigma: Sigma,
    /// EM stops when an update gains less than this (nats per point).
    pub tolerance: f64,
    /// EM stops after this many updates.
    pub max_iterations: usize,
    /// Number of the draw: maps with the same draw number are one independent unit.
    pub draw: u32,
    /// Root of every seed of the study.
    pub seed: u64,
}

/// What a map depends on. The draw number is part of it only where something is drawn or held out by it, so
/// that a map that does not depend on it is built once.
#[derive(Serialize)]
struct Identity<'a> {
    dataset: &'a str,
    split: Option<Split>,
    fold: Option<usize>,
    kind: &'a MapKind,
    size: Option<Size>,
    offset: Offset,
    sigma: Sigma,
    tolerance: f64,
    max_iterations: usize,
    draw_seed: Option<u64>,
}

impl MapRecipe {
    /// The identity of the map in a cache: recipes with the same identity give the same map.
    ///
    /// # Errors
    /// When it cannot be written as JSON.
    pub fn identity(&self) -> anyhow::Result<String> {
        crate::recipe::identity(&Identity {
            dataset: &self.dataset,
            split: self.split,
            fold: self.fold(),
            kind: &self.kind.kind,
            size: self.size,
            offset: self.offset,
            sigma: self.sigma,
            tolerance: self.tolerance,
            max_iterations: self.max_iterations,
            draw_seed: self.draw_seed(),
        })
    }

    /// The recipe of the map that a refinement starts from; itself for a map without refinement.
    pub fn initial(&self) -> Self {
        let MapKind::Sampled { builder, refinement: Some(_) } = self.kind.kind else {
            return self.clone();
        };
        let kind = MapKind::Sampled { builder, refinement: None };
        MapRecipe { kind: NamedKind { name: builder.name().to_owned(), kind }, ..self.clone() }
    }

    /// The fold that the draw holds out, where the split has folds.
    pub fn fold(&self) -> Option<usize> {
        (self.split == Some(Split::Blocks)).then_some(self.draw as usize % FOLDS)
    }

    /// Seed of the map's random draws, as taken by [`Seed::new`]; `None` without any. It depends on data set,
    /// split, builder, size and draw, not on the refinement of the initial map.
    pub fn draw_seed(&self) -> Option<u64> {
        let builder = self.kind.builder()?;
        let is_drawn = match builder {
            Builder::Random => true,
            // Refinements may draw, too.
            Builder::Grid => self.offset == Offset::Random || self.kind.name != builder.name(),
        };
        if !is_drawn {
            return None;
        }
        let mut seed = Seed::new(self.seed).derive("map").derive(&self.dataset);
        if let Some(split) = self.split {
            seed = seed.derive(split.seed_name());
        }
        let size = match self.size {
            Some(Size::Percent(percent)) => percent.to_string(),
            Some(size) => size.to_string(),
            None => String::new(),
        };
        Some(seed.derive(builder.name()).derive(&size).derive_index(self.draw.into()).number())
    }

    /// The initial map of a sampled one, with a size in points or percent.
    pub fn initial_map<const D: usize>(&self, size: MapSize) -> InitialMap<D> {
        let seed = self.draw_seed().unwrap_or_default();
        match (self.kind.builder(), self.offset) {
            (None, _) => InitialMap::All,
            (Some(Builder::Random), _) => InitialMap::Random { size, seed: Seed::new(seed) },
            (Some(Builder::Grid), Offset::Origin) => {
                InitialMap::GridSize { size, offset: GridOffset::ORIGIN }
            }
            (Some(Builder::Grid), Offset::Random) => {
                InitialMap::GridSize { size, offset: random_offset(seed) }
            }
        }
    }

    /// The settings of the refinement, if there is one; `sigma` in m.
    pub fn refinement(&self, sigma: f64) -> Option<RefineSettings> {
        let MapKind::Sampled { refinement: Some(method), .. } = self.kind.kind else { return None };
        let seed = Seed::new(self.draw_seed().unwrap_or_default());
        Some(RefineSettings { method, seed, ..RefineSettings::fkm(self.fkm(sigma)) })
    }

    /// Settings of EM; `sigma` in m.
    pub fn fkm(&self, sigma: f64) -> FkmSettings {
        FkmSettings { sigma, tolerance: self.tolerance, max_iterations: self.max_iterations }
    }

    /// The columns of a row that describe the map's recipe.
    pub fn cells(&self) -> Cells {
        let [mut percent, mut points, mut resolution, mut size_by] = [const { Value::Empty }; 4];
        match self.size {
            Some(Size::Percent(given)) => percent = given.into(),
            Some(Size::Points(given)) => points = given.into(),
            Some(Size::Resolution(metres)) => resolution = metres.into(),
            Some(Size::Chosen(criterion)) => size_by = criterion.name().into(),
            None if self.kind.kind == MapKind::All => percent = 100.0.into(),
            None => {}
        }
        let (sigma, sigma_by) = match self.sigma {
            Sigma::Metres(metres) => (metres.into(), Value::Empty),
            Sigma::Chosen(criterion) => (Value::Empty, criterion.name().into()),
        };
        let offset = (self.kind.builder() == Some(Builder::Grid)).then_some(match self.offset {
            Offset::Random => "random",
            Offset::Origin => "origin",
        });
        let cells: [(&str, Value); 14] = [
            ("dataset", self.dataset.as_str().into()),
            ("split", self.split.map(Split::name).into()),
            ("map", self.kind.name.as_str().into()),
            ("size_percent", percent),
            ("size_points", points),
            ("resolution_m", resolution),
            ("size_by", size_by),
            ("offset", offset.into()),
            ("sigma_m", sigma),
            ("sigma_by", sigma_by),
            ("tolerance", self.tolerance.into()),
            ("max_iterations", self.max_iterations.into()),
            ("draw", self.draw.into()),
            ("map_seed", self.draw_seed().into()),
        ];
        cells.map(|(name, value)| (name.to_owned(), value)).to_vec()
    }
}

/// The offset of a grid for a seed, in cells.
pub fn random_offset<const D: usize>(seed: u64) -> GridOffset<D> {
    let mut rng = Seed::new(seed).derive("grid-offset").rng();
    GridOffset::Cells(std::array::from_fn(|_| rng.random::<f64>()))
}

/// "alternate gbs+f-km 0.25 % #3".
impl fmt::Display for MapRecipe {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(split) = self.split {
            write!(f, "{split} ")?;
        }
        write!(f, "{}", self.kind)?;
        if let Some(size) = self.size {
            write!(f, " {size}")?;
        }
        match self.sigma {
            Sigma::Chosen(criterion) => write!(f, " σ by {criterion}")?,
            Sigma::Metres(metres) => write!(f, " σ {metres} m")?,
        }
        if self.offset == Offset::Origin {
            write!(f, " at the origin")?;
        }
        write!(f, " #{}", self.draw)
    }
}
