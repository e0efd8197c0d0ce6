//! Laser logs in and out: readers and writers of log formats (CARMEN, ROS 2 bags), the simulated office, and the registry
//! of public data sets.
//!
//! # Features
//! All are on by default. What a build leaves out is still recognized, and the error names the feature.
//!
//! | feature | brings |
//! |---|---|
//! | `bags` | bags of ROS, read and written: MCAP, ROS 1, folders of rosbag2 |
//! | `sqlite` | rosbag2's databases (`.db3`), with SQLite compiled in |
//! | `fetch` | [`registry`]: downloads of public data sets, by HTTP |
//!
//! # Example
//! ```
//! use mcl_core::Seed;
//! use mcl_datasets::log::read_log;
//! use mcl_datasets::simulator::{OfficeSettings, simulate};
//!
//! // A log as it would come from a robot: scans, odometry, and where the robot really was.
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("office.log");
//! let office = simulate(&OfficeSettings::default(), Seed::new(1))?;
//! mcl_datasets::carmen::write(&office, &[], std::fs::File::create(&path)?)?;
//!
//! let log = read_log(&path)?;
//! println!("{}: {} scans", log.kind, log.recording.scans.len());
//! assert!(log.report.is_complete() && log.recording.has_reference());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

// Without bags, the message decoder has no caller.
#[cfg_attr(not(feature = "bags"), allow(dead_code))]
pub mod bag;
pub mod carmen;
#[cfg_attr(not(feature = "bags"), allow(dead_code))]
pub mod container;
pub mod log;
mod mount;
mod packed;
pub mod registry;
mod room;
pub mod simulator;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
