use std::fmt;
use std::str::FromStr;

use crate::MapError;

/// The requested number of points of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MapSize {
    /// A number of points.
    Points(usize),
    /// A percentage of the points given to the builder: `floor(P·N/100)`, at least 1.
    Percent(f64),
}

impl MapSize {
    /// Converts the size to a number of points, for a set of `available` points.
    ///
    /// # Errors
    /// [`MapError::Size`] for 0 points, more points than available, or a percentage outside (0, 100].
    pub fn resolve(&self, available: usize) -> Result<usize, MapError> {
        let error = |expected| MapError::Size { size: self.to_string(), available, expected };
        match *self {
            MapSize::Points(count) if (1..=available).contains(&count) => Ok(count),
            MapSize::Points(_) => Err(error("from 1 to the number of points")),
            MapSize::Percent(percent) if percent > 0.0 && percent <= 100.0 && available > 0 => {
                let exact = percent * available as f64 / 100.0;
                // 1.1 % of 1,000 is 11 although the product rounds to 10.999…, so products within rounding of an
                // integer are taken as that integer.
                let nearest = exact.round();
                let whole =
                    if (exact - nearest).abs() <= 1e-9 * nearest { nearest } else { exact.floor() };
                Ok((whole as usize).clamp(1, available))
            }
            MapSize::Percent(_) => Err(error("a percentage above 0 and up to 100")),
        }
    }
}

impl fmt::Display for MapSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MapSize::Points(count) => write!(f, "{count}"),
            MapSize::Percent(percent) => write!(f, "{percent}%"),
        }
    }
}

/// The error for text that is not a map size.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is not a map size, expected a number of points (389) or a percentage (0.25%)")]
pub struct ParseMapSizeError(String);

impl FromStr for MapSize {
    type Err = ParseMapSizeError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let trimmed = text.trim();
        match trimmed.strip_suffix('%') {
            Some(percent) => percent
                .trim()
                .parse()
                .ok()
                .filter(|percent: &f64| *percent > 0.0 && *percent <= 100.0)
                .map(MapSize::Percent),
            None => trimmed.parse().ok().filter(|&count| count > 0).map(MapSize::Points),
        }
        .ok_or_else(|| ParseMapSizeError(text.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentages_are_floored_and_at_least_one() {
        let resolve = |percent, available| MapSize::Percent(percent).resolve(available).unwrap();
        assert_eq!(resolve(0.1, 155_648), 155);
        assert_eq!(resolve(1.0, 155_648), 1556);
        assert_eq!(resolve(100.0, 155_648), 155_648);
        assert_eq!(resolve(0.1, 10), 1);
        // In floating point, 1.1 · 1000 / 100 and 0.57 · 10000 / 100 are not exactly the integer.
        assert_eq!(resolve(1.1, 1000), 11);
        assert_eq!(resolve(0.57, 10_000), 57);
        assert_eq!(resolve(1.15, 10_000), 115);
    }

    #[test]
    fn sizes_out_of_range_are_refused() {
        for size in ["0", "-3", "0%", "101%", "nan%", "many", "", "1.5"] {
            assert!(size.parse::<MapSize>().is_err(), "{size}");
        }
        assert!(MapSize::Points(0).resolve(5).is_err());
        assert!(MapSize::Points(6).resolve(5).is_err());
        assert!(MapSize::Percent(f64::NAN).resolve(5).is_err());
        assert_eq!("0.25 %".parse(), Ok(MapSize::Percent(0.25)));
        assert_eq!("389".parse(), Ok(MapSize::Points(389)));
    }
}
