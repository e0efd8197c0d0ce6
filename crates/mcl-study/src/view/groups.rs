//! Rows of the same settings: those that differ in draw and run only.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::fmt;

use anyhow::{Context, Result};
use mcl_filter::MotionKind;
use mcl_metrics::{Blocked, BlockedRate};

use crate::recipe::localizer::{LOCALIZER, OWN};
use crate::recipe::run::RunRecipe;
use crate::recipe::split::Split;
use crate::store::results::Results;
use crate::study::plan::ENTRIES;
use crate::study::settings::{PRESET, SIZE, Setting, settings, text_of};
use crate::table::{Row, Table, Value};

/// The groups of a study's rows on a data set.
pub struct Groups<'r> {
    /// The results.
    pub results: &'r Results,
    /// Settings in which groups can differ.
    pub settings: Vec<Setting>,
    /// The groups, sorted by their settings. Where rows are missing, a group may have none.
    pub all: Vec<Group<'r>>,
    /// Names in the order of the study's file.
    names: Vec<&'r str>,
    /// Whether a setting, by its index, belongs to the built-in filter and to no program.
    of_filter: Vec<bool>,
}

/// Rows of the same settings.
#[derive(Debug, Clone)]
pub struct Group<'r> {
    /// Its index among the groups.
    pub place: usize,
    /// The rows.
    pub rows: Vec<Row<'r>>,
    /// How many rows the study asks for.
    pub asked: usize,
    /// Names of the entries of `[[trials]]` that ask for one of them.
    pub entries: BTreeSet<String>,
    /// Block and unit of each row: maps with the same draw number are one independent unit, and runs of the same
    /// number have the same noise on every map.
    units: Vec<(u64, u64)>,
    /// Values of the settings, in their order.
    values: Vec<Vec<Value>>,
    /// Its description, for messages.
    name: String,
}

/// A row, or a missing one.
struct Member<'m, 'r> {
    /// Its recipe.
    recipe: Row<'m>,
    row: Option<Row<'r>>,
    /// The values of the settings in which there is a difference between any two members.
    values: Vec<&'m Value>,
}

impl<'m> Member<'m, '_> {
    /// The value in a column, given by its indices in the table of rows and in that of recipes.
    fn value(&self, &(of_rows, of_asked): &(Option<usize>, Option<usize>)) -> &'m Value {
        self.recipe.at(if self.row.is_some() { of_rows } else { of_asked })
    }
}

impl<'r> Groups<'r> {
    /// Groups the rows.
    ///
    /// # Errors
    /// When recipes cannot be written as JSON.
    pub fn of(results: &'r Results) -> Result<Self> {
        let table = &results.table;
        let settings = settings(table.columns(), &results.study.measures.columns(), &[ENTRIES]);
        let asked = match results.is_complete() {
            true => Table::default(),
            false => results.plan.recipes()?,
        };
        let of_setting = settings.iter().flat_map(|setting| &setting.columns);
        let columns: Vec<_> = of_setting.map(|c| (table.column(c), asked.column(c))).collect();
        let mut members: Vec<Member<'_, 'r>> = Vec::with_capacity(table.len() + asked.len());
        let member = |recipe, row| Member { recipe, row, values: Vec::new() };
        members.extend(table.rows().map(|row| member(row, Some(row))));
        members.extend(asked.rows().map(|row| member(row, None)));
        let differs = |column: &&(_, _)| {
            let first = members.first().map(|member| member.value(column));
            members
                .iter()
                .any(|member| first.is_some_and(|f| f.order(member.value(column)).is_ne()))
        };
        let differing: Vec<_> = columns.iter().filter(differs).collect();
        for member in &mut members {
            member.values = differing.iter().map(|column| member.value(column)).collect();
        }
        let names = results.study.names_of_factors();
        // Stable, so that rows keep their order.
        members
            .sort_by(|a, b| order_by(&names, a.values.iter().copied(), b.values.iter().copied()));
        let same = |a: &Member<'_, '_>, b: &Member<'_, '_>| {
            a.values.iter().zip(&b.values).all(|(a, b)| a.order(b).is_eq())
        };
        let all = members.chunk_by(same).enumerate();
        let all = all.map(|(place, members)| Group::of(place, members, &settings)).collect();
        let own = RunRecipe::setting_names()?;
        let is_own = |setting: &Setting| {
            let is_of = |own: &String| {
                setting
                    .name
                    .strip_prefix(own.as_str())
                    .is_some_and(|rest| rest.is_empty() || rest.starts_with('_'))
            };
            setting.name == PRESET || own.iter().any(is_of)
        };
        let of_filter = settings.iter().map(is_own).collect();
        Ok(Groups { results, settings, all, names, of_filter })
    }

