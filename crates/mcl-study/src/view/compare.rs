//! `tests.csv`: comparisons between values of a setting.

use anyhow::Result;
use mcl_core::math;
use mcl_metrics::{Effect, MetricsError, TooFew, holm, paired, two_sample};

use crate::store::results::Results;
use crate::study::settings::{PRESET, text_of};
use crate::study::views::{TestKind, TestView};
use crate::table::{Table, Value};
use crate::view::groups::{Group, Groups};
use crate::view::layout::distinct;
use crate::view::summary::columns_of;

/// A comparison of two groups of rows.
#[derive(Debug, Clone, PartialEq)]
pub enum Comparison {
    /// The effect; of logarithms where a ratio was requested.
    Tested(Effect),
    /// Why there is no test.
    Untested(String),
}

/// Compares two groups by a measured column, over blocks. This is the only place where rows are tested: the
/// same two groups have the same p value wherever it is shown.
///
/// # Errors
/// When a run occurs twice in a draw, or a value is not usable.
pub fn compare(
    a: &Group<'_>,
    b: &Group<'_>,
    y: &str,
    test: TestKind,
    ratio: bool,
) -> Result<Comparison> {
    let (Some(mut of_a), Some(mut of_b)) = (a.blocked(y)?, b.blocked(y)?) else {
        return Ok(Comparison::Untested(format!("not every row has {y}")));
    };
    if ratio {
        let logarithms = [&of_a, &of_b].map(|values| values.map(math::ln));
        let [Ok(ln_a), Ok(ln_b)] = logarithms else {
            let values = of_a.values().chain(of_b.values());
            let smallest = values.map(|(_, value)| value).fold(f64::INFINITY, f64::min);
            let why = format!("no ratio: {y} is {smallest} in a run, expected above 0");
            return Ok(Comparison::Untested(why));
        };
        (of_a, of_b) = (ln_a, ln_b);
    }
    let found: Result<Effect, TooFew> = match test {
        TestKind::Paired => paired(&of_a, &of_b),
        TestKind::Welch => two_sample(&of_a, &of_b),
    };
    Ok(match found {
        Ok(effect) => Comparison::Tested(effect),
        Err(few) => Comparison::Untested(MetricsError::from(few).to_string()),
    })
}

/// The tests of `[[views.tests]]`: wherever groups of rows differ in nothing else than the compared column.
///
/// Columns: the data set, split, map and size, and every other setting that varies, without the compared one;
/// `y`, `column` and its values `a` and `b`; `test` (`paired` by draw and run, or `welch`), `effect` of a
/// against b (`kind`: their difference, or the ratio of their geometric means) with its 95 % interval, `blocks`
/// (of the side with fewer), `t`, `df`, the two-sided `p`, and `p_holm`, adjusted for all tests of the same
/// entry on this data set; `note` says why there is no p value, and which trials are missing.
///
/// # Errors
/// When a run occurs twice in a draw, or a value cannot be computed with.
pub fn tests(groups: &Groups<'_>) -> Result<Table> {
    let results = groups.results;
    let shown: Vec<&Group<'_>> = groups.of_entries(&[]).collect();
    let mut columns = columns_of(groups, &shown);
    // Columns that every comparison has are in `a` and `b`.
    let views = &results.study.views.tests;
    columns.retain(|&((place, _), _)| {
        views.iter().any(|view| view.column != groups.settings[place].name)
    });
    let names = columns.iter().map(|(_, column)| column.as_str());
    const TESTED: &str =
        "y column a b test kind effect effect_low effect_high blocks t df p p_holm note";
    let mut table = Table::new(names.chain(TESTED.split(' ')));
    for view in views {
        let Some(place) = groups.place(&view.column) else { continue };
        let mut free = vec![place];
        if view.column == PRESET {
            let of_view: Vec<&Group<'_>> = groups.of_entries(&view.of).collect();
            free.extend(groups.decided_by_preset(&of_view));
        }
        let mut found: Vec<(Vec<Value>, Comparison)> = Vec::new();
        for [a, b] in pairs(groups, view, place) {
            for group_a in groups.of_entries(&view.of).filter(|g| g.text(place) == a) {
                let is_match = |group: &&Group<'_>| {
                    group.text(place) == b && groups.differ_only_in(group_a, group, &free)
                };
                for group_b in groups.of_entries(&view.of).filter(is_match) {
                    let mut cells = shared(groups, &columns, &free, [group_a, group_b]);
                    let test = if view.test == TestKind::Paired { "paired" } else { "welch" };
                    let kind = if view.ratio { "ratio" } else { "difference" };
                    let texts = [&view.y, &view.column, &a, &b].map(|text| Value::from(&**text));
                    cells.extend(texts.into_iter().chain([test.into(), kind.into()]));
                    found.push((cells, compare(group_a, group_b, &view.y, view.test, view.ratio)?));
                }
            }
        }
        let p = |compared: &Comparison| match compared {
            Comparison::Tested(effect) => effect.p_two_sided,
            Comparison::Untested(_) => f64::NAN,
        };
        let adjusted = holm(&found.iter().map(|(_, compared)| p(compared)).collect::<Vec<_>>());
        for ((mut cells, compared), p_holm) in found.into_iter().zip(adjusted) {
            cells.extend(effect_cells(&compared, view.ratio, p_holm));
            cells.push(note(results, &compared).into());
            table.push(cells);
        }
    }
    Ok(table)
}

