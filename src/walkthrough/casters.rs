//! What casts shadows after something was hidden, looked through or moved: worked out by a thread of its own, since it looks at all
//! voxels.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use crate::filter::Filter;
use crate::gpu::clear::ClearBricks;
use crate::loaded::LoadedScene;
use crate::moved::{Moved, MovedVoxels};
use crate::visibility::QueryScene;

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
    under_way: Option<Receiver<Casters>>,
    /// Something has changed since it began.
    is_stale: bool,
}

impl CasterWorker {
    /// Begins, or begins anew when the one under way is done.
    ///
    /// # Errors
    ///
    /// The system has no more threads.
    pub fn change(
        &mut self,
        scene: &Arc<LoadedScene>,
        filter: &Arc<Filter>,
        moved: Option<&Arc<Moved>>,
    ) -> Result<(), WorkerError> {
        self.is_stale = self.under_way.is_some();
        if self.is_stale {
            return Ok(());
        }
        let (tell, told) = channel();
        let (scene, filter, moved) = (Arc::clone(scene), Arc::clone(filter), moved.cloned());
        std::thread::Builder::new().name("casters".into()).spawn(move || {
            let size = scene.scene().grid().voxel_size;
            let moved = moved.map_or(Ok(None), |moved| moved.voxels(size)).map_err(ShadowFault::Moved);
            // Nobody waits any more: the walk is over.
            let _ = tell.send(Casters { clear: clear_bricks(&scene, &filter), moved });
        })?;
        self.under_way = Some(told);
        Ok(())
    }

    /// Is a thread at it?
    pub fn is_busy(&self) -> bool {
        self.under_way.is_some()
    }

    /// What was found, and whether that is of an older state; waits for it if asked to.
    ///
    /// # Errors
    ///
    /// The thread has died.
    pub fn take(&mut self, wait: bool) -> Result<Option<(Casters, bool)>, WorkerError> {
        let Some(told) = &self.under_way else { return Ok(None) };
        let found = if wait { told.recv().map_err(|_| TryRecvError::Disconnected) } else { told.try_recv() };
        match found {
            Ok(casters) => {
                self.under_way = None;
                Ok(Some((casters, self.is_stale)))
            }
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => {
                self.under_way = None;
                Err(WorkerError::Died)
            }
        }
    }
}

/// Voxels all of whose owners a filter hides or looks through, or are of glass.
pub(super) fn clear_bricks(scene: &LoadedScene, filter: &Filter) -> ClearBricks {
    let query = QueryScene { filter, ..scene.query() };
    let casts = |drawable| query.casts(drawable);
    if (0..query.exact.drawable_count()).all(casts) {
        return ClearBricks::default();
    }
    ClearBricks::new(&query.dag, &query.owners, casts)
}
