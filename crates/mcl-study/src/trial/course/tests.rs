use std::sync::LazyLock;

use mcl_core::{PointMap, is_usable_range};
use mcl_datasets::simulator::{OfficeSettings, simulate};
use mcl_filter::{FilterSettings, MapDistances, OdometryNoise, Preset, localize};

use super::*;
use crate::data::source::DataSource;
use crate::recipe::disturbance::{Disturbance, People};
use crate::recipe::split::Split;
use crate::trial::division::StudyData;
use crate::trial::tracking::{Tracker, track};

static OFFICE: LazyLock<StudyData> = LazyLock::new(|| {
    let log = LogSource::of_recording(
        "office",
        simulate(&OfficeSettings::default(), Seed::new(1)).unwrap(),
    );
    StudyData::new(DataSource::Log(log))
});

fn log() -> &'static LogSource {
    OFFICE.log().unwrap()
}

fn recipe(run: u32, disturbance: Disturbance) -> RunRecipe {
    RunRecipe {
        localizer: None,
        preset: Preset::Default,
        filter: FilterSettings { particles: 100.into(), ..FilterSettings::default() },
        odometry_noise: OdometryNoise::default(),
        start: Start::Anywhere,
        length: Some(100),
        disturbance,
        run,
    }
}

fn course_of(recipe: &RunRecipe, split: Split) -> Result<Course<'static>> {
    let division = OFFICE.divided(Some(split), None)?;
    let seed = |purpose: &str| Seed::new(5).derive(purpose).derive_index(recipe.run.into());
    Course::of(recipe, log(), division.planar()?, seed)
}

fn course(recipe: &RunRecipe) -> Course<'static> {
    course_of(recipe, Split::Same).unwrap()
}

fn people(share: f64) -> Disturbance {
    Disturbance { people: Some(People { share }), ..Disturbance::default() }
}

fn kidnapped() -> Disturbance {
    let kidnapped = Kidnapped { at: 0.4, distance: 5.0 };
    Disturbance { kidnapped: Some(kidnapped), ..Disturbance::default() }
}

/// Readings of the scans of a course, and of the same scans of the log.
fn readings<'c>(course: &'c Course<'_>) -> impl Iterator<Item = (&'c [f64], &'c [f64])> + 'c {
    course.used.iter().zip(&course.scans).map(|(&place, &scan)| {
        (&course.recording.scans[place].ranges[..], &log().recording.scans[scan].ranges[..])
    })
}

#[test]
fn a_run_over_the_whole_log_sees_the_log_itself() {
    let whole =
        RunRecipe { start: Start::First, length: None, ..recipe(0, Disturbance::default()) };
    let found = course(&whole);
    assert!(matches!(found.recording, Cow::Borrowed(_)));
    let scans = &log().recording.scans;
    assert!(found.increments.iter().zip(scans).all(|(found, scan)| *found == scan.odometry));
    assert_eq!(found.scans, (0..scans.len()).collect::<Vec<_>>());
    assert_eq!((&found.scans, found.carried_off), (&found.used, None));
}

#[test]
fn a_run_begins_anywhere_and_has_its_length() {
    let starts = (0..20).map(|run| {
        let found = course(&recipe(run, Disturbance::default()));
        let first = found.scans[0];
        assert_eq!(found.scans, (first..first + 100).collect::<Vec<_>>());
        for (place, &scan) in found.scans.iter().enumerate() {
            let of_log = &log().recording.scans[scan];
            assert_eq!(Some(found.reference[place]), of_log.map_from_laser);
            assert_eq!(found.recording.scans[place], *of_log);
            assert!(place == 0 || found.increments[place] == of_log.odometry);
        }
        first
    });
    let mut starts: Vec<usize> = starts.collect();
    starts.sort_unstable();
    starts.dedup();
    assert!(starts.len() > 15 && starts[0] < 200 && starts[starts.len() - 1] > 600, "{starts:?}");

    // Of every second scan, with the odometry of those between.
    let found = course_of(&recipe(3, Disturbance::default()), Split::Alternate).unwrap();
    assert!(found.scans.iter().all(|scan| scan % 2 == 1));
    let first = found.scans[0];
    assert_eq!(found.used, (0..100).map(|place| 2 * place).collect::<Vec<_>>());
    assert_eq!(found.increments[1], log().recording.scans[first + 1].odometry);

    let long = RunRecipe { length: Some(1000), ..recipe(0, Disturbance::default()) };
    let message = course_of(&long, Split::Same).map(|_| ()).unwrap_err().to_string();
    assert!(message.starts_with("length is 1000 scans, expected at most the 916"), "{message}");
}

