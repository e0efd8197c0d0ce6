//! Writes a recording as a CARMEN log.

use std::fmt::{self, Write as _};
use std::io::{self, Write};

use mcl_core::{LaserScan, Pose2, Recording, ScanGeometry, Stamp};

use super::fields::MAX_POSE_COMPONENT;
use super::reader::MAX_LINE_BYTES;
use super::record::{REFERENCE_PARAM, flaser_geometry};
use crate::mount::MountConversion;

/// The value written for a reading without return (NaN or infinite), in metres. CARMEN writes such readings
/// as values beyond the sensor's range, and many of its readers stop at `inf`.
pub const NO_RETURN: f64 = 10_000.0;

/// Written for a scan without stamp; no reader accepts it as a time.
const NO_STAMP: &str = "-1";
/// Numbers larger than this, or smaller than its inverse, are written with an exponent; 10³⁰⁰ would take
/// 301 digits.
const LARGEST_PLAIN: f64 = 1e30;
/// Largest length of a number written this way, with a space: sign, "0.", 30 zeros and 17 digits.
const LONGEST_NUMBER: usize = 51;
/// An upper bound on the number of fields of a record besides its readings.
const OTHER_FIELDS: usize = 32;

/// Why a recording cannot be written as a CARMEN log.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// Writing failed.
    #[error("cannot write the log: {0}")]
    Io(io::Error),
    /// There is nothing to write.
    #[error("the recording has no scan, expected at least one")]
    NoScan,
    /// Some scans have a reference pose, and some do not.
    #[error(
        "scan {scan} has no reference pose but others do: a CARMEN log has them for all scans or none"
    )]
    PartialReference {
        /// Index of the scan, from 0.
        scan: usize,
    },
    /// A recording without reference needs odometry for the poses of its scans.
    #[error(
        "scan {scan} has neither a reference pose nor odometry, and a CARMEN log needs a pose for every scan"
    )]
    NoPose {
        /// Index of the scan, from 0.
        scan: usize,
    },
    /// A pose or an angle is not finite, or too large for readers.
    #[error("scan {scan}: the {what} is not finite or beyond 1e9, expected metres and radians")]
    OutOfRange {
        /// Index of the scan, from 0.
        scan: usize,
        /// What is out of range.
        what: &'static str,
    },
    /// A scan has no beams, or not as many readings as beams.
    #[error(
        "scan {scan} has {readings} readings for {beams} beams, expected one for each, and at least one"
    )]
    Readings {
        /// Index of the scan, from 0.
        scan: usize,
        /// Number of readings.
        readings: usize,
        /// Number of beams of its geometry.
        beams: usize,
    },
    /// Beam directions that are not evenly spaced.
    #[error(
        "scan {scan}: its beams were placed by the motion or the tilt of the laser, so their directions are not even, as those of a CARMEN log are; read the log with --no-deskew, and a tilted laser as level with --laser-pose"
    )]
    Uneven {
        /// Index of the scan, from 0.
        scan: usize,
    },
    /// A scan with so many beams that readers refuse its line.
    #[error(
        "scan {scan} with its {beams} beams takes a line of {bytes} bytes, expected at most \
         {MAX_LINE_BYTES}; a bag can hold it"
    )]
    TooLong {
        /// Index of the scan, from 0.
        scan: usize,
        /// Number of its beams.
        beams: usize,
        /// Length of the line.
        bytes: usize,
    },
    /// A stamp before the epoch, which readers treat as uninitialised.
    #[error("scan {scan} has the negative stamp {stamp} s, expected one from 0 on")]
    NegativeStamp {
        /// Index of the scan, from 0.
        scan: usize,
        /// The stamp.
        stamp: Stamp,
    },
}

/// Writes a recording as a CARMEN log, with `comments` as its first lines.
///
/// With reference poses it is written like a `*.gfs.log`: each scan with its reference pose, then
/// the `ODOM` line that restarts there, then one with the raw odometry up to the next scan (none of
/// the two where the increment is unknown), and `PARAM mcl_reference_poses recorded` at the head.
/// Without, it is written as a raw log, with the odometry accumulated from the origin.
///
/// [`super::read`] returns the same scans, stamps, readings and reference poses, bit for bit, and the same
/// odometry and mount up to the rounding of composed poses (10⁻¹² m within some hundred metres of the
/// origin). NaN and infinite readings become [`NO_RETURN`]. Scans are `FLASER` records where those define the
/// same beams for all of them, else `ROBOTLASER1`.
///
/// Each line is written by one call: wrap a file into a [`std::io::BufWriter`].
///
/// # Errors
/// [`WriteError`] when the sink fails, or with the scan that a CARMEN log cannot hold. All scans are checked
/// before the first byte is written.
pub fn write(
    recording: &Recording,
    comments: &[&str],
    mut sink: impl Write,
) -> Result<(), WriteError> {
    let has_reference = check(recording)?;
    let placed = place(recording, has_reference)?;
    check_lengths(&recording.scans, &placed)?;
    write_lines(recording, &placed, has_reference, comments, &mut sink).map_err(WriteError::Io)
}

