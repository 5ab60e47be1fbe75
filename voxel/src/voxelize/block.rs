//! One block: triangles to bricks, bricks to nodes with owners.

use super::cell::Cell;
use super::overlap::TriangleOverlap;
use super::{SnappedTriangle, VoxelizeError, task::SubDag};
use crate::bits::SetBits;
use crate::dag::DagError;
use crate::dag::build::NodeDraft;
use crate::dag::node::slot;

/// Largest height of a block: 256 voxels a side.
pub(super) const MAX_BLOCK_HEIGHT: u32 = 3;
/// Parts of a block after which no more triangles go in: so many fewer than [`NONE`] that one more triangle, which touches
/// each brick once, finds room.
pub(super) const MOST_PARTS: usize = NONE as usize - (1 << (6 * MAX_BLOCK_HEIGHT));
/// No part.
const NONE: u32 = u32::MAX;

/// What one drawable occupies of one brick; a list for each brick, the latest drawable first.
struct BrickPart {
    mask: u64,
    drawable: u32,
    next: u32,
}

/// The bricks of one block at a time. Between blocks it is empty.
pub(super) struct BlockBuilder {
    /// Of the block at hand.
    height: u32,
    /// Voxels a side of the grid: nothing is made beyond, even where the tree reaches farther.
    side: i32,
    corner: [i32; 3],
    /// For each height from 1 up to the largest block's, the masks of all nodes that a block may have, by depth-first index.
    masks: [Vec<u64>; MAX_BLOCK_HEIGHT as usize],
    /// First part of each brick, by depth-first index; means something where the brick's bit in `masks[0]` is set.
    first_part: Vec<u32>,
    parts: Vec<BrickPart>,
    most_parts: usize,
    /// Parts that the block at hand may have, and why.
    allowed_parts: usize,
    memory: Option<u64>,
    /// Reused, one for each height.
    drafts: [NodeDraft; MAX_BLOCK_HEIGHT as usize],
    of_brick: Vec<(u32, u64)>,
}

impl BlockBuilder {
    /// For blocks of up to this height, at most [`MAX_BLOCK_HEIGHT`], in a grid of `side` voxels. With `memory` bytes for
    /// a task and its block, and at most `most_parts` (at most [`MOST_PARTS`]) in a block.
    pub fn new(height: u32, side: i32, memory: Option<u64>, most_parts: usize) -> Self {
        let nodes = |below_top: u32| vec![0; 1 << (6 * below_top)];
        let masks = [1, 2, 3].map(|h| if h <= height { nodes(height - h) } else { Vec::new() });
        BlockBuilder {
            height,
            side,
            corner: [0; 3],
            masks,
            first_part: vec![NONE; 1 << (6 * height)],
            parts: Vec::new(),
            most_parts,
            allowed_parts: most_parts,
            memory,
            drafts: Default::default(),
            of_brick: Vec::new(),
        }
    }

    /// The block that the next triangles are for; its task holds `held` bytes so far.
    ///
    /// # Errors
    ///
    /// The task alone holds more than the memory allowed.
    pub fn begin(&mut self, block: Cell, held: u64) -> Result<(), VoxelizeError> {
        self.height = block.height;
        self.corner = block.corner;
        self.allowed_parts = match self.memory {
            Some(limit) if held > limit => return Err(VoxelizeError::Memory { limit, used: held }),
            Some(limit) => ((limit - held) as usize / size_of::<BrickPart>()).min(self.most_parts),
            None => self.most_parts,
        };
        Ok(())
    }

    /// Adds the bricks of the block that a triangle touches. Drawables must come in rising order.
    ///
    /// # Errors
    ///
    /// The triangles before it touched more than there is memory for, or more than indices can tell.
    #[inline]
    pub fn add(&mut self, drawable: u32, triangle: &SnappedTriangle) -> Result<(), VoxelizeError> {
        if self.parts.len() > self.allowed_parts {
            return Err(self.outgrown());
        }
        let (corner, shift, side) = (self.corner, 2 * self.height + 2, self.side);
        TriangleOverlap::new(*triangle).for_each_brick(corner, shift, side, &mut |brick, mask| {
            self.add_mask(drawable, [0, 1, 2].map(|k| brick[k] - corner[k]), mask);
        });
        Ok(())
    }

