//! Raw odometry from the `ODOM` lines between the scans of a log.
//!
//! In a corrected log the `ODOM` line after a scan restarts at the corrected pose just written, and the lines
//! after it follow raw odometry from there. The restart is recognized by its pose; its stamp is uninitialised
//! memory.

use mcl_core::Pose2;

/// Largest difference per component (metres, radians) between the pose of a scan and the `ODOM`
/// line before it that still counts as the same pose: the last digit of `%f`.
const SAME_POSE: f64 = 1e-6;

/// What the `ODOM` lines say about the motion from the previous kept scan to this one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gap {
    /// The robot's motion, if `ODOM` lines restart at the pose of each scan.
    pub restarted: Option<Pose2>,
    /// The last `ODOM` line since the scan before.
    pub last: Option<Pose2>,
}

/// Statistics over all pairs of neighbouring scans on whether `ODOM` lines restart at each scan.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Evidence {
    /// Number of `ODOM` lines in the log.
    pub lines: usize,
    /// Pairs of scans with `ODOM` lines between them, and how many of these gaps begin with the pose of the
    /// previous scan.
    pub gaps: usize,
    pub restarts: usize,
    /// The same for the pairs with at least two lines between them. A single line is inconclusive: a raw log
    /// that writes each odometry reading after the scan it belongs to looks the same.
    pub conclusive_gaps: usize,
    pub conclusive_restarts: usize,
    /// Conclusive gaps after which the scan's pose differs from the line before it.
    pub jumps: usize,
}

impl Evidence {
    /// Whether at least nine in ten gaps begin with the pose of the previous scan.
    pub fn mostly_restarts(&self) -> bool {
        self.gaps > 0 && self.restarts * 10 >= self.gaps * 9
    }

    /// Whether the log was corrected scan by scan: `ODOM` lines restart at the poses of scans, and these
    /// poses differ from where the odometry led. `None` where the lines are inconclusive: there are too few,
    /// or the restarts could be those of a robot that stops for each scan.
    pub fn corrected(&self) -> Option<bool> {
        if self.conclusive_gaps == 0 {
            return None;
        }
        if self.conclusive_restarts * 10 < self.conclusive_gaps * 9 {
            return Some(false);
        }
        (self.jumps * 2 > self.conclusive_gaps).then_some(true)
    }
}

/// Follows the `ODOM` lines and scans of a log in order.
#[derive(Debug, Default)]
pub(super) struct OdometryChain {
    pub evidence: Evidence,
    /// Pose of the last kept scan.
    scan: Option<Pose2>,
    /// Motion since the last kept scan up to the last unreadable one after it; `None` when unknown.
    before_segment: Option<Pose2>,
    /// The pose at which the lines since the last scan, readable or not, start.
    segment_start: Option<Pose2>,
    segment_last: Option<Pose2>,
    /// Number of these lines.
    segment_lines: usize,
    /// Whether the next line is the restart after an unreadable scan, and has the pose of that scan.
    awaiting_restart: bool,
    /// Whether an unreadable record hides the start of the lines since the last kept scan.
    is_start_hidden: bool,
    /// First and last line since the last kept scan, and their number.
    first: Option<Pose2>,
    last: Option<Pose2>,
    lines: usize,
}

impl OdometryChain {
    /// An `ODOM` line.
    pub fn odom(&mut self, pose: Pose2) {
        if self.awaiting_restart {
            self.segment_start = Some(pose);
            self.awaiting_restart = false;
        }
        self.segment_last = Some(pose);
        self.segment_lines += 1;
        self.first = self.first.or(Some(pose));
        self.last = Some(pose);
        self.lines += 1;
        self.evidence.lines += 1;
    }

    /// An unreadable `ODOM` line. The lines around it still give the robot's motion, unless it was the only
    /// one with the pose of an unreadable scan.
    pub fn unreadable_odom(&mut self) {
        self.is_start_hidden |= self.first.is_none();
        self.awaiting_restart = false;
    }

    /// A scan that is kept, with the robot's pose as written in its record.
    pub fn scan(&mut self, robot: Pose2) -> Gap {
        self.weigh(robot);
        self.close_segment();
        let gap = Gap { restarted: self.before_segment, last: self.last };
        *self = OdometryChain {
            evidence: self.evidence,
            scan: Some(robot),
            before_segment: Some(Pose2::IDENTITY),
            segment_start: Some(robot),
            ..OdometryChain::default()
        };
        gap
    }

    /// A scan whose record cannot be read: the odometry restarts, at a pose that is known only from the next
    /// `ODOM` line.
    pub fn unreadable_scan(&mut self) {
        self.close_segment();
        self.segment_start = None;
        self.segment_last = None;
        self.segment_lines = 0;
        self.awaiting_restart = true;
        self.is_start_hidden = true;
    }

    /// A segment with only the restart has no information on the motion.
    fn close_segment(&mut self) {
        let is_restart_only =
            |start: &Pose2, last: &Pose2| self.segment_lines == 1 && is_same_pose(start, last);
        self.before_segment = match (self.before_segment, self.segment_start, self.segment_last) {
            (_, Some(start), Some(last)) if is_restart_only(&start, &last) => None,
            (Some(before), Some(start), Some(last)) => Some(before.compose(&start.between(&last))),
            _ => None,
        };
    }

    fn weigh(&mut self, robot: Pose2) {
        let (Some(scan), Some(first), Some(last)) = (self.scan, self.first, self.last) else {
            return;
        };
        if self.is_start_hidden {
            return;
        }
        let restarts = usize::from(first == scan);
        self.evidence.gaps += 1;
        self.evidence.restarts += restarts;
        if self.lines > 1 {
            let jumps = !is_same_pose(&robot, &last);
            self.evidence.conclusive_gaps += 1;
            self.evidence.conclusive_restarts += restarts;
            self.evidence.jumps += usize::from(jumps);
        }
    }
}

fn is_same_pose(a: &Pose2, b: &Pose2) -> bool {
    let is_far = |difference: f64| difference.abs() > SAME_POSE;
    !(is_far(a.x - b.x) || is_far(a.y - b.y) || is_far(b.between(a).theta))
}
