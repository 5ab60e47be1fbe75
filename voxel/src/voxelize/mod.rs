//! Conservative voxelization of drawables into a DAG with owners, piece by piece (Xue et al. 2016, section 3.2).
//!
//! 1. *Plan*: every drawable is loaded once for its box and size. From the root down, a cell whose drawables are too
//!    much is cut into its 4^3 children; a cell whose drawables are little enough is a task.
//! 2. *Build*, in parallel: a task loads its drawables again, narrows their triangles down to blocks of 256^3 voxels, makes the
//!    bricks of each block, and turns them into one sub-DAG with owner pages.
//! 3. *Join*, while others are built: sub-DAGs join the global tables in depth-first order, owner pages leave for the
//!    caller's sink, and nodes above the tasks are made.
//!
//! Memory: the tables of the DAG, and a bounded number of tasks, each of bounded size. Bits: all tables are ordered by first
//! occurrence in depth-first order, and owner pages end where the grid and the drawables say, so that the same bits come
//! out for any number of threads and any way of cutting.

mod block;
mod cell;
mod join;
pub mod overlap;
mod pipeline;
mod plan;
mod task;
#[cfg(test)]
mod tests;

use std::io;
use std::ops::ControlFlow;

use cell::Cell;
use join::Joiner;
use pipeline::{Take, Work, run_in_order};
use plan::{DENSE_TRIANGLES, Task, Tasks};
use task::{SubDag, TaskBuilder};

use crate::dag::{Dag, DagError, OwnerTable, root_height};
use crate::grid::Grid;

/// Tasks, for each thread, that may be begun and not joined. Many, so that threads go on while one dense task takes long:
/// bytes are what bounds them.
const WINDOW_PER_THREAD: usize = 32;
/// Bytes that tasks begun and not joined may come to, however much memory there is.
const WINDOW_BYTES: u64 = 1 << 28;

/// A triangle's corners, snapped to 1/256 voxel ([`Grid::snap`]).
pub type SnappedTriangle = [[i32; 3]; 3];

/// Triangles of one drawable, snapped.
#[derive(Clone, Debug, Default)]
pub struct SnappedMesh {
    /// Vertices in steps of 1/256 voxel from the grid's low corner, inside the grid.
    pub vertices: Vec<[i32; 3]>,
    /// Corners; every index is below `vertices.len()`.
    pub triangles: Vec<[u32; 3]>,
}

impl SnappedMesh {
    fn iter(&self) -> impl Iterator<Item = SnappedTriangle> {
        self.triangles.iter().map(|t| t.map(|corner| self.vertices[corner as usize]))
    }
}

/// What is voxelized: drawables 0 to `count`.
pub trait Drawables: Sync {
    /// How many.
    fn count(&self) -> u32;
    /// Replaces `mesh` by the drawable's triangles, the same ones each time. Called from any thread, once to plan and once
    /// for each task whose cell the drawable's box touches: a few times for most, more for those that are much larger than a
    /// task's cell. It should be cheap: decode and transform, read nothing from a disk.
    ///
    /// Drawables are best small against the grid, or of few triangles: one of millions is never cut for their sake.
    fn load(&self, drawable: u32, mesh: &mut SnappedMesh);
    /// `triangles` more are done (each counted once); `Break` when the work should stop. Called often, also with 0.
    fn advance(&self, triangles: u64) -> ControlFlow<()> {
        let _ = triangles;
        ControlFlow::Continue(())
    }
}

/// Where owner pages go as they are made: memory, or a file.
pub trait OwnerSink {
    /// Stores words behind those before.
    ///
    /// # Errors
    ///
    /// Ends the voxelization.
    fn append(&mut self, words: &[u64]) -> io::Result<()>;
}

impl OwnerSink for Vec<u64> {
    fn append(&mut self, words: &[u64]) -> io::Result<()> {
        self.extend_from_slice(words);
        Ok(())
    }
}

