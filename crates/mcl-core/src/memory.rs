//! Fallible allocation for buffers whose size depends on data or settings. An ordinary failed allocation aborts a
//! Rust program; with these functions only the trial fails, and the others continue.
//!
//! All other allocations are small, but they fail too once no memory is left. Large allocations are therefore refused
//! while there is still a reserve for the small ones.

use std::hint::black_box;

/// An allocation that was refused for lack of memory.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "out of memory: {bytes} bytes for {what} were refused; use fewer or smaller of them, or fewer threads"
)]
pub struct OutOfMemory {
    /// What the memory was for, in the plural (`"particles"`).
    pub what: &'static str,
    /// The number of bytes requested.
    pub bytes: usize,
}

/// An allocation of at least this many bytes is large ...
const LARGE: usize = 1 << 20;
/// ... and must leave this many bytes for small ones.
const LEFT_FOR_SMALL: usize = 16 << 20;

/// Reserves room for `more` further items, like [`Vec::try_reserve`].
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

/// Returns an empty vector with room for exactly `number` items.
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

/// Checks that memory for `number` items of `bytes` bytes each is available, by allocating and freeing it. For use
/// before calling code that aborts when an allocation fails. No guarantee: other threads may take the memory first.
///
/// # Errors
/// [`OutOfMemory`].
pub fn check_room(number: usize, bytes: usize, what: &'static str) -> Result<(), OutOfMemory> {
    // The optimizer may remove an allocation that is never used.
    with_room::<u8>(number.saturating_mul(bytes), what).map(|room| drop(black_box(room)))
}

/// Whether the reserve for small allocations remains after a large one of `bytes` bytes.
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
    fn more_memory_than_any_machine_has_is_refused_with_an_error() {
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
