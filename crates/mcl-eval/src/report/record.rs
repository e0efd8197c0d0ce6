//! A recording of a run for playback on a page: some of its scans, each with the particles, the beams, the
//! poses and the error.

use anyhow::{Context, Result, bail, ensure};
use mcl_core::{Bounds, Point, Pose2, Recording, is_usable_range, math};
use mcl_filter::{Particles, Replay, Step};
use mcl_metrics::{PoseError, WeightedPoseError};
use mcl_study::trial::map::{Shape, obstacle_grid};
use serde::{Deserialize, Serialize};

use crate::report::pack::{self, ABSENT, Packer, Steps};

/// Largest number of scans shown.
pub const MOST_FRAMES: usize = 250;
/// Number of particles shown per scan, drawn by their weights with systematic sampling.
pub const PARTICLES: usize = 40;
/// Largest number of beams shown per scan.
pub const MOST_BEAMS: usize = 60;
/// Largest number of poses shown of a path.
pub const MOST_PATH_POSES: usize = 1_500;
/// Largest number of points shown of a map; for a map of lines, of their ends.
pub const MOST_MAP_POINTS: usize = 6_000;
/// The format identifier in the file of a recorded run.
const FORMAT: &str = "mcl-eval recorded run 1";
/// Ending of the files of recorded runs.
pub const RECORDED_END: &str = ".watch.json";
/// Unit of a range (m).
const RANGE_STEP: f64 = 0.01;

/// The appearance of a map.
#[derive(Debug, Clone, Default)]
pub struct MapLooks {
    /// Points, or ends of lines in pairs.
    pub points: Vec<Point<2>>,
    /// Whether they are ends of lines.
    pub are_lines: bool,
    /// Number of elements of the map: points, lines, Gaussians or occupied cells.
    pub size: usize,
}

impl MapLooks {
    /// From points.
    pub fn of_points(points: &[Point<2>]) -> Self {
        let size = points.len();
        let points = pack::thinned(points, MOST_MAP_POINTS).collect();
        MapLooks { points, are_lines: false, size }
    }

    /// From a map of a study: for NDT maps the means are shown, for grids the occupied cells that beams end
    /// on.
    ///
    /// # Errors
    /// When a grid has no such cells.
    pub fn of(shape: &Shape<2>) -> Result<Self> {
        Ok(match shape {
            Shape::Points(built) => Self::of_points(built.map.points()),
            Shape::Grid(grid) => Self::of_points(obstacle_grid(grid).surface_points()?.points()),
            Shape::Ndt { map, .. } => {
                let means: Vec<_> = map.cells().iter().map(|cell| cell.mean).collect();
                Self::of_points(&means)
            }
            Shape::Segments(map) => {
                let segments = map.segments();
                let shown = pack::thinned(segments, MOST_MAP_POINTS / 2);
                let points = shown.flat_map(|segment| [segment.start, segment.end]).collect();
                MapLooks { points, are_lines: true, size: segments.len() }
            }
        })
    }
}

/// A run for playback on a page.
///
/// `data` holds, by [`Packer`]: per shown scan the time (`u32`, ms), the scan's number in the log and the number of
/// poses of the paths until then (`u32`); x, y, θ of the
/// reference and of the estimate (`i16`, all x first; [`ABSENT`] without a reference); the weighted error, that of
/// translation and of heading, and the largest weighted error since the shown scan before (`f32`, NaN without a
/// reference); the number of particles (`u32`); Δx, Δy of the shown particles from the estimate (`i16`) and their
/// headings (`u8`); direction (`i16`) and range (`u16`, cm; 0 for none) of the shown beams. Then x and y of the
/// reference's path, of the estimate's path and of the map's points (`i16`). All poses are the laser's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedRun {
    format: String,
    /// A description of the run.
    pub label: String,
    /// Number of shown scans, of `scans`.
    pub frames: usize,
    /// Number of scans of the run.
    pub scans: usize,
    /// Number of particles per shown scan.
    pub particles: usize,
    /// Number of beams per shown scan.
    pub beams: usize,
    /// Number of poses of each path.
    pub path_poses: usize,
    /// Number of shown points of the map.
    pub map_points: usize,
    /// Number of elements of the map.
    pub map_size: usize,
    /// Whether the map's points are ends of lines, in pairs.
    pub map_is_lines: bool,
    /// Whether times are from stamps; otherwise they count scans, as seconds.
    pub is_stamped: bool,
    /// The origin of the coordinates (m).
    pub origin: [f64; 2],
    /// Unit of the coordinates (m).
    pub step_m: f64,
    /// Means over the scans that have a reference: weighted error, translation (m), heading (rad).
    pub mean_errors: Option<[f64; 3]>,
    /// The packed arrays.
    pub data: String,
}

