//! Converts the messages of a bag to a recording.

use std::collections::BTreeSet;

use mcl_core::text::counted;
use mcl_core::{LaserScan, Pose2, Recording, Stamp, memory};

use super::beams::{self, LaserMotion, SweepStatistics};
use super::content::{Content, MessageKind, Purpose};
use super::decoder::{Decoder, Logged, time, tree};
use super::error::BagError;
use super::laser::{LaserMount, in_space};
use super::lists::ScanLists;
use super::messages::{PoseMessage, ScanMessage, in_space_of, planar};
use super::moment::{Moment, Stretches};
use super::motion::Motion;
use super::pairing::{Track, TrackRemarks, goes_over_again, occurrences, stretches_of_file};
use super::scans::{contradictions, drop_repeated, scan_time, stretches};
use super::slice;
use super::survey::Survey;
use super::topics::{ChosenTopics, Pair, choose, possible_references, transform_topics};
use super::track::{Occurrence, PoseTrack};
use crate::log::content::{Log, LogKind};
use crate::log::options::{ReadOptions, ReferencePoses, ReferenceTrack};
use crate::log::plane::out_of_plane;
use crate::log::reference::of_unknown_frame;
use crate::log::report::ReadReport;

const NANOSECONDS: f64 = 1e9;

/// Empty content, prepared for reading a recording.
pub(crate) fn content(options: &ReadOptions) -> Content {
    let purpose = if options.slice.is_some() { Purpose::Slices } else { Purpose::Scans };
    Content::new(purpose, options.topics.scan.as_deref())
}

/// Makes a recording of a bag's content.
pub(crate) fn assemble(mut content: Content, options: &ReadOptions) -> Result<Log, BagError> {
    let messages = std::mem::take(&mut content.messages);
    let lists = content.lists.take();
    let ChosenTopics {
        scan: scan_topic,
        odometry: odometry_topic,
        reference: reference_topic,
        doubts,
        assumptions,
    } = choose(&content, options)?;
    let mut decoder = Decoder::new(&content, messages);
    let whole = match options.slice {
        Some(_) => None,
        None => Some(decoder.scans(scan_topic, ScanMessage::new)?),
    };
    let odometry = match odometry_topic {
        Some(topic) => decoder.poses(topic)?,
        None => Vec::new(),
    };
    let pair =
        reference_topic.filter(|name| content.topics.iter().all(|topic| topic.name != *name));
    let reference = match reference_topic {
        Some(topic) if pair.is_none() => decoder.poses(topic)?,
        _ => Vec::new(),
    };
    let mut topics = transform_topics(&content, Some(scan_topic));
    let mut left_out = content.names(&[MessageKind::Transforms]);
    left_out.retain(|name| !topics.contains(name));
    if let Some(pair) = pair.and_then(Pair::of) {
        topics.push(pair.topic);
    }
    let transforms = decoder.transforms(&topics)?;
    let child = odometry.first().and_then(|pose| pose.value.child.clone());
    let scans = match (whole, options.slice) {
        (Some(scans), _) => scans,
        (None, heights) => {
            let heights = heights.unwrap_or_default();
            let mut motion = tree(&transforms, &Stretches::default());
            motion.sort(None);
            let place = |lidar: &str| {
                let base = robot_frame(&motion, child.as_deref(), lidar, options).0;
                let found = motion.mount_in_space(&base, lidar);
                match options.laser_pose {
                    // The height of the scanner is not known from anything else.
                    Some(asked) => in_space(asked, found.translation.z),
                    None => found,
                }
            };
            decoder.scans(scan_topic, |view| slice::scan(view, place, heights))?
        }
    };
    let mut scans = scans;
    let of_scans = content.topics.iter().filter(|topic| topic.name == scan_topic);
    let found = of_scans.map(|topic| topic.messages).sum();
    let (lists, lost) = match lists {
        Some(lists) if lists.are_of_others(found, content.truncated.is_some()) => {
            (None, Some(lists.mismatch(scan_topic, found)))
        }
        lists => (lists, None),
    };
    let repeated = if lists.is_none() { drop_repeated(&mut scans) } else { 0 };
    // A recording written as a bag is in the order of its scans, whatever their stamps.
    let stretches = match lists {
        Some(_) => Stretches::default(),
        None => {
            let poses = [(odometry_topic, &*odometry), (reference_topic, &*reference)];
            stretches(&scans, scan_topic, poses, &transforms)
        }
    };
    let longest = options.longest_gap.map(|seconds| (seconds * NANOSECONDS) as i64);
    let mut motion = tree(&transforms, &stretches);
    motion.sort(longest);
    let Decoder { mut report, mut notes, .. } = decoder;
    notes.extend(motion.notes());
    report.doubts.extend(doubts);
    report.doubts.extend(lost);
    report.doubts.extend(stretches.doubt());
    report.doubts.extend(motion.doubts());
    let moment = |scan: &Logged<ScanMessage>| stretches.moment(scan.place, scan_time(scan));
    let moments: Vec<Moment> = scans.iter().map(moment).collect();
    let mut assembly = Assembly {
        content: &content,
        options,
        scan_topic,
        scans,
        lists,
        stretches,
        motion,
        longest,
        occurrences: occurrences(&moments),
        moments,
        report,
        notes,
        assumptions,
    };
    if !left_out.is_empty() {
        assembly.notes.push(format!(
            "transforms: those on {} are left out, as their namespace is not that of {scan_topic}",
            left_out.join(", ")
        ));
    }
    if repeated > 0 {
        assembly.assumptions.push(format!(
            "{scan_topic}: {repeated} of {} messages repeat another byte for byte, with the same stamp; each counts once (was the topic recorded twice?)",
            repeated + assembly.scans.len()
        ));
    }
    let Assembly { scans, moments, lists, .. } = &assembly;
    let remarks = contradictions(scan_topic, scans, moments, lists.is_some());
    assembly.report.doubts.extend(remarks.doubts);
    assembly.assumptions.extend(remarks.assumptions);
    assembly.notes.extend(remarks.notes);
    assembly.log(odometry_topic.zip(Some(odometry)), reference_topic, reference)
}

