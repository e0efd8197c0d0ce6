//! Reads the lines of a log into a recording: one pass, then a decision on the kind of log.

use std::collections::BTreeSet;
use std::io::{self, BufRead, Read};

use mcl_core::{LaserScan, OutOfMemory, Pose2, ScanGeometry, memory};

use super::counts::{COUNTED_KINDS, Kinds};
use super::fields::Malformed;
use super::kind::{self, Content, LoggedScan};
use super::odometry::OdometryChain;
use super::record::{self, Laser, Part, Record, RecordKind, ScanRecord};
use crate::bag::moment::Moment;
use crate::bag::pairing::shared_stamps;
use crate::log::content::{Log, LogKind};
use crate::log::options::ReferencePoses;
use crate::log::report::ReadReport;
use crate::packed::damage;
use crate::room::{HEAP_BYTES, Room};

/// Longest line accepted, in bytes. A scan of 361 beams takes about 3 kB; without a limit, a binary file
/// could fill the memory.
pub const MAX_LINE_BYTES: usize = 1 << 20;

/// Why a text cannot be read as a CARMEN log.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CarmenError {
    /// Reading failed.
    #[error("cannot be read: {0}")]
    Io(io::Error),
    /// The scans need more memory than is available.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
    /// A line longer than any record.
    #[error("line {line} is longer than {MAX_LINE_BYTES} bytes, expected a CARMEN record per line")]
    LineTooLong {
        /// The line, from 1.
        line: usize,
    },
    /// No scan could be read.
    #[error(
        "no laser scan in {lines} lines ({kinds}), expected {expected} records of a CARMEN log{}{}",
        match on_request.join(" or ") { names if names.is_empty() => names, names => format!(" (--scan-topic {names} reads those)") },
        match report.to_string() { text if text.is_empty() => text, text => format!("\n{text}") }
    )]
    NoScan {
        /// Number of lines.
        lines: usize,
        /// The kinds of records found, with their counts.
        kinds: String,
        /// The kinds of scan records that were looked for.
        expected: &'static str,
        /// The kinds of scan records found that are read on request.
        on_request: Vec<&'static str>,
        /// What was skipped.
        report: Box<ReadReport>,
    },
}

/// Reads a log from its text. `file_name` is used only where the content is inconclusive (see [`super`]); it
/// may be empty.
///
/// Compressed data that ends early or is damaged ends the log, and [`ReadReport::truncated`] says
/// so; its last, incomplete line is dropped.
///
/// # Errors
/// [`CarmenError`] for a failing input, a line that is too long, and a text without a scan.
pub fn read(
    input: impl BufRead,
    file_name: &str,
    reference: ReferencePoses,
) -> Result<Log, CarmenError> {
    read_scans(input, file_name, reference, None)
}

/// A kind of scan records that can be requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScanKind {
    name: &'static str,
    /// The kind with the same syntax.
    like: &'static str,
}

impl ScanKind {
    /// All of them.
    pub const ALL: [ScanKind; 4] = [
        ScanKind { name: "FLASER", like: "FLASER" },
        ScanKind { name: "RLASER", like: "FLASER" },
        ScanKind { name: "ROBOTLASER1", like: "ROBOTLASER1" },
        ScanKind { name: "ROBOTLASER2", like: "ROBOTLASER1" },
    ];

    /// The laser whose scans they are.
    fn laser(self) -> Laser {
        match self.name {
            "RLASER" | "ROBOTLASER2" => Laser::Rear,
            _ => Laser::Front,
        }
    }

    /// The one of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name == name)
    }
}

/// [`read`], restricted to the scans of one kind of record where one is requested.
///
/// # Errors
/// As [`read`].
pub fn read_scans(
    mut input: impl BufRead,
    file_name: &str,
    reference: ReferencePoses,
    kind: Option<ScanKind>,
) -> Result<Log, CarmenError> {
    let mut pass = Pass { asked: kind, ..Pass::default() };
    let mut line = Vec::new();
    loop {
        line.clear();
        let limit = MAX_LINE_BYTES as u64 + 1;
        match input.by_ref().take(limit).read_until(b'\n', &mut line) {
            Ok(0) => break,
            Ok(_) if line.len() > MAX_LINE_BYTES => {
                return Err(CarmenError::LineTooLong { line: pass.lines + 1 });
            }
            Ok(_) => pass.line(&line)?,
            Err(error) => match damage(&error) {
                Some(reason) => {
                    let reason = format!("{reason} after line {}", pass.lines);
                    pass.report.truncated = Some(reason);
                    break;
                }
                None => return Err(CarmenError::Io(error)),
            },
        }
    }
    pass.finish(file_name, reference)
}

