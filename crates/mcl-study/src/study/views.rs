//! Views: the tables and figures of a study's rows, as defined by its file.

use serde::{Deserialize, Serialize};

/// Whether a run was lost at any time, or at its end.
pub const LOST: &str = "lost";
/// Prefix of the name of a column over the runs that were never lost. It depends on the outcome: it is shown,
/// and never tested.
pub(crate) const TRACKED: &str = "tracked_";
/// The measures of losses: how often a run was lost, and whether it ended so.
pub(crate) const EPISODES: &str = "lost_episodes";
pub(crate) const DIVERGED: &str = "diverged";

/// The measured columns that a derived column is computed from; `None` for any other.
pub fn made_of(column: &str) -> Option<Vec<&str>> {
    match column.strip_prefix(TRACKED) {
        Some(of) => Some(vec![of, EPISODES, DIVERGED]),
        None => (column == LOST).then(|| vec![EPISODES, DIVERGED]),
    }
}

/// All tables and figures of a study's rows.
///
/// A *column* is one of `trials.csv`. Settings that belong together count as one column: `alpha` stands for
/// `alpha1` … `alpha4`, `noise` for `noise_xy` and `noise_theta`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Views {
    /// `summary.csv`.
    pub summary: Summary,
    /// Columns of `summary.csv`, and axes of charts, that compare sizes.
    pub factors: Vec<Factor>,
    /// `tests.csv`: what is tested against what.
    pub tests: Vec<TestView>,
    /// Charts.
    pub charts: Vec<Chart>,
    /// Regions where statements of the paper hold among the values of two settings.
    pub regions: Vec<Region>,
    /// Maps and paths.
    pub pictures: Vec<Picture>,
    /// `ranking.csv`: settings over several data sets.
    pub ranking: Option<Ranking>,
}

/// The columns for which `summary.csv` has means and 95 % intervals, per group of rows that differ in draw
/// and run only.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Summary {
    /// The columns; if empty, every measured column.
    pub columns: Vec<String>,
    /// Columns that are also reported without diverged runs, as `kept_…`. They depend on the outcome, so they
    /// are reported and never tested.
    pub kept: Vec<String>,
}

/// The ratio of the `x` that another kind of map needs for the same `y` to a map's own `x`: it is where the
/// other curve over `x` reaches the `y` of the map. Between sizes the logarithm of `x` is interpolated; where
/// the curve does not reach that far, there is no value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Factor {
    /// Name of the column.
    pub name: String,
    /// The cost of a map, such as `map_points`.
    pub x: String,
    /// The benefit of a map, such as `log_likelihood`.
    pub y: String,
    /// The kind of map that others are compared with, in the column `map`.
    pub than: String,
}

/// Tests of one value of a column against another, wherever the rows differ in nothing else but draw and run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TestView {
    /// Only the settings that the entries of `[[trials]]` with these names ask for; if empty, all.
    #[serde(default, deserialize_with = "one_or_many")]
    pub of: Vec<String>,
    /// What is compared.
    pub y: String,
    /// The column whose values are compared.
    #[serde(default = "map_column")]
    pub column: String,
    /// Pairs of its values: the first against the second. If empty, all pairs.
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

/// Curves over a column, or coloured cells over two.
///
/// Settings that vary and are not used by any part of a chart get further panels, so that rows that differ in
/// more than draw and run are never averaged or drawn over each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chart {
    /// Name of the file without its ending. `{column}` stands for a value: there is a figure per value of
    /// that column.
    pub name: String,
    /// Only the settings that the entries of `[[trials]]` with these names ask for; if empty, all.
    #[serde(default, deserialize_with = "one_or_many")]
    pub of: Vec<String>,
    /// How it is drawn.
    #[serde(default)]
    pub kind: ChartKind,
    /// The horizontal axis; several columns get a curve each. Without it, the setting with the most values,
    /// numbers first.
    pub x: Option<Axis>,
    /// The vertical axis, or the colour; several columns get a panel each.
    pub y: Axis,
    /// Columns with a curve, or a row of cells, per value; if not given, `map`, or without `x` the setting
    /// with the next most values.
    pub curves: Option<Vec<String>>,
    /// Columns with a panel per value.
    #[serde(default)]
    pub panels: Vec<String>,
    /// Number of panels side by side; one if not given.
    pub columns: Option<usize>,
    /// Panels that show parts of the rows; each is drawn for every value of `panels`.
    #[serde(default)]
    pub parts: Vec<Part>,
    /// The column for open symbols: for a column of yes or no, points where some runs say yes, with their
    /// number; for a setting (`size_by`), points that have one, with its value.
    pub marks: Option<String>,
    /// Caption, placed before the description of data, blocks and settings.
    #[serde(default)]
    pub caption: String,
}