/// How the work is cut. Nothing here changes the result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Bytes that the DAG's tables and the work on them may hold: fewer tasks wait when it is short. `None` for no limit.
    pub memory: Option<u64>,
    /// A cell whose drawables have more triangles is cut.
    pub task_triangles: u64,
    /// A cell that holds more bricks, as estimated, is cut.
    pub task_bricks: u64,
    /// Greatest height of the blocks, 1 to 3: 16, 64 or 256 voxels a side.
    pub block_height: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            memory: None,
            task_triangles: 1 << 18,
            task_bricks: 1 << 20,
            block_height: block::MAX_BLOCK_HEIGHT,
        }
    }
}

/// Why voxelization ended without a result.
#[derive(Debug, thiserror::Error)]
pub enum VoxelizeError {
    /// The DAG outgrows its form.
    #[error(transparent)]
    Dag(#[from] DagError),
    /// The sink took no more owner pages.
    #[error("the owners of the voxels cannot be stored: {0}")]
    Owners(#[source] io::Error),
    /// The result itself, or one task's share of it, is larger than the memory that was allowed.
    #[error(
        "the voxel DAG alone needs more than {used} bytes of the {limit} that are left for it: \
         choose a lower resolution, or allow more memory"
    )]
    Memory {
        /// As set, bytes.
        limit: u64,
        /// Bytes of the tables when they outgrew it.
        used: u64,
    },
    /// A cell holds more than 32-bit indices can tell apart.
    #[error("a cell of {side} voxels a side holds more than {most} {what}: choose a higher resolution")]
    Crowded {
        /// Voxels a side of the cell.
        side: u64,
        /// As many as there may be.
        most: u64,
        /// Of what.
        what: &'static str,
    },
    /// [`Drawables::advance`] said so.
    #[error("cancelled")]
    Cancelled,
}

/// What voxelization gives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Voxelized {
    /// Occupied voxels.
    pub dag: Dag,
    /// Who occupies them.
    pub owners: OwnerTable,
}

/// What [`voxelize_into`] gives: all but the owner pages, which went to the sink.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Streamed {
    /// Occupied voxels.
    pub dag: Dag,
    /// First ordinal and first word of each owner page: [`OwnerTable::directory`].
    pub owner_directory: Vec<[u64; 2]>,
    /// Words of all owner pages.
    pub owner_words: u64,
    /// What it took.
    pub cost: Cost,
}

/// How the work went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Cells built apart.
    pub tasks: u64,
    /// Triangles loaded, planning included; those of a drawable once for each task.
    pub loaded_triangles: u64,
}

/// Voxelizes all drawables: a voxel is occupied, and owned by a drawable, if one of the drawable's triangles touches it
/// ([`overlap`] says exactly when).
///
/// # Errors
///
/// The DAG or a cell of it outgrows 32-bit offsets, or the work was cancelled.
pub fn voxelize(grid: &Grid, drawables: &dyn Drawables) -> Result<Voxelized, VoxelizeError> {
    let mut pages = Vec::new();
    let Streamed { dag, owner_directory, .. } =
        voxelize_into(grid, drawables, &Settings::default(), &mut pages)?;
    Ok(Voxelized { dag, owners: OwnerTable { directory: owner_directory, pages } })
}

/// Voxelizes all drawables within a limit of memory. Owner pages go to `sink` in order, while the rest is still being
/// built.
///
/// # Errors
///
/// As [`voxelize`]; also when the sink fails, or when the DAG itself, or a task, outgrows [`Settings::memory`].
///
/// # Threads
///
/// Works on as many threads as the current rayon pool has. They are new ones, beside the pool: a caller on a thread of a pool
/// of N waits, doing what else the pool has to do, while N more threads work; and when [`Drawables::load`] or the sink uses
/// rayon, that runs in the global pool.
pub fn voxelize_into(
    grid: &Grid,
    drawables: &dyn Drawables,
    settings: &Settings,
    sink: &mut (dyn OwnerSink + Send),
) -> Result<Streamed, VoxelizeError> {
    voxelize_cutting(grid, drawables, settings, DENSE_TRIANGLES, sink)
}

