//! Section IV: how grid-based sampling chooses points.

use mcl_core::{NearestNeighbors, PointMap};

use super::claim::{Claim, Finding, Section, Statement, Untestable};
use super::saved::LikelihoodResults;
use crate::experiment::Builder;

pub(super) const CLAIMS: [fn(&LikelihoodResults) -> Claim; 3] =
    [even_spread, size_not_exact, cost_of_grid];

fn even_spread(data: &LikelihoodResults) -> Claim {
    let statement = Statement {
        id: "even-spread",
        section: Section::InitialMap,
        text: "Grid-based maps spread their points more evenly than random maps of the same size \
               (figure 2)",
        test: "no test, one map of each kind: the distances from map points to their nearest map \
               point vary less (coefficient of variation)",
    };
    statement.decide(&data.place, || {
        let maps = data.maps.as_ref().map_err(Untestable::clone)?;
        let grid = spread(&maps.grid)?;
        let random = spread(&maps.random)?;
        Ok(Finding {
            holds: grid < random,
            p: None,
            measured: format!(
                "coefficient of variation {grid:.2} of the grid-based map ({} points), {random:.2} \
                 of the random one ({})",
                maps.grid.len(),
                maps.random.len()
            ),
        })
    })
}

fn size_not_exact(data: &LikelihoodResults) -> Claim {
    let statement = Statement {
        id: "size-not-exact",
        section: Section::InitialMap,
        text: "The number of points of a grid-based map cannot be asked for exactly",
        test: "no test: holds if a map of the experiment, whose cell size is searched for, has not \
               the number of points that was asked for",
    };
    statement.decide(&data.place, || {
        let maps: Vec<_> = data.rows()?.iter().filter(|row| row.builder == Builder::Grid).collect();
        if maps.is_empty() {
            return Err(Untestable("no grid-based map".to_owned()));
        }
        let missed: Vec<_> =
            maps.iter().filter(|row| row.initial_points != row.requested_points).collect();
        let furthest = missed
            .iter()
            .max_by_key(|row| row.requested_points.abs_diff(row.initial_points))
            .map_or(String::new(), |row| {
                let (found, requested) = (row.initial_points, row.requested_points);
                let percent = 100.0 * (found as f64 / requested as f64 - 1.0);
                format!(
                    "; the furthest has {found} instead of {requested} points ({percent:+.2} %)"
                )
                .replace('-', "−")
            });
        Ok(Finding {
            holds: !missed.is_empty(),
            p: None,
            measured: format!(
                "bisection of the cell size met {} of {} requests exactly{furthest}",
                maps.len() - missed.len(),
                maps.len()
            ),
        })
    })
}

fn cost_of_grid(data: &LikelihoodResults) -> Claim {
    let statement = Statement {
        id: "cost-of-grid",
        section: Section::InitialMap,
        text: "Filling the grid takes O(N), all of grid-based sampling O(N + Kn) for n points in \
               each of K cells",
        test: "no test",
    };
    statement.decide(&data.place, || {
        let reason = "saved times are of a search over many grids; `make bench` times one";
        Err(Untestable(reason.to_owned()))
    })
}

/// Coefficient of variation of the distances from each point to the nearest other one: 0 on a
/// regular lattice, about 0.52 for random points that are equally likely everywhere in the plane.
fn spread(map: &PointMap<2>) -> Result<f64, Untestable> {
    let distances = nearest_other_distances(map)?;
    let count = distances.len() as f64;
    let mean = distances.iter().sum::<f64>() / count;
    if mean == 0.0 {
        return Err(Untestable("all points of a map have a twin at the same place".to_owned()));
    }
    let variance = distances.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / count;
    Ok(variance.sqrt() / mean)
}