/// Steps between two beams by which the stated angle may be off: scanners of a full turn may count the first
/// beam twice.
const STEPS_OFF: f64 = 1.5;

const SCANS: &str = "scans";

/// The state kept while the lines are read.
#[derive(Default)]
struct Pass {
    lines: usize,
    /// Memory used by the scans.
    room: Room,
    /// The requested kind of scan records, the only one that is read.
    asked: Option<ScanKind>,
    scans: Vec<LoggedScan>,
    /// `RAWLASER1` scans with the odometry before them; kept only as long as no other kind occurs, as other
    /// kinds log the same scans again.
    raw_scans: Vec<LoggedScan>,
    raw_records: usize,
    raw_report: ReadReport,
    true_poses: usize,
    /// Kind of the first readable scan; the only one read from then on.
    scan_kind: Option<RecordKind>,
    odometry: OdometryChain,
    /// The last `ODOM` and `TRUEPOS` poses.
    last_odom: Option<Pose2>,
    last_truth: Option<Pose2>,
    has_neff: bool,
    /// The mount of the front laser according to the parameters, by [`Part`].
    front_laser: [Option<f64>; 3],
    /// The first and the last value of a part for which the parameters contradict each other.
    two_mounts: Option<(f64, f64)>,
    /// Angle covered and angle between two beams according to the parameters.
    fov: Option<f64>,
    resolution: Option<f64>,
    /// Number of `FLASER` records whose directions are set: records before the first parameters are set by
    /// these.
    settled: usize,
    /// How many of these got other directions than their number of beams implies.
    late: usize,
    /// Numbers of beams whose directions are from CARMEN's rule for any number, and those that contradict the
    /// parameters.
    ruled: BTreeSet<usize>,
    contradicted: BTreeSet<usize>,
    /// Scans that contradict the angle stated in their fields, and the remark on the worst.
    off: usize,
    farthest_off: Option<(f64, String)>,
    not_numbers: usize,
    /// Scans with readings that are not numbers, the number of such readings, and the first of them.
    scans_with_words: usize,
    words: usize,
    first_word: Option<(usize, Malformed)>,
    kinds: Kinds,
    ignored_kinds: Kinds,
    declared: ReferencePoses,
    report: ReadReport,
}

