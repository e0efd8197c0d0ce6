use std::f64::consts::PI;
use std::fmt;

use mcl_core::{Pose2, Stamp, Trajectory, math, wrap_angle};

use crate::ate::{full, rotation, translation};
use crate::error::{MetricsError, check_poses};

/// Distance between the two poses of a pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Delta {
    /// Metres along the path.
    Metres(f64),
    /// A number of poses.
    Frames(usize),
    /// Seconds, by the stamps.
    Seconds(f64),
    /// Radians, at most π. For consecutive pairs this is the total rotation on the path between them, to either side;
    /// for all pairs it is the difference of the two headings.
    Radians(f64),
}

impl fmt::Display for Delta {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Delta::Metres(metres) => write!(f, "{metres} m"),
            Delta::Frames(frames) => write!(f, "{frames} frames"),
            Delta::Seconds(seconds) => write!(f, "{seconds} s"),
            Delta::Radians(radians) => write!(f, "{radians} rad"),
        }
    }
}

/// The path on which the poses of a pair are a [`Delta`] apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PairsFrom {
    /// The reference path: the same pairs for every estimate (evo's `--pairs_from_reference`).
    #[default]
    Reference,
    /// The estimated path, as in evo by default. Noise makes a path longer, so the poses of a pair are closer
    /// together, and the noisier of two estimates can appear better.
    Estimate,
}

/// Settings of [`rpe`]: which pairs of poses are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RpeSettings {
    /// Distance between the poses of a pair.
    pub delta: Delta,
    /// With `false`, pairs are consecutive: each begins where the previous one ended, and ends at the first
    /// pose that is at least `delta` farther along. With `true`, a pair begins at every pose and ends
    /// where the path length (or time) is nearest to `delta`; for an angle, all poses whose headings differ by it are
    /// paired.
    pub all_pairs: bool,
    /// For all pairs over metres, seconds or radians: pairs that differ from `delta` by more than this fraction of it
    /// are left out.
    pub relative_tolerance: f64,
    /// The path on which distances are measured.
    pub pairs_from: PairsFrom,
}

impl RpeSettings {
    /// Consecutive pairs on the reference path, relative tolerance 0.1.
    pub fn new(delta: Delta) -> Self {
        RpeSettings {
            delta,
            all_pairs: false,
            relative_tolerance: 0.1,
            pairs_from: PairsFrom::Reference,
        }
    }

    fn check(&self) -> Result<(), MetricsError> {
        let setting = |name, found, expected| Err(MetricsError::Setting { name, found, expected });
        match self.delta {
            Delta::Metres(found) if !(found.is_finite() && found > 0.0) => {
                setting("delta", found, "a positive number of metres")
            }
            Delta::Seconds(found) if !(found.is_finite() && found > 0.0) => {
                setting("delta", found, "a positive number of seconds")
            }
            Delta::Radians(found) if !(found > 0.0 && found <= PI) => {
                setting("delta", found, "radians above 0 and up to π")
            }
            Delta::Frames(0) => setting("delta", 0.0, "at least one frame"),
            _ if !(self.relative_tolerance.is_finite() && self.relative_tolerance >= 0.0) => {
                let expected = "a finite number, not negative";
                setting("relative tolerance", self.relative_tolerance, expected)
            }
            _ => Ok(()),
        }
    }
}

/// Relative pose errors: one sample per pair (i, j), from the error transform
/// E = (reference_i⁻¹ ∘ reference_j)⁻¹ ∘ (estimate_i⁻¹ ∘ estimate_j).
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Rpe {
    /// Indices (i, j) of the compared poses.
    pub pairs: Vec<(usize, usize)>,
    /// Lengths of the translation parts, in metres.
    pub translation: Vec<f64>,
    /// Rotation angles within [0, π], in radians.
    pub rotation: Vec<f64>,
    /// ‖E − I‖ of the homogeneous matrices, without unit (Frobenius norm).
    pub full: Vec<f64>,
}

