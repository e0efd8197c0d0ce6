//! Runs of the filter over a log, and their report: the figures of `localize`.

use std::time::Duration;

use anyhow::Result;
use mcl_core::text::counted;
use mcl_core::{Point, Pose2, Seed, math};
use mcl_filter::Run;
use mcl_metrics::{
    DivergenceSettings, Interval, LossSettings, LostEpisode, WeightedPoseError, bootstrap_mean,
    diverged, found_for_good, lost_episodes,
};
use serde::Serialize;

use crate::pose_errors::{ErrorFigures, ErrorSamples, Figures};
use mcl_study::data::source::LogSource;
use mcl_study::measure::consistency::{Consistency, Tally, scan_nees};

/// Resamples of the bootstrap over runs.
const RESAMPLES: usize = 10_000;

/// The seed of a run: the same for every map, so that maps are compared with the same random draws. `name` is
/// that of the log.
pub fn run_seed(seed: u64, name: &str, number: u32) -> Seed {
    Seed::new(seed).derive("localization").derive(name).derive_index(u64::from(number))
}

/// The part of a run that the figures need.
pub struct FinishedRun {
    /// Against the reference, one entry per scan that has one; `None` where none has.
    pub errors: Option<ErrorSamples>,
    /// Estimated positions of the laser (m), one per scan; empty where there are errors instead.
    positions: Vec<Point<2>>,
    /// Normalized estimation error squared per scan; `None` without a reference, or with a singular covariance.
    pub nees: Vec<Option<f64>>,
    /// Sum over the scans.
    used_beams: usize,
    /// Sum over the scans of particles times used beams.
    weighed: f64,
    /// Mean over the scans.
    particles: f64,
    /// The filter's consistency.
    tally: Tally,
    /// Time of its thread inside the filter: drawing the initial particles, and all steps.
    elapsed: Duration,
}

impl FinishedRun {
    /// From a run over all scans of a log, with the time of its thread.
    ///
    /// # Errors
    /// When the run has no estimate for a scan of the log, or one that is not finite.
    pub fn of(run: &Run, source: &LogSource, elapsed: Duration) -> Result<Self> {
        let scans = &source.recording.scans;
        let pairs = scans.iter().zip(&run.map_from_laser);
        let (there, estimates): (Vec<Pose2>, Vec<Pose2>) =
            pairs.filter_map(|(scan, estimate)| Some((scan.map_from_laser?, *estimate))).unzip();
        let errors = match there.is_empty() {
            true => None,
            false => Some(ErrorSamples::of(&there, &estimates, &WeightedPoseError::default())?),
        };
        let positions = match &errors {
            Some(_) => Vec::new(),
            None => run.map_from_laser.iter().map(|pose| [pose.x, pose.y]).collect(),
        };
        let laser_from_robot = source.recording.robot_from_laser.inverse();
        let nees = scans.iter().zip(&run.reports).map(|(scan, report)| {
            scan_nees(scan.map_from_laser.as_ref()?, report, &laser_from_robot)
        });
        let nees: Vec<Option<f64>> = nees.collect();
        let mut tally = Tally::default();
        run.reports.iter().zip(&nees).for_each(|(report, &nees)| tally.add(report, nees));
        let weighed = run.reports.iter().map(|report| report.particles * report.used_beams);
        Ok(FinishedRun {
            errors,
            positions,
            nees,
            used_beams: run.reports.iter().map(|report| report.used_beams).sum(),
            weighed: weighed.sum::<usize>() as f64,
            particles: run.reports.iter().map(|report| report.particles).sum::<usize>() as f64
                / run.reports.len() as f64,
            tally,
            elapsed,
        })
    }
}

/// How many runs diverged, and how often robots were lost and found again, in words.
pub fn outcome(runs: usize, diverged: usize, lost: usize, recovered: usize) -> String {
    format!(
        "{diverged} of {} diverged; lost {}, found again {}",
        counted(runs, "run"),
        counted(lost, "time"),
        counted(recovered, "time")
    )
}

