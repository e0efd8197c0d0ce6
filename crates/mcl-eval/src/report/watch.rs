//! Runs to watch: of a study the best, the median and the worst of one setting, recomputed; of an output
//! folder of `localize` the recorded ones.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use mcl_core::math;
use mcl_core::text::{counted, number};
use mcl_maps::Refinement;
use mcl_study::measure::RunContext;
use mcl_study::measure::tracking::TRACKING;
use mcl_study::recipe::kind::{Builder, MapKind};
use mcl_study::recipe::map::{MapRecipe, Size};
use mcl_study::recipe::run::RunRecipe;
use mcl_study::store::results::Results;
use mcl_study::study::plan::Plan;
use mcl_study::table::{Cells, Row};
use mcl_study::trial::division::{Division, StudyData};
use mcl_study::trial::map::Dimension;
use mcl_study::trial::maps::Maps;
use mcl_study::trial::run::Trial;
use mcl_study::trial::tracking::{Tracker, track_with};
use rayon::prelude::*;
use serde::Serialize;

use crate::progress::error_message;
use crate::report::record::{MapLooks, RECORDED_END, RecordedRun, Recorder};
use crate::report::text::shown;

/// The column whose mean ranks the runs.
const RANKED_BY: &str = "weighted";
/// The preferred size (percent) where a study has several and no picture.
const SIZE: f64 = 1.0;
/// Size limit of the file of a recorded run (bytes).
const MOST_BYTES: u64 = 2 << 20;
/// Largest number of recorded runs read from a folder.
const MOST_FILES: usize = 10_000;

/// Runs to watch side by side.
#[derive(Debug, Serialize)]
pub struct Watch {
    /// A description of the runs.
    pub title: String,
    /// How they were chosen, in a sentence.
    pub rule: String,
    /// The runs, the best first.
    pub runs: Vec<WatchedRun>,
}

/// A run, and why it was chosen.
#[derive(Debug, Serialize)]
pub struct WatchedRun {
    /// "best", "median" or "worst".
    pub role: &'static str,
    /// The run.
    pub run: RecordedRun,
}

/// The chosen runs of a study.
#[derive(Debug)]
pub struct ChosenRuns {
    /// How they were chosen, in a sentence.
    pub rule: String,
    /// Each with its role and its row.
    pub runs: Vec<ChosenRun>,
}

/// A chosen run of a study.
#[derive(Debug)]
pub struct ChosenRun {
    /// "best", "median" or "worst".
    pub role: &'static str,
    /// The map and the run.
    pub trial: Trial,
    /// The measurements of the run.
    row: Cells,
}

/// The indices of the best, the median and the worst of `number` sorted runs, each once.
fn ranked(number: usize) -> Vec<(&'static str, usize)> {
    match number {
        0 => Vec::new(),
        1 => vec![("only", 0)],
        2 => vec![("best", 0), ("worst", 1)],
        _ => vec![("best", 0), ("median", (number - 1) / 2), ("worst", number - 1)],
    }
}

/// The distance of a map from the preferred one of a study without pictures: the paper's builder, refined, at
/// `SIZE`.
pub fn distance_from_shown(map: &MapRecipe) -> (u8, f64) {
    let kind = match map.kind.kind {
        MapKind::Sampled { builder: Builder::Grid, refinement: Some(Refinement::Fkm {}) } => 0,
        MapKind::Sampled { refinement: Some(_), .. } => 1,
        MapKind::Sampled { refinement: None, .. } => 2,
        _ => 3,
    };
    let size = match map.size {
        Some(Size::Percent(percent)) => math::ln(percent / SIZE).abs(),
        _ => f64::MAX,
    };
    (kind, size)
}

