//! `ranking.csv`: settings over several data sets.

use anyhow::{Result, bail};
use mcl_core::math;

use crate::store::results::Results;
use crate::study::plan::ENTRIES;
use crate::table::{Table, Value};
use crate::view::groups::{Group, Groups, order};
use crate::view::summary::columns_of;

/// The settings of runs ranked by a measured column over data sets, the best first.
///
/// A setting's score is the geometric mean over data sets of its geometric mean over maps (every combination
/// of split, kind and size) of the mean over blocks, so every log has the same weight, whatever the scale of
/// its errors. Data sets of `except` have rows but do not count. Settings that lack a map on a data set are
/// left out.
///
/// Columns: `trials`, the entry that was ranked, where entries are ranked separately; `rank`, `score`; every
/// setting of runs that varies; and per data set `dataset`, `has_say` (whether it counts), the column itself
/// (its geometric mean over maps), `rows`, `diverged` of them where that was measured, and `note`.
///
/// # Errors
/// When the results are not all of one study, or a value is not usable or not above 0.
pub fn ranking(all: &[Results]) -> Result<Table> {
    let Some((first, view)) = all.first().and_then(|r| Some((r, r.study.views.ranking.as_ref()?)))
    else {
        return Ok(Table::default());
    };
    if let Some(other) = all.iter().find(|other| other.name != first.name) {
        bail!("a ranking is of one study, found {:?} and {:?}", first.name, other.name);
    }
    let has_y = |results: &&Results| results.table.column(&view.y).is_some();
    let grouped = all.iter().filter(has_y).map(Groups::of).collect::<Result<Vec<_>>>()?;
    let each = view.of.chunks(1);
    let entries = if view.of.is_empty() { vec![&view.of[..]] } else { each.collect() };
    let mut ranked = Vec::new();
    for entry in entries {
        ranked.extend(rank(&grouped, entry, &view.y, &view.except)?);
    }
    let shown: Vec<&Group<'_>> = ranked.iter().map(|ranked: &Ranked| ranked.setting).collect();
    let mut columns = grouped.first().map_or(Vec::new(), |groups| columns_of(groups, &shown));
    columns.retain(|((place, _), _)| !grouped[0].settings[*place].of_map);
    let has_diverged = all.iter().any(|results| results.table.column("diverged").is_some());
    let mut names = vec!["rank".to_owned(), "score".to_owned()];
    if !view.of.is_empty() {
        names.insert(0, ENTRIES.to_owned());
    }
    names.extend(columns.iter().map(|(_, column)| column.clone()));
    names.extend(["dataset", "has_say", &view.y, "rows"].map(str::to_owned));
    names.extend(has_diverged.then(|| "diverged".to_owned()));
    names.push("note".to_owned());
    let mut table = Table::new(names);
    for setting in &ranked {
        for of_data in &setting.datasets {
            let mut row: Vec<Value> = vec![setting.rank.into(), setting.score.into()];
            if !view.of.is_empty() {
                row.insert(0, setting.entry.clone().into());
            }
            let values = columns.iter().map(|((at, part), _)| &setting.setting.values(*at)[*part]);
            row.extend(values.cloned());
            let name = of_data.results.facts.name.as_str();
            row.extend([name.into(), of_data.has_say.into(), of_data.error.into()]);
            row.push(of_data.rows.into());
            if has_diverged {
                row.push(of_data.diverged.into());
            }
            row.push(of_data.results.missing().into());
            table.push(row);
        }
    }
    Ok(table)
}

struct Ranked<'g, 'r> {
    entry: Option<String>,
    rank: usize,
    score: f64,
    /// A group with the run's settings.
    setting: &'g Group<'r>,
    datasets: Vec<OfData<'r>>,
}

struct OfData<'r> {
    results: &'r Results,
    has_say: bool,
    error: f64,
    rows: usize,
    diverged: usize,
}

fn rank<'g, 'r>(
    grouped: &'g [Groups<'r>],
    entry: &[String],
    y: &str,
    except: &[String],
) -> Result<Vec<Ranked<'g, 'r>>> {
    // The data sets on which the entry has rows.
    let parts: Vec<(&'g Groups<'r>, Vec<&'g Group<'r>>)> = grouped
        .iter()
        .map(|groups| (groups, groups.of_entries(entry).collect::<Vec<_>>()))
        .filter(|(_, of_entry)| !of_entry.is_empty())
        .collect();
    let mut settings: Vec<(Vec<Vec<Value>>, &'g Group<'r>)> = Vec::new();
    for (groups, of_entry) in &parts {
        settings.extend(of_entry.iter().map(|group| (of_run(groups, group), *group)));
    }
    settings.sort_by(|a, b| order(&a.0, &b.0));
    settings.dedup_by(|a, b| order(&a.0, &b.0).is_eq());
    let mut ranked = Vec::new();
    'settings: for (setting, with_it) in settings {
        let mut datasets = Vec::new();
        for (groups, of_entry) in &parts {
            let name = &groups.results.facts.name;
            let is_same = |g: &&&Group<'r>| order(&of_run(groups, g), &setting).is_eq();
            let own: Vec<&Group<'r>> = of_entry.iter().filter(is_same).copied().collect();
            let has_say = !except.contains(name);
            let mut logarithms = Vec::new();
            for group in &own {
                let Some(values) = group.blocked(y)? else { continue };
                let mean = values.mean_of_blocks();
                if mean <= 0.0 {
                    bail!("{name}: {y} of {group} is {mean}, expected above 0 to be ranked");
                }
                logarithms.push(math::ln(mean));
            }
            if logarithms.len() < groups.combinations(of_entry, &places(groups, true)).len() {
                if has_say {
                    continue 'settings;
                }
                continue;
            }
            let rows = || own.iter().flat_map(|group| &group.rows);
            datasets.push(OfData {
                results: groups.results,
                has_say,
                error: math::exp(logarithms.iter().sum::<f64>() / own.len() as f64),
                rows: rows().count(),
                diverged: rows().filter(|row| *row.get("diverged") == Value::Bool(true)).count(),
            });
        }
        let say: Vec<f64> =
            datasets.iter().filter(|d| d.has_say).map(|d| math::ln(d.error)).collect();
        if say.is_empty() {
            continue;
        }
        ranked.push(Ranked {
            entry: entry.first().cloned(),
            rank: 0,
            score: math::exp(say.iter().sum::<f64>() / say.len() as f64),
            setting: with_it,
            datasets,
        });
    }
    ranked.sort_by(|a, b| a.score.total_cmp(&b.score));
    ranked.iter_mut().zip(1..).for_each(|(setting, rank)| setting.rank = rank);
    Ok(ranked)
}