/// Largest number of compared pairs: for an angle, their number grows with the square of that of poses.
const MAX_PAIRS: usize = 10_000_000;

/// Computes the relative pose error of matched poses, as defined by evo (`evo_rpe`; evo has no pairs by time). Stamps
/// are used only by [`Delta::Seconds`]; a step back in time counts as 0.
///
/// # Errors
/// If a setting is out of range, the numbers of poses differ, one is not finite or too far away, no two poses
/// are `delta` apart, or there are more than ten million such pairs.
pub fn rpe(
    reference: &Trajectory,
    estimate: &Trajectory,
    settings: &RpeSettings,
) -> Result<Rpe, MetricsError> {
    settings.check()?;
    let path = match settings.pairs_from {
        PairsFrom::Estimate => estimate,
        PairsFrom::Reference => reference,
    };
    let (reference, estimate) = (reference.poses(), estimate.poses());
    check_poses(reference, estimate)?;
    let poses = reference.len();
    let by = |steps: &[f64], delta: f64| match settings.all_pairs {
        true => all_by_path(steps, delta, delta * settings.relative_tolerance),
        false => consecutive(&ends_by_path(steps, delta)),
    };
    let pairs = match settings.delta {
        Delta::Frames(frames) if settings.all_pairs => {
            (frames..poses).map(|j| (j - frames, j)).collect()
        }
        Delta::Frames(frames) => consecutive(&(0..poses).step_by(frames).collect::<Vec<_>>()),
        Delta::Metres(metres) => by(&step_lengths(path.poses()), metres),
        // In integer nanoseconds, because floating-point tenths of a second would not add up to one.
        Delta::Seconds(seconds) => by(&step_times(path.stamps()), (seconds * 1e9).round().max(1.0)),
        Delta::Radians(radians) if settings.all_pairs => {
            all_by_angle(path.poses(), radians, radians * settings.relative_tolerance)?
        }
        Delta::Radians(radians) => by(&step_angles(path.poses()), radians),
    };
    if pairs.is_empty() {
        let delta = settings.delta.to_string();
        let sum = |steps: Vec<f64>| steps.iter().sum::<f64>();
        let extent = match settings.delta {
            Delta::Seconds(_) => format!("they last {} s", sum(step_times(path.stamps())) / 1e9),
            Delta::Radians(_) => format!("they turn by {} rad", sum(step_angles(path.poses()))),
            Delta::Metres(_) | Delta::Frames(_) => {
                format!("their path is {} m long", sum(step_lengths(path.poses())))
            }
        };
        return Err(MetricsError::NoPairs { poses, delta, extent });
    }
    let error = |&(i, j): &(usize, usize)| {
        reference[i].between(&reference[j]).between(&estimate[i].between(&estimate[j]))
    };
    let errors: Vec<Pose2> = pairs.iter().map(error).collect();
    Ok(Rpe {
        translation: errors.iter().map(translation).collect(),
        rotation: errors.iter().map(rotation).collect(),
        full: errors.iter().map(full).collect(),
        pairs,
    })
}

/// Distance from each pose to the next, in metres. Computed as the square root of the sum, like numpy, and
/// not with `hypot`: whether a straight run of equal steps has covered `delta` depends on the last digit.
fn step_lengths(poses: &[Pose2]) -> Vec<f64> {
    let squared =
        |pair: &[Pose2]| math::square(pair[1].x - pair[0].x) + math::square(pair[1].y - pair[0].y);
    poses.windows(2).map(|pair| squared(pair).sqrt()).collect()
}

/// Nanoseconds from each pose to the next; 0 for steps back in time.
fn step_times(stamps: &[Stamp]) -> Vec<f64> {
    stamps.windows(2).map(|pair| (pair[1].seconds_since(pair[0]) * 1e9).round().max(0.0)).collect()
}

/// Rotation from each pose to the next, within [0, π].
fn step_angles(poses: &[Pose2]) -> Vec<f64> {
    poses.windows(2).map(|pair| wrap_angle(pair[1].theta - pair[0].theta).abs()).collect()
}