/// The results of all runs. Errors are pooled over runs and scans, and null without a reference.
#[derive(Debug, Serialize)]
pub struct Localization {
    pub(crate) runs: usize,
    /// The reference of the errors, and whose poses it has.
    pub(crate) reference: Option<String>,
    /// Number of scans with a reference pose, which are those with errors.
    pub(crate) reference_scans: usize,
    /// Steps with unknown odometry, on which the filter spreads the particles.
    pub(crate) bridged_steps: usize,
    /// Number of runs that ended lost; null without a reference.
    pub(crate) diverged: Option<usize>,
    /// Times that a robot was lost within a run, and times that it was found again.
    pub(crate) lost: Option<usize>,
    pub(crate) recovered: Option<usize>,
    pub(crate) weighted: Option<Figures>,
    pub(crate) translation: Option<Figures>,
    pub(crate) heading: Option<Figures>,
    /// Pooled over the runs that did not diverge; null when all did.
    pub(crate) without_diverged: Option<ErrorFigures>,
    /// How far the runs are apart where no reference tells how wrong they are; null with a reference, and for a single
    /// run.
    pub(crate) spread: Option<Spread>,
    /// 95 % intervals of the pooled means, by a bootstrap over runs; null for a single run.
    pub(crate) mean_ci95: Option<MeanIntervals>,
    /// Mean number of beams used of a scan.
    pub(crate) used_beams_per_scan: f64,
    /// Mean number of particles at a scan.
    pub(crate) particles_per_scan: f64,
    /// The filter's consistency, pooled over runs and scans.
    #[serde(flatten)]
    pub(crate) consistency: Consistency,
    /// Nanoseconds of a thread's work per particle and used beam; null when no beam was used.
    pub(crate) ns_per_beam: Option<f64>,
    pub(crate) each: Vec<RunFigures>,
}

/// One run.
#[derive(Debug, Serialize)]
pub(crate) struct RunFigures {
    run: usize,
    diverged: Option<bool>,
    lost_episodes: Option<Vec<LostEpisode>>,
    /// Number of scans before the error is below 0.5 m and stays below 1 m; null where it never does, and without a
    /// reference.
    pub(crate) scans_until_found: Option<usize>,
    weighted: Option<Figures>,
    translation: Option<Figures>,
    heading: Option<Figures>,
    seconds: f64,
}

/// Distances between the runs' estimated positions of a scan and their mean (m).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Spread {
    /// Mean over the scans and runs.
    pub(crate) mean: f64,
    /// The largest at the last scan.
    pub(crate) largest_at_end: f64,
}

impl Spread {
    /// Of runs with a position per scan; `None` for fewer than two runs, and without positions.
    fn of(runs: &[&[Point<2>]]) -> Option<Self> {
        let scans = runs.first().filter(|_| runs.len() > 1)?.len();
        let number = runs.len() as f64;
        let (mut sum, mut largest_at_end) = (0.0, 0.0);
        for scan in 0..scans {
            let positions = || runs.iter().map(|run| run[scan]);
            let mean: Point<2> =
                std::array::from_fn(|axis| positions().map(|at| at[axis]).sum::<f64>() / number);
            let distances = || positions().map(|[x, y]| math::hypot(x - mean[0], y - mean[1]));
            sum += distances().sum::<f64>();
            largest_at_end = distances().fold(0.0, f64::max);
        }
        (scans > 0).then(|| Spread { mean: sum / (number * scans as f64), largest_at_end })
    }
}

#[derive(Debug, Clone, Copy, Serialize)]
pub(crate) struct MeanIntervals {
    pub(crate) weighted: Interval,
    pub(crate) translation: Interval,
    pub(crate) heading: Interval,
}

