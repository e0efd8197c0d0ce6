//! Figures as files: valid, with ink where it belongs, the same bytes again, and no panic on odd rows.

use std::path::{Path, PathBuf};

use mcl_figures::*;
use resvg::tiny_skia::Pixmap;
use resvg::usvg;
use tempfile::TempDir;

const NAN: f64 = f64::NAN;

/// What was written: the SVG's text and the picture.
struct Drawn {
    svg: String,
    png: Pixmap,
    bytes: Vec<Vec<u8>>,
}

fn load(paths: Vec<PathBuf>) -> Drawn {
    let bytes: Vec<Vec<u8>> = paths.iter().map(|path| std::fs::read(path).unwrap()).collect();
    let svg = String::from_utf8(bytes[0].clone()).unwrap();
    usvg::Tree::from_str(&svg, &usvg::Options::default()).expect("a valid SVG");
    Drawn { svg, png: Pixmap::decode_png(&bytes[1]).expect("a valid PNG"), bytes }
}

fn clouds(figure: &CloudFigure) -> Result<Drawn, FigureError> {
    let folder = tempfile::tempdir().unwrap();
    draw_clouds(&folder.path().join("figure"), figure, Medium::Screen).map(load)
}

fn curves(figure: &CurveFigure) -> Result<Drawn, FigureError> {
    let folder = tempfile::tempdir().unwrap();
    draw_curves(&folder.path().join("figure"), figure, Medium::Screen).map(load)
}

fn heat(figure: &HeatFigure) -> Result<Drawn, FigureError> {
    let folder = tempfile::tempdir().unwrap();
    draw_heat(&folder.path().join("figure"), figure, Medium::Screen).map(load)
}

impl Drawn {
    fn texts(&self) -> Vec<String> {
        let document = usvg::roxmltree::Document::parse(&self.svg).unwrap();
        document
            .descendants()
            .filter(|node| node.has_tag_name("text"))
            .map(|node| node.text().unwrap_or_default().trim().to_owned())
            .collect()
    }

    /// Boxes of the embedded pictures in pixels of the PNG: left, top, width, height.
    fn windows(&self) -> Vec<[f64; 4]> {
        let document = usvg::roxmltree::Document::parse(&self.svg).unwrap();
        let scale = f64::from(self.png.width()) / 760.0;
        document
            .descendants()
            .filter(|node| node.has_tag_name("image"))
            .map(|node| {
                ["x", "y", "width", "height"]
                    .map(|name| node.attribute(name).unwrap().parse::<f64>().unwrap() * scale)
            })
            .collect()
    }

    /// The darkest pixel (0 black, 255 white) around a place in pixels.
    fn darkest(&self, x: f64, y: f64, reach: i32) -> u8 {
        let mut darkest = 255;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let (x, y) = (x as i32 + dx, y as i32 + dy);
                let pixel = self.png.pixel(x as u32, y as u32).expect("a place on the page");
                darkest = darkest.min(pixel.red().max(pixel.green()).max(pixel.blue()));
            }
        }
        darkest
    }

    fn assert_blank_margins(&self) {
        for y in 0..self.png.height() {
            for x in (0..30).chain(2250..2280) {
                assert_eq!(
                    self.png.pixel(x, y).unwrap().green(),
                    255,
                    "ink in the margin at {x}, {y}"
                );
            }
        }
    }

    /// Number of pixels of about a colour.
    fn count(&self, [red, green, blue]: [u8; 3]) -> usize {
        let near = |a: u8, b: u8| a.abs_diff(b) < 12;
        let is = |p: &&resvg::tiny_skia::PremultipliedColorU8| {
            near(p.red(), red) && near(p.green(), green) && near(p.blue(), blue)
        };
        self.png.pixels().iter().filter(is).count()
    }
}

fn panel<'a>(title: &str, points: &'a [[f64; 2]]) -> CloudPanel<'a> {
    CloudPanel { title: title.into(), points, shades: &[], paths: vec![], start: None }
}

fn cloud_figure(panels: Vec<CloudPanel>) -> CloudFigure {
    let caption = vec!["Simulated office, σ = 0.05 m.".into()];
    CloudFigure { panels, labels: CloudLabels::PLANE, caption }
}

