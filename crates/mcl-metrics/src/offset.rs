use mcl_core::{Pose2, Stamp, Trajectory, math};

use crate::association::{Side, check_not_empty, interpolate, sparser};
use crate::ate::{Alignment, ate};
use crate::error::{MetricsError, check_poses};
use crate::timeline::{Timeline, gap};

/// Number of evenly spaced offsets in the first pass, and the number of poses compared at each.
const OFFSETS: usize = 20_000;
const COARSE_POSES: usize = 250;
/// Two minima are distinct if the error between them exceeds both by this factor; less is noise.
const RIDGE: f64 = 1.1;
/// Number of minima that are refined, and the number of poses compared then.
const MINIMA: usize = 24;
const FINE_POSES: usize = 4000;
/// Around a minimum, successively finer grids with this many offsets to either side are used until their step (in
/// seconds) is small compared with the interval of poses; then golden section search reaches the precision.
const FINER: i32 = 20;
const SMALL_STEP_S: f64 = 0.005;
const PRECISION_S: f64 = 2e-5;
/// Offsets whose errors differ by less than this fraction, or by less than this many metres, are equally good.
const EQUAL: f64 = 1e-6;

/// Clock offset of an estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetFound {
    /// Offset to add to the stamps of the estimate, in seconds.
    pub offset_s: f64,
    /// Root mean square of the distances between positions with that offset (and alignment), in metres.
    pub rmse_m: f64,
    /// Number of pairs of poses with that offset.
    pub pairs: usize,
    /// The best offset of another minimum (seconds), and its root mean square (metres). If it is about as
    /// good, the path repeats itself and the offset is ambiguous.
    pub runner_up: Option<(f64, f64)>,
}

/// Finds the clock offset of the estimate that fits its positions best to those of the reference: it minimizes the
/// root mean square of their distances, after the requested alignment, over all offsets at which at
/// least half of the shorter trajectory overlaps with the other. The sparser trajectory (by its usual interval) is
/// compared with the other one, interpolated.
///
/// A grid of offsets with a few hundred poses each is evaluated first, then finer grids and golden section search
/// around the best minima, to less than 0.1 ms. The run time therefore hardly depends on the number of poses. Clocks
/// may differ by years. Interpolation averages the noise between poses, which biases the offset
/// towards the middle between them: by less than half an interval, and not at all if only the sparser one is noisy.
/// With [`Alignment::Origin`] the offset is that of the rigid alignment, because the first pair changes
/// with the offset; the error is that of the origin alignment.
///
/// # Errors
/// If a trajectory is empty or has poses that are not finite, no offset gives enough pairs, or the positions do
/// not determine an offset (a robot that stands still) or the alignment.
pub fn find_offset(
    reference: &Trajectory,
    estimate: &Trajectory,
    alignment: Alignment,
) -> Result<OffsetFound, MetricsError> {
    check_not_empty(reference, estimate)?;
    check_poses(reference.poses(), reference.poses())?;
    check_poses(estimate.poses(), estimate.poses())?;
    let search = OffsetSearch::new(reference, estimate, alignment);
    let (minima, worst) = search.coarse_minima();
    let mut found: Vec<(f64, f64)> =
        minima.into_iter().filter_map(|offset| search.narrow_down(offset)).collect();
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    let best = found.first().filter(|best| worst - best.1 > EQUAL * worst.max(1.0));
    let offset_s = search.offset(best.ok_or(MetricsError::NoOffset)?.0);
    let runner_up = found.get(1).map(|&(offset, rmse)| (search.offset(offset), rmse));
    let matched = interpolate(reference, &shifted(estimate, offset_s)?, None)?;
    let errors = ate(matched.reference.poses(), matched.estimate.poses(), alignment)?;
    let squares: f64 = errors.translation.iter().map(|error| error * error).sum();
    let pairs = errors.translation.len();
    Ok(OffsetFound { offset_s, rmse_m: (squares / pairs as f64).sqrt(), pairs, runner_up })
}

