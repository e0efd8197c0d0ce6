//! The records of a CARMEN log, one per line: pure parsing, from bytes to values.
//!
//! The definitions follow the comments that CARMEN's logger writes at the head of its logs.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use mcl_core::{Pose2, ScanGeometry, Stamp};

use super::fields::{Field, Malformed, RecordFields};
use crate::log::options::ReferencePoses;

/// Parameters with the mount of the front laser on the robot: metres ahead of its centre and to the left, and
/// the angle of rotation (radians).
const MOUNT_PARAMS: [(&str, Part); 3] = [
    ("robot_frontlaser_offset", Part::Ahead),
    ("robot_frontlaser_side_offset", Part::Left),
    ("robot_frontlaser_angular_offset", Part::Turned),
];
/// Parameters with the angle that a `FLASER` record covers (radians) and the angle between two of its beams
/// (degrees), and those for `RLASER`.
const FOV_PARAMS: [(&str, Laser); 2] =
    [("laser_front_laser_fov", Laser::Front), ("laser_rear_laser_fov", Laser::Rear)];
const RESOLUTION_PARAMS: [(&str, Laser); 2] =
    [("laser_front_laser_resolution", Laser::Front), ("laser_rear_laser_resolution", Laser::Rear)];
/// Parameter that this suite's writer adds, so that its logs need no guess: whether the laser poses
/// are ground truth (a name of [`ReferencePoses`]).
pub(super) const REFERENCE_PARAM: &str = "mcl_reference_poses";

/// Largest angle that a scan may cover, in turns.
const MAX_TURNS: f64 = 1.01;

/// The kind of a line, by its first word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecordKind {
    /// A scan of the front laser, with implied directions of its beams.
    Flaser,
    /// A scan with explicit directions of its beams (newer CARMEN).
    RobotLaser1,
    /// A scan as reported by the scanner, without a pose.
    RawLaser1,
    /// An odometry reading.
    Odom,
    /// The true pose of a simulated robot.
    TruePos,
    /// A parameter of the robot.
    Param,
    /// A comment or a blank line.
    Comment,
    /// Any other kind, which is not read.
    Other,
}

impl RecordKind {
    /// Whether it is a kind of scan.
    pub(super) fn is_scan(self) -> bool {
        matches!(self, RecordKind::Flaser | RecordKind::RobotLaser1 | RecordKind::RawLaser1)
    }

    /// The kind of a line.
    pub fn of(line: &[u8]) -> Self {
        let line = line.trim_ascii_start();
        let end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
        match &line[..end] {
            b"FLASER" => RecordKind::Flaser,
            b"ROBOTLASER1" => RecordKind::RobotLaser1,
            b"RAWLASER1" => RecordKind::RawLaser1,
            b"ODOM" => RecordKind::Odom,
            b"TRUEPOS" => RecordKind::TruePos,
            b"PARAM" => RecordKind::Param,
            word if word.is_empty() || word[0] == b'#' => RecordKind::Comment,
            _ => RecordKind::Other,
        }
    }
}

/// A laser of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Laser {
    /// The laser of `FLASER` records.
    Front,
    /// The laser of `RLASER` records.
    Rear,
}

/// A component of a laser's mount.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Metres ahead of the robot's centre.
    Ahead,
    /// Metres to the left.
    Left,
    /// Rotation in radians.
    Turned,
}

/// A scan as written in a log.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanRecord {
    /// Directions of the beams.
    pub geometry: ScanGeometry,
    /// One reading per beam (metres), as written; `nan`, `inf` and negative numbers are kept, and a word that
    /// is not a number becomes NaN.
    pub ranges: Vec<f64>,
    /// Number of readings that are not numbers.
    pub unreadable: usize,
    /// The first of them.
    pub first_unreadable: Option<Malformed>,
    /// Pose of the laser: `x y θ` of `FLASER`.
    pub laser: Pose2,
    /// Pose of the robot: `ox oy oθ` of `FLASER`.
    pub robot: Pose2,
    /// Time of the scan; `None` where the number is not a valid time.
    pub stamp: Option<Stamp>,
    /// The angle (radians) that the beams cover, as stated in the record.
    pub fov: Option<f64>,
}