impl RecordedRun {
    /// Parses the output of [`RecordedRun::to_json`], which may have been changed by others.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(json: &str) -> Result<Self> {
        let run: RecordedRun = serde_json::from_str(json)?;
        ensure!(run.format == FORMAT, "format is {:?}, expected {FORMAT:?}", run.format);
        let limits = [
            ("frames", run.frames, 1..=MOST_FRAMES),
            ("particles", run.particles, 1..=PARTICLES),
            ("beams", run.beams, 0..=MOST_BEAMS),
            ("path_poses", run.path_poses, 1..=MOST_PATH_POSES),
            ("map_points", run.map_points, 0..=MOST_MAP_POINTS),
        ];
        for (name, value, expected) in limits {
            ensure!(expected.contains(&value), "{name} is {value}, expected {expected:?}");
        }
        let numbers = run.origin.iter().chain(run.mean_errors.iter().flatten());
        ensure!(
            numbers.clone().all(|number| number.is_finite()) && run.step_m > 0.0,
            "origin, step_m and mean_errors have to be numbers"
        );
        let per_frame = 3 * 4 + 6 * 2 + 4 * 4 + 4 + run.particles * 5 + run.beams * 4;
        pack::check(&run.data, run.frames * per_frame + (2 * run.path_poses + run.map_points) * 4)?;
        Ok(run)
    }

    /// Its text.
    ///
    /// # Errors
    /// When memory is exhausted.
    pub fn to_json(&self) -> Result<String> {
        Ok(serde_json::to_string(self)?)
    }
}

/// The recording of a shown scan.
struct Frame {
    time_s: f64,
    scan: usize,
    path_poses: usize,
    estimate: Pose2,
    reference: Option<Pose2>,
    error: Option<PoseError>,
    worst: f64,
    particles: Vec<Pose2>,
    used_particles: usize,
    /// Directions (rad) and ranges (m); 0 for no return.
    beams: Vec<(f64, f64)>,
}

/// Records a run in progress.
pub struct Recorder {
    /// Time per scan of the run (s).
    times: Vec<f64>,
    reference: Vec<Option<Pose2>>,
    /// Indices of the shown scans in the run, increasing.
    shown: Vec<usize>,
    /// Indices of the run's scans in the log.
    scans: Vec<usize>,
    is_stamped: bool,
    max_range: f64,
    beams: usize,
    place: usize,
    worst: f64,
    sums: [f64; 3],
    rated: usize,
    metric: WeightedPoseError,
    frames: Vec<Frame>,
    /// Reference and estimate of every n-th scan.
    path: Vec<(Option<Pose2>, Pose2)>,
}

impl Recorder {
    /// For a run over a replay. `reference` has an entry per scan of the run, and `scans` has their indices
    /// in the log; `carried_off` is the first scan of the run after a kidnapping, where the time of the log
    /// jumps.
    pub fn new(
        replay: &Replay<'_>,
        reference: Vec<Option<Pose2>>,
        scans: Vec<usize>,
        carried_off: Option<usize>,
        max_range: f64,
    ) -> Self {
        let (times, is_stamped) = times(replay, carried_off);
        let recorded = replay.scans.iter().map(|&scan| &replay.recording.scans[scan]);
        let beams = recorded.map(|scan| shown_beams(scan.ranges.len()).count()).max();
        Recorder {
            shown: evenly(&times, MOST_FRAMES),
            times,
            reference,
            scans,
            is_stamped,
            max_range,
            beams: beams.unwrap_or(0),
            place: 0,
            worst: f64::NAN,
            sums: [0.0; 3],
            rated: 0,
            metric: WeightedPoseError::default(),
            frames: Vec::new(),
            path: Vec::new(),
        }
    }

