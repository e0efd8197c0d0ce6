use mcl_core::{Bounds, NdtMap, Point};

use crate::FilterError;
use crate::check::{check_length, check_std};

/// Most cells of the table that a map is looked up in: 4 km² at 0.5 m.
const MAX_CELLS: f64 = (1u64 << 24) as f64;

/// How an [`NdtMap`] is read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NdtReading {
    /// σ_hit of the filter (m): one Mahalanobis distance counts as far as this.
    pub sigma_hit: f64,
    /// Standard deviation of an endpoint in each direction (m), added to every cell's covariance. 0 as in
    /// Biber & Straßer; a thin wall is then a few centimetres wide, whatever σ_hit is. With σ_hit, a place
    /// beside a wall is as far from it as it is from points along it.
    pub endpoint_std: f64,
}

/// Equivalent distances from an NDT map: where the Mahalanobis distance to its Gaussian is m, the squared
/// distance is (σ_hit·m)², so that exp(−d²/2σ_hit²) is the score exp(−m²/2) of P. Biber and W. Straßer,
/// *The Normal Distributions Transform: A New Approach to Laser Scan Matching*, IROS 2003.
///
/// Of the cell that a place lies in and the eight around it the best Gaussian counts. Biber and Straßer
/// add up four grids shifted by half a cell instead, NDT-MCL (J. Saarinen, H. Andreasson, T. Stoyanov and
/// A. Lilienthal, IROS 2013) takes the nearest cell; all are to keep the edges of cells from mattering.
/// Where none of the nine has a Gaussian the distance is the cut.
pub struct NdtDistances {
    per_metre: f64,
    /// The first column and row of the table.
    first: [f64; 2],
    columns: usize,
    rows: usize,
    /// Where the ellipses of each cell begin, row by row; one entry more than cells.
    starts: Vec<u32>,
    ellipses: Vec<Ellipse>,
    bounds: Bounds<2>,
    max_distance: f64,
    sigma_hit: f64,
}

/// A Gaussian as a quadratic form: (σ_hit·m)² = xx·dx² + 2·xy·dx·dy + yy·dy².
#[derive(Clone, Copy)]
struct Ellipse {
    mean: Point<2>,
    form: [f64; 3],
}

impl Ellipse {
    #[inline]
    fn distance_squared(&self, point: Point<2>) -> f64 {
        let [dx, dy] = [point[0] - self.mean[0], point[1] - self.mean[1]];
        let [xx, xy, yy] = self.form;
        xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy
    }
}

impl NdtDistances {
    /// Prepares a map, with distances cut at `max_distance` (m).
    ///
    /// # Errors
    /// [`FilterError::Setting`] for a `max_distance`, `sigma_hit` or `endpoint_std` out of range, and
    /// [`FilterError::TableSize`] for cells too small for the extent of the map.
    pub fn build(
        map: &NdtMap,
        reading: NdtReading,
        max_distance: f64,
    ) -> Result<Self, FilterError> {
        check_length("max_distance", max_distance)?;
        check_length("sigma_hit", reading.sigma_hit)?;
        check_std("endpoint_std", reading.endpoint_std)?;
        let cells: Vec<Point<2>> =
            map.cells().iter().map(|cell| [cell.column as f64, cell.row as f64]).collect();
        let of_cells = Bounds::of(&cells).expect("a map has at least one cell");
        let first = of_cells.min.map(|index| index - 1.0);
        let [columns, rows] = [0, 1].map(|axis| of_cells.extent(axis) + 3.0);
        if columns * rows > MAX_CELLS {
            return Err(FilterError::TableSize { columns, rows, cell: map.cell() });
        }
        let (columns, rows) = (columns as usize, rows as usize);
        let mut lists: Vec<Vec<Ellipse>> = vec![Vec::new(); columns * rows];
        for (cell, place) in map.cells().iter().zip(&cells) {
            let ellipse = Ellipse { mean: cell.mean, form: form(cell.covariance, reading) };
            let [column, row] = [0, 1].map(|axis| (place[axis] - first[axis]) as usize);
            for near in row - 1..=row + 1 {
                for list in &mut lists[near * columns + column - 1..][..3] {
                    list.push(ellipse);
                }
            }
        }
        let mut starts = vec![0];
        let mut ellipses = Vec::new();
        for list in lists {
            ellipses.extend(list);
            starts.push(ellipses.len() as u32);
        }
        let means: Vec<Point<2>> = map.cells().iter().map(|cell| cell.mean).collect();
        Ok(NdtDistances {
            per_metre: 1.0 / map.cell(),
            first,
            columns,
            rows,
            starts,
            ellipses,
            bounds: Bounds::of(&means).expect("a map has at least one cell"),
            max_distance,
            sigma_hit: reading.sigma_hit,
        })
    }

    /// Where distances are cut (m).
    pub fn max_distance(&self) -> f64 {
        self.max_distance
    }

    /// The σ_hit that a Mahalanobis distance of 1 counts as (m).
    pub fn sigma_hit(&self) -> f64 {
        self.sigma_hit
    }

    /// The smallest box around the means.
    pub fn bounds(&self) -> Bounds<2> {
        self.bounds
    }

