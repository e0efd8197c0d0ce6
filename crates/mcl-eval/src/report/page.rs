//! One HTML file of the gathered results.
//!
//! Everything from files is escaped by the templates, and the page allows only its own scripts: a content
//! security policy lists their digests, and forbids every request.

use std::collections::HashMap;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use askama::Template;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::read::GzDecoder;
use mcl_core::text::{counted, printable, thousands};
use mcl_datasets::registry::Registry;
use mcl_study::data::source;
use mcl_study::store::identity::Identity;
use mcl_study::store::results::{STUDY, TRIALS};
use mcl_study::study::views::ChartKind;
use mcl_study::table::Table;
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use crate::progress::error_message;
use crate::report::answer::{Comparison, Unbeaten, comparisons, unbeaten};
use crate::report::folder::{Folder, stem};
use crate::report::gather::Report;
use crate::report::localized::{self, LocalizedRuns};
use crate::report::matrix::{Matrix, matrix};
use crate::report::payload::{self, Payload, Style, pack};
use crate::report::slot::Slot;
use crate::report::text::{argument, bytes, date, duration, shown, shown_lines, shown_long};
use crate::studies::built_in;

/// plotly.js, compressed by the build script.
const PLOTLY: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/plotly.js.gz"));
/// Styles and scripts of the page, in order. The content of a [`Slot`] brings its own.
const STYLES: [&str; 2] =
    [include_str!("../../assets/report.css"), include_str!("../../assets/watch.css")];
const SCRIPTS: [&str; 2] =
    [include_str!("../../assets/report.js"), include_str!("../../assets/watch.js")];
/// Limit on the size of all figures for print on the page (bytes).
const FIGURE_BYTES: usize = 1_800_000;
/// Studies shown first where they are complete; the others follow in a collapsed list.
const FIRST: [&str; 3] = ["likelihood", "localization", "localizers"];

#[derive(Template)]
#[template(path = "report.html")]
struct Page<'a> {
    policy: String,
    styles: &'a [&'a str],
    scripts: &'a [&'a str],
    plotly: String,
    summary: Vec<String>,
    missing: Vec<String>,
    datasets: Vec<DatasetColumn>,
    builds: Vec<BuildLine>,
    claims: Matrix,
    localized: Vec<LocalizedSection<'a>>,
    studies: Vec<StudySection<'a>>,
}

/// A folder with runs recorded by `localize`.
struct LocalizedSection<'a> {
    path: String,
    /// What was run; `None` where no summary can be read.
    runs: Option<LocalizedRuns>,
    slot: Option<&'a Slot>,
    notes: Vec<String>,
}

impl Page<'_> {
    /// Whether the studies shown first, or the others, have an answer.
    fn has_answers(&self, first: bool) -> bool {
        self.studies.iter().any(|study| study.is_first == first && !study.comparisons.is_empty())
    }
}

struct DatasetColumn {
    name: String,
    /// Of each variant of the data, if known.
    facts: Vec<String>,
}

struct BuildLine {
    build: String,
    studies: String,
}

struct StudySection<'a> {
    id: String,
    name: String,
    about: String,
    /// By data set.
    cells: Vec<Vec<RunCell>>,
    /// "from 31 of 1,480 trials"; empty where it is complete, and without rows.
    partial: String,
    is_first: bool,
    comparisons: Vec<Comparison>,
    /// The tables of the comparisons.
    packed: String,
    unbeaten: Vec<Unbeaten>,
    folders: Vec<FolderSection<'a>>,
    settings: Vec<Settings>,
}

struct RunCell {
    href: String,
    text: String,
    detail: String,
    class: &'static str,
}

struct Settings {
    of: String,
    text: String,
}

struct FolderSection<'a> {
    id: String,
    dataset: String,
    title: String,
    facts: Vec<String>,
    notes: Vec<String>,
    charts: Vec<ChartSection>,
    tables: Vec<TableSection>,
    slots: &'a [Slot],
    figures: Vec<FigureSection>,
    left_out: Vec<String>,
    commands: String,
    packed: String,
}

struct ChartSection {
    name: String,
    curves: Vec<(String, Style)>,
    is_heat: bool,
    has_numbers: bool,
    panels: Vec<String>,
    caption: Vec<String>,
}

struct TableSection {
    title: String,
    rows: String,
    place: usize,
}

struct FigureSection {
    id: String,
    name: String,
    file: String,
    size: String,
    data: String,
}

