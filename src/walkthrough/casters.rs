//! What casts shadows after something was hidden, looked through or moved: worked out by a thread of its own, since it looks at all
//! voxels. What was found about an older state is not used: a newer one is worked out at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use crate::gpu::clear::ClearBricks;
use crate::moved::MovedVoxels;
use crate::progress::{CancelFlag, Progress};
use crate::shown::Shown;

use super::ShadowFault;
use super::worker::WorkerError;

/// What the thread found.
pub(super) struct Casters {
    /// Voxels of the scene that cast nothing.
    pub clear: ClearBricks,
    /// Voxels of what was moved.
    pub moved: Result<Option<MovedVoxels>, ShadowFault>,
}

/// At most one thread, about the newest change.
#[derive(Default)]
pub(super) struct CasterWorker {
    under_way: Option<Receiver<Option<Casters>>>,
    /// What it was last asked about.
    asked: Option<Arc<Shown>>,
    /// Something has changed since it began: it should stop.
    is_stale: Arc<AtomicBool>,
}

impl Drop for CasterWorker {
    fn drop(&mut self) {
        self.is_stale.store(true, Ordering::Relaxed);
    }
}

impl CasterWorker {
    /// Begins, or begins anew as soon as the one under way has stopped. Clip planes change nothing: rays are clipped by them.
    ///
    /// # Errors
    ///
    /// The system has no more threads.
    pub fn change(&mut self, shown: &Arc<Shown>) -> Result<(), WorkerError> {
        let is_same = |asked: &Arc<Shown>| {
            asked.filter().is_same_but_for_planes(shown.filter()) && asked.motions() == shown.motions()
        };
        if self.asked.as_ref().is_some_and(is_same) {
            return Ok(());
        }
        self.asked = Some(Arc::clone(shown));
        self.begin()
    }

    /// Begins with what was last asked about.
    fn begin(&mut self) -> Result<(), WorkerError> {
        if self.under_way.is_some() {
            self.is_stale.store(true, Ordering::Relaxed);
            return Ok(());
        }
        let Some(shown) = self.asked.clone() else { return Ok(()) };
        self.is_stale = Arc::default();
        let is_stale = Arc::clone(&self.is_stale);
        let (tell, told) = channel();
        std::thread::Builder::new().name("casters".into()).spawn(move || {
            let stop = CancelFlag(&is_stale);
            let size = shown.scene().scene().grid().voxel_size;
            let moved = shown.moved().map_or(Ok(None), |moved| moved.voxels(size, &stop));
            let casters = (!stop.is_cancelled())
                .then(|| Casters { clear: clear_bricks(&shown), moved: moved.map_err(ShadowFault::Moved) });
            // Nobody waits any more: the walk is over.
            let _ = tell.send(casters.filter(|_| !stop.is_cancelled()));
        })?;
        self.under_way = Some(told);
        Ok(())
    }

    /// Is a thread at it?
    pub fn is_busy(&self) -> bool {
        self.under_way.is_some()
    }

    /// What was found about the newest state; waits for it if asked to.
    ///
    /// # Errors
    ///
    /// The thread has died; no more threads.
    pub fn take(&mut self, wait: bool) -> Result<Option<Casters>, WorkerError> {
        while let Some(told) = &self.under_way {
            let found =
                if wait { told.recv().map_err(|_| TryRecvError::Disconnected) } else { told.try_recv() };
            if let Err(TryRecvError::Empty) = found {
                return Ok(None);
            }
            self.under_way = None;
            match found.map_err(|_| WorkerError::Died)? {
                Some(casters) if !self.is_stale.load(Ordering::Relaxed) => return Ok(Some(casters)),
                // It has stopped for something newer, or was done before that came.
                Some(_) | None => self.begin()?,
            }
        }
        Ok(None)
    }
}

/// Voxels all of whose owners are hidden, elsewhere, looked through or of glass.
pub(super) fn clear_bricks(shown: &Shown) -> ClearBricks {
    let query = shown.unmoved();
    let casts = |drawable| query.casts(drawable);
    if (0..query.exact.drawable_count()).all(casts) {
        return ClearBricks::default();
    }
    ClearBricks::new(&query.dag, &query.owners, casts)
}
