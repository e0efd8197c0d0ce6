//! `summary.csv`: means and intervals per group of rows.

use anyhow::Result;
use mcl_metrics::Interval;

use crate::store::results::Results;
use crate::study::plan::ENTRIES;
use crate::table::{Table, Value};
use crate::view::estimate::{Estimate, Estimates};
use crate::view::groups::{Group, Groups};

/// The columns that always identify groups.
pub const ALWAYS: [&str; 4] = ["dataset", "split", "map", "size_percent"];

/// Begins the names of columns over the runs that did not diverge.
pub const KEPT: &str = "kept_";

/// The column of runs that were lost at the end.
const DIVERGED: &str = "diverged";

/// Means of the columns named in `[views.summary]`, per group of rows that differ in draw and run only.
///
/// Columns: the data set, split, map and size, and every other setting that varies; `trials`, the names of
/// the entries that ask for the group; `blocks` (independent units: draws), `rows`, and `asked`, the number of
/// rows that the study asks for. Then per column `c` of numbers the mean `c`, the standard deviation
/// `c_sd` of the means of blocks, and Student's 95 % interval over blocks, `c_low` to `c_high`; empty with fewer
/// than two blocks, or where a row has no value. Per column of yes or no `c` is the number of rows that say
/// yes, and `c_low` to `c_high` the 95 % interval of that number among as many rows, where all rows of a block count as
/// one trial ([`mcl_metrics::BlockedRate`]). Then the factors of `[[views.factors]]`, and per column of
/// `kept` mean and interval over the runs that did not diverge (`kept_rows` of them).
///
/// # Errors
/// When a run occurs twice in a draw, or a value cannot be computed with.
pub fn summary(estimates: &Estimates<'_>) -> Result<Table> {
    let groups = &estimates.groups;
    let results = groups.results;
    let settings = columns_of(groups, &groups.all.iter().collect::<Vec<_>>());
    let wanted = &results.study.views.summary;
    let of_measures = results.study.measures.columns();
    let has_numbers = |column: &&str| results.table.rows().any(|r| r.number(column).is_some());
    let measured: Vec<&str> = match wanted.columns.is_empty() {
        true => of_measures.into_iter().filter(has_numbers).collect(),
        false => {
            // A data set may have no runs.
            let columns = wanted.columns.iter().map(String::as_str);
            columns.filter(|column| results.table.column(column).is_some()).collect()
        }
    };
    let measured: Vec<(&str, bool)> =
        measured.into_iter().map(|column| (column, is_yes_or_no(results, column))).collect();
    let has_entries = results.table.column(ENTRIES).is_some();
    let kept: &[String] = if results.table.column(DIVERGED).is_some() { &wanted.kept } else { &[] };

    let mut columns: Vec<String> = settings.iter().map(|(_, column)| column.clone()).collect();
    columns.extend(has_entries.then(|| ENTRIES.to_owned()));
    columns.extend(["blocks", "rows", "asked"].map(str::to_owned));
    for (column, is_yes_or_no) in &measured {
        columns.push((*column).to_owned());
        if !is_yes_or_no {
            columns.push(format!("{column}_sd"));
        }
        columns.extend(["low", "high"].map(|end| format!("{column}_{end}")));
    }
    columns.extend(estimates.factors().map(str::to_owned));
    if !kept.is_empty() {
        columns.push(format!("{KEPT}rows"));
    }
    for column in kept {
        columns.extend(["", "_low", "_high"].map(|end| format!("{KEPT}{column}{end}")));
    }

    let mut table = Table::new(columns);
    for group in &groups.all {
        let mut row: Vec<Value> =
            settings.iter().map(|&(at, _)| group.values(at.0)[at.1].clone()).collect();
        if has_entries {
            let entries: Vec<&str> = group.entries.iter().map(String::as_str).collect();
            row.push(entries.join(" ").into());
        }
        row.extend([group.blocks().into(), group.rows.len().into(), group.asked.into()]);
        for &(column, is_yes_or_no) in &measured {
            row.extend(cells(estimates, group, column, is_yes_or_no)?);
        }
        for factor in estimates.factors() {
            row.push(estimates.mean(group, factor)?.map(|found| found.mean).into());
        }
        row.extend(cells_of_kept(group, kept)?);
        table.push(row);
    }
    Ok(table)
}

/// The columns that identify groups, each with the indices of setting and value.
pub fn columns_of(groups: &Groups<'_>, shown: &[&Group<'_>]) -> Vec<((usize, usize), String)> {
    let varying = groups.varying(shown);
    let mut columns = Vec::new();
    for (place, setting) in groups.settings.iter().enumerate() {
        for (part, column) in setting.columns.iter().enumerate() {
            let value = |group: &Group<'_>| group.values(place)[part].clone();
            let has_it: Vec<_> =
                shown.iter().filter(|group| groups.matters(group, place)).collect();
            let varies = || has_it.windows(2).any(|pair| value(pair[0]) != value(pair[1]));
            if ALWAYS.contains(&column.as_str()) || (varying.contains(&place) && varies()) {
                columns.push(((place, part), column.clone()));
            }
        }
    }
    columns
}