/// Adds seconds to the stamps of a trajectory.
///
/// # Errors
/// If the seconds are not finite, or a resulting stamp exceeds the range of 64-bit nanoseconds.
pub fn shifted(trajectory: &Trajectory, offset_s: f64) -> Result<Trajectory, MetricsError> {
    let error = || {
        let expected = "seconds after which stamps lie in the years 1677 to 2262";
        MetricsError::Setting { name: "offset", found: offset_s, expected }
    };
    if !offset_s.is_finite() || offset_s.abs() >= i64::MAX as f64 / 1e9 {
        return Err(error());
    }
    // Whole seconds are added separately, because nanoseconds as a float would be rounded.
    let nanoseconds =
        offset_s.trunc() as i64 * 1_000_000_000 + (offset_s.fract() * 1e9).round() as i64;
    let shift = |(stamp, pose): (Stamp, Pose2)| {
        let stamp = stamp.nanoseconds().checked_add(nanoseconds).ok_or_else(error)?;
        Ok((Stamp::from_nanoseconds(stamp), pose))
    };
    trajectory.iter().map(shift).collect()
}

/// A position and its time, in seconds since the first one of its trajectory.
#[derive(Clone, Copy)]
struct Sample {
    at: f64,
    position: [f64; 2],
}

/// Two trajectories, each with its own clock that starts at 0. Offsets are added to the times of the samples to
/// get times of the other trajectory.
struct OffsetSearch {
    /// The sparser trajectory.
    samples: Vec<Sample>,
    /// The other one, which is interpolated.
    other: Vec<Sample>,
    /// Longest gap for interpolation, in seconds.
    longest_gap: f64,
    sampled: Side,
    /// The first stamp of the reference minus that of the estimate, in seconds.
    clocks_apart: f64,
    alignment: Alignment,
    /// Smallest and largest offset.
    range: [f64; 2],
    /// Step between the offsets of the grid.
    step: f64,
    /// Fraction of the duration of the shorter trajectory that must overlap.
    least_overlap: f64,
}

impl OffsetSearch {
    fn new(reference: &Trajectory, estimate: &Trajectory, alignment: Alignment) -> Self {
        let (reference, estimate) = (Timeline::new(reference), Timeline::new(estimate));
        let sampled = sparser(&reference, &estimate);
        let apart = i128::from(reference.stamp(0).nanoseconds())
            - i128::from(estimate.stamp(0).nanoseconds());
        let (samples, other) = match sampled {
            Side::Reference => (&reference, &estimate),
            Side::Estimate => (&estimate, &reference),
        };
        let longest_gap = other.longest_gap(None).map_or(f64::INFINITY, |gap| gap as f64 / 1e9);
        let (samples, other) = (positions(samples), positions(other));
        let duration = |samples: &[Sample]| samples.last().map_or(0.0, |last| last.at);
        let (of_samples, of_other) = (duration(&samples), duration(&other));
        let least_overlap = 0.5 * of_samples.min(of_other);
        let range = [least_overlap - of_samples, of_other - least_overlap];
        let step = (range[1] - range[0]) / OFFSETS as f64;
        let clocks_apart = apart as f64 / 1e9;
        OffsetSearch {
            samples,
            other,
            longest_gap,
            sampled,
            clocks_apart,
            alignment,
            range,
            step,
            least_overlap,
        }
    }

    /// The offset to add to the stamps of the estimate.
    fn offset(&self, of_samples: f64) -> f64 {
        match self.sampled {
            Side::Estimate => self.clocks_apart + of_samples,
            Side::Reference => self.clocks_apart - of_samples,
        }
    }

    /// The best minima of a grid of offsets, and the largest root mean square on it.
    fn coarse_minima(&self) -> (Vec<f64>, f64) {
        let offsets: Vec<f64> =
            (0..=OFFSETS).map(|k| self.range[0] + k as f64 * self.step).collect();
        let errors: Vec<f64> = offsets
            .iter()
            .map(|&offset| self.rmse(offset, COARSE_POSES).unwrap_or(f64::INFINITY))
            .collect();
        let mut minima = Vec::new();
        // The lowest offset since the last ridge (none while rising), and the height of the ridge so far.
        let (mut lowest, mut highest): (Option<usize>, f64) = (None, f64::INFINITY);
        for (k, &error) in errors.iter().enumerate() {
            match lowest {
                Some(low) if error < errors[low] => lowest = Some(k),
                Some(low) if error > RIDGE * errors[low] => {
                    minima.push(low);
                    (lowest, highest) = (None, error);
                }
                Some(_) => {}
                None if error * RIDGE < highest => lowest = Some(k),
                None => highest = highest.max(error),
            }
        }
        minima.extend(lowest);
        minima.sort_by(|&a, &b| errors[a].total_cmp(&errors[b]));
        let worst = errors.iter().copied().filter(|error| error.is_finite()).fold(0.0, f64::max);
        (minima.into_iter().take(MINIMA).map(|k| offsets[k]).collect(), worst)
    }

