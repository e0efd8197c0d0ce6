//! The settings in which rows differ, derived from the columns of a table.

use crate::recipe::localizer::LOCALIZER;
use crate::table::{Row, Value};

/// The columns in which rows of the same settings differ: they identify draws and runs.
pub const WITHIN: [&str; 3] = ["draw", "map_seed", "run"];

/// The columns for the size of a map. A map of all points has no size to choose.
pub const SIZE: [&str; 4] = ["size_percent", "size_points", "resolution_m", "size_by"];

/// The columns for the σ of a mixture.
pub const SIGMA: [&str; 2] = ["sigma_m", "sigma_by"];

/// The setting that determines others: a set of settings of the filter.
pub const PRESET: &str = "preset";

/// The setting of runs that is not one of the filter.
const NOISE: &str = "noise";

/// Endings of the names of columns that form one setting, in the order of their values.
const AXES: [&str; 4] = ["_xy", "_x", "_y", "_theta"];

/// A setting of a recipe: one column, or several that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// The column's name, or the common part of several columns: `alpha` of `alpha1` … `alpha4`, `noise` of
    /// `noise_xy` and `noise_theta`.
    pub name: String,
    /// The columns.
    pub columns: Vec<String>,
    /// Whether it is a setting of the map, not of the run.
    pub of_map: bool,
}

impl Setting {
    /// Its values in a row.
    pub fn values(&self, row: &Row<'_>) -> Vec<Value> {
        self.columns.iter().map(|column| row.get(column).clone()).collect()
    }

    /// Whether a preset can determine it.
    pub fn is_of_filter(&self) -> bool {
        !self.of_map && ![PRESET, NOISE, LOCALIZER].contains(&self.name.as_str())
    }
}

/// Values of a setting as text: "0.1", "(0.05, 0.02, 0.01, 0.02)".
pub fn text_of(values: &[Value]) -> String {
    match values {
        [one] => one.to_string(),
        several => {
            let texts: Vec<String> = several.iter().map(Value::to_string).collect();
            format!("({})", texts.join(", "))
        }
    }
}

/// The settings among the columns of a table, in their order, except the `other` columns.
///
/// The columns of a map's recipe come before everything that is measured, those of a run's recipe after the
/// measures of the map.
pub fn settings(columns: &[String], measured: &[&str], other: &[&str]) -> Vec<Setting> {
    let is_measured = |column: &String| measured.contains(&column.as_str());
    let end_of_map = columns.iter().position(is_measured).unwrap_or(columns.len());
    let mut settings: Vec<Setting> = Vec::new();
    for (place, column) in columns.iter().enumerate() {
        let is_other = other.iter().chain(&WITHIN).any(|other| other == column);
        if is_measured(column) || is_other {
            continue;
        }
        let stem = stem(column);
        let siblings = columns.iter().filter(|other| self::stem(other) == stem);
        let name = if siblings.count() > 1 { stem } else { column };
        match settings.iter_mut().find(|setting| setting.name == name) {
            Some(setting) => {
                setting.columns.push(column.clone());
                setting.columns.sort_by_key(|column| (axis(column), column.clone()));
            }
            None => settings.push(Setting {
                name: name.to_owned(),
                columns: vec![column.clone()],
                of_map: place < end_of_map,
            }),
        }
    }
    settings
}

/// A column's name without the number or axis at its end.
fn stem(column: &str) -> &str {
    let without_number = column.trim_end_matches(|c: char| c.is_ascii_digit());
    if without_number != column {
        return without_number;
    }
    axis(column).and_then(|axis| column.strip_suffix(AXES[axis])).unwrap_or(column)
}

/// The axis at the end of a column's name.
fn axis(column: &str) -> Option<usize> {
    AXES.iter().position(|axis| column.ends_with(axis))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_belong_together_are_one_setting() {
        let columns = "map draw map_seed data_points alpha1 alpha2 beams noise_theta noise_xy run weighted trials";
        let columns: Vec<String> = columns.split(' ').map(str::to_owned).collect();
        let found = settings(&columns, &["data_points", "weighted"], &["trials"]);
        let names: Vec<(&str, usize, bool)> =
            found.iter().map(|s| (s.name.as_str(), s.columns.len(), s.of_map)).collect();
        let expected =
            [("map", 1, true), ("alpha", 2, false), ("beams", 1, false), ("noise", 2, false)];
        assert_eq!(names, expected);
        assert_eq!(found[3].columns, ["noise_xy", "noise_theta"]);
        assert_eq!(text_of(&[0.5.into()]), "0.5");
        assert_eq!(text_of(&[0.5.into(), 2u32.into()]), "(0.5, 2)");
    }
}