fn cells(
    estimates: &Estimates<'_>,
    group: &Group<'_>,
    column: &str,
    is_yes_or_no: bool,
) -> Result<Vec<Value>> {
    let found = estimates.mean(group, column)?;
    let ends = |factor: f64| interval_cells(found.and_then(|f| f.interval), factor);
    if is_yes_or_no {
        let rows = found.map_or(0, |found| found.rows) as f64;
        let number = found.map(|found| (found.mean * rows).round() as u64);
        return Ok([vec![number.into()], ends(rows).to_vec()].concat());
    }
    let [mean, spread] = [found.map(|f| f.mean), found.and_then(|f| f.spread)];
    Ok([vec![mean.into(), spread.into()], ends(1.0).to_vec()].concat())
}

fn cells_of_kept(group: &Group<'_>, kept: &[String]) -> Result<Vec<Value>> {
    if kept.is_empty() {
        return Ok(Vec::new());
    }
    let is_kept = |row: &crate::table::Row<'_>| *row.get(DIVERGED) == Value::Bool(false);
    let number = group.rows.iter().filter(|row| is_kept(row)).count();
    let mut cells = vec![number.into()];
    for column in kept {
        let values = group.blocked_where(column, is_kept)?;
        let found = values.map(|values| Estimate::of(&values));
        cells.push(found.map(|found| found.mean).into());
        cells.extend(interval_cells(found.and_then(|found| found.interval), 1.0));
    }
    Ok(cells)
}

fn is_yes_or_no(results: &Results, column: &str) -> bool {
    results.table.rows().any(|row| matches!(row.get(column), Value::Bool(_)))
}