/// A map of `columns`, with a cell for each value and its text.
fn heat_figure(columns: usize, cells: &[Option<(f64, &str)>]) -> HeatFigure {
    let names = |count: usize, axis: &str| (0..count).map(|i| format!("{axis}{i}")).collect();
    let cell = |&(value, text): &(f64, &str)| HeatCell { value, text: text.to_owned() };
    let panel = HeatPanel {
        title: "a map of settings".into(),
        x_label: "σ [m]".into(),
        y_label: "map size [%]".into(),
        x: names(columns, "x"),
        y: names(cells.len() / columns.max(1), "y"),
        cells: cells.iter().map(|content| content.as_ref().map(cell)).collect(),
    };
    let caption = vec!["Simulated office, 20 runs.".into()];
    HeatFigure { panels: vec![panel], log: false, label: "error [m]".into(), key: vec![], caption }
}

fn point(x: f64, mean: f64) -> CurvePoint {
    CurvePoint { interval: Some([mean - 0.1, mean + 0.1]), ..CurvePoint::bare(x, mean) }
}

fn curve_figure(curves: Vec<Vec<CurvePoint>>) -> CurveFigure {
    let curves = curves.into_iter().enumerate().map(|(index, points)| Curve {
        label: format!("curve {index}"),
        style: CurveStyle { marker: Some(Marker::Square), ..CurveStyle::line(index) },
        points,
    });
    CurveFigure {
        columns: 1,
        panels: vec![CurvePanel {
            title: "all sizes".into(),
            x: AxisSpec::linear("map size [%]"),
            y: AxisSpec::linear("error [m]"),
            curves: curves.collect(),
        }],
        caption: vec!["Simulated office, 20 runs.".into()],
    }
}

#[test]
fn points_have_ink_where_they_are() {
    // The corners of a square and a lone point near its middle, drawn as dots; then the same as a
    // density, beside a wall of many points.
    let few = [[0.0, 0.0], [10.0, 0.0], [0.0, 10.0], [10.0, 10.0], [4.0, 5.0]];
    let mut many = few.to_vec();
    many.extend((0..60_000).map(|i| [10.0, f64::from(i) / 6000.0]));
    let drawn = clouds(&cloud_figure(vec![panel("few", &few), panel("many", &many)])).unwrap();
    let windows = drawn.windows();
    assert_eq!(windows.len(), 2);
    for [left, top, width, height] in windows {
        assert!((width - height).abs() < 1e-9, "a square of data must stay a square");
        // The window has room of 2 % on every side.
        let place = |x: f64, y: f64| {
            (left + width * (x + 0.2) / 10.4, top + height * (1.0 - (y + 0.2) / 10.4))
        };
        for [x, y] in few {
            let at = place(x, y);
            assert!(drawn.darkest(at.0, at.1, 2) < 200, "no ink at {x}, {y}");
        }
        let empty = place(7.0, 3.0);
        assert_eq!(drawn.darkest(empty.0, empty.1, 20), 255);
    }
    let [left, top, width, height] = drawn.windows()[1];
    let wall = drawn.darkest(left + width * 10.2 / 10.4, top + 0.7 * height, 1);
    let lone = drawn.darkest(left + width * 4.2 / 10.4, top + height * 0.5, 3);
    assert!(wall < lone, "a wall ({wall}) must be darker than a lone point ({lone})");
}

#[test]
fn clouds_say_what_they_show_but_hold_no_coordinates() {
    let points: Vec<_> = (0..40).map(|i| [f64::from(i) * 0.731, 17.123]).collect();
    let mut second = panel("grid-based map, 40 points (0.8 %)", &points);
    let style = CurveStyle { color: 1, dash: Dash::Dashed, marker: Some(Marker::Circle) };
    second.paths =
        vec![CloudPath { label: "estimated path".into(), style, points: &points, is_cut: false }];
    second.start = Some(points[0]);
    let figure = cloud_figure(vec![panel("all data", &points), second]);
    let drawn = clouds(&figure).unwrap();
    let texts = drawn.texts().join(" ");
    for text in ["all data", "grid-based map, 40 points (0.8 %)", "estimated path", "x [m]"] {
        assert!(texts.contains(text), "{text} in {texts}");
    }
    assert!(texts.contains("Simulated office, σ = 0.05 m."));
    assert!(!drawn.svg.contains("<circle") && !drawn.svg.contains("17.123"));
    assert!(drawn.count([0xD5, 0x5E, 0x00]) > 500, "the path is drawn in its colour");
}

