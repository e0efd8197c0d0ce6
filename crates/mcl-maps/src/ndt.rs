//! Normal distributions transform: the data in square cells, each summarized by a Gaussian.
//!
//! Source: P. Biber and W. Straßer, *The Normal Distributions Transform: A New Approach to Laser Scan
//! Matching*, IROS 2003. They use four overlapping grids, shifted by half a cell, so that no position is
//! near the cell borders of all grids. This map has one grid; its users also evaluate the neighbouring cells.
//!
//! # Example
//! ```
//! use mcl_maps::ndt::{NdtSettings, normal_distributions};
//!
//! // A wall along x: 1 m of it is one Gaussian, long and flat.
//! let wall: Vec<[f64; 2]> = (0..100).map(|i| [f64::from(i) * 0.01, 0.5]).collect();
//! let map = normal_distributions(&wall, &NdtSettings::of_cell(1.0))?;
//! assert_eq!(map.cells().len(), 1);
//! let [xx, _, yy] = map.cells()[0].covariance;
//! assert!(xx > 0.08 && yy < 2e-4);
//! # Ok::<(), mcl_maps::MapError>(())
//! ```

use std::collections::BTreeMap;

use mcl_core::{NdtCell, NdtMap, Point, check_finite, math};

use crate::MapError;

/// The smaller eigenvalue of a covariance is at least this times the larger (Biber & Straßer).
pub const EIGENVALUE_RATIO: f64 = 0.001;
/// Above this, not every integer is representable as a double.
const MOST_CELLS: f64 = (1u64 << 52) as f64;

/// Settings of [`normal_distributions`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NdtSettings {
    /// Edge length of a cell in metres.
    pub cell: f64,
    /// Cells with fewer points have no Gaussian.
    pub min_points: usize,
    /// No standard deviation of a Gaussian is below this (m).
    pub min_std: f64,
}

impl NdtSettings {
    /// Settings for cells of this edge length (m) with at least 3 points, as in Biber and Straßer, and standard
    /// deviations of at least 1 cm, the resolution of the readings in the logs of the data sets.
    pub fn of_cell(cell: f64) -> Self {
        NdtSettings { cell, min_points: 3, min_std: 0.01 }
    }

    fn check(&self) -> Result<(), MapError> {
        let check =
            |setting, value: f64, least: f64, expected| match value.is_finite() && value > least {
                true => Ok(()),
                false => Err(MapError::Setting { setting, value, expected }),
            };
        check("cell (m)", self.cell, 0.0, "a positive number")?;
        check("smallest standard deviation (m)", self.min_std, 0.0, "a positive number")?;
        check("smallest number of points", self.min_points as f64, 0.0, "at least 1")
    }
}

/// Computes the Gaussians of the cells that contain enough points, row by row.
///
/// Mean and covariance are those of the points of a cell, the covariance divided by their number n as in
/// the paper; a point is in column ⌊x/cell⌋ and row ⌊y/cell⌋. The smaller eigenvalue of the covariance is
/// raised to [`EIGENVALUE_RATIO`] of the larger if it is below, then both to `min_std`².
///
/// # Errors
/// [`MapError::Points`] for unusable coordinates, [`MapError::Setting`] for settings out of range,
/// [`MapError::CellIndex`] for cells too small for the coordinates, and [`MapError::NoGaussian`] if no
/// cell has enough points.
pub fn normal_distributions(
    points: &[Point<2>],
    settings: &NdtSettings,
) -> Result<NdtMap, MapError> {
    settings.check()?;
    check_finite(points)?;
    let NdtSettings { cell, min_points, min_std } = *settings;
    let mut by_cell: BTreeMap<(i64, i64), Vec<Point<2>>> = BTreeMap::new();
    for point in points {
        let index = point.map(|coordinate| (coordinate / cell).floor());
        if let Some(axis) = index.iter().position(|index| index.abs() > MOST_CELLS) {
            return Err(MapError::CellIndex { cell, coordinate: point[axis] });
        }
        by_cell.entry((index[1] as i64, index[0] as i64)).or_default().push(*point);
    }
    let cells: Vec<NdtCell> = by_cell
        .into_iter()
        .filter(|(_, points)| points.len() >= min_points)
        .map(|((row, column), points)| {
            let (mean, covariance) = moments(&points);
            NdtCell { column, row, mean, covariance: bounded(covariance, min_std * min_std) }
        })
        .collect();
    if cells.is_empty() {
        return Err(MapError::NoGaussian { cell, min_points });
    }
    Ok(NdtMap::new(cell, cells)?)
}

/// Mean, and covariance as xx, xy, yy. Displacements are summed, so that points far from the origin lose no digits.
fn moments(points: &[Point<2>]) -> (Point<2>, [f64; 3]) {
    let n = points.len() as f64;
    let first = points[0];
    let offset: Point<2> =
        [0, 1].map(|axis| points.iter().map(|point| point[axis] - first[axis]).sum::<f64>() / n);
    let mut covariance = [0.0; 3];
    for point in points {
        let [dx, dy] = [0, 1].map(|axis| point[axis] - first[axis] - offset[axis]);
        for (sum, product) in covariance.iter_mut().zip([dx * dx, dx * dy, dy * dy]) {
            *sum += product;
        }
    }
    ([0, 1].map(|axis| first[axis] + offset[axis]), covariance.map(|sum| sum / n))
}

