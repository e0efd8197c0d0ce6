//! Logs of the CARMEN robot navigation toolkit: one record per line, its kind first.
//!
//! Poses, beams and odometry are read as follows; lengths are metres, angles radians.
//!
//! * `FLASER n r₁…rₙ x y θ ox oy oθ stamp host logger_stamp`: beam *i* (from 0) points to
//!   −90° + *i*·Δ, Δ = 1° for 180 or 181 beams, 0.5° for 360 or 361. `ROBOTLASER1` states the
//!   directions itself. A log that holds both kinds logs each scan twice: the kind of the first
//!   readable scan is read, the other ignored.
//! * `x y θ` is the pose of the laser, `ox oy oθ` that of the robot by its odometry. Their meaning
//!   depends on the log, and is decided from its content ([`LogKind`](crate::log::LogKind)):
//!   - the transform between the two varies: `x y θ` is corrected, `ox oy oθ` raw odometry;
//!   - it is constant (mostly the identity), and either the log holds `NEFF` records, which only a
//!     Rao-Blackwellized mapper writes, or the `ODOM` lines restart at the poses of the scans: both
//!     are corrected (`*.gfs.log`). The odometry increment between scan *k* and *k*+1 is
//!     `P_k⁻¹ ∘ (last ODOM line before scan k+1)`;
//!   - it is constant and there is no sign of a correction: a raw log, without reference. The constant
//!     transform is the mount of the laser.
//!
//!   Where the lines are inconclusive (no `ODOM` line, or a robot that stops for each scan), a name with
//!   `.gfs.` counts as corrected, and any other as raw.
//!   [`ReferencePoses`](crate::log::ReferencePoses) overrides all this.
//! * Odometry fields that are zero throughout do not count as odometry, unless the laser stays in place with
//!   them and `ODOM` lines confirm it.
//! * `RLASER` and `ROBOTLASER2`, of a second laser, are read instead of the others on request
//!   ([`read_scans`]).
//! * `NEFF`, `SYNC` and other kinds are ignored and counted. A malformed record of a kind that is
//!   read is skipped and reported; the increment to the next scan then spans the skipped one.
//!
//! # Example
//! A corrected log: two scans of 180 beams, and odometry that restarts at the first of them.
//! ```
//! use mcl_datasets::carmen;
//! use mcl_datasets::log::{LogKind, ReferencePoses};
//!
//! let ranges = ["2.5"; 180].join(" ");
//! let text = format!(
//!     "FLASER 180 {ranges} 1 2 0 1 2 0 32.9068 host 32.9068\n\
//!      ODOM 1 2 0 0 0 0 0 host 0\n\
//!      ODOM 1.5 2 0 0 0 0 33.1 host 33.1\n\
//!      FLASER 180 {ranges} 1.6 2.1 0 1.6 2.1 0 33.1 host 33.1\n"
//! );
//! let log = carmen::read(text.as_bytes(), "walk.log", ReferencePoses::Auto)?;
//! assert_eq!(log.kind, LogKind::GfsCorrected);
//! let second = &log.recording.scans[1];
//! assert_eq!(second.odometry.unwrap().x, 0.5); // what the wheels measured
//! assert_eq!(second.map_from_laser.unwrap().x, 1.6); // where the robot was
//!
//! let mut copy = Vec::new();
//! carmen::write(&log.recording, &["a copy"], &mut copy)?;
//! assert_eq!(carmen::read(copy.as_slice(), "copy.log", ReferencePoses::Auto)?, log);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod counts;
mod fields;
mod kind;
mod odometry;
pub(crate) mod reader;
pub mod record;
mod writer;

pub use fields::{Field, Malformed};
pub use reader::{CarmenError, MAX_LINE_BYTES, ScanKind, read, read_scans};
pub use writer::{NO_RETURN, WriteError, write};
