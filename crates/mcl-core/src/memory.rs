//! Memory whose amount data or settings decide. Asking for more than there is ends a Rust program at
//! once, unless it asks as here: then a trial fails, and the rest go on.
//!
//! All else a program asks for is small, but refused as well once there is nothing left; so what is
//! large is refused while there is still something left for the small.

use std::hint::black_box;

/// Memory that the system refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "out of memory: {bytes} bytes for {what} were refused; use fewer or smaller of them, or fewer threads"
)]
pub struct OutOfMemory {
    /// What it was for, in the plural.
    pub what: &'static str,
    /// How much was asked for.
    pub bytes: usize,
}

/// What has at least so many bytes is large ...
const LARGE: usize = 1 << 20;
/// ... and leaves so many for all that is small.
const LEFT_FOR_SMALL: usize = 16 << 20;

/// Makes room for `more` further items, as [`Vec::try_reserve`].
///
/// # Errors
/// [`OutOfMemory`].
#[inline]
pub fn reserve<T>(items: &mut Vec<T>, more: usize, what: &'static str) -> Result<(), OutOfMemory> {
    if items.capacity() - items.len() >= more {
        return Ok(());
    }
    let number = items.len().saturating_add(more);
    match items.try_reserve(more) {
        Ok(()) if leaves_enough(items.capacity().saturating_mul(size_of::<T>())) => Ok(()),
        _ => Err(refused::<T>(number, what)),
    }
}

/// An empty list with room for exactly `number` items.
///
/// # Errors
/// [`OutOfMemory`].
pub fn with_room<T>(number: usize, what: &'static str) -> Result<Vec<T>, OutOfMemory> {
    let mut items = Vec::new();
    match items.try_reserve_exact(number) {
        Ok(()) if leaves_enough(number.saturating_mul(size_of::<T>())) => Ok(items),
        _ => Err(refused::<T>(number, what)),
    }
}

/// Asks for as much memory as `number` items of `bytes` take, and gives it back: for what is about to be
/// taken by code that cannot be refused. Other threads may be faster, so this is no promise.
///
/// # Errors
/// [`OutOfMemory`].
pub fn check_room(number: usize, bytes: usize, what: &'static str) -> Result<(), OutOfMemory> {
    // An optimizer may leave out memory that nobody looks at.
    with_room::<u8>(number.saturating_mul(bytes), what).map(|room| drop(black_box(room)))
}

/// Whether something is left for the small after so many bytes were taken.
fn leaves_enough(bytes: usize) -> bool {
    let mut room = Vec::<u8>::new();
    bytes < LARGE || black_box(&mut room).try_reserve_exact(LEFT_FOR_SMALL).is_ok()
}

fn refused<T>(number: usize, what: &'static str) -> OutOfMemory {
    OutOfMemory { what, bytes: number.saturating_mul(size_of::<T>()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_machine_has_is_refused_and_told() {
        const TOO_MANY: usize = usize::MAX / 32;
        let refused = with_room::<f64>(TOO_MANY, "particles").unwrap_err();
        assert_eq!(refused, OutOfMemory { what: "particles", bytes: 8 * TOO_MANY });
        assert!(refused.to_string().contains(&format!("{} bytes for particles", 8 * TOO_MANY)));
        let mut items = vec![1u64];
        assert!(reserve(&mut items, TOO_MANY, "points").is_err());
        assert_eq!(items, [1]);
        assert!(check_room(usize::MAX, 2, "points").is_err());
    }

    #[test]
    fn room_is_made_at_once() {
        let items: Vec<u16> = with_room(1000, "points").unwrap();
        assert!(items.is_empty() && items.capacity() >= 1000);
        assert_eq!(check_room(1000, 16, "points"), Ok(()));
    }
}
