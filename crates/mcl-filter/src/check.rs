//! Checks of the ranges of settings.

use std::fmt::Display;
use std::ops::RangeInclusive;

use crate::FilterError;

/// Accepted lengths (m). Others are typing errors, and their squares would lose all precision.
const LENGTHS: RangeInclusive<f64> = 1e-6..=1e6;

/// Returns an error for a value that fails `is_good`.
pub(crate) fn check<T: Display>(
    field: &'static str,
    value: T,
    expected: &'static str,
    is_good: impl Fn(&T) -> bool,
) -> Result<(), FilterError> {
    if is_good(&value) {
        Ok(())
    } else {
        Err(FilterError::Setting { field, found: value.to_string(), expected })
    }
}

/// Returns an error unless the value is a plausible length for a room, a robot or a range finder.
pub(crate) fn check_length(field: &'static str, metres: f64) -> Result<(), FilterError> {
    check(field, metres, "metres from 0.000001 to 1,000,000", |m| LENGTHS.contains(m))
}

/// Returns an error unless the value is above 0.
pub(crate) fn check_positive(field: &'static str, value: f64) -> Result<(), FilterError> {
    check(field, value, "a finite number above 0", |v| v.is_finite() && *v > 0.0)
}

/// Returns an error unless the value is a fraction.
pub(crate) fn check_share(field: &'static str, share: f64) -> Result<(), FilterError> {
    check(field, share, "a fraction from 0 to 1", |s| (0.0..=1.0).contains(s))
}

/// Returns an error if the value is negative or not finite.
pub(crate) fn check_amount(field: &'static str, amount: f64) -> Result<(), FilterError> {
    check(field, amount, "a finite number, at least 0", |a| a.is_finite() && *a >= 0.0)
}

/// Returns an error unless the value is a standard deviation.
pub(crate) fn check_std(field: &'static str, std: f64) -> Result<(), FilterError> {
    check(field, std, "a finite standard deviation, at least 0", |s| s.is_finite() && *s >= 0.0)
}
