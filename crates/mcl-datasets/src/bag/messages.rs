//! The supported messages, as values: scans, odometry, poses and transforms.

use std::f64::consts::TAU;

use mcl_core::{Pose2, ScanGeometry, math};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use sha2::{Digest, Sha256};

use super::cdr::{CdrError, View};
use super::layout::SchemaError;
use crate::log::plane::PoseInSpace;

/// Largest position accepted, in metres; beyond any place on Earth.
pub(super) const MAX_POSITION: f64 = 1e9;
const NANOSECONDS: i64 = 1_000_000_000;

/// Why a message cannot be converted.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum MessageError {
    /// The schema lacks a required field: no message of the topic can be read.
    Schema(SchemaError),
    /// This message is malformed.
    Malformed { field: String, found: String, expected: String },
}

impl From<SchemaError> for MessageError {
    fn from(error: SchemaError) -> Self {
        MessageError::Schema(error)
    }
}

impl From<CdrError> for MessageError {
    fn from(error: CdrError) -> Self {
        malformed("the message", error.to_string(), "a message of its schema")
    }
}

pub(super) fn malformed(
    field: &str,
    found: impl Into<String>,
    expected: impl Into<String>,
) -> MessageError {
    MessageError::Malformed {
        field: field.to_owned(),
        found: found.into(),
        expected: expected.into(),
    }
}

/// `std_msgs/Header`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Header {
    /// Nanoseconds; 0 means that the writer did not set it.
    pub stamp: i64,
    /// Without the leading slash that older writers add.
    pub frame: String,
}

pub(super) fn header(view: &View<'_>) -> Result<Header, MessageError> {
    let header = view.message("header")?;
    let stamp = header.message("stamp")?;
    let (sec, nanosec) = (stamp.number("sec")?, stamp.number("nanosec")?);
    if !(0.0..NANOSECONDS as f64).contains(&nanosec) {
        return Err(malformed("header.stamp.nanosec", nanosec.to_string(), "less than 1000000000"));
    }
    // 32-bit seconds, so there is no overflow.
    let stamp =
        sec.clamp(f64::from(i32::MIN), f64::from(u32::MAX)) as i64 * NANOSECONDS + nanosec as i64;
    Ok(Header { stamp, frame: frame(header.text("frame_id")?) })
}

fn frame(name: &str) -> String {
    name.trim_start_matches('/').to_owned()
}

/// A reading within this relative distance of `range_max` is equal to it, but for the rounding of floats.
const RANGE_MAX_ROUNDING: f64 = 1e-6;
/// Largest angle that a scan may cover, in turns.
const MAX_TURNS: f64 = 1.01;

/// `sensor_msgs/LaserScan`, or another message converted to one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ScanMessage {
    pub header: Header,
    pub geometry: ScanGeometry,
    /// Ranges in metres; below `range_min` they are −∞, beyond `range_max` +∞ (REP 117).
    pub ranges: Vec<f64>,
    /// Number of readings equal to `range_max`, which are +∞ as well: drivers write it where nothing was
    /// detected.
    pub at_max: usize,
    /// Direction of the last beam according to the message (rad).
    pub last_angle: f64,
    /// Time from one beam to the next, in seconds.
    pub time_increment: f64,
    /// Time of a turn of the scanner, in seconds; 0 where not stated.
    pub scan_time: f64,
}

impl ScanMessage {
    pub fn new(view: &View<'_>) -> Result<Self, MessageError> {
        Self::with(view, view.numbers("ranges")?.to_vec())
    }

    /// `sensor_msgs/MultiEchoLaserScan`: the first echo of each beam.
    pub fn multi_echo(view: &View<'_>) -> Result<Self, MessageError> {
        let first = |beam: &View<'_>| Ok(beam.numbers("echoes")?.first().unwrap_or(f64::INFINITY));
        let ranges: Result<_, SchemaError> = view.messages("ranges")?.iter().map(first).collect();
        Self::with(view, ranges?)
    }