/// The content of one line.
#[derive(Debug, Clone, PartialEq)]
pub enum Record {
    /// `FLASER` or `ROBOTLASER1`.
    Scan(ScanRecord),
    /// `RAWLASER1`; both poses are the origin.
    RawScan(ScanRecord),
    /// `TRUEPOS`: the true pose of the simulated robot.
    TruePos(Pose2),
    /// `PARAM laser_front_laser_fov`: the angle (radians) that a `FLASER` record covers; for the rear laser,
    /// an `RLASER` record.
    LaserFov(Laser, f64),
    /// `PARAM laser_front_laser_resolution`: the angle (radians) between two of its beams.
    LaserResolution(Laser, f64),
    /// `ODOM`: pose of the robot in the frame of its odometry. Velocities and stamp are not used.
    Odom(Pose2),
    /// `PARAM robot_frontlaser_offset`, `…_side_offset` or `…_angular_offset`.
    FrontLaser(Part, f64),
    /// `PARAM mcl_reference_poses`, written by [`super::write`].
    ReferencePoses(ReferencePoses),
    /// A comment, a blank line, or a parameter that is not used.
    Nothing,
    /// A record of a kind that is not read.
    Ignored,
}

/// Parses one line, with or without its line break. Bytes that are not UTF-8 invalidate only the field that
/// contains them.
///
/// # Errors
/// [`Malformed`] with the field at fault, for a record of a known kind.
pub fn parse(line: &[u8]) -> Result<Record, Malformed> {
    let kind = RecordKind::of(line);
    match kind {
        RecordKind::Comment => return Ok(Record::Nothing),
        RecordKind::Other => return Ok(Record::Ignored),
        _ => {}
    }
    let text = String::from_utf8_lossy(line);
    match kind {
        RecordKind::Flaser => flaser(&text).map(Record::Scan),
        RecordKind::RobotLaser1 => robot_laser(&text).map(Record::Scan),
        RecordKind::RawLaser1 => raw_laser(&text).map(Record::RawScan),
        RecordKind::Odom => {
            RecordFields::of("ODOM", &text).pose(["x", "y", "theta"]).map(Record::Odom)
        }
        RecordKind::TruePos => {
            RecordFields::of("TRUEPOS", &text).pose(["x", "y", "theta"]).map(Record::TruePos)
        }
        _ => param(&text),
    }
}

/// Directions of the beams of a `FLASER` record: beam 0 at −90°, in steps of 1° for 180 or 181
/// beams and of 0.5° for 360 or 361; `None` for any other number.
pub(super) fn flaser_geometry(beams: usize) -> Option<ScanGeometry> {
    let step_degrees: f64 = match beams {
        180 | 181 => 1.0,
        360 | 361 => 0.5,
        _ => return None,
    };
    Some(ScanGeometry { start_angle: -FRAC_PI_2, angle_step: step_degrees.to_radians(), beams })
}

/// The rule of CARMEN's own reader for any other number: 100° in steps of 0.25° for 400 or 401 beams, else
/// 180° evenly.
fn other_geometry(beams: usize) -> ScanGeometry {
    let (fov, steps) = match beams {
        400 | 401 => (100_f64.to_radians(), 400),
        _ => (PI, beams.saturating_sub(1).max(1)),
    };
    ScanGeometry { start_angle: -0.5 * fov, angle_step: fov / steps as f64, beams }
}

/// Directions of the beams of a `FLASER` record by the parameters of the log: the angle covered and the angle
/// between two beams, in radians. `None` where there are no parameters, or they imply another number of
/// beams; one of the two suffices where the number of beams implies no directions itself.
pub(super) fn parameter_geometry(
    beams: usize,
    fov: Option<f64>,
    step: Option<f64>,
) -> Option<ScanGeometry> {
    let (closed, open) = (beams.saturating_sub(1) as f64, beams as f64);
    let is_turn = |fov: f64| fov >= TAU * (1.0 - 0.5 / open);
    let (fov, step) = match (fov, step) {
        (Some(fov), Some(step)) => (fov, step),
        _ if flaser_geometry(beams).is_some() => return None,
        (Some(fov), None) => (fov, fov / if is_turn(fov) { open } else { closed }),
        (None, Some(step)) if closed * step <= MAX_TURNS * TAU => (closed * step, step),
        _ => return None,
    };
    let steps = fov / step;
    // The parameters are rounded.
    let angle_step = if (steps - closed).abs() < 0.5 {
        fov / closed
    } else if (steps - open).abs() < 0.5 {
        fov / open
    } else {
        return None;
    };
    let is_angle = angle_step.is_finite() && angle_step > 0.0;
    is_angle.then_some(ScanGeometry { start_angle: -0.5 * fov, angle_step, beams })
}

