//! Places the beams of a scan where the laser was when it measured them, and projects them into the plane of
//! the robot.

use std::f64::consts::TAU;

use mcl_core::{Pose2, ScanGeometry, Sweep, is_usable_range, math};

use super::laser::LaserMount;
use super::messages::ScanMessage;
use super::moment::Moment;
use super::track::{Occurrence, Placed, PoseTrack};

/// A scan lasts at most as long as the interval to the next one, times this factor where stamps jitter.
const SWEEP_JITTER: f64 = 1.5;
const NANOSECONDS: f64 = 1e9;

/// The beams of a scan seen from above, in the frame of the laser at the scan's stamp.
#[derive(Debug, Default)]
struct Beams {
    ranges: Vec<f64>,
    directions: Vec<f64>,
    /// Readings left out because the pose at which they were measured is not known.
    lost: usize,
    /// The largest distance by which the correction moved an endpoint, in metres.
    farthest: f64,
}

/// Places the beams of a scan. `plane` maps coordinates in the plane of the scan to the robot's plane, seen
/// from above; `moved` gives the pose of the laser at a beam, in the frame of the laser at the stamp.
fn place(
    geometry: ScanGeometry,
    ranges: &[f64],
    plane: [[f64; 2]; 2],
    moved: impl Fn(usize) -> Option<Pose2>,
) -> Beams {
    let mut beams = Beams::default();
    for (beam, &range) in ranges.iter().enumerate() {
        let (sin, cos) = math::sin_cos(geometry.angle(beam));
        let level = plane.map(|[along, across]| along * cos + across * sin);
        let is_usable = is_usable_range(range, f64::INFINITY);
        let pose = moved(beam);
        let (range, [x, y]) = match (pose, is_usable) {
            (Some(pose), true) => {
                let end = pose.compose(&Pose2::new(range * level[0], range * level[1], 0.0));
                let carried = math::hypot(end.x - range * level[0], end.y - range * level[1]);
                beams.farthest = beams.farthest.max(carried);
                (math::hypot(end.x, end.y), [end.x, end.y])
            }
            (Some(pose), false) => {
                let (sin, cos) = math::sin_cos(pose.theta);
                let [x, y] = level;
                (range, [x * cos - y * sin, x * sin + y * cos])
            }
            (None, true) => {
                beams.lost += 1;
                (f64::NAN, level)
            }
            (None, false) => (range, level),
        };
        beams.ranges.push(range);
        beams.directions.push(math::atan2(y, x));
    }
    beams
}

/// Seconds from the first beam of a scan to its last.
pub(super) fn takes(scan: &ScanMessage) -> f64 {
    scan.time_increment * (scan.ranges.len() - 1) as f64
}

/// Whether the duration of a scan by `time_increment` is more than twice, or less than half, of its duration
/// by `scan_time`.
pub(super) fn contradicts_scan_time(scan: &ScanMessage) -> bool {
    let ScanGeometry { angle_step, beams, .. } = scan.geometry;
    let turned = (angle_step * (beams - 1) as f64).abs() / TAU;
    let (takes, turn) = (takes(scan), scan.scan_time);
    takes > 0.0 && turn > 0.0 && (takes > 2.0 * turn || takes < 0.5 * turn * turned.min(1.0))
}

/// The longest duration of a scan (s); a doubt where that is impossible because the next scan comes sooner.
pub(super) fn longest_sweep(
    takes: impl Iterator<Item = f64>,
    moments: &[Moment],
) -> Result<f64, String> {
    let longest = takes.max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0);
    let mut between: Vec<i64> = moments
        .windows(2)
        .filter(|pair| pair[0].stretch == pair[1].stretch && pair[0].at < pair[1].at)
        .map(|pair| pair[1].at - pair[0].at)
        .collect();
    let middle = between.len() / 2;
    let usual = match between.is_empty() {
        true => f64::INFINITY,
        false => *between.select_nth_unstable(middle).1 as f64 / NANOSECONDS,
    };
    match longest >= 0.0 && longest.is_finite() && longest <= SWEEP_JITTER * usual {
        true => Ok(longest),
        false => Err(format!(
            "by time_increment a scan takes {longest:.3} s, but there is one every {usual:.3} s; time_increment is not used, and beams are taken as measured at once"
        )),
    }
}

/// Statistics of scans whose beams were not measured at once.
#[derive(Default)]
pub(super) struct SweepStatistics {
    scans: usize,
    /// Scans whose beams were corrected for motion.
    placed: usize,
    lost: usize,
    farthest: f64,
    /// The longest duration of a scan (s).
    longest: f64,
}

