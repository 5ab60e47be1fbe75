//! A limit on the memory of the process, for long work that would rather stop than swap.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use super::resources::resident_bytes;
use crate::progress::Progress;

/// Asking the system costs some microseconds: it is done no more often than this.
const CHECK_EVERY_MS: u64 = 10;

/// Why work under a memory limit cannot go on.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MemoryError {
    /// The limit was reached.
    #[error(
        "stopped at {used} bytes of memory, over the limit of {limit}; nothing was written: \
         choose a lower resolution, or allow more"
    )]
    Exceeded {
        /// As set, bytes.
        limit: u64,
        /// Resident bytes when it was noticed.
        used: u64,
    },
    /// The system does not tell how much memory is used.
    #[error("a memory limit needs a system that tells a program its resident memory (/proc/self/status)")]
    Unknown,
}

/// Passes progress on, and cancels the work when the process holds more resident memory than allowed.
pub struct MemoryGuard<'a> {
    limit: Option<u64>,
    progress: &'a dyn Progress,
    started: Instant,
    next_check_ms: AtomicU64,
    exceeded: AtomicBool,
    /// Resident bytes when the limit was found exceeded.
    used: AtomicU64,
}

impl<'a> MemoryGuard<'a> {
    /// Without a `limit` (bytes) it only passes progress on.
    ///
    /// # Errors
    ///
    /// [`MemoryError::Unknown`] where memory cannot be measured.
    pub fn new(limit: Option<u64>, progress: &'a dyn Progress) -> Result<Self, MemoryError> {
        if limit.is_some() && resident_bytes().is_none() {
            return Err(MemoryError::Unknown);
        }
        Ok(MemoryGuard {
            limit,
            progress,
            started: Instant::now(),
            next_check_ms: AtomicU64::new(0),
            exceeded: AtomicBool::new(false),
            used: AtomicU64::new(0),
        })
    }

    /// Bytes that the voxel core may plan with: what the process does not hold yet, less an eighth for what no plan
    /// knows of (the allocator, threads, buffers).
    pub fn left_for_voxels(&self) -> Option<u64> {
        let limit = self.limit?;
        let left = limit.saturating_sub(resident_bytes().unwrap_or(0));
        Some(left - left / 8)
    }

    /// [`MemoryError::Exceeded`] once the limit was found exceeded; measures now.
    pub fn check(&self) -> Result<(), MemoryError> {
        self.measure();
        match self.limit {
            Some(limit) if self.exceeded.load(Ordering::Relaxed) => {
                Err(MemoryError::Exceeded { limit, used: self.used.load(Ordering::Relaxed) })
            }
            _ => Ok(()),
        }
    }

    fn measure(&self) {
        if let (Some(limit), Some(used)) = (self.limit, resident_bytes())
            && used > limit
            && !self.exceeded.swap(true, Ordering::Relaxed)
        {
            self.used.store(used, Ordering::Relaxed);
        }
    }
}

impl Progress for MemoryGuard<'_> {
    fn stage(&self, name: &str, total: u64, unit: &str) {
        self.progress.stage(name, total, unit);
    }

    fn advance(&self, count: u64) {
        self.progress.advance(count);
    }

    fn is_cancelled(&self) -> bool {
        if self.limit.is_some() {
            let now = self.started.elapsed().as_millis() as u64;
            let due = self.next_check_ms.load(Ordering::Relaxed);
            let mine = now >= due
                && self
                    .next_check_ms
                    .compare_exchange(due, now + CHECK_EVERY_MS, Ordering::Relaxed, Ordering::Relaxed)
                    .is_ok();
            if mine {
                self.measure();
            }
        }
        self.exceeded.load(Ordering::Relaxed) || self.progress.is_cancelled()
    }
}