/// The poses written for a scan.
struct RecordPoses {
    /// Raw odometry up to the scan, where it is known.
    odometry: Option<Pose2>,
    laser: Pose2,
    robot: Pose2,
}

/// The poses to write, which must be in the range that readers accept: sums of many steps, or of a pose and
/// the mount, may exceed it.
fn place(recording: &Recording, has_reference: bool) -> Result<Vec<RecordPoses>, WriteError> {
    let mount = MountConversion::new(recording.robot_from_laser);
    let mut placed: Vec<RecordPoses> = Vec::with_capacity(recording.scans.len());
    let mut raw = Pose2::IDENTITY;
    for (index, scan) in recording.scans.iter().enumerate() {
        let start = match placed.last() {
            Some(before) if has_reference => before.robot,
            _ => raw,
        };
        let increment = scan.odometry.filter(|_| index > 0);
        let odometry = increment.map(|increment| start.compose(&mount.robot_increment(increment)));
        raw = odometry.unwrap_or(raw);
        let (laser, robot) = match scan.map_from_laser {
            Some(laser) => (laser, mount.robot_pose(laser)),
            None => (mount.laser_pose(raw), raw),
        };
        if ![Some(laser), Some(robot), odometry].into_iter().flatten().all(is_readable) {
            let what = "pose with the mount or the odometry up to it";
            return Err(WriteError::OutOfRange { scan: index, what });
        }
        placed.push(RecordPoses { odometry, laser, robot });
    }
    Ok(placed)
}

/// Checks that no line is longer than readers accept.
fn check_lengths(scans: &[LaserScan], placed: &[RecordPoses]) -> Result<(), WriteError> {
    let is_flaser = are_flaser(scans);
    let mut line = String::new();
    for (index, (scan, placed)) in scans.iter().zip(placed).enumerate() {
        let beams = scan.ranges.len();
        // Nearly always short enough without formatting the numbers.
        if beams <= MAX_LINE_BYTES / LONGEST_NUMBER - OTHER_FIELDS {
            continue;
        }
        line.clear();
        push_scan(&mut line, scan, placed, is_flaser);
        if line.len() > MAX_LINE_BYTES {
            return Err(WriteError::TooLong { scan: index, beams, bytes: line.len() });
        }
    }
    Ok(())
}

fn write_lines(
    recording: &Recording,
    placed: &[RecordPoses],
    has_reference: bool,
    comments: &[&str],
    sink: &mut impl Write,
) -> io::Result<()> {
    for line in comments.iter().flat_map(|comment| comment.lines()) {
        writeln!(sink, "# {line}")?;
    }
    if has_reference {
        writeln!(sink, "PARAM {REFERENCE_PARAM} recorded 0 nohost 0")?;
    }
    let scans = &recording.scans;
    let is_flaser = are_flaser(scans);
    let mut line = String::new();
    for (index, (scan, placed)) in scans.iter().zip(placed).enumerate() {
        if let Some(odometry) = placed.odometry {
            write_odom(&mut line, sink, odometry, scan.stamp)?;
        }
        line.clear();
        push_scan(&mut line, scan, placed, is_flaser);
        sink.write_all(line.as_bytes())?;
        let next_has_odometry = scans.get(index + 1).is_some_and(|next| next.odometry.is_some());
        if has_reference && next_has_odometry {
            write_odom(&mut line, sink, placed.robot, scan.stamp)?;
        }
    }
    sink.flush()
}

/// Whether `FLASER` records define the beams of all scans.
fn are_flaser(scans: &[LaserScan]) -> bool {
    scans.iter().all(|scan| flaser_geometry(scan.ranges.len()) == Some(scan.geometry))
}

