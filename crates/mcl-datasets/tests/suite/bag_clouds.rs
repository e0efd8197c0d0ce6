//! Point clouds of bags: decoding, joining, and messages made to harm.

use std::f64::consts::FRAC_1_SQRT_2;

use crate::bag_support::*;
use mcl_core::{Point, Stamp};
use mcl_datasets::bag::types::POINT_CLOUD2;
use mcl_datasets::bag::{BagCloud, BagError, CloudOptions, Encoder, MAX_CLOUD_BYTES, read_clouds};
use proptest::prelude::*;

/// A cloud as a driver lays it out; the default is `width` × `height` little-endian floats without padding.
#[derive(Clone)]
struct Layout {
    frame: &'static str,
    height: u32,
    width: u32,
    /// Name, offset, datatype, count.
    fields: Vec<(&'static str, u32, u8, u32)>,
    is_big_endian: bool,
    point_step: u32,
    row_step: u32,
    data: Vec<u8>,
}

impl Layout {
    fn of(points: &[[f32; 3]]) -> Self {
        Layout {
            frame: "lidar",
            height: 1,
            width: points.len() as u32,
            fields: vec![("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)],
            is_big_endian: false,
            point_step: 12,
            row_step: 12 * points.len() as u32,
            data: points.iter().flatten().flat_map(|value| value.to_le_bytes()).collect(),
        }
    }

    fn on(&self, topic: &'static str, at: i64) -> Entry {
        let mut message = Encoder::default();
        message.header(Stamp::from_nanoseconds(at), self.frame).u32(self.height).u32(self.width);
        message.u32(self.fields.len() as u32);
        for &(name, offset, datatype, count) in &self.fields {
            message.text(name).u32(offset).u8(datatype).u32(count);
        }
        message.u8(u8::from(self.is_big_endian)).u32(self.point_step).u32(self.row_step);
        message.u32(self.data.len() as u32).bytes(&self.data).u8(0);
        entry(topic, &POINT_CLOUD2, at, message)
    }
}

fn clouds(entries: &[Entry]) -> Result<BagCloud, BagError> {
    read_clouds(&*bag(entries), &CloudOptions::default())
}

fn read_one(layout: &Layout) -> BagCloud {
    clouds(&[layout.on("/points", SECOND)]).unwrap()
}

#[test]
fn points_of_the_plainest_cloud() {
    let found = read_one(&Layout::of(&[[1.0, 2.0, 3.0], [-4.5, 0.0, 0.25]]));
    assert_eq!(found.points, [[1.0, 2.0, 3.0], [-4.5, 0.0, 0.25]]);
    assert_eq!((found.topic.as_str(), found.frame.as_str(), found.clouds), ("/points", "lidar", 1));
    assert!(found.report.is_complete() && found.assumptions.is_empty());
    // An empty cloud is one, too.
    assert_eq!(read_one(&Layout::of(&[])).points.len(), 0);
}

#[test]
fn any_offsets_types_byte_orders_and_padding() {
    let points: [Point<3>; 6] =
        std::array::from_fn(|k| [k as f64, 0.1 + k as f64, -1.0 / (k as f64 + 1.0)]);
    for is_big_endian in [false, true] {
        // Two rows of three points: z (double), a byte of ring, x (float), 3 bytes of nothing, y (double).
        let (point_step, row_step) = (26_u32, 26 * 3 + 5);
        let mut data = vec![0xee; 2 * row_step as usize];
        for (index, point) in points.iter().enumerate() {
            let start = (index / 3) * row_step as usize + (index % 3) * point_step as usize;
            let mut put = |offset: usize, little: &[u8]| {
                let mut bytes = little.to_vec();
                if is_big_endian {
                    bytes.reverse();
                }
                data[start + offset..][..bytes.len()].copy_from_slice(&bytes);
            };
            put(0, &point[2].to_le_bytes());
            put(9, &(point[0] as f32).to_le_bytes());
            put(16, &point[1].to_le_bytes());
        }
        let layout = Layout {
            height: 2,
            width: 3,
            // A field of a type that nobody knows is nobody's business.
            fields: vec![("y", 16, 8, 1), ("ring", 8, 42, 7), ("x", 9, 7, 1), ("z", 0, 8, 1)],
            is_big_endian,
            point_step,
            row_step,
            data,
            ..Layout::of(&[])
        };
        assert_eq!(read_one(&layout).points, points, "{is_big_endian}");
    }
}

#[test]
fn points_that_are_not_measurements_are_left_out_and_counted() {
    let (nan, inf) = (f32::NAN, f32::INFINITY);
    let layout =
        Layout::of(&[[nan, nan, nan], [3.0, 0.0, 4.0], [0.0; 3], [1.0, inf, 0.0], [0.0, 5.1, 0.0]]);
    let found = read_one(&layout);
    assert_eq!(found.points.len(), 3);
    assert_eq!((found.not_finite, found.out_of_range), (2, 0));
    let near = CloudOptions { max_range: Some(5.0), ..CloudOptions::default() };
    let found = read_clouds(&*bag(&[layout.on("/points", SECOND)]), &near).unwrap();
    assert_eq!(found.points, [[3.0, 0.0, 4.0]]);
    assert_eq!((found.not_finite, found.out_of_range), (2, 2));
}

#[test]
fn clouds_are_joined_where_the_scanner_was() {
    let half = FRAC_1_SQRT_2;
    let cloud = Layout::of(&[[1.0, 0.0, 0.0]]);
    let mount =
        transform_on("/tf_static", 1, "base_link", "lidar", [0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0]);
    let odom = |at: i64, x: f64, [k, w]: [f64; 2]| {
        transform_on("/tf", at, "odom", "base_link", [x, 0.0, 0.0, 0.0, 0.0, k, w])
    };
    let entries = [
        cloud.on("/points", 1),
        mount.clone(),
        odom(SECOND, 0.0, [0.0, 1.0]),
        cloud.on("/points", SECOND),
        cloud.on("/points", SECOND + SECOND / 2),
        odom(2 * SECOND, 4.0, [half, half]),
        cloud.on("/points", 2 * SECOND),
    ];
    let found = clouds(&entries).unwrap();
    let expected = [[1.0, 0.0, 2.0], [2.0 + half, half, 2.0], [4.0, 1.0, 2.0]];
    assert_eq!((found.points.len(), found.clouds, found.frame.as_str()), (3, 3, "odom"));
    for (point, expected) in found.points.iter().zip(expected) {
        assert!((0..3).all(|axis| (point[axis] - expected[axis]).abs() < 1e-12), "{point:?}");
    }
    assert!(found.assumptions.join("\n").contains("left out"), "{:?}", found.assumptions);

    // Odometry gives the same, where /tf does not.
    let entries = [
        mount,
        odometry(SECOND, 1.0, 0.0, 0.0),
        cloud.on("/points", SECOND),
        odometry(2 * SECOND, 3.0, 0.0, 0.0),
        cloud.on("/points", 2 * SECOND),
    ];
    assert_eq!(clouds(&entries).unwrap().points, [[2.0, 0.0, 2.0], [4.0, 0.0, 2.0]]);
}

#[test]
fn clouds_without_a_place_are_refused_unless_they_need_none() {
    let cloud = Layout::of(&[[1.0, 0.0, 0.0]]);
    let error = clouds(&[cloud.on("/points", 1), cloud.on("/points", 2)]).unwrap_err();
    assert_says(&error, &["/points has 2 clouds in frame \"lidar\"", "/tf", "one cloud"]);
    // Clouds before all transforms have none either.
    let tf = |at| transform_on("/tf", at, "odom", "lidar", [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    let late = [cloud.on("/points", 1), cloud.on("/points", 2), tf(5), tf(6)];
    assert_says(&clouds(&late).unwrap_err(), &["before the first or after the last transform"]);
    // Registered clouds, and a scanner that a static transform fixes to the map.
    let map = Layout { frame: "map", ..cloud.clone() };
    assert_eq!(clouds(&[map.on("/points", 1), map.on("/points", 2)]).unwrap().points.len(), 2);
    let tripod = transform_on("/tf_static", 1, "map", "lidar", [9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    let fixed = clouds(&[tripod, cloud.on("/points", 1), cloud.on("/points", 2)]).unwrap();
    assert_eq!(fixed.points.len(), 2);
    assert_eq!(clouds(&[cloud.on("/points", 1)]).unwrap().points.len(), 1);
}

#[test]
fn topics_are_chosen_and_laser_bags_do_not_keep_clouds() {
    let cloud = Layout::of(&[[1.0, 0.0, 0.0]]);
    let two = [cloud.on("/front", 1), cloud.on("/back", 1)];
    assert_says(&clouds(&two).unwrap_err(), &["/front", "/back", "--cloud-topic"]);
    let back = CloudOptions { topic: Some("/back".to_owned()), ..CloudOptions::default() };
    assert_eq!(read_clouds(&*bag(&two), &back).unwrap().topic, "/back");
    let scan_topic = CloudOptions { topic: Some("/scan".to_owned()), ..CloudOptions::default() };
    let mut walk = walk(3);
    let error = read_clouds(&*bag(&walk), &scan_topic).unwrap_err();
    assert_says(&error, &["/scan", "LaserScan", "PointCloud2"]);
    assert_says(&clouds(&walk).unwrap_err(), &["no sensor_msgs/msg/PointCloud2", "/scan"]);
    walk.push(cloud.on("/points", SECOND));
    let log = read(&bag(&walk));
    assert_eq!((log.recording.scans.len(), log.report.ignored), (3, 1));
}

/// What is said of a cloud that is wrong in one way, beside a good one.
#[track_caller]
fn assert_skipped(wrong: impl FnOnce(&mut Layout), parts: &[&str]) {
    let good = Layout { frame: "map", ..Layout::of(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]) };
    let mut bad = good.clone();
    wrong(&mut bad);
    let found = clouds(&[good.on("/points", 1), bad.on("/points", 2)]).unwrap();
    assert_eq!((found.points.len(), found.report.skipped), (2, 1), "{parts:?}");
    let report = found.report.to_string();
    for part in parts.iter().chain(&["/points", "PointCloud2 2 skipped"]) {
        assert!(report.contains(part), "no {part:?} in: {report}");
    }
    // Alone it leaves nothing, and the error says why.
    assert_says(&clouds(&[bad.on("/points", 2)]).unwrap_err(), &[parts[0]]);
}

#[test]
fn malformed_clouds_say_what_is_wrong() {
    assert_skipped(
        |cloud| cloud.data.truncate(23),
        &["data is 23 bytes long", "at least 1 rows of 24 bytes"],
    );
    assert_skipped(|cloud| cloud.height = u32::MAX, &["data is 24 bytes", "4294967295 rows"]);
    assert_skipped(
        |cloud| (cloud.width, cloud.row_step) = (u32::MAX, u32::MAX),
        &["row_step is 4294967295", "4294967295 points of 12 bytes"],
    );
    assert_skipped(|cloud| cloud.row_step = 23, &["row_step is 23", "2 points of 12 bytes"]);
    assert_skipped(|cloud| cloud.point_step = 11, &["fields[z].offset is 8, for 4 bytes", "11"]);
    assert_skipped(|cloud| cloud.point_step = 0, &["fields[x].offset is 0"]);
    assert_skipped(|cloud| cloud.fields[1].1 = u32::MAX, &["fields[y].offset is 4294967295"]);
    assert_skipped(|cloud| cloud.fields.truncate(2), &["fields is [x, y]", "x, y and z"]);
    assert_skipped(|cloud| cloud.fields[2].0 = "x", &["fields is two named \"x\""]);
    assert_skipped(|cloud| cloud.fields[0].2 = 4, &["fields[x].datatype is 4 (UINT16)", "FLOAT32"]);
    assert_skipped(|cloud| cloud.fields[0].2 = 0, &["fields[x].datatype is 0 (no type known)"]);
    assert_skipped(|cloud| cloud.fields[0].2 = 255, &["fields[x].datatype is 255"]);
    assert_skipped(|cloud| cloud.fields[0].3 = 3, &["fields[x].count is 3, expected 1"]);
    assert_skipped(|cloud| cloud.fields[2].1 = 6, &["offsets 0, 4 and 6", "do not overlap"]);
}

#[test]
fn a_cloud_of_another_frame_or_beyond_all_sizes_is_skipped() {
    let cloud = Layout { frame: "map", ..Layout::of(&[[1.0; 3]]) };
    let other = Layout { frame: "lidar", ..cloud.clone() };
    let found = clouds(&[cloud.on("/points", 1), other.on("/points", 2)]).unwrap();
    assert_eq!((found.points.len(), found.report.skipped), (1, 1));
    assert!(found.report.to_string().contains("\"lidar\", expected \"map\""));
    let mut huge = cloud.on("/points", 2);
    huge.data.resize(MAX_CLOUD_BYTES + 1, 0);
    let found = clouds(&[cloud.on("/points", 1), huge]).unwrap();
    assert!(found.report.to_string().contains(&format!("at most {MAX_CLOUD_BYTES}")));
}

#[test]
fn a_message_that_is_cut_anywhere_is_skipped() {
    let whole = Layout::of(&[[1.0, 2.0, 3.0]]).on("/points", 1);
    // The last byte is is_dense, which is the end of the message.
    for end in 0..whole.data.len() {
        let cut = Entry { data: whole.data[..end].to_vec(), ..whole.clone() };
        assert_says(&clouds(&[cut]).unwrap_err(), &["no sensor_msgs/msg/PointCloud2", "skipped"]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn no_bytes_do_harm(at in 4_usize..200, bytes in proptest::collection::vec(any::<u8>(), 1..8)) {
        let mut entry = Layout::of(&[[1.0, 2.0, 3.0]; 4]).on("/points", 1);
        let length = entry.data.len();
        for (offset, byte) in bytes.into_iter().enumerate() {
            entry.data[(at + offset) % length] = byte;
        }
        // Whatever comes of it, at most the points that the bytes could hold.
        if let Ok(found) = clouds(&[entry]) {
            prop_assert!(found.points.len() + found.not_finite <= length / 12);
        }
    }
}
