use mcl_core::{Point, Pose2, math, wrap_angle};

use super::settings::DriveSettings;

/// Radius in m of the curve driven at a waypoint, where both legs are long enough.
const CURVE_RADIUS: f64 = 0.5;

/// Below this radius (m), and above this angle (rad), the robot stops and turns on the spot.
const SMALLEST_RADIUS: f64 = 0.2;
const LARGEST_CURVE: f64 = 1.75;

/// Angles below this (rad) do not count as corners.
const STRAIGHT: f64 = 1e-9;

/// A straight leg of a route, up to its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Leg {
    /// Where the leg ends, in m.
    pub to: Point<2>,
    /// Whether the robot backs up, facing away from `to`.
    pub backward: bool,
}

/// One manoeuvre.
#[derive(Debug, Clone, Copy)]
enum Motion {
    /// Straight on with a constant heading; `length` is negative when backing up.
    Straight { from: Pose2, length: f64 },
    /// Along a circle, heading along its tangent.
    Curve { from: Pose2, radius: f64, sweep: f64 },
    /// On the spot.
    Turn { from: Pose2, sweep: f64 },
}

impl Motion {
    /// Time the motion takes, in s.
    fn duration(&self, drive: &DriveSettings) -> f64 {
        match *self {
            Motion::Straight { length, .. } => length.abs() / drive.speed,
            Motion::Curve { radius, sweep, .. } => {
                radius * sweep.abs() / drive.speed.min(radius * drive.turn_rate)
            }
            Motion::Turn { sweep, .. } => sweep.abs() / drive.turn_rate,
        }
    }

    /// Pose after the given fraction of the motion, from 0 to 1.
    fn pose(&self, fraction: f64) -> Pose2 {
        match *self {
            Motion::Straight { from, length } => {
                from.compose(&Pose2::new(fraction * length, 0.0, 0.0))
            }
            Motion::Curve { from, radius, sweep } => {
                let (sin, cos) = math::sin_cos(fraction * sweep);
                let side = sweep.signum();
                let step =
                    Pose2::new(radius * sin * side, radius * (1.0 - cos) * side, fraction * sweep);
                from.compose(&step)
            }
            Motion::Turn { from, sweep } => from.compose(&Pose2::new(0.0, 0.0, fraction * sweep)),
        }
    }
}

/// The robot's drive: straight lines, curves and turns on the spot, with a pose at every time.
///
/// The path is a closed formula of time, not an integrated motion, so no error accumulates along it.
#[derive(Debug, Clone)]
pub(super) struct Path {
    motions: Vec<Motion>,
    /// When each motion ends, in s from the start.
    ends: Vec<f64>,
}

impl Path {
    /// The path from `start` along the legs, with corners rounded where there is room.
    pub fn new(start: Point<2>, legs: &[Leg], drive: &DriveSettings) -> Self {
        let lines = lines(start, legs);
        let mut motions = Vec::new();
        // How much of the line the curve before it has already driven.
        let mut driven = 0.0;
        for (i, line) in lines.iter().enumerate() {
            let corner = lines.get(i + 1).and_then(|next| corner(line, next));
            let trimmed = match corner {
                Some(Motion::Curve { radius, sweep, .. }) => radius * math::tan(0.5 * sweep.abs()),
                _ => 0.0,
            };
            let sign = if line.backward { -1.0 } else { 1.0 };
            motions.push(Motion::Straight {
                from: line.from.compose(&Pose2::new(sign * driven, 0.0, 0.0)),
                length: sign * (line.length - driven - trimmed),
            });
            motions.extend(corner);
            driven = trimmed;
        }
        let mut time = 0.0;
        let ends = motions
            .iter()
            .map(|motion| {
                time += motion.duration(drive);
                time
            })
            .collect();
        Path { motions, ends }
    }

    /// Time the drive takes, in s.
    pub fn duration(&self) -> f64 {
        self.ends.last().copied().unwrap_or(0.0)
    }

    /// Pose at a time in s from the start, clamped to the drive; `None` for a path without legs.
    pub fn pose(&self, time: f64) -> Option<Pose2> {
        let index =
            self.ends.partition_point(|&end| end < time).min(self.ends.len().checked_sub(1)?);
        let begin = if index == 0 { 0.0 } else { self.ends[index - 1] };
        let duration = self.ends[index] - begin;
        let fraction =
            if duration > 0.0 { ((time - begin) / duration).clamp(0.0, 1.0) } else { 1.0 };
        Some(self.motions[index].pose(fraction))
    }

    /// Positions along the path at most `spacing` (m) apart.
    pub fn positions(&self, spacing: f64) -> Vec<Point<2>> {
        let mut positions = Vec::new();
        for motion in &self.motions {
            let length = match *motion {
                Motion::Straight { length, .. } => length.abs(),
                Motion::Curve { radius, sweep, .. } => radius * sweep.abs(),
                Motion::Turn { .. } => 0.0,
            };
            let pieces = (length / spacing).ceil().max(1.0) as usize;
            positions.extend((0..=pieces).map(|i| {
                let pose = motion.pose(i as f64 / pieces as f64);
                [pose.x, pose.y]
            }));
        }
        positions
    }
}

