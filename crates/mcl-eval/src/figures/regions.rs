//! Verdicts over two settings as a heat map.

use std::path::{Path, PathBuf};

use anyhow::Result;
use mcl_core::text::number;
use mcl_figures::{HeatCell, HeatFigure, HeatPanel, Medium, draw_heat};
use mcl_study::study::settings::text_of;
use mcl_study::view::labels::axis_label;

use crate::claims::claim::Verdict;
use crate::claims::regions::Verdicts;

/// Draws a panel per statement.
///
/// # Errors
/// When a file cannot be written.
pub fn draw(stem: &Path, region: &Verdicts<'_>, medium: Medium) -> Result<Vec<PathBuf>> {
    Ok(draw_heat(stem, &figure(region), medium)?)
}

fn figure(region: &Verdicts<'_>) -> HeatFigure {
    let [x, y] = [0, 1].map(|axis| {
        region.values[axis].iter().map(|values| text_of(values)).collect::<Vec<String>>()
    });
    let statements = region.cells.first().map_or(&[][..], |(_, claims)| claims);
    let panels = statements.iter().enumerate().map(|(panel, statement)| {
        let mut cells = vec![None; x.len() * y.len()];
        for (at, claims) in &region.cells {
            let claim = &claims[panel];
            let (value, verdict) = match claim.verdict {
                Verdict::Reproduced => (1.0, "yes"),
                Verdict::NotReproduced => (0.0, "no"),
                Verdict::NotTestable => continue,
            };
            let effect = claim.evidence.effect.map(|effect| format!(" {}", number(effect)));
            let text = format!("{verdict}{}", effect.unwrap_or_default());
            cells[at[1] * x.len() + at[0]] = Some(HeatCell { value, text });
        }
        HeatPanel {
            title: statement.statement.to_owned(),
            x_label: axis_label(&region.view.x),
            y_label: axis_label(&region.view.y),
            x: x.clone(),
            y: y.clone(),
            cells,
        }
    });
    let key = [(Some(1.0), "holds"), (Some(0.0), "does not hold"), (None, "not testable")];
    HeatFigure {
        panels: panels.collect(),
        log: false,
        label: String::new(),
        key: key.map(|(value, name)| (value, name.to_owned())).to_vec(),
        caption: region.caption.clone(),
    }
}
