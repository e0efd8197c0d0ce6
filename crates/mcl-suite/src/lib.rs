//! From a laser log to the error of localization with one dependency: the crates of the suite under one name and of one
//! version.
//!
//! | module | crate | holds |
//! |---|---|---|
//! | [`core`] | `mcl-core` | poses, scans, recordings, maps, seeds |
//! | [`datasets`] | `mcl-datasets` | logs and bags in and out, the simulated office, public data sets |
//! | [`maps`] | `mcl-maps` | sample-based maps, their likelihood, map files |
//! | [`filter`] | `mcl-filter` | the particle filter |
//! | [`metrics`] | `mcl-metrics` | errors of poses and trajectories, statistics |
//!
//! Studies (`mcl-study`) and figures (`mcl-figures`) are crates of their own, and `mcl-eval` is the program.
//!
//! # Example
//! ```
//! use mcl_suite::core::Seed;
//! use mcl_suite::datasets::simulator::{OfficeSettings, simulate};
//! use mcl_suite::filter::{FilterSettings, MapDistances, Replay, localize};
//! use mcl_suite::maps::*;
//! use mcl_suite::metrics::{Summary, WeightedPoseError};
//!
//! // A log: here 60 scans of the simulated office; `datasets::log::read_log("my.bag".as_ref())?.recording` of a file.
//! let mut log = simulate(&OfficeSettings::default(), Seed::new(1))?;
//! log.scans.truncate(60);
//!
//! // A map of 5 % of the measured points, refined by fuzzy k-means, and the likelihood of all points under it.
//! let data = PointSet::new(log.points(10.0)?)?;
//! let initial = InitialMap::GridSize { size: MapSize::Percent(5.0), offset: GridOffset::ORIGIN };
//! let refinement = Some(RefineSettings::fkm(FkmSettings::default()));
//! let map = build_map(&data, &MapSettings { initial, refinement })?.map;
//! let likelihood = mixture_log_likelihood(&data, &map, 0.05)?;
//!
//! // Localization by odometry and scans from the known start.
//! let settings = FilterSettings { particles: 200.into(), ..FilterSettings::default() }.check()?;
//! let distances = MapDistances::grid(&map, settings.values().max_distance)?;
//! let increments: Vec<_> = log.scans.iter().map(|scan| scan.odometry).collect();
//! let scans: Vec<usize> = (0..log.scans.len()).collect();
//! let replay = Replay { recording: &log, increments: &increments, scans: &scans };
//! let reference = log.reference()?;
//! let run = localize(&replay, &distances, &settings, Some(reference[0]), Seed::new(2))?;
//!
//! // The weighted error d of each estimate (ξ = 0.8).
//! let metric = WeightedPoseError::default();
//! let errors = reference.iter().zip(&run.map_from_laser).map(|(a, b)| metric.distance(a, b));
//! let error = Summary::of(&errors.collect::<Vec<_>>())?;
//! println!("{} points, {:.2} nats per point, d {:.3}", map.len(), likelihood.per_point, error.mean);
//! assert!(error.mean < 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What a version promises
//! All crates of the suite have one version and ask for exactly that version of each other. From one version to the next
//! that Cargo takes for compatible:
//!
//! - **The interface of these five crates** is only added to. Enums that are `#[non_exhaustive]` (errors, formats) may
//!   get variants. Structs of settings may get fields: write them with `..Default::default()`, as above. Types of other
//!   libraries in the variants of errors are for messages, and may change. `mcl-study`, `mcl-figures` and the library of
//!   `mcl-eval` serve the program, and promise nothing.
//! - **The command line** keeps its commands, options, exit codes, the keys of `--json` and the columns of result files;
//!   some may be added.
//! - **Results**: the same seed, data and settings give the same bytes on every processor, operating system and number of
//!   threads within one version. Another version may draw or compute differently; the changelog says where it does, and rows of
//!   different builds are never mixed.
//! - The oldest compiler (`rust-version`) may rise.

pub use mcl_core as core;
pub use mcl_datasets as datasets;
pub use mcl_filter as filter;
pub use mcl_maps as maps;
pub use mcl_metrics as metrics;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