/// Equal to a run on a log that was cut and joined by hand.
#[test]
fn a_kidnapped_robot_goes_on_elsewhere() {
    let recipe = RunRecipe {
        odometry_noise: OdometryNoise { xy: 0.01, theta: 0.01 },
        ..recipe(2, kidnapped())
    };
    let source = &log().recording;
    let odometry: Vec<Option<Pose2>> = source.scans.iter().map(|scan| scan.odometry).collect();
    let seed = |purpose: &str| {
        let seed = Seed::new(1).derive(purpose).derive("office").derive("same");
        seed.derive_index(2)
    };
    let noisy =
        noisy_increments(&odometry, recipe.odometry_noise, seed("experiment-noise")).unwrap();
    let division = OFFICE.divided(Some(Split::Same), None).unwrap();
    let division = division.planar().unwrap();
    let points: Vec<_> = log().points().unwrap().into_iter().step_by(20).collect();
    let settings = recipe.filter.with_max_range(10.0).unwrap();
    let distances = MapDistances::grid(&PointMap::new(points).unwrap(), 2.0).unwrap();
    let tracked =
        track(&recipe, 1, Some(Split::Same), log(), division, &Tracker::Own(&distances)).unwrap();
    assert_eq!((tracked.carried_off, tracked.scans.len()), (Some(40), 100));
    let [from, to] = [tracked.scans[0], tracked.scans[40]];
    assert!(tracked.reference[39].distance(&tracked.reference[40]) >= 5.0);
    let scans = [&source.scans[from..from + 40], &source.scans[to..to + 60]].concat();
    let mut increments = [&noisy[from..from + 40], &noisy[to..to + 60]].concat();
    increments[40] = Some(Pose2::IDENTITY);
    let recording = Recording { scans, robot_from_laser: source.robot_from_laser };
    let all: Vec<usize> = (0..100).collect();
    let replay = Replay { recording: &recording, increments: &increments, scans: &all };
    let start = recording.scans[0].map_from_laser;
    let by_hand = localize(&replay, &distances, &settings, start, seed("filter")).unwrap();
    let by_hand_poses: Vec<_> = by_hand.map_from_laser.iter().copied().map(Some).collect();
    assert_eq!(
        (&tracked.map_from_laser, tracked.reports()),
        (&by_hand_poses, &by_hand.reports[..])
    );
    // The errors are those against the scans that were shown.
    for (place, error) in tracked.errors.iter().enumerate() {
        let truth = recording.scans[place].map_from_laser.unwrap();
        let distance = by_hand.map_from_laser[place].distance(&truth);
        assert!((error.unwrap().translation() - distance).abs() < 1e-12);
    }
    let translations = tracked.translations();
    assert!(translations[40] > 4.0 && translations[39] < 1.0);
}

#[test]
fn a_robot_needs_a_place_to_be_carried_to() {
    let far = |at, distance| Disturbance {
        kidnapped: Some(Kidnapped { at, distance }),
        ..Disturbance::default()
    };
    for (disturbance, expected) in [
        (far(0.5, 1000.0), "kidnapped.distance is 1000 m"),
        (far(0.001, 5.0), "kidnapped.at is 0.001 of 100 scans"),
    ] {
        let found = course_of(&recipe(0, disturbance), Split::Same);
        let message = found.map(|_| ()).unwrap_err().to_string();
        assert!(message.starts_with(expected), "{message}");
    }
}