/// Checks that every scan can be written, and returns whether the log has reference poses.
fn check(recording: &Recording) -> Result<bool, WriteError> {
    let scans = &recording.scans;
    if scans.is_empty() {
        return Err(WriteError::NoScan);
    }
    let has_reference = scans.iter().any(|scan| scan.map_from_laser.is_some());
    for (index, scan) in scans.iter().enumerate() {
        let out_of_range = |what| WriteError::OutOfRange { scan: index, what };
        let (readings, beams) = (scan.ranges.len(), scan.geometry.beams);
        if readings != beams || readings == 0 {
            return Err(WriteError::Readings { scan: index, readings, beams });
        }
        if scan.sweep.directions.is_some() {
            return Err(WriteError::Uneven { scan: index });
        }
        if has_reference && scan.map_from_laser.is_none() {
            return Err(WriteError::PartialReference { scan: index });
        }
        if !has_reference && index > 0 && scan.odometry.is_none() {
            return Err(WriteError::NoPose { scan: index });
        }
        if !scan.map_from_laser.is_none_or(is_readable) {
            return Err(out_of_range("reference pose"));
        }
        if !scan.odometry.is_none_or(is_readable) {
            return Err(out_of_range("odometry increment"));
        }
        let ScanGeometry { start_angle, angle_step, .. } = scan.geometry;
        if !is_readable(Pose2::new(0.0, start_angle, angle_step)) {
            return Err(out_of_range("direction of the beams"));
        }
        if let Some(stamp) = scan.stamp.filter(|stamp| stamp.nanoseconds() < 0) {
            return Err(WriteError::NegativeStamp { scan: index, stamp });
        }
    }
    if !is_readable(recording.robot_from_laser) {
        return Err(WriteError::OutOfRange { scan: 0, what: "mount of the laser" });
    }
    Ok(has_reference)
}

/// Whether the reader accepts all three components.
fn is_readable(pose: Pose2) -> bool {
    [pose.x, pose.y, pose.theta].iter().all(|value| value.abs() <= MAX_POSE_COMPONENT)
}

/// A number as it is written: the shortest decimal that reads back as the same number, with an exponent where
/// there would be many zeros.
struct Number(f64);

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Number(value) = self;
        if *value == 0.0 || (1.0 / LARGEST_PLAIN..=LARGEST_PLAIN).contains(&value.abs()) {
            write!(f, "{value}")
        } else {
            write!(f, "{value:e}")
        }
    }
}

fn push_pose(line: &mut String, pose: Pose2) {
    push(line, format_args!(" {} {} {}", Number(pose.x), Number(pose.y), Number(pose.theta)));
}

fn push(line: &mut String, text: fmt::Arguments<'_>) {
    // Writing to a string cannot fail.
    let _ = line.write_fmt(text);
}

fn push_readings(line: &mut String, ranges: &[f64]) {
    push(line, format_args!(" {}", ranges.len()));
    for &range in ranges {
        push(line, format_args!(" {}", Number(if range.is_finite() { range } else { NO_RETURN })));
    }
}

/// Stamp, host and the logger's stamp.
fn push_tail(line: &mut String, stamp: Option<Stamp>) {
    match stamp {
        Some(stamp) => push(line, format_args!(" {stamp} nohost {stamp}\n")),
        None => push(line, format_args!(" {NO_STAMP} nohost {NO_STAMP}\n")),
    }
}

fn write_odom(
    line: &mut String,
    sink: &mut impl Write,
    pose: Pose2,
    stamp: Option<Stamp>,
) -> io::Result<()> {
    line.clear();
    line.push_str("ODOM");
    push_pose(line, pose);
    line.push_str(" 0 0 0");
    push_tail(line, stamp);
    sink.write_all(line.as_bytes())
}

fn push_scan(line: &mut String, scan: &LaserScan, placed: &RecordPoses, is_flaser: bool) {
    let &RecordPoses { laser, robot, .. } = placed;
    if is_flaser {
        push_flaser(line, scan, laser, robot);
    } else {
        push_robot_laser(line, scan, laser, robot);
    }
}

fn push_flaser(line: &mut String, scan: &LaserScan, laser: Pose2, robot: Pose2) {
    line.push_str("FLASER");
    push_readings(line, &scan.ranges);
    push_pose(line, laser);
    push_pose(line, robot);
    push_tail(line, scan.stamp);
}

fn push_robot_laser(line: &mut String, scan: &LaserScan, laser: Pose2, robot: Pose2) {
    let geometry = &scan.geometry;
    let step = geometry.angle_step;
    let field_of_view = Number((geometry.beams as f64 - 1.0) * step.abs());
    let (start, step) = (Number(geometry.start_angle), Number(step));
    push(line, format_args!("ROBOTLASER1 0 {start} {field_of_view} {step} {NO_RETURN} 0 0"));
    push_readings(line, &scan.ranges);
    line.push_str(" 0");
    push_pose(line, laser);
    push_pose(line, robot);
    line.push_str(" 0 0 0 0 0");
    push_tail(line, scan.stamp);
}