    fn with(view: &View<'_>, mut ranges: Vec<f64>) -> Result<Self, MessageError> {
        let header = header(view)?;
        let start_angle = view.number("angle_min")?;
        let angle_step = view.number("angle_increment")?;
        let (min, max) = (view.number("range_min")?, view.number("range_max")?);
        if ranges.is_empty() {
            return Err(malformed("ranges", "empty", "at least one reading"));
        }
        for (name, angle) in [("angle_min", start_angle), ("angle_increment", angle_step)] {
            if !angle.is_finite() {
                return Err(malformed(name, angle.to_string(), "an angle in radians"));
            }
        }
        // In descriptions with 64-bit angles, the sum may be NaN or infinite.
        let geometry = ScanGeometry { start_angle, angle_step, beams: ranges.len() };
        let last = geometry.angle(ranges.len() - 1);
        if !last.is_finite() {
            let found = format!("{angle_step} from {start_angle} on, {} times", ranges.len());
            return Err(malformed("angle_increment", found, "directions that are finite angles"));
        }
        if angle_step == 0.0 && ranges.len() > 1 {
            return Err(malformed("angle_increment", "0", "the angle between two beams, not 0"));
        }
        if (last - start_angle).abs() > MAX_TURNS * TAU {
            let turns = (last - start_angle).abs() / TAU;
            let found = format!("{angle_step} rad, {} times: {turns:.1} turns", ranges.len());
            return Err(malformed(
                "angle_increment",
                found,
                "at most one turn in radians (are these degrees?)",
            ));
        }
        let mut at_max = 0;
        // Drivers that do not know their limits leave both at 0.
        if min < max {
            for range in &mut ranges {
                if *range < min {
                    *range = f64::NEG_INFINITY;
                } else if *range >= max * (1.0 - RANGE_MAX_ROUNDING) {
                    at_max += usize::from(*range <= max);
                    *range = f64::INFINITY;
                }
            }
        }
        // These two fields are optional in a description.
        let last_angle = view.number("angle_max").unwrap_or(last);
        let time_increment = view.number("time_increment").unwrap_or(0.0);
        let scan_time = view.number("scan_time").unwrap_or(0.0);
        Ok(ScanMessage { header, geometry, ranges, at_max, last_angle, time_increment, scan_time })
    }

    /// SHA-256 of its beams.
    pub fn digest(&self) -> [u8; 32] {
        let mut hash = Sha256::new();
        let ScanGeometry { start_angle, angle_step, .. } = self.geometry;
        let fields = [start_angle, angle_step, self.last_angle, self.time_increment];
        for value in fields.iter().chain(&self.ranges) {
            hash.update(value.to_bits().to_le_bytes());
        }
        hash.finalize().into()
    }

    /// Difference between the direction of the last beam that follows from the others and the one that the
    /// message states, in steps between two beams and beyond the rounding of single precision; 0 where it is
    /// not stated.
    pub fn steps_off(&self) -> f64 {
        let ScanGeometry { start_angle, angle_step, beams } = self.geometry;
        let follows = self.geometry.angle(beams - 1);
        let turned = (beams as f64 * angle_step).abs();
        let rounding =
            f64::from(f32::EPSILON) * (start_angle.abs() + self.last_angle.abs() + turned);
        let steps = ((follows - self.last_angle).abs() - rounding).max(0.0) / angle_step.abs();
        if steps.is_finite() { steps } else { 0.0 }
    }
}

/// A stamped pose: `nav_msgs/Odometry`, `geometry_msgs/PoseStamped` or `PoseWithCovarianceStamped`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PoseMessage {
    pub header: Header,
    /// Child frame, where the message has one (`Odometry`).
    pub child: Option<String>,
    /// Projected onto the plane.
    pub pose: Pose2,
    /// What the projection drops.
    pub in_space: PoseInSpace,
    /// Covariance of x, y and heading, along the axes of the header's frame; `None` where the message has
    /// none, or zeros.
    pub covariance: Option<Covariance>,
}

/// Covariance of x, y (m) and heading (rad), row by row.
pub(super) type Covariance = [[f64; 3]; 3];

impl PoseMessage {
    fn at(header: Header, pose: &Isometry3<f64>) -> Self {
        let in_space = in_space_of(pose);
        PoseMessage { header, child: None, pose: planar(pose), in_space, covariance: None }
    }

