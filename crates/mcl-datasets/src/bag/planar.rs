//! The ROS 2 messages of a robot in the plane, encoded for a [`BagWriter`](super::BagWriter).
//!
//! Stamps must be from 0 to 2³¹ s, the range of ROS times; [`check_scans`](super::check_scans) ensures it.

use std::borrow::Cow;

use mcl_core::{LaserScan, Point, Pose2, ScanGeometry, Stamp, wrap_angle};
use nalgebra::Matrix3;

use super::encode::Encoder;

/// `sensor_msgs/PointField`: a 32-bit float.
const FLOAT32: u8 = 7;
const POINT_BYTES: u32 = 12;

/// `tf2_msgs/msg/TFMessage`: poses of child frames in their parents, as `(parent, child, pose)`.
pub fn transforms(stamp: Stamp, edges: &[(&str, &str, Pose2)]) -> Encoder {
    let mut message = Encoder::default();
    message.u32(edges.len() as u32);
    for (parent, child, pose) in edges {
        message.header(stamp, parent).text(child).pose(*pose);
    }
    message
}

/// `sensor_msgs/msg/LaserScan` with the limits `range_min` and `range_max` in metres, without intensities.
/// Readings and angles become 32-bit floats; beams with individual directions are assigned to the nearest
/// even ones.
pub fn laser_scan(
    scan: &LaserScan,
    stamp: Stamp,
    frame: &str,
    (range_min, range_max): (f32, f32),
) -> Encoder {
    let geometry = &scan.geometry;
    let mut message = Encoder::default();
    message
        .header(stamp, frame)
        .f32(geometry.start_angle as f32)
        .f32(geometry.angle(geometry.beams.saturating_sub(1)) as f32)
        .f32(geometry.angle_step as f32)
        .f32(scan.sweep.time_increment as f32)
        // The time between scans is not known.
        .f32(0.0)
        .f32(range_min)
        .f32(range_max)
        .u32(scan.ranges.len() as u32);
    for &range in even(scan).iter() {
        message.f32(range as f32);
    }
    message.u32(0);
    message
}

/// The readings at the even steps of the scan's geometry: for beams with individual directions, the nearest
/// at each step.
fn even(scan: &LaserScan) -> Cow<'_, [f64]> {
    let Some(directions) = &scan.sweep.directions else { return Cow::Borrowed(&scan.ranges) };
    let ScanGeometry { start_angle, angle_step, beams } = scan.geometry;
    let mut nearest = vec![f64::INFINITY; beams];
    for (&range, direction) in scan.ranges.iter().zip(directions) {
        // Wrapped to half a turn on either side of the middle of the scan.
        let middle = 0.5 * angle_step * (beams - 1) as f64;
        let beam = ((wrap_angle(direction - start_angle - middle) + middle) / angle_step).round();
        if range.is_finite() && range > 0.0 && (0.0..beams as f64).contains(&beam) {
            let there = &mut nearest[beam as usize];
            *there = there.min(range);
        }
    }
    Cow::Owned(nearest)
}

/// `geometry_msgs/msg/PoseStamped`.
pub fn pose_stamped(stamp: Stamp, frame: &str, pose: Pose2) -> Encoder {
    let mut message = Encoder::default();
    message.header(stamp, frame).pose(pose);
    message
}

/// `sensor_msgs/msg/PoseWithCovarianceStamped`, from the covariance of (x, y, θ) in m², m·rad and rad². z and
/// the rotations about x and y have none.
pub fn pose_with_covariance(
    stamp: Stamp,
    frame: &str,
    pose: Pose2,
    covariance: &Matrix3<f64>,
) -> Encoder {
    // Indices of x, y and θ among x, y, z and the rotations about x, y and z.
    const PLACES: [usize; 3] = [0, 1, 5];
    let mut all = [0.0; 36];
    for (i, row) in PLACES.iter().enumerate() {
        for (j, column) in PLACES.iter().enumerate() {
            all[6 * row + column] = covariance[(i, j)];
        }
    }
    let mut message = Encoder::default();
    message.header(stamp, frame).pose(pose).f64s(&all);
    message
}

/// `geometry_msgs/msg/PoseArray`.
pub fn pose_array(
    stamp: Stamp,
    frame: &str,
    poses: impl ExactSizeIterator<Item = Pose2>,
) -> Encoder {
    let mut message = Encoder::default();
    message.header(stamp, frame).u32(poses.len() as u32);
    for pose in poses {
        message.pose(pose);
    }
    message
}

/// `sensor_msgs/msg/PointCloud2` of points at height 0: fields x, y and z, 32-bit floats in metres.
pub fn point_cloud(stamp: Stamp, frame: &str, points: &[Point<2>]) -> Encoder {
    let number = points.len() as u32;
    let mut message = Encoder::default();
    message.header(stamp, frame).u32(1).u32(number).u32(3);
    for (index, name) in ["x", "y", "z"].into_iter().enumerate() {
        message.text(name).u32(4 * index as u32).u8(FLOAT32).u32(1);
    }
    message.u8(0).u32(POINT_BYTES).u32(number * POINT_BYTES).u32(number * POINT_BYTES);
    for &[x, y] in points {
        for value in [x as f32, y as f32, 0.0] {
            message.bytes(&value.to_le_bytes());
        }
    }
    // Dense: every point is valid.
    message.u8(1);
    message
}