    /// The order of settings: by the first in which they differ, names in the order of the study's file.
    fn order(&self, a: &[Vec<Value>], b: &[Vec<Value>]) -> Ordering {
        order_by(&self.names, a.iter().flatten(), b.iter().flatten())
    }

    /// The values that some groups have of some settings, each combination once and in order.
    pub fn combinations(&self, of: &[&Group<'_>], places: &[usize]) -> Vec<Vec<Vec<Value>>> {
        let values =
            |group: &&Group<'_>| places.iter().map(|&at| group.values(at).to_vec()).collect();
        let mut all: Vec<Vec<Vec<Value>>> = of.iter().map(values).collect();
        all.sort_by(|a, b| self.order(a, b));
        all.dedup_by(|a, b| order(a, b).is_eq());
        all
    }

    /// Index of a setting among the settings.
    pub fn place(&self, setting: &str) -> Option<usize> {
        self.settings.iter().position(|known| known.name == setting)
    }

    /// The groups that have rows and are requested by one of these entries of `[[trials]]`; without names,
    /// all that have rows. All rows of a group count, whichever entry asks for them, so that it has the same
    /// mean everywhere.
    pub fn of_entries(&self, names: &[String]) -> impl Iterator<Item = &Group<'r>> {
        let is_asked = move |group: &&Group<'r>| {
            names.is_empty() || names.iter().any(|name| group.entries.contains(name))
        };
        self.all.iter().filter(|group| !group.rows.is_empty()).filter(is_asked)
    }

    /// Indices of the settings in which some of these groups differ, among those that apply to them and are
    /// not determined by a preset.
    pub fn varying(&self, groups: &[&Group<'_>]) -> Vec<usize> {
        let decided = self.decided_by_preset(groups);
        let varies = |place: &usize| {
            let mut has_it = groups.iter().filter(|group| self.matters(group, *place));
            let first = has_it.next();
            let is_other =
                |group: &&Group<'_>| first.is_some_and(|f| self.differ(f, group, *place));
            !decided.contains(place) && has_it.any(is_other)
        };
        (0..self.settings.len()).filter(varies).collect()
    }

    /// Indices of the settings of the filter that have one value under each preset among these groups: naming
    /// the preset names them.
    pub fn decided_by_preset(&self, groups: &[&Group<'_>]) -> Vec<usize> {
        let Some(preset) = self.place(PRESET) else { return Vec::new() };
        let mut firsts: Vec<&Group<'_>> = Vec::new();
        let mut decided: Vec<usize> =
            (0..self.settings.len()).filter(|&place| self.settings[place].is_of_filter()).collect();
        for &group in groups.iter().filter(|group| self.matters(group, preset)) {
            match firsts.iter().find(|first| !self.differ(first, group, preset)) {
                Some(first) => decided.retain(|&place| !self.differ(first, group, place)),
                None => firsts.push(group),
            }
        }
        decided
    }

    /// Whether two groups differ only in the given settings, so that they can be compared. A setting that
    /// does not apply to one of them is not a difference.
    pub fn differ_only_in(&self, a: &Group<'_>, b: &Group<'_>, settings: &[usize]) -> bool {
        (0..self.settings.len()).all(|place| settings.contains(&place) || !self.differ(a, b, place))
    }

    /// Whether two groups differ in a setting that applies to both.
    pub fn differ(&self, a: &Group<'_>, b: &Group<'_>, place: usize) -> bool {
        !same_values(a.values(place), b.values(place))
            && [a, b].iter().all(|group| self.matters(group, place))
    }

    /// Whether a setting applies to a group: offsets to grids only, sizes not to maps of all points, settings
    /// of runs not to maps without runs, noise to its motion model only, and parts not where the whole is
    /// absent or has no such part. Settings of the built-in filter do not apply to external programs.
    pub fn matters(&self, group: &Group<'_>, place: usize) -> bool {
        let Setting { name, of_map, .. } = &self.settings[place];
        let has_value = |place: usize| group.values(place).iter().any(|value| !value.is_empty());
        match name.as_str() {
            "offset" => has_value(place),
            name if SIZE.contains(&name) => !self.has_all_points(group),
            _ if *of_map => true,
            _ if self.of_filter[place] && !has_value(place) && self.is_of_program(group) => false,
            "alpha" | "turning_in_place" => !self.moves_by(group, MotionKind::Gaussian),
            "position_noise" | "heading_noise" => !self.moves_by(group, MotionKind::Book),
            name if is_part(name) && !has_value(place) => false,
            _ => (0..self.settings.len()).any(|run| !self.settings[run].of_map && has_value(run)),
        }
    }

    fn is_of_program(&self, group: &Group<'_>) -> bool {
        self.place(LOCALIZER).is_some_and(|place| !matches!(&*group.text(place), "" | OWN))
    }

    fn moves_by(&self, group: &Group<'_>, motion: MotionKind) -> bool {
        self.place("motion").is_some_and(|place| group.text(place) == motion.name())
    }

    /// What a split means for the scans that build maps and those that rate them or (`of_runs`) are
    /// localized, for captions.
    pub fn describe_split(&self, name: &str, of_runs: bool) -> String {
        match Split::ALL.into_iter().find(|split| split.name() == name) {
            Some(Split::Same) if !of_runs => {
                "Maps are rated by the scans that build them".to_owned()
            }
            Some(Split::Alternate) if !of_runs => {
                "Maps are built from even scans and rated by odd ones".to_owned()
            }
            Some(split) => split.describe().to_owned(),
            None => name.to_owned(),
        }
    }

    /// Whether the maps of a group have all points.
    pub fn has_all_points(&self, group: &Group<'_>) -> bool {
        self.place("map").is_some_and(|map| group.text(map) == "all")
    }
}

impl<'r> Group<'r> {
    fn of(place: usize, members: &[Member<'_, 'r>], settings: &[Setting]) -> Self {
        let rows: Vec<Row<'r>> = members.iter().filter_map(|member| member.row).collect();
        let [draw, run] = ["draw", "run"].map(|column| column_of(&rows, column));
        let number = |row: &Row<'_>, place| match row.at(place) {
            Value::Count(count) => *count,
            _ => 0,
        };
        let units = rows.iter().map(|row| (number(row, draw), number(row, run))).collect();
        // Where rows are missing, every requested row is a member once more, without values.
        let asked = members.len() - rows.len();
        let entries: BTreeSet<&str> =
            members.iter().flat_map(|m| m.recipe.text(ENTRIES).split_whitespace()).collect();
        let values: Vec<Vec<Value>> =
            settings.iter().map(|setting| setting.values(&members[0].recipe)).collect();
        let named = ["map", "size_percent", "split"];
        let named = settings.iter().zip(&values).filter(|(s, _)| named.contains(&s.name.as_str()));
        let name: Vec<String> = named.map(|(_, values)| text_of(values)).collect();
        Group {
            place,
            asked: if asked > 0 { asked } else { rows.len() },
            entries: entries.into_iter().map(str::to_owned).collect(),
            rows,
            units,
            values,
            name: name.join(" "),
        }
    }

    /// Values of a setting, by its index.
    pub fn values(&self, place: usize) -> &[Value] {
        &self.values[place]
    }

    /// The value of a setting as text.
    pub fn text(&self, place: usize) -> String {
        text_of(self.values(place))
    }

    /// The value of a setting of one number.
    pub fn number(&self, place: usize) -> Option<f64> {
        match self.values(place) {
            [value @ (Value::Count(_) | Value::Number(_))] => value.number(),
            _ => None,
        }
    }

    /// Number of independent units.
    pub fn blocks(&self) -> usize {
        self.units.iter().map(|&(block, _)| block).collect::<BTreeSet<u64>>().len()
    }

    /// Values of a column by block (draw) and unit (run); `None` where a row has no number. If one row's
    /// value is not known, the mean is not known: a mean of the others would depend on the outcome.
    ///
    /// # Errors
    /// When a run occurs twice in a draw, or a value cannot be computed with.
    pub fn blocked(&self, column: &str) -> Result<Option<Blocked>> {
        self.blocked_where(column, |_| true)
    }

    /// The same for the rows for which `is_kept` holds.
    ///
    /// # Errors
    /// As [`Group::blocked`].
    pub fn blocked_where(
        &self,
        column: &str,
        is_kept: impl Fn(&Row<'_>) -> bool,
    ) -> Result<Option<Blocked>> {
        let [place, run] = [column, "run"].map(|column| column_of(&self.rows, column));
        let has_runs = self.rows.iter().all(|row| !row.at(run).is_empty());
        let rows = self.rows.iter().zip(&self.units).filter(|(row, _)| is_kept(row));
        let values = rows.map(|(row, &(block, unit))| Some((block, unit, row.at(place).number()?)));
        let Some(values) = values.collect::<Option<Vec<_>>>() else { return Ok(None) };
        if values.is_empty() {
            return Ok(None);
        }
        let blocked = match has_runs {
            true => Blocked::with_units(values),
            // A value of the map alone: it is paired with the mean of a block.
            false => Blocked::new(values.into_iter().map(|(block, _, value)| (block, value))),
        };
        blocked.map(Some).with_context(|| format!("{column} of {self}"))
    }

    /// How many runs say yes in a column; `None` where a row says neither.
    ///
    /// # Errors
    /// When there is no row.
    pub fn rate(&self, column: &str) -> Result<Option<BlockedRate>> {
        let place = column_of(&self.rows, column);
        self.rate_of(|row| match row.at(place) {
            Value::Bool(truth) => Some(*truth),
            _ => None,
        })
    }

    /// The number of rows for which the answer is yes; `None` where a row has no answer.
    ///
    /// # Errors
    /// When there is no row.
    pub fn rate_of(&self, is: impl Fn(&Row<'_>) -> Option<bool>) -> Result<Option<BlockedRate>> {
        let values =
            self.rows.iter().zip(&self.units).map(|(row, &(block, _))| Some((block, is(row)?)));
        let Some(values) = values.collect::<Option<Vec<_>>>() else { return Ok(None) };
        Ok(Some(BlockedRate::new(values)?))
    }
}

/// "gbs+f-km 1 same".
impl fmt::Display for Group<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

/// Whether a setting is a part of another one, which determines whether it applies.
fn is_part(name: &str) -> bool {
    const PARTS_OF: [(&str, &str); 4] = [
        ("initial_pose_kind", "initial_pose_"),
        ("kidnapped_at", "kidnapped_"),
        ("slip_share", "slip_"),
        ("recover", "recover_"),
    ];
    PARTS_OF.iter().any(|(whole, parts)| name != *whole && name.starts_with(parts))
}

/// The place of a column in rows of one table.
fn column_of(rows: &[Row<'_>], column: &str) -> Option<usize> {
    rows.first().and_then(|row| row.column(column))
}

/// Whether two settings have the same values.
pub fn same_values(a: &[Value], b: &[Value]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.order(b).is_eq())
}

/// The order of settings: by the first in which they differ.
pub fn order(a: &[Vec<Value>], b: &[Vec<Value>]) -> Ordering {
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    first_difference(pairs.map(|(a, b)| a.order(b)))
}

fn first_difference(mut orders: impl Iterator<Item = Ordering>) -> Ordering {
    orders.find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
}

/// The order of values, names in that of the study's file.
fn order_by<'v>(
    names: &[&str],
    a: impl IntoIterator<Item = &'v Value>,
    b: impl IntoIterator<Item = &'v Value>,
) -> Ordering {
    let place = |value: &Value| {
        let text = value.text()?;
        Some(names.iter().position(|name| *name == text).unwrap_or(names.len()))
    };
    let orders = a.into_iter().zip(b).map(|(a, b)| match (place(a), place(b)) {
        (Some(first), Some(second)) => first.cmp(&second).then_with(|| a.order(b)),
        _ => a.order(b),
    });
    first_difference(orders)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::charts::charts;
    use crate::view::compare::tests;
    use crate::view::estimate::Estimates;
    use crate::view::planted::planted;
    use crate::view::ranking::ranking;
    use crate::view::summary::summary;

    const STUDY: &str = r#"
seed = 1
[[trials]]
map = ["gbs", "all"]
size = [1, 5]
preset = ["carmen", "book"]
draws = 3
runs = 1
[[views.tests]]
y = "weighted"
column = "preset"
[[views.charts]]
name = "preset"
x = { column = "size_percent" }
y = { column = "weighted" }
curves = ["map", "preset"]
[[views.charts]]
name = "of-{preset}"
y = { column = "weighted" }
[views.ranking]
y = "weighted"
"#;

    /// A filter's tenth as large error on the maps of odd draws.
    fn results(text: &str) -> Results {
        planted(text, "office", |row| {
            let of_preset = if row.text("preset") == "carmen" { 1.0 } else { 2.0 };
            let of_draw = 1.0 + 0.1 * row.number("draw").unwrap();
            vec![("weighted", (of_preset * of_draw).into()), ("diverged", false.into())]
        })
    }

    /// Presets differ in a dozen settings at once, which would give as many columns and panels.
    #[test]
    fn a_preset_stands_for_what_it_decides() {
        let results = results(STUDY);
        let table = summary(&Estimates::of(&results).unwrap()).unwrap();
        let columns = ["dataset", "split", "map", "size_percent", "preset", "blocks"];
        assert_eq!(table.columns()[..6], columns);
        let tested = tests(&Groups::of(&results).unwrap()).unwrap();
        assert_eq!(tested.len(), 3, "two sizes and all points");
        for row in tested.rows() {
            let sides = [row.text("a"), row.text("b"), row.text("preset")];
            assert_eq!((sides, row.get("blocks")), (["carmen", "book", ""], &Value::Count(3)));
            assert!((row.number("effect").unwrap() + 1.1).abs() < 1e-12);
        }
        let columns = ["rank", "score", "preset", "dataset"];
        assert_eq!(ranking(std::slice::from_ref(&results)).unwrap().columns()[..4], columns);
        let charts = charts(&Estimates::of(&results).unwrap()).unwrap();
        let names: Vec<&str> = charts.iter().map(|chart| chart.name.as_str()).collect();
        assert_eq!(names, ["preset", "of-carmen", "of-book"]);
        let [panel] = &charts[0].panels[..] else { panic!("{:?}", charts[0]) };
        assert_eq!(panel.labels, ["gbs, carmen", "gbs, book"]);
        let captions = charts.iter().map(|chart| chart.caption.concat());
        let expected = ["500 particles", "Preset carmen, 500", "Preset book, 500"];
        assert!(captions.zip(expected).all(|(caption, part)| caption.contains(part)), "{charts:?}");
        let beams = "proposal motion, beams all (book), 3deg (carmen)";
        assert!(charts[0].caption.concat().contains(beams), "{charts:?}");
    }

    /// Fault: runs with and without recovery could not be compared, as only one of them has recovery rates.
    #[test]
    fn parts_of_what_is_not_there_make_no_difference() {
        let text = "seed = 1\n[[trials]]\nmap = \"all\"\nrecover = [false, true]\n\
                    initial_pose = [{ kind = \"uniform\" }, { kind = \"scan\" }]\n\
                    disturbance = [{}, { kidnapped = { at = 0.5 } }]\ndraws = 2\nruns = 1\n\
                    [[views.tests]]\ny = \"weighted\"\ncolumn = \"recover\"\n";
        let results = results(text);
        let groups = Groups::of(&results).unwrap();
        let varying = groups.varying(&groups.all.iter().collect::<Vec<_>>());
        let names = varying.iter().map(|&place| groups.settings[place].name.as_str());
        let expected = ["initial_pose_kind", "recover", "kidnapped_at"];
        assert_eq!(names.collect::<Vec<_>>(), expected);
        let tested = tests(&Groups::of(&results).unwrap()).unwrap();
        assert_eq!(tested.len(), 4, "two starts, carried off or not");
        assert!(tested.rows().all(|row| [row.text("a"), row.text("b")] == ["false", "true"]));
    }

    #[test]
    fn a_setting_varied_under_a_preset_stays_separate() {
        let varied = STUDY.replace("draws", "sigma_hit = [0.2, 0.3]\ndraws");
        let more = "[[trials]]\nmap = \"gbs\"\nsize = 1\npreset = \"book\"\nz_rand = 0.2\n\
                    odometry_noise = { xy = 0.1, theta = 0.1 }\ndraws = 3\nruns = 1\n";
        for (text, settings) in [
            (varied, &["map", "size_percent", "preset", "sigma_hit"][..]),
            (format!("{STUDY}{more}"), &["map", "size_percent", "preset", "z_rand", "noise"]),
            (STUDY.replace(", \"book\"", ""), &["map", "size_percent"]),
        ] {
            let results = results(&text);
            let groups = Groups::of(&results).unwrap();
            let all: Vec<&Group<'_>> = groups.all.iter().collect();
            let varying = groups.varying(&all);
            let names = varying.iter().map(|&place| groups.settings[place].name.as_str());
            assert_eq!(names.collect::<Vec<_>>(), settings);
        }
        // Noise that varies with a preset is not one of its settings.
        let at = STUDY.find("draws").unwrap();
        let [before, after] = [&STUDY[..at], &STUDY[at..]];
        let of_carmen =
            before.replace(", \"book\"", "") + "odometry_noise = { xy = 0.1, theta = 0.1 }\n";
        let text = of_carmen
            + after
            + &before[before.find("[[trials]]").unwrap()..].replace("\"carmen\", ", "")
            + "draws = 3\nruns = 1\n";
        let results = results(&text);
        let groups = Groups::of(&results).unwrap();
        let noise = groups.place("noise").unwrap();
        assert!(groups.varying(&groups.all.iter().collect::<Vec<_>>()).contains(&noise));
    }
}
