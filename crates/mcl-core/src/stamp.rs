use std::fmt;

const NANOSECONDS_PER_SECOND: i64 = 1_000_000_000;

/// A point in time: integer nanoseconds since the log's own epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Stamp(i64);

/// Why a text is no stamp.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ParseStampError {
    /// Not a decimal number at all.
    #[error("not a decimal number of seconds")]
    NotANumber,
    /// A number, but not a time: negative, not finite, denormal, or beyond the year 2262.
    #[error("not a usable time (negative, not finite, below a nanosecond, or too large)")]
    Unusable,
}

impl Stamp {
    /// A stamp from integer nanoseconds.
    pub const fn from_nanoseconds(nanoseconds: i64) -> Self {
        Stamp(nanoseconds)
    }

    /// Integer nanoseconds.
    pub const fn nanoseconds(self) -> i64 {
        self.0
    }

    /// Seconds as a float; for arithmetic use the nanoseconds, a float loses digits of an epoch time.
    pub fn seconds(self) -> f64 {
        self.0 as f64 / NANOSECONDS_PER_SECOND as f64
    }

    /// Seconds from `earlier` to this stamp, exact to the nanosecond before the division.
    pub fn seconds_since(self, earlier: Stamp) -> f64 {
        (i128::from(self.0) - i128::from(earlier.0)) as f64 / NANOSECONDS_PER_SECOND as f64
    }

    /// Reads decimal seconds (`1071078718.462310`) digit by digit, not through a float; digits
    /// beyond the nanosecond are rounded half up. Scientific notation, which some writers use for
    /// small or uninitialised values, goes through a float.
    ///
    /// # Errors
    /// [`ParseStampError::NotANumber`] for text that is no number, [`ParseStampError::Unusable`]
    /// for numbers that are no time: negative, NaN, infinite, larger than 0 but below a nanosecond
    /// (an uninitialised double often reads as 6.9e-310), or beyond the range of 64 bits.
    pub fn parse_seconds(text: &str) -> Result<Self, ParseStampError> {
        let value: f64 = text.parse().map_err(|_| ParseStampError::NotANumber)?;
        let smallest = 1.0 / NANOSECONDS_PER_SECOND as f64;
        if !value.is_finite() || value < 0.0 || (value > 0.0 && value < 0.5 * smallest) {
            return Err(ParseStampError::Unusable);
        }
        let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
        let whole = whole.trim_start_matches('+');
        let is_digits = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
        if !is_digits(whole) || !is_digits(fraction) {
            let nanoseconds = (value * NANOSECONDS_PER_SECOND as f64).round();
            return if nanoseconds < i64::MAX as f64 {
                Ok(Stamp(nanoseconds as i64))
            } else {
                Err(ParseStampError::Unusable)
            };
        }
        let mut nanoseconds: i64 = 0;
        for position in 0..9 {
            let digit = fraction.as_bytes().get(position).map_or(0, |byte| byte - b'0');
            nanoseconds = nanoseconds * 10 + i64::from(digit);
        }
        let round_up = fraction.as_bytes().get(9).is_some_and(|&byte| byte >= b'5');
        let seconds: i64 = if whole.is_empty() {
            0
        } else {
            whole.parse().map_err(|_| ParseStampError::Unusable)?
        };
        seconds
            .checked_mul(NANOSECONDS_PER_SECOND)
            .and_then(|total| total.checked_add(nanoseconds + i64::from(round_up)))
            .map(Stamp)
            .ok_or(ParseStampError::Unusable)
    }
}

/// Decimal seconds with nine digits after the point, exact.
impl fmt::Display for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let magnitude = self.0.unsigned_abs();
        let per_second = NANOSECONDS_PER_SECOND as u64;
        let sign = if self.0 < 0 { "-" } else { "" };
        write!(f, "{sign}{}.{:09}", magnitude / per_second, magnitude % per_second)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn epoch_times_keep_every_digit() {
        let stamp = Stamp::parse_seconds("1071078718.462310123").unwrap();
        assert_eq!(stamp.nanoseconds(), 1_071_078_718_462_310_123);
        assert_eq!(stamp.to_string(), "1071078718.462310123");
        assert_eq!(Stamp::parse_seconds("32.9068").unwrap().nanoseconds(), 32_906_800_000);
        assert_eq!(Stamp::parse_seconds("0").unwrap().nanoseconds(), 0);
        assert_eq!(Stamp::parse_seconds(".5").unwrap().nanoseconds(), 500_000_000);
        assert_eq!(Stamp::parse_seconds("1.9999999996").unwrap().nanoseconds(), 2_000_000_000);
        assert_eq!(Stamp::parse_seconds("1.5e3").unwrap().nanoseconds(), 1_500_000_000_000);
    }

    #[test]
    fn what_is_no_time_is_refused() {
        for text in ["-1.5", "nan", "inf", "6.95e-310", "1e300", "99999999999999999999"] {
            assert_eq!(Stamp::parse_seconds(text), Err(ParseStampError::Unusable), "{text}");
        }
        for text in ["", "pippo", "1.2.3", "0x10"] {
            assert_eq!(Stamp::parse_seconds(text), Err(ParseStampError::NotANumber), "{text}");
        }
    }

    proptest! {
        #[test]
        fn display_reads_back(nanoseconds in 0..i64::MAX) {
            let stamp = Stamp::from_nanoseconds(nanoseconds);
            prop_assert_eq!(Stamp::parse_seconds(&stamp.to_string()), Ok(stamp));
        }
    }
}