/// The page.
///
/// # Errors
/// When a figure cannot be read.
pub fn page(report: &Report) -> Result<String> {
    let mut names: Vec<&str> = folders(report).map(|folder| folder.dataset.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    let mut figures = Figures::of(report)?;
    let mut studies = Vec::new();
    let sources = Sources { logs: &report.logs, registry: Registry::from_environment()? };
    for (number, (name, folders)) in report.studies.iter().enumerate() {
        studies.push(study(number, name, folders, &names, (&sources, &mut figures))?);
    }
    studies.sort_by_key(|study| {
        let place = FIRST.iter().position(|first| *first == study.name);
        let place = place.filter(|_| study.is_first).unwrap_or(FIRST.len());
        (place, !study.partial.is_empty())
    });
    if !studies.iter().any(|study| study.is_first) {
        studies.iter_mut().for_each(|study| study.is_first = true);
    }
    let mut plotly = String::new();
    GzDecoder::new(PLOTLY).read_to_string(&mut plotly)?;
    let page = Page {
        policy: policy(SCRIPTS.iter().copied().chain([plotly.as_str()])),
        styles: &STYLES,
        scripts: &SCRIPTS,
        plotly: STANDARD.encode(PLOTLY),
        summary: summary(report, names.len()),
        missing: missing(report),
        datasets: names.iter().map(|name| dataset(report, name)).collect(),
        builds: builds(report),
        claims: matrix(&report.claims),
        localized: report.localized.iter().map(localized).collect(),
        studies,
    };
    Ok(page.render()?)
}

fn localized((path, slot): &(PathBuf, Result<Slot, String>)) -> LocalizedSection<'_> {
    let runs = localized::read(path).map_err(|error| error_message(&error));
    let why = [runs.as_ref().err(), slot.as_ref().err()].into_iter().flatten();
    let notes = why.map(|why| printable(why).into_owned()).collect();
    let path = shown(&path.to_string_lossy());
    LocalizedSection { path, runs: runs.ok(), slot: slot.as_ref().ok(), notes }
}

/// The content security policy: no requests, and no scripts but these.
fn policy<'a>(scripts: impl Iterator<Item = &'a str>) -> String {
    let digest = |script: &str| format!("'sha256-{}'", STANDARD.encode(Sha256::digest(script)));
    let digests: Vec<String> = scripts.map(digest).collect();
    format!(
        "default-src 'none'; script-src {}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'",
        digests.join(" ")
    )
}

fn folders(report: &Report) -> impl Iterator<Item = &Folder> {
    report.studies.values().flatten()
}

/// A summary of what was run, in sentences.
fn summary(report: &Report, datasets: usize) -> Vec<String> {
    let with_rows: Vec<_> = folders(report).filter_map(|folder| folder.rows).collect();
    let all = folders(report).count();
    let studies = match report.studies.len() {
        1 => "1 study".to_owned(),
        count => format!("{count} studies"),
    };
    let mut lines = Vec::new();
    if all > 0 || report.localized.is_empty() {
        lines.push(format!(
            "{studies} on {}: {}",
            counted(datasets, "data set"),
            counted(all, "result folder")
        ));
    }
    if !report.localized.is_empty() {
        lines.push(format!("{} of localize", counted(report.localized.len(), "folder")));
    }
    if !with_rows.is_empty() {
        let [done, asked, rows] = with_rows.iter().fold([0; 3], |[done, asked, rows], of| {
            [done + of.done, asked + of.asked, rows + of.count]
        });
        let last = with_rows.iter().filter_map(|rows| rows.written).max();
        let last =
            last.map_or(String::new(), |last| format!(", the newest file of {}", date(last)));
        lines.push(format!(
            "{} of {} trials done, {} rows{last}",
            thousands(done),
            thousands(asked),
            thousands(rows)
        ));
    }
    lines
}

