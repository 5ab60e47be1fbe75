//! One ray at a time, tested against all 64 children of a node at once.

use fearless_simd::Simd;

use super::ray::{Walk, WalkRef};
use super::slabs::{Columns, RaySlabs};
use super::{Footprint, GridRay, MAX_STACK, Next, VoxelHit};
use crate::bits::{mirror, mirror_slot};
use crate::dag::DagRef;
use crate::dag::node::{child_word, mask_at};

/// See [`super::RayCaster::cast`].
#[inline(always)]
pub(super) fn cast<S: Simd>(
    simd: S,
    dag: &DagRef,
    ray: &GridRay,
    footprint: Footprint,
    visit: &mut impl FnMut(&VoxelHit) -> Next,
) {
    let Some(root) = dag.root else { return };
    let Some(walk) = ray.enter(f64::from(1 << dag.log2)) else { return };
    let mut nodes = [0; MAX_STACK];
    nodes[dag.height as usize] = root;
    cast_alone(Columns::new(simd), dag, &walk, &mut nodes, footprint, visit);
}

/// From the root, which is in `nodes` already.
#[inline(always)]
pub(super) fn cast_alone<S: Simd>(
    columns: Columns<S>,
    dag: &DagRef,
    walk: &Walk,
    nodes: &mut [u32; MAX_STACK],
    footprint: Footprint,
    visit: &mut impl FnMut(&VoxelHit) -> Next,
) {
    let slabs = RaySlabs::new(walk, f64::from(dag.tree_side()));
    let subtree = Subtree { height: dag.height as usize, corner: [0.0; 3], candidates: u64::MAX };
    cast_subtree(columns, dag, walk, &slabs, nodes, subtree, footprint, visit);
}

/// A node and where it lies: low corner in mirrored coordinates.
#[derive(Clone, Copy)]
pub(super) struct Subtree {
    pub height: usize,
    pub corner: [f32; 3],
    /// The children to look at, mirrored.
    pub candidates: u64,
}

/// Position of each child in its node.
const DIGITS: [[f32; 4]; 64] = {
    let mut digits = [[0.0; 4]; 64];
    let mut bit = 0;
    while bit < 64 {
        digits[bit] = [(bit & 3) as f32, (bit >> 2 & 3) as f32, (bit >> 4) as f32, 0.0];
        bit += 1;
    }
    digits
};

/// Side of the children of a node, voxels.
#[inline(always)]
pub(super) fn child_size(height: usize) -> f32 {
    (1i32 << (2 * height)) as f32
}

/// Low corner of child `bit` (mirrored) of `size` voxels.
#[inline(always)]
pub(super) fn child_corner(corner: [f32; 3], bit: u32, size: f32) -> [f32; 3] {
    // Not `map`, here and elsewhere: what is not inlined for certain is compiled without the instructions asked for.
    let digits = &DIGITS[bit as usize & 63];
    [digits[0] * size + corner[0], digits[1] * size + corner[1], digits[2] * size + corner[2]]
}

/// Low corner in voxels of a cell of `size` voxels at a mirrored corner.
#[inline(always)]
pub(super) fn true_corner(dag: &DagRef, corner: [f32; 3], size: i32, flip: u32) -> [i32; 3] {
    let mut low = [0; 3];
    for k in 0..3 {
        // In range, so that the plain conversion is exact.
        let c = corner[k] as i32;
        low[k] = if flip >> k & 1 != 0 { dag.tree_side() - size - c } else { c };
    }
    low
}

#[allow(clippy::too_many_arguments, reason = "the state of one traversal, all of it")]
/// Visits what the ray crosses below `nodes[subtree.height]`. Returns whether the ray goes on.
#[inline(always)]
pub(super) fn cast_subtree<S: Simd>(
    columns: Columns<S>,
    dag: &DagRef,
    walk: &Walk,
    slabs: &RaySlabs,
    nodes: &mut [u32; MAX_STACK],
    subtree: Subtree,
    footprint: Footprint,
    visit: &mut impl FnMut(&VoxelHit) -> Next,
) -> bool {
    let flip = walk.flip();
    let slot_flip = mirror_slot(flip);
    let mut corners = [[0.0f32; 3]; MAX_STACK];
    let mut left = [0u64; MAX_STACK];
    let mut height = subtree.height;
    corners[height] = subtree.corner;
    let occupied = mirror(mask_at(dag.words, nodes[height]), flip);
    left[height] =
        subtree.candidates & occupied & slabs.children(columns, subtree.corner, child_size(height));
    loop {
        while left[height] == 0 {
            if height == subtree.height {
                return true;
            }
            height += 1;
        }
        let bit = left[height].trailing_zeros();
        left[height] &= left[height] - 1;
        let node = nodes[height];
        let mask = mask_at(dag.words, node);
        let child = dag.words[child_word(mask, node, bit ^ slot_flip)];
        let corner = child_corner(corners[height], bit, child_size(height));
        if height > 1 {
            height -= 1;
            nodes[height] = child;
            corners[height] = corner;
            let occupied = mirror(mask_at(dag.words, child), flip);
            left[height] = occupied & slabs.children(columns, corner, child_size(height));
        } else {
            let leaf = mirror(dag.leaves[child as usize], flip);
            if !cast_brick(columns, dag, walk, slabs, nodes, corner, leaf, footprint, visit) {
                return false;
            }
        }
    }
}

#[allow(clippy::too_many_arguments, reason = "the state of one traversal, all of it")]
/// Visits the voxels of a brick, given its mask in mirrored order. Returns whether the ray goes on.
#[inline(always)]
pub(super) fn cast_brick<S: Simd>(
    columns: Columns<S>,
    dag: &DagRef,
    walk: &Walk,
    slabs: &RaySlabs,
    nodes: &[u32; MAX_STACK],
    corner: [f32; 3],
    leaf: u64,
    footprint: Footprint,
    visit: &mut impl FnMut(&VoxelHit) -> Next,
) -> bool {
    let flip = walk.flip();
    if !footprint.is_zero() {
        let voxel = true_corner(dag, corner, 4, flip);
        let Some(t) = walk.crosses(voxel, 4) else { return true };
        if footprint.covers_brick(walk.ray_t(t)) {
            return visit(&VoxelHit { voxel, whole_brick: true, walk: WalkRef::One(walk), dag, nodes })
                != Next::End;
        }
    }
    let mut left = leaf & slabs.children(columns, corner, 1.0);
    while left != 0 {
        let bit = left.trailing_zeros();
        left &= left - 1;
        let voxel = true_corner(dag, child_corner(corner, bit, 1.0), 1, flip);
        if walk.crosses(voxel, 1).is_some() {
            let hit = VoxelHit { voxel, whole_brick: false, walk: WalkRef::One(walk), dag, nodes };
            match visit(&hit) {
                Next::Voxel => {}
                Next::Brick => return true,
                Next::End => return false,
            }
        }
    }
    true
}