/// Distance from each point to the nearest other one (m).
fn nearest_other_distances(map: &PointMap<2>) -> Result<Vec<f64>, Untestable> {
    let points = map.points();
    if points.len() < 2 {
        return Err(Untestable("a map of one point has no spread".to_owned()));
    }
    let index = NearestNeighbors::new(points).map_err(|error| Untestable(error.to_string()))?;
    let bounds = map.bounds();
    let extent = bounds.extent(0).max(bounds.extent(1));
    let distance_of = |(number, point)| {
        // Some other point is within a radius that is doubled often enough, and then so is the
        // nearest.
        let mut radius = extent / (points.len() as f64).sqrt();
        loop {
            let mut nearest = f64::INFINITY;
            index.for_each_within(point, radius, |neighbor| {
                if neighbor.index != number {
                    nearest = nearest.min(neighbor.distance_squared);
                }
            });
            if nearest.is_finite() {
                return nearest.sqrt();
            }
            radius *= 2.0;
        }
    };
    Ok(points.iter().enumerate().map(distance_of).collect())
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::super::planted;
    use super::*;
    use crate::results::ComparisonMaps;

    /// On a lattice, and with half of the points crowded into a corner.
    fn maps() -> [PointMap<2>; 2] {
        let lattice: Vec<[f64; 2]> =
            (0..100).map(|i| [f64::from(i % 10), f64::from(i / 10)]).collect();
        let crowded = lattice
            .iter()
            .enumerate()
            .map(|(i, &[x, y])| if i % 2 == 0 { [x, y] } else { [0.01 * x, 0.01 * y] });
        [PointMap::new(crowded.collect()).unwrap(), PointMap::new(lattice.clone()).unwrap()]
    }

    #[test]
    fn distances_are_those_of_brute_force() {
        let [crowded, _] = maps();
        let found = nearest_other_distances(&crowded).unwrap();
        for (i, a) in crowded.points().iter().enumerate() {
            let others = crowded.points().iter().enumerate().filter(|(j, _)| *j != i);
            let nearest = others
                .map(|(_, b)| ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sqrt())
                .fold(f64::INFINITY, f64::min);
            assert!((found[i] - nearest).abs() < 1e-12);
        }
        // Twins are 0 apart, also when there is nothing else.
        let twins = PointMap::new(vec![[1.0, 1.0]; 2]).unwrap();
        assert_eq!(nearest_other_distances(&twins).unwrap(), [0.0, 0.0]);
    }

    #[test]
    fn the_lattice_is_even() {
        let [random, grid] = maps();
        assert!(spread(&grid).unwrap() < 1e-12);
        let mut data = planted::likelihood(&[1.0], |_, _, _| (-5.0, -4.0));
        assert_eq!(even_spread(&data).verdict, Verdict::NotTestable);
        data.maps = Ok(ComparisonMaps { random: random.clone(), grid: grid.clone() });
        assert_eq!(even_spread(&data).verdict, Verdict::Reproduced);
        data.maps = Ok(ComparisonMaps { random: grid, grid: random });
        assert_eq!(even_spread(&data).verdict, Verdict::NotReproduced);
    }

    #[test]
    fn a_size_that_is_missed_is_told() {
        let mut data = planted::likelihood(&[1.0], |_, _, _| (-5.0, -4.0));
        let claim = size_not_exact(&data);
        assert_eq!(claim.verdict, Verdict::NotReproduced);
        assert!(claim.measured.contains("5 of 5"), "{}", claim.measured);
        let rows = data.rows.as_mut().unwrap();
        let row = rows.iter_mut().find(|row| row.builder == Builder::Grid).unwrap();
        row.initial_points = row.requested_points - 5;
        let claim = size_not_exact(&data);
        assert_eq!(claim.verdict, Verdict::Reproduced);
        assert!(
            claim.measured.contains("95 instead of 100 points (−5.00 %)"),
            "{}",
            claim.measured
        );
        rows_of_random_only(&mut data);
        assert_eq!(size_not_exact(&data).verdict, Verdict::NotTestable);
        assert_eq!(cost_of_grid(&data).verdict, Verdict::NotTestable);
    }

    fn rows_of_random_only(data: &mut LikelihoodResults) {
        data.rows.as_mut().unwrap().retain(|row| row.builder == Builder::Random);
    }
}