/// Places of the settings of the map, or of the run.
fn places(groups: &Groups<'_>, of_map: bool) -> Vec<usize> {
    let settings = groups.settings.iter().enumerate();
    settings.filter(|(_, setting)| setting.of_map == of_map).map(|(place, _)| place).collect()
}

/// Settings of the run.
fn of_run(groups: &Groups<'_>, group: &Group<'_>) -> Vec<Vec<Value>> {
    places(groups, false).into_iter().map(|place| group.values(place).to_vec()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::planted::planted;

    const STUDY: &str = r#"
seed = 1
[[trials]]
name = "tracking"
map = "gbs+f-km"
size = [1, 5]
sigma_hit = [0.1, 0.2]
draws = 2
runs = 1
[[trials]]
name = "other"
map = "rnd"
size = 1
proposal = ["motion", "adaptive"]
draws = 2
runs = 1
[[dataset]]
name = "aces"
[[dataset]]
name = "intel-lab"
[[dataset]]
name = "office"
[views.ranking]
of = ["tracking"]
y = "weighted"
except = ["intel-lab"]
"#;

    /// Errors by size and σ_hit, with two draws on either side.
    fn results(dataset: &str, errors: [[f64; 2]; 2]) -> Results {
        planted(STUDY, dataset, |row| {
            let size = usize::from(row.number("size_percent") == Some(5.0));
            let setting = usize::from(row.number("sigma_hit") == Some(0.2));
            let mean = errors[size][setting];
            let error = mean * if row.number("draw") == Some(0.0) { 0.5 } else { 1.5 };
            vec![("weighted", error.into()), ("diverged", (error > 1.0).into())]
        })
    }

    #[test]
    fn settings_are_ranked_by_geometric_means() {
        let all = [
            // σ_hit 0.1: √(0.02 · 0.08) = 0.04; 0.2: √(0.04 · 0.36) = 0.12.
            results("aces", [[0.02, 0.04], [0.08, 0.36]]),
            // The other way round, on a data set that does not count.
            results("intel-lab", [[9.0, 0.001], [9.0, 0.001]]),
            // 0.04; √(0.01 · 2) = 0.1414.
            results("office", [[0.04, 0.01], [0.04, 2.0]]),
        ];
        let table = ranking(&all).unwrap();
        let names =
            ["trials", "rank", "score", "sigma_hit", "dataset", "has_say", "weighted", "rows"];
        assert_eq!(table.columns()[..8], names);
        let rows: Vec<_> = table.rows().collect();
        assert_eq!(rows.len(), 6);
        let best: Vec<_> = rows[..3].iter().map(|row| row.number("sigma_hit")).collect();
        assert_eq!(best, [Some(0.1); 3]);
        assert!((rows[0].number("score").unwrap() - 0.04).abs() < 1e-12);
        assert!((rows[3].number("score").unwrap() - (0.12 * 0.02f64.sqrt()).sqrt()).abs() < 1e-12);
        assert_eq!((rows[1].text("dataset"), rows[1].get("has_say")), ("intel-lab", &false.into()));
        assert!((rows[1].number("weighted").unwrap() - 9.0).abs() < 1e-12);
        assert!((rows[5].number("weighted").unwrap() - 0.02f64.sqrt()).abs() < 1e-12);
        assert_eq!(
            [rows[5].get("rows"), rows[5].get("diverged")].map(|v| v.number()),
            [Some(4.0), Some(1.0)]
        );
        assert!(rows.iter().all(|row| row.get("note").is_empty()));
    }

    #[test]
    fn settings_that_lack_a_map_have_no_rank() {
        let half = results("office", [[0.1; 2]; 2]).without(2, |row| {
            row.number("sigma_hit") == Some(0.1) && row.number("size_percent") == Some(5.0)
        });
        let table = ranking(&[results("aces", [[0.1; 2]; 2]), half]).unwrap();
        let found: Vec<_> =
            table.rows().map(|row| (row.text("dataset"), row.text("note"))).collect();
        assert_eq!(found, [("aces", ""), ("office", "4 of 6 trials")]);
        // Data sets that do not count have no influence on that.
        let half = results("intel-lab", [[0.1; 2]; 2]).without(2, |row| {
            row.number("sigma_hit") == Some(0.1) && row.number("size_percent") == Some(5.0)
        });
        let table = ranking(&[results("aces", [[0.1; 2]; 2]), half]).unwrap();
        assert_eq!(table.len(), 3);
    }
}
