//! From a triangle to its bricks: the smallest window of 4x4x4 cells that holds it, and down from there, 64 cells at a
//! time.

use fearless_simd::Simd;

use super::TriangleOverlap;
use super::axes::{Axes, Planar, Solid};
use super::bits::{box_mask, per_axis, range_bits, split_window};
use super::projection::{SMALL, fits_32_bits};
use crate::bits::SetBits;
use crate::grid::SUBVOXELS;
use crate::voxelize::for_each_cell;

/// Up to this many bricks in a triangle's box, each is tested without looking for touched ones first.
const FEW_BRICKS: i32 = 4;

/// Voxels from `first` to `last`, both included.
#[derive(Clone, Copy)]
pub(super) struct Region {
    pub first: [i32; 3],
    pub last: [i32; 3],
}

impl Region {
    /// A cell of `2^shift` voxels within a grid of `side` voxels, in whole bricks.
    #[inline(always)]
    pub fn cell(cell: [i32; 3], shift: u32, side: i32) -> Self {
        Region { first: cell, last: per_axis(|k| ((cell[k] + (1 << shift)).min(side) - 1) | 3) }
    }

    #[inline(always)]
    fn intersect(self, other: Region) -> Option<Region> {
        let first = per_axis(|k| self.first[k].max(other.first[k]));
        let last = per_axis(|k| self.last[k].min(other.last[k]));
        let is_empty = first[0] > last[0] || first[1] > last[1] || first[2] > last[2];
        if is_empty { None } else { Some(Region { first, last }) }
    }

    /// log2 of the side of the smallest cells, of 4^n voxels, of which at most four an axis hold the region.
    #[inline(always)]
    fn level(&self) -> u32 {
        let beyond = |k: usize, level: u32| (self.last[k] >> level) - (self.first[k] >> level) > 3;
        let mut level = 0;
        while beyond(0, level) || beyond(1, level) || beyond(2, level) {
            level += 2;
        }
        level
    }
}

/// Visits the bricks that the triangle touches within `clip`, whose borders are borders of bricks.
#[inline(always)]
pub(super) fn for_each_brick<S: Simd>(
    simd: S,
    triangle: &TriangleOverlap,
    clip: Region,
    visit: &mut impl FnMut([i32; 3], u64),
) {
    let (first, last) = triangle.cell_range(0);
    let touched = Region { first, last };
    let Some(region) = touched.intersect(clip) else { return };
    let level = region.level();
    let corner = per_axis(|k| region.first[k] >> level << level);
    let window = Window { corner, level, region };
    // Up to level 2 it always does: windows of 16 voxels at most.
    if level > 2 && !fits_32_bits(triangle.extent(), 4 << level) {
        return wide(triangle, &window, visit);
    }

    // Where it is flat, or within one voxel, its box says all that there is to say about that axis.
    let extent = triangle.extent();
    let flat = per_axis(|k| extent[k] == 0 || touched.first[k] == touched.last[k]);
    let v = per_axis(|i| per_axis(|k| triangle.vertices[i][k] - corner[k] * SUBVOXELS));
    let near = |k: usize| {
        let corner = corner[k] * SUBVOXELS;
        triangle.min[k] - corner > -SMALL && triangle.max[k] - corner < SMALL
    };
    let small = near(0) && near(1) && near(2);
    let axis = match flat {
        [false, false, false] => return window.visit(simd, &Solid::new(simd, &v, small, 4 << level), visit),
        [true, false, false] => 0,
        [false, true, false] => 1,
        [false, false, true] => 2,
        _ => return every_brick(region, visit),
    };
    window.visit(simd, &Planar::new(simd, &v, axis, small, 4 << level), visit);
}