    /// min((σ_hit·m)², max_distance²) in m², m the smallest Mahalanobis distance from a finite point to
    /// a Gaussian of its cell or of one of the eight around it.
    #[inline]
    pub fn distance_squared(&self, point: Point<2>) -> f64 {
        let [x, y] = [0, 1].map(|axis| (point[axis] * self.per_metre).floor() - self.first[axis]);
        let cut = self.max_distance * self.max_distance;
        if !(x >= 0.0 && y >= 0.0 && x < self.columns as f64 && y < self.rows as f64) {
            return cut;
        }
        let cell = y as usize * self.columns + x as usize;
        let near = &self.ellipses[self.starts[cell] as usize..self.starts[cell + 1] as usize];
        near.iter().fold(cut, |least, ellipse| least.min(ellipse.distance_squared(point)))
    }
}

/// σ_hit²·(Σ + endpoint_std²·I)⁻¹, as xx, xy and yy.
fn form([xx, xy, yy]: [f64; 3], reading: NdtReading) -> [f64; 3] {
    let endpoint = reading.endpoint_std * reading.endpoint_std;
    let (xx, yy) = (xx + endpoint, yy + endpoint);
    let scale = reading.sigma_hit * reading.sigma_hit / (xx * yy - xy * xy);
    [yy * scale, -xy * scale, xx * scale]
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::NdtCell;

    const CLASSIC: NdtReading = NdtReading { sigma_hit: 0.5, endpoint_std: 0.0 };

    fn cell(column: i64, row: i64, mean: Point<2>, covariance: [f64; 3]) -> NdtCell {
        NdtCell { column, row, mean, covariance }
    }

    #[test]
    fn scores_by_hand() {
        // Σ = [[0.05, 0.03], [0.03, 0.05]], eigenvalues 0.08 along (1, 1) and 0.02 across.
        let one = NdtMap::new(1.0, vec![cell(2, 1, [2.5, 1.5], [0.05, 0.03, 0.05])]).unwrap();
        let distances = NdtDistances::build(&one, CLASSIC, 2.0).unwrap();
        for (point, mahalanobis_squared) in [
            ([2.5, 1.5], 0.0),
            // 0.2·√2 along: 0.08/0.08. Across: 0.08/0.02.
            ([2.7, 1.7], 1.0),
            ([2.7, 1.3], 4.0),
            // Σ⁻¹ = [[31.25, −18.75], [−18.75, 31.25]]; a cell farther left: 31.25·0.36.
            ([1.9, 1.5], 11.25),
            // Two cells farther, and nowhere near: (2 / 0.5)².
            ([0.9, 1.5], 16.0),
            ([-1e300, 7.0], 16.0),
        ] {
            let found = distances.distance_squared(point);
            let expected = 0.25 * mahalanobis_squared;
            assert!((found - expected).abs() < 1e-12, "{point:?}: {found} for {expected}");
        }
    }

    #[test]
    fn an_endpoint_may_be_as_wide_as_the_sensor() {
        // A wall without width: with endpoints of σ_hit a place beside it is as far as it is.
        let wall = NdtMap::new(1.0, vec![cell(0, 0, [0.5, 0.5], [0.08, 0.0, 1e-12])]).unwrap();
        let reading = NdtReading { endpoint_std: 0.5, ..CLASSIC };
        let distances = NdtDistances::build(&wall, reading, 2.0).unwrap();
        for y in [0.5, 0.7, 1.0, 1.9] {
            let found = distances.distance_squared([0.5, y]).sqrt();
            assert!((found - (y - 0.5)).abs() < 1e-9, "{y}: {found}");
        }
    }

    #[test]
    fn the_best_of_the_cells_around_counts() {
        let round = [0.04, 0.0, 0.04];
        let cells = vec![
            cell(0, 0, [0.5, 0.5], round),
            cell(1, 0, [1.1, 0.5], round),
            cell(-3, -3, [-2.5, -2.5], round),
        ];
        let distances = NdtDistances::build(&NdtMap::new(1.0, cells).unwrap(), CLASSIC, 2.0);
        let distances = distances.unwrap();
        // 0.2 m from the mean of the neighbour is one standard deviation.
        assert!((distances.distance_squared([0.9, 0.5]) - 0.25).abs() < 1e-12);
        assert!((distances.distance_squared([0.4, 0.5]) - 0.25 * 0.25).abs() < 1e-12);
        assert_eq!(distances.bounds(), Bounds { min: [-2.5, -2.5], max: [1.1, 0.5] });
    }

    #[test]
    fn what_cannot_be_read_is_refused() {
        let round = [0.04, 0.0, 0.04];
        let map = NdtMap::new(0.1, vec![cell(0, 0, [0.05, 0.05], round)]).unwrap();
        for reading in [
            NdtReading { sigma_hit: 0.0, ..CLASSIC },
            NdtReading { endpoint_std: f64::NAN, ..CLASSIC },
        ] {
            let refused = NdtDistances::build(&map, reading, 2.0);
            assert!(matches!(refused, Err(FilterError::Setting { .. })));
        }
        let far = vec![
            cell(0, 0, [0.05, 0.05], round),
            cell(1_000_000, 1_000_000, [100_000.05, 100_000.05], round),
        ];
        let far = NdtDistances::build(&NdtMap::new(0.1, far).unwrap(), CLASSIC, 2.0);
        let Err(error) = far else { panic!("accepted") };
        assert!(error.to_string().contains("larger cells"), "{error}");
    }
}
