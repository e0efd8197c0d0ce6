use mcl_core::text::{counted, thousands};
use mcl_filter::FilterSettings;
use mcl_metrics::Interval;
use mcl_study::data::source::LogSource;
use mcl_study::measure::consistency::Consistency;

use crate::cli::args::{Initial, LocalizeArgs};
use crate::cli::output::reference_of;
use crate::localization::{Localization, MeanIntervals, Spread, outcome};
use crate::pose_errors::ErrorFigures;

/// The result as text.
pub fn text(
    found: &Localization,
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
        counted(found.runs, "run"),
        thousands(source.recording.scans.len()),
        args.preset,
        match filter.particles.is_fixed() {
            true => thousands(filter.particles.most),
            false => format!("{} ({:.0} on average)", filter.particles, found.particles_per_scan),
        },
        found.used_beams_per_scan,
        filter.relative_floor(sigma_hit)
    );
    text += &format!("reference: {}\n", reference_of(source));
    match (found.weighted, found.translation, found.heading) {
        (Some(weighted), Some(translation), Some(heading)) => {
            let scans = source.recording.scans.len();
            if found.reference_scans < scans {
                text += &format!(
                    "errors over the {} of {} scans that have a reference pose\n",
                    thousands(found.reference_scans),
                    thousands(scans)
                );
            }
            text += &ErrorFigures { weighted, translation, heading }.table();
        }
        _ => text += "no errors: the log has no reference poses\n",
    }
    if let Some(Spread { mean, largest_at_end }) = found.spread {
        text += &format!(
            "the runs are {mean:.2} m from their mean position on average, and up to {largest_at_end:.2} m at the end\n"
        );
    }
    if let Some(MeanIntervals { weighted: Interval { low, high }, .. }) = found.mean_ci95 {
        text += &format!(
            "mean weighted error: 95 % interval {low:.4} … {high:.4} (bootstrap over runs)\n"
        );
    }
    if let (Some(diverged), Some(lost), Some(recovered)) =
        (found.diverged, found.lost, found.recovered)
    {
        text += &(outcome(found.runs, diverged, lost, recovered) + "\n");
        if args.initial != Initial::Known {
            text += &found_after(found);
        }
        if let Some(rest) = found.without_diverged.filter(|_| diverged > 0) {
            text += &format!("without diverged runs:\n{}", rest.table());
        }
    }
    let Consistency { median_nees, inside_95, log_evidence, explained_beams, .. } =
        found.consistency;
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
    if let Some(nanoseconds) = found.ns_per_beam {
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

/// How many robots that did not know where they were have been found, and how soon.
fn found_after(found: &Localization) -> String {
    let mut scans: Vec<usize> = found.each.iter().filter_map(|run| run.scans_until_found).collect();
    scans.sort_unstable();
    let soon = match scans.as_slice() {
        [] => String::new(),
        [first, .., last] => format!(", after {first} to {last} scans (which count in the errors)"),
        [only] => format!(", after {} (which count in the errors)", counted(*only, "scan")),
    };
    format!("found in {} of {}{soon}\n", scans.len(), counted(found.runs, "run"))
}