/// Chooses the settings whose runs are shown: those of the study's first picture of a run, else the ones
/// nearest to [`distance_from_shown`]. Runs of external programs are left out.
///
/// # Errors
/// Why there are no runs to show.
pub fn choose(results: &Results, plan: &Plan) -> Result<ChosenRuns> {
    let of_own = |run: &&RunRecipe| run.program().is_none();
    let mut all: Vec<(&MapRecipe, &RunRecipe)> = Vec::new();
    for trial in &plan.trials {
        all.extend(trial.runs.iter().filter(of_own).map(|run| (&trial.map, run)));
    }
    ensure!(
        !all.is_empty(),
        "all of its runs are of external programs, which may not repeat their results"
    );
    let mut leads: Vec<Trial> = Vec::new();
    for picture in &results.study.views.pictures {
        for map in picture.maps.iter().filter(|_| picture.run.is_some()) {
            leads.push(results.study.pictured(&results.facts.name, map, picture.run)?);
        }
    }
    let nearest = all.iter().copied().min_by(|(a, _), (b, _)| {
        let [a, b] = [a, b].map(|map| distance_from_shown(map));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    leads.extend(nearest.map(|(map, run)| Trial { map: map.clone(), runs: vec![run.clone()] }));
    for lead in leads {
        let Some(of_lead) = lead.runs.first().filter(of_own) else { continue };
        let is_alike = |(map, run): &(&MapRecipe, &RunRecipe)| {
            MapRecipe { draw: lead.map.draw, ..(*map).clone() } == lead.map
                && RunRecipe { run: of_lead.run, ..(*run).clone() } == *of_lead
        };
        let alike = all.iter().copied().filter(is_alike);
        let mut found = Vec::new();
        for (map, run) in alike {
            let trial = Trial { map: map.clone(), runs: vec![run.clone()] };
            if let Some(row) = row_of(results, &[map.cells(), run.cells()?].concat()) {
                found.push((trial, row));
            }
        }
        if !found.is_empty() {
            return Ok(rank(found, &lead.map, of_lead));
        }
    }
    bail!("its rows are missing")
}

/// Ranks runs that differ in draw and run only.
fn rank(found: Vec<(Trial, Row<'_>)>, map: &MapRecipe, run: &RunRecipe) -> ChosenRuns {
    let mut found: Vec<(f64, Trial, Row<'_>)> = found
        .into_iter()
        // A run without estimate has no mean, and ranks worst.
        .map(|(trial, row)| (row.number(RANKED_BY).unwrap_or(f64::INFINITY), trial, row))
        .collect();
    found.sort_by(|(a, ..), (b, ..)| a.total_cmp(b));
    let all = found.len();
    let chosen = ranked(all);
    let cells = |row: &Row<'_>| -> Cells {
        TRACKING.columns.iter().map(|&name| (name.to_owned(), row.get(name).clone())).collect()
    };
    let runs = chosen.iter().map(|&(role, place)| {
        let (_, trial, row) = &found[place];
        ChosenRun { role, trial: trial.clone(), row: cells(row) }
    });
    let size = map.size.map_or(String::new(), |size| format!(" {size}"));
    let settings = format!("{}{size}, preset {}, split {}", map.kind, run.preset, split_of(map));
    ChosenRuns {
        rule: rule(&counted(all, "run"), &format!("on {settings}"), all),
        runs: runs.collect(),
    }
}

fn split_of(map: &MapRecipe) -> &'static str {
    map.split.map_or("same", |split| split.name())
}

/// "Of 20 runs on gbs 1 %: …"
fn rule(runs: &str, of: &str, number: usize) -> String {
    let which = match number {
        1 => "the only one",
        2 => "the one with the smaller mean of the weighted error d, and the other",
        n if n % 2 == 1 => {
            "those with the smallest, the median and the largest mean of the weighted error d"
        }
        _ => {
            "those with the smallest, the median (the smaller of the two in the middle) and the largest mean \
             of the weighted error d"
        }
    };
    format!("Of {runs} {of}: {which}.")
}

/// The row whose recipe has these cells.
pub fn row_of<'r>(results: &'r Results, recipe: &Cells) -> Option<Row<'r>> {
    // Settings that differ most often come first: draw and kind of map.
    let is_first = |name: &str| matches!(name, "draw" | "map" | "size_percent");
    let (first, others): (Vec<_>, Vec<_>) = recipe.iter().partition(|(name, _)| is_first(name));
    let is_it =
        |row: &Row<'_>| first.iter().chain(&others).all(|(name, value)| row.get(name) == value);
    results.table.rows().find(is_it)
}

/// Recomputes the chosen runs of a study.
///
/// # Errors
/// When a run cannot be repeated, or differs from its row.
pub fn repeat(title: String, chosen: &ChosenRuns, data: &StudyData) -> Result<Watch> {
    let maps = Maps::<2>::new(data, chosen.runs.iter().map(|chosen| &chosen.trial.map))?;
    let one = |chosen: &ChosenRun| -> Result<WatchedRun> {
        let run = repeat_one(chosen, &maps, data).with_context(|| chosen.trial.to_string())?;
        maps.release(&chosen.trial.map)?;
        Ok(WatchedRun { role: chosen.role, run })
    };
    let runs = chosen.runs.par_iter().map(one).collect::<Result<Vec<_>>>()?;
    Ok(Watch { title, rule: chosen.rule.clone(), runs })
}