/// All pairs whose headings differ by `delta` ± `tolerance`.
fn all_by_angle(
    poses: &[Pose2],
    delta: f64,
    tolerance: f64,
) -> Result<Vec<(usize, usize)>, MetricsError> {
    let accepted = delta - tolerance..=delta + tolerance;
    let mut pairs = Vec::new();
    for (i, from) in poses.iter().enumerate() {
        for (j, to) in poses.iter().enumerate().skip(i + 1) {
            if accepted.contains(&wrap_angle(to.theta - from.theta).abs()) {
                if pairs.len() == MAX_PAIRS {
                    return Err(MetricsError::TooManyPairs { limit: MAX_PAIRS });
                }
                pairs.push((i, j));
            }
        }
    }
    Ok(pairs)
}

fn consecutive(indices: &[usize]) -> Vec<(usize, usize)> {
    indices.windows(2).map(|pair| (pair[0], pair[1])).collect()
}

/// The first pose, and then each pose at which `delta` (in the unit of the steps) has been covered since the
/// previous one.
fn ends_by_path(steps: &[f64], delta: f64) -> Vec<usize> {
    let mut indices = vec![0];
    let mut covered = 0.0;
    for (from, step) in steps.iter().enumerate() {
        covered += step;
        if covered >= delta {
            indices.push(from + 1);
            covered = 0.0;
        }
    }
    indices
}