/// Visits all bricks of a region, with the voxels inside it.
#[inline(always)]
fn every_brick(region: Region, visit: &mut impl FnMut([i32; 3], u64)) {
    let brick = |c: [i32; 3]| per_axis(|k| c[k] >> 2);
    for_each_cell(brick(region.first), brick(region.last), |at| {
        let corner = per_axis(|k| at[k] << 2);
        let inside = |k: usize| range_bits(region.first[k] - corner[k], region.last[k] - corner[k], 4);
        visit(corner, box_mask(per_axis(inside)));
    });
}

/// Narrows a window down in which values of the triangle's edges need more than 32 bits.
#[inline(never)]
fn wide(triangle: &TriangleOverlap, window: &Window, visit: &mut impl FnMut([i32; 3], u64)) {
    let (level, region) = (window.level, window.region);
    for_each_cell(region.first.map(|c| c >> level), region.last.map(|c| c >> level), |at| {
        let first = at.map(|c| c << level);
        if triangle.touches_cell(first, level) {
            let last = first.map(|c| c + (1 << level) - 1);
            if let Some(cell) = region.intersect(Region { first, last }) {
                let clip = Region { first: cell.first.map(|c| c & !3), last: cell.last.map(|c| c | 3) };
                triangle.for_each_brick_in(clip, visit);
            }
        }
    });
}

/// 4x4x4 cells of `2^level` voxels at the voxel `corner`, and the voxels of them that the triangle's box touches.
struct Window {
    corner: [i32; 3],
    level: u32,
    region: Region,
}

/// 64 cells on the way down.
#[derive(Clone, Copy)]
struct Node<V: Copy> {
    /// Values of the first cell.
    values: V,
    /// The first cell, counted from the window's corner.
    first: [i32; 3],
    /// Cells to visit.
    left: u64,
    /// Cells of which every voxel passes all tests but the plane's.
    covered: u64,
}

impl Window {
    /// Visits the bricks that a triangle touches; `axes` were made for this window.
    #[inline(always)]
    fn visit<S: Simd, A: Axes<S>>(&self, simd: S, axes: &A, visit: &mut impl FnMut([i32; 3], u64)) {
        let voxels = axes.touching(simd, 0);
        let origin = A::origin(simd);
        if self.level == 0 {
            let last = per_axis(|k| self.region.last[k] - self.region.first[k]);
            let inside = box_mask(per_axis(|k| range_bits(0, last[k], 4)));
            let mask = inside & axes.touched(A::offset(origin, &voxels), &voxels);
            if mask != 0 {
                split_window(self.corner, last, mask, visit);
            }
        } else if self.level == 2 {
            let [x, y, z] = per_axis(|k| (self.region.last[k] >> 2) - (self.region.first[k] >> 2) + 1);
            let mut left = box_mask(self.touched_cells([0; 3], 2));
            if x * y * z > FEW_BRICKS {
                let bricks = axes.touching(simd, 2);
                left &= axes.touched(A::offset(origin, &bricks), &bricks);
            }
            // Too few bricks for it to pay to know which are covered.
            let root = Node { values: origin, first: [0; 3], left, covered: 0 };
            self.visit_bricks(axes, &root, &voxels, visit);
        } else {
            let touching = axes.touching(simd, self.level);
            let covering = axes.covering(simd, self.level);
            let root = self.node(axes, origin, [0; 3], self.level, &touching, &covering);
            self.visit_cells(simd, axes, self.level, root, &voxels, visit);
        }
    }

    /// Cells of `2^level` voxels that the triangle's box touches, of the 64 from cell `first` on: a set an axis.
    #[inline(always)]
    fn touched_cells(&self, first: [i32; 3], level: u32) -> [u32; 3] {
        per_axis(|k| {
            let from = (self.region.first[k] - self.corner[k]) >> level;
            let to = (self.region.last[k] - self.corner[k]) >> level;
            range_bits(from - first[k], to - first[k], 4)
        })
    }

