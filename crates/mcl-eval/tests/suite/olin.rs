//! The Olin bag localizes on its own map_server map. There is no ground truth: that the robot is
//! localized shows in how near its scans end to the map, seen from the estimated poses.

use mcl_core::{NearestNeighbors, Pose2, Seed};
use mcl_filter::{FilterSettings, MapDistances, Replay, localize};
use mcl_maps::files::read_map;
use mcl_study::data::options::SourceOptions;
use mcl_study::data::source::LogSource;

/// The laser's pose at the first scan: where the scans, put together by odometry, fit the map best of
/// all places and directions.
const START: Pose2 = Pose2 { x: 6.9, y: -8.35, theta: -2.92 };

#[test]
#[cfg_attr(not(real_data = "olin-mac"), ignore = "needs olin-mac in MCL_DATA_DIR")]
fn the_bag_localizes_on_its_own_map() {
    let folder = std::env::var_os("MCL_DATA_DIR").expect("MCL_DATA_DIR is set");
    let folder = std::path::PathBuf::from(folder).join("olin-mac");
    let bag = folder.join("take2_zstd.mcap");
    let mut options = SourceOptions { max_range: Some(12.0), ..SourceOptions::default() };
    // The scanner turns clockwise, and its driver gives the readings in the reverse of the order in which they were
    // measured, with a positive time between them: placed by it, the scans fit the map worse (a mean of medians of
    // 3.0 cm, 2.2 cm as they are, and 2.2 cm in the reverse order).
    options.read.no_deskew = true;
    let source = LogSource::open(&bag.display().to_string(), &options).unwrap();
    let map = read_map::<2>(folder.join("mac_1st_floor_final.yaml")).unwrap();
    let settings = FilterSettings { max_range: 12.0, ..FilterSettings::default() };
    let settings = settings.check().unwrap();
    let distances = MapDistances::grid(&map, settings.values().max_distance).unwrap();
    let recording = &source.recording;
    let increments: Vec<Option<Pose2>> = recording.scans.iter().map(|scan| scan.odometry).collect();
    let scans: Vec<usize> = (0..recording.scans.len()).collect();
    let replay = Replay { recording, increments: &increments, scans: &scans };
    let neighbors = NearestNeighbors::new(map.points()).unwrap();
    let distances_of = |scan: usize, pose: Pose2| -> Vec<f64> {
        let ends = recording.scans[scan].endpoints(pose, 12.0);
        ends.map(|end| neighbors.nearest(&end).distance_squared.sqrt()).collect()
    };
    for seed in 1..=3 {
        let run = localize(&replay, &distances, &settings, Some(START), Seed::new(seed)).unwrap();
        assert_eq!(run.map_from_laser.len(), recording.scans.len());
        let fits: Vec<Fit> = run
            .map_from_laser
            .iter()
            .enumerate()
            .map(|(scan, &pose)| Fit::of(distances_of(scan, pose)))
            .collect();
        let mean = fits.iter().map(|fit| fit.mean).sum::<f64>() / fits.len() as f64;
        assert!(mean < 0.2, "seed {seed}: {mean} m from the map");
        // Towards the end the robot passes furniture that the map lacks: a fifth of the beams ends
        // there, which says nothing about the pose. The walls are hit in every scan.
        for (scan, fit) in fits.iter().enumerate() {
            assert!(fit.median < 0.1 && fit.near > 0.7, "seed {seed}, scan {scan}: {fit:?}");
        }
        // A tenth of the particles: the motion model spreads them by 5 cm at least from scan to scan, of which a scan
        // leaves 1 or 2 cm.
        let ess = run.reports.iter().map(|report| report.effective_sample_size);
        let mean_ess = ess.sum::<f64>() / run.reports.len() as f64;
        assert!(mean_ess > 50.0, "seed {seed}: effective sample size {mean_ess}");
        // All runs end where the most beams of the last scans, 73 %, end within 5 cm of the map. The furniture, and where
        // σ_hit and the motion model put its beams, decide between places some centimetres apart.
        let end = run.map_from_laser[run.map_from_laser.len() - 1];
        assert!(end.distance(&Pose2::new(9.03, -13.985, 0.0)) < 0.1, "seed {seed}: {end:?}");
        // Half a metre aside the walls are missed: the distances can tell.
        let aside = Pose2::new(end.x + 0.5, end.y + 0.5, end.theta);
        let missed = Fit::of(distances_of(scans.len() - 1, aside));
        assert!(missed.median > 0.1 && missed.near < 0.7, "seed {seed}: {missed:?}");
    }
}

/// How near the endpoints of a scan are to the map.
#[derive(Debug)]
struct Fit {
    mean: f64,
    median: f64,
    /// Share of them within 0.2 m.
    near: f64,
}

impl Fit {
    fn of(mut distances: Vec<f64>) -> Self {
        distances.sort_by(f64::total_cmp);
        let count = distances.len() as f64;
        Fit {
            mean: distances.iter().sum::<f64>() / count,
            median: distances[distances.len() / 2],
            near: distances.iter().filter(|&&distance| distance < 0.2).count() as f64 / count,
        }
    }
}