/// For each pose, the later pose whose distance along the path is nearest to `delta` (the first of
/// equally near ones), if it differs by at most `tolerance`; all in the unit of the steps.
fn all_by_path(steps: &[f64], delta: f64, tolerance: f64) -> Vec<(usize, usize)> {
    let mut covered = vec![0.0];
    covered.extend(steps.iter().scan(0.0, |sum, step| {
        *sum += step;
        Some(*sum)
    }));
    let mut pairs = Vec::new();
    for (i, &start) in covered.iter().enumerate().take(steps.len()) {
        let later = &covered[i + 1..];
        // Distances never decrease along the path, so the nearest is on either side of `delta`.
        let first_at_least = |distance: f64| later.partition_point(|end| end - start < distance);
        let after = first_at_least(delta);
        let before = after.checked_sub(1).map(|last| first_at_least(later[last] - start));
        let off = |k: usize| later.get(k).map_or(f64::INFINITY, |end| (end - start - delta).abs());
        let nearest = match before {
            Some(before) if off(before) <= off(after) => before,
            _ => after,
        };
        if off(nearest) <= tolerance {
            pairs.push((i, i + 1 + nearest));
        }
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A pose every tenth of a second.
    fn track(poses: impl Iterator<Item = Pose2>) -> Trajectory {
        (0..).map(|k| Stamp::from_nanoseconds(k * 100_000_000)).zip(poses).collect()
    }

    fn line(xs: &[f64]) -> Trajectory {
        track(xs.iter().map(|&x| Pose2::new(x, 0.0, 0.0)))
    }

    fn pairs(poses: &Trajectory, delta: Delta, all_pairs: bool) -> Vec<(usize, usize)> {
        let settings = RpeSettings { all_pairs, ..RpeSettings::new(delta) };
        rpe(poses, poses, &settings).unwrap().pairs
    }

    #[test]
    fn pairs_follow_the_path_or_the_count() {
        // Stops at 1 m, then turns back: the path length increases although x decreases.
        let poses = line(&[0.0, 0.5, 1.0, 1.0, 0.5, 0.0]);
        assert_eq!(pairs(&poses, Delta::Metres(0.75), false), [(0, 2), (2, 5)]);
        assert_eq!(pairs(&poses, Delta::Metres(1.0), true), [(0, 2), (1, 4), (2, 5), (3, 5)]);
        assert_eq!(pairs(&poses, Delta::Frames(2), false), [(0, 2), (2, 4)]);
        assert_eq!(pairs(&poses, Delta::Frames(4), true), [(0, 4), (1, 5)]);
    }

    #[test]
    fn a_constant_offset_is_not_a_relative_error_but_drift_is() {
        let reference = line(&[0.0, 1.0, 2.0, 3.0]);
        let settings = RpeSettings::new(Delta::Metres(1.0));
        let moved =
            track(reference.poses().iter().map(|pose| Pose2::new(5.0, -2.0, 1.0).compose(pose)));
        let errors = rpe(&reference, &moved, &settings).unwrap();
        assert!(errors.full.iter().all(|&error| error < 1e-15), "{errors:?}");
        let drifting = line(&[0.0, 1.1, 2.2, 3.3]);
        let errors = rpe(&reference, &drifting, &settings).unwrap();
        assert!(errors.translation.iter().all(|error| (error - 0.1).abs() < 1e-12), "{errors:?}");
    }

    #[test]
    fn the_path_of_either_side_determines_the_pairs() {
        let (reference, estimate) = (line(&[0.0, 1.0, 2.0]), line(&[0.0, 0.6, 2.0]));
        let from = |pairs_from| {
            let settings = RpeSettings { pairs_from, ..RpeSettings::new(Delta::Metres(1.0)) };
            rpe(&reference, &estimate, &settings).unwrap().pairs
        };
        assert_eq!(RpeSettings::new(Delta::Metres(1.0)).pairs_from, PairsFrom::Reference);
        assert_eq!(from(PairsFrom::Reference), [(0, 1), (1, 2)]);
        assert_eq!(from(PairsFrom::Estimate), [(0, 2)]);
    }

    /// The path of the estimate was once the default. With noise it is longer, so that "1 m" was a shorter part of the
    /// true path, and the noisier of two estimates appeared better.
    #[test]
    fn noise_of_an_estimate_makes_no_pair_shorter() {
        let straight: Vec<f64> = (0..41).map(|k| 0.25 * f64::from(k)).collect();
        let reference = line(&straight);
        let smooth = line(&straight.iter().map(|x| 1.02 * x).collect::<Vec<_>>());
        let y = |k: usize| if k.is_multiple_of(2) { 0.0 } else { 0.3 };
        let noisy =
            track(straight.iter().enumerate().map(|(k, x)| Pose2::new(1.02 * x, y(k), 0.0)));
        let settings = RpeSettings::new(Delta::Metres(1.0));
        let of = |estimate| rpe(&reference, estimate, &settings).unwrap();
        assert_eq!(of(&smooth).pairs, of(&noisy).pairs);
        assert_eq!(of(&smooth).pairs[..2], [(0, 4), (4, 8)]);
        let settings = RpeSettings { pairs_from: PairsFrom::Estimate, ..settings };
        assert_eq!(rpe(&reference, &noisy, &settings).unwrap().pairs[..2], [(0, 3), (3, 6)]);
    }

    #[test]
    fn pairs_by_time_follow_the_stamps() {
        let steady = line(&[0.0; 31]);
        // Ten tenths are a second.
        assert_eq!(pairs(&steady, Delta::Seconds(1.0), false), [(0, 10), (10, 20), (20, 30)]);
        // 2.8 and 2.7 s are within a tenth of 2.9 s, 2.6 s are not.
        assert_eq!(pairs(&steady, Delta::Seconds(2.9), true), [(0, 29), (1, 30), (2, 30), (3, 30)]);
        let stamps =
            [0, 400, 1100, 900, 1500, 1600].map(|ms| Stamp::from_nanoseconds(ms * 1_000_000));
        let poses = vec![Pose2::IDENTITY; stamps.len()];
        let uneven = Trajectory::new(stamps.to_vec(), poses).unwrap();
        // The step back from 1.1 to 0.9 s counts as 0; 0.6 s follow.
        assert_eq!(pairs(&uneven, Delta::Seconds(0.5), false), [(0, 2), (2, 4)]);
        let error = rpe(&uneven, &uneven, &RpeSettings::new(Delta::Seconds(5.0))).unwrap_err();
        assert!(error.to_string().contains("are 5 s apart (they last 1.8 s)"), "{error}");
    }

    #[test]
    fn pairs_by_angle_follow_the_turns_or_compare_headings() {
        // Turns left, right, and through ±π.
        let headings = [0.0, 0.3, 0.0, 0.3, 3.0, -3.0];
        let poses = track(headings.iter().map(|&theta| Pose2::new(0.0, 0.0, theta)));
        assert_eq!(pairs(&poses, Delta::Radians(0.5), false), [(0, 2), (2, 4)]);
        let settings = RpeSettings {
            all_pairs: true,
            relative_tolerance: 0.05,
            ..RpeSettings::new(Delta::Radians(0.29))
        };
        assert_eq!(
            rpe(&poses, &poses, &settings).unwrap().pairs,
            [(0, 1), (0, 3), (1, 2), (2, 3), (4, 5)]
        );
        for radians in [0.0, -1.0, 3.2, f64::NAN] {
            let error =
                rpe(&poses, &poses, &RpeSettings::new(Delta::Radians(radians))).unwrap_err();
            assert!(error.to_string().ends_with("expected radians above 0 and up to π"), "{error}");
        }
        let straight = line(&[0.0, 1.0]);
        let error = rpe(&straight, &straight, &RpeSettings::new(Delta::Radians(0.1))).unwrap_err();
        assert!(error.to_string().contains("0.1 rad apart (they turn by 0 rad)"), "{error}");
    }

    #[test]
    fn too_many_pairs_by_angle_are_refused() {
        let poses = track((0..6400).map(|k| Pose2::new(0.0, 0.0, f64::from(k % 2))));
        let settings = RpeSettings { all_pairs: true, ..RpeSettings::new(Delta::Radians(1.0)) };
        let error = rpe(&poses, &poses, &settings).unwrap_err();
        assert!(error.to_string().starts_with("more than 10,000,000 pairs"), "{error}");
    }

    #[test]
    fn what_cannot_be_computed_says_why() {
        let poses = line(&[0.0, 1.0, 2.5]);
        let error = |delta| rpe(&poses, &poses, &RpeSettings::new(delta)).unwrap_err().to_string();
        assert_eq!(
            error(Delta::Metres(10.0)),
            "no two of 3 poses are 10 m apart (their path is 2.5 m long): use a smaller delta, or a \
             larger relative tolerance with all pairs"
        );
        assert!(error(Delta::Frames(3)).starts_with("no two of 3 poses are 3 frames apart"));
        assert_eq!(error(Delta::Frames(0)), "delta is 0, expected at least one frame");
        assert_eq!(
            error(Delta::Metres(f64::NAN)),
            "delta is NaN, expected a positive number of metres"
        );
    }

    proptest! {
        /// The nearest later pose by a search through all of them, as in evo.
        #[test]
        fn all_pairs_agree_with_brute_force(
            steps in prop::collection::vec(0..4u8, 1..60),
            delta in 0.05..3.0f64,
            tolerance in 0.0..0.5f64,
        ) {
            let steps: Vec<f64> = steps.into_iter().map(|step| f64::from(step) * 0.1).collect();
            let mut covered = vec![0.0];
            for (i, step) in steps.iter().enumerate() {
                covered.push(covered[i] + step);
            }
            let mut expected = Vec::new();
            for i in 0..steps.len() {
                let off = |j: usize| (covered[j] - covered[i] - delta).abs();
                let (mut best, mut best_off) = (i + 1, off(i + 1));
                for j in i + 2..covered.len() {
                    if off(j) < best_off {
                        (best, best_off) = (j, off(j));
                    }
                }
                if best_off <= tolerance {
                    expected.push((i, best));
                }
            }
            prop_assert_eq!(all_by_path(&steps, delta, tolerance), expected);
        }
    }
}