    /// For a run over all scans of a log.
    pub fn of(recording: &Recording, max_range: f64) -> Self {
        let scans: Vec<usize> = (0..recording.scans.len()).collect();
        let replay = Replay { recording, increments: &[], scans: &scans };
        let reference = recording.scans.iter().map(|scan| scan.map_from_laser).collect();
        Self::new(&replay, reference, scans.clone(), None, max_range)
    }

    /// Records a step of the run on this recording.
    pub fn step(&mut self, recording: &Recording, step: &Step<'_>) {
        let place = self.place;
        self.place += 1;
        let robot_from_laser = recording.robot_from_laser;
        let estimate = step.report.estimate.map_from_robot.compose(&robot_from_laser);
        let reference = self.reference.get(place).copied().flatten();
        let error = reference.map(|reference| PoseError::between(&reference, &estimate));
        if let Some(error) = &error {
            let errors = [self.metric.of(error), error.translation(), error.heading()];
            self.worst = self.worst.max(errors[0]);
            self.sums.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error);
            self.rated += 1;
        }
        if place.is_multiple_of(self.times.len().div_ceil(MOST_PATH_POSES)) {
            self.path.push((reference, estimate));
        }
        if self.shown.get(self.frames.len()) != Some(&place) {
            return;
        }
        let scan = &recording.scans[step.scan];
        let range = |beam: usize| match scan.ranges[beam] {
            range if is_usable_range(range, self.max_range) => range,
            _ => 0.0,
        };
        let beams = shown_beams(scan.ranges.len());
        self.frames.push(Frame {
            time_s: self.times[place],
            scan: self.scans[place],
            path_poses: self.path.len(),
            estimate,
            reference,
            error,
            worst: std::mem::replace(&mut self.worst, f64::NAN),
            particles: drawn(step.particles, &robot_from_laser),
            used_particles: step.report.particles,
            beams: beams.map(|beam| (scan.direction(beam), range(beam))).collect(),
        });
    }

    /// Finishes the recording, with this map.
    ///
    /// # Errors
    /// When it has no scans.
    pub fn finish(self, label: String, map: &MapLooks) -> Result<RecordedRun> {
        let Recorder { frames, path, beams, rated, sums, .. } = self;
        if frames.len() != self.shown.len() {
            bail!("{label}: {} of {} scans were recorded", frames.len(), self.shown.len());
        }
        let poses = frames.iter().flat_map(|frame| {
            frame.particles.iter().chain([&frame.estimate]).chain(frame.reference.iter())
        });
        let of_path = path.iter().flat_map(|(reference, pose)| reference.iter().chain([pose]));
        let poses = poses.chain(of_path);
        let places = poses.map(|pose| [pose.x, pose.y]).chain(map.points.iter().copied());
        let bounds = Bounds::around(places).with_context(|| format!("{label}: no scans"))?;
        let steps = Steps::over(&bounds);
        let data = packed((&frames, &path), beams, map, &steps, &self.metric).finish()?;
        Ok(RecordedRun {
            format: FORMAT.to_owned(),
            label,
            frames: frames.len(),
            scans: self.scans.len(),
            particles: PARTICLES,
            beams,
            path_poses: path.len(),
            map_points: map.points.len(),
            map_size: map.size,
            map_is_lines: map.are_lines,
            is_stamped: self.is_stamped,
            origin: steps.origin,
            step_m: steps.step,
            mean_errors: (rated > 0).then(|| sums.map(|sum| sum / rated as f64)),
            data,
        })
    }
}

