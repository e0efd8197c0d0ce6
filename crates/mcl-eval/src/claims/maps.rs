//! Section IV: how grid-based sampling chooses points.

use mcl_core::{PointMap, math};
use mcl_maps::files::read_map;
use mcl_study::store::results::Results;
use mcl_study::table::Value;

use crate::claims::cells::{Sampled, SampledTest, Sizes};
use crate::claims::claim::{Evidence, Finding, Outcome, Test, Untestable};

pub(super) const CLAIMS: [SampledTest; 3] = [
    Test {
        id: "even-spread",
        short: "gbs spreads points more evenly",
        section: "IV",
        statement: "Grid-based maps spread their points more evenly than random maps of the same size \
                   (figure 2)",
        test: "no test, one map of each kind: the distances from map points to their nearest map \
                   point vary less (coefficient of variation)",
        decide: even_spread,
    },
    Test {
        id: "size-not-exact",
        short: "gbs cannot be asked for a size",
        section: "IV",
        statement: "The number of points of a grid-based map cannot be asked for exactly",
        test: "no test: holds if a map of the experiment, whose cell size is searched for, has \
                   not the number of points that was asked for",
        decide: size_not_exact,
    },
    Test {
        id: "cost-of-grid",
        short: "sampling takes O(N + Kn)",
        section: "IV",
        statement: "Filling the grid takes O(N), all of grid-based sampling O(N + Kn) for n points in \
                   each of K cells",
        test: "no test",
        decide: |_| {
            let reason = "saved times are of a search over many grids; `make bench` times one";
            Err(Untestable(reason.to_owned()))
        },
    },
];

/// The picture of a random and a grid-based map of the same size.
const FIGURE_2: &str = "figure2-sampling";

fn even_spread(data: &Sampled) -> Outcome {
    let [grid, random] = [figure_2(data.results, "gbs")?, figure_2(data.results, "rnd")?];
    let (of_grid, of_random) = (spread(&grid)?, spread(&random)?);
    let measured = format!(
        "coefficient of variation {of_grid:.2} of the grid-based map ({} points), {of_random:.2} of \
         the random one ({})",
        grid.len(),
        random.len()
    );
    Ok(Finding { holds: of_grid < of_random, measured, evidence: Evidence::default() })
}

/// The map of a kind in the picture.
fn figure_2(results: &Results, kind: &str) -> Result<PointMap<2>, Untestable> {
    let pictures = results.study.views.pictures.iter().zip(&results.pictured);
    let shown = pictures.filter(|(picture, _)| picture.name == FIGURE_2).flat_map(|(_, maps)| maps);
    let is_kind = |cell: &(String, Value)| cell.0 == "map" && cell.1.text() == Some(kind);
    let map = shown.flatten().find(|map| map.cells.iter().any(is_kind));
    let missing = || Untestable("the maps of figure 2 are not saved".to_owned());
    read_map(&map.ok_or_else(missing)?.map).map_err(|error| Untestable(format!("{error:#}")))
}

fn size_not_exact(data: &Sampled) -> Outcome {
    let (mut maps, mut exact) = (0, 0);
    // Relative deviation, number of points found, number of points requested.
    let mut furthest = (0.0, 0.0, 0.0);
    for cell in data.cells("gbs", &Sizes::ALL)? {
        let (found, requested) = (cell.values("map_points")?, cell.values("requested_points")?);
        for (&(_, found), &(_, requested)) in
            found.block_means().iter().zip(requested.block_means())
        {
            maps += 1;
            exact += usize::from(found == requested);
            let miss = found / requested - 1.0;
            if miss.abs() > f64::abs(furthest.0) {
                furthest = (miss, found, requested);
            }
        }
    }
    let mut measured = format!("bisection of the cell size met {exact} of {maps} requests exactly");
    if exact < maps {
        let (miss, found, requested) = furthest;
        let miss = format!("{:+.2}", 100.0 * miss).replace('-', "−");
        measured += &format!("; the furthest has {found} instead of {requested} points ({miss} %)");
    }
    Ok(Finding { holds: exact < maps, measured, evidence: Evidence::default() })
}