fn repeat_one(chosen: &ChosenRun, maps: &Maps<'_, 2>, data: &StudyData) -> Result<RecordedRun> {
    let ChosenRun { trial, row, .. } = chosen;
    let recipe = trial.runs.first().context("a run is shown")?;
    let log = data.log()?;
    let (division, map) = (maps.division(&trial.map)?, maps.get(&trial.map)?);
    let (division, map) = Division::plane(&division, &map).context("the map lies in space")?;
    let distances = map.distances(&recipe.filter.with_max_range(log.max_range)?)?;
    let MapRecipe { seed, split, .. } = trial.map;
    let mut recorder = None;
    let tracker = Tracker::Own(&distances);
    let tracked = track_with(recipe, seed, split, log, division, &tracker, |course, step| {
        let replay = course.replay();
        let recorder = recorder.get_or_insert_with(|| {
            let reference = course.reference.iter().copied().map(Some).collect::<Vec<_>>();
            let scans = course.scans.clone();
            Recorder::new(&replay, reference, scans, course.carried_off, log.max_range)
        });
        recorder.step(replay.recording, step);
    })?;
    let laser_from_robot = log.recording.robot_from_laser.inverse();
    let context = RunContext { recipe, tracked: &tracked, laser_from_robot };
    check_same(&TRACKING.take(&context)?, row)?;
    let MapRecipe { kind, draw, .. } = &trial.map;
    let size = trial.map.size.map_or(String::new(), |size| format!(" {size}"));
    let label = format!("{kind}{size}, draw {draw}, {recipe}");
    recorder.context("the run has no scans")?.finish(label, &MapLooks::of(&map.shape)?)
}

/// Checks that recomputed measurements equal those of a row, bit for bit.
///
/// # Errors
/// The first difference.
pub fn check_same(found: &Cells, row: &Cells) -> Result<()> {
    for ((name, found), (_, there)) in found.iter().zip(row) {
        ensure!(found == there, "{name} comes out as {found}, but the row says {there}");
    }
    Ok(())
}

/// The files of recorded runs in a folder, sorted.
///
/// # Errors
/// When it cannot be read.
pub fn recorded_runs(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.starts_with("run-") && name.ends_with(RECORDED_END) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Whether a folder has runs recorded by `localize`; false if it cannot be read.
pub fn has_recorded(folder: &Path) -> bool {
    recorded_runs(folder).is_ok_and(|files| !files.is_empty())
}

/// The recorded runs of an output folder of `localize`. Files that are not one are left out, and added to
/// `damaged` with the error.
///
/// # Errors
/// When the folder cannot be read, or there are no recorded runs or too many.
pub fn localized(folder: &Path, damaged: &mut Vec<(PathBuf, String)>) -> Result<Watch> {
    let in_folder = || folder.display().to_string();
    let files = recorded_runs(folder).with_context(in_folder)?;
    ensure!(files.len() <= MOST_FILES, "{}: more than {MOST_FILES} recorded runs", in_folder());
    let mut found = Vec::new();
    for path in &files {
        match read(path) {
            Ok(run) => found.push((run.mean_errors.map_or(f64::INFINITY, |[d, ..]| d), path)),
            Err(error) => damaged.push((path.clone(), error_message(&error))),
        }
    }
    let all = found.len();
    let (first, _) = found
        .first()
        .with_context(|| format!("{}: no recorded runs that can be read", in_folder()))?;
    let is_rated = first.is_finite();
    // Without a reference it is not known which is better.
    found.truncate(if is_rated { found.len() } else { 1 });
    found.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let runs = ranked(found.len())
        .into_iter()
        .map(|(role, place)| Ok(WatchedRun { role, run: read(found[place].1)? }));
    let runs = runs.collect::<Result<Vec<_>>>()?;
    let rule = match is_rated {
        true => rule(&counted(all, "run"), "of localize", all),
        false => "The first run: without a reference the runs cannot be ranked.".to_owned(),
    };
    let name = folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy();
    Ok(Watch { title: format!("localize, {name}"), rule, runs })
}

fn read(path: &Path) -> Result<RecordedRun> {
    let metadata = fs::metadata(path)?;
    if !metadata.is_file() || metadata.len() > MOST_BYTES {
        bail!("expected a file of at most {MOST_BYTES} bytes");
    }
    let mut run = RecordedRun::parse(&fs::read_to_string(path)?)?;
    run.label = shown(&run.label);
    Ok(run)
}

impl Watch {
    /// A text description for readers who cannot see it.
    pub fn describe(&self) -> String {
        let of_run = |WatchedRun { role, run }: &WatchedRun| match run.mean_errors {
            Some([weighted, translation, heading]) => format!(
                "{role}: {}: mean d {}, {} m, {}°",
                run.label,
                number(weighted),
                number(translation),
                number(heading.to_degrees())
            ),
            None => format!("{role}: {}: no reference", run.label),
        };
        let runs: Vec<String> = self.runs.iter().map(of_run).collect();
        format!("{} {}.", self.rule, runs.join("; "))
    }
}