/// What is missing, in sentences.
fn missing(report: &Report) -> Vec<String> {
    let mut lines = Vec::new();
    let without = folders(report).filter(|folder| folder.rows.is_none()).count();
    if without > 0 {
        let (folders, have) =
            (counted(without, "result folder"), if without == 1 { "has" } else { "have" });
        lines.push(format!(
            "{folders} {have} tables and figures but no rows, like those that are committed with the \
             program: charts are drawn from the tables, claims cannot be decided, and the time of \
             computation is unknown."
        ));
    }
    for folder in folders(report) {
        if let Some(rows) = folder.rows.filter(|rows| rows.done < rows.asked) {
            let (study, dataset) = (shown(&folder.study), shown(&folder.dataset));
            lines.push(format!(
                "{study} on {dataset}: {} of {} trials have rows.",
                thousands(rows.done),
                thousands(rows.asked)
            ));
        }
    }
    for folder in folders(report).filter(|folder| !folder.failures.is_empty()) {
        let (study, dataset) = (shown(&folder.study), shown(&folder.dataset));
        let failed = counted(folder.failures.len(), "trial");
        lines.push(format!(
            "{study} on {dataset}: {failed} failed; its table of failed trials has the reasons."
        ));
    }
    if !report.without_results.is_empty() {
        let names: Vec<String> = report.without_results.iter().map(|name| shown(name)).collect();
        lines.push(format!("No results of {}, which the studies list as well.", names.join(", ")));
    }
    for (folder, why) in &report.damaged {
        let folder = folder.to_string_lossy();
        lines.push(format!("Left out: {}: {}", shown(&folder), printable(why)));
    }
    lines
}

fn dataset(report: &Report, name: &str) -> DatasetColumn {
    let identities =
        folders(report).filter(|f| f.dataset == name).filter_map(|f| f.identity.as_ref());
    let mut facts: Vec<String> = Vec::new();
    for Identity { data, .. } in identities {
        let sha256 = shown(&data.sha256);
        let start = sha256.get(..12).unwrap_or(&sha256);
        let of_data = format!("{}; SHA-256 {start}…", shown(&data.describe()));
        if !facts.contains(&of_data) {
            facts.push(of_data);
        }
    }
    DatasetColumn { name: shown(name), facts }
}

fn builds(report: &Report) -> Vec<BuildLine> {
    let mut builds: Vec<(String, Vec<String>)> = Vec::new();
    for folder in folders(report) {
        let build = folder.identity.as_ref().map(|identity| shown(&identity.build.to_string()));
        let build = build.unwrap_or_else(|| "another version".to_owned());
        let study = shown(&folder.study);
        match builds.iter_mut().find(|(known, _)| *known == build) {
            Some((_, studies)) if studies.contains(&study) => {}
            Some((_, studies)) => studies.push(study),
            None => builds.push((build, vec![study])),
        }
    }
    let line =
        |(build, studies): (String, Vec<String>)| BuildLine { build, studies: studies.join(", ") };
    builds.into_iter().map(line).collect()
}

fn study<'a>(
    number: usize,
    name: &str,
    folders: &'a [Folder],
    datasets: &[&str],
    (sources, figures): (&Sources<'_>, &mut Figures),
) -> Result<StudySection<'a>> {
    let id = format!("study-{number}");
    let mut sections = Vec::new();
    let mut cells: Vec<Vec<RunCell>> = datasets.iter().map(|_| Vec::new()).collect();
    let mut settings: Vec<(Vec<String>, &str)> = Vec::new();
    for (place, folder) in folders.iter().enumerate() {
        let section = section(format!("{id}-{place}"), folder, sources, figures)
            .with_context(|| folder.path.display().to_string())?;
        let column = datasets.iter().position(|name| *name == folder.dataset);
        cells[column.expect("data sets are those of all folders")].push(cell(folder, &section.id));
        sections.push(section);
        let text = folder.settings.as_deref().unwrap_or_default();
        match settings.iter_mut().find(|(_, known)| *known == text) {
            Some((of, _)) => of.push(shown(&folder.dataset)),
            None => settings.push((vec![shown(&folder.dataset)], text)),
        }
    }
    settings.retain(|(_, text)| !text.is_empty());
    let about = settings.first().map_or("", |(_, text)| text);
    let about = about.lines().take_while(|line| line.starts_with('#'));
    let about: Vec<&str> = about.map(|line| line.trim_start_matches('#').trim()).collect();
    let settings = settings
        .iter()
        .map(|(of, text)| Settings { of: of.join(", "), text: shown_lines(text) })
        .collect();
    let partial = partial(folders);
    let comparisons = comparisons(folders);
    let packed = match comparisons.as_slice() {
        [] => String::new(),
        comparisons => pack(&serde_json::to_vec(comparisons)?)?,
    };
    Ok(StudySection {
        packed,
        unbeaten: unbeaten(&comparisons),
        name: shown(name),
        about: shown_long(&about.join(" ")),
        cells,
        is_first: FIRST.contains(&name) && partial.is_empty(),
        partial,
        comparisons,
        folders: sections,
        settings,
        id,
    })
}

