//! Point clouds as written by scanners and their software: data to build maps from.

use std::path::Path;

use mcl_core::Point;

use super::columns::{NotFinite, Parsed};
use super::{Format, MapFileError, MapProblem};

/// The points of a point cloud file.
#[derive(Debug, Clone, PartialEq)]
pub struct PointCloud {
    /// The points in metres, in file order; z is 0 if the file has no z column.
    pub points: Vec<Point<3>>,
    /// Whether the file has a z column.
    pub has_z: bool,
    /// Number of points left out because a coordinate was NaN or infinite. Scanners write such points for missing
    /// returns.
    pub not_finite: usize,
}

impl PointCloud {
    /// Returns 3 if the points differ in height, otherwise 2: formats without a 2-D variant write z = 0.
    pub fn dimensions(&self) -> usize {
        let mut heights = self.points.iter().map(|point| point[2]);
        let first = heights.next();
        if self.has_z && heights.any(|height| Some(height) != first) { 3 } else { 2 }
    }
}

/// Whether a path has an extension that [`read_cloud`] reads: `.ply`, `.pcd` or `.csv`.
pub fn is_point_cloud(path: impl AsRef<Path>) -> bool {
    matches!(Format::of(path.as_ref()), Ok(Format::Points(_)))
}

/// Reads a point cloud (PLY, PCD, CSV with a header); the extension of `path` determines the format. Points with NaN
/// or infinite coordinates are left out and counted.
///
/// # Errors
/// As [`read_map`](super::read_map). A file without a finite point is an error too.
pub fn read_cloud(path: impl AsRef<Path>) -> Result<PointCloud, MapFileError> {
    let path = path.as_ref();
    let Format::Points(format) = Format::of(path)? else {
        return Err(MapFileError::NoCloud { path: path.into() });
    };
    let bytes = std::fs::read(path)
        .map_err(|source| MapFileError::Unreadable { path: path.into(), source })?;
    let cloud = match format.parse_points::<3>(&bytes, NotFinite::LeftOut) {
        Ok(Parsed { points, left_out }) => {
            Ok(PointCloud { points, has_z: true, not_finite: left_out })
        }
        Err(MapProblem::MissingColumn { column: "z", .. }) => format
            .parse_points::<2>(&bytes, NotFinite::LeftOut)
            .map(|Parsed { points, left_out }| PointCloud {
                points: points.into_iter().map(|[x, y]| [x, y, 0.0]).collect(),
                has_z: false,
                not_finite: left_out,
            }),
        Err(problem) => Err(problem),
    };
    match cloud {
        Ok(cloud) if cloud.points.is_empty() => {
            let not_finite = cloud.not_finite;
            Err(MapProblem::NoMeasurement { not_finite })
        }
        other => other,
    }
    .map_err(|problem| MapFileError::Content { path: path.into(), problem })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str, text: &str) -> Result<PointCloud, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        read_cloud(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn the_dimension_is_that_of_the_points() {
        let cloud = |text| read("a.csv", text).unwrap();
        let spatial = cloud("x,y,z\n1,2,3\n4,5,6\n");
        assert_eq!(
            (spatial.points.as_slice(), spatial.dimensions()),
            (&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]][..], 3)
        );
        assert_eq!(cloud("x,y,z\n1,2,3\n4,5,3\n").dimensions(), 2);
        let planar = cloud("y,x\n1,2\n");
        assert_eq!(
            (planar.points[0], planar.has_z, planar.dimensions()),
            ([2.0, 1.0, 0.0], false, 2)
        );
    }

    #[test]
    fn points_of_missing_returns_are_left_out_and_counted() {
        let header = |data: &str| {
            format!(
                "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 3\nHEIGHT 1\n\
                 VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA ascii\n{data}"
            )
        };
        let cloud = read("a.pcd", &header("nan nan nan\n1 2 3\n0 inf 1\n")).unwrap();
        assert_eq!((cloud.points.as_slice(), cloud.not_finite), (&[[1.0, 2.0, 3.0]][..], 2));
        let error = read("a.pcd", &header("nan 0 0\nnan 0 0\n0 inf 1\n")).unwrap_err();
        assert!(error.contains("all 3 points are not finite"), "{error}");
        // In all other respects as strict as for maps.
        let error = read("a.pcd", &header("nan 0 0\n1 2 3\n")).unwrap_err();
        assert!(error.contains("announces 3"), "{error}");
        let error = read("a.csv", "x,y,z\n1,2,up\n").unwrap_err();
        assert!(error.contains("line 2") && error.contains("up"), "{error}");
        assert!(read("a.yaml", "image: a.pgm").unwrap_err().contains("grid map"));
        assert!(read("a.csv", "x,y\n").unwrap_err().contains("no point"));
    }
}
