//! The charts of a study, as its file declares them.

use anyhow::Result;

use crate::store::results::Results;
use crate::study::settings::text_of;
use crate::study::views::{Axis, Chart, ChartKind, Part, Relative, Scale};
use crate::table::Value;
use crate::view::caption::{caption, of_all_points, value};
use crate::view::chart::{ChartData, Panel, PanelAxis, Point};
use crate::view::estimate::{Estimate, Estimates};
use crate::view::groups::{Group, order, same_values};
use crate::view::labels::{axis_label, name_and_unit};
use crate::view::layout::{Layout, distinct};

/// The charts of `[[views.charts]]` that have a point on this data set.
///
/// # Errors
/// When a value cannot be computed with.
pub fn charts(results: &Results) -> Result<Vec<ChartData>> {
    let estimates = Estimates::of(results)?;
    let mut charts = Vec::new();
    for chart in &results.study.views.charts {
        let shown: Vec<&Group<'_>> = estimates.groups.of_entries(&chart.of).collect();
        let layout = Layout::of(chart, &estimates.groups, &shown);
        for (name, shown) in figures(chart, &layout, &estimates, &shown) {
            let x = layout.x.first().and_then(|x| estimates.groups.place(x));
            let is_placed = layout.x_scale == Scale::Places || chart.kind == ChartKind::Heat;
            let places =
                x.filter(|_| is_placed).map(|x| (x, distinct(&estimates.groups, &shown, x)));
            let drawing = Drawing { chart, layout: &layout, estimates: &estimates, shown, places };
            let data = drawing.draw(name)?;
            charts.extend((!data.panels.is_empty()).then_some(data));
        }
    }
    Ok(charts)
}

