//! Finding the coordinate columns of a file, and checking coordinates.

use mcl_core::Point;

use super::{FilePosition, MapProblem};

pub(super) const AXES: [&str; 3] = ["x", "y", "z"];

/// How to treat a point with a coordinate that is NaN or infinite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NotFinite {
    /// As an error: maps have no such points.
    Refused,
    /// As a missing return, which is left out: scanners write such points.
    LeftOut,
}

/// Indices of the x, y and z columns of a file.
pub(super) struct Axes<const D: usize> {
    columns: [usize; D],
    /// The z column of a file read as a planar map: it must be 0 everywhere.
    flat: Option<usize>,
    not_finite: NotFinite,
}

/// The points of a file, in file order.
pub(super) struct Parsed<const D: usize> {
    pub points: Vec<Point<D>>,
    /// Number of points left out because a coordinate was NaN or infinite.
    pub left_out: usize,
}

impl<const D: usize> Parsed<D> {
    pub(super) fn new() -> Self {
        Parsed { points: Vec::new(), left_out: 0 }
    }

    /// Number of points of the file so far.
    pub(super) fn count(&self) -> usize {
        self.points.len() + self.left_out
    }

    pub(super) fn push(&mut self, point: Option<Point<D>>) {
        match point {
            Some(point) => self.points.push(point),
            None => self.left_out += 1,
        }
    }
}

impl<const D: usize> Axes<D> {
    /// Finds the coordinate columns by name, in any case and order.
    pub(super) fn find<S: AsRef<str>>(
        names: &[S],
        not_finite: NotFinite,
    ) -> Result<Self, MapProblem> {
        let found = || {
            let quoted: Vec<_> = names.iter().map(|name| format!("{:?}", name.as_ref())).collect();
            if quoted.is_empty() { "no columns".to_owned() } else { quoted.join(", ") }
        };
        let position = |column: &'static str| {
            let mut at =
                (0..names.len()).filter(|&i| names[i].as_ref().trim().eq_ignore_ascii_case(column));
            match (at.next(), at.next()) {
                (_, Some(_)) => Err(MapProblem::DoubleColumn { column, found: found() }),
                (first, None) => Ok(first),
            }
        };
        let mut columns = [0; D];
        for (index, column) in columns.iter_mut().zip(AXES) {
            *index = position(column)?
                .ok_or_else(|| MapProblem::MissingColumn { column, found: found() })?;
        }
        let flat = if D == 2 { position("z")? } else { None };
        Ok(Axes { columns, flat, not_finite })
    }

    /// Reads the point of one row, unless it is left out; `value` reads the coordinate of a column, given its index
    /// and name.
    pub(super) fn point(
        &self,
        place: FilePosition,
        value: impl Fn(usize, &'static str) -> Result<f64, MapProblem>,
    ) -> Result<Option<Point<D>>, MapProblem> {
        if self.not_finite == NotFinite::LeftOut {
            let mut point = [0.0; D];
            for ((coordinate, &index), column) in point.iter_mut().zip(&self.columns).zip(AXES) {
                *coordinate = value(index, column)?;
            }
            return Ok(point.iter().all(|coordinate| coordinate.is_finite()).then_some(point));
        }
        let finite = |index, column| {
            let found = value(index, column)?;
            if found.is_finite() {
                return Ok(found);
            }
            Err(MapProblem::Value {
                place,
                column,
                found: found.to_string(),
                expected: "a finite number of metres",
            })
        };
        let mut point = [0.0; D];
        for ((coordinate, &index), column) in point.iter_mut().zip(&self.columns).zip(AXES) {
            *coordinate = finite(index, column)?;
        }
        if let Some(index) = self.flat {
            let height = finite(index, "z")?;
            if height != 0.0 {
                return Err(MapProblem::Value {
                    place,
                    column: "z",
                    found: height.to_string(),
                    expected: "0, because the map is planar",
                });
            }
        }
        Ok(Some(point))
    }
}

/// Parses a coordinate.
pub(super) fn parse_number(
    text: &str,
    place: FilePosition,
    column: &'static str,
) -> Result<f64, MapProblem> {
    text.trim().parse().map_err(|_| {
        // A damaged file may have arbitrarily long text in place of a number.
        let mut found: String = text.chars().take(40).collect();
        if found.len() < text.len() {
            found.push('…');
        }
        MapProblem::Value {
            place,
            column,
            found: format!("{found:?}"),
            expected: "a number of metres",
        }
    })
}

/// Extends a point to three coordinates with z = 0, as point-cloud tools expect.
pub(super) fn with_height<const D: usize>(point: &Point<D>) -> [f64; 3] {
    std::array::from_fn(|axis| point.get(axis).copied().unwrap_or(0.0))
}
