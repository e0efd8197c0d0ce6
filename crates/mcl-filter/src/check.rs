//! What settings may be.

use std::fmt::Display;
use std::ops::RangeInclusive;

use crate::FilterError;

/// Lengths outside of this (m) are typing errors, and squares of them would lose all meaning.
const LENGTHS: RangeInclusive<f64> = 1e-6..=1e6;

/// Refuses a value that fails `is_good`, in words.
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

/// Refuses what is no length of a room, a robot or a range finder.
pub(crate) fn check_length(field: &'static str, metres: f64) -> Result<(), FilterError> {
    check(field, metres, "metres from 0.000001 to 1,000,000", |m| LENGTHS.contains(m))
}

/// Refuses what is not above 0.
pub(crate) fn check_positive(field: &'static str, value: f64) -> Result<(), FilterError> {
    check(field, value, "a finite number above 0", |v| v.is_finite() && *v > 0.0)
}

/// Refuses what is no fraction.
pub(crate) fn check_share(field: &'static str, share: f64) -> Result<(), FilterError> {
    check(field, share, "a fraction from 0 to 1", |s| (0.0..=1.0).contains(s))
}

/// Refuses what is negative or no number.
pub(crate) fn check_amount(field: &'static str, amount: f64) -> Result<(), FilterError> {
    check(field, amount, "a finite number, at least 0", |a| a.is_finite() && *a >= 0.0)
}

/// Refuses what is no standard deviation.
pub(crate) fn check_std(field: &'static str, std: f64) -> Result<(), FilterError> {
    check(field, std, "a finite standard deviation, at least 0", |s| s.is_finite() && *s >= 0.0)
}