/// The groups of every figure of a chart, by the figure's name.
fn figures<'g, 'r>(
    chart: &Chart,
    layout: &Layout,
    estimates: &Estimates<'r>,
    shown: &[&'g Group<'r>],
) -> Vec<(String, Vec<&'g Group<'r>>)> {
    let mut figures: Vec<(String, Vec<&Group<'_>>)> = Vec::new();
    for &group in shown {
        let name = layout.figures.iter().fold(chart.name.clone(), |name, &place| {
            let setting = &estimates.groups.settings[place].name;
            name.replace(&format!("{{{setting}}}"), &file_part(&group.text(place)))
        });
        match figures.iter_mut().find(|(known, _)| *known == name) {
            Some((_, groups)) => groups.push(group),
            None => figures.push((name, vec![group])),
        }
    }
    figures
}

/// A value as part of a file's name.
fn file_part(value: &str) -> String {
    let part = |c: char| if c.is_ascii_alphanumeric() || ".+-".contains(c) { c } else { '_' };
    match value.is_empty() {
        true => "none".to_owned(),
        false => value.chars().map(part).collect(),
    }
}

/// A figure of a chart.
struct Drawing<'d, 'r> {
    chart: &'d Chart,
    layout: &'d Layout,
    estimates: &'d Estimates<'r>,
    shown: Vec<&'d Group<'r>>,
    /// The setting along x and its values, where each has a place.
    places: Option<(usize, Vec<Vec<Value>>)>,
}

/// What is on all points, by the title of the panel.
type OnAllPoints = Vec<(String, f64, Option<[f64; 2]>)>;

impl Drawing<'_, '_> {
    fn draw(&self, name: String) -> Result<ChartData> {
        let whole = [Part::default()];
        let parts = if self.chart.parts.is_empty() { &whole[..] } else { &self.chart.parts };
        let mut panels = Vec::new();
        let mut on_all_points = OnAllPoints::new();
        for (number, part) in parts.iter().enumerate() {
            for values in self.values_of(&self.layout.panels) {
                for y in &self.chart.y.column {
                    let panel = self.panel(number, part, &values, y, &mut on_all_points)?;
                    panels.extend((!panel.points.is_empty()).then_some(panel));
                }
            }
        }
        let points: Vec<&Point> = panels.iter().flat_map(|panel| &panel.points).collect();
        let Estimates { groups, .. } = self.estimates;
        let mut told = caption(groups.results, groups, &self.shown, &points, self.of_runs());
        for (panel, mean, interval) in &on_all_points {
            told += &format!(" {}.", of_all_points(panel, *mean, *interval));
        }
        let own = (!self.chart.caption.is_empty()).then(|| self.chart.caption.clone());
        let caption = own.into_iter().chain([told]).collect();
        Ok(ChartData { name, kind: self.chart.kind, panels, caption })
    }

    /// Whether what is shown is measured of runs.
    fn of_runs(&self) -> bool {
        let measures = &self.estimates.groups.results.study.measures.of_runs;
        let is_shown = |column: &&str| self.chart.y.column.iter().any(|y| y == column);
        measures.iter().flat_map(|measure| measure.columns).any(is_shown)
    }

    /// Combinations of values of settings among the groups, ascending.
    fn values_of(&self, places: &[usize]) -> Vec<Vec<Vec<Value>>> {
        let values = |group: &&Group<'_>| -> Vec<Vec<Value>> {
            places.iter().map(|&place| group.values(place).to_vec()).collect()
        };
        let mut all: Vec<Vec<Vec<Value>>> = self.shown.iter().map(values).collect();
        all.sort_by(|a, b| self.estimates.groups.order(a, b));
        all.dedup_by(|a, b| order(a, b).is_eq());
        all
    }

    fn panel(
        &self,
        number: usize,
        part: &Part,
        values: &[Vec<Value>],
        y: &str,
        on_all_points: &mut OnAllPoints,
    ) -> Result<Panel> {
        let of_panel = self.title_of(&self.layout.panels, values);
        let own: Vec<&Group<'_>> = self
            .shown
            .iter()
            .filter(|group| self.has(group, &self.layout.panels, values))
            .copied()
            .collect();
        let (mut labels, mut points) = (Vec::new(), Vec::new());
        for curve in self.values_of(&self.layout.curves) {
            for (place, x) in self.layout.x.iter().enumerate() {
                let mut found = Vec::new();
                for &group in &own {
                    if !self.has(group, &self.layout.curves, &curve) {
                        continue;
                    }
                    let Some(estimate) = self.estimates.mean(group, y)? else { continue };
                    if self.is_reference(group, x) {
                        let interval = estimate.interval.map(|i| [i.low, i.high]);
                        let told = (of_panel.clone(), estimate.mean, interval);
                        if !on_all_points.contains(&told) {
                            on_all_points.push(told);
                        }
                        continue;
                    }
                    let (Some(x), true) = (self.x(group, x)?, self.is_in(group, part)?) else {
                        continue;
                    };
                    let Some(mut point) = self.point(group, x, y, estimate)? else { continue };
                    point.curve = labels.len();
                    found.push(point);
                }
                if !found.is_empty() {
                    found.sort_by(|a, b| a.x.total_cmp(&b.x));
                    self.relate(&mut found);
                    points.extend(found);
                    let further = (place > 0).then(|| format!("+{}", name_and_unit(x).0));
                    labels.push(self.curve_label(&curve, y) + &further.unwrap_or_default());
                }
            }
        }
        // What several columns have in common is no name of either.
        let is_shared = self.chart.y.column.len() > 1 && self.chart.y.label.is_some();
        let of_column = if is_shared { name_and_unit(y).0 } else { String::new() };
        let titles = [part.title.clone(), of_panel, of_column];
        let titles: Vec<String> = titles.into_iter().filter(|title| !title.is_empty()).collect();
        let x_scale = match self.layout.x_scale {
            Scale::Places => Scale::Places,
            scale => part.x.unwrap_or(scale),
        };
        let x = self.chart.x.as_ref();
        let first = self.layout.x.first().map_or("", String::as_str);
        let curves = self.layout.curves.iter();
        let curves = curves.map(|&place| axis_label(&self.estimates.groups.settings[place].name));
        Ok(Panel {
            title: titles.join(": "),
            part: number,
            x: PanelAxis {
                label: label_of(x, first),
                scale: x_scale,
                places: match &self.places {
                    Some((_, values)) => values.iter().map(|values| text_of(values)).collect(),
                    None => Vec::new(),
                },
            },
            y: PanelAxis {
                label: label_of(Some(&self.chart.y), y),
                scale: part.y.unwrap_or(self.chart.y.scale),
                places: Vec::new(),
            },
            curves: match self.chart.kind {
                ChartKind::Curves => String::new(),
                ChartKind::Heat => curves.collect::<Vec<_>>().join(", "),
            },
            labels,
            points,
        })
    }

    fn has(&self, group: &Group<'_>, places: &[usize], values: &[Vec<Value>]) -> bool {
        let own: Vec<Vec<Value>> =
            places.iter().map(|&place| group.values(place).to_vec()).collect();
        order(&own, values).is_eq()
    }

    /// "gbs+f-km, 1 %, σ_hit = 0.3 m".
    fn title_of(&self, places: &[usize], values: &[Vec<Value>]) -> String {
        let title = |(&place, values): (&usize, &Vec<Value>)| {
            let setting = self.estimates.groups.settings[place].name.as_str();
            let text = text_of(values);
            match setting {
                _ if values.iter().all(Value::is_empty) => None,
                "map" | "dataset" => Some(text),
                "size_percent" => Some(format!("{text} %")),
                "split" => Some(self.estimates.groups.describe_split(&text, self.of_runs())),
                _ => Some(value(setting, &text)),
            }
        };
        let titles: Vec<String> = places.iter().zip(values).filter_map(title).collect();
        titles.join(", ")
    }

    fn curve_label(&self, curve: &[Vec<Value>], y: &str) -> String {
        let label = self.title_of(&self.layout.curves, curve);
        match (&self.chart.kind, &self.layout.curves[..]) {
            // What rows of cells are stands beside them.
            (ChartKind::Heat, [_]) => text_of(&curve[0]),
            _ if label.is_empty() => name_and_unit(y).0,
            _ => label,
        }
    }

    /// Whether a group is named in the caption instead of the chart: all points have but one size, far
    /// from all others.
    fn is_reference(&self, group: &Group<'_>, x: &str) -> bool {
        let is_alone = || self.shown.iter().all(|g| self.estimates.groups.has_all_points(g));
        let is_size = ["real_percent", "size_percent"].contains(&x);
        is_size && self.estimates.groups.has_all_points(group) && !is_alone()
    }

    fn is_in(&self, group: &Group<'_>, part: &Part) -> Result<bool> {
        let Some([least, most]) = part.sizes else { return Ok(true) };
        let place = self.estimates.groups.place("size_percent");
        let size = match place.and_then(|place| group.number(place)) {
            Some(requested) => Some(requested),
            None => self.estimates.mean(group, "real_percent")?.map(|found| found.mean),
        };
        Ok(size.is_some_and(|size| (least..=most).contains(&size)))
    }

    /// Horizontal position of a group.
    fn x(&self, group: &Group<'_>, column: &str) -> Result<Option<f64>> {
        let Some(place) = self.estimates.groups.place(column) else {
            return Ok(self.estimates.mean(group, column)?.map(|found| found.mean));
        };
        match &self.places {
            Some((x, values)) if *x == place => {
                let is_own = |known: &Vec<Value>| same_values(known, group.values(place));
                Ok(values.iter().position(is_own).map(|at| at as f64 + 1.0))
            }
            _ => Ok(group.number(place)),
        }
    }

    fn point(
        &self,
        group: &Group<'_>,
        x: f64,
        y: &str,
        estimate: Estimate,
    ) -> Result<Option<Point>> {
        let interval = estimate.interval.map(|interval| [interval.low, interval.high]);
        let mut point = Point {
            curve: 0,
            x,
            y: estimate.mean,
            interval,
            mark: self.mark(group)?,
            blocks: estimate.blocks,
            rows: estimate.rows,
        };
        if self.chart.y.relative == Some(Relative::TimesAll) {
            let groups = &self.estimates.groups;
            let map: Vec<usize> = groups.place("map").into_iter().collect();
            let all = groups.of_entries(&[]).find(|other| {
                groups.has_all_points(other) && groups.differ_only_in(group, other, &map)
            });
            let Some(all) = all else { return Ok(None) };
            let Some(on_all) = self.estimates.mean(all, y)? else { return Ok(None) };
            point.y /= on_all.mean;
            point.interval = None;
        }
        Ok(Some(point))
    }

    fn mark(&self, group: &Group<'_>) -> Result<Option<String>> {
        let Some(column) = &self.chart.marks else { return Ok(None) };
        let groups = &self.estimates.groups;
        if let Some(place) = groups.place(column) {
            let text = group.text(place);
            return Ok((!text.is_empty()).then_some(text));
        }
        let rate = group.rate(column)?.map(|rate| rate.of_units());
        Ok(rate.filter(|r| r.hits() > 0).map(|r| format!("{}/{}", r.hits(), r.trials())))
    }

    /// Values of a curve against its smallest or largest.
    fn relate(&self, curve: &mut [Point]) {
        let values = || curve.iter().map(|point| point.y);
        let (from, sign) = match self.chart.y.relative {
            Some(Relative::AboveSmallest) => (values().fold(f64::INFINITY, f64::min), 1.0),
            Some(Relative::BelowLargest) => (values().fold(f64::NEG_INFINITY, f64::max), -1.0),
            Some(Relative::TimesAll) | None => return,
        };
        for point in curve {
            point.y = sign * (point.y - from);
            point.interval = None;
        }
    }
}

