//! Ray casting through the DAG: the voxels that a ray crosses, front to back.
//!
//! Promise: a ray passes no occupied voxel that it crosses by more than 2^-10 voxel, and never loops. The position is
//! kept as integer voxel coordinates; each step goes to the neighbouring cell across the nearest plane, whose distance
//! is computed anew from the plane's position, so that no error accumulates and each step strictly advances along one
//! axis. The ray is re-based in f64 at its entry into the grid.
//!
//! This is the scalar reference: every faster path is tested against it.

mod ray;

pub use ray::GridRay;

use crate::dag::DagRef;
use crate::dag::node::{child_word, mask_at, slot};

/// Height of the root over the largest grid, and a slot for the leaf.
const MAX_STACK: usize = 9;

/// Where a walk goes on after an occupied voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// To the next voxel.
    Voxel,
    /// Past the rest of this voxel's brick.
    Brick,
    /// Nowhere: the caller has what it wants.
    End,
}

/// An occupied voxel that a ray crosses.
pub struct VoxelHit<'t> {
    /// Voxel coordinates.
    pub voxel: [i32; 3],
    /// Where the ray enters it, in the ray's own parameter; not below the ray's start.
    pub t: f64,
    /// Bit of the voxel in its brick.
    pub bit: u32,
    dag: &'t DagRef<'t>,
    /// Node of each height on the way down, index 0 unused.
    path: &'t [u32; MAX_STACK],
}

impl VoxelHit<'_> {
    /// Ordinal of its brick in depth-first order, for [`crate::dag::OwnersRef::of_brick`].
    pub fn brick_ordinal(&self) -> u64 {
        (1..=self.dag.height)
            .map(|height| {
                self.dag.bricks_before(height, self.path[height as usize], slot(self.voxel, 2 * height))
            })
            .sum()
    }

    /// Mask of the occupied voxels of its brick, for [`crate::dag::OwnersRef::of_brick`].
    pub fn brick_mask(&self) -> u64 {
        let node = self.path[1];
        let word = child_word(mask_at(self.dag.words, node), node, slot(self.voxel, 2));
        self.dag.leaves[self.dag.words[word] as usize]
    }
}

impl DagRef<'_> {
    /// Calls `visit` for the occupied voxels that the ray crosses, nearest first, until it says
    /// [`Next::End`] or the ray ends.
    pub fn cast(&self, ray: &GridRay, mut visit: impl FnMut(&VoxelHit) -> Next) {
        let Some(root) = self.root else { return };
        let side = 1 << self.log2;
        let Some(walk) = ray.enter(f64::from(side)) else { return };
        let last = side - 1;
        let top = self.height;

        let mut voxel = walk.start.map(|c| c.clamp(0, last));
        let mut t = walk.t_start;
        let mut path = [0u32; MAX_STACK];
        path[top as usize] = root;
        // Height of the node that `voxel` is looked up in; 0: `leaf` is the mask of its brick.
        let mut height = top;
        let mut leaf = 0u64;
        loop {
            // Down to the smallest cell that holds the voxel and is empty or a voxel.
            let occupied = loop {
                let bit = slot(voxel, 2 * height);
                if height == 0 {
                    break leaf >> bit & 1 == 1;
                }
                let node = path[height as usize];
                let mask = mask_at(self.words, node);
                if mask >> bit & 1 == 0 {
                    break false;
                }
                let child = self.words[child_word(mask, node, bit)];
                height -= 1;
                if height == 0 {
                    leaf = self.leaves[child as usize];
                } else {
                    path[height as usize] = child;
                }
            };
            if occupied {
                let hit = VoxelHit { voxel, t: walk.ray_t(t), bit: slot(voxel, 0), dag: self, path: &path };
                match visit(&hit) {
                    Next::Voxel => {}
                    // As if the brick were an empty cell of the node above.
                    Next::Brick => height = 1,
                    Next::End => return,
                }
            }

            // Across the nearest plane of the cell.
            let size = 1 << (2 * height);
            let low = voxel.map(|c| c & !(size - 1));
            let (axis, t_exit) = walk.exit(low, size);
            if t_exit > walk.t_end {
                return;
            }
            t = t.max(t_exit);
            let before = voxel;
            voxel = walk.voxel_after(t, axis, before, low, size);
            if voxel[axis] < 0 || voxel[axis] > last {
                return;
            }
            // Up to the node that holds both.
            let differ = (0..3).fold(0, |bits, k| bits | (before[k] ^ voxel[k]));
            height = height.max((31 - (differ as u32).leading_zeros()) / 2);
        }
    }

    /// The first occupied voxel that the ray crosses, and where it enters it.
    pub fn first_hit(&self, ray: &GridRay) -> Option<([i32; 3], f64)> {
        let mut first = None;
        self.cast(ray, |hit| {
            first = Some((hit.voxel, hit.t));
            Next::End
        });
        first
    }

    /// Does the ray cross an occupied voxel?
    pub fn any_hit(&self, ray: &GridRay) -> bool {
        self.first_hit(ray).is_some()
    }
}
