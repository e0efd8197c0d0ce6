//! Evaluations as text: tables of all estimates, of groups and their differences, and each estimate with its figures.

use mcl_core::text::{counted, p_value, printable, thousands};

use super::group::{Comparison, GroupError, GroupFigures};
use super::row::{AxisFigures, Row, RowFigures};
use super::table::Table;
use crate::pose_errors::{Figures, figures_table, table_line};

/// Up to this many estimates are shown with all their figures.
const MOST_IN_FULL: usize = 6;
/// Up to this many runs of groups have a line each.
const MOST_RUNS: usize = 12;

/// The printed text: `tables`, then details of each estimate where they are few.
pub fn text(rows: &[&Row], tables: &[Table]) -> String {
    let mut parts = Vec::new();
    if rows.len() > 1 {
        parts.extend(tables.iter().map(Table::text));
    }
    if rows.len() <= MOST_IN_FULL && rows.iter().all(|row| row.group.is_none()) {
        parts.extend(rows.iter().map(|row| row_text(row)));
    }
    parts.join("\n")
}

/// A line per estimate with the RMSE, except for the weighted error, whose mean is used in the paper. Of many
/// runs of groups only those with something to report.
pub fn of_estimates(rows: &[&Row]) -> Table {
    let is_plain = |row: &&&Row| {
        let figures = row.figures.as_ref();
        row.group.is_some() && figures.is_some_and(|figures| figures.with_missing.lost_share < 0.01)
    };
    let plain = rows.iter().filter(is_plain).count();
    let (rows, omitted): (Vec<&Row>, usize) = match rows.len() > MOST_RUNS && plain > 0 {
        true => (rows.iter().filter(|row| !is_plain(row)).copied().collect(), plain),
        false => (rows.to_vec(), 0),
    };
    let first = rows.iter().find_map(|row| row.figures.as_ref());
    let relative: Vec<(f64, &str)> = first
        .map(|figures| figures.rpe.iter().map(|rpe| (rpe.delta, rpe.unit)).collect())
        .unwrap_or_default();
    let mut head: Vec<String> =
        ["estimate", "pairs", "covered", "weighted", "ATE, m", "heading, °"]
            .map(str::to_owned)
            .into();
    head.extend(relative.iter().map(|(delta, unit)| format!("RPE {delta} {unit}")));
    head.push("lost".to_owned());
    let columns = head.len();
    let line = |row: &&Row| {
        let Some(figures) = &row.figures else {
            let mut line = vec![printable(&row.of.label()).into_owned(), "failed".to_owned()];
            line.resize(columns, "–".to_owned());
            return line;
        };
        let mut line = vec![
            printable(&row.of.label()).into_owned(),
            thousands(figures.pairs),
            percent(figures.coverage.time.min(figures.coverage.path)),
            decimals(figures.weighted.map(|error| error.mean)),
            decimals(Some(figures.ate.rmse)),
            decimals(figures.heading.map(|error| error.rmse.to_degrees())),
        ];
        let rmse = |error: Option<Figures>| decimals(error.map(|error| error.rmse));
        line.extend(figures.rpe.iter().map(|relative| rmse(relative.translation)));
        line.resize(columns - 1, "–".to_owned());
        line.push(percent(figures.with_missing.lost_share));
        line
    };
    Table {
        title: String::new(),
        head,
        rows: rows.iter().map(line).collect(),
        remark: format!(
            "mean weighted error; rmse of the others, RPE in m; lost: share of the reference's time in which the robot \
             was lost or the estimate is missing{}",
            match omitted {
                0 => String::new(),
                omitted => format!(
                    "; {} of groups that covered all and never got lost are not listed, --table FILE.csv has them",
                    counted(omitted, "run")
                ),
            }
        ),
    }
}

/// A line per group.
pub fn of_groups(groups: &[GroupFigures]) -> Table {
    let head = [
        "group",
        "runs",
        "failed",
        "covered",
        "lost",
        "weighted",
        "translation, m",
        "heading, °",
        "inside 95 %",
    ];
    let line = |group: &GroupFigures| {
        vec![
            printable(&group.name).into_owned(),
            group.runs.to_string(),
            group.failed.to_string(),
            percent(group.coverage_time.min(group.coverage_path)),
            percent(group.lost_share),
            with_interval(group.weighted, 1.0),
            with_interval(group.translation, 1.0),
            with_interval(group.heading, 1.0_f64.to_degrees()),
            group.inside_95.map_or("–".to_owned(), percent),
        ]
    };
    Table {
        title: String::new(),
        head: head.map(str::to_owned).into(),
        rows: groups.iter().map(line).collect(),
        remark: "means of the runs that have figures, failed ones too, with 95 % intervals over runs; lost: share of the \
                 time in which the robot was lost or the estimate is missing"
            .to_owned(),
    }
}

