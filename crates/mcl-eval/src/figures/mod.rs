//! Tables and figures of a study's results: `summary.csv`, `tests.csv`, `ranking.csv`, and in `figures/` an
//! SVG, a PNG and for charts the points as CSV.

mod charts;
mod pictures;
mod space;

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use mcl_core::files::{create_folder, remove};
use mcl_study::store::results::{FIGURES, Results, SUMMARY, TESTS, save_table};
use mcl_study::view;

/// Writes `summary.csv` and `tests.csv` of a study on a data set, and the points of its charts.
///
/// # Errors
/// When a value cannot be computed with, or a file cannot be written.
pub fn write_tables(results: &Results) -> Result<()> {
    let folder = &results.folder;
    save_table(&folder.join(SUMMARY), &view::summary::summary(results)?)?;
    save_table(&folder.join(TESTS), &view::compare::tests(results)?)?;
    let figures = make_folder(results)?;
    for chart in view::charts::charts(results)? {
        save_table(&figures.join(format!("{}.csv", chart.name)), &chart.to_table())?;
    }
    Ok(())
}

/// Writes `ranking.csv` of a study into its folder, over its data sets; `None` where it ranks nothing.
///
/// # Errors
/// When a value cannot be computed with, or the file cannot be written.
pub fn write_ranking(folder: &Path, all: &[Results]) -> Result<Option<PathBuf>> {
    let table = view::ranking::ranking(all)?;
    let path = folder.join("ranking.csv");
    save_table(&path, &table)?;
    Ok((!table.is_empty()).then_some(path))
}

/// Draws the charts and pictures of a study on a data set. Figures that it does not show, or that cannot be drawn
/// of these results, for their rows or maps are missing, are removed, so that none shows others.
///
/// # Errors
/// When a value cannot be computed with, a map or path cannot be read, or a file cannot be written.
pub fn draw(results: &Results) -> Result<Vec<PathBuf>> {
    let figures = make_folder(results)?;
    let mut drawn = Vec::new();
    let charts = view::charts::charts(results)?;
    for chart in &charts {
        let path = figures.join(&chart.name);
        let files = charts::draw(&path, chart).with_context(|| format!("chart {}", chart.name))?;
        drawn.extend(files);
    }
    let view = space::View::of(results)?;
    for (picture, maps) in results.study.views.pictures.iter().zip(&results.pictured) {
        let maps: Option<Vec<_>> = maps.iter().map(Option::as_ref).collect();
        let Some(maps) = maps else { continue };
        let files = pictures::draw(results, &figures, picture, &maps, view.as_ref());
        drawn.extend(files.with_context(|| format!("picture {}", picture.name))?);
    }
    let tables = charts.iter().map(|chart| figures.join(format!("{}.csv", chart.name)));
    let shown: HashSet<PathBuf> = drawn.iter().cloned().chain(tables).collect();
    for path in files(&figures)? {
        let is_figure =
            ["svg", "png", "csv"].iter().any(|ending| path.extension() == Some(ending.as_ref()));
        if is_figure && !shown.contains(&path) {
            remove(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    Ok(drawn)
}

fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).and_then(Iterator::collect::<std::io::Result<Vec<_>>>);
    let entries =
        entries.with_context(|| format!("cannot look for figures in {}", folder.display()))?;
    Ok(entries.into_iter().map(|entry| entry.path()).collect())
}

fn make_folder(results: &Results) -> Result<PathBuf> {
    let folder = results.folder.join(FIGURES);
    create_folder(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    Ok(folder)
}