    /// Cells of `2^level` voxels that lie within the triangle's box, of the 64 from cell `first` on: a set an axis.
    #[inline(always)]
    fn covered_cells(&self, first: [i32; 3], level: u32) -> [u32; 3] {
        per_axis(|k| {
            let from = (self.region.first[k] - self.corner[k] + (1 << level) - 1) >> level;
            let to = ((self.region.last[k] - self.corner[k] + 1) >> level) - 1;
            range_bits(from - first[k], to - first[k], 4)
        })
    }

    /// Finds the touched and the covered ones of 64 cells of `2^level` voxels.
    #[inline(always)]
    fn node<S: Simd, A: Axes<S>>(
        &self,
        axes: &A,
        values: A::Values,
        first: [i32; 3],
        level: u32,
        touching: &A::Bounds,
        covering: &A::Covering,
    ) -> Node<A::Values> {
        let left =
            box_mask(self.touched_cells(first, level)) & axes.touched(A::offset(values, touching), touching);
        let mut covered = box_mask(self.covered_cells(first, level)) & left;
        if covered != 0 {
            covered &= axes.covered(values, covering);
        }
        Node { values, first, left, covered }
    }

    /// Visits the bricks below cells of `2^level` voxels, at least 16.
    #[inline(never)]
    fn visit_cells<S: Simd, A: Axes<S>, V: FnMut([i32; 3], u64)>(
        &self,
        simd: S,
        axes: &A,
        level: u32,
        node: Node<A::Values>,
        voxels: &A::Bounds,
        visit: &mut V,
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let touching = axes.touching(simd, level - 2);
                let covering = axes.covering(simd, level - 2);
                let within = A::within(node.values);
                for at in cells(node.left) {
                    let first = per_axis(|k| (node.first[k] + at[k]) << 2);
                    let values = axes.step(within, at);
                    let child = if node.covered >> (at[0] + 4 * at[1] + 16 * at[2]) & 1 == 1 {
                        let left = axes.on_plane(A::offset(values, &touching), &touching);
                        Node { values, first, left, covered: u64::MAX }
                    } else {
                        self.node(axes, values, first, level - 2, &touching, &covering)
                    };
                    if level == 4 {
                        self.visit_bricks(axes, &child, voxels, visit);
                    } else {
                        self.visit_cells(simd, axes, level - 2, child, voxels, visit);
                    }
                }
            },
        );
    }

    /// Visits bricks: those that are covered first, since nothing but the plane is left to test.
    #[inline(always)]
    fn visit_bricks<S: Simd, A: Axes<S>>(
        &self,
        axes: &A,
        node: &Node<A::Values>,
        voxels: &A::Bounds,
        visit: &mut impl FnMut([i32; 3], u64),
    ) {
        let within = A::offset(A::within(node.values), voxels);
        let corner = per_axis(|k| self.corner[k] + (node.first[k] << 2));
        for at in cells(node.left & node.covered) {
            let mask = axes.on_plane(axes.step_on_plane(within, at), voxels);
            visit(per_axis(|k| corner[k] + (at[k] << 2)), mask);
        }
        // Voxels inside the triangle's box, of the 16 an axis.
        let inside =
            per_axis(|k| range_bits(self.region.first[k] - corner[k], self.region.last[k] - corner[k], 16));
        for at in cells(node.left & !node.covered) {
            let mask = box_mask(per_axis(|k| inside[k] >> (at[k] << 2)))
                & axes.touched(axes.step(within, at), voxels);
            // Only where bricks were not tested before.
            if mask != 0 {
                visit(per_axis(|k| corner[k] + (at[k] << 2)), mask);
            }
        }
    }
}

/// The cells of a mask, 0 to 3 an axis.
#[inline(always)]
fn cells(mask: u64) -> impl Iterator<Item = [i32; 3]> {
    SetBits(mask).map(
        #[inline(always)]
        |bit| [bit & 3, bit >> 2 & 3, bit >> 4].map(|c| c as i32),
    )
}
