//! Sample-based maps: selecting which measured points to keep, and the likelihood of the data under them.
//!
//! A *sample-based map* is a subset S of the point set D that a laser measured. Read as a mixture of
//! equally weighted isotropic Gaussians, one per kept point, it assigns every measured point a
//! likelihood (Meyer-Delius & Burgard, section III):
//!
//! > p(x | Θ) = 1/K · Σⱼ N(x; μⱼ, σ²I)
//!
//! The main entry point is [`build_map`]: it chooses an [initial map](InitialMap) (random, grid-based, or all points)
//! and, if requested, refines it by [fuzzy k-means](fuzzy_k_means) (EM) or another [refinement](refine()). Its parts
//! can be used on their own: [`sampling`], [`mixture`], [`mod@refine`], [`occupancy`] grids, [`ndt`] maps, line
//! [`segments`], map sizes in [`bytes`], and map [`files`].
//!
//! Everything except grids, NDT maps, segments and files is generic over the dimension.
//!
//! # Example
//! ```
//! use mcl_core::Seed;
//! use mcl_maps::{
//!     FkmSettings, InitialMap, MapSettings, MapSize, PointSet, RefineSettings, build_map,
//! };
//!
//! // A wall seen 400 times.
//! let points: Vec<[f64; 2]> = (0..400).map(|i| [f64::from(i) * 0.01, 0.0]).collect();
//! let data = PointSet::new(points)?;
//! let settings = MapSettings {
//!     initial: InitialMap::Random { size: MapSize::Percent(5.0), seed: Seed::new(1) },
//!     refinement: Some(RefineSettings::fkm(FkmSettings::default())),
//! };
//! let built = build_map(&data, &settings)?;
//! let steps = built.refinement.expect("a refinement was asked for").steps;
//! assert!(steps[steps.len() - 1].log_likelihood > steps[0].log_likelihood);
//! assert!(built.map.len() <= 20);
//! # Ok::<(), mcl_maps::MapError>(())
//! ```

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod build;
pub mod bytes;
pub mod choice;
mod error;
pub mod files;
mod fkm;
mod fkm_accelerated;
pub mod mixture;
pub mod ndt;
pub mod occupancy;
mod point_set;
pub mod refine;
pub mod sampling;
pub mod segments;
mod size;
pub mod size_criteria;

pub use build::{BuiltMap, InitialMap, MapSettings, build_map, initial_map};
pub use error::MapError;
pub use fkm::{FkmReport, FkmSettings, fuzzy_k_means, snap_to_data};
pub use fkm_accelerated::accelerated_fuzzy_k_means;
pub use mixture::{LogLikelihood, mixture_log_likelihood};
pub use point_set::PointSet;
pub use refine::{RefineSettings, Refinement, refine};
pub use sampling::{GridOffset, GridSample};
pub use size::{MapSize, ParseMapSizeError};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
