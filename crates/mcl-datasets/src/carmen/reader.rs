//! From the lines of a log to a recording, in one pass and then a decision on the kind of log.

use std::io::{self, BufRead, Read};

use mcl_core::LaserScan;

use super::kind::{self, Content, LoggedScan};
use super::odometry::OdometryChain;
use super::record::{self, Record, RecordKind};
use crate::log::content::Log;
use crate::log::options::ReferencePoses;
use crate::log::report::ReadReport;
use crate::packed::damage;

/// Longest line accepted, in bytes. A scan of 361 beams takes about 3 kB; without a limit, a file
/// that is no text at all could fill the memory.
pub const MAX_LINE_BYTES: usize = 1 << 20;

/// Why a text is no CARMEN log that can be read.
#[derive(Debug, thiserror::Error)]
pub enum CarmenError {
    /// Reading failed.
    #[error("cannot be read: {0}")]
    Io(io::Error),
    /// A line longer than any record.
    #[error("line {line} is longer than {MAX_LINE_BYTES} bytes, expected a CARMEN record per line")]
    LineTooLong {
        /// The line, from 1.
        line: usize,
    },
    /// No scan could be read.
    #[error(
        "no laser scan in {lines} lines, expected FLASER or ROBOTLASER1 records of a CARMEN log\n{report}"
    )]
    NoScan {
        /// Number of lines.
        lines: usize,
        /// What was ignored and skipped.
        report: Box<ReadReport>,
    },
}

/// Reads a log from its text. `file_name` settles only what the content leaves open (see
/// [`super`]); it may be empty.
///
/// Compressed data that ends early or is damaged ends the log, and [`ReadReport::truncated`] says
/// so; its last, incomplete line is dropped.
///
/// # Errors
/// [`CarmenError`] for a failing input, a line that is too long, and a text without a scan.
pub fn read(
    mut input: impl BufRead,
    file_name: &str,
    reference: ReferencePoses,
) -> Result<Log, CarmenError> {
    let mut pass = Pass::default();
    let mut line = Vec::new();
    loop {
        line.clear();
        let limit = MAX_LINE_BYTES as u64 + 1;
        match input.by_ref().take(limit).read_until(b'\n', &mut line) {
            Ok(0) => break,
            Ok(_) if line.len() > MAX_LINE_BYTES => {
                return Err(CarmenError::LineTooLong { line: pass.lines + 1 });
            }
            Ok(_) => pass.line(&line),
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

/// What is kept while the lines stream by.
#[derive(Default)]
struct Pass {
    lines: usize,
    scans: Vec<LoggedScan>,
    /// Kind of the first readable scan; the only one read from then on.
    scan_kind: Option<RecordKind>,
    odometry: OdometryChain,
    has_neff: bool,
    front_laser_offset: Option<f64>,
    declared: ReferencePoses,
    report: ReadReport,
}

impl Pass {
    fn line(&mut self, mut line: &[u8]) {
        const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";
        self.lines += 1;
        if self.lines == 1 {
            line = line.strip_prefix(BYTE_ORDER_MARK).unwrap_or(line);
        }
        let kind = RecordKind::of(line);
        let is_scan = matches!(kind, RecordKind::Flaser | RecordKind::RobotLaser1);
        if is_scan && self.scan_kind.is_some_and(|read| read != kind) {
            self.report.ignored += 1;
            return;
        }
        match record::parse(line) {
            Ok(Record::Scan(scan)) => {
                self.scan_kind = Some(kind);
                self.report.unusable_stamps += usize::from(scan.stamp.is_none());
                let gap = self.odometry.scan(scan.robot);
                self.scans.push(LoggedScan {
                    laser: scan.laser,
                    robot: scan.robot,
                    gap,
                    scan: LaserScan {
                        stamp: scan.stamp,
                        geometry: scan.geometry,
                        ranges: scan.ranges,
                        map_from_laser: None,
                        odometry: None,
                    },
                });
            }
            Ok(Record::Odom(pose)) => self.odometry.odom(pose),
            Ok(Record::FrontLaserOffset(offset)) => self.front_laser_offset = Some(offset),
            Ok(Record::ReferencePoses(declared)) => self.declared = declared,
            Ok(Record::Nothing) => {}
            Ok(Record::Ignored) => {
                self.has_neff |= line.trim_ascii_start().starts_with(b"NEFF");
                self.report.ignored += 1;
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
    }

    fn finish(self, file_name: &str, reference: ReferencePoses) -> Result<Log, CarmenError> {
        if self.scans.is_empty() {
            return Err(CarmenError::NoScan { lines: self.lines, report: Box::new(self.report) });
        }
        let content = Content {
            scans: self.scans,
            evidence: self.odometry.evidence,
            has_neff: self.has_neff,
            is_named_gfs: file_name.contains(".gfs."),
            front_laser_offset: self.front_laser_offset,
        };
        let reference = if reference == ReferencePoses::Auto { self.declared } else { reference };
        let (kind, recording) = kind::resolve(content, reference);
        Ok(Log {
            recording,
            kind,
            report: self.report,
            front_laser_offset: self.front_laser_offset,
            notes: Vec::new(),
            assumptions: Vec::new(),
        })
    }
}