impl Pass {
    fn line(&mut self, text: &[u8]) -> Result<(), OutOfMemory> {
        let renamed;
        let mut line = text;
        const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
        self.lines += 1;
        if self.lines == 1 {
            line = line.strip_prefix(BYTE_ORDER_MARK).unwrap_or(line);
        }
        let mut kind = RecordKind::of(line);
        if kind != RecordKind::Comment
            || line.starts_with(b"#") && line.get(1).is_some_and(u8::is_ascii_alphabetic)
        {
            self.kinds.count(line);
        }
        if let Some(asked) = self.asked {
            let rest = line.trim_ascii_start().strip_prefix(asked.name.as_bytes());
            match rest.filter(|rest| rest.first().is_none_or(u8::is_ascii_whitespace)) {
                Some(rest) => {
                    renamed = [asked.like.as_bytes(), rest].concat();
                    line = &renamed;
                    kind = RecordKind::of(line);
                }
                None if kind.is_scan() => {
                    self.ignore(line);
                    return Ok(());
                }
                None => {}
            }
        }
        let is_scan = matches!(kind, RecordKind::Flaser | RecordKind::RobotLaser1);
        let is_again = self.scan_kind.is_some_and(|read| read != kind);
        if is_again && (is_scan || kind == RecordKind::RawLaser1) {
            self.ignore(line);
            return Ok(());
        }
        match record::parse(line) {
            Ok(Record::Scan(scan)) => {
                if self.scan_kind.is_none() {
                    self.scan_kind = Some(kind);
                    // They repeat the same scans.
                    self.raw_scans = Vec::new();
                    let records = std::mem::take(&mut self.raw_records);
                    self.ignore_all("RAWLASER1", records);
                }
                let scan = self.logged(scan)?;
                memory::reserve(&mut self.scans, 1, SCANS)?;
                self.scans.push(scan);
                if self.fov.is_some() || self.resolution.is_some() {
                    self.settle(self.scans.len() - 1);
                }
            }
            Ok(Record::RawScan(mut scan)) => {
                scan.robot = self.last_odom.unwrap_or(Pose2::IDENTITY);
                let scan = LoggedScan { has_pose: self.last_odom.is_some(), ..self.logged(scan)? };
                memory::reserve(&mut self.raw_scans, 1, SCANS)?;
                self.raw_scans.push(scan);
                self.raw_records += 1;
            }
            Ok(Record::Odom(pose)) => {
                self.last_odom = Some(pose);
                self.odometry.odom(pose);
            }
            Ok(Record::TruePos(pose)) => {
                self.last_truth = Some(pose);
                self.true_poses += 1;
            }
            Ok(Record::FrontLaser(part, value)) => {
                let before = self.front_laser[part as usize].replace(value);
                let differs = before.filter(|&before| before != value);
                self.two_mounts = differs.map(|before| (before, value)).or(self.two_mounts);
            }
            Ok(Record::LaserFov(laser, angle)) if laser == self.laser() => self.fov = Some(angle),
            Ok(Record::LaserResolution(laser, angle)) if laser == self.laser() => {
                self.resolution = Some(angle);
            }
            Ok(Record::LaserFov(..) | Record::LaserResolution(..)) => {}
            Ok(Record::ReferencePoses(declared)) => self.declared = declared,
            Ok(Record::Nothing) => {}
            Ok(Record::Ignored) => {
                self.has_neff |= line.trim_ascii_start().starts_with(b"NEFF");
                self.ignore(line);
            }
            Err(malformed) if kind == RecordKind::RawLaser1 => {
                self.raw_records += 1;
                self.raw_report.skip(malformed.at_line(self.lines));
            }
            Err(malformed) => {
                if is_scan {
                    self.odometry.unreadable_scan();
                } else if kind == RecordKind::Odom {
                    self.odometry.unreadable_odom();
                }
                self.report.skip(malformed.at_line(self.lines));
            }
        }
        Ok(())
    }

    fn ignore(&mut self, line: &[u8]) {
        self.report.ignored += 1;
        self.ignored_kinds.count(line);
    }

    /// The laser whose scans are read.
    fn laser(&self) -> Laser {
        self.asked.map_or(Laser::Front, ScanKind::laser)
    }

    /// The mount of the laser according to the parameters, if they state it.
    fn mount(&self) -> Option<Pose2> {
        let [x, y, theta] = self.front_laser.map(Option::unwrap_or_default);
        let is_said = self.front_laser.iter().any(Option::is_some);
        (is_said && self.laser() == Laser::Front).then(|| Pose2::new(x, y, theta))
    }

    fn ignore_all(&mut self, kind: &str, count: usize) {
        if count > 0 {
            self.report.ignored += count;
            self.ignored_kinds.add(kind.to_owned(), count);
        }
    }

