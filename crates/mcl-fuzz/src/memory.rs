//! Memory in proportion to the input.

use peak_alloc::PeakAlloc;

#[global_allocator]
static ALLOCATED: PeakAlloc = PeakAlloc;

/// What a reader may take whatever the input: buffers, tables of a decompressor.
pub const ANY_INPUT: usize = 1 << 20;

/// Runs a reader and asserts that it never held more than `base + per_byte · length` bytes. One at a
/// time: the count is the whole process's.
pub fn bounded<T>(length: usize, base: usize, per_byte: usize, read: impl FnOnce() -> T) -> T {
    ALLOCATED.reset_peak_usage();
    let before = ALLOCATED.current_usage();
    let value = read();
    let taken = ALLOCATED.peak_usage().saturating_sub(before);
    let limit = base + per_byte * length;
    assert!(
        taken <= limit,
        "{taken} bytes of memory were taken for {length} bytes of input, more than {limit}"
    );
    value
}