/// The robot's frame, and what was assumed about it: the requested one; that of the odometry, if transforms
/// connect it to the laser; the one that the laser moves with; one of the usual names that the laser is fixed
/// to; else the laser's own.
fn robot_frame(
    motion: &Motion,
    odometry_child: Option<&str>,
    laser: &str,
    options: &ReadOptions,
) -> (String, Option<String>) {
    if let Some(asked) = &options.base_frame {
        return (asked.clone(), None);
    }
    let by_tree = || {
        let moved = motion.robot(laser).map(|(robot, _)| robot);
        moved.or_else(|| motion.base_of(laser).map(str::to_owned))
    };
    let Some(child) = odometry_child.filter(|child| !child.is_empty()) else {
        return (by_tree().unwrap_or_else(|| laser.to_owned()), None);
    };
    if child == laser || motion.link(child, laser).is_some() {
        return (child.to_owned(), None);
    }
    match by_tree() {
        Some(robot) => {
            let doubt = format!(
                "odometry: it is of frame {child:?}, which no transforms connect with {laser:?}; its poses are taken as those of {robot:?} (--base-frame changes this)"
            );
            (robot, Some(doubt))
        }
        None => (child.to_owned(), None),
    }
}

struct Assembly<'a> {
    content: &'a Content,
    options: &'a ReadOptions,
    scan_topic: &'a str,
    scans: Vec<Logged<ScanMessage>>,
    /// The scan lists of a bag written by this suite.
    lists: Option<ScanLists>,
    stretches: Stretches,
    motion: Motion,
    longest: Option<i64>,
    /// Times of the scans, and which of several with the same time each one is.
    moments: Vec<Moment>,
    occurrences: Vec<Occurrence>,
    report: ReadReport,
    notes: Vec<String>,
    assumptions: Vec<String>,
}

