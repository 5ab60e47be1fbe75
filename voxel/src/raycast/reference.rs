//! The scalar reference: from cell to cell, one ray at a time, all in integers and f64.

use super::ray::{Walk, WalkRef};
use super::{Footprint, MAX_STACK, Next, VoxelHit};
use crate::dag::DagRef;
use crate::dag::node::{child_word, mask_at, slot};

/// Visits the occupied voxels that the ray crosses, nearest first.
#[inline(always)]
pub(super) fn cast(
    dag: &DagRef,
    walk: &Walk,
    footprint: Footprint,
    visit: &mut impl FnMut(&VoxelHit) -> Next,
) {
    let Some(root) = dag.root else { return };
    let last = (1u32 << dag.log2) - 1;
    // A negative coordinate has high bits too.
    let outside = |v: [i32; 3]| ((v[0] | v[1] | v[2]) as u32) > last;
    let top = dag.height;

    let mut voxel = walk.start();
    // The second: a start so near the grid's low border, and going out, that t = 0 there by underflow.
    if outside(voxel) || walk.crosses(voxel, 1).is_none() {
        return;
    }
    let mut t = 0.0;
    let mut nodes = [0u32; MAX_STACK];
    nodes[top as usize] = root;
    // Height of the node that `voxel` is looked up in; 0: `leaf` is the mask of its brick.
    let mut height = top;
    let mut leaf = 0u64;
    loop {
        // Down to the smallest cell that holds the voxel and is empty or a voxel.
        let mut accepted = false;
        let occupied = loop {
            let bit = slot(voxel, 2 * height);
            if height == 0 {
                break leaf >> bit & 1 == 1;
            }
            let node = nodes[height as usize];
            let mask = mask_at(dag.words, node);
            if mask >> bit & 1 == 0 {
                break false;
            }
            let child = dag.words[child_word(mask, node, bit)];
            height -= 1;
            if height > 0 {
                nodes[height as usize] = child;
                continue;
            }
            if footprint.covers_brick(walk.ray_t(t)) {
                accepted = true;
                break true;
            }
            leaf = dag.leaves[child as usize];
        };
        if occupied {
            let voxel = if accepted { voxel.map(|c| c & !3) } else { voxel };
            let hit = VoxelHit { voxel, whole_brick: accepted, walk: WalkRef::One(walk), dag, nodes: &nodes };
            match visit(&hit) {
                Next::Voxel if !accepted => {}
                // As if the brick were an empty cell of the node above.
                Next::Voxel | Next::Brick => height = 1,
                Next::End => return,
            }
        }

        // Across the nearest plane of the cell, and every other that the ray meets at the same t.
        let size = 1 << (2 * height);
        let low = [voxel[0] & -size, voxel[1] & -size, voxel[2] & -size];
        let mut exits = [0.0; 3];
        for k in 0..3 {
            exits[k] = walk.at(k, if walk.rises(k) { low[k] + size } else { low[k] });
        }
        t = if exits[0] < exits[1] { exits[0] } else { exits[1] };
        t = if exits[2] < t { exits[2] } else { t };
        if t > walk.t_end {
            return;
        }
        let before = voxel;
        for k in 0..3 {
            voxel[k] = if exits[k] <= t {
                if walk.rises(k) { low[k] + size } else { low[k] - 1 }
            } else if size == 1 {
                before[k]
            } else {
                walk.coordinate_after(k, t, before[k], low[k], size)
            };
        }
        if outside(voxel) {
            return;
        }
        // Up to the node that holds both.
        let differ = (before[0] ^ voxel[0]) | (before[1] ^ voxel[1]) | (before[2] ^ voxel[2]);
        height = height.max((31 - (differ as u32).leading_zeros()) / 2);
    }
}
