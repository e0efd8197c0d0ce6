//! A simulated office: the default data set, for use where no real log is available.
//!
//! A robot with a laser range finder drives through a building of 30 m × 30 m: corridors that form
//! loops, rooms with open and half-open doors, round pillars, furniture, and glass that often misses.
//! It enters every room and drives around the loops again. The recording has the size of the Intel
//! Research Lab log (about 910 scans of 180 beams on 500 m, some 150,000 readings of up to 10 m), the same
//! rule for when a scan is logged, and odometry errors like that log's, but its reference poses are exact.
//!
//! The walls, doors and pillars are the same for every seed. The seed decides the furniture, how the
//! robot strays from its route, and all noise. With no noise and no losses, every reading is the
//! exact distance from the reference pose to the nearest surface (rounded to the scanner's
//! resolution).
//!
//! **People.** [`OfficeSettings::people`] walk from place to place and step out of the robot's way. The laser sees their
//! legs; the map does not know them. A beam that meets nobody reads what it reads without people.
//!
//! **Three dimensions.** [`simulate_cloud`] adds heights to the same building, and scans it with a lidar of
//! several beams along the same path.
//!
//! **Reproducibility.** The same settings and seed give the same bits on every run, whatever the
//! number of threads and the processor. Ranges, poses and odometry increments are rounded to six decimals
//! (1 µm, 1 µrad), which makes a text log exact.
//!
//! # Example
//! ```
//! use mcl_core::Seed;
//! use mcl_datasets::simulator::{OfficeSettings, simulate};
//!
//! let recording = simulate(&OfficeSettings::default(), Seed::new(1))?;
//! assert!(recording.has_reference() && recording.has_odometry());
//! assert_eq!(recording.scans[0].ranges.len(), 180);
//! # Ok::<(), mcl_datasets::simulator::SimulationError>(())
//! ```

mod floor_plan;
mod furniture;
mod laser;
mod lidar;
mod obstacles;
mod odometry;
mod office;
mod path;
mod people;
mod ray;
mod route;
mod settings;

use mcl_core::{Recording, Seed};

pub use lidar::{LidarSettings, simulate_cloud};
pub use obstacles::{Circle, Material, Obstacles, Segment};
pub use office::Office;
pub use settings::{
    DriveSettings, LaserSettings, OdometrySettings, OfficeSettings, SimulationError,
};

/// Builds the office and drives through it.
///
/// # Errors
/// [`SimulationError::Setting`] names a setting that is out of range.
pub fn simulate(settings: &OfficeSettings, seed: Seed) -> Result<Recording, SimulationError> {
    Ok(Office::new(settings, seed)?.record())
}
