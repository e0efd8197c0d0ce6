//! Tables of results: aligned for a terminal, as Markdown, LaTeX, and with every figure as CSV.

use std::path::Path;

use anyhow::{Context, Result, bail};
use mcl_study::store::results::save;

use super::row::{Row, RowFigures};
use crate::pose_errors::Figures;
use mcl_core::text::{as_cell, printable};

/// Cells in columns, the first of which holds names.
pub struct Table {
    /// Title; may be empty.
    pub title: String,
    pub head: Vec<String>,
    pub rows: Vec<Vec<String>>,
    /// Remark below the table.
    pub remark: String,
}

/// The format of `--table`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableFormat {
    Csv,
    Markdown,
    Latex,
}

/// By the ending of the file's name.
///
/// # Errors
/// When the ending is not one of the supported formats.
pub fn kind_of(path: &Path) -> Result<TableFormat> {
    let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_lowercase);
    match ending.as_deref() {
        Some("csv") => Ok(TableFormat::Csv),
        Some("md") => Ok(TableFormat::Markdown),
        Some("tex") => Ok(TableFormat::Latex),
        _ => bail!("cannot write a table as {}: expected .csv, .md or .tex", path.display()),
    }
}

/// Writes the tables, or for CSV all figures of the rows.
///
/// # Errors
/// When the file cannot be written.
pub fn write(path: &Path, tables: &[Table], rows: &[&Row]) -> Result<()> {
    let text = match kind_of(path)? {
        TableFormat::Csv => return save(path, &csv(rows)?),
        TableFormat::Markdown => join(tables, Table::markdown),
        TableFormat::Latex => join(tables, Table::latex),
    };
    save(path, text.as_bytes())
}

/// Joins tables, one below the other.
pub fn join(tables: &[Table], as_text: impl Fn(&Table) -> String) -> String {
    tables.iter().map(as_text).collect::<Vec<_>>().join("\n")
}

impl Table {
    /// With aligned columns.
    pub fn text(&self) -> String {
        let lines = || std::iter::once(&self.head).chain(&self.rows);
        let width = |column: usize| {
            lines().filter_map(|line| line.get(column)).map(|cell| cell.chars().count()).max()
        };
        let widths: Vec<usize> = (0..self.head.len()).map(|c| width(c).unwrap_or(0)).collect();
        let mut text = String::new();
        if !self.title.is_empty() {
            text += &format!("{}\n", self.title);
        }
        for line in lines() {
            let cells = line.iter().zip(&widths).enumerate();
            let cells = cells.map(|(column, (cell, width))| match column {
                0 => format!("{cell:<width$}"),
                _ => format!("{cell:>width$}"),
            });
            text += cells.collect::<Vec<_>>().join("  ").trim_end();
            text.push('\n');
        }
        if !self.remark.is_empty() {
            text += &format!("({})\n", self.remark);
        }
        text
    }

    fn markdown(&self) -> String {
        let line = |cells: &[String]| {
            let cells = cells.iter().map(|cell| markdown_text(cell));
            format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "))
        };
        let rule: Vec<String> = (0..self.head.len())
            .map(|column| if column == 0 { "---".to_owned() } else { "---:".to_owned() })
            .collect();
        let mut text = String::new();
        if !self.title.is_empty() {
            text += &format!("**{}**\n\n", markdown_text(&self.title));
        }
        text += &line(&self.head);
        text += &format!("| {} |\n", rule.join(" | "));
        self.rows.iter().for_each(|row| text += &line(row));
        if !self.remark.is_empty() {
            text += &format!("\n{}\n", markdown_text(&self.remark));
        }
        text
    }

    fn latex(&self) -> String {
        let line = |cells: &[String]| {
            let line = cells.iter().map(|cell| latex_text(cell)).collect::<Vec<_>>().join(" & ");
            // After the end of the previous line, LaTeX would parse these as its argument.
            let guard = if line.starts_with(['[', '*']) { "{}" } else { "" };
            format!("{guard}{line} \\\\\n")
        };
        let columns = format!("l{}", "r".repeat(self.head.len().saturating_sub(1)));
        let mut text = String::new();
        for said in [&self.title, &self.remark] {
            if !said.is_empty() {
                text += &format!("% {}\n", said.replace(['\n', '\r'], " "));
            }
        }
        text += &format!("\\begin{{tabular}}{{{columns}}}\n\\hline\n{}\\hline\n", line(&self.head));
        self.rows.iter().for_each(|row| text += &line(row));
        text + "\\hline\n\\end{tabular}\n"
    }
}

fn markdown_text(text: &str) -> String {
    let mut escaped = String::new();
    for c in printable(text).chars() {
        if "\\`*_[]<>|".contains(c) {
            escaped.push('\\');
        }
        escaped.push(c);
    }
    escaped
}