impl SweepStatistics {
    /// How the beams were placed.
    pub fn note(&self, no_deskew: bool) -> Option<String> {
        let SweepStatistics { scans, placed, farthest, longest, .. } = *self;
        if no_deskew && scans > 0 {
            return Some(format!(
                "a scan takes {longest:.3} s; its beams are taken as measured at once, as requested"
            ));
        }
        (placed > 0).then(|| {
            format!(
                "a scan takes {longest:.3} s; beams of {placed} scans are placed where the laser was when they were measured, at most {farthest:.3} m from where they would be otherwise (--no-deskew takes them as they are)"
            )
        })
    }

    /// What is not known about them.
    pub fn assumptions(&self, no_deskew: bool) -> Vec<String> {
        let SweepStatistics { scans, placed, lost, longest, .. } = *self;
        let mut assumptions = Vec::new();
        if lost > 0 {
            assumptions.push(format!(
                "{lost} readings were measured at times for which neither odometry nor reference gives the pose of the laser; they are left out (--no-deskew takes them as measured at the stamp)"
            ));
        }
        if placed < scans && !no_deskew {
            assumptions.push(format!(
                "a scan takes {longest:.3} s, but for {} of {scans} neither odometry nor reference says how the laser moved meanwhile; their beams are taken as measured at once",
                scans - placed
            ));
        }
        assumptions
    }

    /// Takes the readings out of a scan and places its beams; returns them with the sweep.
    pub fn place(
        &mut self,
        scan: &mut ScanMessage,
        mount: LaserMount,
        time_increment: f64,
        moved: Option<LaserMotion<'_>>,
    ) -> (Vec<f64>, Sweep) {
        if time_increment != 0.0 {
            self.scans += 1;
            self.longest = self.longest.max(time_increment * (scan.ranges.len() - 1) as f64);
        }
        let measured = std::mem::take(&mut scan.ranges);
        let beams = |moved: &dyn Fn(usize) -> Option<Pose2>| {
            place(scan.geometry, &measured, mount.plane, moved)
        };
        let (found, time_increment) = match moved {
            None if !mount.is_tilted() => {
                return (measured, Sweep { time_increment, directions: None });
            }
            None => (beams(&|_| Some(Pose2::IDENTITY)), time_increment),
            Some(moved) => {
                self.placed += 1;
                let found = beams(&|beam| moved.at(beam));
                self.lost += found.lost;
                self.farthest = self.farthest.max(found.farthest);
                (found, 0.0)
            }
        };
        let Beams { ranges, directions, .. } = found;
        (ranges, Sweep { time_increment, directions: Some(directions) })
    }
}

/// The motion of the laser during a scan, by a track that covers the scan's start.
pub(super) struct LaserMotion<'a> {
    poses: &'a PoseTrack,
    mount: LaserMount,
    moment: Moment,
    start: Pose2,
    time_increment: f64,
}

impl<'a> LaserMotion<'a> {
    pub fn of(
        moment: Moment,
        occurrence: Occurrence,
        time_increment: f64,
        tracks: [(Option<&'a PoseTrack>, LaserMount); 2],
    ) -> Option<Self> {
        tracks.into_iter().find_map(|(track, mount)| {
            let poses = track?;
            let Placed::At(robot) = poses.at(moment, occurrence) else { return None };
            Some(LaserMotion { poses, mount, moment, start: mount.laser(robot), time_increment })
        })
    }

    /// The pose of the laser at a beam, in the frame of the laser at the stamp.
    fn at(&self, beam: usize) -> Option<Pose2> {
        let later = (beam as f64 * self.time_increment * NANOSECONDS).round() as i64;
        if later == 0 {
            return Some(Pose2::IDENTITY);
        }
        let moment = Moment { at: self.moment.at.saturating_add(later), ..self.moment };
        match self.poses.at(moment, Occurrence::ONLY) {
            Placed::At(robot) => Some(self.start.between(&self.mount.laser(robot))),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn endpoints_move_with_the_laser_and_into_the_plane() {
        let geometry = ScanGeometry { start_angle: 0.0, angle_step: FRAC_PI_2, beams: 4 };
        // Pitched by 60°: what is ahead is seen at half its distance.
        let plane = [[0.5, 0.0], [0.0, 1.0]];
        let moved = |beam| match beam {
            3 => None,
            beam => Some(Pose2::new(beam as f64, 0.0, 0.0)),
        };
        let beams = place(geometry, &[2.0, 2.0, f64::INFINITY, 1.0], plane, moved);
        assert!((beams.ranges[0] - 1.0).abs() < 1e-15 && beams.directions[0].abs() < 1e-15);
        assert!((beams.ranges[1] - 5.0_f64.sqrt()).abs() < 1e-15);
        assert!((beams.directions[1] - 2.0_f64.atan2(1.0)).abs() < 1e-15);
        assert_eq!((beams.ranges[2], beams.lost), (f64::INFINITY, 1));
        assert!(beams.ranges[3].is_nan() && (beams.directions[3] + FRAC_PI_2).abs() < 1e-15);
        assert!((beams.farthest - 1.0).abs() < 1e-15);
    }
}
