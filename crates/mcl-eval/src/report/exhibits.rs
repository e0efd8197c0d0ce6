//! What a page shows beside charts and tables, within its limits: runs to watch and maps to compare.

use std::collections::HashSet;
use std::fs::{self, DirEntry};
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail};
use mcl_core::text::counted;
use mcl_study::store::results::Results;
use mcl_study::trial::cost::Costs;
use mcl_study::trial::run::Trial;
use serde::Serialize;

use crate::progress::tell;
use crate::report::at_hand::AtHand;
use crate::report::compare_maps::{self, MapPair};
use crate::report::watch::{self, Watch};

/// Bytes of all runs of a page, and of all maps, at most.
const RUN_BYTES: usize = 2_000_000;
const MAP_BYTES: usize = 600_000;
/// Processor time of computing runs and maps again, at most (s), as estimated before.
const SECONDS: f64 = 120.0;

/// What a result folder has to show.
#[derive(Debug, Default)]
pub struct Exhibits {
    /// Its runs, or why they are not shown; `None` of a study without runs.
    pub runs: Option<Result<Shown<Watch>, String>>,
    /// Its maps, or why they are not shown; `None` of a study without two that can be compared, and where those of
    /// another study on the same data are shown.
    pub maps: Option<Result<Shown<MapPair>, String>>,
}

/// What a page shows beside charts and tables.
#[derive(Debug, Default)]
pub struct Collected {
    /// Of each result folder.
    pub of_results: Vec<Exhibits>,
    /// The runs of each folder that `localize` wrote, or why they are not shown.
    pub localized: Vec<(PathBuf, Result<Shown<Watch>, String>)>,
}

/// Something to show, with its text for the page's script.
#[derive(Debug)]
pub struct Shown<T> {
    /// What it is.
    pub what: T,
    /// The same as JSON.
    pub json: String,
}

impl<T: Serialize> Shown<T> {
    /// With its JSON.
    ///
    /// # Errors
    /// When it cannot be written as JSON.
    pub fn new(what: T) -> Result<Self> {
        let json = serde_json::to_string(&what)?;
        Ok(Shown { what, json })
    }
}

/// What is left of the limits.
struct Left {
    run_bytes: usize,
    map_bytes: usize,
    seconds: f64,
}

/// Reads the runs that `localize` recorded below the roots, and computes again what the page shows of each result
/// folder, in their order. Logs are those of the registry, and `logs` by path. Studies that picture a run come first;
/// what comes after the limits is said not to be shown.
pub fn collect(
    results: &[Results],
    roots: &[PathBuf],
    logs: &[String],
    is_quiet: bool,
) -> Collected {
    let mut left = Left { run_bytes: RUN_BYTES, map_bytes: MAP_BYTES, seconds: SECONDS };
    let mut localized = Vec::new();
    for folder in roots.iter().flat_map(|root| folders(root)) {
        if let Some(shown) = localized_in(&folder, &mut left).transpose() {
            localized.push((folder, shown.map_err(|error| format!("{error:#}"))));
        }
    }
    let of_results = computed(results, logs, &mut left, is_quiet);
    Collected { of_results, localized }
}

/// Of a folder, if it has any.
fn localized_in(folder: &Path, left: &mut Left) -> Result<Option<Shown<Watch>>> {
    let Some(watch) = watch::localized(folder)? else { return Ok(None) };
    let shown = Shown::new(watch)?;
    fit(&mut left.run_bytes, shown.json.len(), RUN_BYTES, "runs")?;
    Ok(Some(shown))
}

/// A root, and the folders in it and in these, sorted. Links are not followed, and what cannot be read is left out.
fn folders(root: &Path) -> Vec<PathBuf> {
    let mut found = vec![root.to_owned()];
    let mut level = 0..1;
    for _ in 0..2 {
        for place in level.clone() {
            let entries = fs::read_dir(&found[place]).into_iter().flatten().flatten();
            let is_folder = |entry: &DirEntry| entry.file_type().is_ok_and(|found| found.is_dir());
            let mut below: Vec<_> = entries.filter(is_folder).map(|entry| entry.path()).collect();
            below.sort();
            found.extend(below);
        }
        level = level.end..found.len();
    }
    found
}

