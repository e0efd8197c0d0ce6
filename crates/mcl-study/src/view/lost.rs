//! Lost runs in views: columns derived from others, so that rows of every build have them.
//!
//! A mean error over all runs is dominated by how far the lost ones strayed; a mean of the others alone would
//! hide that some were lost. So both are shown: [`LOST`](crate::study::views::LOST), the share of runs that
//! were lost at any time, and the error of those that were never lost (`tracked_…`).

use anyhow::Result;
use mcl_metrics::{Blocked, BlockedRate};

use crate::study::views::{DIVERGED, EPISODES, TRACKED};
use crate::table::{Row, Value};
use crate::view::groups::Group;

/// Whether a run was lost; `None` where a row does not have it.
fn is_lost(row: &Row<'_>) -> Option<bool> {
    match row.get(DIVERGED) {
        Value::Bool(diverged) => Some(*diverged || row.number(EPISODES)? > 0.0),
        _ => None,
    }
}

/// How many runs of a group were lost; `None` where a row does not have it.
///
/// # Errors
/// When there is no row.
pub fn rate(group: &Group<'_>) -> Result<Option<BlockedRate>> {
    group.rate_of(is_lost)
}

/// Values of a column over the runs that were never lost; `None` for any other column, where a row does not
/// have it, and where all runs were lost.
///
/// # Errors
/// As [`Group::blocked`].
pub fn tracked(group: &Group<'_>, column: &str) -> Result<Option<Blocked>> {
    let Some(of) = column.strip_prefix(TRACKED) else { return Ok(None) };
    if group.rows.iter().any(|row| is_lost(row).is_none()) {
        return Ok(None);
    }
    group.blocked_where(of, |row| is_lost(row) == Some(false))
}

/// Whether a column is over the never-lost runs of a group in which some were lost.
pub fn is_of_some(group: &Group<'_>, column: &str) -> bool {
    column.starts_with(TRACKED) && group.rows.iter().any(|row| is_lost(row) == Some(true))
}

#[cfg(test)]
mod tests {
    use crate::view::charts::charts;
    use crate::view::estimate::Estimates;
    use crate::view::planted::planted;

    /// Fault: a single lost run of twenty dominated the mean, and a curve rose and fell with the size by
    /// chance; runs that were lost and found again were not visible.
    #[test]
    fn lost_runs_are_counted_and_do_not_set_the_error() {
        let text = r#"
seed = 1
[[trials]]
map = ["gbs", "rnd"]
size = [1, 5]
draws = 4
runs = 1
[[views.charts]]
name = "errors"
x = { column = "size_percent", scale = "log" }
y = { column = "weighted" }
parts = [
    { title = "never lost", column = "tracked_weighted", y = "log" },
    { title = "lost runs", column = "lost" },
    { title = "lost time", column = "lost_share" },
]
"#;
        let results = planted(text, "office", |row| {
            let (draw, small) =
                (row.number("draw").unwrap(), row.number("size_percent") == Some(1.0));
            let is_random = row.text("map") == "rnd";
            // Of random maps of 1 % all are lost; of grids one at its end, and one on its way.
            let ends_lost = small && (is_random || draw == 0.0);
            let strays = small && !is_random && draw == 1.0;
            let episodes = usize::from(ends_lost || strays);
            vec![
                ("weighted", if ends_lost { 100.0 } else { 0.02 + 0.001 * draw }.into()),
                ("diverged", ends_lost.into()),
                ("lost_episodes", episodes.into()),
                ("lost_share", (0.5 * episodes as f64).into()),
            ]
        });
        let chart = charts(&Estimates::of(&results).unwrap()).unwrap().remove(0);
        let [error, lost, time] = &chart.panels[..] else { panic!("{:?}", chart.panels) };
        let shown = |panel: &crate::view::chart::Panel| -> Vec<(usize, f64, f64)> {
            panel.points.iter().map(|p| (p.curve, p.x, (1e6 * p.y).round() / 1e6)).collect()
        };
        // Where every run was lost there is no error to show.
        assert_eq!(shown(error), [(0, 1.0, 0.0225), (0, 5.0, 0.0215), (1, 5.0, 0.0215)]);
        assert_eq!(error.labels, ["gbs", "rnd"]);
        assert_eq!(shown(lost), [(0, 1.0, 0.5), (0, 5.0, 0.0), (1, 1.0, 1.0), (1, 5.0, 0.0)]);
        assert_eq!(shown(time)[..2], [(0, 1.0, 0.25), (0, 5.0, 0.0)]);
        // An open symbol without a number: the panel below has it.
        let marks: Vec<Option<&str>> = error.points.iter().map(|p| p.mark.as_deref()).collect();
        assert_eq!(marks, [Some(""), None, None]);
        assert_eq!((error.points[0].rows, error.points[0].blocks), (2, 2));
        assert!(lost.points.iter().all(|point| point.interval.is_some() && point.mark.is_none()));
        let caption = chart.caption.concat();
        assert!(caption.contains("Open symbols: some runs were lost"), "{caption}");
    }

    #[test]
    fn columns_of_lost_runs_need_what_they_are_made_of() {
        let text = |column: &str| {
            format!(
                "seed = 1\nmeasures = [\"likelihood\"]\n[[trials]]\nmap = \"gbs\"\nsize = 1\n\
                 [[views.charts]]\nname = \"a\"\nx = {{ column = \"size_percent\" }}\n\
                 y = {{ column = \"log_likelihood\" }}\nparts = [{{ column = \"{column}\" }}]\n"
            )
        };
        let parsed = |column: &str| crate::study::definition::Study::parse(&text(column));
        assert!(parsed("log_likelihood").is_ok());
        for column in ["lost", "tracked_log_likelihood", "tracked_", "nothing"] {
            let error = parsed(column).err().map(|error| format!("{error:#}")).unwrap_or_default();
            assert!(error.contains("views.charts.0.parts.0.column"), "{column}: {error}");
        }
    }
}
