//! Writes a run as a ROS 2 bag for visualization: `localize --replay` (docs/replay.md).

use std::collections::BTreeMap;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use mcl_core::files::Output;
use mcl_core::{PointMap, Pose2, Recording, Stamp};
use mcl_datasets::bag::planar::{
    float64, laser_scan, point_cloud, pose_array, pose_stamped, pose_with_covariance, transforms,
};
use mcl_datasets::bag::types::{
    FLOAT64, LASER_SCAN, MessageType, POINT_CLOUD2, POSE_ARRAY, POSE_STAMPED,
    POSE_WITH_COVARIANCE_STAMPED, TF_MESSAGE,
};
use mcl_datasets::bag::{
    BASE_FRAME, BagWriter, Delivery, LASER_FRAME, MAP_FRAME, TopicId, WriteBagError, check_scans,
};
use mcl_filter::Step;
use mcl_metrics::{PoseError, WeightedPoseError};
use mcl_study::measure::consistency::scan_nees;

use crate::cli::output::prepare;

/// Name of the metadata record that identifies the run.
const METADATA_NAME: &str = "mcl-eval localize";
/// A scan whose stamp is missing, or not later than the previous ones, is logged this long after the
/// previous scan (ns): players use the log time, which therefore always increases.
const PAUSE: u64 = 1_000_000;

/// A bag that is written during the run. It is complete, under its final name, when [`ReplayFile::finish`]
/// has returned; until then, and after an error, an existing file of that name is unchanged.
pub struct ReplayFile<'a> {
    recorder: Recorder<'a, BufWriter<Output>>,
    path: PathBuf,
}

impl<'a> ReplayFile<'a> {
    /// Begins the bag beside `path`, so that errors of the path are reported before the run. `inputs` are the
    /// files that the run reads; `setup` are its settings, stored in a metadata record.
    pub fn open(path: &Path, inputs: &[PathBuf], scene: &Scene<'a>, setup: String) -> Result<Self> {
        prepare([path], inputs)?;
        let context = || format!("cannot write the replay {}", path.display());
        let file = Output::create(path).with_context(context)?;
        let recorder = Recorder::new(BufWriter::new(file), scene, setup).with_context(context)?;
        Ok(ReplayFile { recorder, path: path.to_owned() })
    }

    /// Writes a step of the run.
    pub fn step(&mut self, step: &Step<'_>) -> Result<()> {
        let path = &self.path;
        self.recorder
            .step(step)
            .with_context(|| format!("cannot write the replay {}", path.display()))
    }

    /// Finishes the bag and renames it to its final name.
    pub fn finish(self) -> Result<()> {
        let context = || format!("cannot write the replay {}", self.path.display());
        let buffer = self.recorder.bag.finish().with_context(context)?;
        let file = buffer.into_inner().map_err(|error| error.into_error()).with_context(context)?;
        file.commit().with_context(context)
    }
}

/// What is constant during a run.
#[derive(Clone, Copy)]
pub struct Scene<'a> {
    pub recording: &'a Recording,
    pub map: &'a PointMap<2>,
    /// Readings beyond it (m) are not used.
    pub max_range: f64,
}

/// Writes the messages of a run.
struct Recorder<'a, W: Write + Seek> {
    bag: BagWriter<W>,
    topics: Topics,
    recording: &'a Recording,
    laser_from_robot: Pose2,
    /// `range_min` and `range_max` of all scans (m).
    limits: (f32, f32),
    clock: Clock,
    metric: WeightedPoseError,
}

struct Topics {
    tf: TopicId,
    scan: TopicId,
    particles: TopicId,
    estimate: TopicId,
    effective_sample_size: TopicId,
    log_evidence: TopicId,
    explained_beams: TopicId,
    /// `None` for a log without reference poses.
    truth: Option<TruthTopics>,
}

#[derive(Clone, Copy)]
struct TruthTopics {
    reference: TopicId,
    weighted: TopicId,
    translation: TopicId,
    heading: TopicId,
    nees: TopicId,
}

