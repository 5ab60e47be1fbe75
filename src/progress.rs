//! How long work tells where it stands and learns that it should stop.

use std::sync::atomic::{AtomicBool, Ordering};

/// Receives progress. The command line draws bars; a library user may pass [`Silent`].
pub trait Progress: Sync {
    /// A stage begins; `total` counts `unit`s (0 when unknown).
    fn stage(&self, name: &str, total: u64, unit: &str);
    /// `count` more units of the current stage are done. Called from any thread.
    fn advance(&self, count: u64);
    /// True when the work should stop soon. Long loops ask this at least every 100 ms or so.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// No output, never cancelled.
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _name: &str, _total: u64, _unit: &str) {}
    fn advance(&self, _count: u64) {}
}

/// No output; stops when the flag is set.
pub struct CancelFlag<'a>(pub &'a AtomicBool);

impl Progress for CancelFlag<'_> {
    fn stage(&self, _name: &str, _total: u64, _unit: &str) {}
    fn advance(&self, _count: u64) {}
    fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// No output; stops when another does: for work inside a stage of something larger.
pub struct Quiet<'a>(pub &'a dyn Progress);

impl Progress for Quiet<'_> {
    fn stage(&self, _name: &str, _total: u64, _unit: &str) {}
    fn advance(&self, _count: u64) {}
    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}