/// "from 31 of 1,480 trials", where trials of some folders lack rows.
fn partial(folders: &[Folder]) -> String {
    let with_rows = || folders.iter().filter_map(|folder| folder.rows);
    let [done, asked] =
        with_rows().fold([0; 2], |[done, asked], of| [done + of.done, asked + of.asked]);
    match done < asked {
        true => format!("from {} of {} trials", thousands(done), thousands(asked)),
        false => String::new(),
    }
}

fn cell(folder: &Folder, id: &str) -> RunCell {
    let (text, detail, class) = match folder.rows {
        Some(rows) if rows.done < rows.asked => {
            let text = format!("{}/{}", thousands(rows.done), thousands(rows.asked));
            (text, "trials have rows".to_owned(), "partly")
        }
        Some(rows) => {
            (thousands(rows.asked), format!("trials, {} rows", thousands(rows.count)), "whole")
        }
        None => ("tables".to_owned(), "no rows".to_owned(), "tables"),
    };
    RunCell { href: id.to_owned(), text, detail, class }
}

fn section<'a>(
    id: String,
    folder: &'a Folder,
    sources: &Sources<'_>,
    figures: &mut Figures,
) -> Result<FolderSection<'a>> {
    let mut packed = Payload { charts: Vec::new(), tables: Vec::new() };
    let mut charts = Vec::new();
    for chart in &folder.charts {
        packed.charts.push(payload::chart(chart));
        let is_heat = chart.kind == ChartKind::Heat;
        charts.push(ChartSection {
            name: shown(&chart.name),
            curves: if is_heat { Vec::new() } else { payload::curves(chart) },
            is_heat,
            has_numbers: chart.panels.iter().any(|panel| panel.x.places.is_empty()),
            panels: chart.panels.iter().map(|panel| shown(&panel.title)).collect(),
            caption: chart.caption.iter().map(|text| printable(text).into_owned()).collect(),
        });
    }
    let mut tables = Vec::new();
    let further: [(&str, &Table); 4] = [
        ("Means and intervals", &folder.summary),
        ("Tests", &folder.tests),
        ("Processor time by part of the trials", &times(&folder.timings)),
        ("Failed trials", &folder.failures),
    ];
    for (title, table) in further.into_iter().filter(|(_, table)| !table.is_empty()) {
        packed.tables.push(payload::listed(title, table));
        let place = packed.tables.len() - 1;
        tables.push(TableSection {
            title: title.to_owned(),
            rows: counted(table.len(), "row"),
            place,
        });
    }
    let (shown_figures, left_out) = figures.take(&id, folder);
    let packed = if packed.charts.is_empty() && packed.tables.is_empty() {
        String::new()
    } else {
        pack(&serde_json::to_vec(&packed)?)?
    };
    Ok(FolderSection {
        dataset: shown(&folder.dataset),
        title: shown(folder.title()),
        facts: facts(folder),
        notes: folder.notes.iter().map(|note| printable(note).into_owned()).collect(),
        charts,
        tables,
        slots: &folder.slots,
        figures: shown_figures,
        left_out,
        commands: commands(folder, sources),
        packed,
        id,
    })
}

fn facts(folder: &Folder) -> Vec<String> {
    let mut facts = Vec::new();
    if let Some(identity) = &folder.identity {
        facts.push(shown(&identity.data.describe()));
        facts.push(format!("build {}", shown(&identity.build.to_string())));
    }
    match folder.rows {
        Some(rows) => {
            facts.push(format!("{}, {}", counted(rows.asked, "trial"), counted(rows.count, "row")));
            facts.extend(rows.written.map(|written| format!("{TRIALS} of {}", date(written))));
        }
        None => facts.push("no rows, tables only".to_owned()),
    }
    let seconds: f64 = folder.timings.rows().filter_map(|row| row.number("seconds")).sum();
    if seconds > 0.0 {
        facts.push(format!("{} of processor time", duration(seconds)));
    }
    if !folder.failures.is_empty() {
        facts.push(format!("{} failed", counted(folder.failures.len(), "trial")));
    }
    facts
}

