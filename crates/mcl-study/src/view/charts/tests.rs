//! Charts of planted rows.

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
        let diverged = row.text("map") == "gbs" && size == 0.5 && row.number("run") == Some(7.0);
        // A refinement drops duplicates.
        let real = if row.text("map") == "gbs+f-km" { 0.9 * size } else { size };
        let error = 1.0 + draw / size;
        vec![
            ("real_percent", real.into()),
            ("weighted", error.into()),
            ("diverged", diverged.into()),
        ]
    });
    let charts = charts(&Estimates::of(&results).unwrap()).unwrap();
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
    let [own, described] = &same.caption[..] else { panic!("{:?}", same.caption) };
    assert_eq!(own, "Own words.");
    assert_eq!(
        described,
        "Planted: 910 scans, 10,000 points with 0 < r ≤ 10 m. Map and runs use the same scans, as in \
         the paper. Means over 5 maps, 2 runs on each, with Student's 95 % intervals over maps. Preset \
         default, 500 particles, proposal adaptive, all beams, σ_hit by the map's spacing, z_rand = 0.8, motion \
         gaussian, noise added to the odometry 0.01 m and 0.02 rad, σ = 0.05 m, each run from the first \
         pose of the log. On all points: 1.020 (1.000 to 1.040). gbs: grid-based sampling, f-km: \
         improved by fuzzy k-means."
    );
    let table = same.to_table();
    assert_eq!(table.len(), 10);
    assert_eq!(
        String::from_utf8(table.to_csv().unwrap()).unwrap().lines().nth(1).unwrap(),
        format!(
            "all sizes,{},gbs,0.5,5,{},{},5,10,1/10",
            whole.y.label,
            whole.points[0].interval.unwrap()[0],
            whole.points[0].interval.unwrap()[1]
        )
    );
}

#[test]
fn missing_trials_are_in_the_caption() {
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
    let complete = charts(&Estimates::of(&results).unwrap()).unwrap();
    assert!(complete[0].caption[0].contains("Means over 4 maps, with Student's"));
    let results = results.without(3, |row| {
        row.text("map") == "rnd"
            && row.number("draw") > Some(0.0)
            && row.number("size_percent") == Some(2.0)
    });
    let chart = &charts(&Estimates::of(&results).unwrap()).unwrap()[0];
    assert!(chart.caption[0].contains(". Incomplete: 13 of 16 trials. "), "{:?}", chart.caption);
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
    let chart = &charts(&Estimates::of(&results).unwrap()).unwrap()[0];
    // The column has no label for the heading.
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
[base]
motion = "book"
sigma_hit = 0.3
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
    charts(&Estimates::of(&results).unwrap()).unwrap()
}

/// Without x: the numeric setting with the most values is the axis, the setting with the next most gives
/// curves, and all others panels, so that nothing is averaged over settings.
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
    // Pairs of numbers are shown at their positions in the list.
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

/// Scores of a sweep above the smallest, and the choices of the data.
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
    let drawn = charts(&Estimates::of(&results).unwrap()).unwrap();
    let [bic, mdl, ..] = &drawn[0].panels[..] else { panic!() };
    assert_eq!(labels(bic), ["gbs"]);
    let points = |panel: &Panel| -> Vec<(f64, f64, Option<String>)> {
        let of_point = |point: &Point| (point.x, (1e6 * point.y).round() / 1e6, point.mark.clone());
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
    let chart = &charts(&Estimates::of(&results).unwrap()).unwrap()[0];
    assert_eq!(titles(chart), ["σ_hit = 0.1 m", "σ_hit = 0.2 m"]);
    for panel in &chart.panels {
        let y: Vec<f64> = panel.points.iter().map(|point| (1e9 * point.y).round() / 1e9).collect();
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
