use anyhow::Result;
use mcl_core::Seed;
use mcl_filter::FilterSettings;
use mcl_metrics::{
    DivergenceSettings, Interval, LossSettings, LostEpisode, bootstrap_mean, diverged,
    lost_episodes,
};
use serde::Serialize;

use super::FinishedRun;
use crate::cli::args::LocalizeArgs;
use crate::cli::errors::{ErrorFigures, ErrorSamples, Figures};
use crate::cli::output::reference_of;
use mcl_core::text::{counted, thousands};
use mcl_study::data::source::LogSource;
use mcl_study::measure::consistency::{Consistency, Tally};

/// Resamples of the bootstrap over runs.
const RESAMPLES: usize = 10_000;

/// What all runs together found. Errors are pooled over runs and scans, and null without a reference.
#[derive(Debug, Serialize)]
pub struct Localization {
    runs: usize,
    /// The reference that errors are taken against, and whose poses it has.
    reference: Option<String>,
    /// Scans that have a reference pose; errors are those of these.
    reference_scans: usize,
    /// Steps that the odometry says nothing of, on which the filter spreads the particles.
    bridged_steps: usize,
    /// Runs that ended lost; null without a reference.
    diverged: Option<usize>,
    /// Times that a robot was lost within a run, and times that it was found again.
    lost: Option<usize>,
    recovered: Option<usize>,
    weighted: Option<Figures>,
    translation: Option<Figures>,
    heading: Option<Figures>,
    /// Pooled over the runs that did not diverge; null when all did.
    without_diverged: Option<ErrorFigures>,
    /// 95 % intervals of the pooled means, by a bootstrap over runs; null for a single run.
    mean_ci95: Option<MeanIntervals>,
    /// Beams used of a scan, on average.
    used_beams_per_scan: f64,
    /// Particles at a scan, on average.
    particles_per_scan: f64,
    /// What the filter said of itself, pooled over runs and scans.
    #[serde(flatten)]
    consistency: Consistency,
    /// Nanoseconds of a thread's work per particle and used beam; null when no beam was used.
    ns_per_beam: Option<f64>,
    each: Vec<RunFigures>,
}

/// One run.
#[derive(Debug, Serialize)]
struct RunFigures {
    run: usize,
    diverged: Option<bool>,
    lost_episodes: Option<Vec<LostEpisode>>,
    weighted: Option<Figures>,
    translation: Option<Figures>,
    heading: Option<Figures>,
    seconds: f64,
}

#[derive(Debug, Clone, Copy, Serialize)]
struct MeanIntervals {
    weighted: Interval,
    translation: Interval,
    heading: Interval,
}

impl Localization {
    /// Figures of at least one run over the scans of a log; `seed` is that of the bootstrap.
    pub fn of(
        runs: &[FinishedRun],
        source: &LogSource,
        bridged_steps: usize,
        seed: Seed,
    ) -> Result<Self> {
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
            mean_ci95,
            used_beams_per_scan: used_beams as f64 / (runs.len() * scans) as f64,
            ns_per_beam: (used_beams > 0).then(|| nanoseconds / weighed),
            particles_per_scan: runs.iter().map(|run| run.particles).sum::<f64>()
                / runs.len() as f64,
            consistency: tally.summary(),
            each,
        })
    }

    /// What a user wants to read of it.
    pub fn text(
        &self,
        args: &LocalizeArgs,
        (filter, sigma_hit): (&FilterSettings, f64),
        source: &LogSource,
        map_points: usize,
    ) -> String {
        let mut text = format!(
            "{} on {} ({} points)\n{} of {} scans, preset {}, {} particles, σ_hit {sigma_hit:.2} m, {:.1} beams used per scan, \
             each at least {:.2} of the largest likelihood\n",
            source.title,
            args.map.display(),
            thousands(map_points),
            counted(self.runs, "run"),
            thousands(source.recording.scans.len()),
            args.preset,
            match filter.particles.is_fixed() {
                true => thousands(filter.particles.most),
                false =>
                    format!("{} ({:.0} on average)", filter.particles, self.particles_per_scan),
            },
            self.used_beams_per_scan,
            filter.relative_floor(sigma_hit)
        );
        text += &format!("reference: {}\n", reference_of(source));
        match (self.weighted, self.translation, self.heading) {
            (Some(weighted), Some(translation), Some(heading)) => {
                let scans = source.recording.scans.len();
                if self.reference_scans < scans {
                    text += &format!(
                        "errors over the {} of {} scans that have a reference pose\n",
                        thousands(self.reference_scans),
                        thousands(scans)
                    );
                }
                text += &ErrorFigures { weighted, translation, heading }.table();
            }
            _ => text += "no errors: the log has no reference poses\n",
        }
        if let Some(MeanIntervals { weighted: Interval { low, high }, .. }) = self.mean_ci95 {
            text += &format!(
                "mean weighted error: 95 % interval {low:.4} … {high:.4} (bootstrap over runs)\n"
            );
        }
        if let (Some(diverged), Some(lost), Some(recovered)) =
            (self.diverged, self.lost, self.recovered)
        {
            text += &format!(
                "{diverged} of {} diverged; lost {}, found again {}\n",
                counted(self.runs, "run"),
                counted(lost, "time"),
                counted(recovered, "time")
            );
            if let Some(rest) = self.without_diverged.filter(|_| diverged > 0) {
                text += &format!("without diverged runs:\n{}", rest.table());
            }
        }
        let Consistency { median_nees, inside_95, log_evidence, explained_beams, .. } =
            self.consistency;
        if let (Some(nees), Some(inside)) = (median_nees, inside_95) {
            text += &format!(
                "the reference lies within the 95 % ellipsoid on {:.0} % of the scans (median NEES {nees:.1}; \
                 2.4 expected)\n",
                100.0 * inside
            );
        }
        if let (Some(evidence), Some(explained)) = (log_evidence, explained_beams) {
            text += &format!(
                "{:.0} % of the beams are explained by the map; log-evidence {evidence:.1} per scan\n",
                100.0 * explained
            );
        }
        if let Some(nanoseconds) = self.ns_per_beam {
            text += &format!("{nanoseconds:.2} ns per particle and beam on one thread\n");
        }
        if let Some(folder) = &args.output {
            text += &format!("{}\n", folder.display());
        }
        if let Some(path) = &args.replay {
            text += &format!("{}: run 0, to be looked at\n", path.display());
        }
        text
    }
}

impl RunFigures {
    /// `placed` are the scans that have a reference pose.
    fn of(number: usize, run: &FinishedRun, placed: &[usize]) -> Result<Self> {
        let mut figures = RunFigures {
            run: number,
            diverged: None,
            lost_episodes: None,
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