/// The share is met, in groups of beams as wide as people, who are still there in the next scan.
#[test]
fn readings_end_at_people() {
    for (share, run) in [(0.05, 0), (0.2, 1), (0.4, 2)] {
        let found = course(&recipe(run, people(share)));
        let (mut hits, mut usable, mut groups) = (0, 0, 0);
        let mut directions: Vec<Vec<bool>> = Vec::new();
        for ((with, without), pose) in readings(&found).zip(&found.reference) {
            let is_hit: Vec<bool> = with.iter().zip(without).map(|(a, b)| a != b).collect();
            for (&with, &without) in with.iter().zip(without) {
                let was_usable = is_usable_range(without, 10.0);
                assert!(with == without || !was_usable || with < without);
                assert!(with == without || (0.3..2.5).contains(&with), "{with}");
            }
            hits += is_hit.iter().filter(|&&hit| hit).count();
            usable += with.iter().filter(|&&range| is_usable_range(range, 10.0)).count();
            groups += is_hit.windows(2).filter(|pair| !pair[0] && pair[1]).count();
            // By direction in the map, in degrees.
            let mut seen = vec![false; 360];
            for (beam, _) in is_hit.iter().enumerate().filter(|(_, hit)| **hit) {
                let angle = pose.theta.to_degrees() - 90.0 + beam as f64;
                seen[angle.rem_euclid(360.0) as usize % 360] = true;
            }
            directions.push(seen);
        }
        // The last scan of the last person may exceed it, by the 49 beams of one who is 0.6 m away at most.
        let over = hits as f64 - share * usable as f64;
        assert!((0.0..=49.0).contains(&over), "{share}: {hits} of {usable}");
        // 0.25 m to each side at most 2.5 m away: 11 beams, but for those at the edge or behind others.
        let width = hits as f64 / groups as f64;
        assert!(width > 8.0, "{share}: {width} beams");
        // How often a direction with people has some this many scans later.
        let again = |later: usize| {
            let pairs = directions.iter().zip(&directions[later..]);
            let both =
                pairs.clone().map(|(a, b)| a.iter().zip(b).filter(|(a, b)| **a && **b).count());
            let first = pairs.map(|(a, _)| a.iter().filter(|a| **a).count());
            both.sum::<usize>() as f64 / first.sum::<usize>() as f64
        };
        assert!(again(1) > 1.3 * again(50), "{share}: {} {}", again(1), again(50));
    }
}

/// Disturbances are compared in pairs: they depend on seed and run alone, and a larger share adds people to
/// the same ones.
#[test]
fn disturbances_belong_to_the_run() {
    let of = |recipe: &RunRecipe| -> Vec<Vec<f64>> {
        readings(&course(recipe)).map(|(with, _)| with.to_vec()).collect()
    };
    let lost = Disturbance { lost_beams: Some(0.3), ..people(0.2) };
    let plain = recipe(4, lost.clone());
    let mut other = plain.clone();
    other.filter = FilterSettings { particles: 7.into(), ..Preset::Carmen.settings() };
    assert_eq!(of(&plain), of(&other));
    assert_ne!(of(&plain), of(&recipe(5, lost.clone())));
    let [few, many] = [0.1, 0.3].map(|share| of(&recipe(4, people(share))));
    let pairs = few.iter().flatten().zip(many.iter().flatten());
    assert!(pairs.clone().all(|(few, many)| many <= few || many.is_infinite()));
    // Lost readings are independent of people.
    let [with, without] = [lost, people(0.2)].map(|disturbance| of(&recipe(4, disturbance)));
    let gone = with.iter().flatten().filter(|range| range.is_infinite()).count() as f64;
    let all = with.iter().flatten().count() as f64;
    // Four standard errors of 18,000 readings.
    assert!((gone / all - 0.3).abs() < 4.0 * (0.3 * 0.7 / all).sqrt(), "{gone} of {all}");
    let kept = with.iter().flatten().zip(without.iter().flatten());
    assert!(kept.filter(|(with, _)| with.is_finite()).all(|(with, without)| with == without));
}

#[test]
fn wheels_slip_on_a_share_of_the_steps() {
    let slip = Slip { share: 0.25, factor: 1.5 };
    let whole = RunRecipe {
        start: Start::First,
        length: None,
        ..recipe(0, Disturbance { slip: Some(slip), ..Disturbance::default() })
    };
    let found = course(&whole);
    let mut slipped = 0;
    for (increment, scan) in found.increments.iter().zip(&log().recording.scans) {
        let (Some(found), Some(logged)) = (increment, scan.odometry) else { continue };
        if *found != logged {
            assert_eq!(*found, Pose2::new(1.5 * logged.x, 1.5 * logged.y, logged.theta));
            slipped += 1;
        }
    }
    // Four standard errors of 915 steps.
    assert!((f64::from(slipped) / 915.0 - 0.25).abs() < 0.058, "{slipped}");
}
