//! Interactive parts of a page beside charts and tables, within its limits: runs to watch and maps to
//! compare.

use std::collections::HashSet;
use std::fs::{self, DirEntry};
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail};
use mcl_core::text::counted;
use mcl_study::data::facts::DataFacts;
use mcl_study::measure::Measures;
use mcl_study::store::results::Results;
use mcl_study::trial::cost::Costs;
use mcl_study::trial::run::Trial;

use crate::progress::{error_message, tell};
use crate::report::at_hand::AtHand;
use crate::report::compare_maps::{self, ChosenMaps, MapPair};
use crate::report::slot::{Slot, SlotKind};
use crate::report::watch::{self, ChosenRuns, Watch};

/// Limits in bytes for all runs of a page, and for all maps.
const RUN_BYTES: usize = 1_500_000;
const MAP_BYTES: usize = 400_000;
/// Limit on the estimated processor time of recomputing runs and maps (s).
const SECONDS: f64 = 90.0;

/// What a result folder could show.
pub struct ExhibitRequest {
    folder: PathBuf,
    study: String,
    facts: DataFacts,
    measures: Measures,
    /// Number of scans after which the study truncates the log.
    scans: Option<usize>,
    /// Whether the study has a picture of a run.
    pictures_run: bool,
    /// Its runs, or why they are not shown; `None` for a study without runs.
    runs: Option<Result<ChosenRuns, String>>,
    /// Its maps, or why they are not shown; `None` for a study without two that can be compared.
    maps: Option<Result<ChosenMaps, String>>,
}

/// What a result folder shows.
#[derive(Debug, Default)]
pub struct Exhibits {
    /// Its runs, or why they are not shown; `None` for a study without runs.
    pub runs: Option<Result<PageExhibit<Watch>, String>>,
    /// Its maps, or why they are not shown; `None` for a study without two that can be compared, and where
    /// those of another study on the same data are shown.
    pub maps: Option<Result<PageExhibit<MapPair>, String>>,
}

/// An exhibit, and its slot on the page.
#[derive(Debug)]
pub struct PageExhibit<T> {
    /// What it is.
    pub what: T,
    /// Its place.
    pub slot: Slot,
}

/// The remaining budget of a page.
pub struct PageBudget {
    run_bytes: usize,
    map_bytes: usize,
    seconds: f64,
}

impl Default for PageBudget {
    fn default() -> Self {
        PageBudget { run_bytes: RUN_BYTES, map_bytes: MAP_BYTES, seconds: SECONDS }
    }
}

impl ExhibitRequest {
    /// From rows, which are not needed any more afterwards.
    ///
    /// # Errors
    /// As [`Results::plan`].
    pub fn of(results: &Results) -> Result<Self> {
        let Results { study, facts, .. } = results;
        let has_runs = results.table.column("run").is_some();
        let message = |error: anyhow::Error| error_message(&error);
        let plan = &results.plan;
        let maps = compare_maps::choose(results, plan).transpose();
        Ok(ExhibitRequest {
            folder: results.folder.clone(),
            study: results.name.clone(),
            facts: facts.clone(),
            measures: study.measures.clone(),
            scans: study.listed(&facts.name).and_then(|listed| listed.scans),
            pictures_run: study.views.pictures.iter().any(|picture| picture.run.is_some()),
            runs: has_runs.then(|| watch::choose(results, plan).map_err(message)),
            maps: maps.map(|maps| maps.map_err(message)),
        })
    }

    fn runs(
        &self,
        chosen: &ChosenRuns,
        at_hand: &mut AtHand<'_>,
        budget: &mut PageBudget,
    ) -> Result<PageExhibit<Watch>> {
        let data = at_hand.of(&self.folder, self.scans)?;
        budget.spend(&self.facts, chosen.runs.iter().map(|chosen| &chosen.trial))?;
        let title = format!("{} on {}", self.study, self.facts.title);
        PageExhibit::watch(watch::repeat(title, chosen, &data)?, budget)
    }

    fn maps(
        &self,
        chosen: &ChosenMaps,
        at_hand: &mut AtHand<'_>,
        budget: &mut PageBudget,
    ) -> Result<PageExhibit<MapPair>> {
        let data = at_hand.of(&self.folder, self.scans)?;
        let trials = chosen.recipes.clone().map(|map| Trial { map, runs: Vec::new() });
        budget.spend(&self.facts, &trials)?;
        let title = format!("Maps of {}", self.facts.title);
        let what = compare_maps::repeat(title, chosen, &self.measures, &data)?;
        let slot = Slot::new(SlotKind::CompareMaps, &what.title, &what.describe(), &what)?;
        fit(&mut budget.map_bytes, slot.json.len(), MAP_BYTES, "maps")?;
        Ok(PageExhibit { what, slot })
    }
}

