//! Tables and figures of a study's results: `summary.csv`, `tests.csv`, `ranking.csv`, and in `figures/` an
//! SVG, a PNG and for charts the points as CSV; in `figures/paper/` the same for a paper.

mod charts;
mod pictures;
mod regions;
mod space;

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use mcl_core::files::{create_folder, remove, remove_folder};
use mcl_figures::Medium;
use mcl_study::store::results::{FIGURES, Results, SUMMARY, TESTS, save_table};
use mcl_study::view;
use mcl_study::view::estimate::Estimates;

/// Folder of the figures for a paper, below the others.
const PAPER: &str = "paper";

/// Writes `ranking.csv` of a study into its folder, over its data sets; `None` where it has no ranking.
///
/// # Errors
/// When a value is not usable, or the file cannot be written.
pub fn write_ranking(folder: &Path, all: &[Results]) -> Result<Option<PathBuf>> {
    let table = view::ranking::ranking(all)?;
    let path = folder.join("ranking.csv");
    save_table(&path, &table)?;
    Ok((!table.is_empty()).then_some(path))
}

/// Writes the tables of a study on a data set (`summary.csv`, `tests.csv`, the points of its charts), draws
/// its charts and pictures, and returns the paths drawn. Figures that the study no longer has, or that cannot
/// be drawn because rows or maps are missing, are removed, so that no outdated figure is left.
///
/// # Errors
/// When a value is not usable, a map or path cannot be read, or a file cannot be written.
pub fn write(results: &Results) -> Result<Vec<PathBuf>> {
    // Figures for a paper are those of earlier rows.
    let paper = results.folder.join(FIGURES).join(PAPER);
    remove_folder(&paper).with_context(|| format!("cannot remove {}", paper.display()))?;
    draw(results, Medium::Screen)
}

/// The same for a medium; figures for a paper are in a folder of their own.
///
/// # Errors
/// As [`write()`].
pub fn draw(results: &Results, medium: Medium) -> Result<Vec<PathBuf>> {
    let folder = &results.folder;
    let estimates = Estimates::of(results)?;
    save_table(&folder.join(SUMMARY), &view::summary::summary(&estimates)?)?;
    save_table(&folder.join(TESTS), &view::compare::tests(&estimates.groups)?)?;
    let figures = match medium {
        Medium::Screen => folder.join(FIGURES),
        Medium::Paper => folder.join(FIGURES).join(PAPER),
    };
    create_folder(&figures).with_context(|| format!("cannot make {}", figures.display()))?;
    let charts = view::charts::charts(&estimates)?;
    let regions = crate::claims::regions::regions(results)?;
    let of_charts = charts.iter().map(|chart| (&chart.name, chart.to_table()));
    let of_regions = regions.iter().map(|region| (&region.view.name, region.to_table()));
    let mut tables = Vec::new();
    // Tables before figures, which need more memory.
    for (name, table) in of_charts.chain(of_regions) {
        tables.push(figures.join(format!("{name}.csv")));
        save_table(&tables[tables.len() - 1], &table)?;
    }
    let mut drawn = Vec::new();
    for chart in &charts {
        let files = charts::draw(&figures.join(&chart.name), chart, medium);
        drawn.extend(files.with_context(|| format!("chart {}", chart.name))?);
    }
    for region in &regions {
        let name = &region.view.name;
        let files = regions::draw(&figures.join(name), region, medium);
        drawn.extend(files.with_context(|| format!("region {name}"))?);
    }
    let view = space::View::of(results)?;
    for (picture, maps) in results.study.views.pictures.iter().zip(&results.pictured) {
        let maps: Option<Vec<_>> = maps.iter().map(Option::as_ref).collect();
        let Some(maps) = maps else { continue };
        let files = pictures::draw(results, (&figures, medium), picture, &maps, view.as_ref());
        drawn.extend(files.with_context(|| format!("picture {}", picture.name))?);
    }
    let endings: &[&str] = match medium {
        Medium::Screen => &["svg", "png", "csv"],
        Medium::Paper => &["svg", "png", "csv", "pdf", "txt"],
    };
    let shown: HashSet<PathBuf> = drawn.iter().cloned().chain(tables).collect();
    for path in files(&figures)? {
        let is_figure = endings.iter().any(|ending| path.extension() == Some(ending.as_ref()));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::claims::planted::study;

    const STUDY: &str = r#"
[[trials]]
map = ["gbs", "rnd"]
size = [1, 2]
draws = 3
runs = 1
[[trials]]
name = "region"
map = ["gbs", "gbs+f-km", "rnd", "rnd+f-km"]
size = 1
beam_floor = [0.1, 0.4]
preset = ["carmen", "book"]
draws = 2
runs = 1
[[views.tests]]
y = "weighted"
[[views.charts]]
name = "error"
x = { column = "size_percent" }
y = { column = "weighted", scale = "log" }
[[views.charts]]
name = "unknown"
x = { column = "size_percent" }
y = { column = "translation" }
[[views.pictures]]
name = "maps"
maps = [{ map = "all" }]
[[views.regions]]
name = "region"
of = "region"
x = "beam_floor"
y = "preset"
"#;

    /// Fault: figures of an earlier definition were kept, and showed other maps than the rows beside them.
    #[test]
    fn figures_are_of_these_results_or_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let mut results = study("small", STUDY, |row| {
            row.set("weighted", 0.1 * (1.0 + row.number("draw")));
        });
        results.folder = folder.path().to_owned();
        // The map of the picture is missing, and no row has a translation error.
        results.pictured = vec![vec![None]];
        let figures = folder.path().join("figures");
        std::fs::create_dir(&figures).unwrap();
        for stale in ["maps.svg", "maps.png", "unknown.png", "unknown.csv"] {
            std::fs::write(figures.join(stale), "of an earlier run").unwrap();
        }
        std::fs::write(figures.join("notes.txt"), "no figure").unwrap();
        let drawn = write(&results).unwrap();
        let expected = ["error.svg", "error.png", "region.svg", "region.png"];
        assert_eq!(drawn, expected.map(|name| figures.join(name)));
        let entries = std::fs::read_dir(&figures).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        let of_region = ["region.csv", "region.png", "region.svg"];
        let expected = [&["error.csv", "error.png", "error.svg", "notes.txt"], &of_region[..]];
        assert_eq!(names, expected.concat());
        for table in ["summary.csv", "tests.csv"] {
            let text = std::fs::read_to_string(folder.path().join(table)).unwrap();
            assert!(text.starts_with("dataset,split,"), "{text}");
        }
        assert_eq!(write_ranking(folder.path(), &[results]).unwrap(), None);
    }
}
