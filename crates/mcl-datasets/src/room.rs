//! Checks that there is memory for what is kept of a log, before it is allocated.

use mcl_core::OutOfMemory;
use mcl_core::memory::check_room;

/// Bytes kept between two checks.
const STEP_BYTES: usize = 8 << 20;
/// Upper bound on the overhead of an allocation, in bytes.
pub(crate) const HEAP_BYTES: usize = 32;

/// Tracks how much is kept of a log.
#[derive(Debug)]
pub(crate) struct Room {
    kept: usize,
    asked: usize,
}

/// No check is made for a log of which little is kept: the check itself takes memory.
impl Default for Room {
    fn default() -> Self {
        Room { kept: 0, asked: STEP_BYTES }
    }
}

impl Room {
    /// Records that this many more bytes are kept. From time to time, checks that there is memory for as many
    /// again as will be kept until the next check, and for `later`, which is allocated when all is read.
    ///
    /// # Errors
    /// [`OutOfMemory`].
    pub fn take(&mut self, bytes: usize, later: usize) -> Result<(), OutOfMemory> {
        self.kept = self.kept.saturating_add(bytes);
        if self.kept >= self.asked {
            check_room((2 * STEP_BYTES).saturating_add(later), 1, "scans and poses of the log")?;
            self.asked = self.kept.saturating_add(STEP_BYTES);
        }
        Ok(())
    }

    /// Bytes kept so far.
    pub fn kept(&self) -> u64 {
        self.kept as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_amounts_of_memory_are_refused_before_allocation() {
        let mut room = Room::default();
        room.take(100, 1000).unwrap();
        // Checked from time to time only.
        room.take(100, usize::MAX / 2).unwrap();
        let refused = room.take(STEP_BYTES, usize::MAX / 4).unwrap_err();
        assert!(refused.to_string().contains("scans and poses of the log were refused"));
        assert_eq!(room.kept(), (STEP_BYTES + 200) as u64);
    }
}