    /// The minimum near an offset of the grid, and the root mean square there; `None` without pairs.
    fn narrow_down(&self, offset: f64) -> Option<(f64, f64)> {
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        let within = |offset: f64| offset.clamp(self.range[0], self.range[1]);
        let error = |offset: f64| self.rmse(offset, FINE_POSES).unwrap_or(f64::INFINITY);
        let (mut offset, mut step) = (offset, self.step);
        while step > SMALL_STEP_S {
            step /= f64::from(FINER);
            let around = (-FINER..=FINER).map(|k| within(offset + f64::from(k) * step));
            let errors = around.map(|offset| (offset, error(offset)));
            offset = errors.min_by(|a, b| a.1.total_cmp(&b.1))?.0;
        }
        let [mut low, mut high] = [within(offset - step), within(offset + step)];
        let (mut a, mut b) = (high - golden * (high - low), low + golden * (high - low));
        let (mut at_a, mut at_b) = (error(a), error(b));
        while high - low > PRECISION_S {
            if at_a <= at_b {
                (high, b, at_b) = (b, a, at_a);
                a = high - golden * (high - low);
                at_a = error(a);
            } else {
                (low, a, at_a) = (a, b, at_b);
                b = low + golden * (high - low);
                at_b = error(b);
            }
        }
        let middle = 0.5 * (low + high);
        // Keeps the offset of the grid if it is better; for a single pose it is the only one.
        let candidates = [(middle, error(middle)), (offset, error(offset))];
        let best = candidates.into_iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
        best.1.is_finite().then_some(best)
    }

    /// Root mean square of the distances with an offset, for at most this many poses; `None` if the overlap is too
    /// small, or nothing can be interpolated or aligned.
    fn rmse(&self, offset: f64, poses: usize) -> Option<f64> {
        let last = self.other.last()?.at;
        let from = self.samples.partition_point(|sample| sample.at + offset < 0.0);
        let to = self.samples.partition_point(|sample| sample.at + offset <= last);
        let overlap = last.min(self.samples.last()?.at + offset) - offset.max(0.0);
        if overlap < self.least_overlap * (1.0 - 1e-9) {
            return None;
        }
        // Uses the same poses at every offset, because the errors of different poses would differ by noise.
        let every = self.samples.len().div_ceil(poses);
        let chosen = (from.next_multiple_of(every)..to).step_by(every);
        let count = chosen.len();
        let mut pairs = Vec::with_capacity(count);
        for sample in chosen.map(|index| self.samples[index]) {
            if let Some(position) = self.at(sample.at + offset) {
                pairs.push(match self.sampled {
                    Side::Estimate => (position, sample.position),
                    Side::Reference => (sample.position, position),
                });
            }
        }
        // Most of the overlap must have poses, not only a few beside a gap.
        if pairs.is_empty() || 2 * pairs.len() < count {
            return None;
        }
        let squares = match self.alignment {
            Alignment::None => {
                let squared = |&([rx, ry], [ex, ey]): &([f64; 2], [f64; 2])| {
                    math::square(rx - ex) + math::square(ry - ey)
                };
                pairs.iter().map(squared).sum()
            }
            Alignment::Origin | Alignment::Rigid => aligned_squares(&pairs),
        };
        Some((squares / pairs.len() as f64).sqrt())
    }

    /// Position of the interpolated trajectory.
    fn at(&self, time: f64) -> Option<[f64; 2]> {
        let after = self.other.partition_point(|sample| sample.at < time);
        let next = self.other.get(after)?;
        if next.at == time {
            return Some(next.position);
        }
        let before = &self.other[after.checked_sub(1)?];
        let whole = next.at - before.at;
        let part = (time - before.at) / whole;
        let [[x0, y0], [x1, y1]] = [before.position, next.position];
        (whole <= self.longest_gap).then_some([x0 + part * (x1 - x0), y0 + part * (y1 - y0)])
    }
}