/// Seconds by part, over all trials.
fn times(timings: &Table) -> Table {
    let mut parts: Vec<(&str, usize, f64, f64)> = Vec::new();
    for row in timings.rows() {
        let (part, seconds) = (row.text("part"), row.number("seconds").unwrap_or(0.0));
        match parts.iter_mut().find(|(known, ..)| *known == part) {
            Some((_, count, sum, most)) => {
                (*count, *sum, *most) = (*count + 1, *sum + seconds, most.max(seconds));
            }
            None => parts.push((part, 1, seconds, seconds)),
        }
    }
    let mut table = Table::new(["part", "trials", "seconds", "mean seconds", "longest seconds"]);
    for (part, count, sum, most) in parts {
        table.push(vec![
            part.into(),
            count.into(),
            sum.into(),
            (sum / count as f64).into(),
            most.into(),
        ]);
    }
    table
}

/// Where data comes from.
struct Sources<'a> {
    /// Logs by path.
    logs: &'a [String],
    registry: Registry,
}

/// The commands that recompute and show the folder.
fn commands(folder: &Folder, sources: &Sources<'_>) -> String {
    let root = folder.path.parent().and_then(|study| study.parent());
    let root = root.map_or(".".into(), |root| root.to_string_lossy());
    let root = argument(if root.is_empty() { "." } else { &root });
    let is_built_in = built_in()
        .iter()
        .any(|known| known.name == folder.study && folder.settings.as_deref() == Some(known.text));
    let file = if is_built_in { folder.study.clone() } else { format!("{}.toml", folder.study) };
    let study = argument(&file);
    let mut lines = Vec::new();
    let log = sources.logs.iter().find(|log| source::name_of(log) == folder.dataset);
    let dataset = match log {
        Some(log) => argument(log),
        None if sources.registry.get(&folder.dataset).is_ok() => argument(&folder.dataset),
        None => {
            let sha256 = folder.identity.as_ref().map_or("", |identity| &identity.data.sha256);
            let start = sha256.get(..12).unwrap_or(sha256);
            lines.push(format!("# PATH: the log {}, SHA-256 {start}…", argument(&folder.dataset)));
            "PATH".to_owned()
        }
    };
    if !is_built_in {
        // The name of the file is that of the study.
        let saved = folder.path.join(STUDY);
        lines.push(format!("cp -i {} {study}", argument(&saved.to_string_lossy())));
    }
    lines.push(format!("mcl-eval run {study} --dataset {dataset} -o {root}"));
    lines.push(format!("mcl-eval plot {root}"));
    let log = log.map_or(String::new(), |log| format!(" --log {}", argument(log)));
    lines.push(format!("mcl-eval report {root}{log} -o report.html"));
    lines.iter().map(|line| printable(line)).collect::<Vec<_>>().join("\n")
}

/// Figures for print, compressed: as many as fit, the smaller ones first, so that one large picture does not
/// displace many charts.
struct Figures(HashMap<PathBuf, String>);

impl Figures {
    fn of(report: &Report) -> Result<Self> {
        let paths: Vec<&PathBuf> = folders(report).flat_map(|folder| &folder.figures).collect();
        let mut packed = paths
            .par_iter()
            .map(|path| Ok(((*path).clone(), pack_figure(path)?)))
            .collect::<Result<Vec<_>>>()?;
        packed.sort_by_key(|(_, data)| data.len());
        let mut sum = 0;
        packed.retain(|(_, data)| {
            sum += data.len();
            sum <= FIGURE_BYTES
        });
        Ok(Figures(packed.into_iter().collect()))
    }

    /// The figures of a folder that are on the page, and the paths of the others.
    fn take(&mut self, id: &str, folder: &Folder) -> (Vec<FigureSection>, Vec<String>) {
        let (mut on_page, mut left_out) = (Vec::new(), Vec::new());
        for (number, figure) in folder.figures.iter().enumerate() {
            let Some(data) = self.0.remove(figure) else {
                left_out.push(shown(&figure.to_string_lossy()));
                continue;
            };
            let name = stem(figure).unwrap_or_default();
            on_page.push(FigureSection {
                id: format!("{id}-f{number}"),
                file: shown(&format!("{}-{}-{name}", folder.study, folder.dataset)),
                name: shown(&name),
                size: bytes(fs::metadata(figure).map_or(0, |file| file.len() as usize)),
                data,
            });
        }
        (on_page, left_out)
    }
}

fn pack_figure(path: &Path) -> Result<String> {
    pack(&fs::read(path).with_context(|| format!("cannot read {}", path.display()))?)
}