    fn logged(&mut self, scan: ScanRecord) -> Result<LoggedScan, OutOfMemory> {
        self.room.take(
            size_of_val(&*scan.ranges) + HEAP_BYTES,
            self.scans.len() * size_of::<LoggedScan>(),
        )?;
        let not_numbers = scan.ranges.iter().filter(|range| range.is_nan()).count();
        self.not_numbers += not_numbers - scan.unreadable;
        self.words += scan.unreadable;
        self.scans_with_words += usize::from(scan.unreadable > 0);
        if let (None, Some(fault)) = (&self.first_word, scan.first_unreadable) {
            self.first_word = Some((self.lines, fault));
        }
        let steps = scan.fov.map_or(0.0, |fov| record::steps_off(&scan.geometry, fov));
        if steps > STEPS_OFF {
            self.off += 1;
            if self.farthest_off.as_ref().is_none_or(|(worst, _)| steps > *worst) {
                let ScanGeometry { beams, angle_step, .. } = scan.geometry;
                let message = format!(
                    "line {}: {beams} readings with resolution {angle_step:.6} cover {:.4} rad, fov is {:.4}",
                    self.lines,
                    angle_step.abs() * (beams - 1) as f64,
                    scan.fov.unwrap_or_default()
                );
                self.farthest_off = Some((steps, message));
            }
        }
        let gap = self.odometry.scan(scan.robot);
        Ok(LoggedScan {
            laser: scan.laser,
            robot: scan.robot,
            truth: self.last_truth.take(),
            has_pose: true,
            gap,
            scan: LaserScan {
                stamp: scan.stamp,
                geometry: scan.geometry,
                ranges: scan.ranges,
                map_from_laser: None,
                odometry: None,
                sweep: Default::default(),
            },
        })
    }

    /// Sets the directions of the `FLASER` records that have none yet; the first `before` came before the
    /// parameters.
    fn settle(&mut self, before: usize) {
        while self.scan_kind == Some(RecordKind::Flaser) && self.settled < self.scans.len() {
            let implied = self.scans[self.settled].scan.geometry;
            let found = self.flaser_geometry(implied);
            self.late += usize::from(self.settled < before && found != implied);
            self.scans[self.settled].scan.geometry = found;
            self.settled += 1;
        }
    }

    /// Directions of the beams of a `FLASER` record: by the parameters of the log where they fit the number
    /// of beams, else those that the number implies.
    fn flaser_geometry(&mut self, implied: ScanGeometry) -> ScanGeometry {
        let beams = implied.beams;
        let by_parameters = record::parameter_geometry(beams, self.fov, self.resolution);
        let contradicts = |geometry: &ScanGeometry| {
            let other = ScanGeometry {
                angle_step: self.resolution.unwrap_or(geometry.angle_step),
                ..*geometry
            };
            let fov = self.fov.unwrap_or_else(|| {
                (geometry.beams.saturating_sub(1) as f64 * geometry.angle_step).abs()
            });
            record::steps_off(&other, fov) > STEPS_OFF
        };
        match by_parameters {
            // Rounded, and so less exact than those implied by the number of beams.
            Some(found) if !is_alike(&found, &implied) => found,
            Some(_) => implied,
            None => {
                let numbers = match contradicts(&implied) {
                    true => Some(&mut self.contradicted),
                    false => record::flaser_geometry(beams).is_none().then_some(&mut self.ruled),
                };
                if let Some(numbers) = numbers.filter(|numbers| numbers.len() < COUNTED_KINDS) {
                    numbers.insert(beams);
                }
                implied
            }
        }
    }