impl Assembly<'_> {
    fn log(
        mut self,
        odometry: Option<(&str, Vec<Logged<PoseMessage>>)>,
        reference_topic: Option<&str>,
        reference: Vec<Logged<PoseMessage>>,
    ) -> Result<Log, BagError> {
        let laser = self.scans[0].value.header.frame.clone();
        let child = odometry.as_ref().and_then(|(_, poses)| poses.first()?.value.child.clone());
        let (base, doubt) = robot_frame(&self.motion, child.as_deref(), &laser, self.options);
        self.report.doubts.extend(doubt);
        let odometry_topic = odometry.as_ref().map(|(topic, _)| *topic);
        let child_frame = child.as_deref().unwrap_or(&base);
        self.check_frame(self.options.odometry_frame.as_deref(), "--odom-frame", |frame| {
            let of_topic = odometry.as_ref().and_then(|(_, poses)| poses.first());
            of_topic.is_some_and(|pose| pose.value.header.frame == frame)
        })?;
        let of_poses = reference.first().and_then(|pose| pose.value.child.as_deref());
        self.check_frame(self.options.reference_frame.as_deref(), "--reference-frame", |frame| {
            ["robot", "laser", &base, &laser, child_frame].contains(&frame)
                || of_poses == Some(frame)
        })?;
        let mut odometry = self.odometry(odometry, &base, &laser);
        self.notes.push(format!("scans: {}, frame {laser:?}", self.scan_topic));
        let mount = self.mount(&base, &laser)?;
        let moments = self.moments.clone();
        let sweeps = self.sweeps(&moments);
        let Reference { track: mut reference, name, frame } =
            self.reference(reference_topic, &reference, &base, odometry_topic)?;
        let (reference_mount, whose) = self.reference_mount(frame, &base, &laser, mount)?;
        let used = reference.as_ref().map(|_| format!("{name}, poses of {whose:?}"));
        if let Some(used) = &used {
            self.notes.push(format!("reference: {used}"));
        }
        for track in [&odometry, &reference].into_iter().flatten() {
            self.check_overlap(track, &name, &moments)?;
        }
        let sways = self.options.laser_pose.is_none()
            && self.motion.link(&base, &laser).is_some_and(|link| link.sways());
        if sways {
            self.notes.push(format!(
                "the laser sways on {base:?}: each scan has the pose of the laser at its own time"
            ));
        }
        let occurrences = self.occurrences.clone();
        let mut scans: Vec<LaserScan> = memory::with_room(self.scans.len(), "scans")?;
        let is_tilted = mount.is_tilted() || sways;
        if is_tilted || sweeps && !self.options.no_deskew {
            let readings: usize = self.scans.iter().map(|scan| scan.value.ranges.len()).sum();
            memory::check_room(readings, size_of::<f64>(), "directions of beams")?;
        }
        let mut before: Option<(Moment, Pose2)> = None;
        let mut by_log_time = 0;
        let mut swept = SweepStatistics::default();
        let numbered = self.scans.iter_mut().zip(&moments).zip(&occurrences);
        for ((logged, &moment), &occurrence) in numbered {
            let header = logged.value.header.stamp;
            let is_listed = |of: fn(&ScanLists) -> &BTreeSet<u32>| {
                self.lists.as_ref().is_some_and(|lists| of(lists).contains(&logged.number))
            };
            let stamp = match self.lists {
                Some(_) => {
                    let is_unstamped = is_listed(|lists| &lists.unstamped);
                    (!is_unstamped && header >= 0).then_some(header)
                }
                None => {
                    by_log_time += usize::from(header <= 0);
                    Some(moment.at)
                }
            };
            self.report.unusable_stamps += usize::from(stamp.is_none());
            let then = match self.motion.link(&base, &laser).filter(|_| sways) {
                Some(link) => match (link.mount_at(moment), self.options.slice) {
                    (Some(then), Some(_)) => then.level(),
                    (then, _) => then.unwrap_or(mount),
                },
                None => mount,
            };
            let at = |track: &mut Option<Track>, mount: LaserMount| {
                let robot = track.as_mut()?.at(moment, occurrence)?;
                Some(mount.laser(robot))
            };
            let odometry_pose = at(&mut odometry, then);
            let of_reference = reference_mount.unwrap_or(then);
            let map_from_laser = match is_listed(|lists| &lists.without_reference) {
                true => None,
                false => at(&mut reference, of_reference),
            };
            let increment = match (before, odometry_pose) {
                _ if is_listed(|lists| &lists.without_odometry) => None,
                (Some((last, before)), Some(pose)) if last.stretch == moment.stretch => {
                    Some(before.between(&pose))
                }
                _ => None,
            };
            before = odometry_pose.map(|pose| (moment, pose));
            let tracks = [(&odometry, then), (&reference, of_reference)]
                .map(|(track, mount)| (track.as_ref().and_then(Track::poses), mount));
            let increment_s = if sweeps { logged.value.time_increment } else { 0.0 };
            let moved = match self.options.no_deskew || increment_s == 0.0 {
                true => None,
                false => LaserMotion::of(moment, occurrence, increment_s, tracks),
            };
            let (ranges, sweep) = swept.place(&mut logged.value, then, increment_s, moved);
            scans.push(LaserScan {
                stamp: stamp.map(Stamp::from_nanoseconds),
                geometry: mount.seen_from_above(logged.value.geometry),
                ranges,
                map_from_laser,
                odometry: increment,
                sweep,
            });
        }
        self.say_swept(&swept);
        if by_log_time > 0 {
            self.assumptions.push(format!(
                "stamps: scans without a stamp in their header: {by_log_time}; their log time is used"
            ));
        }
        for track in [odometry, reference].into_iter().flatten() {
            let TrackRemarks { doubts, assumptions } = track.remarks(&moments);
            self.report.doubts.extend(doubts);
            self.assumptions.extend(assumptions);
        }
        Ok(Log {
            recording: Recording { scans, robot_from_laser: mount.robot_from_laser },
            kind: LogKind::Bag,
            report: self.report,
            front_laser_offset: None,
            reference: used,
            notes: self.notes,
            survey: Some(
                Survey::of(self.content, self.options).with_pairs(self.motion.pairs(&base)),
            ),
            assumptions: self.assumptions,
        })
    }

    fn track(&self, poses: PoseTrack, what: &'static str) -> Track {
        Track::new(poses, what, &self.moments, &self.occurrences)
    }

    /// The robot's poses in the odometry's frame: from the odometry's topic, and before and after it from
    /// `/tf`, which has the same poses.
    fn odometry(
        &mut self,
        topic: Option<(&str, Vec<Logged<PoseMessage>>)>,
        base: &str,
        laser: &str,
    ) -> Option<Track> {
        const WHAT: &str = "odometry";
        if let Some((topic, poses)) = topic
            && let Some(first) = poses.first()
        {
            let frame = &first.value.header.frame;
            let child = first.value.child.clone().unwrap_or_default();
            self.notes.push(format!(
                "odometry: {topic}, {}, frame {frame:?} to {child:?}",
                counted(poses.len(), "message")
            ));
            self.say_unstamped(WHAT, &poses);
            let track = PoseTrack::new(self.samples(&poses), self.longest)?;
            let on_tf = (!child.is_empty()).then(|| self.motion.poses(frame, &child)).flatten();
            let track = match on_tf {
                Some(on_tf) => track.extended_by(&on_tf),
                None => track,
            };
            return Some(self.track(track, WHAT));
        }
        let asked = self.options.odometry_frame.clone();
        // A pose in the map comes from a localizer or a reference.
        let is_map = |frame: &str| frame.rsplit('/').next() == Some("map");
        let found = self.motion.robot(laser);
        let found = found.filter(|(robot, frame)| robot == base && !is_map(frame));
        let frame = asked.or_else(|| Some(found?.1));
        let on_tf = frame.and_then(|frame| {
            let samples = self.motion.poses(&frame, base)?;
            Some((frame, samples))
        });
        let Some((frame, samples)) = on_tf else {
            self.notes.push("odometry: none is used".to_owned());
            return None;
        };
        self.notes.push(format!(
            "odometry: {} from {frame:?} to {base:?}",
            counted(samples.len(), "transform")
        ));
        PoseTrack::new(samples, self.longest).map(|track| self.track(track, WHAT))
    }

    /// In bags written by this suite, stamps of 0 are valid.
    fn say_unstamped(&mut self, what: &str, poses: &[Logged<PoseMessage>]) {
        let without = poses.iter().filter(|pose| pose.value.header.stamp <= 0).count();
        if without > 0 && self.lists.is_none() {
            self.assumptions.push(format!(
                "{what}: {without} of {} have no stamp in their header; their log time is used",
                counted(poses.len(), "message")
            ));
        }
    }

    fn samples(&self, poses: &[Logged<PoseMessage>]) -> Vec<(Moment, Pose2)> {
        let sample = |pose: &Logged<PoseMessage>| {
            let at = time(pose.value.header.stamp, pose.log_time);
            (self.stretches.moment(pose.place, at), pose.value.pose)
        };
        poses.iter().map(sample).collect()
    }

    fn mount(&mut self, base: &str, laser: &str) -> Result<LaserMount, BagError> {
        if let Some(asked) = self.options.laser_pose {
            self.notes.push(format!("laser on {base:?}: as given by --laser-pose"));
            let mount = self.of_scans(LaserMount::asked(asked), base, laser)?;
            self.say_tilt(base, mount);
            return Ok(mount);
        }
        let Some(mount) = self.motion.any_mount(base, laser)? else {
            let why = match self.motion.contains(laser) {
                true => "no transforms lead from one to the other",
                false => "no transform says where it is",
            };
            self.report.doubts.push(format!(
                "laser on {base:?}: {why}, so it is taken to be at the robot's origin, looking ahead; say where it is with --laser-pose X,Y,THETA"
            ));
            return Ok(LaserMount::IDENTITY);
        };
        let Pose2 { x, y, theta } = mount.robot_from_laser;
        let turned = if mount.is_upside_down { ", upside down" } else { "" };
        let mount = self.of_scans(mount, base, laser)?;
        self.notes.push(format!(
            "laser on {base:?}: x {x:.3} m, y {y:.3} m, turned by {:.1}°{turned}",
            theta.to_degrees()
        ));
        self.say_tilt(base, mount);
        Ok(mount)
    }

    /// A slice is level, however its scanner is mounted; otherwise the laser must scan the plane.
    fn of_scans(&self, mount: LaserMount, base: &str, laser: &str) -> Result<LaserMount, BagError> {
        match self.options.slice {
            Some(_) => Ok(mount.level()),
            None => mount.checked(base, laser),
        }
    }

    fn say_tilt(&mut self, base: &str, mount: LaserMount) {
        if mount.is_tilted() {
            self.assumptions.push(format!(
                "laser on {base:?}: tilted by {:.1}°, so the ends of its beams are projected into the plane",
                mount.tilt_degrees
            ));
        }
    }

    /// Whether the times between beams are plausible; otherwise they are reported as a doubt, and not used.
    fn sweeps(&mut self, moments: &[Moment]) -> bool {
        let takes = self.scans.iter().map(|scan| beams::takes(&scan.value));
        match beams::longest_sweep(takes, moments) {
            Ok(longest) => longest > 0.0,
            Err(doubt) => {
                self.report.doubts.push(format!("{}: {doubt}", self.scan_topic));
                false
            }
        }
    }

    fn say_swept(&mut self, swept: &SweepStatistics) {
        let with_topic = |text: String| format!("{}: {text}", self.scan_topic);
        self.notes.extend(swept.note(self.options.no_deskew).map(with_topic));
        let with_topic = |text: String| format!("{}: {text}", self.scan_topic);
        let assumptions = swept.assumptions(self.options.no_deskew);
        self.assumptions.extend(assumptions.into_iter().map(with_topic));
    }

    /// The reference poses, their name, and their child frame where it is stated.
    fn reference(
        &mut self,
        topic: Option<&str>,
        poses: &[Logged<PoseMessage>],
        base: &str,
        odometry_topic: Option<&str>,
    ) -> Result<Reference, BagError> {
        if let Some(track) = &self.options.reference_track {
            let ReferenceTrack { name, trajectory, frame, doubt } = track;
            let doubt = doubt.as_ref().map(|doubt| format!("reference: {name}: {doubt}"));
            self.report.doubts.extend(doubt);
            let times: Vec<i64> = trajectory.stamps().iter().map(|at| at.nanoseconds()).collect();
            let of_file = stretches_of_file(&times);
            let there: BTreeSet<usize> = self.moments.iter().map(|at| at.stretch).collect();
            let in_file = of_file.last().map_or(0, |last| last + 1);
            let poses: Vec<(i64, Pose2)> =
                trajectory.iter().map(|(at, pose)| (at.nanoseconds(), pose)).collect();
            let in_stretch =
                |stretch: usize, &(at, pose): &(i64, Pose2)| (Moment { stretch, at }, pose);
            let samples: Vec<(Moment, Pose2)> = match in_file {
                // It may be about any frame.
                0 | 1 => there
                    .iter()
                    .flat_map(|&stretch| poses.iter().map(move |pose| in_stretch(stretch, pose)))
                    .collect(),
                _ if in_file == there.len() => {
                    let in_bag: Vec<usize> = there.into_iter().collect();
                    let pairs = poses.iter().zip(&of_file);
                    pairs.map(|(pose, &of)| in_stretch(in_bag[of], pose)).collect()
                }
                _ => {
                    self.report.doubts.push(goes_over_again(name, in_file, there.len()));
                    return Ok(Reference::default());
                }
            };
            let track = PoseTrack::new(samples, self.longest);
            let name = format!("{name}, {}", counted(trajectory.len(), "pose"));
            let track = track.map(|track| self.track(track, REFERENCE));
            return Ok(Reference { track, name, frame: frame.clone() });
        }
        let Some(topic) = topic else {
            let mut possible = possible_references(self.content, odometry_topic);
            possible.extend(self.motion.pairs(base));
            let possible = match possible.is_empty() {
                true => String::new(),
                false => format!("; --reference-topic could take {}", possible.join(", ")),
            };
            if self.options.reference == ReferencePoses::Recorded {
                return Err(BagError::NoReference { possible, topics: self.content.list() });
            }
            self.notes.push(format!("reference: none{possible}"));
            return Ok(Reference::default());
        };
        let pair = Pair::of(topic).filter(|_| poses.is_empty());
        let frames = pair.and_then(|pair| pair.frames(|frame| self.motion.knows(frame)));
        let (samples, child, doubt) = match (pair, frames) {
            (None, _) => (
                self.samples(poses),
                poses.first().and_then(|pose| pose.value.child.clone()),
                out_of_plane(poses.iter().map(|pose| pose.value.in_space)),
            ),
            (Some(_), Some((parent, child))) => match self.motion.poses_in_space(parent, child) {
                Some(poses) => {
                    let doubt = out_of_plane(poses.iter().map(|(_, pose)| in_space_of(pose)));
                    let planar = poses.iter().map(|(at, pose)| (*at, planar(pose)));
                    (planar.collect(), Some(child.to_owned()), doubt)
                }
                None => return Err(self.no_pair(topic)),
            },
            (Some(_), None) => return Err(self.no_pair(topic)),
        };
        self.report.doubts.extend(doubt.map(|doubt| format!("reference: {topic}: {doubt}")));
        let count = samples.len();
        let Some(track) = PoseTrack::new(samples, self.longest) else {
            self.assumptions.push(format!("reference: {topic} has no readable message"));
            return Ok(Reference::default());
        };
        self.say_unstamped(REFERENCE, poses);
        Ok(Reference {
            track: Some(self.track(track, REFERENCE)),
            name: format!("{topic}, {}", counted(count, "message")),
            frame: child.filter(|child| !child.is_empty()),
        })
    }

    /// A requested frame must exist: in the tree, or `elsewhere`.
    fn check_frame(
        &self,
        asked: Option<&str>,
        option: &'static str,
        elsewhere: impl Fn(&str) -> bool,
    ) -> Result<(), BagError> {
        match asked.filter(|frame| !self.motion.knows(frame) && !elsewhere(frame)) {
            Some(frame) => Err(BagError::NoFrame {
                frame: frame.to_owned(),
                option,
                frames: self.motion.frames(),
            }),
            None => Ok(()),
        }
    }

    fn no_pair(&self, topic: &str) -> BagError {
        BagError::NoPair { topic: topic.to_owned(), frames: self.motion.frames() }
    }

    /// Mount of the laser on the child frame of the reference, `None` where that is the robot's; and the
    /// frame's name.
    fn reference_mount(
        &mut self,
        child: Option<String>,
        base: &str,
        laser: &str,
        mount: LaserMount,
    ) -> Result<(Option<LaserMount>, String), BagError> {
        let asked = self.options.reference_frame.clone();
        self.report.doubts.extend(of_unknown_frame(self.options, mount.robot_from_laser));
        let frame = match asked.or(child).as_deref() {
            Some("robot") | None => base.to_owned(),
            Some("laser") => laser.to_owned(),
            Some(frame) => frame.to_owned(),
        };
        if frame == base {
            return Ok((None, frame));
        }
        if frame == laser {
            return Ok((Some(LaserMount::IDENTITY), frame));
        }
        let found = self.motion.any_mount(&frame, laser)?;
        let found = found.map(|mount| self.of_scans(mount, &frame, laser)).transpose()?;
        if found.is_none() {
            self.report.doubts.push(format!(
                "reference: its poses are of frame {frame:?}, which no transforms connect with {laser:?}; they are taken as those of {base:?} (--reference-frame robot, laser or NAME changes this)"
            ));
            return Ok((Some(mount), base.to_owned()));
        }
        Ok((found, frame))
    }

    /// The error for poses that were recorded at another time than the scans.
    fn check_overlap(
        &self,
        track: &Track,
        reference: &str,
        moments: &[Moment],
    ) -> Result<(), BagError> {
        let (start, end) = track.span();
        let times = || moments.iter().map(|moment| moment.at);
        let scan_start = times().min().unwrap_or_default();
        let scan_end = times().max().unwrap_or_default();
        if track.what != REFERENCE || end >= scan_start && start <= scan_end {
            return Ok(());
        }
        Err(BagError::NoOverlap {
            topic: reference.to_owned(),
            scan_topic: self.scan_topic.to_owned(),
            reference_start: Stamp::from_nanoseconds(start),
            reference_end: Stamp::from_nanoseconds(end),
            scan_start: Stamp::from_nanoseconds(scan_start),
            scan_end: Stamp::from_nanoseconds(scan_end),
        })
    }
}

const REFERENCE: &str = "reference";

/// The reference of a recording.
#[derive(Default)]
struct Reference {
    track: Option<Track>,
    name: String,
    frame: Option<String>,
}