/// The arrays of a run; see [`RecordedRun`].
fn packed(
    (frames, path): (&[Frame], &[(Option<Pose2>, Pose2)]),
    beams: usize,
    map: &MapLooks,
    steps: &Steps,
    metric: &WeightedPoseError,
) -> Packer {
    let mut packer = Packer::default();
    packer.put(frames.iter().map(|frame| ((1e3 * frame.time_s) as u32).to_le_bytes()));
    packer.put(frames.iter().map(|frame| (frame.scan as u32).to_le_bytes()));
    packer.put(frames.iter().map(|frame| (frame.path_poses as u32).to_le_bytes()));
    let poses: [fn(&Frame) -> Option<Pose2>; 2] =
        [|frame| frame.reference, |frame| Some(frame.estimate)];
    for pose in poses {
        for part in 0..3 {
            let number = move |frame: &Frame| match (pose(frame), part) {
                (None, _) => ABSENT,
                (Some(pose), 0) => steps.place(0, pose.x),
                (Some(pose), 1) => steps.place(1, pose.y),
                (Some(pose), _) => pack::angle(pose.theta),
            };
            packer.put(frames.iter().map(|frame| number(frame).to_le_bytes()));
        }
    }
    type ErrorOf<'a> = &'a dyn Fn(&Frame) -> Option<f64>;
    let errors: [ErrorOf<'_>; 4] = [
        &|frame| frame.error.as_ref().map(|error| metric.of(error)),
        &|frame| frame.error.as_ref().map(PoseError::translation),
        &|frame| frame.error.as_ref().map(PoseError::heading),
        &|frame| Some(frame.worst),
    ];
    for error in errors {
        let number = |frame: &Frame| error(frame).unwrap_or(f64::NAN) as f32;
        packer.put(frames.iter().map(|frame| number(frame).to_le_bytes()));
    }
    packer.put(frames.iter().map(|frame| (frame.used_particles as u32).to_le_bytes()));
    let particles = || frames.iter().flat_map(|f| f.particles.iter().map(move |p| (f, p)));
    packer.put(particles().map(|(frame, p)| steps.length(p.x - frame.estimate.x).to_le_bytes()));
    packer.put(particles().map(|(frame, p)| steps.length(p.y - frame.estimate.y).to_le_bytes()));
    packer.put(particles().map(|(_, particle)| [pack::coarse_angle(particle.theta)]));
    let none = (0.0, 0.0);
    let all_beams = || {
        let of_frame = move |frame: &Frame| -> Vec<(f64, f64)> {
            (0..beams).map(|beam| frame.beams.get(beam).copied().unwrap_or(none)).collect()
        };
        frames.iter().flat_map(of_frame)
    };
    packer.put(all_beams().map(|(direction, _)| pack::angle(direction).to_le_bytes()));
    // Saturates above 655 m.
    packer.put(all_beams().map(|(_, range)| ((range / RANGE_STEP).round() as u16).to_le_bytes()));
    let place = |axis: usize, pose: &Pose2| steps.place(axis, [pose.x, pose.y][axis]);
    for axis in 0..2 {
        let of = |reference: &Option<Pose2>| reference.map_or(ABSENT, |pose| place(axis, &pose));
        packer.put(path.iter().map(|(reference, _)| of(reference).to_le_bytes()));
    }
    for axis in 0..2 {
        packer.put(path.iter().map(|(_, estimate)| place(axis, estimate).to_le_bytes()));
    }
    for axis in 0..2 {
        packer.put(map.points.iter().map(|point| steps.place(axis, point[axis]).to_le_bytes()));
    }
    packer
}

/// The indices of the shown beams: every n-th.
fn shown_beams(beams: usize) -> impl Iterator<Item = usize> + Clone {
    (0..beams).step_by(beams.div_ceil(MOST_BEAMS).max(1))
}

/// Particles drawn by their weights with systematic sampling: as many as are shown. Poses of the laser.
fn drawn(particles: &Particles, robot_from_laser: &Pose2) -> Vec<Pose2> {
    let mut shown = Vec::with_capacity(PARTICLES);
    let mut sum = 0.0;
    let mut last = Pose2::IDENTITY;
    for (pose, log_weight) in particles.iter() {
        sum += math::exp(log_weight);
        last = pose;
        while shown.len() < PARTICLES && (shown.len() as f64 + 0.5) / (PARTICLES as f64) < sum {
            shown.push(pose.compose(robot_from_laser));
        }
    }
    // Weights sum to one up to rounding.
    shown.resize(PARTICLES, last.compose(robot_from_laser));
    shown
}

