use crate::{CoreError, Point, check_finite};

/// A cell of an [`NdtMap`]: the normal distribution of the points in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NdtCell {
    /// Column of the cell, counted along x from the map's origin: x is in [column, column + 1) cell edges.
    pub column: i64,
    /// Row of the cell, counted along y from the map's origin.
    pub row: i64,
    /// Mean μ in metres.
    pub mean: Point<2>,
    /// Covariance Σ in m²: xx, xy and yy.
    pub covariance: [f64; 3],
}

/// A map of square cells, each with a normal distribution of the beam endpoints in it (normal distributions
/// transform: P. Biber and W. Straßer, *The Normal Distributions Transform: A New Approach to Laser Scan
/// Matching*, IROS 2003). It stores only cells that have a distribution, at least one.
#[derive(Debug, Clone, PartialEq)]
pub struct NdtMap {
    cell: f64,
    cells: Vec<NdtCell>,
}

impl NdtMap {
    /// Creates a map from its cells, whose edges are `cell` metres long.
    ///
    /// # Errors
    /// [`CoreError::CellSize`] unless `cell` is positive, [`CoreError::NoPoints`] without cells,
    /// [`CoreError::NonFinite`] or [`CoreError::TooLarge`] for an unusable mean, and [`CoreError::Covariance`] for a
    /// covariance that is not positive definite.
    pub fn new(cell: f64, cells: Vec<NdtCell>) -> Result<Self, CoreError> {
        if !(cell.is_finite() && cell > 0.0) {
            return Err(CoreError::CellSize(cell));
        }
        if cells.is_empty() {
            return Err(CoreError::NoPoints);
        }
        check_finite(&cells.iter().map(|cell| cell.mean).collect::<Vec<_>>())?;
        for (index, NdtCell { covariance, .. }) in cells.iter().enumerate() {
            let [xx, xy, yy] = *covariance;
            // Written so that NaN is refused too.
            let positive = xx > 0.0 && yy > 0.0 && xx * yy - xy * xy > 0.0;
            if !(positive && covariance.iter().all(|value| value.is_finite())) {
                return Err(CoreError::Covariance { index, covariance: *covariance });
            }
        }
        Ok(NdtMap { cell, cells })
    }

    /// Edge length of a cell in metres.
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// The cells that have a normal distribution, at least one.
    pub fn cells(&self) -> &[NdtCell] {
        &self.cells
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn covariances_that_are_not_positive_definite_are_refused() {
        let cell = |mean, covariance| NdtCell { column: 0, row: 0, mean, covariance };
        let one = |size: f64, mean, covariance| NdtMap::new(size, vec![cell(mean, covariance)]);
        assert!(one(1.0, [0.5, 0.5], [1.0, 0.5, 1.0]).is_ok());
        assert_eq!(NdtMap::new(1.0, Vec::new()), Err(CoreError::NoPoints));
        assert_eq!(one(0.0, [0.5; 2], [1.0, 0.0, 1.0]), Err(CoreError::CellSize(0.0)));
        assert!(matches!(
            one(1.0, [0.5, f64::NAN], [1.0, 0.0, 1.0]),
            Err(CoreError::NonFinite { index: 0, axis: 1, .. })
        ));
        // Singular, indefinite, negative, NaN.
        for covariance in
            [[1.0, 1.0, 1.0], [1.0, 2.0, 1.0], [-1.0, 0.0, -1.0], [f64::NAN, 0.0, 1.0]]
        {
            let refused = one(1.0, [0.5; 2], covariance);
            assert!(matches!(refused, Err(CoreError::Covariance { index: 0, .. })));
        }
    }
}