/// Coefficient of variation of the nearest-neighbour distances: 0 on a regular lattice, about 0.52 for points
/// that are uniformly random in the plane.
fn spread(map: &PointMap<2>) -> Result<f64, Untestable> {
    let distances = nearest_other_distances(map)?;
    let count = distances.len() as f64;
    let mean = distances.iter().sum::<f64>() / count;
    if mean == 0.0 {
        return Err(Untestable("all points of a map have a twin at the same place".to_owned()));
    }
    let variance = distances.iter().map(|d| math::square(d - mean)).sum::<f64>() / count;
    Ok(variance.sqrt() / mean)
}

/// Nearest-neighbour distance of each point (m), by brute force: maps of figure 2 are small.
fn nearest_other_distances(map: &PointMap<2>) -> Result<Vec<f64>, Untestable> {
    let points = map.points();
    if points.len() < 2 {
        return Err(Untestable("a map of one point has no spread".to_owned()));
    }
    let nearest = |(index, [x, y]): (usize, &[f64; 2])| {
        let others = points[..index].iter().chain(&points[index + 1..]);
        others.map(|[u, v]| math::hypot(u - x, v - y)).fold(f64::INFINITY, f64::min)
    };
    Ok(points.iter().enumerate().map(nearest).collect())
}

#[cfg(test)]
mod tests {
    use mcl_maps::files::{Encoding, write_map};
    use mcl_study::store::results::Pictured;

    use super::*;
    use crate::claims::planted;

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

    fn outcome(claim: fn(&Sampled) -> Outcome, results: &Results) -> Outcome {
        claim(&Sampled::of(results, "log_likelihood", false).unwrap()[0])
    }

    #[test]
    fn the_lattice_is_even() {
        let [random, grid] = maps();
        assert!(spread(&grid).unwrap() < 1e-12);
        // Duplicates are 0 apart, even without other points.
        let twins = PointMap::new(vec![[1.0, 1.0]; 2]).unwrap();
        assert_eq!(nearest_other_distances(&twins).unwrap(), [0.0, 0.0]);
        let folder = tempfile::tempdir().unwrap();
        let mut results = planted::likelihood(&[1.0], |_, _, _| (-5.0, -4.0));
        let missing = || Some("the maps of figure 2 are not saved".to_owned());
        assert_eq!(outcome(even_spread, &results).err().map(|reason| reason.0), missing());
        for (maps, holds) in [([&random, &grid], true), ([&grid, &random], false)] {
            let shown = ["rnd", "gbs"].into_iter().zip(maps).map(|(kind, points)| {
                let map = folder.path().join(format!("{kind}.ply"));
                write_map(&map, points, Encoding::Binary).unwrap();
                Some(Pictured { cells: vec![("map".to_owned(), kind.into())], map, paths: None })
            });
            results.pictured = vec![shown.collect()];
            assert_eq!(outcome(even_spread, &results).ok().unwrap().holds, holds);
        }
        std::fs::write(folder.path().join("gbs.ply"), "no map").unwrap();
        let reason = outcome(even_spread, &results).err().unwrap().0;
        assert!(reason.contains("gbs.ply"), "{reason}");
    }

    #[test]
    fn a_size_that_is_missed_is_reported() {
        let mut results = planted::likelihood(&[1.0], |_, _, _| (-5.0, -4.0));
        let finding = outcome(size_not_exact, &results).ok().unwrap();
        assert!(!finding.holds && finding.measured.contains("5 of 5"), "{}", finding.measured);
        planted::edit(&mut results, |row| {
            if row.text("map") == "gbs" && row.number("draw") == 2.0 {
                row.set("map_points", 95u32);
            }
            true
        });
        let finding = outcome(size_not_exact, &results).ok().unwrap();
        let missed = finding.measured.contains("95 instead of 100 points (−5.00 %)");
        assert!(finding.holds && missed, "{}", finding.measured);
    }
}