impl Localization {
    /// Figures of at least one run over the scans of a log; `seed` is that of all runs.
    ///
    /// # Errors
    /// When there is no run, or an error is not finite.
    pub fn of(
        runs: &[FinishedRun],
        source: &LogSource,
        bridged_steps: usize,
        seed: u64,
    ) -> Result<Self> {
        let seed = Seed::new(seed).derive("bootstrap").derive(&source.name);
        let scans = source.recording.scans.len();
        let has_reference = |scan: &usize| source.recording.scans[*scan].map_from_laser.is_some();
        let placed: Vec<usize> = (0..scans).filter(has_reference).collect();
        let each = runs
            .iter()
            .enumerate()
            .map(|(number, run)| RunFigures::of(number, run, &placed))
            .collect::<Result<Vec<_>>>()?;
        let errors: Option<Vec<&ErrorSamples>> =
            runs.iter().map(|run| run.errors.as_ref()).collect();
        let pooled = errors.as_ref().map(|errors| ErrorFigures::pooled(errors)).transpose()?;
        let on_track: Vec<&ErrorSamples> = runs
            .iter()
            .zip(&each)
            .filter(|(_, figures)| figures.diverged == Some(false))
            .filter_map(|(run, _)| run.errors.as_ref())
            .collect();
        let without_diverged = match on_track.is_empty() {
            true => None,
            false => Some(ErrorFigures::pooled(&on_track)?),
        };
        let mean_ci95 = match &errors {
            Some(errors) if errors.len() > 1 => Some(MeanIntervals::of(errors, seed)?),
            _ => None,
        };
        let mut tally = Tally::default();
        runs.iter().for_each(|run| tally.merge(&run.tally));
        let used_beams: usize = runs.iter().map(|run| run.used_beams).sum();
        let weighed: f64 = runs.iter().map(|run| run.weighed).sum();
        let nanoseconds: f64 = runs.iter().map(|run| run.elapsed.as_secs_f64() * 1e9).sum();
        let count = |of: &dyn Fn(&RunFigures) -> Option<usize>| -> Option<usize> {
            each.iter().map(of).sum()
        };
        let episodes = |run: &RunFigures, wanted: fn(&LostEpisode) -> bool| {
            let episodes = run.lost_episodes.as_ref()?;
            Some(episodes.iter().filter(|episode| wanted(episode)).count())
        };
        Ok(Localization {
            runs: runs.len(),
            reference: source.reference.clone(),
            reference_scans: placed.len(),
            bridged_steps,
            diverged: count(&|run| run.diverged.map(usize::from)),
            lost: count(&|run| episodes(run, |_| true)),
            recovered: count(&|run| episodes(run, |episode| episode.recovered.is_some())),
            weighted: pooled.map(|pooled| pooled.weighted),
            translation: pooled.map(|pooled| pooled.translation),
            heading: pooled.map(|pooled| pooled.heading),
            without_diverged,
            spread: Spread::of(
                &runs.iter().map(|run| run.positions.as_slice()).collect::<Vec<_>>(),
            ),
            mean_ci95,
            used_beams_per_scan: used_beams as f64 / (runs.len() * scans) as f64,
            ns_per_beam: (used_beams > 0).then(|| nanoseconds / weighed),
            particles_per_scan: runs.iter().map(|run| run.particles).sum::<f64>()
                / runs.len() as f64,
            consistency: tally.summary(),
            each,
        })
    }
}

impl RunFigures {
    /// `placed` are the scans that have a reference pose.
    fn of(number: usize, run: &FinishedRun, placed: &[usize]) -> Result<Self> {
        let mut figures = RunFigures {
            run: number,
            diverged: None,
            lost_episodes: None,
            scans_until_found: None,
            weighted: None,
            translation: None,
            heading: None,
            seconds: run.elapsed.as_secs_f64(),
        };
        if let Some(errors) = &run.errors {
            let translation = &errors.translation;
            figures.diverged = Some(diverged(translation, &DivergenceSettings::default())?);
            let mut lost = lost_episodes(translation, &LossSettings::default())?;
            for episode in &mut lost {
                episode.start = placed[episode.start];
                episode.recovered = episode.recovered.map(|sample| placed[sample]);
            }
            figures.lost_episodes = Some(lost);
            let found = found_for_good(translation, &LossSettings::default());
            figures.scans_until_found = found.map(|sample| placed[sample]);
            figures.weighted = Some(Figures::of(&errors.weighted)?);
            figures.translation = Some(Figures::of(translation)?);
            figures.heading = Some(Figures::of(&errors.heading)?);
        }
        Ok(figures)
    }
}

impl MeanIntervals {
    fn of(runs: &[&ErrorSamples], seed: Seed) -> Result<Self> {
        // The same resampled runs for all three.
        let interval = |samples: fn(&ErrorSamples) -> &[f64]| {
            let runs: Vec<&[f64]> = runs.iter().map(|run| samples(run)).collect();
            bootstrap_mean(&runs, RESAMPLES, seed).map(|found| found.interval)
        };
        Ok(MeanIntervals {
            weighted: interval(|run| &run.weighted)?,
            translation: interval(|run| &run.translation)?,
            heading: interval(|run| &run.heading)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_that_end_in_two_places_are_apart() {
        let there: &[Point<2>] = &[[0.0, 0.0], [0.0, 0.0]];
        let away: &[Point<2>] = &[[0.0, 0.0], [3.0, 4.0]];
        let found = Spread::of(&[there, away]).unwrap();
        assert_eq!(found, Spread { mean: 1.25, largest_at_end: 2.5 });
        assert_eq!(Spread::of(&[there]), None);
        assert_eq!(Spread::of(&[&[], &[]]), None);
    }
}