/// Fault: three panels of a square building stood above each other, on 4,500 pixels.
#[test]
fn maps_of_any_shape_and_number_fit_a_page() {
    for (wide, high) in [(30.0, 30.0), (60.0, 15.0), (15.0, 60.0), (200.0, 10.0)] {
        let corners = [[0.0, 0.0], [wide, high]];
        for number in [1, 3, 4] {
            let title = "grid-based map (gbs): 1,245 points (0.80 %), −11.20 nats per point";
            let drawn = clouds(&cloud_figure(vec![panel(title, &corners); number])).unwrap();
            // An A4 page within margins, at this width, has 1.5 times as much height.
            let limit = 1.5 * f64::from(drawn.png.width());
            assert!(f64::from(drawn.png.height()) < limit, "{number} of {wide} x {high}");
            let windows = drawn.windows();
            assert_eq!(windows.len(), number);
            assert!(windows.iter().all(|window| window[2] > 150.0), "{windows:?}");
        }
    }
}

#[test]
fn odd_clouds_are_drawn_or_refused() {
    let odd: [&[[f64; 2]]; 6] = [
        &[[3.0, 4.0]],
        &[[1e12, -1e12]],
        &[[5.0, 5.0], [5.0, 5.0]],
        &[[0.0, 0.0], [1000.0, 0.0]],
        &[[0.0, -500.0], [0.0, 500.0]],
        &[[-1e12, -1e12], [1e12, 1e12]],
    ];
    for points in odd {
        let drawn = clouds(&cloud_figure(vec![panel("a", points), panel("b", &[])])).unwrap();
        assert!(drawn.texts().contains(&"no points".to_owned()));
    }
    let with_nan = [[1.0, 2.0], [NAN, 0.0], [0.0, f64::INFINITY]];
    let texts = clouds(&cloud_figure(vec![panel("a", &with_nan)])).unwrap().texts();
    assert!(texts.iter().any(|text| text.starts_with("Left out: 2 points")), "{texts:?}");
    for panels in [vec![], vec![panel("a", &[])], vec![panel("a", &with_nan[1..])]] {
        let error = clouds(&cloud_figure(panels)).err().expect("nothing to draw");
        assert!(matches!(error, FigureError::NothingToDraw { .. }), "{error}");
    }
}

#[test]
fn curves_have_labels_ink_and_marks() {
    let mut second = vec![point(1.0, 2.0), point(5.0, 1.0), point(10.0, 0.5)];
    second[0].mark = Some("3/20".into());
    let mut figure = curve_figure(vec![vec![point(1.0, 1.0), point(10.0, 3.0)], second]);
    let mut zoomed = figure.panels[0].clone();
    zoomed.title = "below 6 % & more".into();
    zoomed.x.range = Some([0.0, 6.0]);
    figure.panels.push(zoomed);
    let drawn = curves(&figure).unwrap();
    let texts = drawn.texts();
    let count = |text: &str| texts.iter().filter(|found| *found == text).count();
    for once in ["curve 0", "curve 1", "all sizes", "below 6 % & more"] {
        assert_eq!(count(once), 1, "{once} in {texts:?}");
    }
    for twice in ["map size [%]", "error [m]", "3/20"] {
        assert_eq!(count(twice), 2, "{twice} in {texts:?}");
    }
    assert_eq!(count("Simulated office, 20 runs."), 1);
    assert!(drawn.count([0xD5, 0x5E, 0x00]) > 1000, "the second curve has its colour");
    assert_eq!(drawn.png.width(), 2280);
}