impl<'a, W: Write + Seek> Recorder<'a, W> {
    /// Begins the bag with the settings of the run, the map, and the mount of the laser.
    fn new(sink: W, scene: &Scene<'a>, setup: String) -> Result<Self, WriteBagError> {
        let Scene { recording, map, max_range } = *scene;
        let scans = &recording.scans;
        check_scans(scans)?;
        let mut bag = BagWriter::new(sink)?;
        let entries = [("run".to_owned(), "0".to_owned()), ("setup".to_owned(), setup)];
        bag.metadata(METADATA_NAME, BTreeMap::from(entries))?;

        let map_topic = bag.topic("/map", &POINT_CLOUD2, Delivery::Latched)?;
        let static_topic = bag.topic("/tf_static", &TF_MESSAGE, Delivery::Latched)?;
        let mut topic = |name: &str, kind: &MessageType| bag.topic(name, kind, Delivery::Live);
        let tf = topic("/tf", &TF_MESSAGE)?;
        let scan = topic("/scan", &LASER_SCAN)?;
        let particles = topic("/particles", &POSE_ARRAY)?;
        let estimate = topic("/estimate", &POSE_WITH_COVARIANCE_STAMPED)?;
        let truth = match scans.iter().any(|scan| scan.map_from_laser.is_some()) {
            false => None,
            true => Some(TruthTopics {
                reference: topic("/reference", &POSE_STAMPED)?,
                weighted: topic("/error/weighted", &FLOAT64)?,
                translation: topic("/error/translation", &FLOAT64)?,
                heading: topic("/error/heading", &FLOAT64)?,
                nees: topic("/error/nees", &FLOAT64)?,
            }),
        };
        let effective_sample_size = topic("/effective_sample_size", &FLOAT64)?;
        let log_evidence = topic("/log_evidence", &FLOAT64)?;
        let explained_beams = topic("/explained_beams", &FLOAT64)?;

        let clock = Clock::new(scans.iter().find_map(|scan| scan.stamp));
        let start = clock.next;
        let stamp = stamp_of(start);
        bag.write(map_topic, start, point_cloud(stamp, MAP_FRAME, map.points()))?;
        let mounted = [(BASE_FRAME, LASER_FRAME, recording.robot_from_laser)];
        bag.write(static_topic, start, transforms(stamp, &mounted))?;
        Ok(Recorder {
            bag,
            topics: Topics {
                tf,
                scan,
                particles,
                estimate,
                effective_sample_size,
                log_evidence,
                explained_beams,
                truth,
            },
            recording,
            laser_from_robot: recording.robot_from_laser.inverse(),
            // Usable readings are above 0. Readings that are not used are not drawn, either.
            limits: (f32::MIN_POSITIVE, max_range as f32),
            clock,
            metric: WeightedPoseError::default(),
        })
    }