/// The covariance with its eigenvalues raised to the allowed minimum.
fn bounded([xx, xy, yy]: [f64; 3], least: f64) -> [f64; 3] {
    let (middle, radius) = (0.5 * (xx + yy), math::hypot(0.5 * (xx - yy), xy));
    let larger = (middle + radius).max(least);
    let floor = least.max(EIGENVALUE_RATIO * larger);
    if middle - radius >= floor {
        return [xx, xy, yy];
    }
    // smaller·I + (larger − smaller)·v·vᵀ, with v the eigenvector of the larger one.
    let (sin, cos) = math::sin_cos(0.5 * math::atan2(2.0 * xy, xx - yy));
    let more = larger - floor;
    [floor + more * cos * cos, more * sin * cos, floor + more * sin * sin]
}

#[cfg(test)]
mod tests {
    use super::*;
    use mcl_core::CoreError;
    use proptest::prelude::*;

    fn settings(cell: f64, min_points: usize, min_std: f64) -> NdtSettings {
        NdtSettings { cell, min_points, min_std }
    }

    fn close(found: [f64; 3], expected: [f64; 3]) -> bool {
        found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-12)
    }

    #[test]
    fn moments_by_hand() {
        // Cell (0, 0): displacements from (0.5, 0.4) are (−0.3, −0.1), (0.3, 0.1), (0, 0.2), (0, −0.2):
        // xx = 0.18/4, xy = 0.06/4, yy = 0.1/4. Cell (−1, 2): two points, too few.
        let points = [[0.2, 0.3], [-0.5, 2.5], [0.8, 0.5], [0.5, 0.6], [-0.25, 2.5], [0.5, 0.2]];
        let map = normal_distributions(&points, &settings(1.0, 3, 0.001)).unwrap();
        assert_eq!(map.cells().len(), 1);
        let cell = map.cells()[0];
        assert_eq!((cell.column, cell.row), (0, 0));
        assert!((cell.mean[0] - 0.5).abs() < 1e-15 && (cell.mean[1] - 0.4).abs() < 1e-15);
        assert!(close(cell.covariance, [0.045, 0.015, 0.025]), "{:?}", cell.covariance);

        // The same points far away lose no digits.
        let far: Vec<Point<2>> =
            points.iter().map(|[x, y]| [x + 4_194_304.0, y - 4_194_304.0]).collect();
        let far = normal_distributions(&far, &settings(1.0, 3, 0.001)).unwrap().cells()[0];
        assert_eq!((far.column, far.row), (4_194_304, -4_194_304));
        assert!(far.covariance.iter().zip(cell.covariance).all(|(a, b)| (a - b).abs() < 1e-9));
    }

    #[test]
    fn degenerate_cells_are_widened() {
        // On a diagonal line the smaller eigenvalue is 0: it becomes 0.001 of the larger, 2·(2/3)·0.3².
        let line = [[0.2, 0.2], [0.5, 0.5], [0.8, 0.8]];
        let covariance =
            normal_distributions(&line, &settings(1.0, 3, 1e-6)).unwrap().cells()[0].covariance;
        let (larger, smaller) = (0.12, 0.12 * EIGENVALUE_RATIO);
        let (half_sum, half_difference) = (0.5 * (larger + smaller), 0.5 * (larger - smaller));
        assert!(close(covariance, [half_sum, half_difference, half_sum]), "{covariance:?}");

        // The absolute minimum is the larger bound on a thin wall, and the only one for equal points.
        let wall = [[0.2, 0.5], [0.5, 0.5], [0.8, 0.5]];
        let covariance =
            normal_distributions(&wall, &settings(1.0, 3, 0.02)).unwrap().cells()[0].covariance;
        assert!(close(covariance, [0.06, 0.0, 0.0004]), "{covariance:?}");
        let same = [[0.5, 0.5]; 3];
        let covariance =
            normal_distributions(&same, &settings(1.0, 3, 0.02)).unwrap().cells()[0].covariance;
        assert!(close(covariance, [0.0004, 0.0, 0.0004]), "{covariance:?}");
    }

    proptest! {
        #[test]
        fn eigenvalues_keep_their_bounds(
            points in prop::collection::vec([0.0..1.0f64, 0.0..1.0f64], 3..20),
            flat in prop::sample::select(vec![1.0, 1e-3, 0.0]),
        ) {
            let points: Vec<Point<2>> = points.iter().map(|[x, y]| [*x, 0.5 * flat * y]).collect();
            let map = normal_distributions(&points, &settings(1.0, 3, 0.01)).unwrap();
            let [xx, xy, yy] = map.cells()[0].covariance;
            let (middle, radius) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
            let (larger, smaller) = (middle + radius, middle - radius);
            prop_assert!(smaller >= 1e-4 * (1.0 - 1e-9), "{smaller}");
            prop_assert!(smaller >= EIGENVALUE_RATIO * larger * (1.0 - 1e-9));
        }
    }

    #[test]
    fn too_few_points_and_bad_settings_make_no_map() {
        let few = [[0.0, 0.0], [5.0, 5.0]];
        let message =
            normal_distributions(&few, &NdtSettings::of_cell(1.0)).unwrap_err().to_string();
        assert!(message.contains("3 points") && message.contains("larger cells"), "{message}");
        let nan = normal_distributions(&[[0.0, f64::NAN]], &NdtSettings::of_cell(1.0));
        assert!(matches!(
            nan,
            Err(MapError::Points(CoreError::NonFinite { index: 0, axis: 1, .. }))
        ));
        let small = normal_distributions(&[[1e12, 0.0]], &NdtSettings::of_cell(1e-9));
        assert!(matches!(small, Err(MapError::CellIndex { .. })));
        for wrong in [settings(0.0, 3, 0.01), settings(f64::NAN, 3, 0.01), settings(1.0, 0, 0.01)] {
            let refused = normal_distributions(&few, &wrong);
            assert!(matches!(refused, Err(MapError::Setting { .. })), "{wrong:?}");
        }
        assert!(normal_distributions(&few, &settings(1.0, 3, 0.0)).is_err());
    }
}
