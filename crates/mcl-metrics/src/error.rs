use mcl_core::text::counted;
use mcl_core::{MAX_COORDINATE, Pose2, Stamp};
use serde::Serialize;

/// The error of a test or interval over too few blocks. Its message can be shown in a table in place of the p value.
///
/// # Example
/// ```
/// let reason = mcl_metrics::TooFew { blocks: 1, needed: 2 };
/// assert_eq!(reason.to_string(), "too few to tell: 1 independent block, at least 2 needed");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, thiserror::Error)]
#[error("too few to tell: {}, at least {needed} needed", counted(*.blocks, "independent block"))]
pub struct TooFew {
    /// Number of blocks found: for a paired test those common to both sides, for a two-sample test
    /// those of the smaller side.
    pub blocks: usize,
    /// Number of blocks needed.
    pub needed: usize,
}

/// An error in computing a metric.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MetricsError {
    /// A setting is outside its range.
    #[error("{name} is {found}, expected {expected}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// The value found.
        found: f64,
        /// The range expected.
        expected: &'static str,
    },
    /// There are fewer samples than the computation needs.
    #[error("{what}: found {found}, expected at least {needed}")]
    TooFew {
        /// What was counted.
        what: &'static str,
        /// Number found.
        found: usize,
        /// Number needed.
        needed: usize,
    },
    /// There are fewer independent blocks than a test or an interval needs.
    #[error(transparent)]
    TooFewBlocks(#[from] TooFew),
    /// A unit occurs more than once in its block.
    #[error(
        "block {block} holds unit {unit} more than once, expected each unit once, so that no value counts twice"
    )]
    RepeatedUnit {
        /// The block.
        block: u64,
        /// The unit.
        unit: u64,
    },
    /// A transformation, such as a logarithm, has no finite result for a value.
    #[error("the value {value} is transformed to {result}, expected a finite number")]
    Transformed {
        /// The value.
        value: f64,
        /// The result of the transformation.
        result: f64,
    },
    /// A sample is NaN, infinite, or too large to be squared.
    #[error("sample {index} is {value}, expected a finite number of magnitude below 1e140")]
    Sample {
        /// Index of the sample, from 0.
        index: usize,
        /// The sample.
        value: f64,
    },
    /// All samples are equal, but their spread is needed.
    #[error("all values are {value}, expected at least two different ones")]
    NoSpread {
        /// The value.
        value: f64,
    },
    /// An error in one of several sets of samples.
    #[error("{part}: {source}")]
    Within {
        /// The set: `run 3` (from 0), `a`.
        part: String,
        /// The error.
        source: Box<MetricsError>,
    },
    /// Two sequences that form pairs differ in length.
    #[error(
        "{left} {left_count} but {right} {right_count}, expected equal numbers, because they form pairs"
    )]
    LengthMismatch {
        /// Content of the first sequence.
        left: &'static str,
        /// Its length.
        left_count: usize,
        /// Content of the second sequence.
        right: &'static str,
        /// Its length.
        right_count: usize,
    },
    /// A pose has a component that is NaN, infinite, or beyond [`MAX_COORDINATE`].
    #[error(
        "{trajectory} pose {index} is {pose:?}, expected finite numbers of magnitude up to \
         {MAX_COORDINATE:e}"
    )]
    UnusablePose {
        /// `reference` or `estimate`.
        trajectory: &'static str,
        /// Index of the pose, from 0.
        index: usize,
        /// The pose.
        pose: Pose2,
    },
    /// No stamp of the estimate is near one of the reference.
    #[error(
        "no stamps match within {tolerance_s} s: the reference lasts from {} to {} s, the estimate \
         from {} to {} s, and the nearest two stamps are {nearest_s} s apart. Check that both are \
         of the same recording; if their rates or phases differ, interpolate between poses (`--match \
         interpolate`), and if their clocks differ, shift the estimate's stamps (`--offset`)", .reference[0], .reference[1], .estimate[0], .estimate[1]
    )]
    NothingMatches {
        /// Largest difference accepted, in seconds.
        tolerance_s: f64,
        /// Earliest and latest stamp of the reference.
        reference: [Stamp; 2],
        /// Earliest and latest stamp of the estimate.
        estimate: [Stamp; 2],
        /// Smallest difference between a stamp of the reference and one of the estimate, in seconds.
        nearest_s: f64,
    },
    /// No pose of the sparser trajectory lies between two poses of the other one.
    #[error(
        "no pose can be interpolated: the reference lasts from {} to {} s, the estimate from {} to {} s, \
         and nothing is extrapolated or interpolated over more than {longest_gap_s} s. Check that both \
         are of the same recording; if their clocks differ, shift the estimate's stamps (`--offset`)",
        .reference[0], .reference[1], .estimate[0], .estimate[1]
    )]
    NothingInterpolated {
        /// Longest gap over which poses are interpolated, in seconds.
        longest_gap_s: f64,
        /// Earliest and latest stamp of the reference.
        reference: [Stamp; 2],
        /// Earliest and latest stamp of the estimate.
        estimate: [Stamp; 2],
    },
    /// The positions do not determine the offset of two clocks.
    #[error(
        "cannot find the offset of the clocks: at all offsets the positions are equally far apart (the robot \
         stands still, or runs straight and is aligned), or there are too few poses; give the offset in \
         seconds instead"
    )]
    NoOffset,
    /// The positions do not determine a rotation.
    #[error(
        "cannot align {poses} poses: the positions of a trajectory are all the same, or the two \
         trajectories are uncorrelated, so no rotation is better than any other; compare them \
         without alignment"
    )]
    Alignment {
        /// Number of pairs of poses.
        poses: usize,
    },
    /// No two poses are the requested distance apart.
    #[error(
        "no two of {poses} poses are {delta} apart ({extent}): use a smaller \
         delta, or a larger relative tolerance with all pairs"
    )]
    NoPairs {
        /// Number of poses.
        poses: usize,
        /// The distance requested, with its unit.
        delta: String,
        /// Length of the path on which pairs are searched, in words.
        extent: String,
    },
    /// There are more pairs of poses than can be compared.
    #[error(
        "more than {} of poses differ by the angle: take consecutive pairs, a smaller relative \
         tolerance, or fewer poses", counted(*.limit, "pair")
    )]
    TooManyPairs {
        /// Largest number of pairs that can be compared.
        limit: usize,
    },
}