impl PageExhibit<Watch> {
    fn watch(what: Watch, budget: &mut PageBudget) -> Result<Self> {
        let slot = Slot::new(SlotKind::Watch, &what.title, &what.describe(), &what)?;
        fit(&mut budget.run_bytes, slot.json.len(), RUN_BYTES, "runs")?;
        Ok(PageExhibit { what, slot })
    }
}

/// Recomputes what the page shows for each result folder, in order. Logs are those of the registry, and
/// `logs` by path. Runs of studies with a picture of one come first; maps are shown once per data set, of a
/// study without runs if there is one. What exceeds the limits is reported as not shown.
pub fn repeat(
    wanted: &[ExhibitRequest],
    logs: &[String],
    budget: &mut PageBudget,
    is_quiet: bool,
) -> Vec<Exhibits> {
    let started = Instant::now();
    let mut exhibits: Vec<Exhibits> = wanted.iter().map(|_| Exhibits::default()).collect();
    let sorted = |comes_later: fn(&ExhibitRequest) -> bool| {
        let mut order: Vec<usize> = (0..wanted.len()).collect();
        order.sort_by_key(|&place| {
            let ExhibitRequest { facts, study, folder, .. } = &wanted[place];
            (comes_later(&wanted[place]), &facts.name, study, folder)
        });
        order
    };
    if !wanted.is_empty() && !is_quiet {
        tell!("recomputing runs and maps to show them: {SECONDS:.0} s of processor time at most");
    }
    let mut at_hand = AtHand::new(logs);
    let (mut runs, mut maps) = (0, 0);
    for place in sorted(|wanted| !wanted.pictures_run) {
        let of = &wanted[place];
        exhibits[place].runs = of.runs.as_ref().map(|chosen| {
            let shown = of.runs(chosen.as_ref().map_err(Clone::clone)?, &mut at_hand, budget);
            runs += shown.as_ref().map_or(0, |shown| shown.what.runs.len());
            shown.map_err(|error| error_message(&error))
        });
    }
    let mut compared: HashSet<&str> = HashSet::new();
    for place in sorted(|wanted| wanted.runs.is_some()) {
        let of = &wanted[place];
        if compared.contains(of.facts.name.as_str()) {
            continue;
        }
        exhibits[place].maps = of.maps.as_ref().map(|chosen| {
            let shown = of.maps(chosen.as_ref().map_err(Clone::clone)?, &mut at_hand, budget);
            if shown.is_ok() {
                compared.insert(&of.facts.name);
                maps += 1;
            }
            shown.map_err(|error| error_message(&error))
        });
    }
    if runs + maps > 0 && !is_quiet {
        let seconds = started.elapsed().as_secs_f64();
        let (runs, maps) = (counted(runs, "run"), counted(maps, "pair"));
        tell!("recomputed {runs} and {maps} of maps to show them: {seconds:.1} s");
    }
    exhibits
}

/// The runs recorded by `localize` in a folder; files that cannot be read are added to `damaged`.
///
/// # Errors
/// When none can be read, or the page has no room for them.
pub fn localized(
    folder: &Path,
    budget: &mut PageBudget,
    damaged: &mut Vec<(PathBuf, String)>,
) -> Result<PageExhibit<Watch>> {
    PageExhibit::watch(watch::localized(folder, damaged)?, budget)
}

/// The folders with runs recorded by `localize`: a root, those in it, and those in these, sorted. Links are
/// not followed, and folders that cannot be read are left out.
pub fn recorded_folders(root: &Path) -> Vec<PathBuf> {
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
    found.retain(|folder| watch::has_recorded(folder));
    found
}

impl PageBudget {
    /// Subtracts the time of trials from the budget.
    fn spend<'t>(
        &mut self,
        facts: &DataFacts,
        trials: impl IntoIterator<Item = &'t Trial>,
    ) -> Result<()> {
        let costs = Costs::built_in(facts, &Measures::default());
        let seconds: f64 = trials.into_iter().map(|trial| costs.of(trial)).sum();
        if seconds > self.seconds {
            bail!(
                "recomputing it would take about {seconds:.0} s of processor time, and the page as a \
                 whole may take at most {SECONDS:.0} s"
            );
        }
        self.seconds -= seconds;
        Ok(())
    }
}

fn fit(left: &mut usize, bytes: usize, most: usize, what: &str) -> Result<()> {
    if bytes > *left {
        bail!("the page has room for {:.1} MB of {what}, which is already used", most as f64 / 1e6);
    }
    *left -= bytes;
    Ok(())
}
