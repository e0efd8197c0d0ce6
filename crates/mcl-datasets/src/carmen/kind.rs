//! Decides from the whole content of a log which of its poses are ground truth and where its odometry is.

use mcl_core::{LaserScan, Pose2, Recording, wrap_angle};

use super::odometry::{Evidence, Gap};
use crate::log::content::LogKind;
use crate::log::options::ReferencePoses;

/// A scan as logged, before the meaning of its poses is known.
pub(super) struct LoggedScan {
    /// Without reference and odometry.
    pub scan: LaserScan,
    pub laser: Pose2,
    pub robot: Pose2,
    /// Whether the two poses are stated, in the record or before it.
    pub has_pose: bool,
    /// The true pose of a simulated robot, by a `TRUEPOS` record before the scan.
    pub truth: Option<Pose2>,
    pub gap: Gap,
}

/// The content that the decision is based on. At least one scan.
pub(super) struct Content {
    pub scans: Vec<LoggedScan>,
    pub evidence: Evidence,
    pub has_neff: bool,
    pub is_named_gfs: bool,
    /// The mount of the front laser according to the parameters.
    pub front_laser: Option<Pose2>,
}

/// Decides on the kind of log, and fills in reference poses and odometry.
pub(super) fn resolve(content: Content, reference: ReferencePoses) -> (LogKind, Recording) {
    let constant_mount = constant_mount(&content.scans, content.front_laser);
    let detected = detect(&content, constant_mount.is_some());
    let has_truth = detected == LogKind::Raw
        && reference != ReferencePoses::None
        && content.scans.iter().any(|scan| scan.truth.is_some());
    let kind = match (detected, reference) {
        (LogKind::Raw, _) if has_truth => LogKind::RawWithTruth,
        // Laser poses that are ground truth at a fixed offset from the odometry fields make these ground
        // truth, too: raw odometry can only be in the ODOM lines.
        (LogKind::Raw, ReferencePoses::Recorded) => LogKind::GfsCorrected,
        _ => detected,
    };
    let robot_from_laser = constant_mount.or(content.front_laser).unwrap_or(Pose2::IDENTITY);
    let odometry = Odometry {
        kind,
        restarts: detected == LogKind::GfsCorrected || content.evidence.mostly_restarts(),
        are_fields_empty: are_odometry_fields_empty(&content, constant_mount.is_some()),
        robot_from_laser,
    };
    let has_reference = match reference {
        ReferencePoses::Auto => kind != LogKind::Raw,
        ReferencePoses::Recorded => true,
        ReferencePoses::None => false,
    };
    let increments: Vec<_> =
        content.scans.windows(2).map(|pair| odometry.increment(&pair[0], &pair[1])).collect();
    let scans = content
        .scans
        .into_iter()
        .zip(std::iter::once(None).chain(increments))
        .map(|(logged, odometry)| LaserScan {
            map_from_laser: match has_truth {
                true => logged.truth.map(|robot| robot.compose(&robot_from_laser)),
                false => (has_reference && logged.has_pose).then_some(logged.laser),
            },
            odometry,
            ..logged.scan
        })
        .collect();
    (kind, Recording { scans, robot_from_laser })
}

fn detect(content: &Content, is_mount_constant: bool) -> LogKind {
    if !is_mount_constant {
        return LogKind::CorrectedWithOdometry;
    }
    let corrected = content.evidence.corrected().unwrap_or(content.is_named_gfs);
    if content.has_neff || corrected { LogKind::GfsCorrected } else { LogKind::Raw }
}

/// The transform from the robot's to the laser's pose, if it is the same for all scans up to the rounding of
/// the text; exactly the identity where the two poses are equal. One scan in a hundred may differ: a wrong
/// digit must not change the interpretation of a whole log.
fn constant_mount(scans: &[LoggedScan], parameter: Option<Pose2>) -> Option<Pose2> {
    let mounts: Vec<Pose2> = scans.iter().map(|scan| scan.robot.between(&scan.laser)).collect();
    // Headings relative to one of them, so that the median does not fall between −π and π.
    let turn = |mount: &Pose2| wrap_angle(mount.theta - mounts[0].theta);
    let typical = Pose2::new(
        median(mounts.iter().map(|mount| mount.x)),
        median(mounts.iter().map(|mount| mount.y)),
        wrap_angle(mounts[0].theta + median(mounts.iter().map(turn))),
    );
    let farthest = scans
        .iter()
        .flat_map(|scan| [scan.laser.x, scan.laser.y, scan.robot.x, scan.robot.y])
        .fold(0.0, |farthest: f64, coordinate| farthest.max(coordinate.abs()));
    // Logs print six significant digits (`%g`) or six decimals (`%f`). A coordinate of 100 m is then
    // rounded by up to 0.5 mm, which adds up to 2√2 mm in the difference of two transforms between
    // two poses: 3·10⁻⁵ of the coordinate. A heading loses at most 5·10⁻⁶ rad.
    let tolerance = 1e-3 + 3e-5 * farthest;
    let heading_tolerance = 1e-3;
    let is_close = |mount: &Pose2| {
        mount.distance(&typical) <= tolerance
            && wrap_angle(mount.theta - typical.theta).abs() <= heading_tolerance
    };
    let outliers = mounts.iter().filter(|mount| !is_close(mount)).count();
    if outliers * 100 > scans.len() {
        return None;
    }
    // The parameter is not rounded.
    let is_equal = typical == Pose2::IDENTITY;
    Some(parameter.filter(|parameter| !is_equal && is_close(parameter)).unwrap_or(typical))
}

/// The median (the upper of the two middle values); 0 without values.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Whether the odometry fields beside the laser poses are empty: all are zero, and neither a laser that stays
/// in place with them nor an `ODOM` line shows that the robot stood still there.
fn are_odometry_fields_empty(content: &Content, is_mount_constant: bool) -> bool {
    let all_zero =
        content.scans.iter().all(|scan| [scan.robot.x, scan.robot.y, scan.robot.theta] == [0.0; 3]);
    all_zero && !(is_mount_constant && content.evidence.lines > 0)
}

/// The source of the increments.
struct Odometry {
    kind: LogKind,
    restarts: bool,
    are_fields_empty: bool,
    robot_from_laser: Pose2,
}

impl Odometry {
    /// Pose of the laser at `scan` in its frame at the previous scan.
    fn increment(&self, before: &LoggedScan, scan: &LoggedScan) -> Option<Pose2> {
        if !before.has_pose || !scan.has_pose {
            return None;
        }
        let robot_increment = match self.kind {
            LogKind::GfsCorrected if self.restarts => scan.gap.restarted,
            LogKind::GfsCorrected => Some(before.gap.last?.between(&scan.gap.last?)),
            _ if self.are_fields_empty => None,
            LogKind::Raw | LogKind::RawWithTruth => {
                return Some(before.laser.between(&scan.laser));
            }
            // A CARMEN log is never detected as a bag.
            LogKind::CorrectedWithOdometry | LogKind::Bag => {
                Some(before.robot.between(&scan.robot))
            }
        }?;
        Some(in_laser_frame(&robot_increment, &self.robot_from_laser))
    }
}

/// `M⁻¹ ∘ increment ∘ M`: the motion of the laser while the robot moves by `increment`.
fn in_laser_frame(robot_increment: &Pose2, robot_from_laser: &Pose2) -> Pose2 {
    if *robot_from_laser == Pose2::IDENTITY {
        return *robot_increment;
    }
    robot_from_laser.between(&robot_increment.compose(robot_from_laser))
}
