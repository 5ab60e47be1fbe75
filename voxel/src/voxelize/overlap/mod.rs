//! Conservative overlap of triangles with voxels, bricks and blocks, in exact integer arithmetic.
//!
//! A triangle and a box overlap unless one of 13 axes separates them: the three box normals, the triangle's normal,
//! and the nine cross products of the triangle's edges with the box's axes (Akenine-Möller, "Fast 3D Triangle-Box
//! Overlap Testing", 2001; the grouping into three 2D tests and a plane test is that of Schwarz and Seidel, "Fast
//! Parallel Surface and Solid Voxelization on GPUs", 2010). We differ: all tests are two-sided intervals, so that
//! degenerate triangles (segments, points) need no case of their own, and nothing is ever rounded:
//!
//! - vertices are snapped to 1/256 voxel, integers below 2^25 for the largest grid (2^17 voxels);
//! - a 2D edge test is a sum of two products of numbers below 2^26: below 2^53, exact in i64;
//! - a component of the normal is twice the area of the triangle's projection into a square of side 2^25: at most 2^50.
//!   Its product with a position below 2^26, and the sum of three of them, stay below 2^78: formed once per triangle and
//!   brick in i128. Steps inside a brick (at most 3 voxels of 2^8 an axis) sum to less than 2^62: exact in i64.
//!
//! Each box is widened by one step (1/256 voxel) on every side. Snapping moves a vertex by at most half a step per axis
//! (and the f64 placement before it by far less: [`crate::grid::GridError::TooFine`]), so every point of the *unsnapped*
//! triangle lies within a step of the snapped one: **no voxel touched by the real triangle is missed**. A false
//! positive is no farther from the real triangle than 1.5 steps: half a step more than snapping alone would give, so
//! that a ray walk that is off by 2^-10 voxel still enters a voxel that knows the triangle.

mod bits;
mod descent;
mod plane;
mod projection;

use fearless_simd::{Level, dispatch};

use self::descent::Region;
use self::projection::KEPT_AXES;
use super::SnappedTriangle;
use crate::grid::SUBVOXELS;

/// Widening of each box, in snapping steps.
const WIDEN: i32 = 1;
/// log2 of the steps a voxel.
const STEPS_LOG2: u32 = SUBVOXELS.trailing_zeros();

/// A snapped triangle, ready for overlap tests.
#[derive(Clone, Copy, Debug)]
pub struct TriangleOverlap {
    vertices: SnappedTriangle,
    /// Low and high corner in steps.
    min: [i32; 3],
    max: [i32; 3],
}

impl TriangleOverlap {
    /// From snapped vertices, in steps of 1/256 voxel, each coordinate in `0 ..= 2^25`.
    #[inline(always)]
    pub fn new(vertices: SnappedTriangle) -> Self {
        let [a, b, c] = vertices;
        let min = [0, 1, 2].map(|k| a[k].min(b[k]).min(c[k]));
        let max = [0, 1, 2].map(|k| a[k].max(b[k]).max(c[k]));
        TriangleOverlap { vertices, min, max }
    }

    /// First and last cell of `2^shift` voxels that its widened box touches, per axis; may lie outside the grid by one.
    #[inline(always)]
    pub fn cell_range(&self, shift: u32) -> ([i32; 3], [i32; 3]) {
        let size_log2 = shift + STEPS_LOG2;
        // A cell [a, b] touches when a - WIDEN <= max and b + WIDEN >= min; floor((m - 1) / s) = ceil(m / s) - 1.
        let low = self.min.map(|c| (c - WIDEN - 1) >> size_log2);
        let high = self.max.map(|c| (c + WIDEN) >> size_log2);
        (low, high)
    }

    /// Extent of its box in steps.
    #[inline(always)]
    fn extent(&self) -> [i32; 3] {
        [0, 1, 2].map(|k| self.max[k] - self.min[k])
    }

    /// Does it touch the cell of `2^shift` voxels whose low corner is voxel `corner`?
    ///
    /// One cell at a time, straight from the 13 axes: the reference of [`Self::for_each_brick`].
    pub fn touches_cell(&self, corner: [i32; 3], shift: u32) -> bool {
        let v = self.vertices.map(|p| p.map(i64::from));
        let low = corner.map(|c| i64::from(c) * i64::from(SUBVOXELS) - i64::from(WIDEN));
        let size = (i64::from(SUBVOXELS) << shift) + 2 * i64::from(WIDEN);
        let outside = |k: usize| low[k] > i64::from(self.max[k]) || low[k] + size < i64::from(self.min[k]);
        if outside(0) || outside(1) || outside(2) {
            return false;
        }
        let edge = |a: usize, b: usize| [0, 1, 2].map(|k| v[b][k] - v[a][k]);
        let edges = [edge(0, 1), edge(1, 2), edge(2, 0)];
        for (a, b) in KEPT_AXES {
            for (e, edge) in edges.iter().enumerate() {
                let normal = [-edge[b], edge[a]];
                let project = |p: &[i64; 3]| normal[0] * p[a] + normal[1] * p[b];
                // Both ends of the edge project to the same value.
                let (on_edge, opposite) = (project(&v[e]), project(&v[(e + 2) % 3]));
                let reach = |pick: fn(i64) -> i64| (pick(normal[0]) + pick(normal[1])) * size;
                let at_low = project(&low);
                if at_low + reach(|n| n.max(0)) < on_edge.min(opposite)
                    || at_low + reach(|n| n.min(0)) > on_edge.max(opposite)
                {
                    return false;
                }
            }
        }
        let [p, q, _] = edges;
        let normal = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
        let at_low: i128 = (0..3).map(|k| i128::from(normal[k]) * i128::from(low[k] - v[0][k])).sum();
        let reach = |pick: fn(i64) -> i64| {
            normal.iter().map(|&n| i128::from(pick(n))).sum::<i128>() * i128::from(size)
        };
        at_low + reach(|n| n.max(0)) >= 0 && at_low + reach(|n| n.min(0)) <= 0
    }

    /// Calls `visit(corner, mask)` for the bricks that it touches within the cell of `2^shift` voxels (at least 4) at
    /// `cell` and within a grid of `side` voxels, each once, in no particular order. Bit x + 4 y + 16 z of a mask is the
    /// voxel (x, y, z) of the brick; no mask is empty.
    pub fn for_each_brick(
        &self,
        cell: [i32; 3],
        shift: u32,
        side: i32,
        visit: &mut impl FnMut([i32; 3], u64),
    ) {
        self.for_each_brick_in(Region::cell(cell, shift, side), visit);
    }

    fn for_each_brick_in(&self, clip: Region, visit: &mut impl FnMut([i32; 3], u64)) {
        dispatch!(Level::new(), simd => descent::for_each_brick(simd, self, clip, visit));
    }
}

/// [`TriangleOverlap::for_each_brick`] for many triangles and one cell, one triangle after the other: faster where
/// triangles are small, since the processor's SIMD level is chosen once.
pub fn for_each_brick_of(
    level: Level,
    triangles: impl IntoIterator<Item = SnappedTriangle>,
    cell: [i32; 3],
    shift: u32,
    side: i32,
    visit: &mut impl FnMut([i32; 3], u64),
) {
    let clip = Region::cell(cell, shift, side);
    dispatch!(level, simd => descent::for_each_brick_of(simd, triangles, clip, visit));
}