/// Difference between the angle that the beams cover and the stated one, in steps between two beams.
pub(super) fn steps_off(geometry: &ScanGeometry, fov: f64) -> f64 {
    let covered = geometry.beams.saturating_sub(1) as f64 * geometry.angle_step.abs();
    (covered - fov.abs()).abs() / geometry.angle_step.abs()
}

/// `FLASER n r₁…rₙ x y θ ox oy oθ stamp host logger_stamp`, of which the last three may be missing. The
/// directions are those of a log without parameters.
fn flaser(line: &str) -> Result<ScanRecord, Malformed> {
    let mut fields = RecordFields::of("FLASER", line);
    let beams = fields.count(Field::Named("n"))?;
    if beams == 0 {
        return Err(fields.malformed(Field::Named("n"), "0", "at least 1 beam"));
    }
    // Counted first: one reading too few would shift every later field, and the error would name the wrong
    // one.
    let total = beams.saturating_add(11);
    let missing = 3 - fields.remaining().saturating_sub(beams.saturating_add(6)).min(3);
    let complete = fields.clone();
    let check = |total| check_total(&complete, 2, total, || format!("n = {beams}"));
    check(total - missing).or_else(|_| check(total))?;
    let geometry = flaser_geometry(beams).unwrap_or_else(|| other_geometry(beams));
    let readings = Readings::of(&mut fields, beams);
    // Two readings in one word shift the following fields, which the optional end may hide.
    if let Some(fault) = readings.first_unreadable.as_ref().filter(|_| missing > 0)
        && fault.found.matches('.').count() > 1
    {
        return Err(fault.clone());
    }
    let laser = fields.pose(["x", "y", "theta"])?;
    let robot = fields.pose(["ox", "oy", "otheta"])?;
    let stamp = match fields.stamp_if_any(Field::Named("stamp")) {
        // Then a reading is missing, and not the end.
        Err(_) if missing > 0 => check(total).map(|()| None),
        stamp => stamp,
    }?;
    Ok(readings.scan(geometry, [laser, robot], stamp, None))
}

/// `RAWLASER1 type start_angle fov resolution max_range accuracy remission_mode n r₁…rₙ m e₁…eₘ stamp host
/// logger_stamp`
fn raw_laser(line: &str) -> Result<ScanRecord, Malformed> {
    let mut fields = RecordFields::of("RAWLASER1", line);
    let (geometry, readings, fov) = explicit_scan(&mut fields, 3)?;
    let stamp = fields.stamp(Field::Named("stamp"))?;
    Ok(readings.scan(geometry, [Pose2::IDENTITY; 2], stamp, fov))
}

/// `ROBOTLASER1 type start_angle fov resolution max_range accuracy remission_mode n r₁…rₙ m e₁…eₘ
/// laser_x laser_y laser_θ robot_x robot_y robot_θ tv rv forward_safety side_safety turn_axis stamp
/// host logger_stamp`
fn robot_laser(line: &str) -> Result<ScanRecord, Malformed> {
    let mut fields = RecordFields::of("ROBOTLASER1", line);
    let (geometry, readings, fov) = explicit_scan(&mut fields, 14)?;
    let laser = fields.pose(["laser_x", "laser_y", "laser_theta"])?;
    let robot = fields.pose(["robot_x", "robot_y", "robot_theta"])?;
    fields.pass(5);
    let stamp = fields.stamp(Field::Named("stamp"))?;
    Ok(readings.scan(geometry, [laser, robot], stamp, fov))
}