#[test]
fn lines_that_leave_the_axes_are_cut_not_bent() {
    // From 0 to 100 on an axis that ends at 10: gone at x = 1.
    let bare = CurvePoint::bare;
    let mut figure = curve_figure(vec![vec![bare(0.0, 0.0), bare(10.0, 100.0)]]);
    figure.panels[0].x.range = Some([0.0, 10.0]);
    figure.panels[0].y.range = Some([0.0, 10.0]);
    let drawn = curves(&figure).unwrap();
    let document = usvg::roxmltree::Document::parse(&drawn.svg).unwrap();
    let clip = document.descendants().find(|node| node.has_tag_name("clipPath")).unwrap();
    let window = clip.first_element_child().unwrap();
    let [left, top, width, height] = ["x", "y", "width", "height"]
        .map(|name| 3.0 * window.attribute(name).unwrap().parse::<f64>().unwrap());
    let darkest =
        |x: f64, y: f64| drawn.darkest(left + width * 0.1 * x, top + height * (1.0 - 0.1 * y), 4);
    assert_eq!(darkest(0.53, 5.3), 0);
    assert!(darkest(5.3, 5.3) > 200, "drawn to the corner of the chart");
    assert!(drawn.darkest(left + width * 0.11, top - 10.0, 2) > 200, "drawn beyond the chart");
}

#[test]
fn odd_curves_are_drawn_or_refused() {
    let odd_interval = Some([NAN, f64::INFINITY]);
    let bare = |x, mean| CurvePoint { interval: odd_interval, ..CurvePoint::bare(x, mean) };
    let odd = [
        vec![vec![bare(1.0, 1.0)], vec![]],
        vec![vec![bare(0.0, 0.0), bare(0.0, 0.0)]],
        vec![vec![bare(1.0, 1e-300), bare(2.0, 2e-300)]],
        vec![vec![bare(1.0, -1e199), bare(2.0, 1e199)]],
        vec![vec![bare(1e9, 7.0), bare(1e9 + 1e-6, 7.0)]],
        vec![vec![bare(1.0, 5.0), bare(NAN, 1.0), bare(2.0, NAN), bare(f64::INFINITY, 0.0)]],
    ];
    let scales = [Scale::Linear, Scale::Log, Scale::Symlog { linear_below: 1.0 }];
    let [linear, log, symlog] = scales;
    for rows in odd {
        for (x, y) in [(linear, linear), (log, symlog), (symlog, log)] {
            let mut figure = curve_figure(rows.clone());
            figure.panels[0].x.scale = x;
            figure.panels[0].y.scale = y;
            match curves(&figure) {
                Ok(drawn) => assert!(!drawn.svg.contains("NaN") && !drawn.svg.contains("inf")),
                // Zeros and negative numbers have no logarithm.
                Err(error) => assert!(x == log || y == log, "{error}"),
            }
        }
    }
    for rows in [vec![], vec![vec![]], vec![vec![bare(NAN, 1.0)]]] {
        let error = curves(&curve_figure(rows)).err().expect("nothing to draw");
        assert!(matches!(error, FigureError::NothingToDraw { .. }), "{error}");
    }
    for range in [[0.0, 0.0], [NAN, 1.0], [5.0, -5.0], [f64::NEG_INFINITY, f64::INFINITY]] {
        for scale in scales {
            let mut figure = curve_figure(vec![vec![point(1.0, 1.0), point(2.0, 2.0)]]);
            figure.panels[0].y.range = Some(range);
            figure.panels[0].y.scale = scale;
            let error = curves(&figure).err().expect("an impossible range");
            assert!(matches!(error, FigureError::Range { .. }), "{error}");
        }
    }
}