fn label_of(axis: Option<&Axis>, column: &str) -> String {
    match axis.and_then(|axis| axis.label.clone()) {
        Some(label) => label,
        None => axis_label(column),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::planted::planted;

    fn labels(panel: &Panel) -> Vec<&str> {
        panel.labels.iter().map(String::as_str).collect()
    }

    fn titles(chart: &ChartData) -> Vec<&str> {
        chart.panels.iter().map(|panel| panel.title.as_str()).collect()
    }

    /// Figure 5 of the paper: a figure per split, sizes in two parts, diverged runs marked.
    #[test]
    fn error_over_size() {
        let text = r#"
seed = 1
[base]
odometry_noise = { xy = 0.01, theta = 0.02 }
[[trials]]
split = ["same", "alternate"]
map = ["all", "gbs", "gbs+f-km"]
size = [0.5, 1, 5]
draws = 5
runs = 2
[[views.charts]]
name = "figure5-{split}"
x = { column = "real_percent", label = "map size", scale = "log" }
y = { column = "weighted", scale = "log" }
parts = [{ title = "all sizes" }, { title = "up to 1 %", sizes = [0, 1], x = "linear" }]
marks = "diverged"
caption = "Own words."
"#;
        let results = planted(text, "office", |row| {
            let size = row.number("size_percent").unwrap();
            let draw = row.number("draw").unwrap();
            let diverged =
                row.text("map") == "gbs" && size == 0.5 && row.number("run") == Some(7.0);
            // A refinement drops duplicates.
            let real = if row.text("map") == "gbs+f-km" { 0.9 * size } else { size };
            let error = 1.0 + draw / size;
            vec![
                ("real_percent", real.into()),
                ("weighted", error.into()),
                ("diverged", diverged.into()),
            ]
        });
        let charts = charts(&results).unwrap();
        let names: Vec<&str> = charts.iter().map(|chart| chart.name.as_str()).collect();
        assert_eq!(names, ["figure5-same", "figure5-alternate"]);
        let same = &charts[0];
        assert_eq!(titles(same), ["all sizes", "up to 1 %"]);
        let [whole, small] = &same.panels[..] else { panic!() };
        assert_eq!((whole.x.label.as_str(), whole.x.scale), ("map size", Scale::Log));
        assert_eq!((small.x.scale, small.y.scale, small.part), (Scale::Linear, Scale::Log, 1));
        assert_eq!(whole.y.label, "mean weighted error d [–]");
        assert_eq!(labels(whole), ["gbs", "gbs+f-km"]);
        assert_eq!((whole.points.len(), small.points.len()), (6, 4));
        let last = &whole.points[5];
        assert_eq!((last.curve, last.x, last.blocks, last.rows), (1, 4.5, 5, 10));
        // Draws 0 to 4 at 5 %: 1 + 2/5, of standard deviation √2.5 / 5, Student's 2.776445 √(1/5).
        assert!((last.y - 1.4).abs() < 1e-12);
        let half = 2.776_445 * 2.5f64.sqrt() / 5.0 / 5f64.sqrt();
        let [low, high] = last.interval.unwrap();
        assert!((low - (1.4 - half)).abs() < 1e-6 && (high - (1.4 + half)).abs() < 1e-6);
        let marks: Vec<_> = whole.points.iter().map(|point| point.mark.as_deref()).collect();
        assert_eq!(marks, [Some("1/10"), None, None, None, None, None]);
        let [own, told] = &same.caption[..] else { panic!("{:?}", same.caption) };
        assert_eq!(own, "Own words.");
        assert_eq!(
            told,
            "Planted: 910 scans, 10,000 points with 0 < r ≤ 10 m. Map and runs use the same scans, as in \
             the paper. Means over 5 maps, 2 runs on each, with Student's 95 % intervals over maps. 500 \
             particles, proposal adaptive, all beams, σ_hit = 0.3 m, z_rand = 0.5, α = (0.05, 0.05, 0.05, \
             0.05), noise added to the odometry 0.01 m and 0.02 rad, σ = 0.05 m. On all points: 1.02 \
             (1.00 to 1.04)."
        );
        let table = same.to_table();
        assert_eq!(table.len(), 10);
        assert_eq!(
            String::from_utf8(table.to_csv().unwrap()).unwrap().lines().nth(1).unwrap(),
            format!(
                "all sizes,gbs,0.5,5,{},{},5,10,1/10",
                whole.points[0].interval.unwrap()[0],
                whole.points[0].interval.unwrap()[1]
            )
        );
    }

    #[test]
    fn what_is_missing_is_told() {
        let text = r#"
seed = 1
measures = ["likelihood"]
[[trials]]
map = ["gbs", "rnd"]
size = [1, 2]
draws = 4
[[views.charts]]
name = "chart"
x = { column = "size_percent" }
y = { column = "log_likelihood", scale = "symlog" }
"#;
        let results = planted(text, "office", |row| {
            vec![("log_likelihood", (-row.number("draw").unwrap()).into())]
        });
        let complete = charts(&results).unwrap();
        assert!(complete[0].caption[0].contains("Means over 4 maps, with Student's"));
        let results = results.without(3, |row| {
            row.text("map") == "rnd"
                && row.number("draw") > Some(0.0)
                && row.number("size_percent") == Some(2.0)
        });
        let chart = &charts(&results).unwrap()[0];
        assert!(
            chart.caption[0].contains(". Incomplete: 13 of 16 trials. "),
            "{:?}",
            chart.caption
        );
        assert!(chart.caption[0].contains("Means over 1 to 4 maps"), "{:?}", chart.caption);
        let alone = chart.panels[0].points.last().unwrap();
        assert_eq!((alone.blocks, alone.interval), (1, None));
    }

    /// Several columns: of x a curve each, of y a panel each. A run-length of a grid is a further curve.
    #[test]
    fn several_columns_of_an_axis() {
        let text = r#"
seed = 1
measures = ["bytes"]
[[trials]]
map = ["gbs", "all"]
size = [1, 2]
draws = 2
runs = 1
[[trials]]
map = "occupancy"
resolution = [0.1, 0.2]
draws = 2
runs = 1
[[views.charts]]
name = "bytes"
x = { column = ["kilobytes", "run_length_kilobytes"], scale = "log" }
y = { column = ["weighted", "translation", "heading"] }
"#;
        let results = planted(text, "office", |row| {
            let is_grid = row.text("map") == "occupancy";
            let resolution = row.number("resolution_m").unwrap_or(1.0);
            let size = row.number("size_percent").unwrap_or(1.0 / resolution);
            vec![
                ("kilobytes", size.into()),
                ("run_length_kilobytes", is_grid.then_some(size / 4.0).into()),
                ("weighted", resolution.into()),
                ("translation", (2.0 * resolution).into()),
            ]
        });
        let chart = &charts(&results).unwrap()[0];
        // Nothing is known of the heading.
        let y: Vec<&str> = chart.panels.iter().map(|panel| panel.y.label.as_str()).collect();
        assert_eq!(y, ["mean weighted error d [–]", "mean translation error [m]"]);
        assert_eq!(labels(&chart.panels[0]), ["gbs", "all", "occupancy", "occupancy+run lengths"]);
        let lengths: Vec<(f64, f64)> = chart.panels[1]
            .points
            .iter()
            .filter(|point| point.curve == 3)
            .map(|point| (point.x, point.y))
            .collect();
        assert_eq!(lengths, [(1.25, 0.4), (2.5, 0.2)]);
    }

    const SENSITIVITY: &str = r#"
seed = 1
[[trials]]
name = "tracking"
map = "gbs+f-km"
size = [1, 5]
sigma_hit = [0.2, 0.3, 0.5]
alpha = [[0.1, 0.1, 0.1, 0.1], [0.2, 0.2, 0.2, 0.2], [0.2, 0.2, 0.2, 0.3], [0.3, 0.2, 0.2, 0.3]]
proposal = ["motion", "adaptive"]
draws = 2
runs = 1
[[trials]]
name = "noise"
map = "gbs+f-km"
size = 1
proposal = ["motion", "adaptive"]
odometry_noise = [{ xy = 0.0, theta = 0.0 }, { xy = 0.1, theta = 0.0 }, { xy = 0.1, theta = 0.1 }]
draws = 2
runs = 1
"#;

    fn sensitivity(views: &str) -> Vec<ChartData> {
        let text = format!("{SENSITIVITY}{views}");
        let results = planted(&text, "office", |row| {
            let error = row.number("sigma_hit").unwrap() + row.number("alpha4").unwrap();
            vec![("weighted", error.into()), ("diverged", false.into())]
        });
        charts(&results).unwrap()
    }

    /// Without x: the number with the most values is the axis, the setting with the next most a curve,
    /// and all others panels, so that nothing is averaged over settings.
    #[test]
    fn axes_of_a_sweep_are_found() {
        let views = |name: &str| {
            format!(
                "[[views.charts]]\nname = \"{name}\"\nof = \"{name}\"\ny = {{ column = \"weighted\" }}\n"
            )
        };
        let chart = &sensitivity(&views("tracking"))[0];
        let expected = [
            "1 %, proposal = motion",
            "1 %, proposal = adaptive",
            "5 %, proposal = motion",
            "5 %, proposal = adaptive",
        ];
        assert_eq!(titles(chart), expected);
        let panel = &chart.panels[0];
        assert_eq!((panel.x.label.as_str(), panel.x.scale), ("σ_hit [m]", Scale::Log));
        assert_eq!(labels(panel).len(), 4);
        assert_eq!(labels(panel)[1], "α = (0.2, 0.2, 0.2, 0.2)");
        assert_eq!(panel.points.len(), 12);
        assert_eq!((panel.points[3].x, panel.points[3].y), (0.2, 0.4));
        // Pairs of numbers have places in the list.
        let chart = &sensitivity(&views("noise"))[0];
        let panel = &chart.panels[0];
        assert_eq!(panel.x.label, "noise added to the odometry [m, rad]");
        assert_eq!(panel.x.scale, Scale::Places);
        assert_eq!(panel.x.places, ["(0, 0)", "(0.1, 0)", "(0.1, 0.1)"]);
        assert_eq!(labels(panel), ["proposal = motion", "proposal = adaptive"]);
        let x: Vec<f64> = panel.points.iter().map(|point| point.x).collect();
        assert_eq!(x, [1.0, 2.0, 3.0, 1.0, 2.0, 3.0]);
        assert_eq!(chart.to_table().rows().nth(1).unwrap().text("x"), "(0.1, 0)");
    }

    #[test]
    fn settings_that_no_part_of_a_chart_names_are_panels() {
        let views = "[[views.charts]]\nname = \"a\"\nof = \"tracking\"\ny = { column = \"weighted\" }\n\
                     x = { column = \"sigma_hit\" }\npanels = [\"proposal\"]\n";
        let chart = &sensitivity(views)[0];
        // Two proposals, and beside them two sizes and four α.
        assert_eq!(chart.panels.len(), 2 * 2 * 4);
        assert_eq!(chart.panels[0].title, "proposal = motion, 1 %, α = (0.1, 0.1, 0.1, 0.1)");
        assert!(chart.panels.iter().all(|panel| labels(panel) == ["gbs+f-km"]));
    }

    #[test]
    fn settings_as_cells() {
        let views = "[[views.charts]]\nname = \"a\"\nof = \"tracking\"\nkind = \"heat\"\n\
                     y = { column = \"weighted\", scale = \"log\" }\nx = { column = \"alpha\" }\n\
                     curves = [\"sigma_hit\"]\n";
        let chart = &sensitivity(views)[0];
        assert_eq!((chart.kind, chart.panels.len()), (ChartKind::Heat, 4));
        let panel = &chart.panels[0];
        assert_eq!((panel.x.label.as_str(), panel.curves.as_str()), ("α", "σ_hit [m]"));
        assert_eq!((panel.x.places.len(), labels(panel)), (4, vec!["0.2", "0.3", "0.5"]));
        let third = panel.points.iter().find(|p| (p.curve, p.x) == (2, 3.0)).unwrap();
        assert!((third.y - 0.8).abs() < 1e-12);
    }

    /// Scores of a sweep above the smallest, and what the data chose.
    #[test]
    fn choices_beside_a_sweep() {
        let text = r#"
seed = 1
measures = ["likelihood", "criteria"]
[[trials]]
name = "swept"
map = "gbs"
size = { from = 1, to = 8, factor = 2 }
[[trials]]
name = "chosen"
map = "gbs"
size = ["bic", "mdl"]
[[trials]]
name = "sigma"
map = "gbs"
size = [1, 2]
sigma = [0.05, 0.1, "likelihood"]
[[views.charts]]
name = "sizes"
of = ["swept", "chosen"]
x = { column = "requested_points", scale = "log" }
y = { column = ["bic", "mdl"], scale = "symlog-fine", relative = "above-smallest" }
marks = "size_by"
[[views.charts]]
name = "sigmas"
of = "sigma"
x = { column = "used_sigma_m", scale = "log" }
y = { column = "mdl", relative = "below-largest" }
curves = ["size_percent"]
marks = "sigma_by"
"#;
        let results = planted(text, "office", |row| {
            let size = match row.text("size_by") {
                "bic" => 3.0,
                "mdl" => 5.0,
                _ => row.number("size_percent").unwrap(),
            };
            let sigma = row.number("sigma_m").unwrap_or(0.07);
            vec![
                ("requested_points", (100.0 * size).into()),
                ("used_sigma_m", sigma.into()),
                ("bic", (size - 3.0).abs().into()),
                ("mdl", (7.0 + (size - 4.0).abs() + 10.0 * sigma).into()),
            ]
        });
        let drawn = charts(&results).unwrap();
        let [bic, mdl, ..] = &drawn[0].panels[..] else { panic!() };
        assert_eq!(labels(bic), ["gbs"]);
        let points = |panel: &Panel| -> Vec<(f64, f64, Option<String>)> {
            let of_point =
                |point: &Point| (point.x, (1e6 * point.y).round() / 1e6, point.mark.clone());
            panel.points.iter().map(of_point).collect()
        };
        let by = |name: &str| Some(name.to_owned());
        assert_eq!(
            points(bic),
            [
                (100.0, 2.0, None),
                (200.0, 1.0, None),
                (300.0, 0.0, by("bic")),
                (400.0, 1.0, None),
                (500.0, 2.0, by("mdl")),
                (800.0, 5.0, None)
            ]
        );
        assert_eq!((mdl.points[3].y, mdl.points[4].mark.as_deref()), (0.0, Some("mdl")));
        let sigmas = &drawn[1].panels[0];
        assert_eq!(labels(sigmas), ["1 %", "2 %"]);
        let expected = [(0.05, 0.5, None), (0.07, 0.3, by("likelihood")), (0.1, 0.0, None)];
        assert_eq!(points(sigmas)[..3], expected);
        assert!(drawn[1].caption[0].contains("One map each."), "{:?}", drawn[1].caption);
    }

    #[test]
    fn errors_against_those_on_all_points() {
        let text = r#"
seed = 1
[[trials]]
map = ["gbs", "all"]
size = [1, 2]
sigma_hit = [0.1, 0.2]
draws = 2
runs = 1
[[views.charts]]
name = "race"
x = { column = "map_points" }
y = { column = "weighted", relative = "times-all" }
"#;
        let results = planted(text, "office", |row| {
            let all = row.number("sigma_hit").unwrap();
            let is_all = row.text("map") == "all";
            let size = row.number("size_percent").unwrap();
            vec![
                ("map_points", size.into()),
                ("weighted", if is_all { all } else { all * (1.0 + size) }.into()),
            ]
        });
        let chart = &charts(&results).unwrap()[0];
        assert_eq!(titles(chart), ["σ_hit = 0.1 m", "σ_hit = 0.2 m"]);
        for panel in &chart.panels {
            let y: Vec<f64> =
                panel.points.iter().map(|point| (1e9 * point.y).round() / 1e9).collect();
            assert_eq!(y, [2.0, 3.0, 1.0]);
            assert!(panel.points.iter().all(|point| point.interval.is_none()));
        }
    }

    #[test]
    fn values_in_names_of_files_are_plain() {
        assert_eq!(file_part("gbs+f-km"), "gbs+f-km");
        assert_eq!(file_part("(0.1, ../x)"), "_0.1__.._x_");
        assert_eq!(file_part(""), "none");
    }
}
