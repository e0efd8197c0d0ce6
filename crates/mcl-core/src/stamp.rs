use std::fmt;

const NANOSECONDS_PER_SECOND: i64 = 1_000_000_000;

/// A time stamp: integer nanoseconds since the epoch of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Stamp(i64);

/// The error for text that is not a valid stamp.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ParseStampError {
    /// The text is not a decimal number.
    #[error("not a decimal number of seconds")]
    NotANumber,
    /// The number is not a usable time: not finite, denormal, or outside the years 1677 to 2262.
    #[error("not a usable time (not finite, below a nanosecond, or too large)")]
    Unusable,
}

impl Stamp {
    /// Creates a stamp from integer nanoseconds.
    pub const fn from_nanoseconds(nanoseconds: i64) -> Self {
        Stamp(nanoseconds)
    }

    /// The stamp in integer nanoseconds.
    pub const fn nanoseconds(self) -> i64 {
        self.0
    }

    /// The stamp in seconds. A float cannot hold all digits of an epoch time; use the nanoseconds for arithmetic.
    pub fn seconds(self) -> f64 {
        self.0 as f64 / NANOSECONDS_PER_SECOND as f64
    }

    /// Seconds from `earlier` to this stamp. The difference is taken in exact nanoseconds.
    pub fn seconds_since(self, earlier: Stamp) -> f64 {
        (i128::from(self.0) - i128::from(earlier.0)) as f64 / NANOSECONDS_PER_SECOND as f64
    }

    /// Parses decimal seconds (`1071078718.462310`) digit by digit, not through a float; digits
    /// beyond the nanosecond are rounded half away from zero. Negative numbers are times before the epoch, because
    /// stamps may be relative to the start of another recording. Scientific notation, which some programs write for
    /// small or uninitialised values, is parsed through a float.
    ///
    /// # Errors
    /// [`ParseStampError::NotANumber`] for text that is not a number, [`ParseStampError::Unusable`]
    /// for numbers that are not a time: NaN, infinite, nonzero but below a nanosecond
    /// (an uninitialised double often prints as 6.9e-310), or outside the range of 64 bits.
    pub fn parse_seconds(text: &str) -> Result<Self, ParseStampError> {
        let value: f64 = text.parse().map_err(|_| ParseStampError::NotANumber)?;
        let smallest = 1.0 / NANOSECONDS_PER_SECOND as f64;
        if !value.is_finite() || (value != 0.0 && value.abs() < 0.5 * smallest) {
            return Err(ParseStampError::Unusable);
        }
        let (is_negative, magnitude) = match text.strip_prefix('-') {
            Some(magnitude) => (true, magnitude),
            None => (false, text.strip_prefix('+').unwrap_or(text)),
        };
        let (whole, fraction) = magnitude.split_once('.').unwrap_or((magnitude, ""));
        let is_digits = |part: &str| part.bytes().all(|byte| byte.is_ascii_digit());
        if !is_digits(whole) || !is_digits(fraction) {
            let nanoseconds = (value * NANOSECONDS_PER_SECOND as f64).round();
            return if nanoseconds.abs() < i64::MAX as f64 {
                Ok(Stamp(nanoseconds as i64))
            } else {
                Err(ParseStampError::Unusable)
            };
        }
        let mut nanoseconds: i128 = 0;
        for position in 0..9 {
            let digit = fraction.as_bytes().get(position).map_or(0, |byte| byte - b'0');
            nanoseconds = nanoseconds * 10 + i128::from(digit);
        }
        if fraction.as_bytes().get(9).is_some_and(|&byte| byte >= b'5') {
            nanoseconds += 1;
        }
        let seconds: i64 = if whole.is_empty() {
            0
        } else {
            whole.parse().map_err(|_| ParseStampError::Unusable)?
        };
        let total = i128::from(seconds) * i128::from(NANOSECONDS_PER_SECOND) + nanoseconds;
        i64::try_from(if is_negative { -total } else { total })
            .map(Stamp)
            .map_err(|_| ParseStampError::Unusable)
    }
}

/// Writes exact decimal seconds with nine digits after the point.
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

    /// These were once refused, but stamps may be relative to the start of another recording.
    #[test]
    fn negative_numbers_are_times_before_the_epoch() {
        let cases = [
            ("-0.049999952", -49_999_952),
            ("-1.5", -1_500_000_000),
            ("-.5", -500_000_000),
            ("-0", 0),
        ];
        for (text, nanoseconds) in cases {
            assert_eq!(Stamp::parse_seconds(text), Ok(Stamp(nanoseconds)), "{text}");
        }
        assert_eq!(Stamp::parse_seconds("-1.9999999996"), Ok(Stamp(-2_000_000_000)));
        assert_eq!(Stamp::parse_seconds("-1.5e3"), Ok(Stamp(-1_500_000_000_000)));
        assert_eq!(Stamp::parse_seconds("--1"), Err(ParseStampError::NotANumber));
    }

    #[test]
    fn text_that_is_not_a_time_is_refused() {
        for text in [
            "nan",
            "inf",
            "-inf",
            "-6.95e-310",
            "-1e300",
            "6.95e-310",
            "1e300",
            "99999999999999999999",
        ] {
            assert_eq!(Stamp::parse_seconds(text), Err(ParseStampError::Unusable), "{text}");
        }
        for text in ["", "pippo", "1.2.3", "0x10"] {
            assert_eq!(Stamp::parse_seconds(text), Err(ParseStampError::NotANumber), "{text}");
        }
    }

    proptest! {
        #[test]
        fn display_reads_back(nanoseconds in i64::MIN..=i64::MAX) {
            let stamp = Stamp::from_nanoseconds(nanoseconds);
            prop_assert_eq!(Stamp::parse_seconds(&stamp.to_string()), Ok(stamp));
        }
    }
}
