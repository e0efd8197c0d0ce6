//! What was run by `localize`, and what came out, from the `summary.json` beside the recorded runs.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result};
use mcl_core::text::{counted, number, printable, thousands};
use mcl_study::data::reference::RUN_SUMMARY;
use serde::Deserialize;
use serde_json::Value;

use crate::localization::outcome;
use crate::report::text::{argument, shown, shown_lines};

/// Size limit of the summary (bytes): a run has some hundred.
const MOST_BYTES: u64 = 16 << 20;

/// The runs of an output folder of `localize`, in words.
#[derive(Debug)]
pub struct LocalizedRuns {
    /// Log, map, settings, build.
    pub facts: Vec<String>,
    /// Errors and lost runs, in sentences.
    pub results: Vec<String>,
    /// All settings, as JSON.
    pub settings: String,
    /// The command, with all options that were given.
    pub command: String,
}

#[derive(Deserialize)]
struct Summary {
    setup: Value,
    options: Vec<String>,
    figures: Figures,
}

/// Of the settings, those that are named.
#[derive(Deserialize)]
struct Setup {
    version: String,
    log: String,
    recording_sha256: String,
    scans: usize,
    map: String,
    map_points: usize,
    seed: u64,
    preset: String,
    filter: Filter,
    sigma_hit: f64,
}

#[derive(Deserialize)]
struct Filter {
    /// A number, or a range as text.
    particles: Value,
    initial_pose: Start,
}

#[derive(Deserialize)]
struct Start {
    kind: String,
}

#[derive(Deserialize)]
struct Figures {
    runs: usize,
    reference: Option<String>,
    diverged: Option<usize>,
    lost: Option<usize>,
    recovered: Option<usize>,
    weighted: Option<Errors>,
    translation: Option<Errors>,
    heading: Option<Errors>,
}

#[derive(Deserialize)]
struct Errors {
    mean: f64,
    max: f64,
}

/// Reads the summary of a folder.
///
/// # Errors
/// When it cannot be read, or is none.
pub fn read(folder: &Path) -> Result<LocalizedRuns> {
    let mut text = String::new();
    let file = File::open(folder.join(RUN_SUMMARY));
    file.and_then(|file| file.take(MOST_BYTES).read_to_string(&mut text))
        .with_context(|| format!("cannot read {RUN_SUMMARY}"))?;
    of_summary(&text, &folder.to_string_lossy()).with_context(|| format!("in {RUN_SUMMARY}"))
}

fn of_summary(text: &str, folder: &str) -> Result<LocalizedRuns> {
    let Summary { setup: all, options, figures } = serde_json::from_str(text)?;
    let setup = Setup::deserialize(&all)?;
    let Filter { particles, initial_pose } = &setup.filter;
    let particles = particles.as_str().map_or_else(|| particles.to_string(), str::to_owned);
    let sha256 = shown(&setup.recording_sha256);
    let facts = vec![
        format!(
            "log {}: {} scans; SHA-256 {}…",
            shown(&setup.log),
            thousands(setup.scans),
            sha256.get(..12).unwrap_or(&sha256)
        ),
        format!("map {}: {}", shown(&setup.map), counted(setup.map_points, "point")),
        format!(
            "preset {}, {} particles, σ_hit {} m, start {}, seed {}",
            shown(&setup.preset),
            shown(&particles),
            number(setup.sigma_hit),
            shown(&initial_pose.kind),
            setup.seed
        ),
        format!("mcl-eval {}", shown(&setup.version)),
    ];
    let mut words = vec![argument(&setup.log)];
    words.extend(options.iter().map(|option| argument(option)));
    let command = format!("mcl-eval localize {} -o {}", words.join(" "), argument(folder));
    Ok(LocalizedRuns {
        facts,
        results: results(&figures),
        settings: shown_lines(&serde_json::to_string_pretty(&all)?),
        command: printable(&command).into_owned(),
    })
}

fn results(figures: &Figures) -> Vec<String> {
    let runs = counted(figures.runs, "run");
    let Some(reference) = &figures.reference else {
        return vec![format!("{runs} without a reference, hence without errors.")];
    };
    let mut lines = vec![format!("{runs}; reference: {}.", shown(reference))];
    if let (Some(weighted), Some(translation), Some(heading)) =
        (&figures.weighted, &figures.translation, &figures.heading)
    {
        lines.push(format!(
            "Mean weighted error d {} (at most {}), translation {} m ({} m), heading {}° ({}°).",
            number(weighted.mean),
            number(weighted.max),
            number(translation.mean),
            number(translation.max),
            number(heading.mean.to_degrees()),
            number(heading.max.to_degrees())
        ));
    }
    if let (Some(diverged), Some(lost), Some(recovered)) =
        (figures.diverged, figures.lost, figures.recovered)
    {
        lines.push(outcome(figures.runs, diverged, lost, recovered) + ".");
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fault: the page of a folder of `localize` did not say what was run.
    #[test]
    fn the_summary_is_told_in_words() {
        let text = r#"{"setup": {"version": "0.2.0", "log": "a b.log", "recording_sha256": "90832787f15d83c7d8",
            "scans": 1916, "map": "map.csv", "map_points": 1574, "seed": 7, "preset": "book",
            "filter": {"particles": "100..500", "initial_pose": {"kind": "scan"}, "beams": "all"},
            "sigma_hit": 0.2825}, "options": ["--map=map.csv", "--preset=book", "--beams=30; true"], "figures": {"runs": 4, "reference": "exact\u001b poses",
            "diverged": 1, "lost": 4, "recovered": 1, "weighted": {"mean": 5.6657, "max": 17.69},
            "translation": {"mean": 12.32, "max": 39.46}, "heading": {"mean": 1.0, "max": 2.0}}}"#;
        let found = of_summary(text, "out").unwrap();
        assert_eq!(found.facts[0], "log a b.log: 1,916 scans; SHA-256 90832787f15d…");
        assert_eq!(found.facts[1], "map map.csv: 1,574 points");
        let settings = "preset book, 100..500 particles, σ_hit 0.282 m, start scan, seed 7";
        assert_eq!(found.facts[2], settings);
        assert_eq!(found.results[0], r"4 runs; reference: exact\u{1b} poses.");
        let errors = "Mean weighted error d 5.67 (at most 17.69), translation 12.32 m (39.46 m), heading 57.30° (115°).";
        assert_eq!(found.results[1], errors);
        assert_eq!(found.results[2], "1 of 4 runs diverged; lost 4 times, found again 1 time.");
        assert_eq!(
            found.command,
            "mcl-eval localize 'a b.log' --map=map.csv --preset=book '--beams=30; true' -o out"
        );
        assert!(found.settings.contains("\"beams\": \"all\""), "{}", found.settings);
        assert!(of_summary("{}", "out").is_err());
    }
}