/// The directions and readings of a record with explicit directions, up to its remission values, which are
/// not used; `after` fields follow them.
fn explicit_scan(
    fields: &mut RecordFields<'_>,
    after: usize,
) -> Result<(ScanGeometry, Readings, Option<f64>), Malformed> {
    fields.pass(1);
    let start_angle = fields.finite(Field::Named("start_angle"))?;
    // Used only to check the others; 0 where it was not set.
    let fov = fields.number(Field::Named("fov")).ok().filter(|fov| fov.is_finite() && *fov != 0.0);
    let angle_step = fields.finite(Field::Named("resolution"))?;
    fields.pass(3);
    let beams = fields.count(Field::Named("n"))?;
    // A count that no line can hold is refused before it is used in arithmetic or for an allocation.
    if beams == 0 || beams > fields.remaining() {
        let expected = format!("at least 1 and at most the {} fields left", fields.remaining());
        return Err(fields.malformed(Field::Named("n"), &beams.to_string(), expected));
    }
    if beams > 1 && angle_step == 0.0 {
        let expected = "the angle between two beams in radians, not 0";
        return Err(fields.malformed(Field::Named("resolution"), "0", expected));
    }
    let turns = angle_step.abs() * (beams - 1) as f64 / TAU;
    if turns > MAX_TURNS {
        let found = format!("{angle_step}, {beams} times: {turns:.1} turns");
        let expected = "at most one turn in radians (are these degrees?)";
        return Err(fields.malformed(Field::Named("resolution"), &found, expected));
    }
    let readings = Readings::of(fields, beams);
    // With a reading too many or too few, another field is read here.
    let remissions = fields.count(Field::Named("m")).map_err(|error| Malformed {
        expected: format!("a count of remission values after n = {beams} readings"),
        ..error
    })?;
    let read = 10 + beams;
    let total = read.saturating_add(after).saturating_add(remissions);
    check_total(fields, read, total, || format!("n = {beams}, m = {remissions}"))?;
    fields.pass(remissions);
    Ok((ScanGeometry { start_angle, angle_step, beams }, readings, fov))
}

/// `PARAM name value …`; parameters that are not used may have any form.
fn param(line: &str) -> Result<Record, Malformed> {
    let mut fields = RecordFields::of("PARAM", line);
    let name = fields.text(Field::Named("name"), "a parameter's name")?;
    let laser_of = |names: [(&'static str, Laser); 2]| names.into_iter().find(|of| of.0 == name);
    if let Some((name, laser)) = laser_of(FOV_PARAMS) {
        let fov = fields.finite(Field::Named(name))?;
        // Radians, though older logs have degrees.
        return Ok(Record::LaserFov(laser, if fov > 7.0 { fov.to_radians() } else { fov }));
    }
    if let Some((name, laser)) = laser_of(RESOLUTION_PARAMS) {
        let degrees = fields.finite(Field::Named(name))?;
        return Ok(Record::LaserResolution(laser, degrees.to_radians()));
    }
    if let Some((name, part)) = MOUNT_PARAMS.into_iter().find(|of| of.0 == name) {
        return fields.finite(Field::Named(name)).map(|value| Record::FrontLaser(part, value));
    }
    match name {
        REFERENCE_PARAM => {
            const EXPECTED: &str = "auto, recorded or none";
            let field = Field::Named(REFERENCE_PARAM);
            let text = fields.text(field, EXPECTED)?;
            text.parse()
                .map(Record::ReferencePoses)
                .map_err(|_| fields.malformed(field, text, EXPECTED))
        }
        _ => Ok(Record::Nothing),
    }
}

/// The readings of a record; one that is not a number does not affect the others.
struct Readings {
    ranges: Vec<f64>,
    unreadable: usize,
    first_unreadable: Option<Malformed>,
}

impl Readings {
    /// The next fields of a record with this number of beams.
    fn of(fields: &mut RecordFields<'_>, beams: usize) -> Self {
        let ranges = Vec::with_capacity(beams);
        let mut readings = Readings { ranges, unreadable: 0, first_unreadable: None };
        for index in 0..beams {
            let reading = fields.number(Field::Reading(index)).unwrap_or_else(|fault| {
                readings.unreadable += 1;
                readings.first_unreadable.get_or_insert(fault);
                f64::NAN
            });
            readings.ranges.push(reading);
        }
        readings
    }

    fn scan(
        self,
        geometry: ScanGeometry,
        [laser, robot]: [Pose2; 2],
        stamp: Option<Stamp>,
        fov: Option<f64>,
    ) -> ScanRecord {
        let Readings { ranges, unreadable, first_unreadable } = self;
        ScanRecord { geometry, ranges, unreadable, first_unreadable, laser, robot, stamp, fov }
    }
}

/// Checks the number of fields of the whole record, of which `read` (kind included) have been read.
fn check_total(
    fields: &RecordFields<'_>,
    read: usize,
    expected: usize,
    because: impl Fn() -> String,
) -> Result<(), Malformed> {
    let found = read + fields.remaining();
    if found == expected {
        return Ok(());
    }
    let expected = format!("{expected} for {}", because());
    Err(fields.malformed(Field::Total, &found.to_string(), expected))
}
