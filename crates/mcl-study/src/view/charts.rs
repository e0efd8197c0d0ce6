//! The charts of a study, as declared in its file.

use anyhow::Result;

use crate::recipe::localizer::LOCALIZER;
use crate::study::settings::{PRESET, text_of};
use crate::study::views::{Axis, Chart, ChartKind, Part, Relative, Scale};
use crate::table::Value;
use crate::view::caption::{caption, means, of_all_points, value, vocabulary};
use crate::view::chart::{ChartData, Panel, PanelAxis, Point};
use crate::view::estimate::{Estimate, Estimates};
use crate::view::groups::{Group, order, same_values};
use crate::view::labels::{axis_label, name_and_unit};
use crate::view::layout::{Layout, distinct};
use crate::view::lost;

/// The charts of `[[views.charts]]` that have a point on this data set.
///
/// # Errors
/// When a value cannot be computed with.
pub fn charts(estimates: &Estimates<'_>) -> Result<Vec<ChartData>> {
    let mut charts = Vec::new();
    for chart in &estimates.groups.results.study.views.charts {
        let shown: Vec<&Group<'_>> = estimates.groups.of_entries(&chart.of).collect();
        let layout = Layout::of(chart, &estimates.groups, &shown);
        for (name, shown) in figures(chart, &layout, estimates, &shown) {
            let x = layout.x.first().and_then(|x| estimates.groups.place(x));
            let is_placed = layout.x_scale == Scale::Places || chart.kind == ChartKind::Heat;
            let places =
                x.filter(|_| is_placed).map(|x| (x, distinct(&estimates.groups, &shown, x)));
            let drawing = Drawing { chart, layout: &layout, estimates, shown, places };
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
    /// The setting along x and its values, where they are equally spaced.
    places: Option<(usize, Vec<Vec<Value>>)>,
}

/// The values on all points, by the title of the panel.
type OnAllPoints = Vec<(String, f64, Option<[f64; 2]>)>;

impl Drawing<'_, '_> {
    fn draw(&self, name: String) -> Result<ChartData> {
        let whole = [Part::default()];
        let parts = if self.chart.parts.is_empty() { &whole[..] } else { &self.chart.parts };
        let (mut panels, mut asked) = (Vec::new(), 0);
        let mut on_all_points = OnAllPoints::new();
        for (number, part) in parts.iter().enumerate() {
            for values in self.estimates.groups.combinations(&self.shown, &self.layout.panels) {
                for y in self.columns(part) {
                    asked += 1;
                    let panel = self.panel(number, part, &values, y, &mut on_all_points)?;
                    panels.extend((!panel.points.is_empty()).then_some(panel));
                }
            }
        }
        let points: Vec<&Point> = panels.iter().flat_map(|panel| &panel.points).collect();
        let Estimates { groups, .. } = self.estimates;
        let of_runs = self.of_runs();
        let mut described = caption(groups, &self.shown, &means(&points, of_runs), of_runs);
        for (panel, mean, interval) in &on_all_points {
            described += &format!(" {}.", of_all_points(panel, *mean, *interval));
        }
        let is_open = |point: &&Point| point.mark.as_deref() == Some("");
        if points.iter().any(is_open) {
            described += " Open symbols: some runs were lost, and the error is that of the others.";
        }
        let own = (!self.chart.caption.is_empty()).then(|| self.chart.caption.clone());
        let has_marks =
            points.iter().any(|point| !matches!(point.mark.as_deref(), None | Some("")));
        if let (Some(column), None, true) = (&self.chart.marks, &own, has_marks) {
            let (name, _) = name_and_unit(column);
            let of = name.strip_prefix("share of ").unwrap_or(&name);
            described += &format!(" Beside open symbols: {of}, of all.");
        }
        let labels = panels.iter().flat_map(|panel| &panel.labels).map(String::as_str);
        let meanings = vocabulary(labels.chain([described.as_str()]));
        described += &meanings;
        let caption = own.into_iter().chain([described]).collect();
        // Panels beside each other are to be compared with those above and below.
        let is_whole = panels.len() == asked;
        let columns = self.chart.columns.filter(|_| is_whole).unwrap_or(1);
        Ok(ChartData { name, kind: self.chart.kind, panels, columns, caption })
    }

    /// The columns of the vertical axis, a panel each.
    fn columns<'p>(&'p self, part: &'p Part) -> &'p [String] {
        part.column.as_ref().map_or(&self.chart.y.column, std::slice::from_ref)
    }

    /// Whether the values shown are measured of runs.
    fn of_runs(&self) -> bool {
        let measures = &self.estimates.groups.results.study.measures.of_runs;
        let is_shown = |column: &&str| self.chart.y.column.iter().any(|y| y == column);
        measures.iter().flat_map(|measure| measure.columns).any(is_shown)
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
        for curve in self.estimates.groups.combinations(&self.shown, &self.layout.curves) {
            for (place, x) in self.layout.x.iter().enumerate() {
                let mut found = Vec::new();
                for &group in &own {
                    if !self.has(group, &self.layout.curves, &curve) {
                        continue;
                    }
                    let Some(estimate) = self.estimates.mean(group, y)? else { continue };
                    if self.is_reference(group, x) {
                        // The caption describes other columns.
                        if number > 0 && part.column.is_some() {
                            continue;
                        }
                        let interval = estimate.interval.map(|i| [i.low, i.high]);
                        let mut entry = vec![of_panel.clone()];
                        if self.chart.y.column.len() > 1 {
                            entry.push(name_and_unit(y).0);
                        }
                        entry.retain(|part| !part.is_empty());
                        let entry = (entry.join(", "), estimate.mean, interval);
                        if !on_all_points.contains(&entry) {
                            on_all_points.push(entry);
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
        // The common part of several columns' names is not the name of any.
        let is_own = part.column.is_none();
        let is_shared = is_own && self.chart.y.column.len() > 1 && self.chart.y.label.is_some();
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
                label: label_of(Some(&self.chart.y).filter(|_| is_own), y),
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
                "map" | "dataset" | LOCALIZER | PRESET => Some(text),
                "size_percent" => Some(format!("{text} %")),
                "particles" => Some(format!("{text} particles")),
                _ if values == &[Value::Bool(true)] => Some(name_and_unit(setting).0),
                _ if values == &[Value::Bool(false)] => {
                    Some(format!("no {}", name_and_unit(setting).0))
                }
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
            // The meaning of rows of cells is shown beside them.
            (ChartKind::Heat, [_]) => text_of(&curve[0]),
            _ if label.is_empty() => name_and_unit(y).0,
            _ => label,
        }
    }

    /// Whether a group is described in the caption instead of the chart: maps of all points have a single
    /// size, far from all others.
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
            basis: estimate.basis,
            mark: self.mark(group, y)?,
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

    fn mark(&self, group: &Group<'_>, y: &str) -> Result<Option<String>> {
        if lost::is_of_some(group, y) {
            return Ok(Some(String::new()));
        }
        let Some(column) = &self.chart.marks else { return Ok(None) };
        let groups = &self.estimates.groups;
        if let Some(place) = groups.place(column) {
            let text = group.text(place);
            return Ok((!text.is_empty()).then_some(text));
        }
        let rate = group.rate(column)?.map(|rate| rate.of_units());
        Ok(rate.filter(|r| r.hits() > 0).map(|r| format!("{}/{}", r.hits(), r.trials())))
    }

    /// Replaces the values of a curve by values relative to its smallest or largest.
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
mod tests;