/// How a chart is drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChartKind {
    /// As curves.
    #[default]
    Curves,
    /// As cells whose colours are values.
    Heat,
}

/// An axis of a chart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// The columns.
    #[serde(deserialize_with = "one_or_many")]
    pub column: Vec<String>,
    /// Label with unit; if not given, that of the column.
    pub label: Option<String>,
    /// The scale; without `x` and for `places`, chosen by the values.
    #[serde(default)]
    pub scale: Scale,
    /// What values are relative to; they have no interval then.
    pub relative: Option<Relative>,
}

/// What the values of a curve are relative to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Relative {
    /// Difference to the smallest of their curve.
    AboveSmallest,
    /// Difference to the largest of their curve.
    BelowLargest,
    /// Ratio to the value on all points, under the same settings.
    TimesAll,
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

/// The scale of an axis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scale {
    /// Linear.
    #[default]
    Linear,
    /// Logarithmic.
    Log,
    /// Logarithmic on both sides of zero, linear between −1 and 1.
    Symlog,
    /// Logarithmic on both sides of zero, linear between −0.1 and 0.1.
    SymlogFine,
    /// In ascending order, equally spaced.
    Places,
}

/// A panel that shows part of the rows.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Part {
    /// Title above it.
    pub title: String,
    /// The vertical axis, where it differs from the chart's: a measured column; `lost`, the share of runs
    /// that were lost at any time; or `tracked_` and a measured column, over the runs that were never lost.
    pub column: Option<String>,
    /// Smallest and largest requested size (%).
    pub sizes: Option<[f64; 2]>,
    /// The scale of the horizontal axis, where it differs from the chart's.
    pub x: Option<Scale>,
    /// The scale of the vertical axis, where it differs from the chart's.
    pub y: Option<Scale>,
}

/// The paper's kinds of map by initialization: the initial map, and the same refined by fuzzy k-means. Its
/// statements are about these four.
pub const INITIALIZATIONS: [[&str; 2]; 2] = [["gbs", "gbs+f-km"], ["rnd", "rnd+f-km"]];

/// The paper's statements about localization, decided for every combination of two settings from its rows
/// alone. Apart from these, and the kind and size of maps, nothing varies in the entry; what a preset
/// determines may vary with it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// Name of the file without its ending.
    pub name: String,
    /// Name of the entry of `[[trials]]`.
    pub of: String,
    /// The setting along x.
    pub x: String,
    /// The setting along y.
    pub y: String,
    /// Caption, placed before the description of data, blocks and settings.
    #[serde(default)]
    pub caption: String,
}

/// Maps, and the path of a run on them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Picture {
    /// Name of the file without its ending.
    pub name: String,
    /// The maps, a panel each: factors as in `[base]`, one value each.
    pub maps: Vec<toml::Table>,
    /// Number of a run on each map whose path is shown, with its error over time in a separate chart.
    pub run: Option<u32>,
    /// Caption, placed before the description of the data.
    #[serde(default)]
    pub caption: String,
}

/// Settings ranked over several data sets, which have the same weight whatever the scale of their errors: by
/// the geometric mean over data sets and maps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ranking {
    /// Entries of `[[trials]]` whose settings are ranked, each separately; if empty, all settings together.
    #[serde(default)]
    pub of: Vec<String>,
    /// What is ranked; smaller is better.
    pub y: String,
    /// Data sets that do not count: nothing may be tuned to a log on which results are reported.
    #[serde(default)]
    pub except: Vec<String>,
}
