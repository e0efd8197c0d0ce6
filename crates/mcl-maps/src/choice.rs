//! Minimization of a costly, not quite smooth score over a positive number that spans orders of magnitude.

use mcl_core::math;

/// Golden ratio: 1.618…
const GOLDEN: f64 = 1.618_033_988_749_895;

/// A value with its score.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Tried {
    /// The value.
    pub value: f64,
    /// Its score; smaller is better.
    pub score: f64,
}

/// Settings of [`minimize`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Search {
    /// Smallest and largest value to try; positive.
    pub range: [f64; 2],
    /// Ratio of successive values in the first pass, from the smallest up.
    pub factor: f64,
    /// The first pass stops after this many values in a row that are worse than the best.
    pub patience: usize,
    /// The search stops when the best value is known within this ratio.
    pub precision: f64,
}

/// Searches for the value with the smallest score: first at equal ratios, then between the neighbours of the best
/// by golden section search in the logarithm. Exact for scores with one minimum; otherwise it finds a good value near
/// the best of the first pass. Returns all values tried, sorted by value; [`best`] selects the result.
///
/// # Errors
/// The first error returned by `score`.
pub fn minimize<E>(
    search: &Search,
    mut score: impl FnMut(f64) -> Result<f64, E>,
) -> Result<Vec<Tried>, E> {
    let Search { range: [low, high], factor, patience, precision } = *search;
    let mut tried: Vec<Tried> = Vec::new();
    let mut best = f64::INFINITY;
    let mut worse = 0;
    let mut value = low;
    while worse < patience && (tried.is_empty() || value < high * factor) {
        let value_tried = value.min(high);
        let score = score(value_tried)?;
        tried.push(Tried { value: value_tried, score });
        worse = if score < best { 0 } else { worse + 1 };
        best = best.min(score);
        value *= factor;
    }
    let at = (0..tried.len()).min_by(|&a, &b| tried[a].score.total_cmp(&tried[b].score));
    let Some(at) = at else { return Ok(tried) };
    let mut below = math::ln(tried[at.saturating_sub(1)].value);
    let mut above = math::ln(tried[(at + 1).min(tried.len() - 1)].value);
    let mut middle = (math::ln(tried[at].value), tried[at].score);
    // The larger of the two parts is split.
    while above - below > 2.0 * math::ln(precision) {
        let larger_is_above = above - middle.0 > middle.0 - below;
        let place = match larger_is_above {
            true => middle.0 + (above - middle.0) * (2.0 - GOLDEN),
            false => middle.0 - (middle.0 - below) * (2.0 - GOLDEN),
        };
        let value = math::exp(place);
        let found = score(value)?;
        tried.push(Tried { value, score: found });
        match (found < middle.1, larger_is_above) {
            (true, true) => (below, middle) = (middle.0, (place, found)),
            (true, false) => (above, middle) = (middle.0, (place, found)),
            (false, true) => above = place,
            (false, false) => below = place,
        }
    }
    tried.sort_by(|a, b| a.value.total_cmp(&b.value));
    Ok(tried)
}

/// Returns the value with the smallest score; of equal scores the smallest value.
pub fn best(tried: &[Tried]) -> Option<Tried> {
    tried.iter().copied().min_by(|a, b| a.score.total_cmp(&b.score))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn finds_the_only_minimum(minimum in 1.0..5000.0f64, steepness in 0.1..10.0f64) {
            let search = Search { range: [1.0, 5000.0], factor: 2.0, patience: 2, precision: 1.02 };
            let score = |value: f64| Ok::<_, ()>(steepness * (value / minimum).ln().powi(2));
            let tried = minimize(&search, score).unwrap();
            let found = best(&tried).unwrap().value;
            prop_assert!((found / minimum).ln().abs() <= 2.0 * 1.02f64.ln(), "{found} for {minimum}");
            prop_assert!(tried.len() < 30 && tried.windows(2).all(|pair| pair[0].value <= pair[1].value));
            prop_assert!(tried.iter().all(|tried| (0.99..=5001.0).contains(&tried.value)));
        }
    }

    #[test]
    fn a_score_that_only_falls_is_followed_to_the_end() {
        let search = Search { range: [2.0, 77.0], factor: 2.0, patience: 2, precision: 1.05 };
        let tried = minimize(&search, |value| Ok::<_, ()>(-value)).unwrap();
        assert_eq!(best(&tried).unwrap().value, 77.0);
        let tried = minimize(&search, Ok::<_, ()>).unwrap();
        assert_eq!(best(&tried).unwrap().value, 2.0);
        assert!(minimize(&search, |_| Err("no score")).is_err());
    }
}
