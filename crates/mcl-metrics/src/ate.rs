use mcl_core::{Point, Pose2, math};

use crate::error::{MetricsError, check_poses};

/// How the estimate is aligned before absolute errors are computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Alignment {
    /// No alignment: both trajectories are in the same map frame.
    #[default]
    None,
    /// The rotation and translation that move the first pose of the estimate to that of the reference (evo's
    /// `--align_origin`).
    Origin,
    /// The rotation and translation that fit the positions of the estimate to those of the reference by least
    /// squares (Umeyama 1991, without scale).
    Rigid,
}

/// Absolute trajectory errors (absolute pose errors, APE, in evo): one sample per pair of
/// poses, from the error transform E = reference⁻¹ ∘ estimate.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Ate {
    /// The alignment that was applied to the estimate; the identity without alignment.
    pub reference_from_estimate: Pose2,
    /// Distances between positions, in metres (evo's `trans_part`).
    pub translation: Vec<f64>,
    /// Rotation angles within [0, π], in radians (evo's `angle_rad`).
    pub rotation: Vec<f64>,
    /// ‖E − I‖ of the homogeneous matrices, without unit (Frobenius norm; evo's `full`).
    pub full: Vec<f64>,
}

/// Computes the absolute trajectory error of matched poses, as defined by evo.
///
/// # Errors
/// If the numbers of poses differ, there is none, one is not finite or too far away, or the positions do not
/// determine the alignment.
pub fn ate(
    reference: &[Pose2],
    estimate: &[Pose2],
    alignment: Alignment,
) -> Result<Ate, MetricsError> {
    check_poses(reference, estimate)?;
    let reference_from_estimate = match alignment {
        Alignment::None => Pose2::IDENTITY,
        Alignment::Origin => reference[0].compose(&estimate[0].inverse()),
        Alignment::Rigid => align(reference, estimate)?,
    };
    let error = |(r, e): (&Pose2, &Pose2)| match alignment {
        // Computed without composing with the identity, so that the errors are exact.
        Alignment::None => r.between(e),
        Alignment::Origin | Alignment::Rigid => r.between(&reference_from_estimate.compose(e)),
    };
    let errors: Vec<Pose2> = reference.iter().zip(estimate).map(error).collect();
    Ok(Ate {
        reference_from_estimate,
        translation: errors.iter().map(translation).collect(),
        rotation: errors.iter().map(rotation).collect(),
        full: errors.iter().map(full).collect(),
    })
}

pub(crate) fn translation(error: &Pose2) -> f64 {
    math::hypot(error.x, error.y)
}

pub(crate) fn rotation(error: &Pose2) -> f64 {
    error.theta.abs()
}

/// ‖E − I‖² = ‖R − I‖² + ‖t‖², and ‖R − I‖² = 4 − 4·cos θ = 8·sin²(θ/2).
pub(crate) fn full(error: &Pose2) -> f64 {
    math::hypot(translation(error), 8_f64.sqrt() * math::sin(0.5 * error.theta))
}

/// The rigid motion that minimizes Σ‖r − (R·e + t)‖². In the plane, Umeyama's singular value
/// decomposition has a closed form: the angle of (Σ ē·r̄, Σ ē×r̄) over positions relative to their
/// means. Unlike evo's 3-D decomposition, this also works for positions on a line.
fn align(reference: &[Pose2], estimate: &[Pose2]) -> Result<Pose2, MetricsError> {
    let (reference_mean, estimate_mean) = (mean_position(reference), mean_position(estimate));
    let (mut dot, mut cross) = (0.0, 0.0);
    let (mut reference_spread, mut estimate_spread) = (0.0, 0.0);
    for (r, e) in reference.iter().zip(estimate) {
        let (rx, ry) = (r.x - reference_mean[0], r.y - reference_mean[1]);
        let (ex, ey) = (e.x - estimate_mean[0], e.y - estimate_mean[1]);
        dot += ex * rx + ey * ry;
        cross += ex * ry - ey * rx;
        reference_spread += rx * rx + ry * ry;
        estimate_spread += ex * ex + ey * ey;
    }
    // By Cauchy-Schwarz the left side is at most √(spread·spread). A tiny fraction of that is rounding, and its
    // direction is meaningless.
    if math::hypot(dot, cross) <= 1e-12 * (reference_spread * estimate_spread).sqrt() {
        return Err(MetricsError::Alignment { poses: reference.len() });
    }
    let rotation = Pose2::new(0.0, 0.0, math::atan2(cross, dot));
    let [x, y] = rotation.transform_point(estimate_mean);
    Ok(Pose2::new(reference_mean[0] - x, reference_mean[1] - y, rotation.theta))
}

