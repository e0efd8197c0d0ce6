//! Line segments of known walls.
//!
//! ```text
//! 5 +-----------------+     A room of 8 m × 5 m with a door in the right wall, from y = 2 to 2.9, and
//!   |        /        |     a wall standing in it from (2, 1) to (4, 3).
//!   |      /          .
//!   |    /            |
//! 0 +-----------------+
//!   0                 8
//! ```

use std::f64::consts::{PI, TAU};

use mcl_core::{CoreError, LaserScan, LineSegment, Point, Pose2, Recording, ScanGeometry, Seed};
use mcl_maps::MapError;
use mcl_maps::segments::{SegmentSettings, line_segments};
use proptest::prelude::*;
use rand_distr::{Distribution, Normal};

const MAX_RANGE: f64 = 10.0;
/// Longest first, as maps are.
const WALLS: [[Point<2>; 2]; 6] = [
    [[0.0, 0.0], [8.0, 0.0]],
    [[0.0, 5.0], [8.0, 5.0]],
    [[0.0, 0.0], [0.0, 5.0]],
    [[2.0, 1.0], [4.0, 3.0]],
    [[8.0, 2.9], [8.0, 5.0]],
    [[8.0, 0.0], [8.0, 2.0]],
];

/// Range of a beam to the first wall; larger than any reading if there is none.
fn range(from: Point<2>, angle: f64, [start, end]: [Point<2>; 2]) -> f64 {
    let (sin, cos) = angle.sin_cos();
    let [along_x, along_y] = [end[0] - start[0], end[1] - start[1]];
    let [x, y] = [start[0] - from[0], start[1] - from[1]];
    let across = cos * along_y - sin * along_x;
    let (range, foot) = ((x * along_y - y * along_x) / across, (x * sin - y * cos) / across);
    if range > 0.0 && (0.0..=1.0).contains(&foot) { range } else { f64::INFINITY }
}

/// A full turn with one beam per degree, readings with Gaussian noise (m).
fn scan(pose: Pose2, noise: f64, seed: u64) -> LaserScan {
    let geometry = ScanGeometry { start_angle: -PI, angle_step: TAU / 360.0, beams: 360 };
    let (normal, mut rng) = (Normal::new(0.0, noise).unwrap(), Seed::new(seed).rng());
    let ranges = (0..geometry.beams).map(|beam| {
        let seen = |wall| range([pose.x, pose.y], pose.theta + geometry.angle(beam), wall);
        WALLS.map(seen).into_iter().fold(f64::INFINITY, f64::min) + normal.sample(&mut rng)
    });
    LaserScan {
        stamp: None,
        geometry,
        ranges: ranges.collect(),
        map_from_laser: Some(pose),
        odometry: None,
        sweep: Default::default(),
    }
}

/// Scans from 15 positions around the free-standing wall.
fn room(noise: f64) -> Recording {
    let scans = (0..15).map(|i| {
        let (sin, cos) = (TAU * f64::from(i) / 15.0).sin_cos();
        let pose = Pose2::new(3.5 + 2.6 * cos, 2.3 + 1.7 * sin, f64::from(i));
        scan(pose, noise, i as u64)
    });
    Recording { scans: scans.collect(), robot_from_laser: Pose2::IDENTITY }
}

fn settings(tolerance: f64) -> SegmentSettings {
    SegmentSettings::of_tolerance(tolerance)
}

fn distance(a: Point<2>, b: Point<2>) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[test]
fn each_wall_is_found_once() {
    for (noise, tolerance) in [(0.0, 0.02), (0.01, 0.05), (0.02, 0.1)] {
        let map = line_segments(&room(noise), MAX_RANGE, &settings(tolerance)).unwrap();
        let found = map.segments();
        assert_eq!(found.len(), WALLS.len(), "noise {noise} m: {found:?}");
        for [start, end] in WALLS {
            let ends = |s: &LineSegment| {
                let straight = distance(s.start, start).max(distance(s.end, end));
                straight.min(distance(s.start, end).max(distance(s.end, start)))
            };
            let off = found.iter().map(ends).fold(f64::INFINITY, f64::min);
            // At 6 m beams are 0.1 m apart: a wall ends between two of them.
            assert!(off < 0.1, "noise {noise} m, {start:?} to {end:?}: {off} m in {found:?}");
        }
        assert!(found.is_sorted_by(|a, b| a.length() >= b.length()));
    }
}

/// Averages of many points are better than any of them.
#[test]
fn lines_are_fit_through_all_points() {
    let map = line_segments(&room(0.02), MAX_RANGE, &settings(0.1)).unwrap();
    let [longest, ..] = map.segments() else { panic!("no segment") };
    let height = if longest.start[1] < 1.0 { 0.0 } else { 5.0 };
    for end in [longest.start, longest.end] {
        assert!((end[1] - height).abs() < 0.01, "{end:?}");
    }
}

