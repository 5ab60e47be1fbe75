//! A limit on the memory of the process, for long work that would rather stop than swap.

use std::sync::atomic::{AtomicU64, Ordering};
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
    /// Resident bytes when the limit was found exceeded; 0 until then. One number, so that nobody sees one without the other.
    exceeded_at: AtomicU64,
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
            exceeded_at: AtomicU64::new(0),
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
        match (self.limit, self.exceeded_at.load(Ordering::Relaxed)) {
            (Some(limit), used) if used > 0 => Err(MemoryError::Exceeded { limit, used }),
            _ => Ok(()),
        }
    }

    fn measure(&self) {
        if let (Some(limit), Some(used)) = (self.limit, resident_bytes())
            && used > limit
        {
            // The first to notice is the one that counts.
            let _ = self.exceeded_at.compare_exchange(0, used, Ordering::Relaxed, Ordering::Relaxed);
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
        self.exceeded_at.load(Ordering::Relaxed) > 0 || self.progress.is_cancelled()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Barrier;

    use super::*;
    use crate::progress::Silent;

    #[test]
    fn every_thread_that_hears_of_the_limit_hears_what_was_used() {
        const THREADS: usize = 4;
        for round in 0..200 {
            let Ok(guard) = MemoryGuard::new(Some(1), &Silent) else {
                assert!(resident_bytes().is_none(), "round {round}: refused where memory can be measured");
                return;
            };
            let start = Barrier::new(THREADS);
            std::thread::scope(|scope| {
                for _ in 0..THREADS {
                    scope.spawn(|| {
                        start.wait();
                        let error = guard.check().expect_err("every process holds more than a byte");
                        let is_told = matches!(error, MemoryError::Exceeded { limit: 1, used: 2.. });
                        assert!(is_told, "round {round}: {error}");
                    });
                }
            });
        }
    }
}
