//! What stands beneath a chart.

use mcl_core::text::{counted, number};

use crate::store::results::Results;
use crate::view::chart::Point;
use crate::view::groups::{Group, Groups};
use crate::view::labels::name_and_unit;
use crate::view::layout::distinct;

/// Settings that captions give where they do not vary.
const TOLD: [&str; 8] =
    ["particles", "proposal", "beams", "sigma_hit", "z_rand", "alpha", "noise", "sigma_m"];

/// What is known of the data; which trials are missing; what a point is a mean of, and what its interval
/// is; and settings that do not vary. `of_runs`: whether runs are shown, not only maps.
pub fn caption(
    results: &Results,
    groups: &Groups<'_>,
    shown: &[&Group<'_>],
    points: &[&Point],
    of_runs: bool,
) -> String {
    let mut sentences = vec![results.facts.describe()];
    if let Some(missing) = results.missing() {
        sentences.push(format!("Incomplete: {missing}"));
    }
    sentences.extend(scans(groups, shown, of_runs));
    sentences.push(means(points, of_runs));
    let told = TOLD.iter().filter_map(|name| groups.place(name));
    let told = told.filter(|&place| of_runs || groups.settings[place].of_map);
    let settings: Vec<String> = told.filter_map(|place| setting(groups, shown, place)).collect();
    if !settings.is_empty() {
        sentences.push(capitalized(&settings.join(", ")));
    }
    sentences
        .iter()
        .map(|sentence| format!("{sentence}. "))
        .collect::<String>()
        .trim_end()
        .to_owned()
}

/// "On all points: 0.0123 (0.0119 to 0.0127)".
pub fn of_all_points(panel: &str, mean: f64, interval: Option<[f64; 2]>) -> String {
    let place = if panel.is_empty() { String::new() } else { format!(" ({panel})") };
    let interval = interval
        .map_or(String::new(), |[low, high]| format!(" ({} to {})", number(low), number(high)));
    format!("On all points{place}: {}{interval}", number(mean))
}

/// Which scans build maps, if it is the same in all of the chart.
fn scans(groups: &Groups<'_>, shown: &[&Group<'_>], of_runs: bool) -> Option<String> {
    let place = groups.place("split")?;
    match &distinct(groups, shown, place)[..] {
        [split] => split.first()?.text().map(|split| groups.describe_split(split, of_runs)),
        _ => None,
    }
}

fn means(points: &[&Point], of_runs: bool) -> String {
    let range = |of: &dyn Fn(&Point) -> usize| {
        let counts = || points.iter().map(|point| of(point)).filter(|&count| count > 0);
        Some([counts().min()?, counts().max()?])
    };
    let several = |[least, most]: [usize; 2], what: &str| match least == most {
        true => counted(least, what),
        false => format!("{least} to {}", counted(most, what)),
    };
    let Some(blocks) = range(&|point| point.blocks) else { return "Means".to_owned() };
    let per_block = |point: &Point| point.rows.checked_div(point.blocks).unwrap_or(0);
    let mut text = match blocks {
        [1, 1] => "One map each".to_owned(),
        blocks => format!("Means over {}", several(blocks, "map")),
    };
    if let Some(runs) = range(&per_block)
        && of_runs
        && runs[1] > 1
    {
        text += &format!(", {} on each", several(runs, "run"));
    }
    if points.iter().any(|point| point.interval.is_some()) {
        text += ", with Student's 95 % intervals over maps";
    }
    text
}

fn setting(groups: &Groups<'_>, shown: &[&Group<'_>], place: usize) -> Option<String> {
    let shown: Vec<&Group<'_>> =
        shown.iter().copied().filter(|group| groups.matters(group, place)).collect();
    let values = match &distinct(groups, &shown, place)[..] {
        [values] if values.iter().all(|value| !value.is_empty()) => values.clone(),
        _ => return None,
    };
    let text = crate::study::settings::text_of(&values);
    let setting = groups.settings[place].name.as_str();
    Some(match (setting, &values[..]) {
        ("particles", _) => format!("{text} particles"),
        ("beams", _) => format!("{text} beams"),
        ("proposal", _) => format!("proposal {text}"),
        ("noise", [xy, theta]) => format!("noise added to the odometry {xy} m and {theta} rad"),
        _ => value(setting, &text),
    })
}

/// "σ_hit = 0.3 m".
pub fn value(setting: &str, text: &str) -> String {
    let (name, unit) = name_and_unit(setting);
    format!("{name} = {text} {unit}").trim_end().to_owned()
}

/// With its first letter in upper case, where it has one; σ stays what it is.
fn capitalized(text: &str) -> String {
    let mut chars = text.chars();
    match chars.next() {
        Some(first) if first.is_ascii() => first.to_ascii_uppercase().to_string() + chars.as_str(),
        _ => text.to_owned(),
    }
}
