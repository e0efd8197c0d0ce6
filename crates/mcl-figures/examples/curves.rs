//! A chart of two curves as `curves.svg` and `curves.png` in the folder for temporary files.

use mcl_figures::{
    AxisSpec, Curve, CurveFigure, CurvePanel, CurvePoint, Medium, draw_curves, styles,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let labels = ["gbs", "gbs+f-km"];
    let curves =
        labels.iter().zip(styles(&labels)).zip([0.030, 0.026]).map(|((label, style), least)| {
            let point = |i: u32| {
                let (x, mean) = (f64::from(i), least + 0.02 / f64::from(i));
                CurvePoint { x, mean, interval: Some([mean - 0.001, mean + 0.001]), mark: None }
            };
            Curve { label: (*label).to_owned(), style, points: (1..=10).map(point).collect() }
        });
    let panel = CurvePanel {
        title: "Error over map size".to_owned(),
        x: AxisSpec::linear("map size [% of the points]"),
        y: AxisSpec::linear("weighted error d"),
        curves: curves.collect(),
    };
    let figure = CurveFigure { panels: vec![panel], columns: 1, caption: Vec::new() };
    for path in draw_curves(&std::env::temp_dir().join("curves"), &figure, Medium::Screen)? {
        println!("{}", path.display());
    }
    Ok(())
}