    /// The pose of the child frame in the parent: `geometry_msgs/TransformStamped`.
    pub fn of(transform: TransformMessage) -> Self {
        let TransformMessage { header, child, parent_from_child } = transform;
        PoseMessage { child: Some(child), ..PoseMessage::at(header, &parent_from_child) }
    }

    pub fn of_odometry(odometry: OdometryMessage) -> Self {
        let OdometryMessage { transform, covariance } = odometry;
        PoseMessage { covariance, ..PoseMessage::of(transform) }
    }

    pub fn pose(view: &View<'_>) -> Result<Self, MessageError> {
        Ok(PoseMessage::at(header(view)?, &pose(&view.message("pose")?)?))
    }

    pub fn pose_with_covariance(view: &View<'_>) -> Result<Self, MessageError> {
        let with_covariance = view.message("pose")?;
        let pose = pose(&with_covariance.message("pose")?)?;
        let covariance = covariance(&with_covariance);
        Ok(PoseMessage { covariance, ..PoseMessage::at(header(view)?, &pose) })
    }
}

/// A `nav_msgs/Odometry`: the transform between its two frames, and the covariance.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct OdometryMessage {
    pub transform: TransformMessage,
    pub covariance: Option<Covariance>,
}

impl OdometryMessage {
    pub fn new(view: &View<'_>) -> Result<Self, MessageError> {
        let child = frame(view.text("child_frame_id")?);
        let with_covariance = view.message("pose")?;
        let parent_from_child = pose(&with_covariance.message("pose")?)?;
        let transform = TransformMessage { header: header(view)?, child, parent_from_child };
        Ok(OdometryMessage { transform, covariance: covariance(&with_covariance) })
    }
}

/// The planar part of a 6 × 6 covariance. Writers that do not know it leave zeros, or a first element of −1.
fn covariance(view: &View<'_>) -> Option<Covariance> {
    const PLANE: [usize; 3] = [0, 1, 5];
    let numbers = view.numbers("covariance").ok()?.to_vec();
    if numbers.len() != 36 {
        return None;
    }
    let covariance = PLANE.map(|row| PLANE.map(|column| numbers[6 * row + column]));
    let is_known = covariance.iter().flatten().all(|value| value.is_finite());
    let variances = [0, 1, 2].map(|axis| covariance[axis][axis]);
    (is_known && variances.iter().all(|variance| *variance > 0.0)).then_some(covariance)
}

/// One transform of a `tf2_msgs/TFMessage`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TransformMessage {
    pub header: Header,
    pub child: String,
    pub parent_from_child: Isometry3<f64>,
}

impl TransformMessage {
    /// All transforms of a message; errors of malformed ones are added to `faults`.
    pub fn all(view: &View<'_>, faults: &mut Vec<MessageError>) -> Result<Vec<Self>, MessageError> {
        let mut transforms = Vec::new();
        for (index, view) in view.messages("transforms")?.iter().enumerate() {
            match Self::one(view) {
                Ok(transform) => transforms.push(transform),
                Err(MessageError::Malformed { field, found, expected }) => {
                    let child = view.text("child_frame_id")?;
                    let field = format!("transforms[{index}] (child {child:?}).{field}");
                    faults.push(MessageError::Malformed { field, found, expected });
                }
                Err(error) => return Err(error),
            }
        }
        Ok(transforms)
    }

    /// `geometry_msgs/TransformStamped`.
    pub fn one(view: &View<'_>) -> Result<Self, MessageError> {
        Ok(TransformMessage {
            header: header(view)?,
            child: frame(view.text("child_frame_id")?),
            parent_from_child: isometry(&view.message("transform")?, "translation", "rotation")?,
        })
    }
}

