//! One block: triangles to bricks, bricks to a sub-DAG with owner runs.

use super::bin::{Bins, Block, Source};
use super::overlap::TriangleOverlap;
use super::{Drawables, SnappedMesh, SnappedTriangle};
use crate::dag::DagError;
use crate::dag::build::{DagTables, NodeDraft};
use crate::dag::node::slot;
use crate::dag::owners::OwnerBuilder;

/// No entry.
const NONE: u32 = u32::MAX;

/// Sub-DAG of a block.
pub(super) struct BuiltBlock {
    pub tables: DagTables,
    /// Offset of the block's node in the top table.
    pub root: u32,
    pub owners: OwnerBuilder,
}

/// What one drawable occupies of one brick; a list for each brick, the latest drawable first.
struct BrickPart {
    drawable: u32,
    next: u32,
    mask: u64,
}

/// Working memory of a thread.
#[derive(Default)]
pub(super) struct Scratch {
    mesh: SnappedMesh,
    /// Voxels a side of the grid: nothing is made beyond, even where the tree reaches farther.
    side: i32,
    /// First part of each brick of the block, by depth-first index; reset after each block through `touched`.
    first_part: Vec<u32>,
    parts: Vec<BrickPart>,
    /// Depth-first indices of occupied bricks.
    touched: Vec<u32>,
}

impl Scratch {
    /// Voxelizes a block. `None` when no triangle touches it after all.
    pub fn build(
        &mut self,
        block: &Block,
        bins: &Bins,
        drawables: &dyn Drawables,
        block_height: u32,
        side: i32,
    ) -> Result<Option<BuiltBlock>, DagError> {
        self.side = side;
        self.first_part.resize(1 << (6 * block_height), NONE);
        for entry in bins.entries(block) {
            match entry.source {
                Source::Whole => {
                    let mut mesh = std::mem::take(&mut self.mesh);
                    drawables.load(entry.drawable, &mut mesh);
                    mesh.iter().for_each(|t| self.add(entry.drawable, t, block.corner, block_height));
                    self.mesh = mesh;
                }
                Source::Binned { batch, start, count } => {
                    let triangles = bins.triangles(batch, start, count);
                    triangles.iter().for_each(|&t| self.add(entry.drawable, t, block.corner, block_height));
                }
            }
            let triangles = match entry.source {
                Source::Whole => self.mesh.triangles.len() as u64,
                Source::Binned { count, .. } => count as u64,
            };
            if drawables.advance(triangles) {
                return Err(DagError::Cancelled);
            }
        }
        self.touched.sort_unstable();
        let built = self.sub_dag(block_height);
        for &brick in &self.touched {
            self.first_part[brick as usize] = NONE;
        }
        self.touched.clear();
        self.parts.clear();
        built
    }

    /// Adds the bricks of the block that a triangle touches.
    fn add(&mut self, drawable: u32, triangle: SnappedTriangle, corner: [i32; 3], block_height: u32) {
        let side = self.side;
        TriangleOverlap::new(triangle).for_each_brick(
            corner,
            2 * block_height + 2,
            side,
            &mut |brick, mask| {
                self.add_mask(drawable, [0, 1, 2].map(|k| brick[k] - corner[k]), mask);
            },
        );
    }

    fn add_mask(&mut self, drawable: u32, brick_in_block: [i32; 3], mask: u64) {
        let index = (1..4).rev().fold(0, |index, h| index << 6 | slot(brick_in_block, 2 * h));
        let first = self.first_part[index as usize];
        // Drawables come in rising order, so that a brick's latest part is this drawable's or an earlier one's.
        match self.parts.get_mut(first as usize) {
            Some(part) if part.drawable == drawable => part.mask |= mask,
            _ => {
                if first == NONE {
                    self.touched.push(index);
                }
                self.first_part[index as usize] = self.parts.len() as u32;
                self.parts.push(BrickPart { drawable, next: first, mask });
            }
        }
    }

    /// Turns the touched bricks, sorted, into nodes bottom up.
    fn sub_dag(&self, block_height: u32) -> Result<Option<BuiltBlock>, DagError> {
        let mut tables = DagTables::new(block_height);
        let mut owners = OwnerBuilder::default();
        let mut of_brick: Vec<(u32, u64)> = Vec::new();
        // (depth-first index, node or leaf, bricks) of the height just finished.
        let mut children: Vec<(u32, u32, u32)> = Vec::with_capacity(self.touched.len());
        for &brick in &self.touched {
            of_brick.clear();
            let mut at = self.first_part[brick as usize];
            while let Some(part) = self.parts.get(at as usize) {
                of_brick.push((part.drawable, part.mask));
                at = part.next;
            }
            of_brick.reverse();
            let mask = of_brick.iter().fold(0, |mask, (_, m)| mask | m);
            children.push((brick, tables.intern_leaf(mask)?, 1));
            owners.push(&of_brick)?;
        }
        let mut draft = NodeDraft::default();
        for height in 0..block_height as usize {
            let mut parents = Vec::new();
            for of_parent in children.chunk_by(|a, b| a.0 >> 6 == b.0 >> 6) {
                draft.clear();
                of_parent.iter().for_each(|&(key, child, bricks)| draft.push(key & 63, child, bricks));
                let (node, bricks) = tables.heights[height].intern(&draft)?;
                parents.push((of_parent[0].0 >> 6, node, bricks));
            }
            children = parents;
        }
        Ok(children.first().map(|&(_, root, _)| BuiltBlock { tables, root, owners }))
    }
}