/// `std_msgs/msg/Float64`.
pub fn float64(value: f64) -> Encoder {
    let mut message = Encoder::default();
    message.f64s(&[value]);
    message
}

#[cfg(test)]
mod tests {
    use super::super::cdr::{self, View};
    use super::super::schema::MessageSchema;
    use super::super::types::{self, MessageType};
    use super::*;

    const STAMP: Stamp = Stamp::from_nanoseconds(3_000_000_004);
    const POSE: Pose2 = Pose2::new(1.0, -2.0, 0.5);

    /// Decodes a message by its description and passes it to `look`; no byte may be left.
    fn decoded(kind: &MessageType, message: Encoder, look: impl FnOnce(View<'_>)) {
        let text = kind.description();
        let schema = MessageSchema::parse(kind.name, "ros2msg", text.as_bytes()).unwrap();
        let bytes = message.into_bytes();
        let (value, read) = cdr::decode_prefix(&schema, &bytes).unwrap();
        assert_eq!(read, bytes.len());
        look(View::new(&schema, &value));
    }

    fn check_header(view: &View<'_>) {
        let header = view.message("header").unwrap();
        let stamp = header.message("stamp").unwrap();
        assert_eq!((stamp.number("sec"), stamp.number("nanosec")), (Ok(3.0), Ok(4.0)));
        assert_eq!(header.text("frame_id"), Ok("map"));
    }

    fn check_pose(pose: &View<'_>) {
        let part = |name: &str, field: &str| pose.message(name).unwrap().number(field).unwrap();
        assert_eq!(["x", "y", "z"].map(|field| part("position", field)), [1.0, -2.0, 0.0]);
        let (sin, cos) = 0.25_f64.sin_cos();
        let rotation = ["x", "y", "z", "w"].map(|field| part("orientation", field));
        assert_eq!(rotation, [0.0, 0.0, sin, cos]);
    }

    #[test]
    fn points_become_floats_at_height_0() {
        let message = point_cloud(STAMP, "map", &[[1.5, -2.25], [0.1, 4.0]]);
        decoded(&types::POINT_CLOUD2, message, |cloud| {
            check_header(&cloud);
            let numbers = ["height", "width", "is_bigendian", "point_step", "row_step", "is_dense"];
            let found = numbers.map(|field| cloud.number(field).unwrap());
            assert_eq!(found, [1.0, 2.0, 0.0, 12.0, 24.0, 1.0]);
            for (index, field) in cloud.messages("fields").unwrap().iter().enumerate() {
                assert_eq!(field.text("name").unwrap(), ["x", "y", "z"][index]);
                let found = ["offset", "datatype", "count"].map(|name| field.number(name).unwrap());
                assert_eq!(found, [4.0 * index as f64, 7.0, 1.0]);
            }
            let values: Vec<f32> = cloud
                .bytes("data")
                .unwrap()
                .chunks_exact(4)
                .map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()))
                .collect();
            assert_eq!(values, [1.5, -2.25, 0.0, 0.1, 4.0, 0.0]);
        });
    }

    #[test]
    fn a_covariance_of_the_plane_has_its_place_among_six() {
        let covariance = Matrix3::new(1.0, 2.0, 3.0, 2.0, 5.0, 6.0, 3.0, 6.0, 9.0);
        let message = pose_with_covariance(STAMP, "map", POSE, &covariance);
        decoded(&types::POSE_WITH_COVARIANCE_STAMPED, message, |estimate| {
            check_header(&estimate);
            let pose = estimate.message("pose").unwrap();
            check_pose(&pose.message("pose").unwrap());
            let mut expected = [0.0; 36];
            for (place, value) in
                [(0, 1.0), (1, 2.0), (5, 3.0), (6, 2.0), (7, 5.0), (11, 6.0), (30, 3.0), (31, 6.0)]
            {
                expected[place] = value;
            }
            expected[35] = 9.0;
            assert_eq!(pose.numbers("covariance").unwrap().to_vec(), expected);
        });
    }

    #[test]
    fn poses_by_number_and_a_plain_number() {
        let message = pose_array(STAMP, "map", [POSE; 3].into_iter());
        decoded(&types::POSE_ARRAY, message, |array| {
            check_header(&array);
            let poses = array.messages("poses").unwrap();
            assert_eq!(poses.len(), 3);
            poses.iter().for_each(check_pose);
        });
        decoded(&types::FLOAT64, float64(0.1), |value| assert_eq!(value.number("data"), Ok(0.1)));
    }
}
