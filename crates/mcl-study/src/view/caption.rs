//! Captions of charts.

use mcl_core::text::{counted, number, numbers};
use mcl_filter::{MotionKind, SigmaHit};
use mcl_metrics::IntervalBasis;

use crate::recipe::disturbance::Start;
use crate::study::settings::{PRESET, text_of};
use crate::table::Value;
use crate::view::chart::Point;
use crate::view::groups::{Group, Groups};
use crate::view::labels::name_and_unit;
use crate::view::layout::distinct;

/// Settings listed in captions where they do not vary.
const CAPTIONED: [&str; 20] = [
    "map",
    "size_percent",
    PRESET,
    "particles",
    "proposal",
    "beams",
    "sigma_hit",
    "z_rand",
    "beam_floor",
    "motion",
    "alpha",
    "noise",
    "sigma_m",
    "start",
    "length",
    "people_share",
    "lost_beams",
    "kidnapped_at",
    "slip_share",
    "recover",
];

/// Settings listed in captions by preset, where presets differ in them.
const CAPTIONED_BY_PRESET: [&str; 2] = ["proposal", "beams"];

/// A description of the data; missing trials; `of_what`, the content of the chart; and settings that do not
/// vary. `of_runs`: whether runs are shown, not only maps.
pub fn caption(groups: &Groups<'_>, shown: &[&Group<'_>], of_what: &str, of_runs: bool) -> String {
    let mut sentences = vec![groups.results.facts.describe()];
    sentences.extend(groups.results.missing().map(|missing| format!("Incomplete: {missing}")));
    sentences.extend(scans(groups, shown, of_runs));
    sentences.push(of_what.to_owned());
    let captioned = CAPTIONED.iter().filter_map(|name| groups.place(name));
    let captioned = captioned.filter(|&place| of_runs || groups.settings[place].of_map);
    let settings: Vec<String> = captioned
        .filter_map(|place| {
            setting(groups, shown, place).or_else(|| by_preset(groups, shown, place))
        })
        .collect();
    if !settings.is_empty() {
        sentences.push(capitalized(&settings.join(", ")));
    }
    format!("{}.", sentences.join(". "))
}

/// "On all points: 0.01231 (0.01192 to 0.01270)".
pub fn of_all_points(panel: &str, mean: f64, interval: Option<[f64; 2]>) -> String {
    let place = if panel.is_empty() { String::new() } else { format!(" ({panel})") };
    let found = match interval.map(|[low, high]| numbers(&[mean, low, high])).as_deref() {
        Some([mean, low, high]) => format!("{mean} ({low} to {high})"),
        _ => number(mean),
    };
    format!("On all points{place}: {found}")
}

/// " gbs: grid-based sampling, +f-km: improved by fuzzy k-means.", of the short names in these texts; nothing without any.
pub fn vocabulary<'l>(names: impl Iterator<Item = &'l str>) -> String {
    const WORDS: [(&str, &str); 3] = [
        ("gbs", "grid-based sampling"),
        ("rnd", "random sampling"),
        ("f-km", "improved by fuzzy k-means"),
    ];
    let names: Vec<&str> =
        names.flat_map(|name| name.split(|c: char| ", +.".contains(c))).collect();
    let is_used = |(word, _): &&(&str, &str)| names.contains(word);
    let meanings: Vec<String> =
        WORDS.iter().filter(is_used).map(|(word, meaning)| format!("{word}: {meaning}")).collect();
    if meanings.is_empty() { String::new() } else { format!(" {}.", meanings.join(", ")) }
}

/// Which scans build maps, if that is the same in the whole chart.
fn scans(groups: &Groups<'_>, shown: &[&Group<'_>], of_runs: bool) -> Option<String> {
    let place = groups.place("split")?;
    match &distinct(groups, shown, place)[..] {
        [split] => split.first()?.text().map(|split| groups.describe_split(split, of_runs)),
        _ => None,
    }
}

/// What a point is a mean of, and the kind of its interval.
pub fn means(points: &[&Point], of_runs: bool) -> String {
    let counts: Vec<_> = points.iter().map(|point| (point.blocks, point.rows)).collect();
    let Some(of) = maps_and_runs(&counts, of_runs) else { return "Means".to_owned() };
    let shares = points.iter().filter(|point| point.basis.is_some()).count();
    let text = match (of.strip_prefix("1 map"), shares) {
        (Some(runs), _) => format!("One map each{runs}"),
        (None, 0) => format!("Means over {of}"),
        (None, shares) if shares == points.len() => format!("Shares of the runs on {of}"),
        (None, _) => format!("Means and shares over {of}"),
    };
    let has = |basis| points.iter().any(|p| p.interval.is_some() && p.basis == basis);
    let intervals = [
        (None, "Student's 95 % intervals over maps"),
        (Some(IntervalBasis::Exact), "exact 95 % intervals (Clopper and Pearson) of shares"),
        (
            Some(IntervalBasis::Conservative),
            "95 % intervals (Clopper and Pearson) of shares that take all runs on a map for one trial",
        ),
    ];
    let intervals: Vec<&str> =
        intervals.into_iter().filter(|(basis, _)| has(*basis)).map(|(_, text)| text).collect();
    match intervals.is_empty() {
        true => text,
        false => format!("{text}, with {}", intervals.join(" and ")),
    }
}