#[test]
fn the_order_of_scans_does_not_matter() {
    let log = room(0.02);
    let map = line_segments(&log, MAX_RANGE, &settings(0.05)).unwrap();
    let mut reversed = log.clone();
    reversed.scans.reverse();
    let mut turned = log;
    turned.scans.rotate_left(4);
    for other in [reversed, turned] {
        assert_eq!(line_segments(&other, MAX_RANGE, &settings(0.05)).unwrap(), map);
    }
}

#[test]
fn settings_do_what_they_say() {
    let log = room(0.01);
    let with = |settings| line_segments(&log, MAX_RANGE, &settings).unwrap().segments().len();
    let usual = settings(0.05);
    // Gaps as wide as the door join its sides; 8 m are longer than all but the walls along x.
    assert_eq!(with(SegmentSettings { max_gap: 1.0, ..usual }), WALLS.len() - 1);
    assert_eq!(with(SegmentSettings { min_length: 7.0, ..usual }), 2);
    // All points are on some wall, but none is on one of them with half of all.
    let half = log.points(MAX_RANGE).unwrap().len() / 2;
    let refused = line_segments(&log, MAX_RANGE, &SegmentSettings { min_points: half, ..usual });
    assert_eq!(refused, Err(MapError::NoSegment { min_length: 0.3, min_points: half }));
    // A tolerance below the noise leaves bits of walls.
    assert!(with(settings(0.005)) > 2 * WALLS.len());
}

#[test]
fn what_makes_no_map() {
    let log = room(0.01);
    for wrong in [
        settings(0.0),
        settings(f64::NAN),
        SegmentSettings { max_gap: 0.0, ..settings(0.1) },
        SegmentSettings { min_length: -1.0, ..settings(0.1) },
        SegmentSettings { min_length: f64::INFINITY, ..settings(0.1) },
        SegmentSettings { min_points: 0, ..settings(0.1) },
    ] {
        let refused = line_segments(&log, MAX_RANGE, &wrong);
        assert!(matches!(refused, Err(MapError::Setting { .. })), "{wrong:?}");
    }
    let refused = |log: &Recording| line_segments(log, MAX_RANGE, &settings(0.1)).unwrap_err();
    let mut lost = log.clone();
    lost.scans[3].map_from_laser = None;
    assert_eq!(refused(&lost), MapError::Points(CoreError::NoReference { scan: 3 }));
    lost.scans[3].map_from_laser = Some(Pose2::new(f64::NAN, 0.0, 0.0));
    assert!(matches!(refused(&lost), MapError::Points(CoreError::NonFinite { axis: 0, .. })));
    let empty = Recording { scans: Vec::new(), ..log };
    assert!(refused(&empty).to_string().contains("larger tolerance"));
}

proptest! {
    /// Whatever the readings are, segments are finite and long enough, and each is near points.
    #[test]
    fn any_readings_make_segments_or_none(
        ranges in prop::collection::vec(
            prop_oneof![0.1..9.0f64, 4.0..4.2f64, Just(0.0), Just(f64::NAN), Just(1.0)], 1..300),
        scans in 1..4usize,
        tolerance in prop::sample::select(vec![1e-9, 0.05, 0.5, 20.0]),
        max_gap in prop::sample::select(vec![0.1, 1.0, 30.0]),
        far in prop::sample::select(vec![0.0, 1e9, 1e12]),
    ) {
        let geometry = ScanGeometry { start_angle: -PI, angle_step: 0.021, beams: ranges.len() };
        let scans = (0..scans).map(|i| LaserScan {
            stamp: None,
            geometry,
            ranges: ranges.clone(),
            map_from_laser: Some(Pose2::new(far - 20.0, 0.1 * i as f64, 0.02 * i as f64)),
            odometry: None, sweep: Default::default(), });
        let log = Recording { scans: scans.collect(), robot_from_laser: Pose2::IDENTITY };
        let settings = SegmentSettings { tolerance, max_gap, min_length: 0.0, min_points: 3 };
        match line_segments(&log, MAX_RANGE, &settings) {
            Ok(map) => {
                let points = log.points(MAX_RANGE).unwrap();
                prop_assert!(3 * map.segments().len() <= points.len());
                for end in map.segments().iter().flat_map(|s| [s.start, s.end]) {
                    // An end is a point moved onto its line, by at most the tolerance; the line is then fitted again.
                    let nearest = points.iter().map(|p| distance(*p, end)).fold(f64::INFINITY, f64::min);
                    prop_assert!(nearest <= 3.0 * tolerance + 1e-14 * far + 1e-9, "{nearest}");
                }
            }
            Err(error) => prop_assert!(matches!(error, MapError::NoSegment { .. }), "{error}"),
        }
    }
}