/// [`voxelize_into`], with another idea of what is dense.
fn voxelize_cutting(
    grid: &Grid,
    drawables: &dyn Drawables,
    settings: &Settings,
    dense_triangles: u64,
    sink: &mut (dyn OwnerSink + Send),
) -> Result<Streamed, VoxelizeError> {
    let height = root_height(grid.log2);
    let root = Cell { corner: [0; 3], height };
    let tasks = Tasks::plan(drawables, settings, dense_triangles, root)?;
    let build = Build {
        drawables,
        block_height: settings.block_height.clamp(1, height.min(block::MAX_BLOCK_HEIGHT)),
        height,
        side: grid.side() as i32,
        memory: settings.memory,
    };
    let join = Join {
        joiner: Joiner::new(height, sink),
        memory: settings.memory,
        drawables,
        cost: Cost { tasks: 0, loaded_triangles: tasks.planned_triangles() },
    };
    let window = WINDOW_PER_THREAD * rayon::current_num_threads();
    let (_, join, result) = run_in_order(tasks, &build, join, window);
    result?;
    let Join { joiner, cost, .. } = join;
    let owner_words = joiner.owner_words();
    let (dag, owner_directory) = joiner.finish(grid.log2)?;
    Ok(Streamed { dag, owner_directory, owner_words, cost })
}

/// Visits all cells from `first` to `last`, both included, x fastest.
fn for_each_cell(first: [i32; 3], last: [i32; 3], mut visit: impl FnMut([i32; 3])) {
    for z in first[2]..=last[2] {
        for y in first[1]..=last[1] {
            for x in first[0]..=last[0] {
                visit([x, y, z]);
            }
        }
    }
}

/// Tells the caller that `triangles` more are done, and asks whether to stop.
fn go_on(drawables: &dyn Drawables, triangles: u64) -> Result<(), VoxelizeError> {
    match drawables.advance(triangles) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(VoxelizeError::Cancelled),
    }
}

/// Builds tasks.
struct Build<'a> {
    drawables: &'a dyn Drawables,
    block_height: u32,
    height: u32,
    side: i32,
    memory: Option<u64>,
}

impl<'a> Work<Task, SubDag, VoxelizeError> for Build<'a> {
    type Scratch = TaskBuilder<'a>;

    fn scratch(&self) -> TaskBuilder<'a> {
        TaskBuilder::new(self.drawables, self.block_height, self.height, self.side, self.memory)
    }

    fn run(&self, task: Task, scratch: &mut TaskBuilder<'a>) -> Result<SubDag, VoxelizeError> {
        scratch.build(&task)
    }

    fn bytes(&self, part: &SubDag) -> u64 {
        part.bytes()
    }
}

/// Joins what tasks give, within the limit of memory.
struct Join<'a> {
    joiner: Joiner<'a>,
    memory: Option<u64>,
    drawables: &'a dyn Drawables,
    cost: Cost,
}

impl Take<SubDag, VoxelizeError> for Join<'_> {
    fn take(&mut self, part: SubDag) -> Result<(), VoxelizeError> {
        self.joiner.add(&part)?;
        self.cost.tasks += 1;
        self.cost.loaded_triangles += part.loaded_triangles;
        if let Some(limit) = self.memory {
            let used = self.joiner.bytes();
            if used > limit {
                return Err(VoxelizeError::Memory { limit, used });
            }
        }
        go_on(self.drawables, part.new_triangles)
    }

    fn allowance(&self) -> u64 {
        let left = self.memory.map_or(u64::MAX, |limit| limit.saturating_sub(self.joiner.bytes()));
        left.min(WINDOW_BYTES)
    }
}