/// A leg with its start.
struct Line {
    /// Where it begins, with the robot's heading on it.
    from: Pose2,
    length: f64,
    backward: bool,
}

/// The legs as lines; legs of zero length have no direction and are left out.
fn lines(start: Point<2>, legs: &[Leg]) -> Vec<Line> {
    let mut lines = Vec::with_capacity(legs.len());
    let [mut x, mut y] = start;
    for &Leg { to, backward } in legs {
        let (dx, dy) = (to[0] - x, to[1] - y);
        let length = math::hypot(dx, dy);
        if length > 0.0 {
            let heading = if backward { math::atan2(-dy, -dx) } else { math::atan2(dy, dx) };
            lines.push(Line { from: Pose2::new(x, y, heading), length, backward });
            [x, y] = to;
        }
    }
    lines
}

/// The motion from the end of one line to the heading of the next: along a curve that is tangent to both, or
/// on the spot; `None` when the heading is the same.
fn corner(line: &Line, next: &Line) -> Option<Motion> {
    let sweep = wrap_angle(next.from.theta - line.from.theta);
    if sweep.abs() < STRAIGHT {
        return None;
    }
    let at = Pose2::new(next.from.x, next.from.y, line.from.theta);
    // A curve of radius r touches both lines at r·tan(sweep/2) from the corner.
    let half_tan = math::tan(0.5 * sweep.abs());
    let radius = CURVE_RADIUS.min(0.5 * line.length.min(next.length) / half_tan);
    if line.backward || next.backward || sweep.abs() > LARGEST_CURVE || radius < SMALLEST_RADIUS {
        return Some(Motion::Turn { from: at, sweep });
    }
    let from = at.compose(&Pose2::new(-radius * half_tan, 0.0, 0.0));
    Some(Motion::Curve { from, radius, sweep })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn forward(to: Point<2>) -> Leg {
        Leg { to, backward: false }
    }

    fn drive() -> DriveSettings {
        DriveSettings { speed: 0.5, turn_rate: 1.0, ..DriveSettings::default() }
    }

    fn assert_pose(path: &Path, time: f64, expected: (f64, f64, f64)) {
        let pose = path.pose(time).unwrap();
        let turn = wrap_angle(pose.theta - expected.2);
        assert!(
            pose.distance(&Pose2::new(expected.0, expected.1, 0.0)) < 1e-12 && turn.abs() < 1e-12,
            "at {time} s: {pose:?}, expected {expected:?}"
        );
    }

    #[test]
    fn a_corner_is_rounded_with_a_tangent_curve() {
        let path = Path::new([0.0, 0.0], &[forward([4.0, 0.0]), forward([4.0, 3.0])], &drive());
        // 3.5 m, a quarter of a circle of radius 0.5 m, 2.5 m, all at 0.5 m/s.
        assert!((path.duration() - (7.0 + FRAC_PI_2 + 5.0)).abs() < 1e-12);
        assert_pose(&path, 0.0, (0.0, 0.0, 0.0));
        assert_pose(&path, 7.0, (3.5, 0.0, 0.0));
        let half = 0.5 * std::f64::consts::FRAC_1_SQRT_2;
        assert_pose(&path, 7.0 + 0.5 * FRAC_PI_2, (3.5 + half, 0.5 - half, 0.25 * PI));
        assert_pose(&path, 7.0 + FRAC_PI_2, (4.0, 0.5, FRAC_PI_2));
        assert_pose(&path, 1e9, (4.0, 3.0, FRAC_PI_2));
    }

    #[test]
    fn the_robot_turns_on_the_spot_and_backs_up() {
        let back = Leg { to: [1.0, 0.0], backward: true };
        let path = Path::new([0.0, 0.0], &[forward([2.0, 0.0]), back], &drive());
        assert_pose(&path, 5.0, (1.5, 0.0, 0.0));
        let path = Path::new([0.0, 0.0], &[forward([2.0, 0.0]), forward([1.0, 0.0])], &drive());
        assert_pose(&path, 4.0 + 0.5 * PI, (2.0, 0.0, FRAC_PI_2));
        assert_pose(&path, 4.0 + PI, (2.0, 0.0, PI));
    }

    #[test]
    fn positions_leave_no_gap_and_the_empty_path_has_none() {
        let path = Path::new([0.0, 0.0], &[forward([4.0, 0.0]), forward([4.0, -3.0])], &drive());
        let positions = path.positions(0.1);
        for pair in positions.windows(2) {
            assert!((pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]) <= 0.1 + 1e-12);
        }
        assert_eq!(Path::new([0.0, 0.0], &[forward([0.0, 0.0])], &drive()).pose(0.0), None);
    }
}