#[test]
fn heat_has_colours_and_texts_in_their_places() {
    let cells = [(1.0, "least"), (2.0, "right"), (3.0, "above"), (4.0, "most")];
    let figure = heat_figure(2, &cells.map(Some));
    let drawn = heat(&figure).unwrap();
    let document = usvg::roxmltree::Document::parse(&drawn.svg).unwrap();
    let find = |text: &str| {
        let mut nodes = document.descendants().filter(|node| node.has_tag_name("text"));
        nodes.find(|node| node.text().is_some_and(|found| found.trim() == text)).expect(text)
    };
    let place = |text: &str| {
        ["x", "y"].map(|name| find(text).attribute(name).unwrap().parse::<f64>().unwrap())
    };
    let [least, right, above, most] = cells.map(|(_, text)| place(text));
    assert!(least[0] < right[0] && least[1] == right[1], "x grows to the right");
    assert!(least[0] == above[0] && least[1] > above[1], "y grows upwards");
    assert_eq!([place("x1")[0], place("x0")[0]], [right[0], least[0]]);
    assert!((place("y1")[1] - most[1]).abs() < 2.0);
    for (text, color, fill) in
        [("least", [68, 1, 84], "#FFFFFF"), ("most", [223, 200, 30], "#000000")]
    {
        assert_eq!(find(text).attribute("fill"), Some(fill), "legible on its colour");
        let [x, y] = place(text).map(|place| (place * 3.0) as u32);
        let pixel = drawn.png.pixel(x - 70, y).unwrap();
        assert_eq!([pixel.red(), pixel.green(), pixel.blue()], color);
    }
    let texts = drawn.texts();
    for once in
        ["a map of settings", "σ [m]", "map size [%]", "error [m]", "Simulated office, 20 runs."]
    {
        assert_eq!(texts.iter().filter(|text| *text == once).count(), 1, "{once} in {texts:?}");
    }
    assert!(!texts.contains(&"no value".to_owned()));
    assert!(drawn.bytes == heat(&figure).unwrap().bytes);
}

#[test]
fn heat_follows_the_logarithm_if_asked() {
    let mut figure = heat_figure(3, &[Some((1.0, "")), Some((10.0, "")), Some((100.0, ""))]);
    let middle = |figure: &HeatFigure| heat(figure).unwrap().count([33, 145, 140]);
    let linear = middle(&figure);
    figure.log = true;
    assert!(middle(&figure) > linear + 5000, "10 is the middle between 1 and 100");
}

/// Verdicts are no values: a scale from 0 to 1 would say nothing of them.
#[test]
fn heat_of_classes_has_a_key() {
    let mut figure = heat_figure(3, &[Some((1.0, "yes")), Some((1.0, "yes")), None]);
    let names = ["holds", "does not hold", "not testable"];
    let values = [Some(1.0), Some(0.0), None];
    figure.key = values.into_iter().zip(names.map(str::to_owned)).collect();
    let drawn = heat(&figure).unwrap();
    let texts = drawn.texts();
    assert!(names.iter().all(|name| texts.iter().any(|text| text == name)), "{texts:?}");
    assert!(!texts.iter().any(|text| text == "no value" || text == "error [m]"), "{texts:?}");
    // Colours are those of the key, also where all cells are alike.
    let [yes, no] = [[223, 200, 30], [68, 1, 84]].map(|color| drawn.count(color));
    assert!(yes > 5000 && no > 300 && no < yes, "{yes} {no}");
    for cells in [vec![None], vec![]] {
        let columns = cells.len();
        let figure = HeatFigure { key: figure.key.clone(), ..heat_figure(columns, &cells) };
        assert_eq!(heat(&figure).is_ok(), columns == 1);
    }
}

#[test]
fn heat_says_what_has_no_value_and_no_room() {
    let endless = "W".repeat(10_000);
    let cells = [Some((2.0, "fine")), None, Some((NAN, "lost")), Some((1.0, endless.as_str()))];
    let drawn = heat(&heat_figure(2, &cells)).unwrap();
    let texts = drawn.texts();
    for text in [
        "no value",
        "fine",
        "lost",
        "Without a colour: 1 value not on its scale.",
        "Left out: 1 text too large for a cell.",
    ] {
        assert!(texts.iter().any(|found| found == text), "{text} in {texts:?}");
    }
    assert!(!drawn.svg.contains("WWW"));
    // The hatching, in the cell and in the legend.
    assert!(drawn.count([0xB8; 3]) > 300);
}