/// Seconds since the first scan of the run, never decreasing, and whether they are from stamps.
fn times(replay: &Replay<'_>, carried_off: Option<usize>) -> (Vec<f64>, bool) {
    let stamps: Option<Vec<_>> =
        replay.scans.iter().map(|&scan| replay.recording.scans[scan].stamp).collect();
    let Some(stamps) = stamps.filter(|stamps| stamps.windows(2).any(|pair| pair[0] < pair[1]))
    else {
        return ((0..replay.scans.len()).map(|scan| scan as f64).collect(), false);
    };
    let mut time = 0.0;
    let mut times = vec![0.0];
    for (place, pair) in stamps.windows(2).enumerate() {
        if carried_off != Some(place + 1) {
            time += pair[1].seconds_since(pair[0]).max(0.0);
        }
        times.push(time);
    }
    times.truncate(replay.scans.len());
    (times, true)
}

/// Indices into non-decreasing times, at most `most`, at even steps of time, including the first and the
/// last.
fn evenly(times: &[f64], most: usize) -> Vec<usize> {
    let Some((last, duration)) = times.len().checked_sub(1).zip(times.last()) else {
        return Vec::new();
    };
    if times.len() <= most {
        return (0..times.len()).collect();
    }
    let steps = (most - 1) as f64;
    let wanted = (0..most - 1).map(|k| duration * k as f64 / steps);
    let mut places: Vec<usize> =
        wanted.map(|time| times.partition_point(|&other| other < time)).collect();
    places.push(last);
    places.dedup();
    places
}

#[cfg(test)]
mod tests {
    use mcl_core::{LaserScan, ScanGeometry, Stamp};

    use super::*;

    #[test]
    fn shown_scans_are_even_in_time_with_both_ends() {
        assert_eq!(evenly(&[], 3), [0; 0]);
        assert_eq!(evenly(&[0.0, 1.0, 2.0], 3), [0, 1, 2]);
        // The robot stands still for long: fewer are shown than possible, and none twice.
        let times: Vec<f64> = (0..100).map(|k| if k < 50 { f64::from(k) } else { 1e4 }).collect();
        let shown = evenly(&times, 10);
        assert_eq!((shown.first(), shown.last()), (Some(&0), Some(&99)));
        assert!(shown.len() <= 10 && shown.is_sorted_by(|a, b| a < b), "{shown:?}");
        let even: Vec<f64> = (0..1000).map(f64::from).collect();
        let shown = evenly(&even, 250);
        assert_eq!((shown.len(), shown[249]), (250, 999));
        assert!(shown.windows(2).all(|pair| (3..=5).contains(&(pair[1] - pair[0]))), "{shown:?}");
    }

    fn recording(stamps: &[Option<i64>]) -> Recording {
        let scan = |stamp: &Option<i64>| LaserScan {
            stamp: stamp.map(|seconds| Stamp::from_nanoseconds(seconds * 1_000_000_000)),
            geometry: ScanGeometry { start_angle: 0.0, angle_step: 1.0, beams: 0 },
            ranges: Vec::new(),
            map_from_laser: None,
            odometry: None,
            sweep: Default::default(),
        };
        let scans = stamps.iter().map(scan).collect();
        Recording { scans, robot_from_laser: Pose2::IDENTITY }
    }

    /// Logs step back in time, and a kidnapped robot continues at another time of the log.
    #[test]
    fn time_never_goes_back_and_does_not_jump_where_the_robot_is_carried_off() {
        let log = recording(&[Some(10), Some(12), Some(11), Some(500), Some(501)]);
        let scans = [0, 1, 2, 3, 4];
        let replay = Replay { recording: &log, increments: &[], scans: &scans };
        assert_eq!(times(&replay, Some(3)), (vec![0.0, 2.0, 2.0, 2.0, 3.0], true));
        assert_eq!(times(&replay, None).0, [0.0, 2.0, 2.0, 491.0, 492.0]);
        let log = recording(&[Some(1), None, Some(3)]);
        let replay = Replay { recording: &log, increments: &[], scans: &scans[..3] };
        assert_eq!(times(&replay, None), (vec![0.0, 1.0, 2.0], false));
    }

    #[test]
    fn every_beam_is_shown_of_few_and_every_second_of_more() {
        assert_eq!(shown_beams(60).count(), 60);
        assert_eq!(shown_beams(61).collect::<Vec<_>>()[..3], [0, 2, 4]);
        assert!((1..2000).all(|beams| (1..=MOST_BEAMS).contains(&shown_beams(beams).count())));
        assert_eq!(shown_beams(0).count(), 0);
    }
}