/// The pairs of values that a view compares.
fn pairs(groups: &Groups<'_>, view: &TestView, place: usize) -> Vec<[String; 2]> {
    if !view.pairs.is_empty() {
        return view.pairs.clone();
    }
    let shown: Vec<&Group<'_>> = groups.of_entries(&view.of).collect();
    let values: Vec<String> = distinct(groups, &shown, place).iter().map(|v| text_of(v)).collect();
    let later = |at: usize| values[at + 1..].iter().map(move |b| (at, b));
    let pairs = (0..values.len()).flat_map(later);
    pairs.map(|(a, b)| [values[a].clone(), b.clone()]).collect()
}

/// The common values of two groups, empty in the columns of the settings in which they may differ.
fn shared(
    groups: &Groups<'_>,
    columns: &[((usize, usize), String)],
    free: &[usize],
    [a, b]: [&Group<'_>; 2],
) -> Vec<Value> {
    let value = |&((place, part), _): &((usize, usize), String)| {
        if free.contains(&place) {
            return Value::Empty;
        }
        let of = if groups.matters(a, place) { a } else { b };
        of.values(place)[part].clone()
    };
    columns.iter().map(value).collect()
}

fn effect_cells(compared: &Comparison, ratio: bool, p_holm: f64) -> Vec<Value> {
    let Comparison::Tested(effect) = compared else { return vec![Value::Empty; 8] };
    let back = |value: f64| if ratio { math::exp(value) } else { value };
    let [low, high] = [effect.interval.low, effect.interval.high];
    let mut cells: Vec<Value> =
        [effect.mean_difference, low, high].map(|value| back(value).into()).to_vec();
    cells.push(effect.blocks[0].min(effect.blocks[1]).into());
    let rest = [effect.t, effect.degrees_of_freedom, effect.p_two_sided, p_holm];
    cells.extend(rest.map(Value::from));
    cells
}

fn note(results: &Results, compared: &Comparison) -> String {
    let mut notes = Vec::new();
    match compared {
        Comparison::Untested(why) => notes.push(why.clone()),
        Comparison::Tested(effect) if effect.t.is_infinite() => {
            notes.push("all blocks differ by the same".to_owned());
        }
        Comparison::Tested(_) => {}
    }
    notes.extend(results.missing());
    notes.join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::planted::planted;

    fn study(views: &str) -> String {
        format!(
            r#"
seed = 1
[[trials]]
map = ["gbs", "gbs+f-km", "rnd"]
size = 1
draws = 10
runs = 2
[[trials]]
name = "small"
map = ["gbs", "gbs+f-km"]
size = 0.5
draws = 10
runs = 2
[[trials]]
name = "part"
map = ["gbs", "gbs+f-km"]
size = 1
draws = 3
runs = 2
[[trials]]
map = "all"
draws = 10
runs = 2
{views}"#
        )
    }

    /// A random effect common to everything on one map.
    fn luck(draw: f64) -> f64 {
        0.01 * ((7.0 * draw) % 10.0 - 4.5)
    }

    fn results(views: &str) -> Results {
        planted(&study(views), "office", |row| {
            let (draw, run) = (row.number("draw").unwrap(), row.number("run").unwrap());
            // Twenty runs on ten maps: runs on the same map differ by a hundredth of the difference between
            // maps.
            let of_run = if run < 10.0 { 1e-4 } else { -1e-4 };
            let error = match row.text("map") {
                "gbs" => 0.2,
                "gbs+f-km" => 0.19 + luck(draw) + of_run,
                "rnd" => 0.3 + of_run,
                _ => 0.1 + 1e-3 * of_run,
            };
            vec![("weighted", error.into()), ("diverged", false.into())]
        })
    }

    const PAIRED: &str = "[[views.tests]]\ny = \"weighted\"\n\
                          pairs = [[\"gbs+f-km\", \"gbs\"], [\"gbs\", \"rnd\"], [\"gbs\", \"all\"]]\n";

    /// Fault: runs were treated as independent, with p = 9·10⁻¹⁰ by run and 2·10⁻⁵ by map.
    #[test]
    fn the_unit_of_tests_is_the_map() {
        let table = tests(&Groups::of(&results(PAIRED)).unwrap()).unwrap();
        let row = table.rows().find(|row| row.text("a") == "gbs+f-km").unwrap();
        assert_eq!(row.get("blocks"), &Value::Count(10));
        assert_eq!(row.number("df"), Some(9.0));
        // By hand: per map −0.01 + luck, of standard deviation 0.01 √(82.5 / 9).
        let t = -0.01 / (0.01 * (82.5f64 / 9.0).sqrt() / 10f64.sqrt());
        assert!((row.number("effect").unwrap() + 0.01).abs() < 1e-12);
        assert!((row.number("t").unwrap() - t).abs() < 1e-9);
        let by_map = row.number("p").unwrap();
        let differences: Vec<f64> = (0..20)
            .map(|run| -0.01 + luck(f64::from(run % 10)) + if run < 10 { 1e-4 } else { -1e-4 })
            .collect();
        let by_run = mcl_metrics::paired_t_test(&differences, &[0.0; 20]).unwrap().p_two_sided;
        assert!(by_run < 0.5 * by_map, "{by_run} {by_map}");
        let groups = results(PAIRED);
        let groups = Groups::of(&groups).unwrap();
        let group = groups.all.iter().find(|g| g.to_string() == "same gbs+f-km 1").unwrap();
        let correlation = group.blocked("weighted").unwrap().unwrap().intraclass_correlation();
        assert!(correlation > Some(0.99), "{correlation:?}");
    }

    /// Fault: one hypothesis had two p values in a folder, as entries, figures and claims each counted
    /// separately. `part` asks for three of the ten maps that another entry asks for.
    #[test]
    fn a_hypothesis_has_one_p_value() {
        let part = PAIRED.replace("[[views.tests]]", "[[views.tests]]\nof = \"part\"");
        let results = results(&format!("{PAIRED}{part}"));
        let table = tests(&Groups::of(&results).unwrap()).unwrap();
        let same: Vec<_> = table
            .rows()
            .filter(|row| row.text("a") == "gbs+f-km" && row.number("size_percent") == Some(1.0))
            .map(|row| (row.number("p"), row.get("blocks").clone()))
            .collect();
        assert_eq!(same.len(), 2);
        assert_eq!(same[0], same[1]);
        assert_eq!(same[0].1, Value::Count(10));
        // Claims use the same one.
        let groups = Groups::of(&results).unwrap();
        let group = |name: &str| groups.all.iter().find(|g| g.to_string() == name).unwrap();
        let (a, b) = (group("same gbs+f-km 1"), group("same gbs 1"));
        let compared = compare(a, b, "weighted", TestKind::Paired, false).unwrap();
        let Comparison::Tested(effect) = compared else { panic!("{compared:?}") };
        assert_eq!(Some(effect.p_two_sided.to_bits()), same[0].0.map(f64::to_bits));
    }

    #[test]
    fn rows_that_differ_in_nothing_else_are_compared() {
        let table = tests(&Groups::of(&results(PAIRED)).unwrap()).unwrap();
        let found: Vec<(String, String, Option<f64>)> = table
            .rows()
            .map(|row| {
                (row.text("a").to_owned(), row.text("b").to_owned(), row.number("size_percent"))
            })
            .collect();
        // Random maps have no grid, and all points no size: the offset and size of the other are given there.
        let expected = [
            ("gbs+f-km", "gbs", 0.5),
            ("gbs+f-km", "gbs", 1.0),
            ("gbs", "rnd", 1.0),
            ("gbs", "all", 0.5),
            ("gbs", "all", 1.0),
        ];
        let expected = expected.map(|(a, b, size)| (a.to_owned(), b.to_owned(), Some(size)));
        assert_eq!(found, expected);
        // Holm over the five; the smallest first.
        let p: Vec<f64> = table.rows().filter_map(|row| row.number("p")).collect();
        let adjusted: Vec<f64> = table.rows().filter_map(|row| row.number("p_holm")).collect();
        assert_eq!(adjusted, holm(&p));
        assert_eq!(p.len(), 5);
        // All pairs, where none are named.
        let all =
            tests(&Groups::of(&results("[[views.tests]]\ny = \"weighted\"\n")).unwrap()).unwrap();
        assert_eq!(all.len(), 2 + 1 + 1 + 1 + 2 + 2);
    }

    #[test]
    fn effects_are_ratios_where_that_is_asked_for() {
        let text = "[[views.tests]]\ny = \"weighted\"\nratio = true\npairs = [[\"all\", \"rnd\"]]\n\
                    [[views.tests]]\ny = \"weighted\"\ntest = \"welch\"\npairs = [[\"all\", \"rnd\"]]\n\
                    [[views.tests]]\ny = \"translation\"\npairs = [[\"all\", \"rnd\"]]\n";
        let table = tests(&Groups::of(&results(text)).unwrap()).unwrap();
        let rows: Vec<_> = table.rows().collect();
        let ratio = rows[0].number("effect").unwrap();
        assert!((ratio - 1.0 / 3.0).abs() < 1e-6, "{ratio}");
        assert_eq!((rows[0].text("kind"), rows[1].text("kind")), ("ratio", "difference"));
        let [low, high] = ["effect_low", "effect_high"].map(|end| rows[0].number(end).unwrap());
        assert!(low <= ratio && ratio <= high && low > 0.3 && high < 0.4);
        assert_eq!(rows[1].text("test"), "welch");
        assert!((rows[1].number("effect").unwrap() + 0.2).abs() < 1e-12);
        assert_eq!(rows[2].text("note"), "not every row has translation");
        assert!(rows[2].get("p").is_empty() && rows[2].get("p_holm").is_empty());
    }

    #[test]
    fn what_cannot_be_tested_says_why() {
        let results = results(&PAIRED.replace("pairs", "ratio = true\npairs"));
        let zero = {
            let mut results = results.clone();
            results.table = crate::table::Table::of_cells(results.table.rows().map(|row| {
                let cell = |column: &String| {
                    let is_zero = column == "weighted" && row.text("map") == "rnd";
                    let value = if is_zero { 0.0.into() } else { row.get(column).clone() };
                    (column.clone(), value)
                };
                results.table.columns().iter().map(cell).collect()
            }));
            results
        };
        let table = tests(&Groups::of(&zero).unwrap()).unwrap();
        let row = table.rows().find(|row| row.text("b") == "rnd").unwrap();
        assert_eq!(row.text("note"), "no ratio: weighted is 0 in a run, expected above 0");
        let missing =
            results.without(9, |row| row.text("map") == "gbs" && row.number("draw") != Some(3.0));
        let table = tests(&Groups::of(&missing).unwrap()).unwrap();
        let row = table.rows().next().unwrap();
        assert_eq!(
            row.text("note"),
            "too few to tell: 1 independent block, at least 2 needed; 51 of 60 trials"
        );
        assert!(row.get("p").is_empty());
    }
}