#[test]
fn odd_heat_maps_are_drawn_or_refused() {
    let odd: [&[f64]; 7] = [
        &[1.0],
        &[0.0; 4],
        &[-1e199, 1e199],
        &[5e-324, 1e-300],
        &[7.0, 7.0 + 1e-15],
        &[1.0, f64::INFINITY, f64::NEG_INFINITY, NAN, 1e300],
        &[3.0; 1000],
    ];
    for values in odd {
        let cells: Vec<_> = values.iter().map(|&value| Some((value, "x"))).collect();
        for columns in [1, values.len()] {
            for log in [false, true] {
                let figure = HeatFigure { log, ..heat_figure(columns, &cells) };
                match heat(&figure) {
                    Ok(drawn) => {
                        assert!(!drawn.svg.contains("NaN") && !drawn.svg.contains("inf"));
                        drawn.assert_blank_margins();
                    }
                    Err(error) => assert!(log && values == [0.0; 4], "{error}"),
                }
            }
        }
    }
    let nothing = HeatFigure { panels: vec![], ..heat_figure(0, &[]) };
    for figure in
        [nothing, heat_figure(0, &[]), heat_figure(1, &[None]), heat_figure(1, &[Some((NAN, "a"))])]
    {
        let error = heat(&figure).err().expect("nothing to draw");
        assert!(matches!(error, FigureError::NothingToDraw { .. }), "{error}");
    }
    let error = heat(&heat_figure(2, &[Some((1.0, "")); 3])).err().expect("a cell is missing");
    assert!(error.to_string().contains("holds 3 cells: expected 2 × 1"), "{error}");
    let mut figure = heat_figure(1, &[Some((1.0, ""))]);
    figure.panels.extend(heat_figure(0, &[]).panels);
    assert!(heat(&figure).unwrap().texts().contains(&"no data here".to_owned()));
}

#[test]
fn omitted_points_and_empty_panels_are_noted() {
    let mut figure = curve_figure(vec![vec![point(1.0, 1.0), point(2.0, NAN)]]);
    let mut beyond = figure.panels[0].clone();
    beyond.x.range = Some([50.0, 100.0]);
    figure.panels.push(beyond);
    let texts = curves(&figure).unwrap().texts();
    assert!(texts.contains(&"no data here".to_owned()), "{texts:?}");
    assert!(texts.iter().any(|text| text.starts_with("Left out: 2 points")), "{texts:?}");
}

#[test]
fn texts_of_any_kind_are_valid_xml() {
    let mut figure = curve_figure(vec![vec![point(1.0, 1.0), point(2.0, 2.0)]]);
    figure.panels[0].title = "a <b> & \"c\" \u{0} \u{1b}[1m 地図".into();
    figure.caption = vec!["'".repeat(300), String::new(), "\u{fffe} ]]> <!-- ".into()];
    curves(&figure).unwrap();
}

/// A name from a log put control characters and marks of direction into the SVG, and one of 10,000
/// letters ran over the edge of the page.
#[test]
fn names_from_data_are_shown_as_they_are_and_stay_on_the_page() {
    let name = format!("\u{202e}log\u{1b}[2J{}", "W".repeat(10_000));
    let mut figure = curve_figure(vec![vec![point(1.0, 1.0), point(2.0, 2.0)]]);
    figure.caption = vec![name.clone()];
    let curve_panel = &mut figure.panels[0];
    curve_panel.curves[0].points[0].mark = Some(name.clone());
    for text in [
        &mut curve_panel.title,
        &mut curve_panel.x.label,
        &mut curve_panel.y.label,
        &mut curve_panel.curves[0].label,
    ] {
        *text = name.clone();
    }
    let mut cloud = cloud_figure(vec![panel(&name, &[[0.0, 0.0], [9.0, 3.0]])]);
    cloud.caption = vec![name.clone()];
    let mut map = heat_figure(1, &[Some((1.0, "")), None]);
    let panel = &mut map.panels[0];
    for text in [&mut map.label, &mut panel.title, &mut panel.x_label, &mut panel.y_label] {
        *text = name.clone();
    }
    (panel.x[0], panel.y[0]) = (name.clone(), name.clone());
    for drawn in [curves(&figure).unwrap(), clouds(&cloud).unwrap(), heat(&map).unwrap()] {
        let texts = drawn.texts();
        let names: Vec<_> = texts.iter().filter(|text| text.contains("log")).collect();
        assert!(names.iter().any(|text| text.contains(r"\u{1b}[2JWW")), "{names:?}");
        for text in names {
            assert!(text.starts_with(r"\u{202e}log") && text.contains('…'), "{text}");
        }
        drawn.assert_blank_margins();
    }
}