/// "3 to 5 maps, 2 runs on each", from numbers of blocks and rows; `None` without rows.
pub fn maps_and_runs(counts: &[(usize, usize)], of_runs: bool) -> Option<String> {
    let several = |numbers: Vec<usize>, what: &str| {
        let (least, most) = (numbers.iter().min()?, *numbers.iter().max()?);
        let range = if *least == most { String::new() } else { format!("{least} to ") };
        Some((most, range + &counted(most, what)))
    };
    let counts = || counts.iter().filter(|(blocks, _)| *blocks > 0);
    let (_, maps) = several(counts().map(|(blocks, _)| *blocks).collect(), "map")?;
    let runs = several(counts().map(|(blocks, rows)| rows / blocks).collect(), "run");
    let runs = runs.filter(|(most, _)| of_runs && *most > 1);
    Some(maps + &runs.map_or(String::new(), |(_, runs)| format!(", {runs} on each")))
}

/// "beams 3deg (carmen), all (book)": a setting determined by presets.
fn by_preset(groups: &Groups<'_>, shown: &[&Group<'_>], place: usize) -> Option<String> {
    let preset = groups.place(PRESET)?;
    if !groups.decided_by_preset(shown).contains(&place) {
        return None;
    }
    let pairs = groups.combinations(shown, &[place, preset]);
    let (mut values, mut texts): (Vec<&[Value]>, Vec<String>) = Default::default();
    for pair in &pairs {
        let [own, of] = &pair[..] else { return None };
        if own.iter().chain(of).any(Value::is_empty) {
            return None;
        }
        if !values.contains(&&own[..]) {
            values.push(own);
        }
        texts.push(format!("{} ({})", text_of(own), text_of(of)));
    }
    let name = &groups.settings[place].name;
    (values.len() > 1 && CAPTIONED_BY_PRESET.contains(&name.as_str()))
        .then(|| format!("{} {}", name_and_unit(name).0, texts.join(", ")))
}

fn setting(groups: &Groups<'_>, shown: &[&Group<'_>], place: usize) -> Option<String> {
    let shown: Vec<&Group<'_>> =
        shown.iter().copied().filter(|group| groups.matters(group, place)).collect();
    let values = match &distinct(groups, &shown, place)[..] {
        [values] if values.iter().all(|value| !value.is_empty()) => values.clone(),
        _ => return None,
    };
    let text = text_of(&values);
    let setting = groups.settings[place].name.as_str();
    Some(match (setting, &values[..]) {
        ("map", _) => format!("maps {text}"),
        ("size_percent", _) => format!("size {text} % of the points"),
        ("particles", _) => format!("{text} particles"),
        (PRESET, _) => format!("preset {text}"),
        ("beams", _) => format!("{text} beams"),
        ("proposal", _) => format!("proposal {text}"),
        ("sigma_hit", _) if text == SigmaHit::Auto.to_string() => {
            "σ_hit by the map's spacing".to_owned()
        }
        ("motion", _) if text == MotionKind::Book.name() => return None,
        ("motion", _) => format!("motion {text}"),
        ("start", _) if text == Start::First.name() => {
            "each run from the first pose of the log".to_owned()
        }
        ("start", _) => "each run from a start of its own, anywhere in the log".to_owned(),
        ("length", _) => format!("{text} scans per run"),
        ("people_share" | "lost_beams" | "slip_share", _) if text == "0" => return None,
        ("kidnapped_at", _) => format!("carried off after {text} of the scans"),
        ("recover", _) => match text.as_str() {
            "true" => "with recovery".to_owned(),
            _ => return None,
        },
        ("noise", [xy, theta]) => format!("noise added to the odometry {xy} m and {theta} rad"),
        _ => value(setting, &text),
    })
}

/// "σ_hit = 0.3 m".
pub fn value(setting: &str, text: &str) -> String {
    let (name, unit) = name_and_unit(setting);
    // A word, such as auto, has no unit.
    let unit = if text.starts_with(char::is_alphabetic) { "" } else { unit };
    format!("{name} = {text} {unit}").trim_end().to_owned()
}

/// With its first letter in upper case, if it is a letter with one; σ is unchanged.
fn capitalized(text: &str) -> String {
    let mut chars = text.chars();
    match chars.next() {
        Some(first) if first.is_ascii() => first.to_ascii_uppercase().to_string() + chars.as_str(),
        _ => text.to_owned(),
    }
}
