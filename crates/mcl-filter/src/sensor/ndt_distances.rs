use mcl_core::{Bounds, NdtMap, Point};

use crate::FilterError;
use crate::check::{check_length, check_std};

/// Largest number of cells of the lookup table of a map: 4 km² at 0.5 m.
const MAX_CELLS: f64 = (1u64 << 24) as f64;

/// How an [`NdtMap`] is evaluated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NdtReading {
    /// σ_hit of the filter (m): the distance that corresponds to a Mahalanobis distance of 1.
    pub sigma_hit: f64,
    /// Standard deviation of an endpoint in each direction (m), added to the covariance of every cell. With 0, as in
    /// Biber & Straßer, a thin wall is a few centimetres wide, whatever σ_hit is. With σ_hit, the distance to a wall
    /// is about that to points along it.
    pub endpoint_std: f64,
}

/// Equivalent distances from an NDT map: for a Mahalanobis distance m to a Gaussian, the squared
/// distance is (σ_hit·m)², so that exp(−d²/2σ_hit²) is the score exp(−m²/2) of P. Biber and W. Straßer,
/// *The Normal Distributions Transform: A New Approach to Laser Scan Matching*, IROS 2003.
///
/// The best Gaussian of the cell that contains the point and the eight cells around it is used. Biber and Straßer
/// instead sum over four grids shifted by half a cell, and NDT-MCL (J. Saarinen, H. Andreasson, T. Stoyanov and
/// A. Lilienthal, IROS 2013) uses the nearest cell; all of these reduce the effect of cell borders.
/// If none of the nine cells has a Gaussian, the distance is `max_distance`.
pub struct NdtDistances {
    per_metre: f64,
    /// The first column and row of the table.
    first: [f64; 2],
    columns: usize,
    rows: usize,
    /// Index of the first ellipse of each cell, row by row; one entry more than cells.
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
    /// Prepares a map, with distances truncated at `max_distance` (m).
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

    /// Distance at which distances are truncated (m).
    pub fn max_distance(&self) -> f64 {
        self.max_distance
    }

    /// The σ_hit for which the distances were prepared (m).
    pub fn sigma_hit(&self) -> f64 {
        self.sigma_hit
    }

    /// Bounding box of the means.
    pub fn bounds(&self) -> Bounds<2> {
        self.bounds
    }

    /// min((σ_hit·m)², max_distance²) in m², with m the smallest Mahalanobis distance from a finite point to
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
            // Two cells farther, so no cell is near: (2 / 0.5)².
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
        // A wall without width: with an endpoint_std of σ_hit, the distance beside it is the metric one.
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