/// A line per test of one group against another.
pub fn of_comparisons(comparisons: &[Comparison]) -> Table {
    let head =
        ["", "measure", "first", "second", "difference", "95 % interval", "p (Holm)", "test"];
    let line = |tested: &Comparison| {
        let unit = match tested.measure {
            "heading" => 1.0_f64.to_degrees(),
            "failed" => 100.0,
            _ => 1.0,
        };
        let (measure, digits) = match tested.measure {
            "translation" => ("translation, m", 4),
            "heading" => ("heading, °", 4),
            "failed" => ("failed, %", 1),
            measure => (measure, 4),
        };
        let shown = |value: f64| format!("{:.digits$}", value * unit);
        let interval =
            tested.ci95.map(|ends| format!("{} … {}", shown(ends.low), shown(ends.high)));
        let [a, b] = tested.runs;
        let runs = if a == b { format!("{a}") } else { format!("{a}, {b}") };
        vec![
            format!("{} – {}", printable(&tested.a), printable(&tested.b)),
            measure.to_owned(),
            shown(tested.of_a),
            shown(tested.of_b),
            format!("{:+.digits$}", tested.difference * unit),
            interval.unwrap_or_else(|| "–".to_owned()),
            tested
                .p_holm
                .map_or("–".to_owned(), |p| p_value(p).trim_start_matches("p = ").to_owned()),
            match tested.remark {
                Some(remark) => remark.to_owned(),
                None => format!("{}, {runs}", tested.test),
            },
        ]
    };
    Table {
        title: String::new(),
        head: head.map(str::to_owned).into(),
        rows: comparisons.iter().map(line).collect(),
        remark: "means of runs, first minus second; p adjusted for all tests shown".to_owned(),
    }
}

fn decimals(value: Option<f64>) -> String {
    value.map_or("–".to_owned(), |value| format!("{value:.4}"))
}

fn percent(share: f64) -> String {
    // 99.96 % must not be shown as 100 %.
    let percent = 100.0 * share;
    let rounded = if share < 1.0 { percent.min(99.9) } else { percent };
    format!("{rounded:.1} %")
}

fn with_interval(error: Option<GroupError>, unit: f64) -> String {
    let Some(GroupError { mean, ci95, .. }) = error else { return "–".to_owned() };
    let mean = format!("{:.4}", mean * unit);
    match ci95 {
        Some(ends) => format!("{mean} ({:.4} … {:.4})", ends.low * unit, ends.high * unit),
        None => mean,
    }
}

fn row_text(row: &Row) -> String {
    match &row.figures {
        Some(figures) => figures_text(&printable(&row.of.label()), figures),
        None => format!("{}\n", printable(row.failure.as_deref().unwrap_or_default())),
    }
}

fn figures_text(label: &str, figures: &RowFigures) -> String {
    let mut text = format!(
        "{label}: {}, {} unmatched; {} of the time and {} of the path covered\n",
        counted(figures.pairs, "pair"),
        counted(figures.unmatched, "pose"),
        percent(figures.coverage.time),
        percent(figures.coverage.path)
    );
    if let Some(motion) = figures.reference_from_estimate {
        text += &format!(
            "  aligned: moved by ({:.4}, {:.4}) m, turned by {:.3}°\n",
            motion.x,
            motion.y,
            motion.theta.to_degrees()
        );
    }
    text += &figures_table(figures.weighted, figures.translation, figures.heading);
    for relative in &figures.rpe {
        let (delta, unit) = (relative.delta, relative.unit);
        match (&relative.translation, &relative.heading) {
            (Some(translation), Some(heading)) => {
                let line = table_line(&format!("over {delta} {unit}, m"), translation);
                text += &format!("{}  {}\n", line.trim_end(), counted(relative.pairs, "pair"));
                text += &table_line(&format!("over {delta} {unit}, rad"), heading);
            }
            _ => text += &format!("  over {delta} {unit}: no two poses are so far apart\n"),
        }
    }
    text += &format!("  {:<18}{:>10}{:>10}{:>10}{:>10}\n", "signed", "bias", "std", "rmse", "max");
    let axes = &figures.axes;
    for (name, axis) in [
        ("x, m", Some(&axes.x)),
        ("y, m", Some(&axes.y)),
        ("yaw, rad", axes.yaw.as_ref()),
        ("longitudinal, m", axes.longitudinal.as_ref()),
        ("lateral, m", axes.lateral.as_ref()),
    ] {
        let Some(AxisFigures { mean, std, rmse, max }) = axis else { continue };
        text += &format!("  {name:<18}{mean:>10.4}{std:>10.4}{rmse:>10.4}{max:>10.4}\n");
    }
    if figures.weighted.is_none() {
        text += "  positions only: no errors of headings, and none relative\n";
    }
    if figures.lost > 0 || figures.diverged {
        text += &format!(
            "  lost {}, found again {}{}; lost or missing {} of the time\n",
            counted(figures.lost, "time"),
            counted(figures.recovered, "time"),
            if figures.diverged { ", ended lost" } else { "" },
            percent(figures.with_missing.lost_share)
        );
    }
    if let Some(found) = &figures.consistency {
        text += &format!(
            "  the reference lies within the 95 % ellipsoid of {:.0} % of {} with a covariance (median NEES {:.1}; 2.4 expected)\n",
            100.0 * found.inside_95,
            counted(found.poses, "pose"),
            found.median_nees
        );
    }
    text
}