/// The poses of a `nav_msgs/Path`, each with its stamp; errors of malformed ones are added to `faults`.
pub(super) fn path_poses(
    view: &View<'_>,
    faults: &mut Vec<MessageError>,
) -> Result<Vec<PoseMessage>, MessageError> {
    let frame = header(view)?.frame;
    let mut poses = Vec::new();
    for (index, view) in view.messages("poses")?.iter().enumerate() {
        let pose = PoseMessage::pose(view).and_then(|mut pose| {
            // Many writers leave the frame of the single poses empty.
            if pose.header.frame.is_empty() {
                pose.header.frame.clone_from(&frame);
            }
            match pose.header.stamp {
                1.. => Ok(pose),
                stamp => Err(malformed("header.stamp", stamp.to_string(), "the time of the pose")),
            }
        });
        match pose {
            Ok(pose) => poses.push(pose),
            Err(MessageError::Malformed { field, found, expected }) => {
                let field = format!("poses[{index}].{field}");
                faults.push(MessageError::Malformed { field, found, expected });
            }
            Err(error) => return Err(error),
        }
    }
    Ok(poses)
}

fn pose(view: &View<'_>) -> Result<Isometry3<f64>, MessageError> {
    isometry(view, "position", "orientation")
}

fn isometry(
    view: &View<'_>,
    position: &str,
    rotation: &str,
) -> Result<Isometry3<f64>, MessageError> {
    let vector = view.message(position)?;
    let [x, y, z] = [vector.number("x")?, vector.number("y")?, vector.number("z")?];
    if ![x, y, z].iter().all(|value| value.abs() <= MAX_POSITION) {
        return Err(malformed(position, format!("({x}, {y}, {z})"), "at most 1e9 m from 0"));
    }
    let view = view.message(rotation)?;
    let [i, j, k, w] = [view.number("x")?, view.number("y")?, view.number("z")?, view.number("w")?];
    let quaternion = Quaternion::new(w, i, j, k);
    let norm = quaternion.norm();
    // Writers round; an orientation that was not set is 0.
    if !(0.9..1.1).contains(&norm) {
        return Err(malformed(rotation, format!("({i}, {j}, {k}, {w})"), "a quaternion of norm 1"));
    }
    Ok(Isometry3::from_parts(
        Translation3::new(x, y, z),
        UnitQuaternion::from_quaternion(quaternion),
    ))
}

/// What the projection of a pose onto the plane drops.
pub(super) fn in_space_of(pose: &Isometry3<f64>) -> PoseInSpace {
    let up = (pose.rotation * Vector3::z()).z;
    let tilt_degrees = math::acos(up.clamp(-1.0, 1.0)).to_degrees();
    PoseInSpace { position: pose.translation.vector.into(), tilt_degrees }
}

/// The pose seen from above: position and yaw, which is the direction of the x axis.
pub(super) fn planar(pose: &Isometry3<f64>) -> Pose2 {
    let q = pose.rotation.quaternion();
    let yaw = math::atan2(2.0 * (q.w * q.k + q.i * q.j), 1.0 - 2.0 * (q.j * q.j + q.k * q.k));
    Pose2::new(pose.translation.x, pose.translation.y, yaw)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bag::encode::Encoder;
    use crate::bag::{cdr, schema::MessageSchema};
    use mcl_core::Stamp;

    /// Found by the fuzz target: with 64-bit angles, the direction of the last beam was infinite.
    #[test]
    fn directions_that_are_not_numbers_are_malformed() {
        let text = "std_msgs/Header header\nfloat64 angle_min\nfloat64 angle_increment\n\
            float32 range_min\nfloat32 range_max\nfloat32[] ranges\n===\nMSG: std_msgs/Header\n\
            builtin_interfaces/Time stamp\nstring frame_id\n";
        let schema = MessageSchema::parse("p/A", "ros2msg", text.as_bytes()).unwrap();
        let read = |angles: [f64; 2]| {
            let mut message = Encoder::default();
            message.header(Stamp::from_nanoseconds(1), "laser").f64s(&angles);
            message.f32(0.0).f32(9.0).u32(3).f32(1.0).f32(2.0).f32(3.0);
            let bytes = message.into_bytes();
            let value = cdr::decode(&schema, &bytes).unwrap();
            ScanMessage::new(&View::new(&schema, &value))
        };
        assert_eq!(read([-0.5, 0.25]).unwrap().geometry.angle(2), 0.0);
        let MessageError::Malformed { field, .. } = read([1e308, 1e308]).unwrap_err() else {
            panic!("the schema is right")
        };
        assert_eq!(field, "angle_increment");
    }
}