/// Sum of squared distances (reference, estimate) after the rigid motion that minimizes it:
/// Σ(|r̄|² + |ē|²) of positions relative to their means, to which the best rotation adds −2·‖(Σ ē·r̄, Σ ē×r̄)‖.
fn aligned_squares(pairs: &[([f64; 2], [f64; 2])]) -> f64 {
    let count = pairs.len() as f64;
    let mut mean = [0.0; 4];
    for &([rx, ry], [ex, ey]) in pairs {
        for (mean, value) in mean.iter_mut().zip([rx, ry, ex, ey]) {
            *mean += value / count;
        }
    }
    let (mut spread, mut dot, mut cross) = (0.0, 0.0, 0.0);
    for &([rx, ry], [ex, ey]) in pairs {
        let [rx, ry, ex, ey] = [rx - mean[0], ry - mean[1], ex - mean[2], ey - mean[3]];
        spread += rx * rx + ry * ry + ex * ex + ey * ey;
        dot += ex * rx + ey * ry;
        cross += ex * ry - ey * rx;
    }
    (spread - 2.0 * math::hypot(dot, cross)).max(0.0)
}

fn positions(timeline: &Timeline<'_>) -> Vec<Sample> {
    let sample = |position| {
        let pose = timeline.pose(position);
        let at = gap(timeline.stamp(0), timeline.stamp(position)) as f64 / 1e9;
        Sample { at, position: [pose.x, pose.y] }
    };
    (0..timeline.len()).map(sample).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    /// Rooms visited one after the other at about 0.5 m/s, never twice in the same order.
    fn path(t: f64) -> Pose2 {
        let (slow, fast) = (0.031 * t + 0.6 * (0.0137 * t).sin(), 0.11 * t);
        Pose2::new(
            9.0 * slow.sin() + 1.5 * fast.sin(),
            7.0 * (1.3 * slow).cos() + 1.5 * fast.cos(),
            fast,
        )
    }

    /// A pose every `step` seconds of true time from `from` to `to`, on a clock that is `late` by this many seconds.
    fn track(from: f64, to: f64, step: f64, late: f64, noise: f64) -> Trajectory {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
        let count = ((to - from) / step).round() as usize;
        (0..count)
            .map(|k| {
                let t = from + k as f64 * step;
                let mut moved = || noise * 12.0_f64.sqrt() * (random.random::<f64>() - 0.5);
                let pose = path(t);
                let stamp = Stamp::from_nanoseconds(((t - late) * 1e9).round() as i64);
                (stamp, Pose2::new(pose.x + moved(), pose.y + moved(), pose.theta))
            })
            .collect()
    }

    #[test]
    fn an_estimate_on_another_clock() {
        let reference = track(0.0, 60.0, 0.1, 0.0, 0.0);
        let estimate = track(0.03, 60.0, 0.1, -0.35, 0.01);
        for alignment in [Alignment::None, Alignment::Rigid, Alignment::Origin] {
            let found = find_offset(&reference, &estimate, alignment).unwrap();
            // Noise of 0.01 m at 0.35 m/s gives an uncertainty of 0.01/(0.35·√600) s, 1.2 ms; an alignment absorbs
            // part of the motion and about doubles it. Three times as much is allowed.
            let doubt = if alignment == Alignment::None { 1.2e-3 } else { 2.4e-3 };
            assert!((found.offset_s + 0.35).abs() < 3.0 * doubt, "{alignment:?} {found:?}");
            let moved = shifted(&estimate, found.offset_s).unwrap();
            assert!(found.pairs >= 598 && found.pairs <= moved.len(), "{found:?}");
            if alignment != Alignment::Origin {
                assert!((found.rmse_m - 0.01 * 2.0_f64.sqrt()).abs() < 7e-4, "{found:?}");
            }
        }
        // Without noise, to less than 0.1 ms, whichever side is sparser.
        for step in [0.02, 0.1, 0.2] {
            let exact = track(0.03, 60.0, step, -0.35, 0.0);
            let found = find_offset(&reference, &exact, Alignment::None).unwrap();
            assert!((found.offset_s + 0.35).abs() < 1e-4, "{step} {found:?}");
        }
    }

    #[test]
    fn clocks_may_be_years_apart_and_half_of_the_time_must_overlap() {
        let reference = track(0.0, 300.0, 0.1, -1.7e9, 0.0);
        let estimate = track(140.0, 420.0, 0.25, 1234.5, 0.02);
        let found = find_offset(&reference, &estimate, Alignment::None).unwrap();
        assert!((found.offset_s - 1.7e9 - 1234.5).abs() < 4e-3, "{found:?}");
        assert!(found.rmse_m < 0.03 && found.pairs > 600, "{found:?}");
        assert!(found.runner_up.is_some_and(|(_, rmse)| rmse > 1.0), "{found:?}");
        // 60 s of 280 s in common are too few.
        let estimate = track(240.0, 520.0, 0.25, 1234.5, 0.02);
        let found = find_offset(&reference, &estimate, Alignment::None).unwrap();
        assert!((found.offset_s - 1.7e9 - 1234.5).abs() > 50.0, "{found:?}");
    }

    #[test]
    fn a_path_that_repeats_itself_has_a_runner_up_as_good() {
        let lap = |t: f64| {
            let angle = std::f64::consts::TAU * t / 20.0;
            Pose2::new(3.0 * angle.cos(), 3.0 * angle.sin(), angle)
        };
        let stamp = |seconds: f64| Stamp::from_nanoseconds((seconds * 1e9).round() as i64);
        let laps = |to: i32, late: f64| -> Trajectory {
            (0..to).map(|k| 0.1 * f64::from(k)).map(|t| (stamp(t + late), lap(t))).collect()
        };
        let found = find_offset(&laps(1000, 0.0), &laps(600, 5.0), Alignment::None).unwrap();
        let (other, rmse) = found.runner_up.unwrap();
        assert!(found.rmse_m < 1e-3 && rmse < 1e-3, "{found:?}");
        let laps_apart = (other - found.offset_s) / 20.0;
        assert!(
            (laps_apart - laps_apart.round()).abs() < 1e-4 && laps_apart.abs() > 0.5,
            "{found:?}"
        );
    }

    #[test]
    fn hours_of_poses_take_no_longer_than_minutes() {
        let reference = track(0.0, 20_000.0, 0.05, 0.0, 0.0);
        let estimate = track(100.0, 19_000.0, 0.05, 77.7, 0.05);
        assert!(reference.len() == 400_000 && estimate.len() > 370_000);
        let found = find_offset(&reference, &estimate, Alignment::None).unwrap();
        assert!((found.offset_s - 77.7).abs() < 3e-3, "{found:?}");
    }

    #[test]
    fn what_determines_no_offset_is_refused() {
        let still: Trajectory = (0..100)
            .map(|k| (Stamp::from_nanoseconds(k * 100_000_000), Pose2::new(1.0, 2.0, 0.0)))
            .collect();
        let one: Trajectory = still.iter().take(1).collect();
        for (a, b) in [(&still, &still), (&one, &one), (&still, &one)] {
            for alignment in [Alignment::None, Alignment::Rigid] {
                let error = find_offset(a, b, alignment).unwrap_err();
                assert_eq!(error, MetricsError::NoOffset);
            }
        }
        assert!(find_offset(&still, &Trajectory::default(), Alignment::None).is_err());
        let broken = [(Stamp::from_nanoseconds(0), Pose2::new(f64::NAN, 0.0, 0.0))];
        assert!(find_offset(&still, &broken.into_iter().collect(), Alignment::None).is_err());
    }

    #[test]
    fn stamps_are_shifted_to_the_nanosecond() {
        let of = |nanoseconds| -> Trajectory {
            [(Stamp::from_nanoseconds(nanoseconds), Pose2::IDENTITY)].into_iter().collect()
        };
        let shift = |from, by| shifted(&of(from), by).map(|t| t.stamps()[0].nanoseconds());
        assert_eq!(shift(1_700_000_000_000_000_001, -0.35), Ok(1_699_999_999_650_000_001));
        assert_eq!(shift(5, -1_700_000_000.25), Ok(-1_700_000_000_249_999_995));
        for (from, by) in [(i64::MAX, 1.0), (0, f64::NAN), (0, 1e10), (0, f64::INFINITY)] {
            assert!(matches!(shift(from, by), Err(MetricsError::Setting { name: "offset", .. })));
        }
    }
}