fn interval_cells(interval: Option<Interval>, factor: f64) -> [Value; 2] {
    [interval.map(|i| i.low * factor).into(), interval.map(|i| i.high * factor).into()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::planted::planted;

    const STUDY: &str = r#"
seed = 1
[[trials]]
map = ["gbs", "rnd", "all"]
size = 1
draws = 3
runs = 2
sigma_hit = [0.1, 0.2]
[views.summary]
columns = ["map_points", "weighted", "diverged", "found_after_scans"]
kept = ["weighted"]
"#;

    fn results() -> Results {
        planted(STUDY, "office", |row| {
            let (draw, run) = (row.number("draw").unwrap(), row.number("run").unwrap());
            // Draws 0, 1, 2 hold runs 0 and 3, 1 and 4, 2 and 5.
            let diverged = row.text("map") == "rnd" && run >= 4.0;
            let factor = if row.text("map") == "gbs" { 1.0 } else { 2.0 };
            vec![
                ("map_points", (100.0 + draw).into()),
                ("weighted", (factor * (draw + run) + if diverged { 90.0 } else { 1.0 }).into()),
                ("diverged", diverged.into()),
                ("found_after_scans", (!diverged).then_some(4u32).into()),
            ]
        })
    }

    #[test]
    fn groups_differ_in_settings_and_rows_in_draw_and_run() {
        let table = summary(&Estimates::of(&results()).unwrap()).unwrap();
        let settings = &table.columns()[..8];
        let expected =
            ["dataset", "split", "map", "size_percent", "sigma_hit", "blocks", "rows", "asked"];
        assert_eq!(settings, expected);
        assert_eq!(table.len(), 6);
        let rows: Vec<_> = table.rows().collect();
        assert!(rows.iter().all(|row| row.get("blocks") == &Value::Count(3)));
        assert!(
            rows.iter().all(|row| [row.get("rows"), row.get("asked")] == [&Value::Count(6); 2])
        );
        let names: Vec<(&str, Option<f64>)> =
            rows.iter().map(|row| (row.text("map"), row.number("sigma_hit"))).collect();
        assert_eq!(names[..3], [("gbs", Some(0.1)), ("gbs", Some(0.2)), ("rnd", Some(0.1))]);

        // gbs: 1 + draw + run: 1 and 4, 3 and 6, 5 and 8. Means of blocks 2.5, 4.5, 6.5: Student's
        // quantile with two degrees of freedom is 4.302653, the standard error 2 / √3.
        let gbs = rows[0];
        assert_eq!(gbs.number("weighted"), Some(4.5));
        assert_eq!(gbs.number("weighted_sd"), Some(2.0));
        let half = 4.302_652_73 * 2.0 / 3f64.sqrt();
        assert!((gbs.number("weighted_low").unwrap() - (4.5 - half)).abs() < 1e-6);
        assert!((gbs.number("weighted_high").unwrap() - (4.5 + half)).abs() < 1e-6);
        assert_eq!(
            (gbs.number("map_points"), gbs.number("map_points_sd")),
            (Some(101.0), Some(1.0))
        );
        assert_eq!(
            (gbs.get("diverged"), gbs.number("diverged_low")),
            (&Value::Count(0), Some(0.0))
        );
        // No run diverged in as many trials as there are maps: 1 − 0.025^(1/3) of six runs.
        let high = 6.0 * (1.0 - 0.025f64.powf(1.0 / 3.0));
        assert!((gbs.number("diverged_high").unwrap() - high).abs() < 1e-9);
        assert_eq!(gbs.number("found_after_scans"), Some(4.0));
    }

    /// A measure that depends on the outcome is either reported beside the whole, or not at all.
    #[test]
    fn diverged_runs_count_and_are_left_out_only_where_that_is_said() {
        let table = summary(&Estimates::of(&results()).unwrap()).unwrap();
        let rnd = table.rows().find(|row| row.text("map") == "rnd").unwrap();
        // 1 and 7, 5 and 100, 9 and 104.
        let mean = (1.0 + 7.0 + 5.0 + 100.0 + 9.0 + 104.0) / 6.0;
        assert!((rnd.number("weighted").unwrap() - mean).abs() < 1e-12);
        assert_eq!(rnd.get("diverged"), &Value::Count(2));
        assert_eq!(rnd.get("kept_rows"), &Value::Count(4));
        // Means of blocks 4, 5, 9.
        assert!((rnd.number("kept_weighted").unwrap() - 6.0).abs() < 1e-12);
        assert!(rnd.number("kept_weighted_low").unwrap() < 6.0);
        // Not the mean over the runs that were found.
        assert!(rnd.get("found_after_scans").is_empty());
    }

    #[test]
    fn missing_rows_are_counted() {
        let results = results().without(2, |row| {
            row.text("map") == "rnd" && row.number("draw") > Some(0.0)
                || row.text("map") == "all" && row.number("sigma_hit") == Some(0.2)
        });
        let table = summary(&Estimates::of(&results).unwrap()).unwrap();
        let counts = |map: &str, sigma_hit: f64| {
            let is = |row: &crate::table::Row<'_>| {
                row.text("map") == map && row.number("sigma_hit") == Some(sigma_hit)
            };
            let row = table.rows().find(is).unwrap();
            [row.get("blocks"), row.get("rows"), row.get("asked")].map(|value| value.number())
        };
        assert_eq!(counts("gbs", 0.1), [Some(3.0), Some(6.0), Some(6.0)]);
        assert_eq!(counts("rnd", 0.2), [Some(1.0), Some(2.0), Some(6.0)]);
        assert_eq!(counts("all", 0.2), [Some(0.0), Some(0.0), Some(6.0)]);
        let rnd = table.rows().find(|row| row.text("map") == "rnd").unwrap();
        assert_eq!(rnd.number("weighted"), Some(4.0));
        assert!(rnd.get("weighted_low").is_empty() && rnd.get("weighted_sd").is_empty());
    }

    /// Likelihood grows with the logarithm of size: 1 per decade, and 0.5 more after the better refinement,
    /// for which plain fuzzy k-means needs √10 times as many points.
    #[test]
    fn sizes_are_compared_by_what_they_are_worth() {
        let text = r#"
seed = 1
measures = ["likelihood"]
[[trials]]
map = ["gbs", "gbs+f-km", "gbs+best"]
size = [1, 10]
draws = 2
[[trials]]
map = "gbs+f-km"
size = 100
draws = 2
[[views.factors]]
name = "plain_size_factor"
x = "map_points"
y = "log_likelihood"
than = "gbs+f-km"
"#;
        let results = planted(text, "office", |row| {
            let points = 100.0 * row.number("size_percent").unwrap();
            let better = match row.text("map") {
                "gbs" => -9.0,
                "gbs+best" => 0.5,
                _ => 0.0,
            };
            vec![
                ("map_points", points.into()),
                ("log_likelihood", (points.log10() + better).into()),
            ]
        });
        let table = summary(&Estimates::of(&results).unwrap()).unwrap();
        let factors: Vec<(&str, Option<f64>)> =
            table.rows().map(|row| (row.text("map"), row.number("plain_size_factor"))).collect();
        assert_eq!(factors[0], ("gbs", None));
        for (map, factor) in &factors[2..] {
            let expected = if *map == "gbs+best" { 10f64.sqrt() } else { 1.0 };
            assert!((factor.unwrap() - expected).abs() < 1e-9, "{map}: {factor:?}");
        }
        assert_eq!(factors.len(), 7);
    }
}