impl MetricsError {
    pub(crate) fn within(self, part: impl Into<String>) -> Self {
        MetricsError::Within { part: part.into(), source: Box::new(self) }
    }
}

/// Samples above this could overflow when squared and summed.
const SAMPLE_LIMIT: f64 = 1e140;

/// Whether a sample is usable; NaN is not.
pub(crate) fn is_usable(sample: f64) -> bool {
    sample.abs() < SAMPLE_LIMIT
}

/// Checks that there are `needed` samples and that all are usable.
pub(crate) fn check_samples(samples: &[f64], needed: usize) -> Result<(), MetricsError> {
    if samples.len() < needed {
        return Err(MetricsError::TooFew { what: "samples", found: samples.len(), needed });
    }
    match samples.iter().position(|&value| !is_usable(value)) {
        Some(index) => Err(MetricsError::Sample { index, value: samples[index] }),
        None => Ok(()),
    }
}

/// Checks the samples of several runs.
pub(crate) fn check_runs<R: AsRef<[f64]>>(runs: &[R], needed: usize) -> Result<(), MetricsError> {
    if runs.len() < needed {
        return Err(MetricsError::TooFew { what: "runs", found: runs.len(), needed });
    }
    for (run, samples) in runs.iter().enumerate() {
        check_samples(samples.as_ref(), 1).map_err(|error| error.within(format!("run {run}")))?;
    }
    Ok(())
}

/// Checks that both have equally many poses, at least one, and that no coordinate is so large that results overflow.
pub(crate) fn check_poses(reference: &[Pose2], estimate: &[Pose2]) -> Result<(), MetricsError> {
    if reference.len() != estimate.len() {
        return Err(MetricsError::LengthMismatch {
            left: "reference poses:",
            left_count: reference.len(),
            right: "estimated poses:",
            right_count: estimate.len(),
        });
    }
    if reference.is_empty() {
        return Err(MetricsError::TooFew { what: "pairs of poses", found: 0, needed: 1 });
    }
    for (trajectory, poses) in [("reference", reference), ("estimate", estimate)] {
        // Written so that NaN is an error too.
        let usable = |pose: &Pose2| {
            [pose.x, pose.y, pose.theta].iter().all(|value| value.abs() <= MAX_COORDINATE)
        };
        if let Some(index) = poses.iter().position(|pose| !usable(pose)) {
            return Err(MetricsError::UnusablePose { trajectory, index, pose: poses[index] });
        }
    }
    Ok(())
}