    #[cold]
    fn outgrown(&self) -> VoxelizeError {
        match self.memory {
            Some(limit) if self.allowed_parts < self.most_parts => {
                let excess = (self.parts.len() - self.allowed_parts) * size_of::<BrickPart>();
                VoxelizeError::Memory { limit, used: limit + excess as u64 }
            }
            _ => VoxelizeError::Crowded {
                side: 4 << (2 * self.height),
                most: self.most_parts as u64,
                what: "pairs of a brick and a drawable",
            },
        }
    }

    #[inline]
    fn add_mask(&mut self, drawable: u32, brick_in_block: [i32; 3], mask: u64) {
        let index = (1..=MAX_BLOCK_HEIGHT).rev().fold(0, |index, h| index << 6 | slot(brick_in_block, 2 * h));
        let (node, bit) = (index as usize >> 6, 1 << (index & 63));
        let first = &mut self.first_part[index as usize];
        if self.masks[0][node] & bit == 0 {
            // New, and so may be its node and the node above.
            self.masks[0][node] |= bit;
            let mut above = index >> 6;
            for masks in self.masks.iter_mut().take(self.height as usize).skip(1) {
                masks[above as usize >> 6] |= 1 << (above & 63);
                above >>= 6;
            }
            *first = self.parts.len() as u32;
            self.parts.push(BrickPart { drawable, next: NONE, mask });
            return;
        }
        // The brick's latest part is this drawable's or an earlier one's.
        match self.parts.get_mut(*first as usize) {
            Some(part) if part.drawable == drawable => part.mask |= mask,
            _ => {
                let next = std::mem::replace(first, self.parts.len() as u32);
                self.parts.push(BrickPart { drawable, next, mask });
            }
        }
    }

    /// Turns the bricks into nodes and owners, depth first. `None` when there are none.
    pub fn finish(&mut self, out: &mut SubDag) -> Result<Option<u32>, DagError> {
        let root = self.node(self.height, 0, out);
        self.parts.clear();
        root
    }

    fn node(&mut self, height: u32, index: u32, out: &mut SubDag) -> Result<Option<u32>, DagError> {
        let level = height as usize - 1;
        let mask = std::mem::take(&mut self.masks[level][index as usize]);
        if mask == 0 {
            return Ok(None);
        }
        let mut draft = std::mem::take(&mut self.drafts[level]);
        draft.begin(mask);
        for slot in SetBits(mask) {
            let child = index << 6 | slot;
            if height == 1 {
                draft.push(self.brick(child, out)?);
            } else if let Some(node) = self.node(height - 1, child, out)? {
                draft.push(node);
            }
        }
        let node = out.tables.heights[level].intern(&draft)?;
        self.drafts[level] = draft;
        Ok(Some(node))
    }

    /// Its leaf; its owners go to `out`.
    fn brick(&mut self, index: u32, out: &mut SubDag) -> Result<u32, DagError> {
        let part = &self.parts[self.first_part[index as usize] as usize];
        if part.next == NONE {
            out.owners.push_one(part.drawable);
            return out.tables.intern_leaf(part.mask);
        }
        self.of_brick.clear();
        let mut part = Some(part);
        while let Some(&BrickPart { mask, drawable, next }) = part {
            self.of_brick.push((drawable, mask));
            part = self.parts.get(next as usize);
        }
        self.of_brick.reverse();
        out.owners.push(&self.of_brick);
        out.tables.intern_leaf(self.of_brick.iter().fold(0, |mask, (_, m)| mask | m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Adds one small triangle of many drawables to one brick; the error, and how many went in before.
    fn fill(memory: Option<u64>, most_parts: usize) -> (VoxelizeError, u32) {
        let mut block = BlockBuilder::new(1, 64, memory, most_parts);
        block.begin(Cell { corner: [16; 3], height: 1 }, 0).unwrap();
        let triangle = [[17 << 8; 3], [17 << 8, 17 << 8, 18 << 8], [17 << 8, 18 << 8, 18 << 8]];
        let mut added = (0..1000).map(|drawable| (block.add(drawable, &triangle), drawable));
        added.find_map(|(added, drawable)| Some((added.err()?, drawable))).unwrap()
    }

    #[test]
    fn parts_that_outgrow_their_indices_or_the_memory_are_an_error() {
        let (error, before) = fill(None, 100);
        assert!(matches!(error, VoxelizeError::Crowded { side: 16, most: 100, .. }), "{error}");
        assert_eq!(before, 101);
        let (error, before) = fill(Some(1600), 200);
        assert!(matches!(error, VoxelizeError::Memory { limit: 1600, used: 1616 }), "{error}");
        assert_eq!(before, 101);
    }
}