/// Mean position, summed relative to the first one, so that the mean of equal positions is exact and positions far
/// from the origin keep their digits.
fn mean_position(poses: &[Pose2]) -> Point<2> {
    let (first, count) = (poses[0], poses.len() as f64);
    let x: f64 = poses.iter().map(|pose| pose.x - first.x).sum();
    let y: f64 = poses.iter().map(|pose| pose.y - first.y).sum();
    [first.x + x / count, first.y + y / count]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::summary::Summary;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn pose() -> impl Strategy<Value = Pose2> {
        (-50.0..50.0, -50.0..50.0, -PI..PI).prop_map(|(x, y, t)| Pose2::new(x, y, t))
    }

    fn tracks() -> impl Strategy<Value = (Vec<Pose2>, Vec<Pose2>)> {
        prop::collection::vec((pose(), pose()), 3..20).prop_map(|pairs| pairs.into_iter().unzip())
    }

    fn moved(motion: &Pose2, poses: &[Pose2]) -> Vec<Pose2> {
        poses.iter().map(|pose| motion.compose(pose)).collect()
    }

    fn squares(errors: &Ate) -> f64 {
        errors.translation.iter().map(|error| error * error).sum()
    }

    #[test]
    fn worked_by_hand() {
        let reference = [Pose2::IDENTITY, Pose2::new(1.0, 1.0, PI)];
        let estimate = [Pose2::new(3.0, 4.0, 0.0), Pose2::new(1.0, 1.0, -PI / 2.0)];
        let errors = ate(&reference, &estimate, Alignment::None).unwrap();
        assert_eq!(errors.translation, [5.0, 0.0]);
        assert_eq!(errors.rotation, [0.0, PI / 2.0]);
        // A quarter turn moves (1, 0) and (0, 1) by √2 each.
        assert!((errors.full[0] - 5.0).abs() < 1e-15 && (errors.full[1] - 2.0).abs() < 1e-15);
        let summary = Summary::of(&errors.translation).unwrap();
        assert_eq!((summary.rmse, summary.sse), (12.5_f64.sqrt(), 25.0));
    }

    #[test]
    fn positions_without_extent_cannot_be_aligned() {
        let still = [Pose2::new(1e6 + 0.1, -0.3, 1.0); 7];
        let moving: Vec<Pose2> = (0..7).map(|i| Pose2::new(f64::from(i), 0.0, 0.0)).collect();
        for (reference, estimate) in [(&still[..], &moving[..]), (&moving, &still)] {
            let error = ate(reference, estimate, Alignment::Rigid).unwrap_err();
            assert_eq!(error, MetricsError::Alignment { poses: 7 });
            assert!(ate(reference, estimate, Alignment::None).is_ok());
        }
        let aligned = ate(&moving, &moved(&Pose2::new(5.0, 1.0, 2.0), &moving), Alignment::Rigid);
        assert!(squares(&aligned.unwrap()) < 1e-24);
    }

    proptest! {
        #[test]
        fn zero_only_for_equal_poses((reference, estimate) in tracks()) {
            let same = ate(&reference, &reference, Alignment::None).unwrap();
            prop_assert!(same.full.iter().all(|&error| error == 0.0));
            let other = ate(&reference, &estimate, Alignment::None).unwrap();
            prop_assert!(other.full.iter().all(|&error| error > 0.0));
        }

        #[test]
        fn common_motion_changes_nothing((reference, estimate) in tracks(), motion in pose()) {
            for alignment in [Alignment::None, Alignment::Rigid] {
                let here = ate(&reference, &estimate, alignment).unwrap();
                let there = moved(&motion, &estimate);
                let there = ate(&moved(&motion, &reference), &there, alignment).unwrap();
                for (a, b) in here.translation.iter().zip(&there.translation) {
                    // The alignment of nearly uncorrelated tracks is poorly determined.
                    prop_assert!((a - b).abs() < 1e-8, "{a} {b}");
                }
            }
        }

        #[test]
        fn alignment_undoes_a_rigid_motion((reference, _) in tracks(), motion in pose()) {
            let aligned =
                ate(&reference, &moved(&motion, &reference), Alignment::Rigid).unwrap();
            prop_assert!(aligned.full.iter().all(|&error| error < 1e-11));
            let undone = motion.compose(&aligned.reference_from_estimate);
            prop_assert!(undone.x.abs() < 1e-11 && undone.y.abs() < 1e-11);
        }

        #[test]
        fn alignment_is_optimal((reference, estimate) in tracks(), nudge in pose()) {
            let best = ate(&reference, &estimate, Alignment::Rigid).unwrap();
            let unaligned = ate(&reference, &estimate, Alignment::None).unwrap();
            prop_assert!(squares(&best) <= squares(&unaligned) * (1.0 + 1e-12));
            let small = Pose2::new(nudge.x * 1e-3, nudge.y * 1e-3, nudge.theta * 1e-3);
            let near = moved(&small.compose(&best.reference_from_estimate), &estimate);
            let near = ate(&reference, &near, Alignment::None).unwrap();
            prop_assert!(squares(&best) <= squares(&near) * (1.0 + 1e-12));
        }
    }
}
