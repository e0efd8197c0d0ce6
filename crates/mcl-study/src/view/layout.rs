//! Chooses the axes, curves and panels of a chart.

use std::cmp::Reverse;

use crate::study::check::placeholders;
use crate::study::settings::{SIGMA, SIZE};
use crate::study::views::{Chart, Scale};
use crate::table::Value;
use crate::view::groups::{Group, Groups, order};

/// Settings of a chart by their role, as indices among the settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// A figure per value.
    pub figures: Vec<usize>,
    /// The columns of the horizontal axis.
    pub x: Vec<String>,
    /// Its scale.
    pub x_scale: Scale,
    /// A curve per value.
    pub curves: Vec<usize>,
    /// A panel per value: the settings named by the chart, and every setting that would otherwise be drawn
    /// over another.
    pub panels: Vec<usize>,
}

impl Layout {
    /// For a chart and the groups that it shows.
    pub fn of(chart: &Chart, groups: &Groups<'_>, shown: &[&Group<'_>]) -> Self {
        let places = |names: &[String]| -> Vec<usize> {
            names.iter().filter_map(|name| groups.place(name)).collect()
        };
        let names: Vec<String> =
            placeholders(&chart.name).0.into_iter().map(str::to_owned).collect();
        let figures = places(&names);
        let mut panels = places(&chart.panels);
        let mark = chart.marks.as_ref().and_then(|mark| groups.place(mark));
        let (x, x_scale, curves) = match &chart.x {
            Some(x) => {
                let map = vec!["map".to_owned()];
                let curves = places(chart.curves.as_ref().unwrap_or(&map));
                (x.column.clone(), x.scale, curves)
            }
            None => {
                let given = places(chart.curves.as_deref().unwrap_or_default());
                let named = [&figures[..], &panels, &given, mark.as_slice()].concat();
                let (x, curve) = automatic(groups, shown, &named);
                let curves = match chart.curves {
                    Some(_) => given,
                    None => curve.into_iter().collect(),
                };
                (
                    x.into_iter().map(|x| groups.settings[x].name.clone()).collect(),
                    Scale::Log,
                    curves,
                )
            }
        };
        let covered = x.iter().flat_map(|x| covered_by(groups, x));
        let mut visible: Vec<usize> = covered.chain(mark).collect();
        visible.extend([&figures[..], &curves, &panels].concat());
        // Settings that are left would be drawn over each other.
        while let Some(place) = overlaid(groups, shown, &visible) {
            panels.push(place);
            visible.push(place);
        }
        let x_scale = match x.iter().find_map(|x| groups.place(x)) {
            Some(place) => scale_of(place, shown, x_scale),
            None => x_scale,
        };
        Layout { figures, x, x_scale, curves, panels }
    }
}

/// The settings covered by a horizontal axis: measures of size depend on the size of a map.
fn covered_by(groups: &Groups<'_>, x: &str) -> Vec<usize> {
    let places = |names: &[&str]| names.iter().filter_map(|name| groups.place(name)).collect();
    if SIGMA.contains(&x) || x == "used_sigma_m" {
        return places(&SIGMA);
    }
    match groups.place(x) {
        Some(place) if !SIZE.contains(&x) => vec![place],
        _ => places(&SIZE),
    }
}

/// The numeric setting with the most values, or else any; and the one with the next most. Sizes count as one
/// setting.
fn automatic(
    groups: &Groups<'_>,
    shown: &[&Group<'_>],
    named: &[usize],
) -> (Option<usize>, Option<usize>) {
    let mut varied: Vec<usize> = groups.varying(shown);
    varied.retain(|place| !named.contains(place));
    let name = |place: usize| groups.settings[place].name.as_str();
    // Most values first; among equals, settings of runs.
    varied.sort_by_key(|&place| {
        (Reverse(distinct(groups, shown, place).len()), groups.settings[place].of_map)
    });
    let size = varied.iter().copied().find(|&place| SIZE.contains(&name(place)));
    varied.retain(|&place| !SIZE.contains(&name(place)) || Some(place) == size);
    if let Some(number) = varied.iter().position(|&place| is_number(shown, place)) {
        varied[..=number].rotate_right(1);
    }
    (varied.first().copied(), varied.get(1).copied())
}

/// A setting in which two groups differ that agree in all settings shown.
fn overlaid(groups: &Groups<'_>, shown: &[&Group<'_>], visible: &[usize]) -> Option<usize> {
    let key = |group: &Group<'_>| -> Vec<Vec<Value>> {
        visible.iter().map(|&place| group.values(place).to_vec()).collect()
    };
    let mut keyed: Vec<(Vec<Vec<Value>>, &Group<'_>)> =
        shown.iter().map(|g| (key(g), *g)).collect();
    keyed.sort_by(|a, b| order(&a.0, &b.0));
    let same = keyed.windows(2).filter(|pair| order(&pair[0].0, &pair[1].0).is_eq());
    let differing = |pair: &[(Vec<Vec<Value>>, &Group<'_>)]| {
        let (a, b) = (pair[0].1, pair[1].1);
        (0..groups.settings.len()).find(|&place| groups.differ(a, b, place))
    };
    same.filter_map(differing).min()
}

/// The distinct values of a setting, names in the order of the study and numbers ascending.
pub fn distinct(groups: &Groups<'_>, shown: &[&Group<'_>], place: usize) -> Vec<Vec<Value>> {
    groups.combinations(shown, &[place]).into_iter().flatten().collect()
}

/// Whether a setting is a single number in all groups that have it.
fn is_number(shown: &[&Group<'_>], place: usize) -> bool {
    let has = |group: &&&Group<'_>| group.values(place).iter().any(|value| !value.is_empty());
    let mut numbers = shown.iter().filter(has).map(|group| group.number(place)).peekable();
    numbers.peek().is_some() && numbers.all(|number| number.is_some())
}

/// The scale that fits the values of a setting.
fn scale_of(place: usize, shown: &[&Group<'_>], wanted: Scale) -> Scale {
    let numbers = || shown.iter().filter_map(|group| group.number(place));
    match wanted {
        _ if !is_number(shown, place) => Scale::Places,
        Scale::Log if numbers().any(|number| number <= 0.0) => Scale::Linear,
        wanted => wanted,
    }
}