    fn finish(mut self, file_name: &str, reference: ReferencePoses) -> Result<Log, CarmenError> {
        let is_raw = self.scans.is_empty();
        self.settle(self.scans.len());
        if is_raw {
            self.scans = std::mem::take(&mut self.raw_scans);
            let mount = self.mount().unwrap_or(Pose2::IDENTITY);
            for scan in &mut self.scans {
                scan.laser = scan.robot.compose(&mount);
            }
            self.report.skipped += self.raw_report.skipped;
            self.report.skipped_details.append(&mut self.raw_report.skipped_details);
        }
        let on_request = ScanKind::ALL.into_iter().map(|kind| kind.name);
        let on_request = on_request.filter(|kind| self.ignored_kinds.has(kind)).collect::<Vec<_>>();
        if self.scans.is_empty() {
            return Err(CarmenError::NoScan {
                lines: self.lines,
                kinds: self.kinds.list(),
                expected: self.asked.map_or("FLASER, ROBOTLASER1 or RAWLASER1", |asked| asked.name),
                on_request,
                // Those that were ignored are among the kinds.
                report: Box::new(ReadReport { ignored: 0, ..self.report }),
            });
        }
        let (mut notes, mut assumptions) = (Vec::new(), Vec::new());
        if let Some((line, fault)) = &self.first_word {
            self.report.doubts.push(format!(
                "readings: {} in {} of {} scans are not numbers (line {line}: {} is {}): no measurement there",
                self.words,
                self.scans_with_words,
                self.scans.len(),
                fault.field,
                fault.found
            ));
        }
        if let Some((first, last)) = self.two_mounts {
            self.report.doubts.push(format!(
                "laser: the parameters give two mounts on the robot ({first} and {last}); the last is used"
            ));
        }
        if self.late > 0 {
            assumptions.push(format!(
                "scans: the parameters of their directions come after the first {}, but are used for these, too",
                self.late
            ));
        }
        if is_raw {
            let without = self.scans.iter().filter(|scan| !scan.has_pose).count();
            assumptions.push(format!(
                "scans: RAWLASER1 records have no pose; that of the ODOM record before each is used{}",
                match without {
                    0 => String::new(),
                    without => format!(", which {without} of {} do not have: neither odometry nor a reference pose there", self.scans.len()),
                }
            ));
        }
        let numbers =
            |of: &BTreeSet<usize>| of.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
        if let Some((_, worst)) = &self.farthest_off {
            self.report.doubts.push(format!(
                "scans: in {} of {} the fields of the directions contradict each other ({worst}); resolution is used",
                self.off,
                self.scans.len()
            ));
        }
        if !self.contradicted.is_empty() {
            let shown = |angle: Option<f64>| {
                angle.map_or("not given".to_owned(), |a| format!("{:.2}°", a.to_degrees()))
            };
            self.report.doubts.push(format!(
                "scans: the parameters (field of view {}, resolution {}) contradict FLASER records of {} beams; CARMEN's default directions for that number of beams are used",
                shown(self.fov),
                shown(self.resolution),
                numbers(&self.contradicted)
            ));
        }
        if !self.ruled.is_empty() {
            assumptions.push(format!(
                "scans: no parameters give the directions of FLASER records of {} beams; CARMEN's own rule is used: 100° for 400 and 401 beams, else 180°, evenly spaced",
                numbers(&self.ruled)
            ));
        }
        if self.not_numbers > 0 {
            notes.push(format!("readings that are not numbers: {}, no returns", self.not_numbers));
        }
        let stamps = self.scans.iter().filter_map(|scan| scan.scan.stamp);
        let stamps: Vec<_> = stamps.map(Moment::only).collect();
        self.report.unusable_stamps = self.scans.len() - stamps.len();
        if let Some((message, are_many)) = shared_stamps(stamps.into_iter()) {
            let list = if are_many { &mut self.report.doubts } else { &mut assumptions };
            list.push(format!("stamps: {message}"));
        }
        let content = Content {
            scans: std::mem::take(&mut self.scans),
            evidence: self.odometry.evidence,
            has_neff: self.has_neff,
            is_named_gfs: file_name.contains(".gfs."),
            front_laser: self.mount(),
        };
        let reference = if reference == ReferencePoses::Auto { self.declared } else { reference };
        let (kind, recording) = kind::resolve(content, reference);
        if kind != LogKind::RawWithTruth {
            self.ignore_all("TRUEPOS", self.true_poses);
        }
        if self.report.ignored > 0 {
            let others = on_request.into_iter().map(|kind| {
                format!("scans: --scan-topic {kind} reads those of the {kind} records instead")
            });
            let list = format!("ignored records: {}", self.ignored_kinds.list());
            notes.splice(..0, std::iter::once(list).chain(others));
        }
        self.report.ignored_kinds = self.ignored_kinds.named();
        let records = self.asked.map_or("the scans' records", |asked| asked.name);
        let has_reference = recording.scans.iter().any(|scan| scan.map_from_laser.is_some());
        let used = has_reference.then(|| match kind {
            LogKind::RawWithTruth => "TRUEPOS records, poses of the robot".to_owned(),
            _ => format!("poses of the laser in {records}"),
        });
        Ok(Log {
            recording,
            kind,
            reference: used,
            report: self.report,
            front_laser_offset: self.front_laser[Part::Ahead as usize],
            notes,
            survey: None,
            assumptions,
        })
    }
}

fn is_alike(a: &ScanGeometry, b: &ScanGeometry) -> bool {
    let last = a.beams.saturating_sub(1);
    (a.start_angle - b.start_angle).abs().max((a.angle(last) - b.angle(last)).abs()) < 0.01
}
