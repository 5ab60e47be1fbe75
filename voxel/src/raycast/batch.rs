//! Unrelated rays, several at a time: their steps are interleaved, so that the processor works on one while it waits
//! for another.

use fearless_simd::Simd;

use super::ray::{Walk, WalkRef};
use super::single::{child_corner, child_size, true_corner};
use super::slabs::{Columns, RaySlabs};
use super::{Footprint, GridRay, MAX_STACK, Next, VoxelHit};
use crate::bits::{mirror_slot, mirror_without_branches};
use crate::dag::DagRef;
use crate::dag::node::{child_word, mask_at};

/// Rays in flight. Measured: 2, 4, 6 and 8 give 1.5, 1.8, 1.8 and 1.7 times the rate of one.
const IN_FLIGHT: usize = 4;

/// One ray on its way.
struct Traveller {
    ray: usize,
    walk: Walk,
    slabs: RaySlabs,
    flip: u32,
    slot_flip: u32,
    /// Heights with something left to visit; none: the ray is done.
    pending: u32,
    nodes: [u32; MAX_STACK],
    corners: [[f32; 3]; MAX_STACK],
    /// Children (height 0: voxels) to visit, mirrored.
    left: [u64; MAX_STACK],
}

/// See [`super::RayCaster::cast_batch`].
#[inline(always)]
pub(super) fn cast<S: Simd>(
    simd: S,
    dag: &DagRef,
    rays: &[GridRay],
    footprint: Footprint,
    visit: &mut impl FnMut(usize, &VoxelHit) -> Next,
) {
    let Some(root) = dag.root else { return };
    let columns = Columns::new(simd);
    let nothing = Walk::new(&GridRay::new(glam::DVec3::ZERO, glam::DVec3::ZERO), 1.0);
    let mut travellers: [Traveller; IN_FLIGHT] = std::array::from_fn(|_| Traveller {
        ray: 0,
        walk: nothing,
        slabs: RaySlabs::default(),
        flip: 0,
        slot_flip: 0,
        pending: 0,
        nodes: [root; MAX_STACK],
        corners: [[0.0; 3]; MAX_STACK],
        left: [0; MAX_STACK],
    });
    let mut next_ray = 0;
    loop {
        let mut any = false;
        for traveller in &mut travellers {
            if traveller.pending == 0 {
                while next_ray < rays.len() && !traveller.start(columns, dag, next_ray, &rays[next_ray]) {
                    next_ray += 1;
                }
                if traveller.pending == 0 {
                    continue;
                }
                next_ray += 1;
            }
            any = true;
            traveller.step(columns, dag, footprint, visit);
        }
        if !any {
            return;
        }
    }
}

impl Traveller {
    /// Takes a new ray. False when there is nothing on its way.
    #[inline(always)]
    fn start<S: Simd>(&mut self, columns: Columns<S>, dag: &DagRef, number: usize, ray: &GridRay) -> bool {
        let walk = Walk::new(ray, f64::from(1 << dag.log2));
        if !walk.is_inside() {
            return false;
        }
        let top = dag.height as usize;
        self.ray = number;
        self.slabs = RaySlabs::new(&walk, f64::from(dag.tree_side()));
        self.flip = walk.flip();
        self.slot_flip = mirror_slot(self.flip);
        self.walk = walk;
        let occupied = mirror_without_branches(mask_at(dag.words, self.nodes[top]), self.flip);
        self.left[top] = occupied & self.slabs.children(columns, self.corners[top], child_size(top));
        self.pending = u32::from(self.left[top] != 0) << top;
        self.pending != 0
    }

    /// Opens the next child, or visits the next voxel. No branch depends on the ray but at voxels.
    #[inline(always)]
    fn step<S: Simd>(
        &mut self,
        columns: Columns<S>,
        dag: &DagRef,
        footprint: Footprint,
        visit: &mut impl FnMut(usize, &VoxelHit) -> Next,
    ) {
        // Below MAX_STACK: only bits of heights are ever set, and one is.
        let height = self.pending.trailing_zeros() as usize % MAX_STACK;
        let bit = self.left[height].trailing_zeros();
        self.left[height] &= self.left[height].wrapping_sub(1);
        self.pending &= !(u32::from(self.left[height] == 0) << height);
        let corner = child_corner(self.corners[height], bit, child_size(height));
        if height == 0 {
            self.visit_voxel(dag, corner, visit);
            return;
        }
        let node = self.nodes[height];
        let child = dag.words[child_word(mask_at(dag.words, node), node, bit ^ self.slot_flip)];
        let below = height - 1;
        let is_leaf = below == 0;
        if is_leaf && !footprint.is_zero() && self.visit_brick(dag, corner, footprint, visit) {
            return;
        }
        // Both are read, one of them in vain, so that there is no branch. A root has a leaf below it.
        let leaf = dag.leaves[if is_leaf { child as usize } else { 0 }];
        let mask = mask_at(dag.words, if is_leaf { node } else { child });
        let mask = if is_leaf { leaf } else { mask };
        self.nodes[below] = child;
        self.corners[below] = corner;
        let occupied = mirror_without_branches(mask, self.flip);
        self.left[below] = occupied & self.slabs.children(columns, corner, child_size(below));
        self.pending |= u32::from(self.left[below] != 0) << below;
    }

    #[inline(always)]
    fn visit_voxel(
        &mut self,
        dag: &DagRef,
        corner: [f32; 3],
        visit: &mut impl FnMut(usize, &VoxelHit) -> Next,
    ) {
        let voxel = true_corner(dag, corner, 1, self.flip);
        if self.walk.crosses(voxel, 1).is_none() {
            return;
        }
        let (walk, nodes) = (WalkRef::One(&self.walk), &self.nodes);
        match visit(self.ray, &VoxelHit { voxel, whole_brick: false, walk, dag, nodes }) {
            Next::Voxel => {}
            Next::Brick => self.pending &= !1,
            Next::End => self.pending = 0,
        }
    }

    /// Visits a brick as a whole if it is below the footprint. True when there is nothing to open.
    #[inline(always)]
    fn visit_brick(
        &mut self,
        dag: &DagRef,
        corner: [f32; 3],
        footprint: Footprint,
        visit: &mut impl FnMut(usize, &VoxelHit) -> Next,
    ) -> bool {
        let voxel = true_corner(dag, corner, 4, self.flip);
        let Some(t) = self.walk.crosses(voxel, 4) else { return true };
        if !footprint.covers_brick(self.walk.ray_t(t)) {
            return false;
        }
        let (walk, nodes) = (WalkRef::One(&self.walk), &self.nodes);
        if visit(self.ray, &VoxelHit { voxel, whole_brick: true, walk, dag, nodes }) == Next::End {
            self.pending = 0;
        }
        true
    }
}
