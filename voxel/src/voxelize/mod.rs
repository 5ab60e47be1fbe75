//! Conservative voxelization of drawables into a DAG with owners, block by block (Xue et al. 2016, section 3.2).
//!
//! 1. *Bin*: drawables are loaded in batches of about equal triangle count; each drawable goes whole to the one block
//!    that holds it, or its triangles go to the blocks that they touch.
//! 2. *Build*: each block voxelizes its triangles into bricks and turns them into a sub-DAG with owner runs.
//! 3. *Merge*: sub-DAGs join the global tables in depth-first order, and nodes above the blocks are made.
//!
//! Batches and blocks run in parallel, but what they give is joined in a fixed order: the same bits come out for any
//! number of threads.

mod bin;
mod block;
pub mod overlap;

use rayon::prelude::*;

use crate::dag::build::{DagTables, NodeDraft};
use crate::dag::owners::{OwnerBuilder, OwnerTable};
use crate::dag::{Dag, DagError, root_height};
use crate::grid::Grid;

/// Blocks are sub-trees of this height or of the whole grid: 256 voxels a side.
const BLOCK_HEIGHT: u32 = 3;
/// Blocks built between two merges, so that few sub-DAGs wait in memory.
const BLOCKS_PER_ROUND: usize = 256;

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
    /// Triangles of a drawable, to balance the work.
    fn triangle_count(&self, drawable: u32) -> u32;
    /// Replaces `mesh` by the drawable's triangles. Called at most twice for each, from any thread.
    fn load(&self, drawable: u32, mesh: &mut SnappedMesh);
    /// `triangles` more are done; true when the work should stop.
    fn advance(&self, triangles: u64) -> bool {
        let _ = triangles;
        false
    }
}

/// What voxelization gives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Voxelized {
    /// Occupied voxels.
    pub dag: Dag,
    /// Who occupies them.
    pub owners: OwnerTable,
}

/// Voxelizes all drawables: a voxel is occupied, and owned by a drawable, if one of the drawable's triangles touches it
/// ([`overlap`] says exactly when).
pub fn voxelize(grid: &Grid, drawables: &dyn Drawables) -> Result<Voxelized, DagError> {
    if drawables.count() > 1 << 31 {
        return Err(DagError::TooManyOwners { what: "drawables" });
    }
    let height = root_height(grid.log2);
    let block_height = height.min(BLOCK_HEIGHT);
    let bins = bin::bin(drawables, block_height, grid.log2)?;

    let mut tables = DagTables::new(height);
    let mut owners = OwnerBuilder::default();
    let mut upper = UpperNodes::new(block_height, height);
    let blocks: Vec<bin::Block> = bins.blocks().collect();
    for round in blocks.chunks(BLOCKS_PER_ROUND) {
        let built: Vec<_> = round
            .par_iter()
            .map_init(block::Scratch::default, |scratch, block| {
                scratch.build(block, &bins, drawables, block_height, grid.side() as i32)
            })
            .collect();
        for (block, built) in round.iter().zip(built) {
            let Some(built) = built? else { continue };
            let (node, bricks) = tables.merge(&built.tables, built.root)?;
            owners.append(&built.owners)?;
            upper.push(&mut tables, block.key, node, bricks)?;
        }
    }
    let root = upper.finish(&mut tables)?;
    Ok(Voxelized { dag: tables.finish(grid.log2, root)?, owners: owners.finish() })
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

/// Nodes above the blocks, made as the blocks come in depth-first order.
struct UpperNodes {
    block_height: u32,
    /// Draft of the open node of height `block_height + 1 + i`, and its key.
    open: Vec<(NodeDraft, u64)>,
    /// The only block when the block is the root.
    single: Option<u32>,
}

impl UpperNodes {
    fn new(block_height: u32, height: u32) -> Self {
        let open = (block_height..height).map(|_| (NodeDraft::default(), 0)).collect();
        UpperNodes { block_height, open, single: None }
    }

    /// The next block: `key` is its path from the root, six bits a height.
    fn push(&mut self, tables: &mut DagTables, key: u64, node: u32, bricks: u32) -> Result<(), DagError> {
        if self.open.is_empty() {
            self.single = Some(node);
        }
        self.add(tables, 0, key, node, bricks)
    }

    /// Adds a child with path `key` to the open node `above`, closing it first when it is another one's child.
    fn add(
        &mut self,
        tables: &mut DagTables,
        above: usize,
        key: u64,
        node: u32,
        bricks: u32,
    ) -> Result<(), DagError> {
        let Some((draft, open_key)) = self.open.get(above) else { return Ok(()) };
        if !draft.is_empty() && *open_key != key >> 6 {
            self.close(tables, above)?;
        }
        let (draft, open_key) = &mut self.open[above];
        *open_key = key >> 6;
        draft.push((key & 63) as u32, node, bricks);
        Ok(())
    }

    fn close(&mut self, tables: &mut DagTables, above: usize) -> Result<u32, DagError> {
        let (draft, key) = &mut self.open[above];
        let (node, bricks) = tables.heights[self.block_height as usize + above].intern(draft)?;
        draft.clear();
        let key = *key;
        self.add(tables, above + 1, key, node, bricks)?;
        Ok(node)
    }

    fn finish(mut self, tables: &mut DagTables) -> Result<Option<u32>, DagError> {
        let mut root = self.single;
        for above in 0..self.open.len() {
            if !self.open[above].0.is_empty() {
                root = Some(self.close(tables, above)?);
            }
        }
        Ok(root)
    }
}