    fn step(&mut self, step: &Step<'_>) -> Result<(), WriteBagError> {
        let scan = &self.recording.scans[step.scan];
        let robot_from_laser = self.recording.robot_from_laser;
        let time = self.clock.tick(scan.stamp);
        let stamp = scan.stamp.unwrap_or(stamp_of(time));
        let estimate = &step.report.estimate;
        let map_from_robot = estimate.map_from_robot;
        let mut write = |topic, message| self.bag.write(topic, time, message);

        // Frames first: players draw only what they can place.
        let edges = [(MAP_FRAME, BASE_FRAME, map_from_robot)];
        write(self.topics.tf, transforms(stamp, &edges))?;
        write(self.topics.scan, laser_scan(scan, stamp, LASER_FRAME, self.limits))?;
        let poses = step.particles.iter().map(|(pose, _)| pose);
        write(self.topics.particles, pose_array(stamp, MAP_FRAME, poses))?;
        write(
            self.topics.estimate,
            pose_with_covariance(stamp, MAP_FRAME, map_from_robot, &estimate.covariance),
        )?;
        write(self.topics.effective_sample_size, float64(step.report.effective_sample_size))?;
        if let Some(share) = step.report.explained_beams {
            write(self.topics.log_evidence, float64(step.report.log_evidence))?;
            write(self.topics.explained_beams, float64(share))?;
        }
        if let (Some(topics), Some(map_from_laser)) = (self.topics.truth, scan.map_from_laser) {
            let reference = map_from_laser.compose(&self.laser_from_robot);
            write(topics.reference, pose_stamped(stamp, MAP_FRAME, reference))?;
            // The laser's pose, as in the error rows.
            let estimate = map_from_robot.compose(&robot_from_laser);
            let error = PoseError::between(&map_from_laser, &estimate);
            write(topics.weighted, float64(self.metric.of(&error)))?;
            write(topics.translation, float64(error.translation()))?;
            write(topics.heading, float64(error.heading()))?;
            if let Some(nees) = scan_nees(&map_from_laser, step.report, &self.laser_from_robot) {
                write(topics.nees, float64(nees))?;
            }
        }
        Ok(())
    }
}

/// Log times, each later than the previous one.
struct Clock {
    /// Earliest time of the next scan (ns).
    next: u64,
}

impl Clock {
    /// Starts at the first stamp of the log.
    fn new(first: Option<Stamp>) -> Self {
        Clock { next: first.map_or(0, nanoseconds) }
    }

    /// The time of a scan: its stamp, or a [`PAUSE`] after the previous scan if that is later.
    fn tick(&mut self, stamp: Option<Stamp>) -> u64 {
        let time = stamp.map_or(self.next, |stamp| nanoseconds(stamp).max(self.next));
        self.next = time + PAUSE;
        time
    }
}

/// For a checked stamp, which is not negative.
fn nanoseconds(stamp: Stamp) -> u64 {
    stamp.nanoseconds() as u64
}

fn stamp_of(time: u64) -> Stamp {
    Stamp::from_nanoseconds(time as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::Seed;
    use mcl_datasets::simulator::{OfficeSettings, simulate};
    use std::io::{self, Cursor, SeekFrom};

    /// A disk with room for this many bytes.
    struct FullDisk(Cursor<Vec<u8>>, usize);

    impl Write for FullDisk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.0.get_ref().len() + bytes.len() > self.1 {
                return Err(io::ErrorKind::StorageFull.into());
            }
            self.0.write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for FullDisk {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.0.seek(to)
        }
    }

    #[test]
    fn a_full_disk_is_an_error_whenever_it_fills_up() {
        let recording = simulate(&OfficeSettings::default(), Seed::new(1)).unwrap();
        let map = PointMap::new(vec![[0.0, 0.0]; 100_000]).unwrap();
        let scene = Scene { recording: &recording, map: &map, max_range: 10.0 };
        let record = |room: usize| -> Result<usize, WriteBagError> {
            let disk = FullDisk(Cursor::new(Vec::new()), room);
            let recorder = Recorder::new(disk, &scene, String::new())?;
            Ok(recorder.bag.finish()?.0.into_inner().len())
        };
        let whole = record(usize::MAX).unwrap();
        for room in [0, 10, whole / 2, whole - 1] {
            assert!(record(room).is_err(), "{room} of {whole} bytes");
        }
        assert_eq!(record(whole).unwrap(), whole);
    }

    #[test]
    fn the_clock_advances() {
        let stamp = |milliseconds: i64| Some(Stamp::from_nanoseconds(milliseconds * 1_000_000));
        let mut clock = Clock::new(stamp(5000));
        let stamps = [None, stamp(5000), stamp(5100), stamp(5100), stamp(3), None, stamp(6000)];
        let times = stamps.map(|stamp| clock.tick(stamp) / 1_000_000);
        assert_eq!(times, [5000, 5001, 5100, 5101, 5102, 5103, 6000]);
        assert_eq!(Clock::new(None).tick(None), 0);
    }
}
