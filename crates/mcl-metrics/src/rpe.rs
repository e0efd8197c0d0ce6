use std::fmt;

use mcl_core::{Pose2, math};

use crate::ate::{full, rotation, translation};
use crate::error::{MetricsError, check_poses};

/// How far apart the two poses of a pair are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Delta {
    /// Metres along the path.
    Metres(f64),
    /// A number of poses.
    Frames(usize),
}

impl fmt::Display for Delta {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Delta::Metres(metres) => write!(f, "{metres} m"),
            Delta::Frames(frames) => write!(f, "{frames} frames"),
        }
    }
}

/// The path that says which poses are a [`Delta`] apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PairsFrom {
    /// The estimated path, as evo does unless told otherwise.
    #[default]
    Estimate,
    /// The reference path: the same pairs for every estimate.
    Reference,
}

/// Which pairs of poses are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RpeSettings {
    /// Distance between the poses of a pair.
    pub delta: Delta,
    /// With `false`, pairs follow one another: each begins where the one before ended, at the first
    /// pose that is at least `delta` further on. With `true`, a pair begins at every pose and ends
    /// where the path is nearest to `delta`.
    pub all_pairs: bool,
    /// With all pairs over metres: pairs whose distance is off by more than this part of `delta`
    /// are left out.
    pub relative_tolerance: f64,
    /// The path on which distances are measured.
    pub pairs_from: PairsFrom,
}

impl RpeSettings {
    /// Consecutive pairs on the estimated path, relative tolerance 0.1: evo's defaults.
    pub fn new(delta: Delta) -> Self {
        RpeSettings {
            delta,
            all_pairs: false,
            relative_tolerance: 0.1,
            pairs_from: PairsFrom::Estimate,
        }
    }

    fn check(&self) -> Result<(), MetricsError> {
        let setting = |name, found, expected| Err(MetricsError::Setting { name, found, expected });
        match self.delta {
            Delta::Metres(found) if !(found.is_finite() && found > 0.0) => {
                setting("delta", found, "a positive number of metres")
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

/// Relative pose errors: one sample per pair (i, j), of the error transform
/// E = (reference_i⁻¹ ∘ reference_j)⁻¹ ∘ (estimate_i⁻¹ ∘ estimate_j).
#[derive(Debug, Clone, PartialEq)]
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

/// Relative pose error of matched poses, as evo defines it (`evo_rpe`).
///
/// # Errors
/// When a setting is out of range, the numbers of poses differ, one is not finite or too far away, or no two poses
/// are `delta` apart.
pub fn rpe(
    reference: &[Pose2],
    estimate: &[Pose2],
    settings: &RpeSettings,
) -> Result<Rpe, MetricsError> {
    settings.check()?;
    check_poses(reference, estimate)?;
    let steps = step_lengths(match settings.pairs_from {
        PairsFrom::Estimate => estimate,
        PairsFrom::Reference => reference,
    });
    let poses = reference.len();
    let pairs = match (settings.delta, settings.all_pairs) {
        (Delta::Frames(frames), false) => {
            consecutive(&(0..poses).step_by(frames).collect::<Vec<_>>())
        }
        (Delta::Frames(frames), true) => (frames..poses).map(|j| (j - frames, j)).collect(),
        (Delta::Metres(metres), false) => consecutive(&ends_by_path(&steps, metres)),
        (Delta::Metres(metres), true) => {
            all_by_path(&steps, metres, metres * settings.relative_tolerance)
        }
    };
    if pairs.is_empty() {
        let delta = settings.delta.to_string();
        return Err(MetricsError::NoPairs { poses, delta, path_m: steps.iter().sum() });
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

/// Distance from each pose to the next, in metres. The square root of the sum, as numpy has it, and
/// not `hypot`: whether a straight run of equal steps has covered `delta` hangs on the last digit.
fn step_lengths(poses: &[Pose2]) -> Vec<f64> {
    let squared =
        |pair: &[Pose2]| math::square(pair[1].x - pair[0].x) + math::square(pair[1].y - pair[0].y);
    poses.windows(2).map(|pair| squared(pair).sqrt()).collect()
}

fn consecutive(indices: &[usize]) -> Vec<(usize, usize)> {
    indices.windows(2).map(|pair| (pair[0], pair[1])).collect()
}

/// The first pose, and then each pose at which `delta` metres have been covered since the last one.
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

/// For each pose the later pose whose distance along the path is nearest to `delta`, the first of
/// equally near ones, when it is off by `tolerance` metres at most.
fn all_by_path(steps: &[f64], delta: f64, tolerance: f64) -> Vec<(usize, usize)> {
    let mut covered = vec![0.0];
    covered.extend(steps.iter().scan(0.0, |sum, step| {
        *sum += step;
        Some(*sum)
    }));
    let mut pairs = Vec::new();
    for (i, &start) in covered.iter().enumerate().take(steps.len()) {
        let later = &covered[i + 1..];
        // Distances never fall along the path, so the nearest lies on either side of `delta`.
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

    fn line(xs: &[f64]) -> Vec<Pose2> {
        xs.iter().map(|&x| Pose2::new(x, 0.0, 0.0)).collect()
    }

    fn pairs(poses: &[Pose2], delta: Delta, all_pairs: bool) -> Vec<(usize, usize)> {
        let settings = RpeSettings { all_pairs, ..RpeSettings::new(delta) };
        rpe(poses, poses, &settings).unwrap().pairs
    }

    #[test]
    fn pairs_follow_the_path_or_the_count() {
        // Stands still at 1 m, then turns back: the path goes on although x falls.
        let poses = line(&[0.0, 0.5, 1.0, 1.0, 0.5, 0.0]);
        assert_eq!(pairs(&poses, Delta::Metres(0.75), false), [(0, 2), (2, 5)]);
        assert_eq!(pairs(&poses, Delta::Metres(1.0), true), [(0, 2), (1, 4), (2, 5), (3, 5)]);
        assert_eq!(pairs(&poses, Delta::Frames(2), false), [(0, 2), (2, 4)]);
        assert_eq!(pairs(&poses, Delta::Frames(4), true), [(0, 4), (1, 5)]);
    }

    #[test]
    fn a_constant_offset_is_no_relative_error_but_drift_is() {
        let reference = line(&[0.0, 1.0, 2.0, 3.0]);
        let settings = RpeSettings::new(Delta::Metres(1.0));
        let moved: Vec<Pose2> =
            reference.iter().map(|pose| Pose2::new(5.0, -2.0, 1.0).compose(pose)).collect();
        let errors = rpe(&reference, &moved, &settings).unwrap();
        assert!(errors.full.iter().all(|&error| error < 1e-15), "{errors:?}");
        let drifting = line(&[0.0, 1.1, 2.2, 3.3]);
        let errors = rpe(&reference, &drifting, &settings).unwrap();
        assert!(errors.translation.iter().all(|error| (error - 0.1).abs() < 1e-12), "{errors:?}");
    }

    #[test]
    fn the_path_of_either_side_says_the_pairs() {
        let (reference, estimate) = (line(&[0.0, 1.0, 2.0]), line(&[0.0, 0.6, 2.0]));
        let from = |pairs_from| {
            let settings = RpeSettings { pairs_from, ..RpeSettings::new(Delta::Metres(1.0)) };
            rpe(&reference, &estimate, &settings).unwrap().pairs
        };
        assert_eq!(from(PairsFrom::Reference), [(0, 1), (1, 2)]);
        assert_eq!(from(PairsFrom::Estimate), [(0, 2)]);
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
        /// The nearest later pose by looking at all of them, as evo does.
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
