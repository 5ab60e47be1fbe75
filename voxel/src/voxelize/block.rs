//! One block: triangles to bricks, bricks to nodes with owners.

use super::cell::Cell;
use super::overlap::TriangleOverlap;
use super::{SnappedTriangle, task::SubDag};
use crate::dag::DagError;
use crate::dag::build::NodeDraft;
use crate::dag::node::slot;

/// Largest height of a block: 256 voxels a side.
pub(super) const MAX_BLOCK_HEIGHT: u32 = 3;
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
    /// Reused, one for each height.
    drafts: [NodeDraft; MAX_BLOCK_HEIGHT as usize],
    of_brick: Vec<(u32, u64)>,
}

impl BlockBuilder {
    /// For blocks of up to this height, at most [`MAX_BLOCK_HEIGHT`], in a grid of `side` voxels.
    pub fn new(height: u32, side: i32) -> Self {
        let nodes = |below_top: u32| vec![0; 1 << (6 * below_top)];
        let masks = [1, 2, 3].map(|h| if h <= height { nodes(height - h) } else { Vec::new() });
        BlockBuilder {
            height,
            side,
            corner: [0; 3],
            masks,
            first_part: vec![NONE; 1 << (6 * height)],
            parts: Vec::new(),
            drafts: Default::default(),
            of_brick: Vec::new(),
        }
    }

    /// The block that the next triangles are for.
    pub fn begin(&mut self, block: Cell) {
        self.height = block.height;
        self.corner = block.corner;
    }

    /// Adds the bricks of the block that a triangle touches. Drawables must come in rising order.
    #[inline]
    pub fn add(&mut self, drawable: u32, triangle: &SnappedTriangle) {
        let (corner, shift, side) = (self.corner, 2 * self.height + 2, self.side);
        TriangleOverlap::new(*triangle).for_each_brick(corner, shift, side, &mut |brick, mask| {
            self.add_mask(drawable, [0, 1, 2].map(|k| brick[k] - corner[k]), mask);
        });
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
        let mut left = mask;
        while left != 0 {
            let child = index << 6 | left.trailing_zeros();
            left &= left - 1;
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