fn computed(
    results: &[Results],
    logs: &[String],
    left: &mut Left,
    is_quiet: bool,
) -> Vec<Exhibits> {
    let started = Instant::now();
    let mut exhibits: Vec<Exhibits> = results.iter().map(|_| Exhibits::default()).collect();
    let mut order: Vec<usize> = (0..results.len()).collect();
    let rank = |place: &usize| {
        let Results { study, facts, name, .. } = &results[*place];
        let pictures_run = study.views.pictures.iter().any(|picture| picture.run.is_some());
        (!pictures_run, facts.name.clone(), name.clone())
    };
    order.sort_by_cached_key(rank);
    let mut at_hand = AtHand::new(logs);
    let mut compared: HashSet<&str> = HashSet::new();
    let (mut runs, mut maps) = (0, 0);
    for place in order {
        let of = &results[place];
        let has_runs = of.table.column("run").is_some();
        if has_runs {
            let shown = runs_of(of, &mut at_hand, left);
            runs += shown.as_ref().map_or(0, |shown| shown.what.runs.len());
            exhibits[place].runs = Some(shown.map_err(|error| format!("{error:#}")));
        }
        if compared.contains(of.facts.name.as_str()) {
            continue;
        }
        let shown = maps_of(of, &mut at_hand, left).transpose();
        if let Some(Ok(_)) = shown {
            compared.insert(&of.facts.name);
            maps += 1;
        }
        exhibits[place].maps = shown.map(|shown| shown.map_err(|error| format!("{error:#}")));
    }
    if runs + maps > 0 && !is_quiet {
        let seconds = started.elapsed().as_secs_f64();
        let (runs, maps) = (counted(runs, "run"), counted(maps, "pair"));
        tell!("computed {runs} and {maps} of maps again to show them: {seconds:.1} s");
    }
    exhibits
}

fn runs_of(results: &Results, at_hand: &mut AtHand<'_>, left: &mut Left) -> Result<Shown<Watch>> {
    let chosen = watch::choose(results)?;
    let trials: Vec<Trial> = chosen.runs.iter().map(|chosen| chosen.trial.clone()).collect();
    let data = at_hand.of(results)?;
    left.spend(results, &trials)?;
    let shown = Shown::new(watch::repeat(results, &chosen, &data)?)?;
    fit(&mut left.run_bytes, shown.json.len(), RUN_BYTES, "runs")?;
    Ok(shown)
}

fn maps_of(
    results: &Results,
    at_hand: &mut AtHand<'_>,
    left: &mut Left,
) -> Result<Option<Shown<MapPair>>> {
    let Some(recipes) = compare_maps::choose(results)? else { return Ok(None) };
    let data = at_hand.of(results)?;
    let trials = recipes.clone().map(|map| Trial { map, runs: Vec::new() });
    left.spend(results, &trials)?;
    let shown = Shown::new(compare_maps::repeat(results, &recipes, &data)?)?;
    fit(&mut left.map_bytes, shown.json.len(), MAP_BYTES, "maps")?;
    Ok(Some(shown))
}

impl Left {
    /// Takes the time of trials off.
    fn spend(&mut self, results: &Results, trials: &[Trial]) -> Result<()> {
        let costs = Costs::built_in(&results.facts);
        let seconds: f64 = trials.iter().map(|trial| costs.of(trial)).sum();
        if seconds > self.seconds {
            bail!(
                "computing it again would take about {seconds:.0} s of the processor, and the page as a whole \
                 takes at most {SECONDS:.0} s"
            );
        }
        self.seconds -= seconds;
        Ok(())
    }
}

fn fit(left: &mut usize, bytes: usize, most: usize, what: &str) -> Result<()> {
    if bytes > *left {
        bail!("the page has room for {:.1} MB of {what}, which others fill", most as f64 / 1e6);
    }
    *left -= bytes;
    Ok(())
}
