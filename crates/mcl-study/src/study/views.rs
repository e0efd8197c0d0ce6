//! What tables and figures show of a study's rows, as its file says.

use serde::{Deserialize, Serialize};

/// Everything that is made of a study's rows.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Views {
    /// `summary.csv`.
    pub summary: Summary,
    /// `tests.csv`: what is tested against what.
    pub tests: Vec<TestView>,
    /// Charts.
    pub charts: Vec<Chart>,
    /// Maps and paths.
    pub pictures: Vec<Picture>,
    /// `ranking.csv`: settings over several data sets.
    pub ranking: Option<Ranking>,
}

/// The columns that `summary.csv` gives means and 95 % intervals of, per group of rows that differ in
/// draw and run only.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Summary {
    /// The columns; none: every column that was measured.
    pub columns: Vec<String>,
}

/// Tests of one value of a column against another, wherever the rows differ in nothing else but draw
/// and run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TestView {
    /// Only rows of the entry of `[[trials]]` with this name.
    #[serde(default)]
    pub of: Option<String>,
    /// What is compared.
    pub y: String,
    /// The column whose values are compared.
    #[serde(default = "map_column")]
    pub column: String,
    /// Pairs of its values: the first against the second. None: all pairs.
    #[serde(default)]
    pub pairs: Vec<[String; 2]>,
    /// How they are compared.
    #[serde(default)]
    pub test: TestKind,
    /// Whether logarithms are compared, so that the effect is a ratio.
    #[serde(default)]
    pub ratio: bool,
}

fn map_column() -> String {
    "map".to_owned()
}

/// How two groups of blocks are compared.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TestKind {
    /// Paired by draw and run.
    #[default]
    Paired,
    /// Welch's two-sample test.
    Welch,
}

/// Curves over a column.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chart {
    /// Name of the file without its ending. `{column}` stands for a value: there is a figure per value of
    /// that column.
    pub name: String,
    /// Only rows of the entry of `[[trials]]` with this name.
    #[serde(default)]
    pub of: Option<String>,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// Columns whose values make a curve.
    #[serde(default = "map_columns")]
    pub curves: Vec<String>,
    /// Columns whose values make a panel.
    #[serde(default)]
    pub panels: Vec<String>,
    /// Panels that show parts of the rows; each is drawn for every value of `panels`.
    #[serde(default)]
    pub parts: Vec<Part>,
    /// A column of yes or no: points where some runs say yes are open symbols, with their number.
    #[serde(default)]
    pub marks: Option<String>,
    /// What stands beneath, before what is known of data, blocks and settings.
    #[serde(default)]
    pub caption: String,
}

fn map_columns() -> Vec<String> {
    vec![map_column()]
}

/// An axis of a chart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// The column; several make a curve each.
    #[serde(deserialize_with = "one_or_many")]
    pub column: Vec<String>,
    /// What it shows, with its unit; the column's name where it is not given.
    #[serde(default)]
    pub label: Option<String>,
    /// How values are laid out.
    #[serde(default)]
    pub scale: Scale,
    /// Values less the smallest of their curve.
    #[serde(default)]
    pub above_smallest: bool,
}

fn one_or_many<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Vec<String>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum OneOrMany {
        One(String),
        Many(Vec<String>),
    }
    Ok(match OneOrMany::deserialize(deserializer)? {
        OneOrMany::One(one) => vec![one],
        OneOrMany::Many(many) => many,
    })
}

/// How values are laid out along an axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scale {
    /// Evenly.
    #[default]
    Linear,
    /// By their logarithm.
    Log,
    /// By their logarithm on both sides of zero, evenly between −1 and 1 (or as given).
    Symlog,
    /// By their logarithm on both sides of zero, evenly between −0.1 and 0.1.
    SymlogFine,
    /// In the order in which they come, a place per value.
    Places,
}

/// A panel that shows part of the rows.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Part {
    /// Stands above it.
    pub title: String,
    /// Smallest and largest requested size (%).
    pub sizes: Option<[f64; 2]>,
    /// The scale of the horizontal axis, where it is not the chart's.
    pub x: Option<Scale>,
    /// The scale of the vertical axis, where it is not the chart's.
    pub y: Option<Scale>,
}

/// Maps, and the path of a run on them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Picture {
    /// Name of the file without its ending.
    pub name: String,
    /// The maps, a panel each: factors as in `[base]`, one value each.
    pub maps: Vec<toml::Table>,
    /// Number of a run on each map whose path is shown, and its error over time in a chart of its own.
    #[serde(default)]
    pub run: Option<u32>,
    /// What stands beneath, before what is known of the data.
    #[serde(default)]
    pub caption: String,
}

/// Settings ranked over several data sets, which count the same whatever the scale of their errors: by
/// the geometric mean over data sets and maps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ranking {
    /// Entries of `[[trials]]` whose settings are ranked; none: all of them.
    #[serde(default)]
    pub of: Vec<String>,
    /// What is ranked; smaller is better.
    pub y: String,
    /// Data sets that have no say: nothing may be tuned to a log that results are reported on.
    #[serde(default)]
    pub except: Vec<String>,
}

impl Views {
    /// Checks that the columns and entries of `[[trials]]` that views name exist.
    ///
    /// # Errors
    /// When one does not; the message names the view.
    pub fn check(&self, columns: &[String], entries: &[&str]) -> anyhow::Result<()> {
        let column = |place: &str, name: &str| match columns.iter().any(|known| known == name) {
            true => Ok(()),
            false => anyhow::bail!(
                "{place}: there is no column {name:?}, expected one of {}",
                columns.join(", ")
            ),
        };
        let entry = |place: &str, name: Option<&String>| match name {
            Some(name) if !entries.contains(&name.as_str()) => anyhow::bail!(
                "{place}: none of [[trials]] has the name {name:?}, expected one of {}",
                entries.join(", ")
            ),
            _ => Ok(()),
        };
        for name in &self.summary.columns {
            column("views.summary", name)?;
        }
        for test in &self.tests {
            entry("views.tests.of", test.of.as_ref())?;
            column("views.tests.y", &test.y)?;
            column("views.tests.column", &test.column)?;
        }
        for chart in &self.charts {
            let place = format!("views.charts {:?}", chart.name);
            entry(&place, chart.of.as_ref())?;
            let named = chart.x.column.iter().chain(&chart.y.column).chain(&chart.curves);
            for name in named.chain(&chart.panels).chain(&chart.marks) {
                column(&place, name)?;
            }
        }
        if let Some(ranking) = &self.ranking {
            column("views.ranking.y", &ranking.y)?;
            ranking.of.iter().try_for_each(|name| entry("views.ranking.of", Some(name)))?;
        }
        Ok(())
    }
}