fn latex_text(text: &str) -> String {
    let mut escaped = String::new();
    for c in printable(text).chars() {
        match c {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => {
                escaped.push('\\');
                escaped.push(c);
            }
            '\\' => escaped += "\\textbackslash{}",
            '~' => escaped += "\\textasciitilde{}",
            '^' => escaped += "\\textasciicircum{}",
            '°' => escaped += "$^\\circ$",
            '–' => escaped += "--",
            '…' => escaped += "--",
            '<' => escaped += "$<$",
            '>' => escaped += "$>$",
            'σ' => escaped += "$\\sigma$",
            c => escaped.push(c),
        }
    }
    escaped
}

/// A row per estimate with all of its figures; empty where a figure is missing.
fn csv(rows: &[&Row]) -> Result<Vec<u8>> {
    let figures = rows.iter().find_map(|row| row.figures.as_ref());
    let shape: Vec<String> =
        figures.map(cells).unwrap_or_default().into_iter().map(|c| c.0).collect();
    let mut writer = csv::Writer::from_writer(Vec::new());
    let head = ["group", "file", "topic", "failure"].map(str::to_owned);
    writer.write_record(head.iter().chain(&shape))?;
    for row in rows {
        let own = [&row.group, &Some(row.of.file.clone()), &row.of.topic, &row.failure]
            .map(|cell| as_cell(cell.as_deref().unwrap_or_default()).into_owned());
        let figures: Vec<String> = match &row.figures {
            Some(figures) => cells(figures).into_iter().map(|cell| cell.1).collect(),
            None => vec![String::new(); shape.len()],
        };
        writer.write_record(own.iter().chain(&figures)).context("a row of the table")?;
    }
    Ok(writer.into_inner()?)
}

/// The figures of a row by name; the same names for every row of a call.
fn cells(figures: &RowFigures) -> Vec<(String, String)> {
    let number = |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
    let mut cells: Vec<(String, String)> = [
        ("pairs", figures.pairs.to_string()),
        ("unmatched", figures.unmatched.to_string()),
        ("offset_s", figures.offset_s.to_string()),
        ("coverage_time", figures.coverage.time.to_string()),
        ("coverage_path", figures.coverage.path.to_string()),
        ("diverged", figures.diverged.to_string()),
        ("lost", figures.lost.to_string()),
        ("recovered", figures.recovered.to_string()),
        ("lost_share_with_missing", figures.with_missing.lost_share.to_string()),
        ("translation_median_with_missing", number(figures.with_missing.median)),
        ("translation_p95_with_missing", number(figures.with_missing.p95)),
    ]
    .map(|(name, cell)| (name.to_owned(), cell))
    .into();
    let mut push = |name: String, value: Option<f64>| cells.push((name, number(value)));
    for (name, error) in [
        ("weighted", figures.weighted),
        ("translation", Some(figures.translation)),
        ("heading", figures.heading),
    ] {
        let of = |figure: fn(&Figures) -> f64| error.as_ref().map(figure);
        push(format!("{name}_mean"), of(|error| error.mean));
        push(format!("{name}_median"), of(|error| error.median));
        push(format!("{name}_rmse"), of(|error| error.rmse));
        push(format!("{name}_max"), of(|error| error.max));
    }
    for (name, value) in [
        ("mean", figures.ate.mean),
        ("std", figures.ate.std),
        ("rmse", figures.ate.rmse),
        ("min", figures.ate.min),
        ("p05", figures.ate.p05),
        ("median", figures.ate.median),
        ("p95", figures.ate.p95),
        ("max", figures.ate.max),
    ] {
        push(format!("ate_{name}"), Some(value));
    }
    let consistency = figures.consistency.as_ref();
    push("median_nees".to_owned(), consistency.map(|found| found.median_nees));
    push("inside_95".to_owned(), consistency.map(|found| found.inside_95));
    for relative in &figures.rpe {
        let name = format!("rpe_{}_{}", relative.delta, relative.unit);
        push(format!("{name}_pairs"), Some(relative.pairs as f64));
        push(format!("{name}_translation_rmse"), relative.translation.map(|found| found.rmse));
        push(format!("{name}_heading_rmse"), relative.heading.map(|found| found.rmse));
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        Table {
            title: "errors".to_owned(),
            head: vec!["estimate".to_owned(), "ATE, m".to_owned()],
            rows: vec![vec!["a_b|<script>".to_owned(), "0.1".to_owned()]],
            remark: "5 % & more".to_owned(),
        }
    }

    #[test]
    fn names_from_files_are_text() {
        assert!(table().markdown().contains("| a\\_b\\|\\<script\\> | 0.1 |"));
        assert!(table().latex().contains("a\\_b|$<$script$>$ & 0.1 \\\\"));
        let starred = Table { rows: vec![vec!["*.tum".to_owned(), "1".to_owned()]], ..table() };
        assert!(starred.latex().contains("\n{}*.tum & 1 "));
        assert!(table().text().starts_with("errors\nestimate      ATE, m\na_b|<script>"));
        assert!(kind_of("x.html".as_ref()).is_err());
        assert_eq!(kind_of("x.TEX".as_ref()).unwrap(), TableFormat::Latex);
    }
}