#[test]
fn the_same_rows_give_the_same_bytes() {
    let figure = curve_figure(vec![vec![point(1.0, 1.0), point(2.0, 3.0)]; 6]);
    assert!(curves(&figure).unwrap().bytes == curves(&figure).unwrap().bytes);
    let points: Vec<_> = (0..500).map(|i| [f64::from(i).sin(), f64::from(i).cos()]).collect();
    let figure = cloud_figure(vec![panel("a", &points)]);
    assert!(clouds(&figure).unwrap().bytes == clouds(&figure).unwrap().bytes);
}

#[test]
fn files_are_named_after_the_whole_stem() {
    let folder: TempDir = tempfile::tempdir().unwrap();
    let figure = curve_figure(vec![vec![point(1.0, 1.0)]]);
    let drawn = draw_curves(&folder.path().join("map-0.8"), &figure, Medium::Screen).unwrap();
    let [svg, png] = &drawn[..] else { panic!("{drawn:?}") };
    assert_eq!(*svg, folder.path().join("map-0.8.svg"));
    assert_eq!(*png, folder.path().join("map-0.8.png"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    let error = draw_curves(Path::new("absent/figure"), &figure, Medium::Screen).unwrap_err();
    assert!(matches!(error, FigureError::Write { .. }), "{error}");
}

/// For a paper: a column wide, no caption in the figure, and a PDF whose text is text.
#[test]
fn figures_for_papers_fit_a_column() {
    let folder = tempfile::tempdir().unwrap();
    let stem = folder.path().join("figure");
    let mut figure = curve_figure(vec![vec![point(1.0, 1.0), point(2.0, 3.0)]; 2]);
    for (columns, inches) in [(1, 3.5), (2, 7.0)] {
        figure.columns = columns;
        figure.panels = vec![figure.panels[0].clone(); columns];
        let drawn = draw_curves(&stem, &figure, Medium::Paper).unwrap();
        let endings = drawn.iter().map(|path| path.extension().unwrap().to_str().unwrap());
        assert_eq!(endings.collect::<Vec<_>>(), ["svg", "png", "pdf", "txt"]);
        let pdf = std::fs::read(&drawn[2]).unwrap();
        let text = String::from_utf8_lossy(&pdf);
        assert!(text.starts_with("%PDF-1.") && text.contains("/FontFile2"), "a font is embedded");
        let page = text.split("/MediaBox [").nth(1).unwrap().split(']').next().unwrap();
        let width: f64 = page.split_whitespace().nth(2).unwrap().parse().unwrap();
        assert!((width - 72.0 * inches).abs() < 0.5, "{page}");
        let caption = std::fs::read_to_string(&drawn[3]).unwrap();
        assert!(!caption.trim().is_empty() && figure.caption.iter().all(|c| caption.contains(c)));
        let svg = std::fs::read_to_string(&drawn[0]).unwrap();
        assert!(figure.caption.iter().all(|paragraph| !svg.contains(paragraph)), "{svg}");
    }
    let points: Vec<_> = (0..50).map(|i| [f64::from(i), f64::from(i * i)]).collect();
    let maps = cloud_figure(vec![panel("a", &points)]);
    let drawn = draw_clouds(&stem, &maps, Medium::Paper).unwrap();
    let pdf = std::fs::read(&drawn[2]).unwrap();
    assert!(String::from_utf8_lossy(&pdf).contains("/Subtype /Image"), "points are a picture");
    let cells = heat_figure(2, &[Some((1.0, "1.00")), Some((2.0, "2.00"))]);
    assert_eq!(draw_heat(&stem, &cells, Medium::Paper).unwrap().len(), 4);
}
