//! The most important numbers, of maps of one size.

use mcl_core::math;
use mcl_core::text::numbers as with_distinct_digits;
use mcl_filter::Preset;
use mcl_metrics::BlockedRate;
use mcl_study::recipe::split::Split;
use mcl_study::store::results::Results;

use crate::claims::cells::{Cell, Sampled, Sizes, kinds};
use crate::claims::claim::{Conditions, Untestable};

/// The preferred size (%); the nearest one is shown.
const SIZE: f64 = 1.0;

/// The measurements on maps of the four kinds with one size.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers {
    /// The data set.
    pub dataset: String,
    /// Whether robots were localized.
    pub of_runs: bool,
    /// What the numbers are, with unit.
    pub what: String,
    /// Size of the maps (% of the points).
    pub percent: f64,
    /// By kind of map: "gbs 0.0269 (0 of 20)".
    pub kinds: Vec<String>,
}

/// Mean log-likelihood and mean error of each data set in the plane for which all four kinds of map have
/// them: under the conditions of the paper, with its authors' filter and on the scans that built the map, or
/// else under the available ones.
pub fn numbers(results: &[Results]) -> Vec<Numbers> {
    let mut found: Vec<Numbers> = Vec::new();
    for results in results.iter().filter(|results| results.facts.dimensions == 2) {
        for of_runs in [false, true] {
            let column = if of_runs { "weighted" } else { "log_likelihood" };
            let Ok(mut places) = Sampled::of(results, column, of_runs) else { continue };
            places.sort_by_key(|data| preference(&data.place));
            let Some(data) = places.first() else { continue };
            let dataset = &results.facts.name;
            let is_known = found.iter().any(|n| n.dataset == *dataset && n.of_runs == of_runs);
            found.extend((!is_known).then(|| of(data, column, of_runs).ok()).flatten());
        }
    }
    found.sort_by(|a, b| (&a.dataset, a.of_runs).cmp(&(&b.dataset, b.of_runs)));
    found
}

/// Sort key of several places: the conditions of the paper come first.
pub(super) fn preference(place: &Conditions) -> [bool; 2] {
    let is_papers = |preset: &String| *preset == Preset::Carmen.to_string();
    [
        place.split.is_some_and(|split| split != Split::Same),
        !place.preset.as_ref().is_none_or(is_papers),
    ]
}

fn of(data: &Sampled<'_>, column: &str, of_runs: bool) -> Result<Numbers, Untestable> {
    let by_kind = data.all_cells(&Sizes::ALL)?;
    let is_everywhere =
        |size: f64| by_kind.iter().all(|cells| cells.iter().any(|cell| cell.percent == size));
    let sizes =
        by_kind.iter().flatten().map(|cell| cell.percent).filter(|size| is_everywhere(*size));
    let distance = |size: f64| math::ln(size / SIZE).abs();
    let percent = sizes.min_by(|a, b| distance(*a).total_cmp(&distance(*b)));
    let percent = percent.ok_or_else(|| Untestable("no size that all kinds have".to_owned()))?;
    let cells = by_kind.iter().flatten().filter(|cell| cell.percent == percent);
    let cells: Vec<&Cell<'_>> = cells.collect();
    let values = cells.iter().map(|cell| Ok(cell.values(column)?.mean_of_blocks()));
    let values = values.collect::<Result<Vec<f64>, Untestable>>()?;
    // The error of a lost run is not representative of the others.
    let values = match of_runs {
        true => values.iter().map(|error| format!("{error:.4}")).collect(),
        false => with_distinct_digits(&values),
    };
    let mut shown = Vec::new();
    for kind in kinds() {
        for (cell, value) in cells.iter().zip(&values).filter(|(cell, _)| cell.kind == kind) {
            let lost = if of_runs { lost(cell)? } else { String::new() };
            shown.push(format!("{kind} {value}{lost}"));
        }
    }
    let preset = data.place.preset.as_ref().map_or(String::new(), |preset| format!(", {preset}"));
    let what = match of_runs {
        true => format!("mean error d (diverged runs){preset}"),
        false => "log-likelihood, nats per point".to_owned(),
    };
    let dataset = data.place.dataset.clone();
    Ok(Numbers { dataset, of_runs, what, percent, kinds: shown })
}

/// " (3 of 20)"
fn lost(cell: &Cell<'_>) -> Result<String, Untestable> {
    let diverged = cell.values("diverged")?;
    let rate = BlockedRate::new(diverged.values().map(|(draw, hit)| (draw, hit > 0.0)))?.of_units();
    Ok(format!(" ({} of {})", rate.hits(), rate.trials()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::claims::planted;

    #[test]
    fn numbers_are_those_of_the_size_next_to_one_percent() {
        let of_likelihood = planted::likelihood(&[0.5, 2.0, 20.0], |is_random, size, _| {
            let initial = if is_random { -9.0 } else { -8.0 } + size;
            (initial, initial + 1.0)
        });
        let localized = planted::localization(&[0.1, 1.0], |kind, size, run, _| match kind {
            "rnd" if run == 1 => 4.0,
            "rnd" => 0.05,
            _ => 0.03 + 0.01 * size,
        });
        let found = numbers(&[localized, of_likelihood]);
        let [likelihood, errors] = &found[..] else { panic!("{found:?}") };
        // 0.5 and 2 are equally near to 1: the smaller one.
        assert_eq!((likelihood.percent, likelihood.of_runs), (0.5, false));
        assert_eq!(
            likelihood.kinds,
            ["gbs −7.50", "gbs+f-km −6.50", "rnd −8.50", "rnd+f-km −7.50"]
        );
        assert_eq!((errors.percent, errors.of_runs), (1.0, true));
        assert_eq!(errors.kinds[0], "gbs 0.0400 (0 of 8)");
        assert_eq!(errors.kinds[2], "rnd 0.5437 (1 of 8)");
    }
}
