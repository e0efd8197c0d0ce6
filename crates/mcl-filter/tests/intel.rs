//! Tracking a real robot: the Intel Research Lab log. Ignored where `MCL_DATA_DIR` does not hold it.

use std::collections::BTreeMap;
use std::path::Path;

use mcl_core::{LaserScan, PointMap, Pose2, Recording, ScanGeometry, Seed, wrap_angle};
use mcl_filter::{FilterSettings, MapDistances, Proposal, Replay, localize};

/// The corrected log.
fn intel() -> Recording {
    let folder = std::env::var_os("MCL_DATA_DIR").expect("MCL_DATA_DIR is set");
    let path = Path::new(&folder).join("intel-lab/intel.gfs.log");
    let text = std::fs::read_to_string(&path)
        .unwrap_or_else(|error| panic!("cannot read {}: {error}", path.display()));
    let mut scans: Vec<LaserScan> = Vec::new();
    let mut last_odometry = None;
    for line in text.lines() {
        let mut words = line.split_ascii_whitespace();
        let kind = words.next();
        let numbers: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
        let pose =
            |first: usize| Pose2::new(numbers[first], numbers[first + 1], numbers[first + 2]);
        match kind {
            Some("ODOM") => last_odometry = Some(pose(0)),
            Some("FLASER") => {
                let beams = numbers[0] as usize;
                // The odometry restarts at each corrected pose.
                let before = scans.last().and_then(|scan| scan.map_from_laser);
                scans.push(LaserScan {
                    stamp: None,
                    geometry: ScanGeometry {
                        start_angle: -std::f64::consts::FRAC_PI_2,
                        angle_step: 1f64.to_radians(),
                        beams,
                    },
                    ranges: numbers[1..=beams].to_vec(),
                    map_from_laser: Some(pose(1 + beams)),
                    odometry: before.zip(last_odometry).map(|(from, to)| from.between(&to)),
                    sweep: Default::default(),
                });
            }
            _ => {}
        }
    }
    assert_eq!(scans.len(), 910);
    Recording { scans, robot_from_laser: Pose2::IDENTITY }
}

/// The paper's error (eq. 7) with ξ = 0.8.
fn weighted_error(a: &Pose2, b: &Pose2) -> f64 {
    (0.8 * wrap_angle(a.theta - b.theta).powi(2) + 0.2 * a.distance(b).powi(2)).sqrt()
}

fn nearest_to_mean(points: Vec<[f64; 2]>) -> [f64; 2] {
    let mean = [0, 1].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / points.len() as f64);
    let off = |p: &[f64; 2]| (p[0] - mean[0]).hypot(p[1] - mean[1]);
    points.into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap()
}

#[test]
#[cfg_attr(not(real_data = "intel-lab"), ignore = "needs intel-lab in MCL_DATA_DIR")]
fn tracks_the_intel_robot_on_one_percent_of_the_points() {
    let recording = intel();
    let points = recording.points(10.0).unwrap();
    assert_eq!(points.len(), 155_648);
    // About 1 % of the points: in each cell of a grid, the one nearest to the mean.
    let mut cells: BTreeMap<[i64; 2], Vec<[f64; 2]>> = BTreeMap::new();
    for point in points {
        let cell = point.map(|coordinate| (coordinate / 0.48).floor() as i64);
        cells.entry(cell).or_default().push(point);
    }
    let map: Vec<[f64; 2]> = cells.into_values().map(nearest_to_mean).collect();
    eprintln!("{} map points", map.len());
    let map = PointMap::new(map).unwrap();
    let max_distance = FilterSettings::default().max_distance;
    let distances = MapDistances::grid(&map, max_distance).unwrap();
    let increments: Vec<Option<Pose2>> = recording.scans.iter().map(|scan| scan.odometry).collect();
    let scans: Vec<usize> = (0..recording.scans.len()).collect();
    let replay = Replay { recording: &recording, increments: &increments, scans: &scans };
    let start = recording.scans[0].map_from_laser;
    let reference: Vec<Pose2> =
        recording.scans.iter().filter_map(|scan| scan.map_from_laser).collect();
    let [motion, adaptive] = [Proposal::Motion, Proposal::Adaptive].map(|proposal| {
        let settings = FilterSettings { proposal, ..FilterSettings::default() }.check().unwrap();
        [0, 1, 2].map(|seed| {
            let run = localize(&replay, &distances, &settings, start, Seed::new(seed)).unwrap();
            assert_eq!(run.map_from_laser.len(), 910);
            let pairs = run.map_from_laser.iter().zip(&reference);
            pairs.map(|(e, r)| weighted_error(e, r)).sum::<f64>() / 910.0
        })
    });
    eprintln!("mean weighted error on a 1 % map: {motion:.4?}, adaptive proposal {adaptive:.4?}");
    // Dead reckoning is off by 9.7 on average; a lost robot by more than 0.3. Without fuzzy k-means the
    // map itself costs some millimetres.
    assert!(motion.iter().all(|&mean| mean < 0.024), "{motion:?}");
    assert!(adaptive.iter().all(|&mean| mean < 0.021), "{adaptive:?}");
}
